"""Keys of a mechanism file: points, two-point bodies, springs, torques, gravity.

Nothing is built here, and what compiles is not imported; see `newmark_cli.mechanisms.planar`.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
)
from pydantic_core import PydanticCustomError

from newmark_cli.support import documents
from newmark_cli.support.documents import KeyPath, Number, StrictModel, TiedModel, Truth, misfit

#: Products and squares of a few numbers of this size, and of their inverses, are numbers.
_LARGEST, _SMALLEST = 1e30, 1e-30

Bounded = Annotated[Number, Field(ge=-_LARGEST, le=_LARGEST)]
#: What does not fit each other in a model.
Misfits = Iterator[PydanticCustomError]
NotNegative = Annotated[Number, Field(ge=0, le=_LARGEST)]
Length = Annotated[Number, Field(ge=_SMALLEST, le=_LARGEST)]


def components(count: int) -> BeforeValidator:
    """What refuses a vector of the plane or of space that lacks brackets or components."""
    text, given = {
        2: ("two components, [x, y]", "three; is 'dimensions: 3' missing?"),
        3: ("three components, [x, y, z]", "two: this mechanism is spatial"),
    }[count]

    def checked(value: Any, info: ValidationInfo) -> Any:
        documents.require_brackets(value, info)
        if isinstance(value, int | float):
            raise ValueError(f"must have {text}")
        if isinstance(value, list | tuple) and len(value) == 5 - count:
            raise ValueError(f"must have {text.partition(',')[0]}, given {given}")
        return value

    return BeforeValidator(checked)


def directed(vector: tuple[float, ...]) -> tuple[float, ...]:
    """What refuses a direction without length."""
    if math.hypot(*vector) == 0:
        raise ValueError(f"must not be {[0] * len(vector)}: it has no direction")
    return vector


Vector = Annotated[tuple[Bounded, Bounded], components(2)]


class Point(StrictModel):
    """A fixed or a moving point; SI units."""

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


class BetweenPoints(StrictModel):
    """What joins two points."""

    from_: str = Field(alias="from", description="one end, a point or one of 'body_points'")
    to: str = Field(description="other end, likewise")


class Bar(BetweenPoints):
    """A massless bar: a constant distance."""

    length: Length = Field(description="length (m)")


_FILE = "table in a file beside this one, in place of both lists"


def _misfits_of_table(
    key: str, places: Sequence[float], values: Sequence[float], file: str | None, fewest: int = 2
) -> Misfits:
    """Why lists are no table: values at places that increase."""
    falls = next((pair for pair in pairwise(places) if pair[1] <= pair[0]), None)
    if file is not None:
        yield misfit("file", "is missing, or holds no table")
    elif len(places) < fewest:
        yield misfit(key, f"must be {fewest} at least, given {len(places)}")
    elif len(values) != len(places):
        text = f"must be one for each of {len(places)} {key}, given {len(values)}"
        yield misfit("values", text)
    elif falls:
        yield misfit(key, f"must increase: {falls[1]:g} follows {falls[0]:g}")


class LengthTable(TiedModel):
    """Forces of a spring at lengths: no overshoot between them, straight on beyond the ends."""

    lengths: list[NotNegative] = Field(
        [], max_length=100_000, description="lengths (m), increasing"
    )
    values: list[Bounded] = Field([], description="force at each length (N), positive if it pulls")
    file: str | None = Field(None, description=f"{_FILE}: CSV with columns length, force")

    def _misfits(self) -> Misfits:
        return _misfits_of_table("lengths", self.lengths, self.values, self.file)


class SpringForce(TiedModel):
    """The force of a spring as a law of its length."""

    powers: list[Bounded] = Field(
        [],
        max_length=12,
        description="coefficients of 1, s, s², … of a polynomial in the stretch s = length − "
        "rest_length (N, N/m, N/m², …)",
    )
    table: LengthTable | None = Field(None, description="forces at lengths")

    def _misfits(self) -> Misfits:
        if bool(self.powers) == (self.table is not None):
            yield misfit(None, "needs either powers or a table")


class Spring(BetweenPoints, TiedModel):
    """A spring between two points, linear or with a law of its force."""

    stiffness: NotNegative | None = Field(None, description="stiffness (N/m) of a linear spring")
    rest_length: NotNegative | None = Field(
        None, description="length without force (m), or from which powers count; not of a table"
    )
    force: SpringForce | None = Field(
        None, description="law of the force over the length, in place of stiffness"
    )

    def _misfits(self) -> Misfits:
        by_table = self.force is not None and self.force.table is not None
        given, wanted = self.model_dump(exclude_none=True), {"stiffness", "rest_length"}
        if self.force is not None:
            wanted = set() if by_table else {"rest_length"}
        for key in ("stiffness", "rest_length"):
            if key in wanted and key not in given:
                yield misfit(key, "missing")
            if key in given and key not in wanted:
                yield misfit(key, "stands in the law of the force; leave it out")


class Damper(BetweenPoints):
    """A linear damper between two points: it resists the rate of their distance."""

    damping: NotNegative = Field(description="damping (N s/m)")


class Line(StrictModel):
    """A line, fixed or on a body."""

    on: str | None = Field(None, description="body that carries the line; fixed if omitted")
    through: Vector = Field(
        description="a point of the line (m); of a body's, along and across from its first point"
    )
    direction: Annotated[Vector, AfterValidator(directed)] = Field(
        description="direction of the line; its length does not matter"
    )


class Slider(Line):
    """A point that stays on a line, fixed or on a body."""

    point: str = Field(description="point")


class Sine(StrictModel):
    """An oscillation: amplitude sin(frequency t + phase)."""

    amplitude: Bounded = Field(description="amplitude")
    frequency: Bounded = Field(description="angular frequency (rad/s)")
    phase: Bounded = Field(0.0, description="phase at t = 0 (rad)")


#: Values that a spline of degree 5 takes at least.
_FEWEST_OF_QUINTIC = 6


class Table(TiedModel):
    """Values at times, and what is between them."""

    # A measurement, not a data base.
    times: list[Bounded] = Field(
        [], max_length=100_000, description="times (s), increasing, the first at most 0"
    )
    values: list[Bounded] = Field([], description="value at each time")
    file: str | None = Field(None, description=f"{_FILE}: CSV with columns t, value")
    interpolation: Literal["cubic", "quintic", "pchip"] = Field(
        "cubic",
        description="cubic: spline with a continuous second derivative; quintic: spline with a "
        "continuous fourth; pchip: no overshoot, but only the first derivative is continuous",
    )
    ends: Literal["not-a-knot", "natural", "clamped", "periodic"] = Field(
        "not-a-knot",
        description="of splines, at both ends: no jump of the highest derivatives next to them; "
        "no second (quintic: third and fourth) derivative; no first (quintic: and second) "
        "derivative; or the table repeats itself for ever",
    )

    def _misfits(self) -> Misfits:
        times, values = self.times, self.values
        fewest = _FEWEST_OF_QUINTIC if self.interpolation == "quintic" else 2
        if found := [*_misfits_of_table("times", times, values, self.file, fewest)]:
            yield from found
            return
        if self.interpolation == "pchip" and self.ends != "not-a-knot":
            yield misfit("ends", "is of splines, and interpolation is pchip")
        if times[0] > 0:
            yield misfit("times", f"must begin at 0 or before, given {times[0]:g}")
        if times[-1] <= 0:
            yield misfit("times", f"must end after 0, given {times[-1]:g}")
        if self.ends == "periodic" and values[0] != values[-1]:
            yield misfit(
                "values", f"must end as they begin to repeat: {values[0]:g}, {values[-1]:g}"
            )


class Law(StrictModel):
    """A sum: value + rate t + acceleration t²/2 + amplitude sin(frequency t + phase) + others."""

    value: Bounded | None = Field(
        None,
        description="constant term; if omitted, what the initial position asks for, but 0 next "
        "to powers or a table, and in a force or torque",
    )
    rate: Bounded = Field(0.0, description="constant rate (1/s)")
    acceleration: Bounded = Field(0.0, description="constant acceleration (1/s²)")
    amplitude: Bounded = Field(0.0, description="amplitude of the oscillation")
    frequency: Bounded = Field(0.0, description="angular frequency (rad/s)")
    phase: Bounded = Field(0.0, description="phase at t = 0 (rad)")
    powers: list[Bounded] = Field(
        [], max_length=12, description="coefficients of 1, t, t², … of a polynomial"
    )
    sines: list[Sine] = Field([], description="further oscillations")
    table: Table | None = Field(
        None, description="values at times, with a spline between them, from lists or a file"
    )

    @property
    def moves(self) -> bool:
        """Whether it depends on time."""
        return bool(
            self.rate
            or self.acceleration
            or self.amplitude * self.frequency
            or any(self.powers[1:])
            or any(sine.amplitude * sine.frequency for sine in self.sines)
            or (self.table is not None and len({*self.table.values}) > 1)
        )

    def parameters(self, initially: float | None = None) -> tuple[float, ...]:
        """c, r, s, A, ω, φ of the element loop, starting from ``initially`` if it is given.

        What the element loop keeps elsewhere, powers, sines and the table, is in c only as
        far as the start determines c.
        """
        value = self.value
        if value is None:
            start = self.amplitude * math.sin(self.phase)
            start += sum(sine.amplitude * math.sin(sine.phase) for sine in self.sines)
            determined = initially is not None and not (self.powers or self.table)
            value = (initially or 0.0) - start if determined else 0.0
        return (value, self.rate, self.acceleration, self.amplitude, self.frequency, self.phase)


#: A file in Python and a function in it.
_PYTHON = re.compile(r"^[^:]+\.py:[A-Za-z_][A-Za-z_0-9]*$")

#: Which branch of a union a value is meant for, so that errors are those of one branch.
MAPPED, LISTED, PLAIN = "(mapping)", "(list)", "(value)"


def branch(mapped: str, listed: str, plain: str) -> Discriminator:
    """What chooses the branch of a union for a mapping, for a list and for another value."""

    def chosen(value: Any) -> str:
        if isinstance(value, Mapping | StrictModel):
            return mapped
        return listed if isinstance(value, list | tuple) else plain

    return Discriminator(chosen)


_Usual = TypeVar("_Usual")
_Mapped = TypeVar("_Mapped")
#: A list, or a mapping; a plain value, or a mapping.
ListedOr = Annotated[
    Annotated[_Usual, Tag(LISTED)] | Annotated[_Mapped, Tag(MAPPED)], branch(MAPPED, LISTED, LISTED)
]
PlainOr = Annotated[
    Annotated[_Usual, Tag(PLAIN)] | Annotated[_Mapped, Tag(MAPPED)], branch(MAPPED, PLAIN, PLAIN)
]
#: A number, or a law of time.
Amount = PlainOr[Bounded, Law]


def size_of(amount: "float | Law") -> float:
    """A number that an arrow may stand for: 1 for what changes with time."""
    return 1.0 if isinstance(amount, Law) else amount


def amounts_of(given: Any) -> tuple[Any, ...]:
    """Components of what may be one amount or several."""
    return given if isinstance(given, tuple) else (given,)


def laws_of(amounts: Sequence["float | Law"]) -> dict[int, Law]:
    """Those of several numbers that are laws of time, by their places."""
    return {place: amount for place, amount in enumerate(amounts) if isinstance(amount, Law)}


class DrivenModel(TiedModel):
    """What laws of time drive.

    Attributes:
        drives: What may be driven, and keys of laws and of what else belongs to it.
        needs: The same in words.
    """

    drives: ClassVar[Mapping[str, Sequence[str]]]
    needs: ClassVar[str]

    @property
    def driven(self) -> dict[str, Law]:
        """Quantity → law that drives it."""
        return {key: value for key, value in self if isinstance(value, Law)}

    def _misfits(self) -> Misfits:
        named = [
            any(getattr(self, key) is not None for key in (subject, *keys))
            for subject, keys in self.drives.items()
        ]
        subjects = [getattr(self, subject) is not None for subject in self.drives]
        if sum(named) != 1 or named != subjects or not self.driven:
            yield misfit(None, f"needs {self.needs}")


class Motion(DrivenModel):
    """A prescribed motion: of a point (m), of the angle of a body (rad), or along a slider (m)."""

    drives = MappingProxyType(
        {"point": ("x", "y"), "body": ("angle", "relative_to"), "slider": ("distance",)}
    )
    needs = "a point with x or y, a body with angle, or a slider with distance"

    point: str | None = Field(None, description="driven point")
    x: Law | None = Field(None, description="law of its first coordinate")
    y: Law | None = Field(None, description="law of its second coordinate")
    body: str | None = Field(None, description="driven body")
    angle: Law | None = Field(
        None, description="law of the angle from its first to its second point"
    )
    relative_to: str | None = Field(
        None, description="body whose angle is subtracted from that of the driven one"
    )
    slider: str | None = Field(None, description="driven slider")
    distance: Law | None = Field(
        None, description="law of the place of its point on the line, from 'through' on"
    )


class Force(StrictModel):
    """A force at a point, in global axes."""

    at: str = Field(description="point")
    force: Annotated[tuple[Amount, Amount], components(2)] = Field(
        description="components (N), each a number or a law of time"
    )


class Torque(StrictModel):
    """A torque on a body."""

    on: str = Field(description="body")
    from_: str | None = Field(
        None, alias="from", description="body that the opposite torque acts on; none if omitted"
    )
    torque: Amount = Field(description="counter-clockwise (N m), a number or a law of time")

    @property
    def acts(self) -> bool:
        """Whether it is a torque at all."""
        return self.torque != 0


#: What the ground is called.
GROUND = "ground"


class BetweenBodies(StrictModel):
    """What acts on the angle between two bodies, or between the ground and a body."""

    from_: str = Field(GROUND, alias="from", description="first body, or 'ground'")
    to: str = Field(description="second body")


class TorsionSpring(BetweenBodies):
    """A linear spring of the angle between two bodies, over any number of turns."""

    stiffness: NotNegative = Field(description="stiffness (N m/rad)")
    rest_angle: Bounded | None = Field(
        None,
        description="angle without torque (rad), from the first body to the second, which starts "
        "between -π and π; as at the start if omitted",
    )


class TorsionDamper(BetweenBodies):
    """A linear damper of the angle between two bodies."""

    damping: NotNegative = Field(description="damping (N m s/rad)")


class AngleJoint(BetweenBodies):
    """A constant angle between two bodies, which need not meet."""

    angle: Bounded | None = Field(
        None, description="angle from the first to the second (rad); as at the start if omitted"
    )


class Gear(TiedModel):
    """Angles of two bodies that turn in a constant ratio, counted from the start."""

    from_: str = Field(alias="from", description="first body")
    to: str = Field(description="second body")
    ratio: Bounded = Field(
        description="turns of the second body for one of the first; negative where they mesh "
        "outside"
    )
    on: str | None = Field(
        None, description="carrier, relative to which both turn; the ground if omitted"
    )

    def _misfits(self) -> Misfits:
        if self.ratio == 0:
            yield misfit("ratio", "must not be 0: the second body would not turn")
        names = [name for name in (self.from_, self.to, self.on) if name is not None]
        if len(set(names)) < len(names):
            yield misfit("to", "must be different bodies, and another than the carrier")


class Circle(StrictModel):
    """A circle that a wheel rolls on, fixed or a wheel itself."""

    centre: str = Field(description="point")
    radius: Length = Field(description="radius (m)")
    body: str | None = Field(None, description="body that turns with it; it is fixed if omitted")
    inside: Truth = Field(False, description="whether the wheel rolls inside of it")


class Rolling(TiedModel):
    """A wheel that rolls without slipping: two constraints, of contact and of rolling."""

    wheel: str = Field(description="body that turns with the wheel")
    centre: str | None = Field(None, description="its centre; the body's first point if omitted")
    radius: Length = Field(description="radius (m)")
    line: Line | None = Field(None, description="line that it rolls on")
    circle: Circle | None = Field(None, description="circle that it rolls on")

    def _misfits(self) -> Misfits:
        if (self.line is None) == (self.circle is None):
            yield misfit(None, "needs either a line or a circle to roll on")
        if self.circle is not None and self.circle.inside and self.circle.radius <= self.radius:
            yield misfit(
                "radius",
                f"must be less than that of the circle around it, {self.circle.radius:g}, "
                f"given {self.radius:g}",
            )


class PythonForce(TiedModel):
    """Forces on points that a Python function returns; runs only with --allow-code."""

    python: str = Field(
        description="file.py:function of positions (k, 2), velocities (k, 2) and the time t, which "
        "returns the forces (N), (k, 2); the file is looked for beside this one"
    )
    on: list[str] = Field(min_length=1, description="the k points, at least one")

    def _misfits(self) -> Misfits:
        if not _PYTHON.fullmatch(self.python):
            yield misfit("python", f'must be "file.py:function", given {self.python!r:.60}')
        if len(set(self.on)) < len(self.on):
            yield misfit("on", "must name each point once")


class MechanismModel(StrictModel):
    """What mechanisms in the plane and in space have in common."""

    title: str = Field("", description="heads drawings")
    description: str = Field("", description="what it is and how it moves, in one line")
    source: str = Field("", description="where the data come from")
    springs: dict[str, Spring] = Field({}, description="springs between two points")
    dampers: dict[str, Damper] = Field({}, description="linear dampers between two points")
    assemble: Truth = Field(False, description="initial positions are a guess; solve for them")
    project_velocities: Truth = Field(
        False,
        description="replace initial velocities by the nearest, in the norm of M, that fit",
    )

    @property
    def conservative(self) -> bool:
        """Whether energy is conserved: nothing damps, drives or moves by a law of time."""

        def all_of(*kinds: str) -> Iterator[Any]:
            for kind in kinds:
                yield from getattr(self, kind, {}).values()

        return not (
            any(damper.damping for damper in all_of("dampers", "torsion_dampers"))
            or any(torque.acts for torque in all_of("torques"))
            or any(law.moves for one in all_of("forces") for law in laws_of(one.force).values())
            or any(law.moves for one in all_of("motions") for law in one.driven.values())
            or any(all_of("python_forces"))
        )


class Mechanism(MechanismModel):
    """A planar mechanism; SI units."""

    dimensions: Literal[2] = Field(2, description="2: the mechanism is planar")
    points: dict[str, Point] = Field(
        description="fixed points, and moving ones, whose coordinates are the unknowns"
    )
    bodies: dict[str, Body] = Field({}, description="rigid bodies, each carried by two points")
    body_points: dict[str, BodyPoint] = Field({}, description="further points on bodies")
    bars: dict[str, Bar] = Field({}, description="massless bars between two points")
    sliders: dict[str, Slider] = Field(
        {}, description="points that stay on a line, fixed or moving"
    )
    motions: dict[str, Motion] = Field({}, description="prescribed motions")
    torques: dict[str, Torque] = Field({}, description="torques on bodies")
    forces: dict[str, Force] = Field({}, description="forces at points")
    torsion_springs: dict[str, TorsionSpring] = Field(
        {}, description="springs of the angle between two bodies"
    )
    torsion_dampers: dict[str, TorsionDamper] = Field(
        {}, description="dampers of the angle between two bodies"
    )
    angle_joints: dict[str, AngleJoint] = Field({}, description="constant angles between bodies")
    gears: dict[str, Gear] = Field({}, description="bodies that turn in a constant ratio")
    rolling: dict[str, Rolling] = Field({}, description="wheels that roll on lines or circles")
    python_forces: dict[str, PythonForce] = Field({}, description="forces that code computes")
    gravity: Vector = Field((0.0, 0.0), description="acceleration of gravity (m/s²)")
    outputs: list[Literal["points", "pins"]] = Field(
        [],
        description="further outputs: places of 'body_points', forces of pins on each body",
    )

    @property
    def guessed(self) -> dict[KeyPath, Vector]:
        """Key → place of what `assemble` moves (m)."""
        points = self.points.items()
        return {("points", name, "at"): of.at for name, of in points if of.at is not None}

    @property
    def grounded(self) -> list[Vector]:
        """Places on the ground (m)."""
        return [point.fixed for point in self.points.values() if point.fixed is not None]
