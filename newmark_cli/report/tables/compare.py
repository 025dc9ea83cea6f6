"""Two results folders side by side: cells, values, slopes, verdicts, environments."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from newmark_cli.report.judging import expectations
from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.slopes import Slope, study_slopes
from newmark_cli.report.judging.text import text_table
from newmark_cli.report.reading import records
from newmark_cli.study import axes
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.measures import RECORDS
from newmark_cli.study.reading import SERIES, read_study, study_files
from newmark_cli.support.errors import visible

#: Measures of what is determined by more than rounding: they agree to a relative tolerance.
DETERMINED = ("condition", "sensitivity", "krylov_iterations")

#: Factor within which all other measures agree.  Two machines round differently, as two
#: codings of one step do: in the studies `all-forms`, `integrators` and `precision` rms of
#: corrections in physical units scatter by up to 8.4 over forms and variants.
FACTOR = 10.0

#: Columns that tell cells apart.
_CELL = ("study", *(axis.name for axis in axes.cell_axes() if axis.cell), "steps")
_USUAL = {axis.name: axis.usual for axis in axes.cell_axes() if axis.cell}

Key = tuple[str, ...]


@dataclass(frozen=True)
class Difference:
    """Something that is not the same in both folders.

    Attributes:
        what: What it is.
        first, second: What it is in either folder.
    """

    what: str
    first: str
    second: str


@dataclass(frozen=True)
class Comparison:
    """Differences between two results folders, and what they have in common.

    Attributes:
        folders: The two.
        rtol: Relative tolerance of the measures in `DETERMINED`.
        cells: How many are in both.
        lacking: Studies that are in one folder only: of either folder.
        only: Cells, series and rows of studies in both folders that are in one of them only.
        statuses: Cells that ended differently.
        compared: How many values were compared.
        values: Those that do not agree.
        slopes: How many slopes were compared.
        farthest: The slope that differs most; None without any.
        claims: How many claims and expectations were compared.
        verdicts: Slopes, claims and expectations whose verdict is another one.
        environment: What the folders were computed with, where it differs.
    """

    folders: tuple[Path, Path]
    rtol: float
    cells: int
    lacking: tuple[tuple[str, ...], tuple[str, ...]]
    only: tuple[tuple[str, ...], tuple[str, ...]]
    statuses: tuple[Difference, ...]
    compared: int
    values: tuple[Difference, ...]
    slopes: int
    farthest: Difference | None
    claims: int
    verdicts: tuple[Difference, ...]
    environment: tuple[Difference, ...]

    @property
    def differs(self) -> bool:
        """Whether a verdict is another one, or a study in both folders lacks something in one."""
        return bool(self.verdicts) or any(self.only)


@dataclass(frozen=True)
class _Folder:
    """The content of one results folder, as far as it is compared."""

    path: Path
    frames: Mapping[str, pd.DataFrame]
    slopes: Sequence[Slope]

    @classmethod
    def read(cls, path: Path) -> "_Folder":
        files = study_files(path)
        frames = {file.stem: read_study(file) for file in files}
        slopes = [s for file in files for s in study_slopes(frames[file.stem], file)]
        return cls(path, frames, slopes)

    def cells(self) -> dict[Key, str]:
        """Key of a cell → its status."""
        return {
            tuple(_spell(row[column]) for column in _CELL): str(row["status"])
            for frame in self.frames.values()
            for row in frame.to_dict("records")
        }

    def values(self) -> dict[Key, tuple[str, float]]:
        """Key of a row → measure, and the value that is drawn."""
        found: dict[Key, tuple[str, float]] = {}
        for frame in self.frames.values():
            for measure, rows in frame.groupby("measure", sort=False):
                if str(measure) not in RECORDS:
                    continue  # a cell that failed before it measured anything
                values = RECORDS[str(measure)].drawn(rows)
                for row, value in zip(rows.to_dict("records"), values, strict=True):
                    key = tuple(_spell(row[column]) for column in (*SERIES, "h", "steps"))
                    found[key] = (str(measure), float(value))
        return found

    def named_slopes(self) -> dict[SeriesKey, Slope]:
        """Key of a series → its slope."""
        return {slope.key: slope for slope in self.slopes}

    def verdicts(self) -> dict[str, tuple[str, str]]:
        """A claim or an expectation, as a sentence → what was measured, and the verdict."""
        return {
            f"{each.name if each.figure else f'expectation of {each.study}'}: {each.text}": (
                each.measured,
                each.verdict,
            )
            for each in expectations.judge(self.path, self.slopes)
            if not each.missing
        }

    def environment(self) -> dict[str, dict[str, str]]:
        """Study → what it was computed with; nothing of a study without a record."""
        read = {study: records.known(self.path / f"{study}.csv") for study in self.frames}
        return {
            study: records.environment(record)
            | {f"config of {study}": str(record.get("config_sha256", records.UNKNOWN))}
            for study, record in read.items()
            if record
        }


def compare(first: Path, second: Path, rtol: float) -> Comparison:
    """Compare the studies of two results folders.

    Args:
        first, second: The folders.
        rtol: Relative tolerance of the measures in `DETERMINED`; the others agree
            within `FACTOR`.

    Raises:
        ResultsError: When a folder has no results, or a CSV cannot be used.
    """
    a, b = _Folder.read(first), _Folder.read(second)
    cells_a, cells_b = a.cells(), b.cells()
    shared = [key for key in cells_a if key in cells_b]
    values_a, values_b = a.values(), b.values()
    rows = [key for key in values_a if key in values_b]
    slopes_a, slopes_b = a.named_slopes(), b.named_slopes()
    series = [key for key in slopes_a if key in slopes_b]
    claims_a, claims_b = a.verdicts(), b.verdicts()
    claims = [text for text in claims_a if text in claims_b]
    return Comparison(
        folders=(first, second),
        rtol=rtol,
        cells=len(shared),
        lacking=(_lacking(cells_a, cells_b), _lacking(cells_b, cells_a)),
        only=(
            (*_only(cells_a, cells_b), *_only_rows(values_a, values_b, cells_b)),
            (*_only(cells_b, cells_a), *_only_rows(values_b, values_a, cells_a)),
        ),
        statuses=tuple(
            Difference(_cell_name(key), cells_a[key], cells_b[key])
            for key in shared
            if cells_a[key] != cells_b[key]
        ),
        compared=len(rows),
        values=tuple(
            Difference(_row_name(key), f"{values_a[key][1]:.6g}", f"{values_b[key][1]:.6g}")
            for key in rows
            if not agree(values_a[key][0], values_a[key][1], values_b[key][1], rtol)
        ),
        slopes=len(series),
        farthest=_farthest([(slopes_a[key], slopes_b[key]) for key in series]),
        claims=len(claims),
        verdicts=(
            *(
                Difference(
                    _slope_name(slopes_a[key]),
                    f"{format_fit(slopes_a[key].fit)} {slopes_a[key].verdict}",
                    f"{format_fit(slopes_b[key].fit)} {slopes_b[key].verdict}",
                )
                for key in series
                if slopes_a[key].verdict != slopes_b[key].verdict
            ),
            *(
                Difference(text, " ".join(claims_a[text]), " ".join(claims_b[text]))
                for text in claims
                if claims_a[text][1] != claims_b[text][1]
            ),
        ),
        environment=_environments(a.environment(), b.environment()),
    )


def agree(measure: str, a: float, b: float, rtol: float) -> bool:
    """Whether two values of a measure are the same but for rounding.

    Args:
        measure: As in the CSV.
        a, b: The values, not negative; NaN where there is none.
        rtol: Relative tolerance of the measures in `DETERMINED`.
    """
    if math.isnan(a) or math.isnan(b):
        return math.isnan(a) and math.isnan(b)
    if measure in DETERMINED:
        return math.isclose(a, b, rel_tol=rtol)
    low, high = sorted((a, b))
    return high <= FACTOR * low


def as_text(found: Comparison, most: int | None) -> str:
    """For a terminal.

    Args:
        found: The comparison.
        most: How many lines a list may have; any number when None.
    """
    names = [str(folder) for folder in found.folders]
    blocks = [
        "\n".join(
            [
                f"cells in both: {found.cells}",
                *(
                    line
                    for parts in (found.lacking, found.only)
                    for name, only in zip(names, parts, strict=True)
                    for line in _listed(f"only in {name}", only, most)
                ),
            ]
        ),
        _table(f"cells that ended differently: {len(found.statuses)}", names, found.statuses, most),
        _table(
            f"values beyond tolerance: {len(found.values)} of {found.compared} "
            f"({', '.join(DETERMINED)}: {found.rtol:g}; others: a factor of {FACTOR:g})",
            names, found.values, most,
        ),
        _table(
            "slope farthest apart:" if found.farthest else "no slope differs",
            names, [found.farthest] if found.farthest else [], most,
        ),
        _table("computed with something else:", names, found.environment, most)
        if found.environment
        else "no difference in what was recorded of code and machine",
        _table(
            f"verdicts changed: {len(found.verdicts)}, "
            f"of {found.slopes} slopes and {found.claims} claims",
            names, found.verdicts, most,
        ),
    ]  # fmt: skip
    return "\n\n".join(blocks)


def _listed(title: str, entries: Sequence[str], most: int | None) -> list[str]:
    lines = [f"{title}: {entry}" for entry in entries[:most]]
    more = len(entries) - len(lines)
    lines += [f"{title}: {more} more (--all)"] if more else []
    return list(map(visible, lines))


def _table(
    title: str, names: Sequence[str], entries: Sequence[Difference], most: int | None
) -> str:
    if not entries:
        return title
    rows = [("", *names), *((e.what, e.first, e.second) for e in entries[:most])]
    lines = [title, text_table(rows, indent=2)]
    more = len(entries) - (len(rows) - 1)
    return "\n".join([*lines, f"  {more} more (--all)"] if more else lines)


def _lacking(cells: Mapping[Key, str], others: Mapping[Key, str]) -> tuple[str, ...]:
    """Studies that the others lack altogether."""
    theirs = {key[0] for key in others}
    whole = Counter(key[0] for key in cells if key[0] not in theirs)
    return tuple(f"study {study}, {count} cells" for study, count in whole.items())


def _only(cells: Mapping[Key, str], others: Mapping[Key, str]) -> tuple[str, ...]:
    """Cells that the others lack of studies which they have."""
    theirs = {key[0] for key in others}
    return tuple(_cell_name(key) for key in cells if key[0] in theirs and key not in others)


def _only_rows(
    values: Mapping[Key, object], others: Mapping[Key, object], cells: Mapping[Key, str]
) -> tuple[str, ...]:
    """Rows that the others lack of cells which they have; a whole series is one entry."""
    missing: dict[Key, list[Key]] = {}
    for key in values:
        if key not in others and _cell_of(key) in cells:
            missing.setdefault(key[:-2], []).append(key)
    theirs = {key[:-2] for key in others}
    names = []
    for series, keys in missing.items():
        if series in theirs:
            names += [_row_name(key) for key in keys]
        else:
            named = dict(zip(SERIES, series, strict=True))
            rows = "1 row" if len(keys) == 1 else f"{len(keys)} rows"
            names.append(f"{_where(named)}, {_what(named)}, {rows}")
    return tuple(names)


def _cell_of(row: Key) -> Key:
    """Key of the cell that a row belongs to."""
    named = dict(zip((*SERIES, "h", "steps"), row, strict=True))
    return tuple(named[name] for name in _CELL)


def _farthest(pairs: Iterable[tuple[Slope, Slope]]) -> Difference | None:
    apart = [
        (abs(a.fit.slope - b.fit.slope), a, b)
        for a, b in pairs
        if not math.isnan(a.fit.slope - b.fit.slope)
    ]
    distance, a, b = max(apart, key=lambda entry: entry[0], default=(0.0, None, None))
    if a is None or b is None or distance == 0:
        return None
    return Difference(_slope_name(a), format_fit(a.fit), format_fit(b.fit))


def _environments(
    first: Mapping[str, Mapping[str, str]], second: Mapping[str, Mapping[str, str]]
) -> tuple[Difference, ...]:
    """Facts of the studies in both folders that differ; one folder may mix several machines.

    Where a run has no record, as with results that are shipped, nothing of it is compared.
    """
    shared = [study for study in first if study in second]
    ran = [study for study in shared if "python" in first[study] and "python" in second[study]]
    names = dict.fromkeys(name for study in shared for name in (*first[study], *second[study]))
    found = []
    for name in names:
        given = [
            ", ".join(
                dict.fromkeys(
                    folder[study].get(name, records.UNKNOWN)
                    for study in shared
                    if (name in first[study]) + (name in second[study]) > (study not in ran)
                )
            )
            for folder in (first, second)
        ]
        if given[0] != given[1]:
            found.append(Difference(name, *given))
    return tuple(found)


def _spell(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)


def _cell_name(key: Key) -> str:
    named = dict(zip(_CELL, key, strict=True))
    return f"{_where(named)}, {_at(named)}"


def _row_name(key: Key) -> str:
    named = dict(zip((*SERIES, "h", "steps"), key, strict=True))
    return f"{_where(named)}, {_what(named)}, {_at(named)}"


def _slope_name(slope: Slope) -> str:
    named = slope.key.named()
    return f"{_where(named)}, {_what(named)}"


def _where(named: Mapping[str, str]) -> str:
    """Names of a cell, without what goes without saying."""
    said = ("study", "problem", "integrator", "form", "preconditioning")
    rest = [named[name] for name in _CELL if name not in (*said, "h", "steps")]
    usual = [_USUAL[name] for name in _CELL if name not in (*said, "h", "steps")]
    unusual = [given for given, goes in zip(rest, usual, strict=True) if given != goes]
    return " ".join([*(named[name] for name in said), *unusual])


def _what(named: Mapping[str, str]) -> str:
    given = (named["measure"], named["quantity"], named["row_block"])
    return " ".join(part for part in given if part)


def _at(named: Mapping[str, str]) -> str:
    return f"h = {float(named['h']):g}, {float(named['steps']):g} steps"
