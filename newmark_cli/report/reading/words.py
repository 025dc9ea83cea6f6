"""Counts, values and quantities of series in words."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from newmark_cli.study.axes import value_text
from newmark_cli.study.measures import RECORDS

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.figures import Curve


def counted(words: Iterable[str]) -> str:
    """How often each word occurs, in the order of their first occurrences."""
    return ", ".join(f"{count} {word}" for word, count in Counter(words).items())


def joined_values(names: Iterable[str], where: Mapping[str, str]) -> str:
    """Values of axes, a comma between them; what a series has nothing of is left out."""
    return ", ".join(value_text(axis, where[axis]) for axis in names if where[axis])


def quantity(series: "Slope | Curve") -> str:
    """The quantity that a series measures, in the field's symbols."""
    return RECORDS[series.measure].text(series.key) if series.measure else "(failed)"
