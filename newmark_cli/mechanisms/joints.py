"""Joints of spatial mechanisms as data: one entry each.

A joint goes from body A to body B, either of which may be the ground.  Its constraints are
products of vectors that one of the two carries:

====  =======================================================================
name  vector
====  =======================================================================
D     from the joint's point on A to that on B
n     the axis
p, q  with n orthonormal, q = n × p
a, b  the two axes of a universal joint, a of A and b of B
e1 …  the global axes at the start
====  =======================================================================

Another joint is another `Joint` in `JOINTS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

#: Row names of D = 0.
_POINT = ("x", "y", "z")


@dataclass(frozen=True)
class Dot:
    """A constraint: the product of a vector of A and a vector of B, or D, vanishes.

    Attributes:
        name: Of the row.
        first: Vector that A carries.
        second: Vector that B carries, or ``D``.
    """

    name: str
    first: str
    second: str

    @property
    def of_points(self) -> bool:
        """Whether it is about the places of the joint's two points."""
        return self.second == "D"


@dataclass(frozen=True)
class Joint:
    """A kind of joint.

    Attributes:
        about: What it leaves free, for the docs.
        dots: Its rows past ``D = 0``, or all of them.
        meets: Whether D = 0 comes first: the rows ``x``, ``y``, ``z``.
        axes: Axes that a file gives: 0, 1, or 2 that are perpendicular.
        length: Whether D keeps its length: the row ``length``.
        turns: Whether B turns about n: it has an angle.
        slides: Whether B slides along n: it has a distance.
    """

    about: str
    dots: tuple[Dot, ...] = ()
    meets: bool = False
    axes: int = 0
    length: bool = False
    turns: bool = False
    slides: bool = False

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of its constraints."""
        lengths = ("length",) if self.length else ()
        return (*(_POINT if self.meets else ()), *(dot.name for dot in self.dots), *lengths)


#: n of B is parallel to n of A.
_PARALLEL = (Dot("p", "p", "n"), Dot("q", "q", "n"))
#: The point of B lies on the axis.
_ON_AXIS = (Dot("pD", "p", "D"), Dot("qD", "q", "D"))

#: Joints by the name that a file gives them.
JOINTS: Mapping[str, Joint] = MappingProxyType(
    {
        "spherical": Joint("turns in every direction about a point", meets=True),
        "revolute": Joint("turns about an axis", _PARALLEL, meets=True, axes=1, turns=True),
        "universal": Joint(
            "turns about two perpendicular axes, one of each body",
            (Dot("ab", "a", "b"),),
            meets=True,
            axes=2,
        ),
        "cylindrical": Joint(
            "turns about an axis and slides along it",
            _PARALLEL + _ON_AXIS,
            axes=1,
            turns=True,
            slides=True,
        ),
        "prismatic": Joint(
            "slides along an axis", (*_PARALLEL, *_ON_AXIS, Dot("pq", "p", "q")), axes=1,
            slides=True,
        ),
        "planar": Joint(
            "slides in a plane and turns about its normal, the axis",
            (*_PARALLEL, Dot("nD", "n", "D")),
            axes=1,
            turns=True,
        ),
        "rigid": Joint(
            "nothing is free",
            (Dot("e12", "e1", "e2"), Dot("e23", "e2", "e3"), Dot("e31", "e3", "e1")),
            meets=True,
        ),
        "distance": Joint("two points keep their distance: a massless rod", length=True),
        "point-on-line": Joint(
            "a point of 'to' stays on a line of 'from', along the axis", _ON_AXIS, axes=1
        ),
        "point-on-plane": Joint(
            "a point of 'to' stays in a plane of 'from', the axis its normal",
            (Dot("nD", "n", "D"),),
            axes=1,
        ),
    }
)  # fmt: skip
