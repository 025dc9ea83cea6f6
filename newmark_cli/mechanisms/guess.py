"""Positions that a mechanism file guesses, and how far assembling has moved them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from newmark_cli.mechanisms.models import GROUND
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document

#: How many times the size of a mechanism assembling may move a part.
_FAR = 2.0


def _places(problem: Problem, mechanism: Any) -> tuple[tuple[str, ...], Array, Array]:
    """(k,) moving points or bodies, and (k, 2) or (k, 3) their places in the file and now (m)."""
    if mechanism.dimensions == 2:
        names = problem.points
        before = [mechanism.points[name].at for name in names]
        after = problem.u0[: 2 * len(names)].reshape(-1, 2)  # angles come behind the points
    else:
        names = tuple(mechanism.bodies)
        before = [mechanism.bodies[name].position for name in names]
        after = problem.u0.reshape(-1, 12)[:, :3]  # directors come behind an origin
    return names, np.array(before, float), after


def doubts(problem: Problem, document: Document) -> tuple[str, ...]:
    """A line, with file, line and key, on what assembling has moved too far to be meant.

    Too far is twice the size of the mechanism.  That is the box around its places as guessed or
    as assembled, the smaller of both: neither a position nor a length that is wrong makes it large.
    """
    mechanism = problem.drawing
    if not mechanism.assemble:
        return ()
    names, before, after = _places(problem, mechanism)
    around = np.array(_fixed(mechanism), float).reshape(-1, before.shape[1])
    size = min(
        float(np.linalg.norm(np.ptp(np.concatenate([around, places]), axis=0)))
        for places in (before, after)
    )
    away = np.linalg.norm(after - before, axis=1)
    most = int(np.argmax(away))
    if away[most] <= _FAR * size:
        return ()
    name = names[most]
    path = ("points", name, "at") if mechanism.dimensions == 2 else ("bodies", name, "position")
    guessed = ", ".join(f"{number:g}" for number in before[most])
    text = f"[{guessed}] is {away[most]:.3g} m from where assembling puts {name}, more than twice"
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


def assembled(problem: Problem) -> list[str]:
    """A line on how far assembling has moved what a file guesses; none if it guesses nothing."""
    mechanism = problem.drawing
    if mechanism is None or not mechanism.assemble:
        return []
    names, before, after = _places(problem, mechanism)
    away = np.linalg.norm(after - before, axis=1)
    found = [(away, 1e-12, "{}, the farthest, is {:.3g} m from its guess")]
    if mechanism.dimensions == 3:
        from newmark_cli.mechanisms.spatial_model import directors

        turned = problem.u0.reshape(-1, 4, 3)[:, 1:] - directors(mechanism.bodies.values())
        half = np.arcsin(np.minimum(np.linalg.norm(turned, axis=(1, 2)) / math.sqrt(8), 1.0))
        found.append((2 * np.degrees(half), 1e-6, "{} has turned most, by {:.3g}°"))
    parts = [
        text.format(names[most], by[most])
        for by, least, text in found
        if by[most := int(np.argmax(by))] >= least
    ]
    return [f"  assembled: {'; '.join(parts) or 'nothing moved'}"]
