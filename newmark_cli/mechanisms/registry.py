"""Problems by name: the mechanism files that travel with the package."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support.spelling import nearest

_FOLDER = Path(__file__).parent / "shipped"
#: Members of the test set, with their reference values.
TESTSET_FOLDER = Path(__file__).parent / "testset"

#: Names of the project's own problems, and of the members of the test set.
SHIPPED, TESTSET = (
    tuple(sorted(file.stem for file in folder.glob("*.yaml")))
    for folder in (_FOLDER, TESTSET_FOLDER)
)
#: Names of all problems that travel with the package.
PROBLEMS = tuple(sorted((*SHIPPED, *TESTSET)))


@cache
def digest() -> str:
    """Hexadecimal digest of the files of the shipped problems."""
    sha256 = hashlib.sha256()
    for name in PROBLEMS:
        sha256.update(name.encode() + b"\0" + file(name).read_bytes())
    return sha256.hexdigest()


def file(name: str) -> Path:
    """The file of a shipped problem."""
    return (TESTSET_FOLDER if name in TESTSET else _FOLDER) / f"{name}.yaml"


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
    """Coordinates and constraints of a valid mechanism, as far as shipped ones go."""
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
    # Each angle that is a coordinate has a constraint.
    twisted = all_of("torsion_springs", "torsion_dampers")
    turning = {part[end] for part in twisted for end in ("from", "to") if end in part}
    for motion in all_of("motions"):
        turning |= {motion["body"], motion["relative_to"]} if "relative_to" in motion else set()
    turning |= {wheel["wheel"] for wheel in all_of("rolling")}
    angles = len(turning & data.get("bodies", {}).keys())
    angles += sum("circle" in wheel for wheel in all_of("rolling"))
    points = sum("at" in point for point in data["points"].values())
    return 2 * points + angles, bodies + rows + angles
