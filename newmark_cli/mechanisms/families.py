"""Mechanisms of any size, made from a few numbers.

Each is the data that a file would have.
"""

import gc
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Field, Strict, create_model

from newmark_cli.mechanisms.sines import sine_cosine
from newmark_cli.problems.problem import Problem
from newmark_cli.support.documents import WHOLE, StrictModel

#: Of what is drawn at random.
_SEED = 20061012


@dataclass(frozen=True)
class Family:
    """Mechanisms that differ in their size.

    Attributes:
        title: One line.
        sizes: Its parameters, whole numbers, and what they count.
        counts: How many coordinates and constraints follow from them.
        mechanism: Sizes, by name → data of a mechanism.
        most: What a size may be at most: a million links take gigabytes, and so does a net of
            a million bars; more is a slip of the finger.
    """

    title: str
    sizes: Mapping[str, str]
    counts: str
    mechanism: Callable[..., dict[str, Any]]
    most: int = 1_000_000

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.sizes)

    @cached_property
    def size(self) -> type[StrictModel]:
        """What a config may say of them."""
        number = Annotated[int, Strict(), Field(ge=1, le=self.most), WHOLE]
        fields: Any = {name: (number, Field(description=text)) for name, text in self.sizes.items()}
        return create_model("Sizes", __base__=StrictModel, **fields)

    def problem(self, name: str, sizes: Mapping[str, int]) -> Problem:
        """The member of these sizes, under this name."""
        from newmark_cli.mechanisms import loading

        enabled = gc.isenabled()
        gc.disable()  # it would look at all parts again and again, a third longer
        try:
            return loading.made(name, self.mechanism(**sizes))
        finally:
            if enabled:
                gc.enable()


def chain(links: int) -> dict[str, Any]:
    """A chain of point masses and massless bars that falls from a straight line.

    Its first end is fixed, its other end free; it is released at rest.  Every
    mass, every bar and gravity are 1, as in the pendulum of Section 5.1 of the
    paper, which ``chain(1)`` is, so that a chain is ``links`` long.

    The line descends by 3 in 5.  From the horizontal all but the first links fall
    side by side, at whole distances that floating point holds exactly, for as long
    as the bend takes to travel: Φ evaluates to zero, corrections of u fall below
    one unit in the last place of it, and corrections of λ die out, or are caught
    on their way, instead of showing rounding.
    """
    places = range(1, links + 1)
    x, y = [0.8 * i for i in places], [-0.6 * i for i in places]
    return _hung(f"Falling chain of {links} links", x, y, [1.0] * links)


def random_chain(links: int) -> dict[str, Any]:
    """A chain like `chain`, its links in random directions and of random masses.

    In a straight chain GᵀM⁻¹G is a second difference: its condition number, and
    under the optimal scaling that of J̄, grows with the square of ``links``, and
    Krylov solvers need twice as many iterations as there are links.  Where the links
    turn at random the condition number hardly depends on their number.  Masses
    between 0.5 and 1.5, because equal ones make the largest block of an unscaled J̄
    all but a multiple of the identity, which a Krylov solver disposes of in one
    iteration.  Directions and masses are drawn from a fixed seed, one link after the
    other, so that a shorter chain is the beginning of a longer one.
    """
    draw = random.Random(_SEED).random
    drawn = [draw() for _ in range(2 * links)]
    masses = [0.5 + part for part in drawn[1::2]]
    y, x = zip(*(sine_cosine(math.tau * part, np.float64) for part in drawn[::2]), strict=True)
    title = f"Falling chain of {links} links in random directions"
    return _hung(title, list(accumulate(x)), list(accumulate(y)), masses)


def _hung(
    title: str, x: Sequence[float], y: Sequence[float], masses: Sequence[float]
) -> dict[str, Any]:
    """Point masses joined by massless bars, the first to the origin, under gravity 1."""
    places = list(zip(x, y, strict=True))
    points: dict[str, Any] = {"P0": {"fixed": (0.0, 0.0)}}
    bars: dict[str, Any] = {}
    for i, (place, mass) in enumerate(zip(places, masses, strict=True), 1):
        points[f"P{i}"] = {"at": place, "mass": mass}
    for i, (start, end) in enumerate(pairwise([(0.0, 0.0), *places]), 1):
        # 1 but for the rounding of the ends, so that any length starts assembled.
        bars[f"bar{i}"] = {"from": f"P{i - 1}", "to": f"P{i}", "length": math.dist(start, end)}
    return {"title": title, "points": points, "bars": bars, "gravity": (0.0, -1.0)}


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


def _descending(heading: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Direction of a bar that descends by 3 in 5, and one across."""
    sine, cosine = sine_cosine(heading, np.float64)
    return (0.8 * cosine, 0.8 * sine, -0.6), (-sine, cosine, 0.0)


def spatial_chain(bodies: int) -> dict[str, Any]:
    """A chain of bars on spherical joints that falls in space, released at rest.

    Each bar is a homogeneous box of 1 m and 1 kg; gravity is 1.  They descend as those of
    `chain` and turn to and fro about the upright, each by 1 rad from the last, so that no two
    neighbours move in one plane.
    """
    net = _Net(f"Falling chain of {bodies} bars in space")
    at, above = (0.0, 0.0, 0.0), "ground"
    for i in range(bodies):
        net.join(f"joint{i + 1}", above, f"bar{i + 1}", at)
        above, (dx, dy, dz) = f"bar{i + 1}", net.along[i % 2][0]
        net.bar(above, (at[0] + dx / 2, at[1] + dy / 2, at[2] + dz / 2), i % 2)
        at = at[0] + dx, at[1] + dy, at[2] + dz
    return net.data


class _Net:
    """Equal homogeneous bars, and spherical joints between them; all at rest."""

    def __init__(self, title: str) -> None:
        #: Directions of bars, and one across each.
        self.along = [*map(_descending, (0.5, -0.5)), ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))]
        self.bodies: dict[str, Any] = {}
        self.joints: dict[str, Any] = {}
        self.data = {
            "title": title, "dimensions": 3, "bodies": self.bodies, "joints": self.joints,
            "gravity": (0.0, 0.0, -1.0),
        }  # fmt: skip

    def bar(self, name: str, place: tuple[float, float, float], kind: int) -> None:
        axes = dict(zip("xy", self.along[kind], strict=True))
        self.bodies[name] = {"position": place, "axes": axes, "mass": 1.0, "box": (1.0, 0.2, 0.1)}

    def join(self, name: str, start: str, end: str, at: tuple[float, float, float]) -> None:
        self.joints[name] = {"type": "spherical", "from": start, "to": end, "at": at}


def spatial_grid(rows: int, columns: int) -> dict[str, Any]:
    """A net of bars on spherical joints that falls in space, released at rest.

    ``columns`` chains like `spatial_chain` hang side by side, 1 m apart, and a bar joins the
    ends of neighbours in each of the ``rows``.  Where four bars meet, three are jointed to the
    one above.  All its loops are closed by constraints that do not depend on each other.
    """
    net = _Net(f"Falling net of {rows} by {columns} bars in space")
    x = y = z = 0.0
    above = ["ground"] * columns
    for i in range(1, rows + 1):
        dx, dy, dz = net.along[i % 2][0]
        hanging = [f"bar{i}.{j + 1}" for j in range(columns)]
        for j, name in enumerate(hanging):
            net.join(f"hang{i}.{j + 1}", above[j], name, (x, y + j, z))
            net.bar(name, (x + dx / 2, y + dy / 2 + j, z + dz / 2), i % 2)
        x, y, z = x + dx, y + dy, z + dz
        for j in range(columns - 1):
            tie = f"tie{i}.{j + 1}"
            net.join(f"left{i}.{j + 1}", hanging[j], tie, (x, y + j, z))
            net.join(f"right{i}.{j + 1}", hanging[j + 1], tie, (x, y + j + 1, z))
            net.bar(tie, (x, y + j + 0.5, z), 2)
        above = hanging
    return net.data


FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        "chain": Family(
            "point masses on massless bars, falling from a straight line",
            {"links": "number of links"},
            "n = 2 links, m = links",
            chain,
        ),
        "random-chain": Family(
            "random point masses on massless bars in random directions, falling",
            {"links": "number of links"},
            "n = 2 links, m = links",
            random_chain,
        ),
        "four-bars": Family(
            "four-bar linkages side by side, falling through a singular position",
            {"windows": "number of four-bar linkages"},
            "n = 2 windows + 2, m = 2 windows + 1",
            four_bars,
        ),
        "spatial-chain": Family(
            "bars on spherical joints, falling in space",
            {"bodies": "number of bodies"},
            "n = 12 bodies, m = 9 bodies",
            spatial_chain,
        ),
        "spatial-grid": Family(
            "a net of bars on spherical joints, falling in space",
            {
                "rows": "number of bars that hang below each other",
                "columns": "number of bars that hang side by side",
            },
            "n = 24 rows columns - 12 rows, m = 21 rows columns - 12 rows",
            spatial_grid,
            most=1000,
        ),
    }
)
