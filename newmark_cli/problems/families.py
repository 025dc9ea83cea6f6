"""Mechanisms of any size: the data of a planar mechanism, made from a few numbers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from newmark_cli.problems.problem import Problem

#: Largest size: a million links take gigabytes; more is a slip of the finger.
LARGEST = 1_000_000


@dataclass(frozen=True)
class Family:
    """Mechanisms that differ in their size.

    Attributes:
        title: One line.
        parameters: Names of the sizes, each a whole number from 1 to `LARGEST`.
        mechanism: Sizes, by name → data of a `planar.Mechanism`.
    """

    title: str
    parameters: tuple[str, ...]
    mechanism: Callable[..., dict[str, Any]]

    def problem(self, name: str, sizes: Mapping[str, int]) -> Problem:
        """The member of these sizes, under this name."""
        from newmark_cli.problems import planar  # numba and numpy only when they are needed

        return planar.build(name, planar.Mechanism.model_validate(self.mechanism(**sizes)))


def chain(links: int) -> dict[str, Any]:
    """A chain of point masses and massless bars that falls from the horizontal.

    Its first end is fixed, its other end free.  Every mass, every bar and gravity
    are 1, as in the pendulum of Section 5.1 of the paper, which is ``chain(1)``;
    so the chain is ``links`` long, and its joints start at whole numbers, which
    meet the constraints exactly at any length.
    """
    points: dict[str, Any] = {"P0": {"fixed": (0.0, 0.0)}}
    bars: dict[str, Any] = {}
    for i in range(1, links + 1):
        points[f"P{i}"] = {"at": (float(i), 0.0), "mass": 1.0}
        bars[f"bar{i}"] = {"from": f"P{i - 1}", "to": f"P{i}", "length": 1.0}
    return {
        "title": f"Falling chain of {links} links",
        "points": points,
        "bars": bars,
        "gravity": (0.0, -1.0),
    }


def four_bars(windows: int) -> dict[str, Any]:
    """Four-bar linkages side by side, each sharing a rod with the next.

    ``windows`` + 1 rods stand upright on pins, as many couplers as windows join
    their tops; all are uniform, 1 m long, of 1 kg.  The tops start at 1 m/s, and
    the one degree of freedom falls under gravity.  In the horizontal position,
    which the motion passes, G loses rank.  Problem A02 of M. González, D. Dopico,
    U. Lugrís, J. Cuadrado, "A benchmarking system for MBS simulation software",
    Multibody System Dynamics 16 (2006).
    """
    rod = {"length": 1.0, "mass": 1.0, "centre": (0.5, 0.0), "inertia": 1 / 12}
    points: dict[str, Any] = {}
    bodies: dict[str, Any] = {}
    # From left to right, so that what is joined stands close in the coordinates.
    for i in range(windows + 1):
        points[f"A{i}"] = {"fixed": (float(i), 0.0)}
        points[f"B{i}"] = {"at": (float(i), 1.0), "velocity": (1.0, 0.0)}
        if i > 0:
            bodies[f"coupler{i}"] = {"from": f"B{i - 1}", "to": f"B{i}"} | rod
        bodies[f"rod{i}"] = {"from": f"A{i}", "to": f"B{i}"} | rod
    return {
        "title": f"{windows} four-bar linkages side by side",
        "source": "González, Dopico, Lugrís, Cuadrado 2006, problem A02",
        "points": points,
        "bodies": bodies,
        "gravity": (0.0, -9.81),
    }


FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        "chain": Family("falling chain of point masses", ("links",), chain),
        "four-bars": Family("four-bar linkages side by side", ("windows",), four_bars),
    }
)
