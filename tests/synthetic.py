"""CSVs of the studies past the paper as they should be, made from a few numbers."""

import numpy as np

from newmark_cli.newmark.forms import FORMS
from newmark_cli.report.reading.figures import FIGURES, Curve
from newmark_cli.study import csv_files
from newmark_cli.study.axes import series_axes
from newmark_cli.support import files

#: Figures that claims are about.
CLAIMING = [FIGURES[name] for name in ("10", "11", "12", "13", "14", "15", "16", "18")]

DAMPED = "generalized-alpha rho=0.9"

#: Error of λ of Andrews' mechanism at t = 0.03 by integrator and evaluation.
ERROR = {
    ("newmark beta=0.25 gamma=0.5", "direct"): {1e-4: 1.4, 1e-5: 0.3, 1e-6: 9e2, 1e-7: 2e6},
    ("newmark beta=0.25 gamma=0.5", "compensated"): {1e-4: 1.4, 1e-5: 2e-2, 1e-6: 0.3, 1e-7: 60.0},
    (DAMPED, "direct"): {1e-4: 4.4e-3, 1e-5: 5.0e-5, 1e-6: 5.9e-7, 1e-7: 1.7e-5},
    (DAMPED, "compensated"): {1e-4: 4.4e-3, 1e-5: 5.0e-5, 1e-6: 5.0e-7, 1e-7: 5.1e-9},
}

#: What rounding changes in it, over h².
ROUNDING = {
    ("newmark beta=0.25 gamma=0.5", "direct"): 1e-9,
    ("newmark beta=0.25 gamma=0.5", "compensated"): 1e-14,
    (DAMPED, "direct"): 1e-19,
    (DAMPED, "compensated"): 1e-25,
}

#: Most iterations that the Krylov solver is allowed.
LIMIT = 600


def _multipliers(curve):
    order = -1 if curve.evaluation == "compensated" else -2
    at_largest = 3.5e-11 if curve.evaluation == "compensated" else 5e-9
    return {h: {"rms": at_largest * (h / 1e-4) ** order} for h in (1e-4, 1e-5, 1e-6, 1e-7)}


def _error(curve):
    found = ERROR[curve.integrator, curve.evaluation]
    if curve.preconditioning != "optimal":
        found = {1e-6: {"none": 3e3, "left": 4e2, "right": 1.2e3}[curve.preconditioning]}
    statistics = ("rms", "max", "median", "last")
    rounding = ROUNDING[curve.integrator, curve.evaluation]
    return {
        h: dict.fromkeys(statistics, value) | {"rounding": rounding * h**-2}
        for h, value in found.items()
    }


def _tolerance(curve):
    share = dict.fromkeys((1e-4, 1e-5, 1e-6, 1e-7), 1.0)
    if curve.preconditioning in ("none", "left"):
        share = {1e-4: 0.99, 1e-5: 0.02, 1e-6: 0.0, 1e-7: 0.0}
    return {
        h: {
            "steps": 1000,
            "met": round(1000 * part),
            "not_converged": 1000 - round(1000 * part),
            "status": "ok" if part == 1 else "not_converged",
        }
        for h, part in share.items()
    }


def _krylov(curve):
    medians = {
        "none": {1e-2: 588, 1e-3: None, 1e-4: None, 1e-5: None},
        "left": {1e-2: 410, 1e-3: 560, 1e-4: None, 1e-5: None},
        "right": {1e-2: 300, 1e-3: 340, 1e-4: 380, 1e-5: None},
        "optimal": {1e-2: 89, 1e-3: 80, 1e-4: 79, 1e-5: 79},
    }[curve.preconditioning]
    return {
        h: {"median": median, "max": median + 5, "status": "ok"}
        if median
        else {"median": 590, "max": LIMIT, "status": "stagnated"}
        for h, median in medians.items()
    }


def _precision(curve):
    order = {"u": 0, "v": -1, "a": -2, "lambda": -2}[curve.quantity]
    order = order if curve.preconditioning in ("none", "left") else 0
    unit = 2**-24 if curve.precision == "float32" else 2**-53
    own = 1 + 0.2 * len(curve.preconditioning)
    return {h: {"rms": 0.3 * own * unit * h**order} for h in (1e-1, 1e-2, 1e-3)}


def _history(curve):
    largest = 1.2e8 if (curve.integrator, curve.evaluation) != (DAMPED, "direct") else 9.9e4
    return {1e-6: {"max": 9.97e4 if curve.evaluation == "compensated" else largest}}


def _cures(curve):
    """Order 2 in λ and u, but for what nothing cures with the trapezoidal rule."""
    steps = [1e-4, 1e-5, 1e-6] if curve.problem == "andrews" else [1e-3, 3e-4, 1e-4]
    found = {
        h: (2e-8 if curve.problem == "andrews" else 1e-6) * (h / steps[-1]) ** 2 for h in steps
    }
    usual = (curve.formulation, curve.projection, curve.multipliers, curve.start)
    if usual == ("index-3", "none", "newton", "consistent") and curve.integrator != DAMPED:
        wrong = [1.4, 0.3, 3e2] if curve.problem == "andrews" else [52.0, 52.0, 52.0]
        found = dict(zip(steps, wrong, strict=True))
    statistics = ("rms", "max", "median", "last")
    return {h: dict.fromkeys(statistics, value) for h, value in found.items()}


def _drift(curve):
    """Rounding of what a formulation enforces, and a drift of the rest."""
    held = {"index-3": ["position"], "index-2": ["velocity"], "ggl": ["position", "velocity"]}
    kept = curve.quantity in held.get(curve.formulation, [])
    kept |= curve.projection == "velocity"
    h = 1e-5 if curve.problem == "andrews" else 1e-3
    return {h: {"max": 1e-15 if kept else 1e-6}}


_POINTS = {
    "cures": _cures,
    "drift": _drift,
    "multipliers": _multipliers,
    "error": _error,
    "tolerance": _tolerance,
    "krylov": _krylov,
    "precision": _precision,
    "history": _history,
}


def row(value="", **columns):
    """Row of a study `own`: every statistic is the value, and the rest as usual."""
    return (
        dict.fromkeys(csv_files.COLUMNS, "")
        | {axis.name: axis.usual for axis in series_axes() if axis.usual and axis.column}
        | {
            "study": "own", "problem": "andrews", "integrator": "newmark beta=0.25 gamma=0.5",
            "form": "u-lambda", "preconditioning": "none", "linear_solver": "dense-lu",
            "t_end": 1.0, "steps": 1000, "quantity": "lambda", "measure": "correction",
            "role": "primary", "zeros": 0, "not_converged": 0, "newton_iterations": 4.0,
            "status": "ok",
        }
        | dict.fromkeys(("rms", "max", "median", "last"), value)
        | columns
    )  # fmt: skip


def rows_of(curve):
    """Rows of one series: the study's CSV with numbers that its claims hold for."""
    labels = {name: of for name, of in curve.key.named().items() if name in csv_files.COLUMNS}
    return [
        row(**labels, h=h) | {"t_end": 0.03, "steps": 30} | given
        for h, given in _POINTS[curve.study](curve).items()
    ]


def curves(figure):
    """What a figure draws; claims about precisions are about every form, those about cures about
    all that figures draw of their errors.
    """
    if figure.study == "cures":
        return [curve for name in ("16", "24", "25") for curve in FIGURES[name].curves]
    if figure.study != "precision":
        return list(figure.curves)
    return [
        Curve("", **curve.key.named() | {"form": form, "quantity": unknown})
        for curve in figure.curves
        if curve.quantity == "u"
        for form in FORMS
        for unknown in FORMS[form].unknowns
    ]


def rows(figure):
    """Rows of the study of a figure."""
    return [row for curve in curves(figure) for row in rows_of(curve)]


def write(folder, figure, table=None):
    """Write the study of a figure, or other rows in its place."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{figure.study}.csv"
    path.write_text(csv_files.csv_text(csv_files.COLUMNS, rows(figure) if table is None else table))
    return path


def multipliers(curve):
    """Times (s) and two multipliers (N/m); the trapezoidal rule's second one alternates."""
    t = 1e-6 * np.arange(100, 30_100, 100).repeat(2) + np.tile([0, 1e-6], 300)
    found = np.column_stack([10 * np.cos(200 * t), 5e4 * np.sin(300 * t)])
    if (curve.integrator, curve.evaluation) != (DAMPED, "direct"):
        small = 1e-4 if curve.evaluation == "compensated" else 1
        found[:, 1] += small * np.tile([-1, 1], 300) * 1e-3 * np.exp(1000 * t)
    return t, found


def write_history(folder, figure):
    """Write the time series of a figure; returns the file."""
    table = []
    for curve in figure.curves:
        t, found = multipliers(curve)
        for when, values in zip(t, found, strict=True):
            row = {column: getattr(curve, column, "") for column in csv_files.HISTORY_COLUMNS}
            row |= {"h": figure.h, "step": round(when / figure.h), "t": float(when)}
            table.append(row | {"lambda[a]": float(values[0]), "lambda[b]": float(values[1])})
    columns = (*csv_files.HISTORY_COLUMNS, "lambda[a]", "lambda[b]")
    path = csv_files.trajectory_path(folder, figure.study)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write(path, csv_files.csv_text(columns, table))
    return path


def drifts(curve):
    """Times (s), and misfits (2,) of the constraints and of their rate."""
    t = np.linspace(0.01, 0.1, 10)
    each = [curve.integrator, curve.formulation, curve.projection]
    size = {"index-3": 1e-17, "ggl": 1e-17}.get(each[1], 1e-8) * (2 if each[2] != "none" else 1)
    return t, np.column_stack([size * t, 1e3 * size * t])


def write_drifts(folder, figure, steps):
    """Write the drifts of a figure, h of each problem from `steps`; returns the file."""
    may_have = ("formulation", "projection", "multipliers")
    columns = (*csv_files.HISTORY_COLUMNS, *may_have, "drift[position]", "drift[velocity]")
    table = []
    for curve in figure.curves:
        if curve.quantity != "position":
            continue
        for step, (when, values) in enumerate(zip(*drifts(curve), strict=True), 1):
            row = {column: getattr(curve, column, "") for column in columns[:-2]}
            row |= {"h": steps[curve.problem], "step": step, "t": float(when)}
            named = {"drift[position]": float(values[0]), "drift[velocity]": float(values[1])}
            table.append(row | named)
    path = csv_files.trajectory_path(folder, figure.study)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write(path, csv_files.csv_text(columns, table))
    return path


def spoilt(table, where, change):
    """Rows with those that agree with `where` changed by a function of a row."""
    table = [dict(row) for row in table]
    for row in table:
        if all(row[column] == value for column, value in where.items()):
            row.update(change(row))
    return table
