"""Counts, values and quantities of series in words."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from newmark_cli.newmark.kept import ENERGY, OUTPUT
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.scaling import TABLE_2
from newmark_cli.study.axes import value_text
from newmark_cli.study.measures import RECORDS, is_dimensionless, symbol

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.figures import Curve


def counted(words: Iterable[str]) -> str:
    """How often each word occurs, in the order of their first occurrences."""
    return ", ".join(f"{count} {word}" for word, count in Counter(words).items())


def joined_values(names: Iterable[str], where: Mapping[str, str]) -> str:
    """Values of axes, a comma between them; what a series has nothing of is left out."""
    return ", ".join(value_text(axis, where[axis]) for axis in names if where[axis])


def scalings(series: Iterable["Slope | Curve"]) -> str:
    """What the scalings of Table 2 that series compare do to J; empty where they compare none.

    For one form it has the powers of h: "scaling left: rows D·h²; right: columns λ·h⁻²; …"
    """
    every = [(one.preconditioning, one.form) for one in series]
    forms = {form for name, form in every if name in ("left", "right", "optimal")}
    names = {name for name, _ in every}
    if len(names) == 1 or not forms:
        return ""
    sides = {"left": "rows", "right": "columns"}
    form = forms.pop()
    if forms:
        sides = {side: f"{name} by powers of h" for side, name in sides.items()}
    else:
        sides = {side: f"{name} {_powers(TABLE_2[form][side])}" for side, name in sides.items()}
    parts = [f"{side}: {text}" for side, text in sides.items() if side in names]
    if "optimal" in names:
        parts.append("optimal: " + ("both" if len(parts) == 2 else " and ".join(sides.values())))
    return f"scaling {'; '.join(parts)}"


def _powers(factors: Mapping[str, str]) -> str:
    """Factors that depend on h: block·power, separated by commas."""
    orders = {block: Monomial.parse(factor).order() for block, factor in factors.items()}
    return ", ".join(
        f"{symbol(block)}·{power('h', str(order))}" for block, order in orders.items() if order
    )


_SUPERSCRIPTS = str.maketrans("−-.0123456789", "⁻⁻·⁰¹²³⁴⁵⁶⁷⁸⁹")


def power(base: str, exponent: str) -> str:
    """A power as plain text, which is drawn much faster than mathematics."""
    return base + exponent.translate(_SUPERSCRIPTS)


def quantity(series: "Slope | Curve") -> str:
    """The quantity that a series measures, in the field's symbols."""
    return RECORDS[series.measure].text(series.key) if series.measure else "(failed)"


#: What stands for a unit where none is known, and where there is none.
NO_UNITS = SI, DIMENSIONLESS = "SI units", "dimensionless"
#: Last word of a component, before its axis → its unit.
_UNITS = {"force": "N", "moment": "N m", "omega": "rad/s", "angle": "rad", "distance": "m",
          "origin": "m", "d1": "1", "d2": "1", "d3": "1", ENERGY: "J"}  # fmt: skip
_RATES = {"v": "/s", "a": "/s²"}


def unit(of: "Curve", name: str) -> str:
    """Unit of a component of what a trajectory has of u, v, a, λ, the energy or outputs.

    Multipliers have that of their constraint, which a name does not say.
    """
    *words, last = name.split(".")
    place = last in ("x", "y", "z")
    word = words[-1] if place and len(words) > 1 else last
    if is_dimensionless(of.problem):
        return DIMENSIONLESS
    if of.quantity == "lambda" or not (place or word in _UNITS):
        return SI
    return _UNITS.get(word, "m") + _RATES.get(of.quantity, "")


def component(quantity: str, name: str = "") -> str:
    """A component of a trajectory in the field's symbols, or all of them."""
    if quantity in (ENERGY, OUTPUT):
        return name or quantity
    math = rf"$\{quantity}$" if quantity == "lambda" else f"${quantity}$"
    return math + (f" of {name.removeprefix('bodies.')}" if name else "")
