"""What a study expects of its series: orders and levels of the user's own.

Plain values, without pydantic: those who read a study's record need them too.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.drawing import COMPARABLE
from newmark_cli.study.measures import RECORDS


@dataclass(frozen=True)
class Expectation:
    """One entry of `expect`.

    Attributes:
        number: Its place in the list, counted from 1.
        measure: Kind of rows, as in the CSV.
        choice: Axis → its values, as CSVs have them; an axis that it lacks may have any.
        slope: Expected order; None where only a level is expected.
        within: Largest |fitted − slope|; None for the tolerance of the measure.
        at_most, at_least: Bounds of the values.
        h: Step size (s) at which the bounds hold; None for every step size.
    """

    number: int
    measure: str
    choice: Mapping[str, tuple[str, ...]]
    slope: float | None = None
    within: float | None = None
    at_most: float = math.inf
    at_least: float = 0.0
    h: float | None = None

    @property
    def name(self) -> str:
        """How texts name it."""
        return f"expect[{self.number}]"

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


def expectations(config: Any) -> list[Expectation]:
    """Expectations of a resolved config.

    Args:
        config: As in a study's record.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    given = config.get("expect") if isinstance(config, Mapping) else None
    try:
        return [_expectation(i, entry) for i, entry in enumerate(given or (), start=1)]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"expect: not as written by a run: {error}") from None


def _expectation(number: int, entry: Mapping[str, Any]) -> Expectation:
    def read(name: str, default: Any) -> Any:
        value = entry.get(name)
        if value is not None and not (isinstance(value, int | float) and math.isfinite(value)):
            raise ValueError(f"{name}: {value!r}")
        return default if value is None else float(value)

    same = {axis.name: axis.same for axis in axes.series_axes()}
    return Expectation(
        number,
        RECORDS[entry["measure"]].name,
        {
            axis: tuple(same[axis](str(value)) for value in entry[axis])
            for axis in COMPARABLE
            if entry.get(axis) is not None
        },
        read("slope", None),
        read("within", None),
        read("at_most", math.inf),
        read("at_least", 0.0),
        read("h", None),
    )
