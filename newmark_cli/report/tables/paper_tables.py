"""Tables 1 and 2 of the paper, as the shipped config of `all-forms` defines them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.tables import predicted_tables
from newmark_cli.report.tables.study_tables import groups, report
from newmark_cli.report.tables.table import Report
from newmark_cli.study import shipped
from newmark_cli.study.entries import tables
from newmark_cli.support.errors import ResultsError

#: Study that the tables read.
STUDY = "all-forms"


def _ours(slopes: Iterable[Slope]) -> list[Slope]:
    """Series of the study; raises `ResultsError` when there are none."""
    ours = [s for s in slopes if s.study == STUDY and s.shipped and s.measure]
    if not ours:
        raise ResultsError(
            f"no results of the shipped {STUDY}; run 'newmark-study run {STUDY}' first"
        )
    return ours


def entries(slopes: Iterable[Slope]) -> Iterator[tuple[str, Slope]]:
    """Table and column of each entry, and its series."""
    ours = _ours(slopes)
    for layout in tables(shipped.configs()[STUDY]):
        for _, placed in groups(ours, layout):
            yield from ((f"Table {layout.table}, {column}", slope) for column, slope in placed)


def reports(slopes: Sequence[Slope]) -> list[Report]:
    """Both tables; the second begins with the factors themselves."""
    ours = _ours(slopes)
    first, second = (report(ours, layout) for layout in tables(shipped.configs()[STUDY]))
    return [first, replace(second, tables=(predicted_tables.factors(), *second.tables))]


def not_as_predicted(slopes: Iterable[Slope]) -> list[tuple[str, Slope]]:
    """Name and series of each entry that is not as predicted."""
    return [
        (f"{name}, {slope.form}, {slope.problem}", slope)
        for name, slope in entries(slopes)
        if slope.missed
    ]
