"""Fitted slopes beside predicted orders, with verdicts: what `check` asserts.

One `Slope` for each series in the CSVs: the rows of one study that differ in
the step size alone.  Predictions come from exponent arithmetic
(`newmark_cli.newmark.orders`), never from a table of expected numbers.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from newmark_cli.arrays import Array
from newmark_cli.documents import nearest
from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.orders import UNKNOWNS, FormOrders, form_orders
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure, SensitivityFigure
from newmark_cli.report.fits import Fit, power_law
from newmark_cli.report.table import SERIES, read_study, study_files
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
    groups = frame.groupby(["problem", "measure", frame["steps"] == 0])
    most = {group: rows["h"].nunique() for group, rows in groups}
    for key, rows in frame.groupby([*SERIES, frame["steps"] == 0], sort=False):
        first = {column: str(rows[column].iloc[0]) for column in SERIES}
        points = most[first["problem"], first["measure"], key[-1]]
        found.append(_slope(first, rows, points, path) if first["measure"] else _failed(first))
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


def _draws(figure: OrderFigure | SensitivityFigure, first: dict[str, str]) -> bool:
    asked = {
        key: value
        for key, value in vars(figure).items()
        if key in ("study", "problem", "form", "quantity", "measure")
    }
    return first["preconditioning"] in figure.variants and asked.items() <= first.items()


def _slope(first: dict[str, str], rows: pd.DataFrame, points: int, path: Path) -> Slope:
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
    default = _TOLERANCE_AT_START.get(measure) if at_start else None
    default = default or _TOLERANCE[measure]
    tolerance = min([figure.tolerance for figure in figures], default=default)
    expected = _predicted(first, path)
    # An exact zero at every h is within any order: a block that this problem lacks.
    absent = measure == "sensitivity" and bool((values == 0).all())
    usable = absent or fit.points == points >= 2
    complete = bool((rows["status"] == "ok").all()) and usable
    within = absent or abs(fit.slope - expected) <= tolerance
    return Slope(
        figures=tuple(figure.name for figure in figures),
        **_described(first),
        h=h,
        values=values,
        fit=fit,
        expected=expected,
        tolerance=tolerance,
        verdict=(PASS if within else MISS) if complete else INCOMPLETE,
    )


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
        fit=power_law(np.array([]), np.array([])),
        expected=np.nan,
        tolerance=np.nan,
        verdict=INCOMPLETE,
    )


def _predicted(first: dict[str, str], path: Path) -> float:
    form, quantity = first["form"], first["quantity"]
    try:
        if not first["integrator"].startswith("newmark "):
            raise ResultsError(f"unknown integrator {first['integrator']!r}; allowed: newmark")
        if form not in FORMS:
            raise ResultsError(f"unknown form {form!r}{nearest(form, FORMS)}")
        if quantity not in (*UNKNOWNS, "jacobian"):
            raise ResultsError(f"unknown quantity {quantity!r}{nearest(quantity, UNKNOWNS)}")
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


def format_fit(fit: Fit) -> str:
    """Slope ± standard error: two decimals, more where the error asks for them."""
    if np.isnan(fit.slope):
        return "n/a"
    # As many decimals as the error has, at least two: "± 0.000" would claim too much.
    small = 0 < fit.stderr < 0.005
    decimals = min(-math.floor(math.log10(fit.stderr)), 6) if small else 2
    slope = f"{round(fit.slope, decimals) + 0.0:.{decimals}f}".replace("-", "−")
    return slope if np.isnan(fit.stderr) else f"{slope} ± {fit.stderr:.{decimals}f}"


def format_order(value: float) -> str:
    """A predicted order: a whole number with a true minus sign."""
    return f"{value + 0:g}".replace("-", "−")
