"""Series of a study, as figures and claims name them."""

from typing import Any

from newmark_cli.study.axes import TRAPEZOIDAL, SeriesKey
from newmark_cli.study.measures import FLOOR_OF

__all__ = ["TRAPEZOIDAL", "Curve", "floor_of"]


class Curve:
    """One series, and its name in a legend; every axis is an attribute, as in the CSV.

    Attributes:
        label: Name in a legend and in claims.
        named: Axes that were named besides study, problem, quantity and measure.
        key: What finds the series.
    """

    def __init__(
        self, label: str, study: str, problem: str, quantity: str, measure: str, **axes: str
    ) -> None:
        """Take a label and axes; the (u, λ) form without scaling unless they say otherwise."""
        usual = {"form": "u-lambda", "preconditioning": "none"}
        where = {"study": study, "problem": problem, "quantity": quantity, "measure": measure}
        self.label, self.named = label, frozenset(axes)
        self.key = SeriesKey.of(usual | where | axes)

    def __getattr__(self, name: str) -> str:
        if name == "key":
            raise AttributeError(name)
        return str(getattr(self.key, name))

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, Curve) and (self.label, self.key) == (other.label, other.key)

    def __hash__(self) -> int:
        return hash((self.label, self.key))


def floor_of(key: SeriesKey) -> SeriesKey | None:
    """The series that predicts a measured one; None for what has no floor."""
    measure = FLOOR_OF.get(key.measure)
    return SeriesKey.of(key.named() | {"measure": measure}) if measure else None
