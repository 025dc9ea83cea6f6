"""Fitted slopes beside predicted orders, with verdicts: what `check` asserts.

One `Slope` for each series in the CSVs: the rows of one study that differ in
the step size alone.  Predictions come from exponent arithmetic
(`newmark_cli.newmark.orders`) and from the order of the integrator, never from a
table of expected numbers.  Where theory predicts none, the series is shown.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.newmark import integrator
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.orders import UNKNOWNS, FormOrders, form_orders
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.report.curves import KEY, key_of
from newmark_cli.report.figures import FIGURES
from newmark_cli.report.fits import Fit, power_law
from newmark_cli.report.verdicts import INCOMPLETE, MISS, PASS, SHOWN
from newmark_cli.spelling import nearest
from newmark_cli.study import results
from newmark_cli.study.reading import SERIES, accepted_statuses, read_study, study_files
from newmark_cli.study.results import ResultsError

#: Columns of ``slopes.csv``; a new one is appended.
COLUMNS = (
    "figure", "study", "form", "preconditioning", "quantity", "measure", "slope", "stderr",
    "points", "expected", "tolerance", "verdict", "problem", "integrator", "row_block",
    "evaluation", "precision", "linear_solver", "stop",
)  # fmt: skip

#: Column that is drawn and fitted; of `tolerance` as a share of the steps.
STATISTIC = {
    "correction": "rms",
    "physical_correction": "rms",
    "condition": "median",
    "sensitivity": "median",
    "error": "last",
    "invariant": "max",
    "krylov_iterations": "median",
    "krylov_residual": "max",
    "tolerance": "met",
    "history": "max",
}

_CORRECTIONS = ("correction", "physical_correction")

#: Largest |fitted − predicted| where no figure sets its own.  Condition numbers
#: are not noisy; along a run they still vary with the motion.
_TOLERANCE = {
    "correction": 0.15,
    "physical_correction": 0.15,
    "condition": 0.05,
    "sensitivity": 0.15,
    "error": 0.2,
}
_TOLERANCE_AT_START = {"condition": 0.02, "sensitivity": 0.05}


@dataclass(frozen=True, eq=False)
class Slope:
    """A series with its fit and what theory says.

    Attributes:
        figures: Figures that draw it.
        study, problem, integrator, form, preconditioning, evaluation, precision,
        linear_solver, quantity, measure, role, row_block, stop: As in the CSV.
        h: (points,) step sizes.
        values: (points,) the statistic that is drawn; where a Krylov solver
            stagnated, the number of iterations that it was allowed.
        statuses: Status of the cell behind each point.
        fitted: (points,) which of them the fit is for: of an error those above
            the rounding floor, of all else every one.
        fit: Power law through them.
        expected: Predicted order; NaN where theory says nothing.
        tolerance: Largest |fit.slope − expected|; NaN likewise.
        verdict: pass, miss, incomplete (a cell is not ok, or has no value), or shown.
    """

    figures: tuple[str, ...]
    study: str
    problem: str
    integrator: str
    form: str
    preconditioning: str
    evaluation: str
    precision: str
    linear_solver: str
    quantity: str
    measure: str
    role: str
    row_block: str
    stop: str
    h: Array
    values: Array
    statuses: tuple[str, ...]
    fitted: Array
    fit: Fit
    expected: float
    tolerance: float
    verdict: str

    @property
    def key(self) -> tuple[str, ...]:
        """What a `Curve` finds it by."""
        return tuple(getattr(self, column) for column in KEY)

    def row(self) -> dict[str, Any]:
        """Row of ``slopes.csv``."""
        return {
            "figure": " ".join(self.figures),
            "slope": self.fit.slope,
            "stderr": self.fit.stderr,
            "points": self.fit.points,
        } | {column: getattr(self, column) for column in COLUMNS if hasattr(self, column)}


def collect(folder: Path, studies: Iterable[str] | None = None) -> list[Slope]:
    """Slopes of every series in a results folder.

    Args:
        folder: Results folder.
        studies: Names of studies to read; all when omitted.

    Raises:
        ResultsError: When a CSV is missing or cannot be used.
    """
    if studies is None:
        files = study_files(folder)
    else:
        files = [folder / f"{name}.csv" for name in studies]
        for file in files:
            if not file.exists():
                raise ResultsError(f"{file}: no results; run 'newmark-study run {file.stem}' first")
    return [slope for file in files for slope in study_slopes(read_study(file), file)]


def study_slopes(frame: pd.DataFrame, path: Path) -> list[Slope]:
    """Slopes of one study's rows, in their order.

    Args:
        frame: Rows as `read_study` gives them.
        path: How errors name the file.
    """
    # A form, a variant or a quantity that lacks step sizes which others of the same
    # problem have was cut off; cases may differ in the rest on purpose.
    alike = ["problem", "integrator", "evaluation", "precision", "linear_solver", "measure", "stop"]
    at_start = frame["steps"] == 0
    most = frame.groupby([*alike, at_start])["h"].transform("nunique")
    accepted = ("ok", *accepted_statuses(path))
    found = []
    for _, rows in frame.groupby([*SERIES, at_start], sort=False):
        first = {column: str(rows[column].iloc[0]) for column in SERIES}
        if first["measure"]:
            found.append(_slope(first, rows, int(most[rows.index[0]]), accepted, path))
        elif not rows["status"].isin(accepted).all():
            found.append(_failed(first))
    return found


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write ``slopes.csv``: series of the figures first."""
    rest = sorted((s for s in slopes if not s.figures), key=lambda slope: slope.study)
    ordered = in_figure_order(slopes) + rest
    text = results.csv_text(COLUMNS, (slope.row() for slope in ordered))
    results.write_atomically(folder / "slopes.csv", text)


def in_figure_order(slopes: Iterable[Slope]) -> list[Slope]:
    """Slopes that a figure draws, in the order of the figures."""
    names = list(FIGURES)
    drawn = [slope for slope in slopes if slope.figures]
    return sorted(drawn, key=lambda slope: names.index(slope.figures[0]))


@cache
def _drawing(figures: tuple[str, ...]) -> Mapping[tuple[str, ...], list[str]]:
    """Key of a series → names of the figures that draw it."""
    names: dict[tuple[str, ...], list[str]] = {}
    for name in figures:
        for curve in FIGURES[name].curves:
            names.setdefault(curve.key, []).append(name)
    return names


def _slope(
    first: dict[str, str], rows: pd.DataFrame, points: int, accepted: Sequence[str], path: Path
) -> Slope:
    measure = first["measure"]
    if measure not in STATISTIC:
        raise ResultsError(f"{path}: unknown measure {measure!r}; is it from a newer version?")
    h = rows["h"].to_numpy(float)
    values = drawn(measure, rows)
    figures = tuple(_drawing(tuple(FIGURES)).get(key_of(first), ()))
    expected = _predicted(first, path)
    fitted = np.full(len(h), True)
    if measure == "error":
        fitted = h >= h[np.argmin(np.where(np.isfinite(values), values, np.inf))]
        points = int(np.count_nonzero(fitted))
        if points < 3:
            expected = np.nan
    statuses = tuple(rows["status"])
    if not set(statuses) <= {"ok"} and set(statuses) <= set(accepted):
        expected = np.nan  # a cell that was expected to end like this measured something else
    fit = power_law(h[fitted], values[fitted])
    tolerance, verdict = np.nan, SHOWN
    if not np.isnan(expected):
        tolerance = _tolerance(measure, bool(rows["steps"].iloc[0] == 0), figures)
        # An exact zero at every h is within any order: a block that this problem lacks.
        absent = measure == "sensitivity" and bool((values == 0).all())
        usable = absent or fit.points == points >= 2
        within = absent or abs(fit.slope - expected) <= tolerance
        complete = set(statuses) == {"ok"} and usable
        verdict = (PASS if within else MISS) if complete else INCOMPLETE
    return Slope(
        figures=figures,
        **_described(first),
        h=h,
        values=values,
        statuses=statuses,
        fitted=fitted,
        fit=fit,
        expected=expected,
        tolerance=tolerance,
        verdict=verdict,
    )


def drawn(measure: str, rows: pd.DataFrame) -> Array:
    """Values of a measure as they are drawn and fitted, one for each row of a study's CSV."""
    values = rows[STATISTIC[measure]].to_numpy(float)
    if measure == "tolerance":
        return np.asarray(values / rows["steps"].to_numpy(float))
    if measure == "krylov_iterations":
        return np.asarray(np.where(rows["status"] == "stagnated", rows["max"], values))
    return values


def _tolerance(measure: str, at_start: bool, figures: Sequence[str]) -> float:
    """The strictest of the figures that draw a series, else that of its measure."""
    own = [t for name in figures if (t := FIGURES[name].tolerance) is not None]
    default = _TOLERANCE_AT_START.get(measure) if at_start else None
    return min(own, default=default or _TOLERANCE[measure])


def _described(first: dict[str, str]) -> dict[str, str]:
    """Columns that a `Slope` carries."""
    return {column: first[column] for column in SERIES if column in Slope.__dataclass_fields__}


def _failed(first: dict[str, str]) -> Slope:
    """A cell that failed measured nothing: an incomplete series without a name."""
    return Slope(
        figures=(),
        **_described(first),
        h=np.array([]),
        values=np.array([]),
        statuses=(),
        fitted=np.array([], bool),
        fit=power_law(np.array([]), np.array([])),
        expected=np.nan,
        tolerance=np.nan,
        verdict=INCOMPLETE,
    )


def _predicted(first: dict[str, str], path: Path) -> float:
    """Order by theory; NaN where it says nothing."""
    form, quantity, measure = first["form"], first["quantity"], first["measure"]
    try:
        method = integrator.parse(first["integrator"])
        if form not in FORMS:
            raise ResultsError(f"unknown form {form!r}{nearest(form, FORMS)}")
        if measure in _TOLERANCE and quantity not in (*UNKNOWNS, "jacobian"):
            raise ResultsError(f"unknown quantity {quantity!r}{nearest(quantity, UNKNOWNS)}")
        if measure not in _TOLERANCE:
            return np.nan
        if measure == "error":
            # Without damping an odd–even mode of λ is left as rounding has fed it.
            return float(method.order) if quantity != "lambda" or method.damped else np.nan
        if measure in _CORRECTIONS and first["stop"] != "saturation":
            return np.nan
        orders = _orders(form, first["evaluation"] == "compensated")
        scaling = Preconditioning.parse(first["preconditioning"]).scaling(FORMS[form])
        if measure == "condition":
            return orders.condition(scaling)
        if measure == "sensitivity":
            row = FORMS[form].rows.index(first["row_block"])
            return float(orders.scaled(scaling)[1][FORMS[form].unknowns.index(quantity), row])
        if measure == "correction":
            return orders.corrections(scaling)[quantity]
        return orders.physical_corrections()[quantity]
    except (InputError, KeyError, ValueError) as error:
        raise ResultsError(f"{path}: {form}, {quantity}: no prediction: {error}") from None


@cache
def _orders(form: str, compensated: bool) -> FormOrders:
    return form_orders(FORMS[form], compensated=compensated)
