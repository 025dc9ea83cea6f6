"""Problems by name: the mechanism files that travel with the package."""

from functools import cache
from pathlib import Path

from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.spelling import nearest

_FOLDER = Path(__file__).parent / "shipped"

#: Names of the shipped problems.
PROBLEMS = tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


@cache
def problem(name: str) -> Problem:
    """The shipped problem of this name.

    Raises:
        ProblemError: When there is none.
    """
    if name not in PROBLEMS:
        raise ProblemError(f"unknown problem {name!r}{nearest(name, PROBLEMS)}")
    from newmark_cli.mechanisms import planar

    return planar.load(_FOLDER / f"{name}.yaml", name)
