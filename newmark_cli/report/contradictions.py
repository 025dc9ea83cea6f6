"""Contradictions in a study's CSV, which no run writes: found without recomputing anything.

A CSV says many things twice.  Steps follow from h and t_end; a mean over N steps is a
multiple of 1/N; rms, max and median bound each other; physical corrections are scaled
ones times known factors; a cell has the rows of its measures, together and in one order.
What is said here holds for every CSV that the tool has written, whatever the study, so
that a contradiction is somebody's change and no accident of rounding.

The record next to a CSV says which cells there are besides, twice again: in its config,
which spans a grid, and in its list of cells.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import compress, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.errors import InputError
from newmark_cli.newmark import integrator
from newmark_cli.newmark.forms import Form
from newmark_cli.newmark.formulation import Formulation, Projection, formulated
from newmark_cli.newmark.integrator import FIELDS, INTEGRATORS
from newmark_cli.newmark.linear.choice import AUTO, DENSE
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.report import records
from newmark_cli.study import axes, results
from newmark_cli.study.axes import SATURATION
from newmark_cli.study.measures import MEASURES, Measure
from newmark_cli.study.provenance import config_checksum
from newmark_cli.study.reading import Table, read_texts
from newmark_cli.study.results import NUMBERS

#: Numbers that count; the others are floats.
_COUNTS = ("steps", "zeros", "not_converged", "met")
_STATISTICS = ("rms", "max", "median", "last")
#: Columns that a cell has in all its rows, besides those that tell it from others.
_OF_CELL = ("not_converged", "newton_iterations", "status", "met")
#: Statuses of cells that took all their steps.
_COMPLETED = ("ok", "not_converged")
#: Far above what rounding does to a statistic, far below what anybody would change.
_SLACK = 1e-9
#: Sensitivities come from a linear solve each; smaller ones than this share of the largest
#: may be nothing but its rounding.
_SOLVED, _NOISE = 1e-2, 1e-6
#: Smaller values lose digits to underflow.
_SMALL = 1e-290
#: Cells that one finding names.
_MOST_NAMED = 3

_MEASURE_OF: Mapping[str, Measure] = {
    record.name: measure for measure in MEASURES.values() for record in measure.records
}
_AXES = tuple(axis for axis in axes.cell_axes() if axis.cell)
_WRITTEN = (*(axis.name for axis in _AXES), "t_end", "steps")
#: Columns of numbers, and whether they count.
_SPELLED = tuple((column, column in _COUNTS) for column in sorted(NUMBERS))

CellKey = tuple[Any, ...]


@dataclass(frozen=True)
class Contradiction:
    """Something in a CSV that the tool has not written.

    Attributes:
        path: The CSV.
        line: Its line, counted from 1.
        text: What is wrong, in words.
    """

    path: Path
    line: int
    text: str

    def __str__(self) -> str:
        """As a line for people."""
        return f"{self.path}, line {self.line}: not what the tool writes: {self.text}"

    def row(self) -> dict[str, Any]:
        """As values for programs."""
        return {"study": self.path.stem, "line": self.line, "contradiction": self.text}


def _cell(
    texts: Mapping[str, str], numbers: Mapping[str, float], known: dict[CellKey, CellKey]
) -> CellKey:
    """Labels that tell the cell of a row from others; one object for all its rows.

    Args:
        texts, numbers: Of the row.
        known: How cells are written → what tells them from others; taken up here.
    """
    written = tuple(texts[name] for name in _WRITTEN)
    if (cell := known.get(written)) is not None:
        return cell
    named = (numbers["h"] if axis.name == "h" else axis.same(texts[axis.name]) for axis in _AXES)
    t_end, steps = numbers["t_end"], numbers["steps"]
    cell = (*named, t_end, steps)
    if not (math.isnan(t_end) or math.isnan(steps)):  # such cells are not even like themselves
        known[written] = cell
    return cell


@dataclass(frozen=True, eq=False)
class _Row:
    """A row of the CSV: texts as they stand there, and numbers."""

    line: int
    texts: Mapping[str, str]
    numbers: Mapping[str, float]
    cell: CellKey  #: what tells its cell from others

    def __getitem__(self, column: str) -> float:
        return self.numbers[column]

    @property
    def completed(self) -> bool:
        """Whether its cell took all its steps."""
        return self.texts["status"] in _COMPLETED

    @property
    def counted(self) -> tuple[float, float]:
        """Least and most values that its statistics can be of."""
        steps, measure = self["steps"], self.texts["measure"]
        if measure in ("correction", "physical_correction"):
            most = steps - self["not_converged"]
            return (most if self.completed else 0), most
        if measure == "tolerance":
            return (steps if self.completed else 0), steps
        if measure == "error":
            return 0, 1
        if measure in ("krylov_iterations", "krylov_residual"):
            return 0, math.inf
        return 0, max(steps, 1)

    @property
    def name(self) -> tuple[str, str, str, str]:
        """Labels that tell it from the other rows of its cell."""
        return tuple(self.texts[c] for c in ("measure", "quantity", "role", "row_block"))  # type: ignore[return-value]


@dataclass(frozen=True)
class _Segment:
    """Rows of one cell and measure that stand together."""

    cell: CellKey
    measure: str
    rows: list[_Row]

    @property
    def line(self) -> int:
        return self.rows[0].line


def contradictions(path: Path, texts: Table, record: Mapping[str, Any]) -> list[Contradiction]:
    """Find what a CSV says that no run writes.

    Args:
        path: The CSV.
        texts: Its rows as text, as `newmark_cli.study.reading.read_texts` has them;
            `read_study` must take them.
        record: What stands next to it; empty where there is none.

    Returns:
        In the order of the lines.
    """
    columns = list(texts.columns)
    rows = []
    cells: dict[CellKey, CellKey] = {}
    for line, values in zip(texts.lines, texts.rows(columns), strict=True):
        named = dict(zip(columns, values, strict=True))
        numbers = {name: float(named[name] or math.nan) for name in NUMBERS}
        rows.append(_Row(line, named, numbers, _cell(named, numbers, cells)))
    found = [(row.line, text) for row in rows for text in _of_row(row)]
    segments = _segments(rows)
    found += [*_of_segments(segments), *_of_sensitivities(rows), *_of_record(rows, record)]
    return [Contradiction(path, line, text) for line, text in sorted(dict.fromkeys(found))]


def of_studies(folder: Path, names: Iterable[str]) -> list[Contradiction]:
    """Contradictions in the CSVs of studies of a results folder.

    Raises:
        ResultsError: When a CSV is missing or cannot be used.
    """
    found = []
    for name in names:
        file = folder / f"{name}.csv"
        contents = results.read(file)  # of one run, though another may be writing
        texts = read_texts(file, contents[file])
        found += contradictions(
            file, texts, records.known(file, contents[file.with_suffix(".json")])
        )
    return found


# -- one row ------------------------------------------------------------------------------------


def _of_row(row: _Row) -> Iterator[str]:
    misspelled = list(_misspelled(row))
    yield from misspelled
    if misspelled:
        return
    yield from _times(row)
    yield from _outcome(row)
    if row.texts["measure"] in _MEASURE_OF:
        yield from _statistics(row)


def _misspelled(row: _Row) -> Iterator[str]:
    """Numbers read back to the same bits, and are written in one way."""
    texts, numbers = row.texts, row.numbers
    for column, counts in _SPELLED:
        given = texts[column]
        if not given:
            continue
        number = numbers[column]
        if counts:
            spelled = f"{number:.0f}" if math.isfinite(number) else "a whole number"
        else:
            spelled = "" if math.isnan(number) else repr(number)
        if given != spelled:
            yield f"{column} is {given!r}, which would be {spelled!r}"


def _times(row: _Row) -> Iterator[str]:
    h, t_end, steps = row["h"], row["t_end"], row["steps"]
    ratio = t_end / h * (1 + 1e-9)
    if not (math.isfinite(ratio) and math.floor(ratio) == steps):
        yield f"{steps:.0f} steps of h = {h:g} do not end at t_end = {t_end:g}"


def _outcome(row: _Row) -> Iterator[str]:
    """How a cell ended, how many steps converged, and their iterations on average."""
    steps, missed, mean = row["steps"], row["not_converged"], row["newton_iterations"]
    status, met = row.texts["status"], row["met"]
    if not 0 <= missed <= steps:
        yield f"not_converged is {row.texts['not_converged']!r} of {steps:.0f} steps"
    elif status in _COMPLETED and (status == "ok") != (missed == 0):
        yield f"status is {status!r}, and {missed:.0f} steps did not converge"
    if status in _COMPLETED and steps > 0:
        # A mean of whole numbers, each at least 1.
        total = round(mean * steps) if math.isfinite(mean) else 0
        if total < steps or total / steps != mean:
            yield (
                f"newton_iterations is {row.texts['newton_iterations']!r}, which is not a mean "
                f"over {steps:.0f} steps"
            )
    elif status in _COMPLETED and not math.isnan(mean):
        yield "newton_iterations without steps"
    tolerance = row.texts["stop"] != SATURATION
    if not tolerance and not math.isnan(met):
        yield "met without a tolerance to meet"
    elif tolerance and status in _COMPLETED and met != steps - missed:
        converged = f"{steps - missed:.0f} of {steps:.0f} steps converged"
        yield f"met is {row.texts['met']!r}, where {converged}"


def _statistics(row: _Row) -> Iterator[str]:
    """Rms, max, median, last and zeros of the same values, none of them negative."""
    rms, largest, median, last = (row[name] for name in _STATISTICS)
    zeros, (least, most) = row["zeros"], row.counted
    if math.isnan(largest):
        if not (math.isnan(rms) and math.isnan(median)):
            yield "rms or median without max"
        return
    values = (rms, largest, median, last)
    if any(map(math.isnan, values)) or math.isnan(zeros):
        yield "max without the other statistics"
        return
    if min(values) < 0 or zeros < 0:
        yield "a statistic is negative"
        return
    if most == 0:
        yield "statistics of no steps"
        return
    if not all(map(math.isfinite, values)):
        return
    if median > largest:
        yield f"median {median:g} is above max {largest:g}"
    if last > largest:
        yield f"last {last:g} is above max {largest:g}"
    # Half of the values are at most the median, half at least.
    squares = (median / largest) ** 2 if largest else 0.0
    high = largest * math.sqrt((1 + min(squares, 1)) / 2)
    low = max(median / math.sqrt(2), largest / math.sqrt(most))
    if rms > high * (1 + _SLACK):
        yield f"rms {rms:g} is above {high:g}, the most that max and median allow"
    elif rms < low * (1 - _SLACK):
        yield f"rms {rms:g} is below {low:g}, the least that max and median allow"
    yield from _zeros(row, zeros, least, most)
    if most == 1 and not (last == largest == median and math.isclose(rms, largest)):
        yield "statistics of one value differ from each other"
    measure = row.texts["measure"]
    if measure == "condition" and row.texts["linear_solver"] == DENSE and min(values) < 1 - 1e-6:
        yield f"a condition number of {min(values):g} is below 1"
    if measure in ("tolerance", "krylov_iterations") and (largest % 1 or last % 1 or median % 0.5):
        yield "iterations are not whole numbers"
    if measure == "tolerance" and row["newton_iterations"] > rms * (1 + _SLACK):
        mean = f"{row['newton_iterations']:g}"
        yield f"{mean} newton_iterations on average are above their rms {rms:g}"


def _zeros(row: _Row, zeros: float, least: float, most: float) -> Iterator[str]:
    """How many values are exactly 0, next to what other statistics say of that."""
    rms, largest, median, last = (row[name] for name in _STATISTICS)
    if zeros > most:
        yield f"{zeros:.0f} zeros among {most:.0f} values"
    elif zeros == 0 and 0 in (largest, median, last):
        yield "a statistic is exactly 0, and zeros is 0"
    elif least == most:
        if (zeros == most) != (largest == 0):
            yield f"{zeros:.0f} of {most:.0f} values are zeros, and max is {largest:g}"
        elif (2 * zeros > most and median > 0) or (2 * zeros < most and median == 0):
            yield f"{zeros:.0f} of {most:.0f} values are zeros, and the median is {median:g}"
        elif rms > largest * math.sqrt((most - zeros) / most) * (1 + _SLACK):
            yield f"rms {rms:g} is too large for {zeros:.0f} zeros of {most:.0f} values"


# -- the rows of a cell -------------------------------------------------------------------------


def _segments(rows: Iterable[_Row]) -> list[_Segment]:
    found: list[_Segment] = []
    for row in rows:
        measure = _MEASURE_OF.get(row.texts["measure"])
        name, cell = measure.name if measure else "", row.cell
        if not found or (found[-1].cell, found[-1].measure) != (cell, name):
            found.append(_Segment(cell, name, []))
        found[-1].rows.append(row)
    return found


def _of_segments(segments: Sequence[_Segment]) -> Iterator[tuple[int, str]]:
    """A cell's rows of one measure: together, all of them, in their order, of one outcome."""
    first: dict[tuple[CellKey, str], _Segment] = {}
    apart = {
        key
        for key, count in Counter((s.cell, s.measure) for s in segments).items()
        if count > 1
    }  # fmt: skip
    for segment in segments:
        key = (segment.cell, segment.measure)
        before = first.setdefault(key, segment)
        if before is not segment:
            yield segment.line, f"rows of the cell of line {before.line} stand apart from it"
        if key not in apart and segment.measure:
            incomplete = list(_incomplete(segment))
            yield from incomplete
            if not incomplete:
                yield from _of_corrections(segment)
        for row in segment.rows[1:]:
            for column in _OF_CELL:
                if row.texts[column] != segment.rows[0].texts[column]:
                    yield (
                        row.line,
                        f"{column} is {row.texts[column]!r}, and {segment.rows[0].texts[column]!r} "
                        f"in line {segment.line} of the same cell",
                    )


def _incomplete(segment: _Segment) -> Iterator[tuple[int, str]]:
    measure = MEASURES[segment.measure]
    form = _form(*(segment.rows[0].texts[column] for column in ("form", "formulation")))
    if measure.rows is None or form is None:
        return
    expected = [tuple(name) for name in measure.rows(form)]
    given = [row.name for row in segment.rows]
    there = [name for name in expected if name in given or name[1] not in measure.may_lack]
    if given == there:
        return
    missing = [_said(name) for name in there if name not in given]
    if missing:
        rows = "row" if len(missing) == 1 else "rows"
        yield segment.line, f"the cell has {measure.name}, but no {rows} {', '.join(missing)}"
    for row in segment.rows:
        if row.name not in there:
            yield row.line, f"{measure.name} of {form.described} has no row {_said(row.name)}"
    if sorted(given) == sorted(there):
        row = next(r for r, name in zip(segment.rows, there, strict=True) if r.name != name)
        yield row.line, f"rows of {measure.name} are in another order"


def _said(name: Sequence[str]) -> str:
    return " ".join(part for part in name if part and part != "primary")


def _of_corrections(segment: _Segment) -> Iterator[tuple[int, str]]:
    """Physical corrections are the scaled ones times D_R, or times the form's weights."""
    if segment.measure != "correction":
        return
    first = segment.rows[0]
    scheme = _scheme(
        *(first.texts[c] for c in ("integrator", "form", "formulation", "preconditioning")),
        first["h"],
    )
    if scheme is None:
        return
    form = scheme.form
    scaled = {r.texts["quantity"]: r for r in segment.rows if r.texts["measure"] == "correction"}
    for row in segment.rows:
        quantity = row.texts["quantity"]
        if row.texts["measure"] != "physical_correction":
            continue
        if quantity not in form.unknowns and "eta" in form.unknowns:
            # η moves it too, and by how much does not follow from norms.
            continue
        if quantity in form.unknowns:
            source, factor = quantity, 1.0
        else:
            weights = np.abs(scheme.elimination.weights[FIELDS.index(quantity)])
            source, factor = form.kept[int(np.argmax(weights))], float(weights.max())
        factor *= float(scheme.right[form.unknowns.index(source)])
        for column in _STATISTICS:
            before, given = scaled[source][column], row[column]
            expected = factor * before
            tiny = 0 < before < _SMALL or max(expected, given) < _SMALL
            if math.isfinite(expected) and not (
                tiny or math.isclose(given, expected, rel_tol=_SLACK)
            ):
                yield (
                    row.line,
                    f"{column} of the physical correction of {quantity} is {given:g}, where line "
                    f"{scaled[source].line} and the scaling say {expected:g}",
                )
                break


@cache
def _form(name: str, formulation: str) -> Form | None:
    """Form in a formulation by the words of a CSV; None where they cannot be read."""
    try:
        return formulated(name, formulation)
    except (InputError, LookupError, ValueError):
        return None


@cache
def _scheme(method: str, name: str, formulation: str, scaling: str, h: float) -> Scheme | None:
    """Scheme by the words of a CSV; None where they cannot be read."""
    form = _form(name, formulation)
    if form is None:
        return None
    try:
        factors = Preconditioning.parse(scaling).scaling(form)
        scheme = Scheme(integrator.parse(method), form, factors, h)
        usable = bool(np.isfinite(scheme.right).all() and np.isfinite(scheme.left).all())
    except (ArithmeticError, InputError, LookupError, TypeError, ValueError):
        return None
    return scheme if usable else None


def _of_sensitivities(rows: Iterable[_Row]) -> Iterator[tuple[int, str]]:
    """How unknowns react to rows at the initial state: alike in every form and scaling.

    But for the factors of that row and that unknown, which are known.  What is nothing but
    rounding next to the reactions of other unknowns is left out.
    """
    known: dict[tuple[Any, ...], list[tuple[float, float, _Row]]] = {}
    largest: dict[tuple[Any, ...], float] = {}
    for row in rows:
        quantity, block, given = row.texts["quantity"], row.texts["row_block"], row["median"]
        if row.texts["measure"] != "sensitivity" or row["steps"] > 0 or row.texts["status"] != "ok":
            continue
        factor, balanced = (
            _factor(row, quantity, block, row.texts["preconditioning"]),
            _factor(row, quantity, block, "optimal"),
        )
        if not (factor and balanced and math.isfinite(given)):
            continue
        at = (*(row.texts[c] for c in ("problem", "integrator", "formulation", "h")), block)
        known.setdefault((*at, quantity), []).append((given * factor, balanced, row))
        largest[at] = max(largest.get(at, 0.0), given * factor / balanced)
    for (*where, _), group in known.items():
        middle = float(np.median([value for value, *_ in group]))
        for value, balanced, row in group:
            is_rounding = max(value, middle) / balanced < _NOISE * largest[tuple(where)]
            if not is_rounding and not math.isclose(value, middle, rel_tol=_SOLVED):
                times = value / middle if middle else math.inf
                yield row.line, f"the sensitivity is {times:.3g} times that of other series"


def _factor(row: _Row, quantity: str, block: str, scaling: str) -> float:
    """Factor by which a scaling divides a sensitivity; 0 if it is not known."""
    words = (row.texts[column] for column in ("integrator", "form", "formulation"))
    scheme = _scheme(*words, scaling, row["h"])
    if scheme is None or quantity not in scheme.form.unknowns or block not in scheme.form.rows:
        return 0.0
    left = scheme.left[scheme.form.rows.index(block)]
    return float(left * scheme.right[scheme.form.unknowns.index(quantity)])


# -- the record ---------------------------------------------------------------------------------


def _of_record(rows: Sequence[_Row], record: Mapping[str, Any]) -> Iterator[tuple[int, str]]:
    """The cells of the record's config, and those that it lists, are those of the CSV."""
    config = record.get("config")
    digest = record.get("config_sha256")
    if isinstance(config, dict) and isinstance(digest, str) and config_checksum(config) != digest:
        yield 1, "the config in its record is not the one that config_sha256 is of"
    if not rows:
        return
    lines: dict[CellKey, int] = {}
    for row in rows:
        lines.setdefault(row.cell, row.line)
    # One for each cell: its rows share it.
    given = [rows[0].cell]
    given += [row.cell for before, row in pairwise(rows) if row.cell is not before.cell]
    end = rows[-1].line
    try:
        grid = list(_grid(config))
    except (ArithmeticError, AttributeError, InputError, LookupError, TypeError, ValueError):
        grid = []
    if grid:
        yield from _differences(given, [cell for cell, _ in grid], lines, end, "the config")
        yield from _unmeasured(rows, grid)
    listed = record.get("cells")
    if isinstance(listed, list) and listed:
        try:
            cells = [_listed(cell) for cell in listed]
        except (AttributeError, LookupError, TypeError, ValueError):
            return
        short = [(*cell[:-2], cell[-1]) for cell in given]
        by_short = {(*cell[:-2], cell[-1]): line for cell, line in lines.items()}
        yield from _differences(
            short, [cell for cell, _ in cells], by_short, end, "the list of cells"
        )
        statuses = dict(cells)
        for row in rows:
            key = (*row.cell[:-2], row.cell[-1])
            status = row.texts["status"]
            if statuses.get(key, status) != status:
                yield row.line, f"status is {status!r}, and {statuses[key]!r} in its record"


def _listed(cell: Mapping[str, Any]) -> tuple[CellKey, str]:
    """Labels that tell a cell of the record from others, and how it ended."""
    named = [
        float(cell["h"]) if axis.name == "h" else axis.same(str(cell.get(axis.name, axis.usual)))
        for axis in _AXES
    ]
    return (*named, float(cell["steps"])), str(cell["status"])


def _grid(config: Any) -> Iterator[tuple[CellKey, tuple[str, ...]]]:
    """Cells of a resolved config with their measures, in the order of the CSV.

    None stands for a value that the config does not tell: a linear solver that is chosen
    by size, a problem in Python.
    """
    for case in config["cases"]:
        values = {
            axis.name: tuple(_LABELS.get(axis.name, str)(one) for one in _several(case, axis))
            for axis in _AXES
        }
        for at in axes.grid(values):
            h = at["h"]
            t_end, steps = case.get("t_end"), case.get("steps")
            if steps is None:
                steps = math.floor(t_end / h * (1 + 1e-9))
            elif t_end is None:
                t_end = steps * h
            named = (at[axis.name] for axis in _AXES)
            yield (*named, float(t_end), float(steps)), tuple(case["measure"])


def _several(case: Mapping[str, Any], axis: axes.Axis) -> Sequence[Any]:
    """Values that a case gives for an axis; older configs lack some axes."""
    if axis.name in case:
        return case[axis.name] if axis.many else (case[axis.name],)
    if axis.name == "stop":
        return (None,)
    if axis.usual is None:
        raise KeyError(axis.name)
    if axis.name == "integrator":
        return ({"method": "newmark"},)
    return (AUTO if axis.name == "multipliers" else axis.usual,)


def _problem_label(given: Any) -> str | None:
    from newmark_cli.mechanisms import loading
    from newmark_cli.mechanisms.spec import Shipped, Sized

    if isinstance(given, dict):
        if "python" in given:
            return None
        ((family, sizes),) = given.items()
        return Sized(family, tuple(sizes.items())).label
    is_file = Path(given).suffix in (".yaml", ".yml")
    return loading.label(given) if is_file else Shipped(given).label


def _integrator_label(given: Mapping[str, Any]) -> str:
    parameters = {name: float(value) for name, value in given.items() if name != "method"}
    return str(INTEGRATORS[given["method"]](**parameters).label)


def _scaling_label(given: Any) -> str:
    if not isinstance(given, dict):
        return str(given)
    left, right = (
        tuple(
            (block, "".join(str(factor).split())) for block, factor in given.get(side, {}).items()
        )
        for side in ("left", "right")
    )
    return Preconditioning(given["name"], left, right, own=True).label


def _formulation_label(given: Any) -> str:
    if not isinstance(given, dict):
        return Formulation.parse(given).label
    parameters = [(k, float(v)) for k, v in given.items() if k != "method" and v is not None]
    return Formulation(given["method"], *parameters[:1]).label


def _projection_label(given: Any) -> str:
    if not isinstance(given, dict):
        return Projection.parse(given).label
    return Projection(given["method"], bool(given.get("accelerations"))).label


def _stop_label(given: Any) -> str:
    if not given:
        return SATURATION
    return Tolerance(given.get("absolute") or 0.0, given.get("relative") or 0.0).label


_LABELS: Mapping[str, Any] = {
    "problem": _problem_label,
    "integrator": _integrator_label,
    "preconditioning": _scaling_label,
    "linear_solver": lambda given: None if given == AUTO else given,
    "formulation": _formulation_label,
    "projection": _projection_label,
    "multipliers": lambda given: None if given == AUTO else given,
    "stop": _stop_label,
    "h": float,
}


def _differences(
    given: Sequence[CellKey],
    expected: Sequence[CellKey],
    lines: Mapping[CellKey, int],
    end: int,
    where: str,
) -> Iterator[tuple[int, str]]:
    """Cells of the CSV against those of its record: which are there, and in which order."""
    told = _told(expected)
    ours = _without_repeats((told(cell), cell) for cell in given)
    theirs = _without_repeats((told(cell), cell) for cell in expected)
    here, there = {key for key, _ in ours}, {key for key, _ in theirs}
    missing = [cell for key, cell in theirs if key not in here]
    more = [cell for key, cell in ours if key not in there]
    if missing:
        yield end, f"lacks {_counted(missing)} of {where} in its record: {_named(missing)}"
    for cell in more[:_MOST_NAMED]:
        yield lines[cell], f"{where} in its record has no cell {_named([cell])}"
    if len(more) > _MOST_NAMED:
        yield lines[more[_MOST_NAMED]], f"{where} in its record has {len(more)} of its cells not"
    if not missing and not more and [key for key, _ in ours] != [key for key, _ in theirs]:
        place = next(
            i for i, (a, b) in enumerate(zip(ours, theirs, strict=False)) if a[0] != b[0]
        )  # fmt: skip
        yield lines[ours[place][1]], f"cells are in another order than in {where} in its record"


def _told(expected: Iterable[CellKey]) -> Callable[[CellKey], CellKey]:
    """What expected cells tell of a cell: without places at which one of them has None."""
    unknown = {place for cell in expected for place, value in enumerate(cell) if value is None}
    if not unknown:
        return lambda cell: cell
    known = [place not in unknown for place in range(len(_WRITTEN))]
    return lambda cell: tuple(compress(cell, known))


def _without_repeats(
    cells: Iterable[tuple[CellKey, CellKey]],
) -> list[tuple[CellKey, CellKey]]:
    """Cells without those that repeat the one before them."""
    found: list[tuple[CellKey, CellKey]] = []
    for key, cell in cells:
        if not found or found[-1][0] != key:
            found.append((key, cell))
    return found


def _unmeasured(
    rows: Sequence[_Row], grid: Sequence[tuple[CellKey, tuple[str, ...]]]
) -> Iterator[tuple[int, str]]:
    """Cells that ended well have rows of every measure of their case."""
    told = _told(cell for cell, _ in grid)
    measured: dict[CellKey, set[str]] = {}
    for row in rows:
        measure = _MEASURE_OF.get(row.texts["measure"])
        measured.setdefault(told(row.cell), set()).update([measure.name] if measure else [])
    wanted: dict[CellKey, set[str]] = {}
    for cell, measures in grid:
        wanted.setdefault(told(cell), set()).update(measures)
    said = set()
    for row in rows:
        key = told(row.cell)
        lacking = wanted.get(key, set()) - measured[key]
        if lacking and row.completed and key not in said:
            said.add(key)
            yield row.line, f"the cell lacks its rows of {', '.join(sorted(lacking))}"


def _counted(cells: Sequence[CellKey]) -> str:
    return "a cell" if len(cells) == 1 else f"{len(cells)} cells"


def _named(cells: Sequence[CellKey]) -> str:
    """Cells in words, not many of them."""
    usual = {axis.name: axis.usual for axis in _AXES}
    texts = []
    for cell in cells[:_MOST_NAMED]:
        named = dict(zip((axis.name for axis in _AXES), cell, strict=False))
        parts = [
            str(value)
            for name, value in named.items()
            if name != "h" and value is not None and value != usual[name]
        ]
        texts.append(" ".join([*parts, f"h={named['h']:g}", f"steps={cell[-1]:.0f}"]))
    return "; ".join(texts) + ("; …" if len(cells) > _MOST_NAMED else "")
