"""Shapes of the parts of planar mechanisms, as plain data: places are x + iy in the figure."""

from collections.abc import Mapping
from dataclasses import dataclass

from newmark_cli.mechanisms.models import Mechanism


@dataclass(frozen=True)
class Scene:
    """A mechanism at a position.

    Attributes:
        mechanism: The mechanism.
        points: Places of its points.
        size: Its extent.
        factor: Lengths in the figure of a metre.
        start: The mechanism where it starts; None if this is it.
    """

    mechanism: Mechanism
    points: Mapping[str, complex]
    size: float
    factor: float
    start: "Scene | None" = None

    def along(self, body: str | None) -> complex:
        """Direction of a body from its first to its second point, of length 1; 1 of the ground."""
        given = self.mechanism.bodies.get(body or "")
        if given is None:
            return 1 + 0j
        return (self.points[given.to] - self.points[given.from_]) / (self.factor * given.length)

    def centre(self, body: str | None) -> complex | None:
        """First point of a body; None of the ground."""
        given = self.mechanism.bodies.get(body or "")
        return None if given is None else self.points[given.from_]

    def seen_from(self, body: str | None, point: str) -> complex:
        """Place of a point in the axes of a body, or of the ground (m)."""
        return (self.points[point] - (self.centre(body) or 0)) / self.along(body) / self.factor

    def placed(self, on: str | None, at: complex) -> complex:
        """A place that is given in the axes of a body, or of the ground (m)."""
        start = self.centre(on)
        at = self.factor * at
        return at if start is None else start + at * self.along(on)


# Each mark has a symbol, by which the key of a figure explains it.


@dataclass(frozen=True)
class Stroke:
    """A line through places: a bar, or a guide.

    Attributes:
        places: The places.
        symbol: What it stands for.
    """

    places: tuple[complex, ...]
    symbol: str


@dataclass(frozen=True)
class Coil:
    """A spring between two places."""

    start: complex
    end: complex
    symbol: str = "spring"


@dataclass(frozen=True)
class Dashpot:
    """A damper between two places."""

    start: complex
    end: complex
    symbol: str = "damper"


@dataclass(frozen=True)
class Disc:
    """A wheel, or a circle that one rolls on.

    Attributes:
        centre: Its centre.
        radius: Its radius.
        towards: Direction of a mark that turns with it; 0 without one.
    """

    centre: complex
    radius: float
    towards: complex = 0j
    symbol: str = "wheel"


@dataclass(frozen=True)
class Turn:
    """An arrow about a place: a torque, with its sign."""

    centre: complex
    radius: float
    sign: float
    symbol: str = "torque"


@dataclass(frozen=True)
class Spiral:
    """A torsion spring about a place, or the arc of a torsion damper."""

    centre: complex
    radius: float
    damps: bool = False

    @property
    def symbol(self) -> str:
        """That of springs and dampers."""
        return "damper" if self.damps else "spring"


@dataclass(frozen=True)
class Arrow:
    """A force at a place, in a direction of length 1."""

    tip: complex
    towards: complex
    length: float
    symbol: str = "force"


Mark = Stroke | Coil | Dashpot | Disc | Turn | Spiral | Arrow
