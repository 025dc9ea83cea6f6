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
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure, SensitivityFigure
from newmark_cli.report.fits import Fit, power_law
from newmark_cli.report.table import read_study, study_files
from newmark_cli.study import results
from newmark_cli.study.results import ResultsError

#: Columns of ``slopes.csv``; a new one is appended.
COLUMNS = (
    "figure", "study", "form", "preconditioning", "quantity", "measure", "slope", "stderr",
    "points", "expected", "tolerance", "verdict", "problem", "integrator", "row_block",
)  # fmt: skip

PASS, MISS, INCOMPLETE = "pass", "miss", "incomplete"

#: Statistic over the steps that is drawn and fitted.
STATISTIC = {
    "correction": "rms",
    "physical_correction": "rms",
    "condition": "median",
    "sensitivity": "median",
}

#: Largest |fitted − predicted| where no figure sets its own.  Condition numbers
#: are not noisy; along a run they still vary with the motion.
_TOLERANCE = {
    "correction": 0.15,
    "physical_correction": 0.15,
    "condition": 0.05,
    "sensitivity": 0.15,
}
_TOLERANCE_AT_START = {"condition": 0.02, "sensitivity": 0.05}

_SERIES = (
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
    "linear_solver", "quantity", "measure", "role", "row_block",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Slope:
    """A series with its fit and what theory says.

    Attributes:
        figures: Figures that draw it.
        study, problem, integrator, form, preconditioning, quantity, measure, role,
        row_block: As in the CSV.
        h: (points,) step sizes.
        values: (points,) the statistic that is drawn.
        fit: Power law through them.
        expected: Predicted order.
        tolerance: Largest |fit.slope − expected|.
        verdict: pass, miss, or incomplete (a cell is not ok, or has no value).
    """

    figures: tuple[str, ...]
    study: str
    problem: str
    integrator: str
    form: str
    preconditioning: str
    quantity: str
    measure: str
    role: str
    row_block: str
    h: Array
    values: Array
    fit: Fit
    expected: float
    tolerance: float
    verdict: str

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
    ordered = in_figure_order(slopes) + [slope for slope in slopes if not slope.figures]
    text = results.csv_text(COLUMNS, (slope.row() for slope in ordered))
    results.write_atomically(folder / "slopes.csv", text)


def in_figure_order(slopes: Iterable[Slope]) -> list[Slope]:
    """Slopes that a figure draws, in the order of the figures."""
    names = list(FIGURES)
    drawn = [slope for slope in slopes if slope.figures]
    return sorted(drawn, key=lambda slope: names.index(slope.figures[0]))


def _draws(figure: OrderFigure | SensitivityFigure, first: dict[str, str]) -> bool:
    asked = {
        key: value
        for key, value in vars(figure).items()
        if key in ("study", "problem", "form", "quantity", "measure")
    }
    return first["preconditioning"] in figure.variants and asked.items() <= first.items()


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
        if not isinstance(figure, MechanismFigure) and _draws(figure, first)
    ]
    default = (_TOLERANCE_AT_START if at_start else _TOLERANCE)[measure]
    tolerance = min([figure.tolerance for figure in figures], default=default)
    expected = _predicted(first, path)
    # An exact zero at every h is within any order: a block that this problem lacks.
    absent = measure == "sensitivity" and bool((values == 0).all())
    usable = absent or fit.points == len(rows) >= 2
    complete = bool((rows["status"] == "ok").all()) and usable
    within = absent or abs(fit.slope - expected) <= tolerance
    return Slope(
        figures=tuple(figure.name for figure in figures),
        **{column: first[column] for column in _SERIES[:5]},
        quantity=first["quantity"],
        measure=measure,
        role=first["role"],
        row_block=first["row_block"],
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
        if first["measure"] == "sensitivity":
            row = FORMS[form].rows.index(first["row_block"])
            return float(orders.scaled(scaling)[1][FORMS[form].unknowns.index(quantity), row])
        if first["measure"] == "correction":
            return orders.corrections(scaling)[quantity]
        return orders.physical_corrections()[quantity]
    except (InputError, KeyError, ValueError) as error:
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
