"""Runs of another code as cells of a study in memory, beside marches with the same method."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd

from newmark_cli.codes.evidence import printed
from newmark_cli.codes.reading import STEP_SIZE, Run, Runs
from newmark_cli.codes.solutions import Measured, Solutions, roundings
from newmark_cli.library.scalings import read
from newmark_cli.newmark.formulation import RECOVERED
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.newmark.statistics import Measurement
from newmark_cli.problems.problem import Problem
from newmark_cli.report.judging.slopes import Slope, study_slopes
from newmark_cli.report.judging.verdicts import MISS, NOT_CONVERGING, SHOWN
from newmark_cli.study import csv_files, replay
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Outcome
from newmark_cli.study.other_codes import USUAL as OF_CASES
from newmark_cli.support.errors import InputError

#: The method that a code is held against where nobody says which it has.
USUAL = {"integrator": "generalized-alpha rho=0.9", "formulation": "index-3"}
#: Twins of a march of this tool's; most steps of all of these, of a problem with one unknown;
#: and unknowns that make a step twice as long.
_TWINS, _MOST_STEPS, _UNKNOWNS = 3, 2_000_000, 5
#: Parts whose printing changes a quantity; what it leaves of it; and of 15 digits or more.
_OF = {"u": "u", "v": "v", "lambda": ("lambda",), "position": "u", "velocity": "uv",
       "multiplier": ("u", "v", "lambda")}  # fmt: skip
_PRINTED, _DIGITS = 3.0, 1e-15
#: Part of the time of a run within which others may end and be judged with it.
_SAME_END = 0.05


def method(options: Mapping[str, Any]) -> dict[str, str]:
    """Axis → value of a method, as CSVs have them.

    Raises:
        ArgumentError, IntegratorError, FormulationError: For what no method has.
    """
    labelled = ("integrator", "formulation", "projection")
    values = {
        name: read(name, value).label if name in labelled else str(value)
        for name, value in (USUAL | {k: v for k, v in options.items() if v}).items()
    }
    if values.get("projection", "none") != "none":
        values.setdefault("multipliers", RECOVERED)
    return values


def _cell(run: Run, problem: Problem, options: Mapping[str, Any]) -> Cell:
    """The cell that a run is: its method, step size and end."""
    how: dict[str, Any] = method({**options, **run.method})
    how |= {name: read(name, how[name]) for name in ("integrator", "formulation", "projection")
            if name in how}  # fmt: skip
    t_end = float(run.t[-1] - problem.t0)
    return Cell(
        problem=cast(Any, SimpleNamespace(label=problem.name, load=lambda: problem)),
        form=OF_CASES["form"],
        preconditioning=Preconditioning(OF_CASES["preconditioning"]),
        h=run.size,
        t_end=t_end,
        steps=max(1, round(t_end / run.size)),
        measure=("error", "invariant"),
        twins=_TWINS,
        **how,
    )


def measured(runs: Runs, motion: Solutions, options: Mapping[str, Any]) -> list[Measured]:
    """Every run that ended, twins aside, with its errors.

    Args:
        runs: The runs.
        motion: Solutions of the problem.
        options: Axis → value of their method where the table does not say it.
    """
    ended = [run for run in runs.runs if run.ended]
    first = [run for run in ended if run.twin == min(r.twin for r in ended if _same(r, run))]
    cells = {id(run): _cell(run, motion.problem, options) for run in first}
    left = _MOST_STEPS / (1 + (motion.problem.n + motion.problem.m) / _UNKNOWNS)
    ours: dict[int, list[Run]] = {}
    if runs.abscissa == STEP_SIZE:
        for run in sorted(first, key=lambda run: cells[id(run)].steps):
            left -= cells[id(run)].steps * (1 + _TWINS)
            if left < 0:
                break
            ours[id(run)] = _marched(cells[id(run)], run)
    found = []
    for run in first:
        cell, own, there = cells[id(run)], ours.get(id(run), []), motion.at(float(run.t[-1]))
        others = [r for r in ended if _same(r, run) and r is not run]
        of_run, of_ours = (
            replay.measured(cell, of, there, marches=lambda *_, own=own: own) if of else None
            for of in ([run, *others], own[:1])
        )
        assert of_run is not None
        found.append(Measured(run, _by_name(of_run), _by_name(of_ours) if of_ours else {}))
    return found


def _same(one: Run, other: Run) -> bool:
    return one.series == other.series and one.size == other.size


def _marched(cell: Cell, run: Run) -> list[Run]:
    """A march of this tool's with the method of a run, and its twins; none if it fails."""
    try:
        return replay.of_march(cell, run.t)
    except (InputError, np.linalg.LinAlgError):
        return []


def _by_name(outcome: Outcome) -> dict[tuple[str, str], Measurement]:
    return {(row.measure, row.quantity): row for row in outcome.measurements}


def slopes(
    measurements: Sequence[Measured], runs: Runs, motion: Solutions, options: Mapping[str, Any]
) -> list[Slope]:
    """Series of the runs, judged by the rule of `check`.

    Those of tolerances are only shown, and so are orders of a code whose method nobody says.
    """
    judged = []
    for label in dict.fromkeys(m.run.series for m in measurements):
        of = [m for m in measurements if m.run.series == label]
        said = {**options, **of[-1].run.method}
        frame = _frame(of, label, motion.problem, said)
        of_label = study_slopes(frame, Path(label), {}) if len(frame) else []
        if not said.get("integrator"):
            of_label = [_unexpected(slope) for slope in of_label]
        # Of constraints findings say what is wrong, and whether it is: another code may iterate to
        # another tolerance.
        judged += [
            shown(s, s.reason)
            if s.measure == "invariant" and s.verdict in (MISS, NOT_CONVERGING) else s
            for s in of_label
        ]  # fmt: skip
    if runs.abscissa != STEP_SIZE:
        judged = [shown(s) for s in judged]
    return judged


def _unexpected(slope: Slope) -> Slope:
    """A series of a method that nobody says, which may have any order."""
    if slope.measure == "error":
        slope = slope.judged(math.nan)
        if slope.verdict != SHOWN:
            return slope
    return shown(slope)


def shown(slope: Slope, reason: str = "") -> Slope:
    """A series that is measured, and held against no order."""
    return replace(slope, expected=math.nan, tolerance=math.nan, verdict=SHOWN, reason=reason)


def _frame(
    measurements: Sequence[Measured], label: str, problem: Problem, options: Mapping[str, Any]
) -> pd.DataFrame:
    """Rows of a series as the CSV of a study has them."""
    cells = [_cell(m.run, problem, options) for m in measurements]
    names = dict.fromkeys(name for m in measurements for name in m.errors)
    unsure = {name: _unsure(measurements, name, problem.t0) for name in names}
    outcomes = [
        Outcome(
            [replace(row, statistics=replace(row.statistics, rounding=unsure[name][m.run.size]))
             for name, row in m.errors.items()],
            0, np.nan, "ok",
        )
        for m in measurements
    ]  # fmt: skip
    rows = [row for row in csv_files.rows(label, cells, outcomes) if "measure" in row]
    frame = pd.DataFrame(rows, columns=csv_files.COLUMNS)
    for name in csv_files.NUMBERS:
        frame[name] = pd.to_numeric(frame[name])
    # Each is held against the solution at its own end: a step size need not divide the time.
    ends = frame["t_end"]
    if ends.max() - ends.min() <= _SAME_END * ends.max():
        frame["t_end"] = ends.median()
    return frame


def _unsure(
    measurements: Sequence[Measured], name: tuple[str, str], t0: float
) -> dict[float, float]:
    """Step size → rounding of a quantity: from larger ones where it was not measured.

    What is printed with few digits is rounded by as much.
    """
    of = [m for m in measurements if name in m.errors]
    parts = _OF.get(name[1], ())
    least = max((printed([m.run for m in of], part, t0) for part in parts), default=0.0)
    rounding = roundings(of, name)
    if least > _DIGITS:
        rounding = np.fmax(rounding, _PRINTED * least)
    return dict(zip((m.run.size for m in of), rounding.tolist(), strict=True))
