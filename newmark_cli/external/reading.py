"""Runs of another code, from the table that it wrote.

A row is the state of one run at one time.  Columns are named as in `Trajectory.to_frame`:
``u[A.x]``, ``v[A.x]``, ``lambda[bars.rod]``, ``output[O.force.x]``; a mapping names others.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from newmark_cli.library.arguments import shown
from newmark_cli.problems.problem import Problem
from newmark_cli.study import axes
from newmark_cli.study.trajectories import require_parquet
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

#: What the runs of a series differ in; the first that a table has counts.
STEP_SIZE, TOLERANCE = "h", "tolerance"
ABSCISSAS = (STEP_SIZE, TOLERANCE, "steps")
#: Parts of a state.
STATE = ("u", "v", "lambda", "output")
#: Axes that say which method a code has.
METHOD = ("integrator", "formulation", "projection", "multipliers", "start", "evaluation")
#: Columns besides the state: of numbers, and of text.
NUMBERS = (*ABSCISSAS, "t", "twin", "iterations", "seconds", "calls", "correction")
TEXTS = ("series", "message", *METHOD)
#: Newton's successive corrections in a step.
CORRECTIONS = re.compile(r"correction\[(\d+)\]")
#: Names without brackets that number a part of the state: ``u1``, ``v_3``, ``lam[2]``.
_NUMBERED = re.compile(r"([a-zλ]+)[_\[(]?(\d+)[\])]?")
_PARTS = {"u": "u", "q": "u", "x": "u", "v": "v", "qd": "v", "qp": "v", "lambda": "lambda",
          "lam": "lambda", "la": "lambda", "λ": "lambda"}  # fmt: skip
_FACTOR = re.compile(r"\s*(-)?\s*(?:([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*\*\s*)?(.+?)\s*")
#: Name of a series that the table does not name.
UNNAMED = "your code"
#: Lines in which digits are counted, and fewer digits than a double has.
_LOOKED_AT, _FEW_DIGITS = 200, 12


@dataclass(frozen=True, eq=False)
class Run:
    """One run, its rows in the order of time.

    Attributes:
        series: Label of the series that it belongs to.
        size: Step size (s), or tolerance.
        twin: 0, or the number of the run from a start one unit in the last place away.
        t: (k,) times (s).
        state: Part → (k, size) values; NaN where the table has none.
        numbers: Further column → (k,) values.
        message: What the code said of it.
        method: Axis → value that the table says of it.
        lacks: Columns of the state that the table has, without a number in the last row.
    """

    series: str
    size: float
    twin: int
    t: Array
    state: Mapping[str, Array]
    numbers: Mapping[str, Array]
    message: str = ""
    method: Mapping[str, str] = field(default_factory=dict)
    lacks: Sequence[str] = ()

    @property
    def ended(self) -> bool:
        """Whether the last row has all numbers."""
        return not self.lacks

    @property
    def corrections(self) -> Array:
        """(k, j) Newton's corrections in the steps of the rows; j may be 0."""
        found = {int(place[1]): values for name, values in self.numbers.items()
                 if (place := CORRECTIONS.fullmatch(name))}  # fmt: skip
        columns = [found[number] for number in sorted(found)]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self.t), 0))


@dataclass(frozen=True, eq=False)
class Runs:
    """What a table holds.

    Attributes:
        runs: In the order of series, and of sizes from the largest.
        abscissa: ``"h"`` or ``"tolerance"``.
        given: Part → names of its components that the table has.
        notes: What was taken for granted, in sentences.
        digits: Most digits of a number, as text; None where there is no text.
        single: Whether each number of the state is one of single precision.
    """

    runs: Sequence[Run]
    abscissa: str
    given: Mapping[str, Sequence[str]]
    notes: Sequence[str]
    digits: int | None = None
    single: bool = False


def names_of(problem: Problem) -> dict[str, tuple[str, ...]]:
    """Part of the state → names of its components."""
    outputs = problem.outputs.names if problem.outputs is not None else ()
    return {
        "u": problem.coordinate_names,
        "v": problem.coordinate_names,
        "lambda": problem.constraint_names,
        "output": tuple(outputs),
    }


def read(source: Any, problem: Problem, columns: Mapping[str, Any] | None = None) -> Runs:
    """Runs from a table.

    Args:
        source: A DataFrame, or the path of a CSV or Parquet file.
        problem: What was solved.
        columns: Column of this tool → column of the table, with a factor if need be:
            ``{"lambda[bars.rod]": "-2 * force"}``.

    Raises:
        ArgumentError: When the table cannot be used; names the column or line.
    """
    import pandas as pd

    where = "table" if isinstance(source, pd.DataFrame) else str(source)
    frame = source if isinstance(source, pd.DataFrame) else _file(Path(source))
    if not len(frame):
        raise ArgumentError(f"{where}: no row")
    if frame.columns.duplicated().any():
        twice = frame.columns[frame.columns.duplicated()][0]
        raise ArgumentError(f"{where}: column {twice} is there twice")
    notes: list[str] = []
    taken = _columns([str(name) for name in frame.columns], problem, columns, where, notes)
    single = None

    def numbers(name: str) -> Array:
        nonlocal single
        theirs, factor = taken[name]
        values = _numbers(frame[theirs], f"{where}: {theirs}", where)
        if name.partition("[")[0] in STATE and factor == 1 and single is not False:
            finite = values[np.isfinite(values)]
            # Zeros and ones are numbers of any precision.
            if np.any(finite != np.round(finite, 3)):
                with np.errstate(over="ignore"):
                    single = bool(np.all(finite == finite.astype(np.float32)))
        return factor * values

    found = {name: numbers(name) for name in taken if name not in TEXTS}
    abscissa = next((name for name in ABSCISSAS if name in found), None)
    if abscissa is None or "t" not in found:
        lacking = "t" if abscissa else "h, tolerance or steps"
        raise ArgumentError(f"{where}: needs a column {lacking}; has {_some(frame.columns)}")
    table = pd.DataFrame(found)
    for name in TEXTS:
        if name in taken:
            table[name] = frame[taken[name][0]].fillna("").astype(str).to_numpy()
    if "series" not in table:
        table["series"] = UNNAMED
    given = {part: [n for n in names if f"{part}[{n}]" in found]
             for part, names in names_of(problem).items()}  # fmt: skip
    if not any(given.values()):
        wanted = ", ".join(f"{part}[{names[0]}]" for part, names in names_of(problem).items()
                           if names)  # fmt: skip
        raise ArgumentError(
            f"{where}: no column of {problem.name}, such as {wanted}; has {_some(frame.columns)}"
        )
    runs = list(_runs(table, abscissa, problem, where))
    return Runs(
        runs, TOLERANCE if abscissa == TOLERANCE else STEP_SIZE, given, notes,
        _digits(frame, [taken[f"{p}[{n}]"][0] for p, names in given.items() for n in names]),
        bool(single),
    )  # fmt: skip


def _file(path: Path) -> "pd.DataFrame":
    """A file's table; of a CSV as text, since other parsers lose last digits."""
    import pandas as pd

    try:
        if path.suffix == ".parquet":
            require_parquet()
            return pd.read_parquet(path)
        frame = pd.read_csv(path, dtype=str, keep_default_na=False, skipinitialspace=True)
    except OSError as error:
        raise ArgumentError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, pd.errors.ParserError) as error:  # of either library
        raise ArgumentError(f"{path}: not a table: {str(error).splitlines()[0]}") from None
    frame.columns = frame.columns.str.strip()
    return frame


def _columns(
    known: Sequence[str],
    problem: Problem,
    mapping: Mapping[str, Any] | None,
    where: str,
    notes: list[str],
) -> dict[str, tuple[str, float]]:
    """Column of this tool → column of the table, and what its numbers are multiplied by."""
    ours = {f"{part}[{name}]": part for part, names in names_of(problem).items() for name in names}
    allowed = (*NUMBERS, *TEXTS, *ours)
    found: dict[str, tuple[str, float]] = {}
    for name, given in (mapping or {}).items():
        if name not in allowed:
            raise ArgumentError(f"columns: unknown {shown(name)}{nearest(name, allowed)}")
        match = _FACTOR.fullmatch(str(given))
        assert match is not None
        factor = float(match[2] or 1) * (-1 if match[1] else 1)
        if match[3] not in known:
            raise ArgumentError(
                f"columns: {name}: {where} has no column {match[3]!r}{nearest(match[3], known)}"
            )
        found[name] = (match[3], factor)
    for name in known:
        if name in allowed or CORRECTIONS.fullmatch(name):
            found.setdefault(name, (name, 1.0))
        elif re.fullmatch(r"(u|v|lambda|output)\[.*\]", name) and not any(
            theirs == name for theirs, _ in found.values()
        ):
            raise ArgumentError(f"{where}: {problem.name} has no {name}{nearest(name, ours)}")
    _number_columns(known, problem, found, notes)
    used = {theirs for theirs, _ in found.values()}
    left = [name for name in known if name not in used and not name.startswith("a[")]
    if left:
        notes.append(f"not read: column {_some(left)}")
    return found


def _number_columns(
    known: Sequence[str],
    problem: Problem,
    found: dict[str, tuple[str, float]],
    notes: list[str],
) -> None:
    """Take columns that are numbered, one for each component, in the mechanism's order."""
    numbered: dict[str, list[tuple[int, str]]] = {}
    for name in known:
        match = _NUMBERED.fullmatch(name.lower())
        if match and match[1] in _PARTS:
            numbered.setdefault(_PARTS[match[1]], []).append((int(match[2]), name))
    for part, columns in numbered.items():
        names = names_of(problem)[part]
        wanted = [f"{part}[{name}]" for name in names]
        if len(columns) == len(names) and not set(wanted) & found.keys():
            found |= {
                name: (theirs, 1.0)
                for name, (_, theirs) in zip(wanted, sorted(columns), strict=True)
            }
            first, last = sorted(columns)[0][1], sorted(columns)[-1][1]
            span = first if len(columns) == 1 else f"{first} … {last}"
            notes.append(f"{span}: taken for {wanted[0]} … in the mechanism's order")


def _numbers(column: "pd.Series[Any]", what: str, where: str) -> Array:
    """(rows,) numbers of a column; NaN where it is empty, or says that there is none."""
    values = column.to_numpy()
    if values.dtype.kind in "iuf":
        return np.asarray(values, float)
    texts = ["nan" if given is None or given != given else str(given).strip() for given in values]
    try:
        return np.array([float(text) if text else math.nan for text in texts])
    except ValueError:
        found = np.empty(len(texts))
        for place, text in enumerate(texts):
            try:
                # What C writes for numbers that are none.
                found[place] = float("nan" if not text or "nan" in text.lower() else text)
            except ValueError:
                line = f"line {place + 2}" if where.endswith(".csv") else f"row {place + 1}"
                raise ArgumentError(f"{what}, {line}: not a number, given {text!r}") from None
        return found


def _runs(table: "pd.DataFrame", abscissa: str, problem: Problem, where: str) -> Iterator[Run]:
    """The rows of each run, of each series by descending sizes."""
    ours = names_of(problem)
    if "twin" not in table:
        table["twin"] = 0
    for name in (abscissa, "t"):
        wrong = (
            ~np.isfinite(table[name])
            | (table[name] < 0)
            | ((table[name] == 0) if name == abscissa else False)
        )
        if wrong.any():
            place = int(np.argmax(wrong.to_numpy()))
            raise ArgumentError(
                f"{where}, line {place + 2}: {name} must be "
                f"{'a time, not negative' if name == 't' else 'positive'}, given "
                f"{table[name].iloc[place]:g}"
            )
    keys = ["series", abscissa, "twin"]
    for series, of_series in table.groupby("series", sort=False):
        sizes = of_series.groupby(keys, sort=False)
        runs = []
        for key, rows in sizes:
            _, size, twin = cast(tuple[str, float, float], key)
            rows = rows.sort_values("t", kind="stable")
            again = rows["t"].duplicated() & np.isfinite(rows["t"])
            if again.any():
                raise ArgumentError(
                    f"{where}: series {series}, {abscissa} = {size:g}: t = "
                    f"{rows['t'][again].iloc[0]:g} is there twice; give each run a label in the "
                    "column series, or twins their number in the column twin"
                )
            t = rows["t"].to_numpy()
            h = (t[-1] - problem.t0) / size if abscissa == "steps" else size
            state = {
                part: np.stack(
                    [
                        rows[name].to_numpy() if (name := f"{part}[{one}]") in rows
                        else np.full(len(rows), np.nan)
                        for one in names
                    ],
                    axis=1,
                )
                for part, names in ours.items() if names
            }  # fmt: skip
            columns = [str(name) for name in rows.columns]
            numbers = {name: rows[name].to_numpy(float) for name in columns
                       if name in NUMBERS[4:] or CORRECTIONS.fullmatch(name)}  # fmt: skip
            words = {n: str(rows[n].iloc[-1]) for n in TEXTS[1:] if n in rows and rows[n].iloc[-1]}
            message = words.pop("message", "")
            last = {f"{part}[{name}]": number for part, names in ours.items() if names
                    for name, number in zip(names, state[part][-1], strict=True)}  # fmt: skip
            lacks = [name for name, number in last.items()
                     if name in columns and not math.isfinite(number)]  # fmt: skip
            runs.append(
                Run(str(series), float(h), int(twin), t, state, numbers, message, words, lacks)
            )
        yield from sorted(runs, key=lambda run: (-run.size, run.twin))


def _digits(frame: "pd.DataFrame", columns: Iterable[str]) -> int | None:
    """Most digits that a number of the state is written with; None where there is no text."""
    most = None
    for column in columns:
        for text in frame[column].head(_LOOKED_AT):
            if isinstance(text, str):
                mantissa = re.sub(r"[eE].*", "", text).strip().lstrip("+-0.")
                most = max(most or 0, len(mantissa.replace(".", "")))
    return most


def few_digits(runs: Runs) -> bool:
    """Whether numbers were printed with fewer digits than rounding needs."""
    return runs.digits is not None and 1 < runs.digits < _FEW_DIGITS


def _some(names: Iterable[Any]) -> str:
    every = [str(name) for name in names]
    return ", ".join(every[:6]) + (f" and {len(every) - 6} more" if len(every) > 6 else "")


def changed(runs: Runs, change: Callable[[Run], Mapping[str, Array]], *notes: str) -> Runs:
    """The same runs with other values of their states."""
    return replace(
        runs,
        runs=[replace(run, state={**run.state, **change(run)}) for run in runs.runs],
        notes=(*runs.notes, *notes),
    )


def require_known_axes(runs: Runs) -> None:
    """Refuse words of a method that mean nothing; the readers of the axes say which."""
    for run in runs.runs:
        axes.SeriesKey.of({"study": run.series, "form": "u-lambda", "problem": "", **run.method})
