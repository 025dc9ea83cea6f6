"""Runs of another code, from the table that it wrote.

A row is the state of one run at one time.  Columns are named as in `Trajectory.to_frame`:
``u[A.x]``, ``v[A.x]``, ``lambda[bars.rod]``, ``output[O.force.x]``; a mapping names others.
"""

import errno
import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from newmark_cli.library.arguments import shown
from newmark_cli.problems.problem import Problem
from newmark_cli.study.trajectories import require_parquet
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

#: What the runs of a series differ in; the first that a table has counts.
STEP_SIZE, TOLERANCE = "h", "tolerance"
ABSCISSAS = (STEP_SIZE, TOLERANCE, "steps")
#: Axes that say which method a code has.
METHOD = ("integrator", "formulation", "projection", "multipliers", "start", "evaluation")
#: Columns besides the state: of numbers, and of text.
WORK = ("iterations", "seconds", "calls")
NUMBERS = (*ABSCISSAS, "t", "twin", *WORK)
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
#: Lines in which digits are counted, and digits that suffice to judge rounding.
_LOOKED_AT, _FEW_DIGITS = 200, 12


@dataclass(frozen=True, eq=False)
class Run:
    """One run, its rows in the order of time."""

    series: str  #: label of the series that it belongs to
    size: float  #: step size (s), or tolerance
    twin: int  #: 0, or the number of the run from a start one unit in the last place away
    t: Array  #: (k,) times (s)
    state: Mapping[str, Array]  #: part → (k, size) values; NaN where the table has none
    numbers: Mapping[str, Array]  #: further column → (k,) values
    message: str = ""  #: what the code said of it
    method: Mapping[str, str] = field(default_factory=dict)  #: axis → value that the table has
    lacks: Sequence[str] = ()  #: columns of the state without a number in the last row

    @property
    def ended(self) -> bool:
        """Whether the last row has all numbers."""
        return not self.lacks

    @property
    def corrections(self) -> Array:
        """(k, j) Newton's corrections in the steps of the rows; j may be 0."""
        columns = {int(place[1]): values for name, values in self.numbers.items()
                 if (place := CORRECTIONS.fullmatch(name))}  # fmt: skip
        return np.array([columns[number] for number in sorted(columns)]).reshape(-1, len(self.t)).T


@dataclass(frozen=True, eq=False)
class Runs:
    """What a table holds."""

    runs: Sequence[Run]  #: in the order of series, and of sizes from the largest
    abscissa: str  #: ``"h"`` or ``"tolerance"``
    components: Mapping[str, Sequence[str]]  #: part → names of its components that the table has
    notes: Sequence[str]  #: what was taken for granted, in sentences
    digits: int = 0  #: most digits of a number, as text; 0 where there is no text
    single: bool = False  #: whether each number of the state is one of single precision

    @property
    def few_digits(self) -> bool:
        """Whether numbers were printed with fewer digits than rounding needs."""
        return 1 < self.digits < _FEW_DIGITS


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

    frame, where = _frame(source)
    notes: list[str] = []
    taken = _columns([str(name) for name in frame.columns], problem, columns, where, notes)
    numbers = {name: factor * _numbers(frame[theirs], f"{where}: {theirs}", where)
             for name, (theirs, factor) in taken.items() if name not in TEXTS}  # fmt: skip
    abscissa = _abscissa(numbers, f"; has {_some(frame.columns)}", where)
    ours = {part: [f"{part}[{name}]" for name in names]
            for part, names in names_of(problem).items() if names}  # fmt: skip
    present = {part: [name for name in names if name in numbers] for part, names in ours.items()}
    state = [*chain(*present.values())]
    if not state:
        wanted = ", ".join(names[0] for names in ours.values())
        raise ArgumentError(
            f"{where}: no column of {problem.name}, such as {wanted}; has {_some(frame.columns)}"
        )
    table = pd.DataFrame({"series": UNNAMED, "twin": 0.0, **numbers})
    for name in TEXTS:
        if name in taken:
            table[name] = frame[taken[name][0]].fillna("").astype(str).to_numpy()
    _refuse_rows(table, abscissa, where, problem.t0)
    later = frame[(table["t"] > problem.t0).to_numpy()]
    if not len(later):
        raise ArgumentError(f"{where}: only starts: add rows that your code has computed")
    unscaled = [numbers[name] for name in state if taken[name][1] == 1]
    return Runs(
        _runs(table, abscissa, problem, ours, present),
        TOLERANCE if abscissa == TOLERANCE else STEP_SIZE,
        present,
        notes,
        _most_digits(later[[taken[name][0] for name in state]].head(_LOOKED_AT)),
        _is_single(np.concatenate([np.zeros(0), *unscaled])),
    )  # fmt: skip


def _frame(source: Any) -> tuple["pd.DataFrame", str]:
    """A table with rows, and what errors call it."""
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        frame, where = source, "table"
    else:
        frame, where = _file(Path(source)), str(source)
    if not len(frame):
        raise ArgumentError(f"{where}: no row")
    if frame.columns.duplicated().any():
        twice = frame.columns[frame.columns.duplicated()][0]
        raise ArgumentError(f"{where}: column {twice} is there twice")
    return frame, where


def _runs(
    table: "pd.DataFrame",
    abscissa: str,
    problem: Problem,
    ours: Mapping[str, Sequence[str]],
    present: Mapping[str, Sequence[str]],
) -> list[Run]:
    """The runs of a table in the order of series, and of sizes from the largest."""
    runs = []
    further = [name for name in table if name in WORK or CORRECTIONS.fullmatch(str(name))]
    keys = ["series", abscissa, "twin"]
    for key, rows in table.sort_values("t", kind="stable").groupby(keys):
        series, size, twin = cast(tuple[str, float, float], key)
        last = rows.iloc[-1]
        runs.append(Run(
            series,
            float((last["t"] - problem.t0) / size if abscissa == "steps" else size),
            int(twin),
            rows["t"].to_numpy(),
            {part: rows.reindex(columns=[*names]).to_numpy(float) for part, names in ours.items()},
            {str(name): rows[name].to_numpy() for name in further},
            last.get("message", ""),
            {name: last[name] for name in METHOD if last.get(name)},
            [name for part in present.values() for name in part if not math.isfinite(last[name])],
        ))  # fmt: skip
    order = table["series"].unique().tolist()
    return sorted(runs, key=lambda run: (order.index(run.series), -run.size, run.twin))


def _file(path: Path) -> "pd.DataFrame":
    """A file's table; of a CSV as text, since other parsers lose last digits."""
    import pandas as pd

    try:
        if path.suffix == ".parquet":
            require_parquet()
            return pd.read_parquet(path.absolute())
        # An absolute path is no address, which pandas would fetch.
        frame = pd.read_csv(
            path.absolute(), dtype=str, keep_default_na=False, skipinitialspace=True
        )
    except OSError as error:
        missing = os.strerror(errno.ENOENT) if isinstance(error, FileNotFoundError) else str(error)
        raise ArgumentError(f"{path}: cannot be read: {error.strerror or missing}") from None
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
    sources: dict[str, tuple[str, float]] = {}
    for name, expression in (mapping or {}).items():
        if name not in allowed:
            raise ArgumentError(f"columns: unknown {shown(name)}{nearest(name, allowed)}")
        sources[name] = _times(expression, known, f"columns: {name}: {where}")
    for name in known:
        if name in allowed or CORRECTIONS.fullmatch(name):
            sources.setdefault(name, (name, 1.0))
        elif re.fullmatch(r"(u|v|lambda|output)\[.*\]", name) and not any(
            theirs == name for theirs, _ in sources.values()
        ):
            raise ArgumentError(f"{where}: {problem.name} has no {name}{nearest(name, ours)}")
    _number_columns(known, problem, sources, notes)
    used = {theirs for theirs, _ in sources.values()}
    left = [name for name in known if name not in used and not name.startswith("a[")]
    if left:
        notes.append(f"not read: column {_some(left)}")
    return sources


def _times(expression: Any, known: Sequence[str], where: str) -> tuple[str, float]:
    """Column and factor from text such as ``-2 * force``."""
    match = _FACTOR.fullmatch(str(expression))
    assert match is not None
    if match[3] not in known:
        raise ArgumentError(f"{where} has no column {match[3]!r}{nearest(match[3], known)}")
    try:
        factor = float(match[2] or 1)
    except ValueError:
        factor = math.nan
    if not 0 < factor < math.inf:
        raise ArgumentError(f"{where}: not a factor, given {match[2]!r}")
    return match[3], -factor if match[1] else factor


def _number_columns(
    known: Sequence[str],
    problem: Problem,
    sources: dict[str, tuple[str, float]],
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
        numbers, theirs = zip(*sorted(columns), strict=True)
        # From 0 or from 1 on: others are not all that there are, or of two parts.
        whole = [number - numbers[0] for number in numbers] == list(range(len(names)))
        if whole and numbers[0] < 2 and not set(wanted) & sources.keys():
            sources |= {name: (column, 1.0) for name, column in zip(wanted, theirs, strict=True)}
            span = theirs[0] if len(theirs) == 1 else f"{theirs[0]} … {theirs[-1]}"
            notes.append(f"{span}: taken for {wanted[0]} … in the mechanism's order")


def _numbers(column: "pd.Series[Any]", what: str, where: str) -> Array:
    """(rows,) numbers of a column; NaN where it is empty, or says that there is none."""
    values = column.to_numpy()
    try:
        return np.asarray(values, object).astype(float)
    except (ValueError, TypeError):
        pass  # where some are empty, or words
    numbers = np.full(len(values), math.nan)
    for place, value in enumerate(values):
        text = str(value).strip()
        # "nan" is in all that C writes for numbers that are none, such as -nan(ind).
        if text and text != "None" and "nan" not in text.lower():
            try:
                numbers[place] = float(text)
            except ValueError:
                line = _line(place, where)
                raise ArgumentError(f"{what}, {line}: not a number, given {text!r}") from None
    return numbers


def _line(place: int, where: str) -> str:
    """What a row of a table is called."""
    return f"line {place + 2}" if where.endswith(".csv") else f"row {place + 1}"


def _refuse_rows(table: "pd.DataFrame", abscissa: str, where: str, t0: float) -> None:
    """Refuse sizes and times out of range, and times that occur twice."""
    for name, bad, wanted in (
        (abscissa, table[abscissa] <= 0, "positive"),
        ("t", table["t"] < min(t0, 0.0), f"a time, at least {min(t0, 0.0):g}"),
    ):
        wrong = np.asarray(bad | ~np.isfinite(table[name]))
        if wrong.any():
            at = int(np.argmax(wrong))
            raise ArgumentError(
                f"{where}, {_line(at, where)}: {name} must be {wanted}, "
                f"given {table[name].iloc[at]:g}"
            )
    again = table.duplicated(["series", abscissa, "twin", "t"])
    if again.any():
        row = table[again].iloc[0]
        raise ArgumentError(
            f"{where}: series {row['series']}, {abscissa} = {row[abscissa]:g}: t = {row['t']:g} is "
            "there twice; give each run a label in the column series, or twins their number in the "
            "column twin"
        )


def _abscissa(columns: Collection[str], has: str, where: str) -> str:
    """The column of sizes; there must be one of times, too."""
    abscissa = next((name for name in ABSCISSAS if name in columns), None)
    if abscissa is None or "t" not in columns:
        lacking = "t" if abscissa else "h, tolerance or steps"
        raise ArgumentError(f"{where}: needs a column {lacking}{has}")
    return abscissa


def _most_digits(frame: "pd.DataFrame") -> int:
    """Most significant digits of numbers that are text."""
    texts = (text for text in frame.to_numpy().flat if isinstance(text, str))
    return max(map(_digits, texts), default=0)


def _digits(text: Any) -> int:
    """Digits that a number is written with."""
    mantissa = re.sub(r"[eE].*", "", str(text)).strip().lstrip("+-0.")
    return len(mantissa.replace(".", ""))


def _is_single(numbers: Array) -> bool:
    """Whether all are numbers of single precision; zeros and ones are of any."""
    telling = numbers[np.isfinite(numbers)]
    telling = telling[telling != np.round(telling, 3)]
    with np.errstate(over="ignore"):
        return bool(len(telling)) and bool(np.all(telling == telling.astype(np.float32)))


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
