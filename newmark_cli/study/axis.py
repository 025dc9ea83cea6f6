"""One axis of a study: what tells values along it apart, and how files and people write them."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from newmark_cli.newmark.integrator import TRAPEZOIDAL_NAME, Newmark

TRAPEZOIDAL = Newmark().label
#: Another name of an axis, where one is typed.
ALIASES = {"scaling": "preconditioning"}


@dataclass(frozen=True)
class Axis:
    """One way in which cells, rows or series differ."""

    name: str  #: attribute of `Cell` or `RowAxes`, key of configs, and column of CSVs
    title: str  #: how tables for people head it
    write: Callable[[Any], Any]  #: its value in a CSV: text or a number, from the cell or the row
    #: value that goes without saying in texts, and that a CSV has which lacks the column; None
    #: where there is no such value
    usual: str | None = None
    same: Callable[[str], str] = str  #: what all spellings of one value in a CSV have in common
    names: Collection[str] = ()  #: values that have a name; others are written out
    text: Callable[[str], str] = str  #: a value, as CSVs have it, as legends and titles have it
    #: a value as CSVs have it, from what legends make of one without a name
    plain: Callable[[str], str] = str
    #: what else a value may be called, where one is typed
    also: Callable[[str], Collection[str]] = lambda value: ()
    column: bool = True  #: whether CSVs have a column of its name
    series: bool = True  #: whether it tells series apart
    cell: bool = True  #: whether it tells cells of a study apart
    computed: bool = True  #: whether it is part of what is computed, and so of a kept cell's key
    #: whether it varies inside the axes that are not, in a study's order of cells
    inner: bool = False
    #: version of the columns of a study's CSV, and of ``slopes.csv``, that brought it: columns are
    #: appended, never moved
    since: tuple[int, int] = (3, 3)
    default: Any = ...  #: what a config that lacks the key means
    about: str = ""  #: what the key means, for JSON Schema and the docs
    #: what the column of a CSV holds, for the docs, where ``about`` does not say it
    shows: str = ""
    rare: bool = False  #: whether CSVs have the column only where a value is not the usual one
    many: bool = True  #: whether a config may give several values, which then span a grid
    #: value of a cell from one of the config's
    value: Callable[[Any], Any] = lambda key: key.value() if hasattr(key, "value") else key

    def values(self, case: Any) -> tuple[Any, ...]:
        """Values of the cells of a case along the axis."""
        listed = getattr(case, self.name)
        return tuple(map(self.value, listed if self.many else (listed,)))

    def read(self, word: str) -> str:
        """A value as CSVs have it, from what legends make of it; another word as it is."""
        word = self.plain(word)
        return next((name for name in self.names if self.text(name) == word), word)

    def means(self, word: str, value: str) -> bool:
        """Whether a word is a value that a CSV has, as CSVs or people write it."""
        words = (value, self.text(value), *self.also(value)) if value else ()
        return word in words or (value != "" and value in (self.same(word), self.plain(word)))


def axis(
    title: str = "", *, write: Callable[[Any], Any] | None = None, compare: bool = True, **rest: Any
) -> Any:
    """A field of a dataclass that is an axis; see `Axis`.

    Args:
        title: As of the axis; its name when omitted.
        write: As of the axis; the attribute's value as it is when omitted.
        compare: Whether cells that differ in it are different cells.
        rest: Further attributes of the axis; `initial`, its value in a cell that is not given one,
            is its usual and default value, too, unless these are given.
    """
    initial = rest.pop("initial", ...)
    options: dict[str, Any] = {} if initial is ... else {"default": initial}
    if options and rest.get("many", True):
        rest = {"usual": label(initial), "default": label(initial), **rest}
    elif options:
        rest = {"default": initial, **rest}
    return field(compare=compare, metadata={"title": title, "write": write, **rest}, **options)


def setting(about: str, column: bool = False, **rest: Any) -> Any:
    """A field of a cell that is the same in all of a case: no series differ in it."""
    return axis(about=about, column=column, series=False, cell=False, many=False, **rest)


def axes_of(of: type) -> tuple[Axis, ...]:
    """Axes that the fields of a dataclass declare."""
    return tuple(_axis(declared.name, dict(declared.metadata)) for declared in fields(of))


def _axis(name: str, declared: dict[str, Any]) -> Axis:
    title, write = declared.pop("title") or name, declared.pop("write")
    return Axis(name, title, write or (lambda owner: label(getattr(owner, name))), **declared)


def label(value: Any) -> Any:
    """A value as CSVs spell it."""
    return getattr(value, "label", value)


# -- values in words --------------------------------------------------------------------------

_METHODS = {
    "newmark": "Newmark",
    "generalized-alpha": "generalized-α",
    "hht": "HHT",
    "bdf1": "BDF1",
    "bdf2": "BDF2",
}
_FORMULATIONS = {
    "index-3": "index 3",
    "index-2": "index 2",
    "index-1": "index 1",
    "ggl": "GGL",
    "baumgarte": "Baumgarte",
    "augmented-lagrangian": "augmented Lagrangian",
}
_PARAMETERS = {"beta": "β", "gamma": "γ", "rho": "ρ∞", "alpha": "α", "alpha_m": "α_m",
               "alpha_f": "α_f", "rate": "α", "rate_h": "αh"}  # fmt: skip
MULTIPLIERS = {"newton": "Newton's λ", "recovered": "recovered λ", "total": "total λ"}
#: Kind of rows → the measures that give them, as `newmark_cli.study.measures` declares them.
GIVEN_BY: dict[str, list[str]] = {}
#: Symbols of quantities.
SYMBOLS = {"lambda": "λ", "eta": "η", "jacobian": "C", "omega": "ω"}


def integrator_text(label: str) -> str:
    """An integrator as people write it, numbers with six digits, from its label."""
    if label == TRAPEZOIDAL:
        return TRAPEZOIDAL_NAME
    return _written(label, _METHODS)


def _written(label: str, names: Mapping[str, str]) -> str:
    """A method and its parameters in parentheses, from its label."""
    method, *parameters = label.split()
    if ".py:" in method:
        return method
    pairs = (part.partition("=") for part in parameters)
    texts = [
        f"{_PARAMETERS.get(name, name)} = {float(value):.6g}".replace("-", "−")
        for name, _, value in pairs
    ]
    return " ".join([names.get(method, method), *([f"({', '.join(texts)})"] if texts else [])])


def formulation_text(label: str) -> str:
    """A formulation as people write it, such as Baumgarte (αh = 1), from its label."""
    return _written(label, _FORMULATIONS)


def formulation_label(text: str) -> str:
    """A label from what `formulation_text` makes of it; other text stays as it is."""
    text = text.replace(" = ", "=").replace(" (", " ").removesuffix(")").replace("−", "-")
    for words, other in (
        ("αh=", "rate_h="),
        ("α=", "rate="),
        *((v, k) for k, v in _FORMULATIONS.items()),
    ):
        text = text.replace(words, other)
    return text


def projection_text(label: str) -> str:
    """A projection in words."""
    method, _, rest = label.partition(" ")
    named = "no projection" if method == "none" else f"{method} projection"
    return named + (f" with {rest}" if rest else "")
