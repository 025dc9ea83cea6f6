"""Tables of a study, in its config and on the command line.

Plain values, without pydantic: those who read a study's record need them too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from newmark_cli.study import drawing

#: Axes that rows and columns can stand for.
AXES = (*drawing.COMPARABLE, "measure")

#: What a table can say of a series → in words.
VALUES = {
    "predicted": "predicted order",
    "tolerance": "largest difference from it that passes",
    "fitted": "fitted slope ± standard error",
    "slope": "fitted slope",
    "stderr": "its standard error",
    "points": "how many step sizes the fit is for",
    "h_from": "largest step size of the fit",
    "h_to": "smallest step size of the fit",
    "local_orders": "orders between successive step sizes",
    "verdict": "whether it is as predicted",
    "reason": "why the verdict is not a plain pass",
}


@dataclass(frozen=True)
class Heading:
    """A column: its label, and the series that its entries are of, axis → values."""

    label: str
    choice: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Layout:
    """A table of fitted orders, or several of one kind."""

    rows: tuple[str, ...] = ()  #: axes that tell rows apart; those that vary when empty
    #: axes that tell columns apart. Without any, and without headings, each series has a row, and
    #: its values are the columns.
    columns: tuple[str, ...] = ()
    #: columns one by one; an entry is of the strongest of its series
    headings: tuple[Heading, ...] = ()
    values: tuple[str, ...] = ("predicted", "fitted")  #: what it says of a series, of `VALUES`
    #: axis → values, which series it is about; all where it says nothing
    choice: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    title: str = ""  #: what it shows
    name: str = ""  #: number or word of its files; empty for none


def layouts(config: Any) -> list[Layout]:
    """Tables that a config defines; see `newmark_cli.study.drawing.definitions`.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    return drawing.entries(config, "tables", _layout) or []


def _layout(entry: Mapping[str, Any]) -> Layout:
    headings = (
        Heading(str(heading["label"]), _chosen(heading)) for heading in entry.get("headings") or ()
    )
    return Layout(
        drawing.several(entry, "rows", AXES),
        drawing.several(entry, "columns", AXES),
        tuple(headings),
        drawing.several(entry, "values", VALUES) or Layout.values,
        _chosen(entry),
        str(entry.get("title") or ""),
        str(entry.get("table") or ""),
    )


def _chosen(entry: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Axis → values of an entry, including the measure."""
    kinds = [kind for name in drawing.several(entry, "measure") for kind in drawing.kinds(name)]
    return drawing.chosen(entry) | ({"measure": tuple(kinds)} if kinds else {})
