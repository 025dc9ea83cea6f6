"""What the drivers of this folder share: the command, the kernel of BLAS, and words of verdicts."""

import argparse
import os
import sys
from pathlib import Path

#: Verdicts with which `check` fails, by which it is satisfied, and which say neither; the last
#: two of them are what results before 0.3 call it.
RED, GREEN = ("miss", "not converging"), ("pass",)
UNDECIDED = ("undecided", "not asymptotic", "too few points")


def decided(verdict: str) -> str:
    """A verdict, under one name where it says neither yes nor no."""
    return "undecided" if verdict in UNDECIDED else verdict


def command() -> str:
    """The console script beside this interpreter, or else the one on the path."""
    beside = Path(sys.executable).with_name("newmark-study")
    return str(beside) if beside.exists() else "newmark-study"


def options(description: str) -> argparse.ArgumentParser:
    """A parser with the options that every driver has."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("results", type=Path, help="folder that is written to")
    parser.add_argument("--kernel", help="OPENBLAS_CORETYPE: Nehalem, Haswell, SkylakeX and so on")
    return parser


def parsed(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """The arguments, in a process whose BLAS takes the kernel that they name.

    OpenBLAS chooses when NumPy is loaded, so the process starts again.
    """
    given = parser.parse_args()
    if given.kernel and os.environ.get("OPENBLAS_CORETYPE") != given.kernel:
        os.environ["OPENBLAS_CORETYPE"] = given.kernel
        os.execv(sys.executable, [sys.executable, *sys.argv])
    return given
