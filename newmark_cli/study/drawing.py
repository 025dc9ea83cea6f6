"""What figures of a study can show, and how: in its config, and on the command line."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from newmark_cli.study import axes
from newmark_cli.study.measures import ERROR, MEASURES, RECORDED, RECORDS

Entry = TypeVar("Entry")

#: Error against work: made from the rows of `error` and the operations in the record.
WORK_PRECISION = "work-precision"

#: What a figure can show: kinds of rows, measures that give several kinds, and this one.
SHOWABLE = tuple(dict.fromkeys((*RECORDED, *MEASURES, WORK_PRECISION)))

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


def entries(config: Any, key: str, read: Callable[[Any], Entry]) -> list[Entry] | None:
    """Entries of a list in a config, as `read` has them; None where it has no such list."""
    listed = config.get(key) if isinstance(config, Mapping) else None
    try:
        return None if listed is None else [read(entry) for entry in listed]
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"{key}: not as written by a run: {error}") from None


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
