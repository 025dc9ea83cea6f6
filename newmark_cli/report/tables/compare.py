"""Two results folders side by side: cells, values, slopes, verdicts, environments."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.report.judging import expectations
from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.slopes import Slope, study_slopes
from newmark_cli.report.judging.text import text_table
from newmark_cli.report.reading import records
from newmark_cli.study import axes
from newmark_cli.study.measures import RECORDS
from newmark_cli.study.reading import read_study, study_files
from newmark_cli.support.errors import visible

#: Measures of what is determined by more than rounding: they agree to a relative tolerance.
DETERMINED = ("condition", "sensitivity", "krylov_iterations")

#: Factor within which all other measures agree.  Two machines round differently, as two
#: codings of one step do: in the studies `all-forms`, `integrators` and `precision` rms of
#: corrections in physical units scatter by up to 8.4 over forms and variants.
FACTOR = 10.0

#: Axes that tell cells apart and are said only where they have another value than usually.
_SAID = ("problem", "integrator", "form", "preconditioning")
_UNUSUAL = {
    axis.name: axis.usual
    for axis in axes.cell_axes()
    if axis.cell and axis.name not in (*_SAID, "h", "steps")
}


@dataclass(frozen=True)
class Difference:
    """Something that is not the same in both folders, and what it is in either."""

    what: str
    first: str
    second: str


@dataclass(frozen=True)
class Comparison:
    """Differences between two results folders, and what they have in common."""

    folders: tuple[Path, Path]  #: the two
    rtol: float  #: relative tolerance of the measures in `DETERMINED`
    #: How many cells, values, slopes, and claims and expectations are in both.
    cells: int
    #: Studies that are in one folder only: of either folder.
    lacking: tuple[tuple[str, ...], tuple[str, ...]]
    #: Cells, series and rows of studies in both folders that are in one of them only.
    only: tuple[tuple[str, ...], tuple[str, ...]]
    statuses: tuple[Difference, ...]  #: cells that ended differently
    compared: int
    values: tuple[Difference, ...]  #: values that do not agree
    slopes: int
    farthest: Difference | None  #: the slope that differs most; None without any
    claims: int
    #: Slopes, claims and expectations whose verdict is another one.
    verdicts: tuple[Difference, ...]
    environment: tuple[Difference, ...]  #: what the folders were computed with, where it differs

    @property
    def differs(self) -> bool:
        """Whether a verdict is another one, or a study in both folders lacks something in one."""
        return bool(self.verdicts) or any(self.only)


@dataclass(frozen=True)
class _Row:
    """A value of a CSV with its study, cell and series in words."""

    measure: str
    value: float
    study: str
    cell: str
    series: str


class _Folder:
    """The comparable content of a results folder, by names in words."""

    def __init__(self, path: Path) -> None:
        self.statuses: dict[str, str] = {}  # by cell
        self.rows: dict[str, _Row] = {}
        self.environment: dict[str, dict[str, str]] = {}  # by study
        slopes: list[Slope] = []
        for file in study_files(path):
            frame = read_study(file)
            slopes += study_slopes(frame, file)
            for measure, of_measure in frame.groupby("measure", sort=False, dropna=False):
                record = RECORDS.get(str(measure))
                values = record.drawn(of_measure) if record else [math.nan] * len(of_measure)
                for row, value in zip(of_measure.to_dict("records"), values, strict=True):
                    at = f"h = {row['h']:g}, {row['steps']:g} steps"
                    cell, series = f"{_where(row)}, {at}", f"{_where(row)}, {_what(row)}"
                    self.statuses[cell] = str(row["status"])
                    if record:  # else of a cell that failed before it measured anything
                        entry = _Row(str(measure), float(value), str(row["study"]), cell, series)
                        self.rows[f"{series}, {at}"] = entry
            if record_of := records.known(file):
                digest = str(record_of.get("config_sha256", records.UNKNOWN))
                computed_with = records.environment(record_of)
                self.environment[file.stem] = computed_with | {f"config of {file.stem}": digest}
        # Of claims and series what was measured, and the verdict.
        self.claims = {
            f"{claim.name if claim.figure else f'expectation of {claim.study}'}: {claim.text}": (
                claim.measured,
                claim.verdict,
            )
            for claim in expectations.judge(path, slopes)
            if not claim.missing
        }
        keys = [(slope, slope.key.named()) for slope in slopes]
        self.slopes = {f"{_where(key)}, {_what(key)}": slope for slope, key in keys}
        self.studies = Counter(cell.partition(" ")[0] for cell in self.statuses)

    def alone(self, other: "_Folder") -> tuple[str, ...]:
        """Cells, series and rows of studies in both folders that the other one lacks."""
        cells = [
            cell
            for cell in self.statuses
            if cell not in other.statuses and cell.partition(" ")[0] in other.studies
        ]
        theirs = {row.series for row in other.rows.values()}
        lacking = {
            name: row
            for name, row in self.rows.items()
            if name not in other.rows and row.cell in other.statuses
        }
        missing = Counter(row.series for row in lacking.values() if row.series not in theirs)
        series = [f"{name}, {n} row{'s' if n > 1 else ''}" for name, n in missing.items()]
        return (*cells, *series, *(n for n, row in lacking.items() if row.series in theirs))

    def lacked(self, other: "_Folder") -> tuple[str, ...]:
        """Studies that the other folder lacks altogether."""
        missing = self.studies.keys() - other.studies.keys()
        return tuple(f"study {s}, {n} cells" for s, n in self.studies.items() if s in missing)


def _both(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Pairs of values by the names that both have."""
    return {name: (mine[name], theirs[name]) for name in mine if name in theirs}


def compare(first: Path, second: Path, rtol: float) -> Comparison:
    """Compare two results folders; measures in `DETERMINED` agree to a relative tolerance."""
    a, b = _Folder(first), _Folder(second)
    cells, rows = _both(a.statuses, b.statuses), _both(a.rows, b.rows)
    slopes, claims = _both(a.slopes, b.slopes), _both(a.claims, b.claims)
    verdicts = claims | {
        name: ((format_fit(x.fit), x.verdict), (format_fit(y.fit), y.verdict))
        for name, (x, y) in slopes.items()
    }
    return Comparison(
        folders=(first, second),
        rtol=rtol,
        cells=len(cells),
        lacking=(a.lacked(b), b.lacked(a)),
        only=(a.alone(b), b.alone(a)),
        statuses=tuple(Difference(name, *pair) for name, pair in cells.items() if len({*pair}) > 1),
        compared=len(rows),
        values=tuple(
            Difference(name, f"{x.value:.6g}", f"{y.value:.6g}")
            for name, (x, y) in rows.items()
            if not agree(x.measure, x.value, y.value, rtol)
        ),
        slopes=len(slopes),
        farthest=_farthest(slopes),
        claims=len(claims),
        verdicts=tuple(
            Difference(name, " ".join(x), " ".join(y))
            for name, (x, y) in verdicts.items()
            if x[1] != y[1]
        ),
        environment=_environments(a.environment, b.environment),
    )


def agree(measure: str, a: float, b: float, rtol: float) -> bool:
    """Whether two values of a measure, at least 0, or NaN for none, agree but for rounding."""
    if math.isnan(a) or math.isnan(b):
        return math.isnan(a) and math.isnan(b)
    if measure in DETERMINED:
        return math.isclose(a, b, rel_tol=rtol)
    low, high = sorted((a, b))
    return high <= FACTOR * low


def as_text(comparison: Comparison, most: int | None) -> str:
    """For a terminal, with lists of at most so many lines; of any number when that is None."""
    names = [str(folder) for folder in comparison.folders]
    lines = [f"cells in both: {comparison.cells}"]
    for parts in (comparison.lacking, comparison.only):
        for name, only in zip(names, parts, strict=True):
            lines += [visible(f"only in {name}: {entry}") for entry in only[:most]]
            if more := len(only[len(only) if most is None else most :]):
                lines.append(visible(f"only in {name}: {more} more (--all)"))
    farthest, environment = comparison.farthest, comparison.environment
    lists: list[tuple[str, Sequence[Difference]]] = [
        (f"cells that ended differently: {len(comparison.statuses)}", comparison.statuses),
        (
            f"values beyond tolerance: {len(comparison.values)} of {comparison.compared} "
            f"({', '.join(DETERMINED)}: {comparison.rtol:g}; others: a factor of {FACTOR:g})",
            comparison.values,
        ),
        ("slope farthest apart:", [farthest]) if farthest else ("no slope differs", []),
        ("computed with something else:", environment)
        if environment
        else ("no difference in what was recorded of code and machine", []),
        (
            f"verdicts changed: {len(comparison.verdicts)}, "
            f"of {comparison.slopes} slopes and {comparison.claims} claims",
            comparison.verdicts,
        ),
    ]
    blocks = ["\n".join(lines)]
    for title, entries in lists:
        rows = [("", *names), *((e.what, e.first, e.second) for e in entries[:most])]
        block = f"{title}\n{text_table(rows, indent=2)}" if entries else title
        if len(entries) >= len(rows):
            block += f"\n  {len(entries) - len(rows) + 1} more (--all)"
        blocks.append(block)
    return "\n\n".join(blocks)


def _farthest(slopes: Mapping[str, tuple[Slope, Slope]]) -> Difference | None:
    """The pair of slopes that differs most, if any does."""
    apart = {name: abs(a.fit.slope - b.fit.slope) for name, (a, b) in slopes.items()}
    name = max(apart, key=lambda name: np.nan_to_num(apart[name]), default="")
    if not apart.get(name, 0.0) > 0:
        return None
    return Difference(name, *(format_fit(slope.fit) for slope in slopes[name]))


def _environments(
    first: Mapping[str, Mapping[str, str]], second: Mapping[str, Mapping[str, str]]
) -> tuple[Difference, ...]:
    """Facts of the studies in both folders that differ; one folder may mix several machines.

    Where a run has no record, as with results that are shipped, nothing of it is compared.
    """
    shared = [study for study in first if study in second]
    ran = [study for study in shared if "python" in first[study] and "python" in second[study]]
    names = dict.fromkeys(name for study in shared for name in (*first[study], *second[study]))
    differences = []
    for name in names:
        of_run = [study for study in shared if name in first[study] or name in second[study]]
        of_run = [s for s in of_run if s in ran or (name in first[s] and name in second[s])]
        texts = [
            ", ".join(dict.fromkeys(folder[s].get(name, records.UNKNOWN) for s in of_run))
            for folder in (first, second)
        ]
        if texts[0] != texts[1]:
            differences.append(Difference(name, *texts))
    return tuple(differences)


def _where(row: Mapping[Any, Any]) -> str:
    """Name of a cell but for its step size, without usual values."""
    unusual = (row[name] for name, usual in _UNUSUAL.items() if row[name] != usual)
    return " ".join([str(row["study"]), *(str(row[name]) for name in _SAID), *unusual])


def _what(row: Mapping[Any, Any]) -> str:
    return " ".join(filter(None, (row["measure"], row["quantity"], row["row_block"])))
