"""The example of the documentation in Python, compiled once for all tests of a process."""

from functools import cache
from pathlib import Path

from newmark_cli.problems import python_problem

CAR_AXIS = Path(__file__).parents[1] / "docs/examples/car_axis.py"


@cache
def car_axis(compiled):
    """The car axis, with compiled functions or plain ones; tests share it and change nothing."""
    return python_problem.load(CAR_AXIS, "car_axis", {"compiled": compiled}, "car axis")
