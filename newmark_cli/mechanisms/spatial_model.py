"""Keys of a spatial mechanism file; SI units.

Geometry is given as it stands at the start, in global axes.  Only ``centre``, ``inertia``,
``body_points.at`` and what a joint gives by body are in body axes.
"""

import math
from collections.abc import Iterable, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, Tag

from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.models import (
    GROUND,
    LISTED,
    PLAIN,
    Amount,
    Bounded,
    DrivenModel,
    Law,
    Length,
    ListedOr,
    MechanismModel,
    Misfits,
    NotNegative,
    PlainOr,
    amounts_of,
    branch,
    components,
    directed,
)
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import KeyPath, Number, StrictModel, TiedModel, misfit

#: Largest cosine of directions that are to be perpendicular: those of few digits are made so.
_SKEW = 1e-3
#: How far the largest moment of inertia may be beyond the sum of the others.
_IMPOSSIBLE = 1e-12


Vector = Annotated[tuple[Bounded, Bounded, Bounded], components(3)]


Direction = Annotated[Vector, AfterValidator(directed)]
Extents = Annotated[tuple[Length, Length, Length], components(3)]
_ORIGIN = (0.0, 0.0, 0.0)


Place = ListedOr[Vector, dict[str, Vector]]
Axis = ListedOr[Direction, dict[str, Direction]]
TwoAxes = ListedOr[tuple[Direction, Direction], dict[str, Direction]]


def inner(first: Any, second: Any) -> Array:
    """(…) products of vectors (…, 3), terms added from the first to the last."""
    terms = np.multiply(first, second)
    return np.asarray(0.0 + terms[..., 0] + terms[..., 1] + terms[..., 2])


def unit(directions: Any) -> Array:
    """(…, 3) directions with length 1."""
    vectors = np.asarray(directions, float)
    vectors = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return np.asarray(vectors / np.sqrt(inner(vectors, vectors))[..., None])


def _cosine(first: Sequence[float], second: Sequence[float]) -> float:
    size, other = math.hypot(*first), math.hypot(*second)
    return sum(a / size * (b / other) for a, b in zip(first, second, strict=True))


class Axes(TiedModel):
    """Directions of two body axes at the start; the third follows."""

    x: Direction = Field(description="direction of the body's x axis, global")
    y: Direction = Field(description="direction of the body's y axis, global")

    def _misfits(self) -> Misfits:
        if abs(cosine := _cosine(self.x, self.y)) > _SKEW:
            yield misfit("y", f"must be perpendicular to x, the cosine is {cosine:.3g}")


class Tensor(StrictModel):
    """Tensor of inertia about the mass centre, in body axes (kg m²)."""

    xx: NotNegative = Field(description="moment about x (kg m²)")
    yy: NotNegative = Field(description="moment about y (kg m²)")
    zz: NotNegative = Field(description="moment about z (kg m²)")
    xy: Bounded = Field(0.0, description="−∫ x y dm (kg m²)")
    xz: Bounded = Field(0.0, description="−∫ x z dm (kg m²)")
    yz: Bounded = Field(0.0, description="−∫ y z dm (kg m²)")

    @property
    def matrix(self) -> Array:
        """(3, 3)."""
        return np.array(
            [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]]
        )


class SpatialBody(TiedModel):
    """A rigid body: its origin and three directors."""

    position: Vector = Field(description="position of its origin at the start (m)")
    axes: Axes | None = Field(
        None, description="directions of its x and y axes at the start; the global ones if omitted"
    )
    mass: NotNegative = Field(description="mass (kg)")
    centre: Vector = Field(_ORIGIN, description="mass centre in body axes, from its origin (m)")
    inertia: ListedOr[Vector, Tensor] | None = Field(
        None,
        description="about the mass centre, in body axes (kg m²): [xx, yy, zz], or all six by name",
    )
    box: Extents | None = Field(
        None, description="in place of inertia: edges of a homogeneous box along its axes (m)"
    )
    velocity: Vector = Field(_ORIGIN, description="initial velocity of its origin (m/s)")
    angular_velocity: Vector = Field(_ORIGIN, description="initial, in global axes (rad/s)")

    def _misfits(self) -> Misfits:
        if (self.inertia is None) == (self.box is None):
            both = self.inertia is not None
            text = "give either 'inertia' or 'box'" + (", not both" if both else "")
            yield misfit("box" if both else "mass", text)
        elif self.inertia is not None:
            moments = np.linalg.eigvalsh(self.tensor)
            size = max(abs(float(moments[0])), abs(float(moments[2])))
            if moments[0] < -_IMPOSSIBLE * size:
                yield misfit("inertia", f"must not have a negative moment, {_listed(moments)}")
            elif moments[2] - moments[0] - moments[1] > _IMPOSSIBLE * size:
                yield misfit(
                    "inertia",
                    f"no body has such moments, {_listed(moments)}: the largest is more than the "
                    "sum of the others; are they about the centre?",
                )

    @property
    def tensor(self) -> Array:
        """(3, 3) tensor of inertia about the centre, in body axes."""
        if self.box is not None:
            a, b, c = (edge * edge for edge in self.box)
            return np.diag([self.mass / 12 * (a + b + c - square) for square in (a, b, c)])
        if isinstance(self.inertia, Tensor):
            return self.inertia.matrix
        return np.diag(np.asarray(self.inertia, float))


def directors(bodies: Iterable[SpatialBody]) -> Array:
    """(b, 3, 3) directors of bodies at the start, one a row."""
    axes = [
        ((1, 0, 0), (0, 1, 0)) if (of := body.axes) is None else (of.x, of.y) for body in bodies
    ]
    first, second = np.array(axes, float).transpose(1, 0, 2)
    x = unit(first)
    y = unit(second - inner(x, second)[:, None] * x)
    (a, b, c), (d, e, f) = x.T, y.T
    return np.stack([x, y, np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)], axis=1)


def inertias(mechanism: "SpatialMechanism") -> Array:
    """(b, 4, 4) S of bodies with point masses on them, M = S ⊗ 1.

    Mass, first moments, and Euler's tensor about the origin.
    """
    bodies = list(mechanism.bodies.values())
    mass, centre, tensor = (
        np.array([getattr(body, key) for body in bodies], float)
        for key in ("mass", "centre", "tensor")
    )
    blocks = np.empty((len(bodies), 4, 4))
    blocks[:, 0, 0] = mass
    blocks[:, 0, 1:] = blocks[:, 1:, 0] = mass[:, None] * centre
    half = np.trace(tensor, axis1=1, axis2=2) / 2
    squares = centre[:, :, None] * centre[:, None]
    blocks[:, 1:, 1:] = half[:, None, None] * np.eye(3) - tensor + mass[:, None, None] * squares
    numbers = {body: i for i, body in enumerate(mechanism.bodies)}
    for point in mechanism.body_points.values():
        if point.mass and point.on in numbers:
            weights = np.array([1.0, *point.at])
            blocks[numbers[point.on]] += point.mass * np.outer(weights, weights)
    return blocks


def _listed(numbers: Any) -> str:
    return ", ".join(f"{float(number):.6g}" for number in numbers)


class SpatialPoint(StrictModel):
    """A point of the ground."""

    fixed: Vector = Field(description="position (m)")


class SpatialBodyPoint(StrictModel):
    """A point fixed on a body."""

    on: str = Field(description="body")
    at: Vector = Field(description="place in the body's axes, from its origin (m)")
    mass: NotNegative = Field(0.0, description="point mass (kg)")


_KINDS = "; ".join(f"{name}: {joint.about}" for name, joint in JOINTS.items())
if TYPE_CHECKING:
    JointType = str
else:
    JointType = Literal[tuple(JOINTS)]
_GIVEN_BY_BODY = "; by body, in body axes: {crank: [...], rod: [...]}"


class SpatialJoint(TiedModel):
    """A joint between two bodies, or of a body and the ground."""

    type: JointType = Field(description=_KINDS)
    from_: str = Field(alias="from", description="first body, or 'ground'")
    to: str = Field(description="second body, or 'ground'")
    at: Place = Field(description="its point at the start, in global axes (m)" + _GIVEN_BY_BODY)
    axis: Axis | None = Field(
        None, description="its axis at the start, in global axes" + _GIVEN_BY_BODY
    )
    axes: TwoAxes | None = Field(
        None, description="of 'universal': of 'from' and of 'to', perpendicular"
    )
    length: Length | None = Field(
        None, description="of 'distance': what it keeps (m); as at the start if omitted"
    )

    def _misfits(self) -> Misfits:
        kind = JOINTS[self.type]
        if self.from_ == self.to:
            yield misfit("to", f"joins {self.to} with itself")
        for key, count in (("axis", 1), ("axes", 2)):
            present = getattr(self, key) is not None
            if kind.axes == count and not present:
                yield misfit(key, f"missing; a {self.type} joint needs it")
            if kind.axes != count and present:
                yield misfit(key, f"a {self.type} joint has no '{key}'")
        if isinstance(self.axes, tuple) and abs(cosine := _cosine(*self.axes)) > _SKEW:
            yield misfit("axes", f"must be perpendicular, the cosine is {cosine:.3g}")
        if self.length is not None and not kind.length:
            yield misfit("length", f"a {self.type} joint has no 'length'")
        for key in ("at", "axis", "axes"):
            value = getattr(self, key)
            if isinstance(value, dict) and set(value) != {self.from_, self.to}:
                text = f"must name both bodies, {self.from_} and {self.to}"
                yield misfit(key, f"{text}, given {', '.join(value) or 'none'}")
        if kind.length and not isinstance(self.at, dict):
            yield misfit("at", "a distance has two points: give them by body, in body axes")


class SpatialTorsionSpring(StrictModel):
    """A spring about the axis of a joint."""

    on: str = Field(description="joint")
    stiffness: NotNegative = Field(description="stiffness (N m/rad)")
    # Angles of torsion springs stay within half a turn.
    rest_angle: Annotated[Number, Field(ge=-3, le=3)] = Field(
        0.0, description="angle without torque (rad); the angle at the start is 0"
    )


class SpatialTorsionDamper(StrictModel):
    """A damper about the axis of a joint."""

    on: str = Field(description="joint")
    damping: NotNegative = Field(description="damping (N m s/rad)")


Amounts = Annotated[tuple[Amount, Amount, Amount], components(3)]


class SpatialTorque(StrictModel):
    """A torque on a body, or about the axis of a joint."""

    on: str = Field(description="body or joint")
    torque: Annotated[
        Annotated[Amounts, Tag(LISTED)] | Annotated[Amount, Tag(PLAIN)],
        branch(PLAIN, LISTED, PLAIN),
    ] = Field(
        description="on a body [x, y, z]; on a joint one, from 'from' on 'to' (N m); each a number "
        "or a law of time"
    )
    frame: Literal["global", "body"] | None = Field(
        None, description="axes of a torque on a body; global if omitted"
    )

    @property
    def acts(self) -> bool:
        """Whether it is a torque at all."""
        return any(amount != 0 for amount in amounts_of(self.torque))


class SpatialForce(StrictModel):
    """A force at a point, in global axes."""

    at: str = Field(description="point of a body: one of 'body_points', or a body: its origin")
    force: Amounts = Field(description="components (N), each a number or a law of time")


class JointMotion(DrivenModel):
    """A prescribed motion: of a joint, or of coordinates of a point."""

    drives = MappingProxyType({"joint": ("angle", "distance"), "point": ("x", "y", "z")})
    needs = "a joint with angle or distance, or a point with x, y or z"

    joint: str | None = Field(None, description="driven joint")
    angle: Law | None = Field(None, description="law of its angle (rad), 0 at the start")
    distance: Law | None = Field(None, description="law of its distance (m), 0 at the start")
    point: str | None = Field(None, description="driven point of a body")
    x: Law | None = Field(None, description="law of its first coordinate (m)")
    y: Law | None = Field(None, description="law of its second coordinate (m)")
    z: Law | None = Field(None, description="law of its third coordinate (m)")


class Rate(StrictModel):
    """Both rates of a joint that turns and slides."""

    angle: Bounded | None = Field(None, description="rate of its angle (rad/s)")
    distance: Bounded | None = Field(None, description="rate of its distance (m/s)")

    @property
    def rates(self) -> dict[str, float]:
        """Those that are given."""
        return {key: rate for key, rate in self if rate is not None}


class SpatialMechanism(MechanismModel):
    """A spatial mechanism; SI units."""

    dimensions: Literal[3] = Field(description="3: the mechanism is spatial")
    points: dict[str, SpatialPoint] = Field({}, description="points of the ground")
    bodies: dict[str, SpatialBody] = Field(min_length=1, description="rigid bodies")
    body_points: dict[str, SpatialBodyPoint] = Field({}, description="points on bodies")
    joints: dict[str, SpatialJoint] = Field({}, description="joints")
    motions: dict[str, JointMotion] = Field({}, description="prescribed motions")
    torsion_springs: dict[str, SpatialTorsionSpring] = Field(
        {}, description="springs about joints' axes"
    )
    torsion_dampers: dict[str, SpatialTorsionDamper] = Field(
        {}, description="dampers about joints' axes"
    )
    torques: dict[str, SpatialTorque] = Field({}, description="torques")
    forces: dict[str, SpatialForce] = Field({}, description="forces at points of bodies")
    gravity: Vector = Field(_ORIGIN, description="acceleration of gravity (m/s²)")
    outputs: list[Literal["points"]] = Field(
        [], description="further outputs: places of 'body_points'"
    )
    rates: dict[str, PlainOr[Bounded, Rate]] = Field(
        {}, description="relative rates of joints (rad/s, m/s), met while velocities are projected"
    )
    redundant: PlainOr[Literal["refuse", "drop"], dict[str, list[str]]] = Field(
        "refuse",
        description="constraints that depend on each other: refuse them, drop what is redundant, "
        "or release rows by joint, such as {P5: [q]}",
    )

    @property
    def guessed(self) -> dict[KeyPath, Vector]:
        """Key → place of what `assemble` moves (m)."""
        return {("bodies", name, "position"): of.position for name, of in self.bodies.items()}

    @property
    def grounded(self) -> list[Vector]:
        """Places on the ground (m)."""
        return [
            joint.at[GROUND] if isinstance(joint.at, dict) else joint.at
            for joint in self.joints.values()
            if GROUND in (joint.from_, joint.to)
        ]
