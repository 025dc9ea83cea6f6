"""Values of axes as people write them: in legends, titles and on command lines."""

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from newmark_cli.study import axes
from newmark_cli.study.axes import TRAPEZOIDAL
from newmark_cli.study.drawing import WORK_PRECISION
from newmark_cli.study.measures import RECORDS, symbol

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.curves import Curve

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
        return "trapezoidal"
    method, *given = label.split()
    pairs = (part.partition("=") for part in given)
    said = [f"{_PARAMETERS.get(name, name)} = {value}" for name, _, value in pairs]
    return " ".join([_METHODS.get(method, method), *([f"({', '.join(said)})"] if said else [])])


def means(axis: str, word: str, value: str) -> bool:
    """Whether a word of a command line is a value of an axis, as CSVs or people write it.

    An integrator may be given by its method, a scaling of one's own by its name, and a
    mechanism file without its ending.
    """
    spellings = {value, spelled(axis, value)}
    if axis == "integrator":
        spellings.add(value.split()[0])
    return word in spellings


def spelled(axis: str, value: str) -> str:
    """A value of an axis as legends and titles have it."""
    if axis == "problem":
        return re.sub(r"\.ya?ml$", "", value)
    if axis == "integrator":
        return integrator_text(value)
    if axis == "form":
        return f"({', '.join(symbol(part) for part in value.split('-'))}) form"
    if axis == "preconditioning":
        return value.partition("[")[0]
    if axis == "row_block":
        return f"row {value} perturbed"
    if axis == "stop":
        return value if value == axes.SATURATION else f"tolerance {value}"
    if axis == "initial":
        return "at the start" if value else "along the motion"
    if axis == "measure":
        return measure_text(value)
    return symbol(value) if axis == "quantity" else in_words(axis, value)


def measure_text(measure: str) -> str:
    """Kind of rows in words."""
    return measure.replace("_", " ").replace(WORK_PRECISION, "work and precision")


def joined_values(names: Iterable[str], where: Mapping[str, str]) -> str:
    """Values of axes, a comma between them; what a series has nothing of is left out."""
    return ", ".join(spelled(axis, where[axis]) for axis in names if where[axis])


def in_words(axis: str, value: str) -> str:
    """A value that says little without its axis, with it; any other as it is."""
    if axis == "projection":
        method, _, rest = value.partition(" ")
        named = "no projection" if method == "none" else f"{method} projection"
        return named + (f" with {rest}" if rest else "")
    if axis == "multipliers":
        return {"newton": "Newton's λ", "recovered": "recovered λ", "total": "total λ"}.get(
            value, value
        )
    return f"{value} start" if axis == "start" else value


def quantity(series: "Slope | Curve") -> str:
    """The quantity that a series measures, in the field's symbols."""
    return RECORDS[series.measure].text(series.key) if series.measure else "(failed)"
