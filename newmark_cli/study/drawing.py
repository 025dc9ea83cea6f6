"""Choices about the figures of a study: in its config, and on the command line.

Plain values, without pydantic: those who read a study's record need them too.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from newmark_cli.study import axes
from newmark_cli.study.measures import ERROR, MEASURES, RECORDS

Entry = TypeVar("Entry")

#: Error against work: made from the rows of `error` and the operations in the record.
WORK_PRECISION = "work-precision"

#: What a figure can show: kinds of rows, measures that give several kinds, and this one.
SHOWABLE = tuple(dict.fromkeys((*RECORDS, *MEASURES, WORK_PRECISION)))

#: Axes that a figure can compare: as the series of a panel, or as panels.
COMPARABLE = tuple(
    axis.name for axis in axes.series_axes() if axis.name not in ("study", "measure", "initial")
)


def kinds(name: str) -> tuple[str, ...]:
    """Kinds of rows that one of `SHOWABLE` stands for; `WORK_PRECISION` for itself."""
    if name in RECORDS or name == WORK_PRECISION:
        return (name,)
    return tuple(record.name for record in MEASURES[name].records)


def needed(name: str) -> tuple[str, ...]:
    """Measures of which a study needs one for one of `SHOWABLE`."""
    if name == WORK_PRECISION:
        return (ERROR.name,)
    return tuple(
        measure.name
        for measure in MEASURES.values()
        if {record.name for record in measure.records} & set(kinds(name))
    )


def quantities(names: Iterable[str]) -> tuple[str, ...]:
    """Quantities that rows have of which the given ones of `SHOWABLE` are made."""
    rows = (kind for name in names for kind in kinds(name))
    of_rows = (RECORDS["error" if kind == WORK_PRECISION else kind].quantities for kind in rows)
    return tuple(dict.fromkeys(quantity for of_kind in of_rows for quantity in of_kind))


#: What figures draw: series against the step size, errors against work, values over time, or a
#: mechanism.
KINDS = ("orders", "work", "history", "drift", "mechanism")


@dataclass(frozen=True)
class Line:
    """One entry of `curves`: series, and how a legend names them."""

    label: str = ""  #: name in the legend; made from its axes when empty
    panel: str = ""  #: title of the panel that it stands in, beside the axes that tell panels apart
    #: axis → its values, over those of the figure
    choice: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: its colour and marker, as matplotlib writes them, where they are given
    look: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Definition:
    """A figure as a study's config defines it, or several of one kind."""

    kinds: tuple[str, ...] = ()  #: kinds of rows, or `WORK_PRECISION`; a figure for each
    #: axis → values; which rows, all where it says nothing
    choice: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: axes that tell the series of a panel and the panels apart; None leaves the choice to the
    #: results
    series: tuple[str, ...] | None = None
    panels: tuple[str, ...] | None = None
    title: str | None = None  #: of the figure; empty for none, made from what it shows when None
    name: str = ""  #: of its files, behind that of the study; made likewise
    figure: str = ""  #: number or word by which `plot` knows it; such a figure names all its series
    kind: str = ""  #: one of `KINDS`; empty for that of its rows
    curves: tuple[Line, ...] = ()  #: its series, where they are named one by one
    note: str = ""  #: what stands above the legend
    columns: int | None = None  #: panels side by side; as suits them when None
    h: float | None = None  #: step size of values over time (s)
    #: largest |fitted − predicted slope| of its series; that of their measure when None
    within: float | None = None
    #: value of an axis → how it is named, and how its series is coloured
    labels: Mapping[str, str] = field(default_factory=dict)
    colors: Mapping[str, str] = field(default_factory=dict)
    style: Mapping[str, Any] = field(default_factory=dict)  #: settings of matplotlib


def definitions(config: Any) -> list[Definition] | None:
    """Figures that a config defines; None where it leaves them to the results.

    The config is that of a study's record, or of a file with values spelled as in CSVs.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    return entries(config, "figures", _definition)


def entries(config: Any, key: str, read: Callable[[Any], Entry]) -> list[Entry] | None:
    """Entries of a list in a config, as `read` has them; None where it has no such list."""
    listed = config.get(key) if isinstance(config, Mapping) else None
    try:
        return None if listed is None else [read(entry) for entry in listed]
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"{key}: not as written by a run: {error}") from None


def _definition(entry: Mapping[str, Any]) -> Definition:
    def axes_of(key: str) -> tuple[str, ...] | None:
        return several(entry, key, COMPARABLE) or None

    def text(key: str, of: Mapping[str, Any] = entry) -> str:
        return str(of.get(key) or "")

    def number(key: str) -> float | None:
        return None if entry.get(key) is None else float(entry[key])

    lines = (
        Line(
            text("label", curve),
            text("panel", curve),
            chosen(curve),
            {key: text(key, curve) for key in ("color", "marker") if curve.get(key)},
        )
        for curve in entry.get("curves") or ()
    )
    columns, title = number("columns"), entry.get("title")
    return Definition(
        kinds(entry["measure"]) if entry.get("measure") else (),
        chosen(entry),
        axes_of("series"),
        axes_of("panels"),
        None if title is None else "" if title == "none" else str(title),
        text("name"),
        text("figure"),
        text("kind"),
        tuple(lines),
        text("note"),
        None if columns is None else int(columns),
        number("h"),
        number("within"),
        dict(entry.get("labels") or {}),
        dict(entry.get("colors") or {}),
        dict(entry.get("style") or {}),
    )


def several(entry: Mapping[str, Any], key: str, known: Iterable[str] = ()) -> tuple[str, ...]:
    """A value or several of an entry; of known ones only, where there are any."""
    value = entry.get(key) or ()
    values = (value,) if isinstance(value, str) else tuple(map(str, value))
    if known and not set(values) <= set(known):
        raise KeyError(f"{key}: {', '.join(values)}")
    return values


def chosen(entry: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Axis → values of an entry of a config, spelled as in CSVs."""
    same = {axis.name: axis.same for axis in axes.series_axes()}
    choice = {}
    for axis in (*COMPARABLE, "initial"):
        if (listed := entry.get(axis)) is not None:
            several = listed if isinstance(listed, list | tuple) else [listed]
            if not all(isinstance(value, str) for value in several):
                raise TypeError(f"{axis}: {listed!r}")
            choice[axis] = tuple(map(same[axis], several))
    return choice
