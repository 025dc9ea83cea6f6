"""Runs of another code, from the table that it wrote.

A row is the state of one run at one time.  Columns are named as in `Trajectory.to_frame`:
``u[A.x]``, ``v[A.x]``, ``lambda[bars.rod]``, ``output[O.force.x]``; a mapping names others.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from newmark_cli.codes import table_files
from newmark_cli.codes.formulas import Formula, column, formula
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, shown
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import closest, nearest

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
#: A unit behind a name, and those that are no SI units but are taken for what they are.
_UNIT = re.compile(r"(.+?)\s*[\[(]([^\[\]()]*)[\])]")
_UNITS = {"mm": 1e-3, "mm/s": 1e-3, "cm": 1e-2, "cm/s": 1e-2, "ms": 1e-3, "us": 1e-6, "µs": 1e-6,
          "deg": math.pi / 180, "deg/s": math.pi / 180}  # fmt: skip
#: What may help where a table lacks columns.
_HELP = '; --columns FILE says which are meant, such as "t: \'#1\'", the first, or "h: 0.002"'
#: Times that differ by less, over their size, are the same.
SAME_TIME = 1e-11
#: Name of a series that the table does not name.
UNNAMED = "your code"


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
    notes: Sequence[str]  #: what was taken for granted, in sentences
    differs: bool = False  #: whether units, signs or an order of columns were undone


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
        source: A DataFrame, or the path of a file that `table_files.table` reads.
        problem: What was solved.
        columns: Column of this tool → formula of the table's columns, see `formulas.formula`:
            ``{"lambda[bars.rod]": "-2 * force", "h": 0.002}``.

    Raises:
        ArgumentError: When the table cannot be used; names the column or line.
    """
    import pandas as pd

    mapping, notes = dict(columns or {}), list[str]()
    frame, where = table_files.table(source, mapping)
    taken, numbers = columns_of(frame, where, problem, mapping, notes)
    has = f"; has {some(frame.columns)}{_HELP}"
    abscissa = next((name for name in ABSCISSAS if name in numbers), "")
    if not abscissa or "t" not in numbers:
        lacking = "t" if abscissa else "h, tolerance or steps"
        raise ArgumentError(f"{where}: needs a column {lacking}{has}")
    ours = {part: [f"{part}[{name}]" for name in names]
            for part, names in names_of(problem).items()}  # fmt: skip
    present = {part: [name for name in names if name in numbers] for part, names in ours.items()}
    if not any(present.values()):
        wanted = ", ".join(names[0] for names in ours.values() if names)
        raise ArgumentError(f"{where}: no column of {problem.name}, such as {wanted}{has}")
    table = pd.DataFrame({"series": UNNAMED, "twin": 0.0, **numbers}, index=frame.index)
    for name in TEXTS:
        if name in taken:
            table[name] = frame[taken[name].columns[0]].fillna("").astype(str)
    _refuse_rows(table, abscissa, where, problem.t0)
    if not (table["t"] > problem.t0).any():
        raise ArgumentError(f"{where}: only starts: add rows that your code has computed")
    return Runs(
        _runs(table, abscissa, problem, ours, present),
        TOLERANCE if abscissa == TOLERANCE else STEP_SIZE,
        notes,
    )


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


def columns_of(
    frame: "pd.DataFrame",
    where: str,
    problem: Problem,
    mapping: Mapping[str, Any],
    notes: list[str],
    further: Collection[str] = (),
) -> tuple[dict[str, Formula], dict[str, Array]]:
    """Columns of this tool in those of a table, and their numbers (rows,); NaN where it has none.

    Args:
        frame, where: The table, and what errors call it.
        problem, mapping: As of `read`.
        notes: Takes what is taken for granted.
        further: Columns of this tool that are looked for besides those of `read`.

    Raises:
        ArgumentError: When the mapping cannot be used, or a column that must be meant for one of
            the problem is none.
    """
    known = [*frame.columns]
    ours = [f"{part}[{name}]" for part, names in names_of(problem).items() for name in names]
    allowed = (*NUMBERS, *TEXTS, *ours, *further)
    taken: dict[str, Formula] = {}
    for name, text in mapping.items():
        if name not in allowed:
            raise ArgumentError(f"columns: unknown {shown(name)}{nearest(name, allowed)}")
        taken[name] = formula(text, known, f"columns: {name}: {where}")
        if name in TEXTS and not taken[name].is_plain:
            raise ArgumentError(f"columns: {name}: must be a column, given {shown(text)}")
    ignored = set()
    for theirs in known:
        name, factor = _without_unit(theirs, allowed)
        if name in mapping:
            ignored.add(theirs)
        elif name in taken:
            raise ArgumentError(f"{where}: column {name} is there twice, as {theirs}, too")
        elif name in allowed or CORRECTIONS.fullmatch(name):
            taken[name] = column(theirs, factor)
            if name != theirs:
                times = f", times {factor:g}" if factor != 1 else ""
                notes.append(f"{theirs}: taken for {name}{times}")
    _number_columns(known, problem, taken, notes)
    used = set(chain(*(formula.columns for formula in taken.values())))
    left = [name for name in known if name not in used and not name.startswith("a[")]
    for name in left:
        if name not in ignored and _is_meant(name, ours, taken):
            raise ArgumentError(f"{where}: {problem.name} has no {name}{nearest(name, ours)}")
    if left:
        notes.append(f"not read: column {some(left)}")
    counted = {name: formula for name, formula in taken.items() if name not in TEXTS}
    used = set(chain(*(formula.columns for formula in counted.values())))
    values = {name: table_files.numbers(frame, name, where) for name in known if name in used}
    with np.errstate(all="ignore"):
        numbers = {name: np.full(len(frame), one.of(values)) for name, one in counted.items()}
    return taken, numbers


def _without_unit(name: str, allowed: Collection[str]) -> tuple[str, float]:
    """Name of a column without its unit in brackets, and what makes it an SI unit."""
    match = _UNIT.fullmatch(name)
    if name in allowed or match is None or match[1] not in allowed:
        return name, 1.0
    return match[1], _UNITS.get(match[2].strip(), 1.0)


def _is_meant(name: str, ours: Sequence[str], taken: Collection[str]) -> bool:
    """Whether a column must be meant for one of the problem: ``lamda[rod]``, ``old u[A.x]``."""
    if match := re.fullmatch(r"\s*([^\W\d_]+)\s*\[(.*)\]\s*", name):
        head, component = match[1], match[2]
        if head.casefold() in ("u", "v", "lambda", "output"):
            return True
        if head in _PARTS or closest(head, ("lambda", "output")):
            return closest(component, [one.partition("[")[2][:-1] for one in ours]) is not None
    missing = [one for one in ours if one not in taken]
    alike = [one for one in missing if one[0] == name[:1].casefold()]
    return any(one in name for one in missing) or closest(name, alike) is not None


def _number_columns(
    known: Sequence[str],
    problem: Problem,
    taken: dict[str, Formula],
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
        if whole and numbers[0] < 2 and not set(wanted) & taken.keys():
            taken |= {ours: column(one) for ours, one in zip(wanted, theirs, strict=True)}
            span = theirs[0] if len(theirs) == 1 else f"{theirs[0]} … {theirs[-1]}"
            notes.append(f"{span}: taken for {wanted[0]} … in the mechanism's order")


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
                f"{where}, {table_files.line(table, at)}: {name} must be {wanted}, "
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


def some(names: Iterable[Any]) -> str:
    """The first names of a list, in words."""
    every = [str(name) for name in names]
    return ", ".join(every[:6]) + (f" and {len(every) - 6} more" if len(every) > 6 else "")
