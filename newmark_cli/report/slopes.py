"""Fitted slopes beside predicted orders, with verdicts: what `check` asserts.

One `Slope` for each series in the CSVs: the rows of one study that differ in
the step size alone.  Predictions come from exponent arithmetic
(`newmark_cli.newmark.orders`), never from a table of expected numbers.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.orders import FormOrders, form_orders
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.report.figures import FIGURES, OrderFigure
from newmark_cli.report.fits import Fit, power_law
from newmark_cli.report.table import read_study, study_files
from newmark_cli.study import results
from newmark_cli.study.results import ResultsError

#: Columns of ``slopes.csv``; a new one is appended.
COLUMNS = (
    "figure", "study", "form", "preconditioning", "quantity", "measure", "slope", "stderr",
    "points", "expected", "tolerance", "verdict", "problem", "integrator",
)  # fmt: skip

PASS, MISS, INCOMPLETE = "pass", "miss", "incomplete"

#: Statistic over the steps that is drawn and fitted.
STATISTIC = {"correction": "rms", "physical_correction": "rms", "condition": "median"}

#: Largest |fitted − predicted| where no figure sets its own.  Condition numbers
#: are not noisy; along a run they still vary with the motion.
_TOLERANCE = {"correction": 0.15, "physical_correction": 0.15, "condition": 0.05}
_TOLERANCE_AT_START = {"condition": 0.02}

_SERIES = (
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
    "linear_solver", "quantity", "measure", "role",
)  # fmt: skip


@dataclass(frozen=True)
class Slope:
    """A series with its fit and what theory says.

    Attributes:
        figures: Numbers of the figures that draw it.
        study, problem, integrator, form, preconditioning, quantity, measure, role:
            As in the CSV.
        h: (points,) step sizes.
        values: (points,) the statistic that is drawn.
        fit: Power law through them.
        expected: Predicted order.
        tolerance: Largest |fit.slope − expected|.
        verdict: pass, miss, or incomplete (a cell is not ok, or has no value).
    """

    figures: tuple[int, ...]
    study: str
    problem: str
    integrator: str
    form: str
    preconditioning: str
    quantity: str
    measure: str
    role: str
    h: Array
    values: Array
    fit: Fit
    expected: float
    tolerance: float
    verdict: str

    def row(self) -> dict[str, Any]:
        """Row of ``slopes.csv``."""
        return {
            "figure": " ".join(str(number) for number in self.figures),
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
    found = []
    failed = frame["measure"] == ""
    for _, rows in frame[~failed].groupby([*_SERIES, frame["steps"] == 0], sort=False):
        first = {column: str(rows[column].iloc[0]) for column in _SERIES}
        found.append(_slope(first, rows, path))
    for _, rows in frame[failed].groupby(["problem", "form", "preconditioning"], sort=False):
        # A cell that failed measured nothing; every series of its form is incomplete.
        first = {column: str(rows[column].iloc[0]) for column in _SERIES}
        found = [_incomplete(slope) if _same_cell(slope, first) else slope for slope in found]
    return found


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write ``slopes.csv``: series of the figures first."""
    ordered = sorted(slopes, key=lambda slope: (not slope.figures, slope.figures))
    text = results.csv_text(COLUMNS, (slope.row() for slope in ordered))
    results.write_atomically(folder / "slopes.csv", text)


def _slope(first: dict[str, str], rows: pd.DataFrame, path: Path) -> Slope:
    measure = first["measure"]
    if measure not in STATISTIC:
        raise ResultsError(f"{path}: unknown measure {measure!r}; is it from a newer version?")
    at_start = bool(rows["steps"].iloc[0] == 0)
    h = rows["h"].to_numpy(float)
    values = rows[STATISTIC[measure]].to_numpy(float)
    fit = power_law(h, values)
    figures = [
        figure
        for figure in FIGURES.values()
        if isinstance(figure, OrderFigure)
        and (figure.study, figure.problem, figure.form, figure.quantity, figure.measure)
        == (first["study"], first["problem"], first["form"], first["quantity"], measure)
        and first["preconditioning"] in figure.variants
    ]
    default = (_TOLERANCE_AT_START if at_start else _TOLERANCE)[measure]
    tolerance = min([figure.tolerance for figure in figures], default=default)
    expected = _predicted(first, path)
    complete = bool((rows["status"] == "ok").all()) and fit.points == len(rows) >= 2
    within = abs(fit.slope - expected) <= tolerance
    return Slope(
        figures=tuple(figure.number for figure in figures),
        **{column: first[column] for column in _SERIES[:5]},
        quantity=first["quantity"],
        measure=measure,
        role=first["role"],
        h=h,
        values=values,
        fit=fit,
        expected=expected,
        tolerance=tolerance,
        verdict=(PASS if within else MISS) if complete else INCOMPLETE,
    )


def _predicted(first: dict[str, str], path: Path) -> float:
    form, quantity = first["form"], first["quantity"]
    try:
        if form not in FORMS:
            raise ResultsError(f"unknown form {form!r}")
        orders = _orders(form)
        scaling = Preconditioning.parse(first["preconditioning"]).scaling(FORMS[form])
        if first["measure"] == "condition":
            return orders.condition(scaling)
        if first["measure"] == "correction":
            return orders.corrections(scaling)[quantity]
        return orders.physical_corrections()[quantity]
    except (InputError, KeyError) as error:
        raise ResultsError(f"{path}: {form}, {quantity}: no prediction: {error}") from None


@cache
def _orders(form: str) -> FormOrders:
    return form_orders(FORMS[form])


def _same_cell(slope: Slope, first: dict[str, str]) -> bool:
    return all(
        getattr(slope, key) == first[key] for key in ("study", "problem", "form", "preconditioning")
    )


def _incomplete(slope: Slope) -> Slope:
    return Slope(**{**vars(slope), "verdict": INCOMPLETE})


def format_fit(fit: Fit) -> str:
    """Slope ± standard error: two decimals, three where the error asks for them."""
    if np.isnan(fit.slope):
        return "n/a"
    decimals = 3 if fit.stderr < 0.005 else 2
    slope = f"{round(fit.slope, decimals) + 0.0:.{decimals}f}".replace("-", "−")
    return slope if np.isnan(fit.stderr) else f"{slope} ± {fit.stderr:.{decimals}f}"


def format_order(value: float) -> str:
    """A predicted order: a whole number with a true minus sign."""
    return f"{value + 0:g}".replace("-", "−")
