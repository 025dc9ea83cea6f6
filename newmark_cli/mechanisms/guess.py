"""Positions that a mechanism file guesses, and how far assembling has moved them."""

import math

import numpy as np

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import Document, KeyPath

#: How many times the size of a mechanism assembling may move a part.
_FAR = 2.0


def _places(problem: Problem) -> tuple[list[KeyPath], Array, Array]:
    """Keys of what is guessed, and (k, 2) or (k, 3) places in the file and now (m)."""
    guessed, axes = problem.drawing.guessed, len(problem.axes)
    vectors = 1 if axes == 2 else 4  # directors come behind an origin
    now = problem.u0[: axes * vectors * len(guessed)].reshape(-1, vectors, axes)[:, 0]
    return list(guessed), np.array(list(guessed.values()), float), now


def doubts(problem: Problem, document: Document) -> tuple[str, ...]:
    """A line, with file, line and key, on what assembling has moved too far to be meant.

    Too far is twice the size of the mechanism.  That is the box around its places as guessed or
    as assembled, the smaller of both: neither a position nor a length that is wrong makes it large.
    """
    if not problem.drawing.assemble:
        return ()
    paths, before, after = _places(problem)
    around = np.array(problem.drawing.grounded, float).reshape(-1, before.shape[1])
    size = min(
        float(np.linalg.norm(np.ptp(np.concatenate([around, places]), axis=0)))
        for places in (before, after)
    )
    away = np.linalg.norm(after - before, axis=1)
    most = int(np.argmax(away))
    if away[most] <= _FAR * size:
        return ()
    guessed = ", ".join(f"{number:g}" for number in before[most])
    text = f"[{guessed}] is {away[most]:.3g} m from where assembling puts {paths[most][1]}, more "
    text += f"than twice the size of the mechanism, {size:.3g} m"
    return (str(document.error(paths[most], text)),)


def assembled(problem: Problem) -> list[str]:
    """A line on how far assembling has moved what a file guesses; none if it guesses nothing."""
    mechanism = problem.drawing
    if mechanism is None or not mechanism.assemble:
        return []
    paths, before, after = _places(problem)
    away = np.linalg.norm(after - before, axis=1)
    found = [(away, 1e-12, "{}, the farthest, is {:.3g} m from its guess")]
    if len(problem.axes) == 3:
        from newmark_cli.mechanisms.spatial_model import directors

        turned = problem.u0.reshape(-1, 4, 3)[:, 1:] - directors(mechanism.bodies.values())
        half = np.arcsin(np.minimum(np.linalg.norm(turned, axis=(1, 2)) / math.sqrt(8), 1.0))
        found.append((2 * np.degrees(half), 1e-6, "{} has turned most, by {:.3g}°"))
    parts = [
        text.format(paths[most][1], by[most])
        for by, least, text in found
        if by[most := int(np.argmax(by))] >= least
    ]
    return [f"  assembled: {'; '.join(parts) or 'nothing moved'}"]
