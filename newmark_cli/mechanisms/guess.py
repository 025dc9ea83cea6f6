"""Positions that a mechanism file guesses, and how far assembling has moved them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.mechanisms.models import GROUND
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document

#: How many times the size of a mechanism assembling may move a part.
_FAR = 2.0


class Guess(NamedTuple):
    """What a file guesses of positions.

    Attributes:
        names: (k,) moving points of a planar mechanism, bodies of a spatial one.
        before, after: (k, 2) or (k, 3) their positions in the file, and assembled (m).
    """

    names: tuple[str, ...]
    before: Array
    after: Array

    @property
    def moved(self) -> dict[str, float]:
        """How far assembling has moved each (m)."""
        away = np.linalg.norm(self.after - self.before, axis=1)
        return dict(zip(self.names, away.tolist(), strict=True))


def guess(problem: Problem, mechanism: Any) -> Guess:
    """Guessed positions next to those of the problem, which is assembled."""
    if mechanism.dimensions == 2:
        names = problem.points
        before = [mechanism.points[name].at for name in names]
        after = problem.u0[: 2 * len(names)].reshape(-1, 2)  # angles come behind the points
    else:
        names = tuple(mechanism.bodies)
        before = [mechanism.bodies[name].position for name in names]
        after = problem.u0.reshape(-1, 12)[:, :3]  # directors come behind an origin
    return Guess(names, np.array(before, float), after)


def doubts(problem: Problem, document: Document) -> tuple[str, ...]:
    """A line, with file, line and key, on what assembling has moved too far to be meant.

    Too far is twice the size of the mechanism.  That is the box around its places as guessed or
    as assembled, the smaller of both: neither a position nor a length that is wrong makes it large.
    """
    mechanism = getattr(problem.drawing, "mechanism", problem.drawing)
    if not mechanism.assemble:
        return ()
    guessed = guess(problem, mechanism)
    around = np.array(_fixed(mechanism), float).reshape(-1, guessed.before.shape[1])
    size = min(
        float(np.linalg.norm(np.ptp(np.concatenate([around, places]), axis=0)))
        for places in (guessed.before, guessed.after)
    )
    moved = guessed.moved
    name = max(moved, key=moved.__getitem__)
    if moved[name] <= _FAR * size:
        return ()
    path = ("points", name, "at") if mechanism.dimensions == 2 else ("bodies", name, "position")
    before = ", ".join(f"{number:g}" for number in guessed.before[guessed.names.index(name)])
    text = f"[{before}] is {moved[name]:.3g} m from where assembling puts {name}, more than twice"
    return (str(document.error(path, f"{text} the size of the mechanism, {size:.3g} m")),)


def _fixed(mechanism: Any) -> list[Sequence[float]]:
    """Places on the ground."""
    if mechanism.dimensions == 2:
        return [point.fixed for point in mechanism.points.values() if point.fixed is not None]
    return [
        joint.at[GROUND] if isinstance(joint.at, dict) else joint.at
        for joint in mechanism.joints.values()
        if GROUND in (joint.from_, joint.to)
    ]
