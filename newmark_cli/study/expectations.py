"""What a study expects of its series: orders, levels, quotients, in the author's own words.

Plain values, without pydantic: those who read a study's record need them too.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any

from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.drawing import chosen, entries
from newmark_cli.study.measures import RECORDS


@dataclass(frozen=True)
class Expectation:
    """One entry of `expect`."""

    number: int  #: its place in the list, counted from 1
    measure: str  #: kind of rows, as in the CSV
    #: axis → its values, as CSVs have them; an axis that it lacks may have any
    choice: Mapping[str, tuple[str, ...]]
    slope: float | None = None  #: expected order; None where only a level is expected
    within: float | None = None  #: largest |fitted − slope|; None for the tolerance of the measure
    at_most: float = math.inf  #: bounds of the values, or of their quotients
    at_least: float = 0.0
    h: float | None = None  #: step size (s) at which the bounds hold; None for every step size
    #: axis → value of the series that values are divided by, where it differs from that of the
    #: numerator; None where values are not divided
    over: Mapping[str, str] | None = None
    #: step size (s) of the denominator; that of the numerator when None
    over_h: float | None = None
    spread: float | None = None  #: largest (max − min)/min over the step sizes; None for any
    status: str = ""  #: how the cell at the smallest step size ends; empty for any way
    figure: str = ""  #: the figure that it is a claim about; empty for none
    label: str = ""  #: how the claim names the series; made from their axes when empty

    @property
    def bounded(self) -> bool:
        """Whether it expects a level."""
        return self.at_least > 0 or self.at_most < math.inf

    @property
    def described(self) -> str:
        """The series that it is about, in words."""
        parts = (f"{axis} {' or '.join(values)}" for axis, values in self.choice.items())
        return ", ".join([f"measure {self.measure}", *parts])

    def matches(self, key: SeriesKey) -> bool:
        """Whether it is about a series."""
        return key.measure == self.measure and all(
            getattr(key, axis) in values for axis, values in self.choice.items()
        )

    def divisor(self, key: SeriesKey) -> SeriesKey:
        """The series that the values of a series are divided by."""
        return SeriesKey.of(key.named() | dict(self.over or {}))


def expectations(config: Any) -> list[Expectation]:
    """Expectations of a config; see `newmark_cli.study.drawing.definitions`.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    number = count(1)
    return entries(config, "expect", lambda entry: _expectation(next(number), entry)) or []


def _expectation(number: int, entry: Mapping[str, Any]) -> Expectation:
    over = entry.get("over")
    return Expectation(
        number,
        RECORDS[entry["measure"]].name,
        chosen(entry),
        _number(entry, "slope"),
        _number(entry, "within"),
        _number(entry, "at_most", math.inf),
        _number(entry, "at_least", 0.0),
        _number(entry, "h"),
        None if over is None else {axis: values[0] for axis, values in chosen(over).items()},
        _number(over or {}, "h"),
        _number(entry, "spread"),
        str(entry.get("status") or ""),
        str(entry.get("figure") or ""),
        str(entry.get("label") or ""),
    )


def _number(entry: Mapping[str, Any], name: str, default: Any = None) -> Any:
    value = entry.get(name)
    if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
        raise ValueError(f"{name}: {value!r}")
    return default if value is None else float(value)
