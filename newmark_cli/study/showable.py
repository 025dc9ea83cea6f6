"""What figures and tables of a study can show: in its config, and on the command line."""

from collections.abc import Iterable

from newmark_cli.study import axes
from newmark_cli.study.measures import MEASURES, RECORDED, RECORDS

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
        return ("error",)
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

#: Axes that rows and columns of tables can stand for.
TABULATED = (*COMPARABLE, "measure")

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
    "least": "smallest value, and its step size",
    "finest": "value at the smallest step size",
    "local_orders": "orders between successive step sizes",
    "verdict": "whether it is as predicted",
    "reason": "why the verdict is not a plain pass",
    "failed": "why a cell failed",
}
