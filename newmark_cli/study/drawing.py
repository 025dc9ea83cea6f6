"""Choices about the figures of a study: in its config, and on the command line.

Plain values, without pydantic: those who read a study's record need them too.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from newmark_cli.study import axes
from newmark_cli.study.measures import ERROR, MEASURES, RECORDS

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
    found = (RECORDS["error" if kind == WORK_PRECISION else kind].quantities for kind in rows)
    return tuple(dict.fromkeys(quantity for several in found for quantity in several))


@dataclass(frozen=True)
class Definition:
    """A figure as a study's config defines it, or several of one kind.

    Attributes:
        kinds: Kinds of rows, or `WORK_PRECISION`; a figure for each.
        quantity, problem, form: Which rows; all when empty.
        series, panels: Axes that tell the series of a panel and the panels apart; None
            leaves the choice to the results.
        title: Of the figure; made from what it shows when empty.
        name: Of its files, behind that of the study; made likewise.
    """

    kinds: tuple[str, ...]
    quantity: tuple[str, ...] = ()
    problem: tuple[str, ...] = ()
    form: tuple[str, ...] = ()
    series: tuple[str, ...] | None = None
    panels: tuple[str, ...] | None = None
    title: str = ""
    name: str = ""


def definitions(config: Any) -> list[Definition] | None:
    """Figures that a resolved config defines; None where it leaves them to the results.

    Args:
        config: As in a study's record.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    given = config.get("figures") if isinstance(config, Mapping) else None
    if given is None:
        return None
    try:
        return [_definition(entry) for entry in given]
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f"figures: not as written by a run: {error}") from None


def _definition(entry: Mapping[str, Any]) -> Definition:
    def several(key: str) -> tuple[str, ...]:
        return tuple(str(value) for value in entry.get(key) or ())

    def axes_of(key: str) -> tuple[str, ...] | None:
        found = several(key) or None
        if found and not set(found) <= set(COMPARABLE):
            raise KeyError(f"{key}: {', '.join(found)}")
        return found

    return Definition(
        kinds(entry["measure"]),
        several("quantity"),
        several("problem"),
        several("form"),
        axes_of("series"),
        axes_of("panels"),
        str(entry.get("title") or ""),
        str(entry.get("name") or ""),
    )
