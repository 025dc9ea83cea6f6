"""What surrounds a command changes no result unseen: kernels of the BLAS, drawing settings."""

import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from command_line import CommandLine
from conftest import QUICK

from newmark_cli.study import provenance

EXAMPLES = Path(__file__).parents[2] / "docs/examples"


@pytest.fixture(scope="module")
def other_kernel():
    """A kernel that processors of this kind have, besides the one that the BLAS takes here."""
    here = provenance.blas_kernel()
    if platform.machine() not in ("x86_64", "AMD64") or here == "unknown":
        pytest.skip("the BLAS of this machine has one kernel, or does not tell")
    return "Nehalem" if here != "Nehalem" else "Haswell"


#: Runs commands, each with its arguments, in a process that loads its libraries itself.
IN_TURN = """
import sys
from newmark_cli.cli import main
for command in {}:
    try:
        main(command)
    except SystemExit as ending:
        if ending.code:
            raise
"""


def in_turn(folder, commands, **environment):
    """Run commands in one process of their own, which must end well; what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", IN_TURN.format(commands)], cwd=folder, text=True,
        capture_output=True, env=os.environ | environment, timeout=120,
    )  # fmt: skip
    told = [line for line in done.stderr.splitlines() if "does not see a scaling" not in line]
    assert (done.returncode, told) == (0, [])
    return done.stdout


#: What its cells record passes through everything that computes: starts that are assembled and
#: projected, dense and static elimination, condition numbers, references, formulations.
BITS = """\
study: bits
expect: [{measure: correction, at_least: 1.0e-99}]
cases:
  - problem: [andrews, spatial-slider-crank]
    form: u-v-a-lambda
    preconditioning: optimal
    h: 1e-3
    t_end: 0.002
    measure: [correction, condition, sensitivity, error, invariant, floor]
  - problem: governor
    form: u-lambda
    preconditioning: optimal
    formulation: ggl
    h: 1e-3
    t_end: 0.005
    measure: [correction, condition, trajectory]
  - problem: hoist.yaml
    form: v-lambda
    preconditioning: left
    linear_solver: gmres
    h: 1e-3
    t_end: 0.005
    measure: [condition, krylov]
"""


@pytest.mark.release  # .ci/run compares two studies with other kernels
def test_results_are_the_same_with_every_kernel(cli, other_kernel):
    """To the bit, in whatever order sets are; cells computed with one serve the other.

    The run's record names its own.
    """
    cli.write("bits.yaml", BITS)
    shutil.copy(EXAMPLES / "hoist.yaml", cli.folder)
    assert cli("run", "bits.yaml").stdout == "bits: 4 ok -> results/bits.csv\n"
    commands = (["run", "bits.yaml", "--results", "two"], ["run", "bits.yaml"])
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    printed = in_turn(cli.folder, commands, OPENBLAS_CORETYPE=other_kernel, PYTHONHASHSEED=seed)
    assert printed.splitlines() == [
        "bits: 4 ok -> two/bits.csv", "bits: 4 ok (4 cached) -> results/bits.csv"
    ]  # fmt: skip
    one, two = cli.folder / "results", cli.folder / "two"
    for name in ("bits.csv", "trajectory/bits.csv", "bits.json"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    cells = json.loads((two / "bits.json").read_text())["cells"]
    assert all(cell["operations"] > 0 for cell in cells)
    run = json.loads((two / "runs/bits.json").read_text())
    assert run["blas"]["kernel"] == other_kernel
    assert re.search(r"\d+\.\d+", run["blas"]["loaded"])
    told = cli("show", "--record", "--results", "two").stdout
    assert re.search(rf"BLAS kernel +{other_kernel}\n", told)


#: Commands that draw a mechanism, and a study, each with imports of its own.
DRAWING = (["draw", "four-bar"], ["plot", "quick", "--measure", "condition"])


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A study's results, and figures that nobody's settings have touched."""
    cli = CommandLine(tmp_path_factory.mktemp("plain"))
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    for command in DRAWING:
        cli(*command)
    return cli


def test_settings_change_no_figure(cli, plain):
    """Those of a file that matplotlib reads as it is imported, nor those of a calling program."""
    ignored = shutil.ignore_patterns("figures")
    shutil.copytree(plain.folder / "results", cli.folder / "results", ignore=ignored)
    cli.write("matplotlibrc", "figure.facecolor: red\nfont.size: 20\nsavefig.dpi: 30\n")
    in_turn(cli.folder, DRAWING[:1], MPLBACKEND="svg")
    with mpl.rc_context({"font.size": 20, "axes.facecolor": "red", "savefig.dpi": 20}):
        cli(*DRAWING[1])
    drawn, expected = (
        {file.name: file.read_bytes() for file in (where.folder / "results/figures").iterdir()}
        for where in (cli, plain)
    )
    assert drawn == expected
    assert len(drawn) >= 2
