"""Ends cells where rows that were dropped as redundant are needed."""

from newmark_cli.newmark.needed import Needed
from newmark_cli.problems.problem import Problem
from newmark_cli.study.measures import Observer

#: Status of a cell that was ended.
REDUNDANT = "redundant"


class Watch(Needed, Observer):
    """Looks at the constraints that were kept along a march of a cell."""

    def __init__(self, problem: Problem, steps: int) -> None:
        super().__init__(problem, steps)
