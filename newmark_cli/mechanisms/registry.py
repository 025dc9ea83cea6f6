"""Problems by name: the mechanism files that travel with the package."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support.spelling import nearest

_FOLDER = Path(__file__).parent / "shipped"

#: Names of the shipped problems.
PROBLEMS = tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


@cache
def digest() -> str:
    """Hexadecimal digest of the files of the shipped problems."""
    sha256 = hashlib.sha256()
    for name in PROBLEMS:
        sha256.update(name.encode() + b"\0" + file(name).read_bytes())
    return sha256.hexdigest()


def file(name: str) -> Path:
    """The file of a shipped problem."""
    return _FOLDER / f"{name}.yaml"


@cache
def problem(name: str) -> Problem:
    """The shipped problem of this name.

    Raises:
        ProblemError: When there is none.
    """
    if name not in PROBLEMS:
        raise ProblemError(f"unknown problem {name!r}{nearest(name, PROBLEMS)}")
    from newmark_cli.mechanisms import loading

    return loading.load(file(name), name)


@cache
def is_spatial(name: str) -> bool:
    """Whether there is a shipped mechanism in space of this name; nothing is built."""
    from newmark_cli.support import documents

    data = documents.read(file(name)).data if name in PROBLEMS else {}
    return data.get("dimensions") == 3


def size(data: Mapping[str, Any]) -> tuple[int, int]:
    """Coordinates and constraints of the data of a valid mechanism without angle coordinates."""
    from newmark_cli.mechanisms.joints import JOINTS

    def all_of(*kinds: str) -> list[Any]:
        return [part for kind in kinds for part in data.get(kind, {}).values()]

    bodies = len(all_of("bodies"))
    rows = len(all_of("bars", "sliders", "angle_joints", "gears")) + 2 * len(all_of("rolling"))
    rows += sum(len(JOINTS[joint["type"]].rows) for joint in all_of("joints"))
    driven = {"angle", "distance", "x", "y", "z"}
    rows += sum(len(driven & motion.keys()) for motion in all_of("motions"))
    if data.get("dimensions") == 3:
        redundant = data.get("redundant", {})
        released = 0 if isinstance(redundant, str) else sum(map(len, redundant.values()))
        return 12 * bodies, 6 * bodies + rows - released
    return 2 * sum("at" in point for point in data["points"].values()), bodies + rows
