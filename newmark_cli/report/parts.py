"""Figures that are made of parts: panels with series each."""

from dataclasses import dataclass
from typing import ClassVar

from newmark_cli.report.curves import Curve


@dataclass(frozen=True)
class Part:
    """A panel: its title, and its series in the order of the legend."""

    title: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class OfParts:
    """The parts that automatic figures of a study share.

    Attributes:
        name: Of its files.
        title: What it shows.
        study: Study whose results it reads.
        parts: Its panels.
        columns: Panels side by side.
    """

    name: str
    title: str
    study: str
    parts: tuple[Part, ...]
    columns: int = 1
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        return tuple(curve for part in self.parts for curve in part.curves)
