"""Values of axes as people write them: in legends, titles and on command lines."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING

from newmark_cli.newmark.integrator import TRAPEZOIDAL_NAME
from newmark_cli.study.axes import TRAPEZOIDAL, in_words, series_axes
from newmark_cli.study.drawing import WORK_PRECISION
from newmark_cli.study.measures import MEASURES, RECORDS, symbol

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.figures import Curve

_METHODS = {
    "newmark": "Newmark",
    "generalized-alpha": "generalized-α",
    "hht": "HHT",
    "bdf1": "BDF1",
    "bdf2": "BDF2",
}
_PARAMETERS = {"beta": "β", "gamma": "γ", "rho": "ρ∞", "alpha": "α"}


def integrator_text(label: str) -> str:
    """An integrator as people write it, from its label."""
    if label == TRAPEZOIDAL:
        return TRAPEZOIDAL_NAME
    method, *parameters = label.split()
    pairs = (part.partition("=") for part in parameters)
    texts = [f"{_PARAMETERS.get(name, name)} = {value}" for name, _, value in pairs]
    return " ".join([_METHODS.get(method, method), *([f"({', '.join(texts)})"] if texts else [])])


@cache
def means(axis: str, word: str, value: str) -> bool:
    """Whether a word of a command line is a value of an axis, as CSVs or people write it.

    An integrator may be given by its method, a scaling of one's own by its name, a mechanism
    file without its ending, and what a measure records by the measure.
    """
    if not value:
        return False
    spellings = {value, value_text(axis, value)}
    if axis == "integrator":
        spellings.add(value.split()[0])
    if axis == "measure":
        spellings |= {
            name for name, of in MEASURES.items() if value in (row.name for row in of.records)
        }
    same = next(a.same for a in series_axes() if a.name == axis)
    return word in spellings or same(word) == value


def value_text(axis: str, value: str) -> str:
    """A value of an axis as legends and titles have it."""
    if axis == "problem":
        return re.sub(r"\.ya?ml$", "", value)
    if axis == "integrator":
        return integrator_text(value)
    if axis == "preconditioning":
        return value.partition("[")[0]
    if axis == "row_block":
        return f"row {value} perturbed"
    if axis == "initial":
        return "at the start" if value else "along the motion"
    if axis == "measure":
        return measure_text(value)
    return symbol(value) if axis == "quantity" else in_words(axis, value)


def measure_text(measure: str) -> str:
    """Kind of rows in words."""
    return measure.replace("_", " ").replace(WORK_PRECISION, "work and precision")


def counted(words: Iterable[str]) -> str:
    """How often each word occurs, in the order of their first occurrences."""
    return ", ".join(f"{count} {word}" for word, count in Counter(words).items())


def joined_values(names: Iterable[str], where: Mapping[str, str]) -> str:
    """Values of axes, a comma between them; what a series has nothing of is left out."""
    return ", ".join(value_text(axis, where[axis]) for axis in names if where[axis])


def quantity(series: "Slope | Curve") -> str:
    """The quantity that a series measures, in the field's symbols."""
    return RECORDS[series.measure].text(series.key) if series.measure else "(failed)"
