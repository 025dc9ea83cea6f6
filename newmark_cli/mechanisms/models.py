"""Keys of a mechanism file: points, two-point bodies, springs, torques, gravity.

Nothing is built here, and what compiles is not imported; see `newmark_cli.mechanisms.planar`.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    model_validator,
)

from newmark_cli import documents
from newmark_cli.documents import Number, StrictModel, Truth, misfit
from newmark_cli.json_schema import JsonSchema, also, given

#: Products and squares of a few numbers of this size, and of their inverses, are numbers.
_LARGEST = 1e30
_SMALLEST = 1e-30


def _not_huge(number: float) -> float:
    if abs(number) > _LARGEST:
        raise ValueError(f"must be at most {_LARGEST:g} in size")
    return number


def _not_tiny(number: float) -> float:
    if number < _SMALLEST:
        raise ValueError(f"must be at least {_SMALLEST:g}")
    return number


Bounded = Annotated[Number, AfterValidator(_not_huge), also(minimum=-_LARGEST, maximum=_LARGEST)]
NotNegative = Annotated[Number, Field(ge=0), AfterValidator(_not_huge), also(maximum=_LARGEST)]
Length = Annotated[
    Number,
    Field(gt=0),
    AfterValidator(_not_huge),
    AfterValidator(_not_tiny),
    also(minimum=_SMALLEST, maximum=_LARGEST),
]


def _two_numbers(value: Any, info: ValidationInfo) -> Any:
    documents.require_brackets(value, info)
    if isinstance(value, list | tuple) and len(value) == 3:
        raise ValueError("must have two components, given three; is 'dimensions: 3' missing?")
    return value


Vector = Annotated[tuple[Bounded, Bounded], BeforeValidator(_two_numbers)]


class Point(StrictModel):
    """A fixed or a moving point; SI units."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [given("fixed"), given("at")]})

    fixed: Vector | None = Field(None, description="position of a fixed point (m)")
    at: Vector | None = Field(None, description="initial position of a moving point (m)")
    velocity: Vector = Field((0.0, 0.0), description="initial velocity of a moving point (m/s)")
    mass: NotNegative = Field(0.0, description="point mass (kg)")


class Body(StrictModel):
    """A rigid body carried by two points at constant distance."""

    from_: str = Field(alias="from", description="first point")
    to: str = Field(description="second point")
    length: Length = Field(description="distance of the two points (m)")
    mass: NotNegative = Field(description="mass (kg)")
    centre: Vector = Field(
        (0.0, 0.0), description="mass centre along and across, from the first point (m)"
    )
    inertia: NotNegative = Field(description="moment of inertia about the mass centre (kg m²)")


class BodyPoint(StrictModel):
    """A point fixed on a body."""

    on: str = Field(description="body")
    at: Vector = Field(description="place along and across, from the body's first point (m)")


class Bar(StrictModel):
    """A massless bar: a constant distance."""

    from_: str = Field(alias="from", description="one end")
    to: str = Field(description="other end")
    length: Length = Field(description="length (m)")


class Spring(StrictModel):
    """A linear spring between two points."""

    from_: str = Field(alias="from", description="one end")
    to: str = Field(description="other end")
    stiffness: NotNegative = Field(description="stiffness (N/m)")
    rest_length: NotNegative = Field(description="length without force (m)")


class Damper(StrictModel):
    """A linear damper between two points: it resists the rate of their distance."""

    from_: str = Field(alias="from", description="one end")
    to: str = Field(description="other end")
    damping: NotNegative = Field(description="damping (N s/m)")


class Slider(StrictModel):
    """A point that stays on a fixed line."""

    point: str = Field(description="point")
    through: Vector = Field(description="a point of the line (m)")
    direction: Annotated[Vector, also(not_={"const": [0, 0]})] = Field(
        description="direction of the line; its length does not matter"
    )

    @model_validator(mode="after")
    def _has_direction(self) -> "Slider":
        if math.hypot(*self.direction) == 0:
            raise misfit("direction", "must not be [0, 0]: a slider needs a direction")
        return self


class Law(StrictModel):
    """A law of time: value + rate t + acceleration t²/2 + amplitude sin(frequency t + phase)."""

    value: Bounded | None = Field(
        None, description="constant term; what the initial position asks for when omitted"
    )
    rate: Bounded = Field(0.0, description="constant rate (1/s)")
    acceleration: Bounded = Field(0.0, description="constant acceleration (1/s²)")
    amplitude: Bounded = Field(0.0, description="amplitude of the oscillation")
    frequency: Bounded = Field(0.0, description="angular frequency (rad/s)")
    phase: Bounded = Field(0.0, description="phase at t = 0 (rad)")

    @property
    def moves(self) -> bool:
        """Whether it depends on time."""
        return bool(self.rate or self.acceleration or self.amplitude * self.frequency)

    def parameters(self, initially: float) -> tuple[float, ...]:
        """c, r, s, A, ω, φ of the element loop, starting from ``initially``."""
        start = self.amplitude * math.sin(self.phase)
        value = initially - start if self.value is None else self.value
        return (value, self.rate, self.acceleration, self.amplitude, self.frequency, self.phase)


class Motion(StrictModel):
    """A prescribed motion: coordinates of a point (m), or the angle of a body (rad)."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {
                    **given("point"),
                    "anyOf": [given("x"), given("y")],
                    "not": {"anyOf": [given("body"), given("angle")]},
                },
                {
                    "allOf": [given("body"), given("angle")],
                    "not": {"anyOf": [given("point"), given("x"), given("y")]},
                },
            ]
        }
    )

    point: str | None = Field(None, description="driven point")
    x: Law | None = Field(None, description="law of its first coordinate")
    y: Law | None = Field(None, description="law of its second coordinate")
    body: str | None = Field(None, description="driven body")
    angle: Law | None = Field(
        None, description="law of the angle from its first to its second point"
    )

    @model_validator(mode="after")
    def _drives_one_thing(self) -> "Motion":
        of_point = self.point is not None and (self.x or self.y) and not (self.body or self.angle)
        of_body = self.body is not None and self.angle and not (self.point or self.x or self.y)
        if not (of_point or of_body):
            raise ValueError("needs a point with x or y, or a body with angle")
        return self


class Torque(StrictModel):
    """A constant torque on a body."""

    on: str = Field(description="body")
    torque: Bounded = Field(description="torque, counter-clockwise (N m)")


_ALL_FIXED: JsonSchema = {"additionalProperties": {"not": given("at")}}


class Mechanism(StrictModel):
    """A planar mechanism; SI units."""

    model_config = ConfigDict(
        json_schema_extra={
            "anyOf": [
                {"required": [kind], "properties": {kind: {"minProperties": 1}}}
                for kind in ("bodies", "bars", "sliders", "motions")
            ]
        }
    )

    title: str = Field("", description="heads drawings")
    description: str = Field("", description="what it is and how it moves, in one line")
    source: str = Field("", description="where the data come from")
    dimensions: Literal[2] = Field(2, description="2: the mechanism is planar")
    points: Annotated[dict[str, Point], also(not_=_ALL_FIXED)] = Field(
        description="fixed points, and moving ones, whose coordinates are the unknowns"
    )
    bodies: dict[str, Body] = Field({}, description="rigid bodies, each carried by two points")
    body_points: dict[str, BodyPoint] = Field({}, description="further points on bodies")
    bars: dict[str, Bar] = Field({}, description="massless bars between two points")
    sliders: dict[str, Slider] = Field({}, description="points that stay on a line")
    motions: dict[str, Motion] = Field({}, description="prescribed motions")
    springs: dict[str, Spring] = Field({}, description="linear springs between two points")
    dampers: dict[str, Damper] = Field({}, description="linear dampers between two points")
    torques: dict[str, Torque] = Field({}, description="constant torques on bodies")
    gravity: Vector = Field((0.0, 0.0), description="acceleration of gravity (m/s²)")
    assemble: Truth = Field(False, description="initial positions are a guess; solve for them")
    project_velocities: Truth = Field(
        False, description="replace initial velocities by the nearest that fit the constraints"
    )

    @property
    def conservative(self) -> bool:
        """Whether energy is conserved: nothing damps, drives or moves by a law of time."""
        laws = [law for m in self.motions.values() for law in (m.x, m.y, m.angle) if law]
        return not (
            any(damper.damping for damper in self.dampers.values())
            or any(torque.torque for torque in self.torques.values())
            or any(law.moves for law in laws)
        )
