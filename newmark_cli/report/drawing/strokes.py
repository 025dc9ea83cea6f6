"""Strokes of drawings of mechanisms, in the plane of the paper: places are x + iy."""

from collections.abc import Sequence
from typing import Any


def line(axes: Any, points: Sequence[complex], **look: Any) -> None:
    """A line through places."""
    axes.plot([p.real for p in points], [p.imag for p in points], **look)


def zigzag(start: complex, end: complex, amplitude: float, coils: int = 7) -> list[complex]:
    """Places along a spring."""
    along = end - start
    normal = along / abs(along) * 1j
    inner = [
        start + along * (0.2 + 0.6 * (k + 0.5) / (2 * coils)) + (-1) ** k * amplitude * normal
        for k in range(2 * coils)
    ]
    return [start, start + 0.2 * along, *inner, start + 0.8 * along, end]


def damper(axes: Any, start: complex, end: complex, width: float) -> None:
    """A damper between two places."""
    along = (end - start) / abs(end - start)
    middle, side = (start + end) / 2, width * along * 1j
    look = {"color": "#CC79A7", "linewidth": 0.9}
    line(axes, [start, middle], **look)
    line(axes, [middle - 0.7 * side, middle + 0.7 * side], **look)
    cup = [middle + 1.5 * width * along - side, middle + 1.5 * width * along + side]
    line(
        axes,
        [middle - 0.5 * width * along - side, cup[0], cup[1], middle - 0.5 * width * along + side],
        **look,
    )
    line(axes, [middle + 1.5 * width * along, end], **look)
