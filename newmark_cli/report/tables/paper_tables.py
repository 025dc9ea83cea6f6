"""Tables 1 and 2 of the paper, as the shipped config of `all-forms` defines them."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from newmark_cli.newmark.scaling import TABLE_2
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.tables import predicted_tables
from newmark_cli.report.tables.study_tables import groups, report
from newmark_cli.report.tables.table import Record, Report
from newmark_cli.study import shipped
from newmark_cli.study.table_keys import tables
from newmark_cli.support.errors import ResultsError

#: Study that the tables read.
STUDY = "all-forms"

COLUMNS = (
    "table", "entry", "form", "problem", "factor", "predicted", "measured", "stderr",
    "eliminated", "verdict",
)  # fmt: skip


class Entry(NamedTuple):
    """One entry of a table, for one problem: its table and column, and its series."""

    table: str
    column: str
    slope: Slope

    @property
    def record(self) -> Record:
        """It as a row of a CSV."""
        side, _, block = self.column.partition(" ")
        slope = self.slope
        factors = TABLE_2[slope.form]["left" if side == "D_L" else "right"]
        factor = factors[block.replace("λ", "lambda")] if block else ""
        eliminated = "yes" if slope.role == "recovered" else "no"
        values = (
            self.table, self.column, slope.form, slope.problem, factor, int(slope.expected),
            slope.fit.slope, slope.fit.stderr, eliminated, slope.verdict,
        )  # fmt: skip
        return dict(zip(COLUMNS, values, strict=True))

    @property
    def name(self) -> str:
        """It in words."""
        return f"Table {self.table}, {self.column}, {self.slope.form}, {self.slope.problem}"


def _ours(slopes: Iterable[Slope]) -> list[Slope]:
    return [s for s in slopes if s.study == STUDY and s.shipped and s.measure]


def build(slopes: Iterable[Slope]) -> list[Entry]:
    """Entries of both tables; raises `ResultsError` when there are no results of the study."""
    ours = _ours(slopes)
    if not ours:
        raise ResultsError(
            f"no results of the shipped {STUDY}; run 'newmark-study run {STUDY}' first"
        )
    return [
        Entry(layout.table or "", column, slope)
        for layout in tables(shipped.configs()[STUDY])
        for _, placed in groups(ours, layout)
        for column, slope in placed
    ]


def reports(slopes: Sequence[Slope]) -> list[Report]:
    """Both tables; the second begins with the factors themselves."""
    entries, both = build(slopes), []
    for layout in tables(shipped.configs()[STUDY]):
        measured = report(_ours(slopes), layout)
        before = (predicted_tables.factors(),) if layout.table == "2" else ()
        records = [entry.record for entry in entries if entry.table == layout.table]
        both.append(
            Report(measured.name, (*before, *measured.tables), measured.legend, records, COLUMNS)
        )
    return both


def not_as_predicted(entries: Iterable[Entry]) -> list[Entry]:
    """Entries that are not as predicted."""
    return [entry for entry in entries if entry.slope.missed]


def worst(entries: Iterable[Entry]) -> str:
    """How far the measured orders are from the predicted ones, a line for each kind."""
    kinds: dict[str, list[float]] = {}
    for _, column, slope in entries:
        of_factors = "factors" if column.startswith("D_") else "corrections"
        kind = "condition numbers" if column == "C" else of_factors
        kinds.setdefault(kind, []).append(abs(slope.fit.slope - slope.expected))
    return "\n".join(
        f"{len(off)} {kind}: at most {max(off):.2g} from the predicted order"
        for kind, off in kinds.items()
    )
