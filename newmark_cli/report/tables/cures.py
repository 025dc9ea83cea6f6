"""Which cure cures what: every entry predicted, and measured by the studies of cures.

A cure is the values of a few axes by which it differs from index 3, unscaled, with the
trapezoidal rule; the curves of Figure 16 define them.  Predictions are those of the series,
measured values come from the CSVs, and the cost from the operations in their records.  Only
the bounds beyond which a value counts as good or bad are numbers that somebody typed in.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.linear.choice import GMRES
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.report.drawing.panels import power
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.drawing.work import costs
from newmark_cli.report.judging import slopes
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.verdicts import MISS, PASS
from newmark_cli.report.reading.figures import Curve
from newmark_cli.report.tables.table import MARK, MARKED, MISSING, Report, pivoted
from newmark_cli.study import shipped
from newmark_cli.study.axes import TRAPEZOIDAL
from newmark_cli.study.drawing import definitions
from newmark_cli.support.errors import ResultsError

#: Studies that the table reads.
TABLED = STUDY, TOLERANCE_STUDY, KRYLOV_STUDY = "cures", "cures-tolerance", "cures-krylov"
#: Where orders are read, and where the alternation starts with the motion.
PROBLEM, MOVING = "andrews", "slider-crank"
DAMPED = GeneralizedAlpha(0.9).label

#: What an entry comes to; nothing where there is no such question.
YES, PARTLY, NO, NONE = "yes", "partly", "no", ""

#: |fitted − predicted| that contradicts an order, of however few points.
_FAR = 0.5


@dataclass(frozen=True)
class Cure:
    """Something that somebody may do about small steps."""

    name: str  #: in legends and tables
    #: Axis → value, where it differs from the usual one.
    axes: Mapping[str, str] = field(default_factory=dict)
    group: str = ""  #: panel of Figure 16

    def curve(self, study: str, problem: str, quantity: str, measure: str, **axes: str) -> Curve:
        """A series of it, as CSVs name it, with values of axes over those of the cure."""
        usual = {"form": "a-lambda", "preconditioning": "none", "integrator": TRAPEZOIDAL}
        return Curve(self.name, study, problem, quantity, measure, **{**usual, **self.axes, **axes})

    def series(
        self, results: Results, quantity: str, measure: str, problem: str = PROBLEM, **axes: str
    ) -> Slope | None:
        """The same in results; None where they lack it."""
        study = axes.pop("study", STUDY)
        return results.by_key.get(self.curve(study, problem, quantity, measure, **axes).key)

    def on(self, *axes: str) -> "Cure":
        """The part of it that is about these axes."""
        return Cure(self.name, {a: value for a, value in self.axes.items() if a in axes})

    @property
    def damped(self) -> "Cure":
        """The cure with dissipation, where corrections are not fed by an alternation."""
        return Cure(self.name, {**self.axes, "integrator": DAMPED})

    @property
    def needs(self) -> str:
        """Inputs that a problem or a user must supply besides those of index 3."""
        formulation = Formulation.parse(self.axes.get("formulation", "index-3"))
        projection = Projection.parse(self.axes.get("projection", "none"))
        recovered = self.axes.get("multipliers") == "recovered"
        parameters = {"rate": "decay rate α", "rate_h": "decay αh", "factor": "penalty factor"}
        name, _ = formulation.parameter or ("", 0.0)
        needed = {
            "quadratic constraints": self.axes.get("evaluation") == COMPENSATED,
            "rate tangent": formulation.kind.derivatives > 0,
            "curvature and its tangent": formulation.kind.derivatives == 2,
            parameters.get(name, ""): bool(name),
            "curvature": bool(projection.level) or recovered,
            "derivatives of the curvature": self.axes.get("start") == "corrected",
        }
        return "; ".join(text for text, is_needed in needed.items() if is_needed) or MISSING


@cache
def of_problem(problem: str) -> Mapping[str, Cure]:
    """Name → cure, of those that a problem of the study admits.

    A rate of Baumgarte's must suit its step sizes, and compensated evaluation is not for all.
    """
    defined = definitions(shipped.configs()[STUDY]) or ()
    (figure,) = (d for d in defined if d.figure == "16")
    return {
        line.label: Cure(
            line.label, {a: v[0] for a, v in line.choice.items() if a != "problem"}, line.panel
        )
        for line in figure.curves
        if problem in line.choice.get("problem", (problem,))
    }


#: The cures of Andrews' mechanism.
CURES = tuple(of_problem(PROBLEM).values())


@dataclass(frozen=True)
class Cell:
    """One entry of the table."""

    mark: str = NONE  #: `YES`, `PARTLY`, `NO`, or nothing where there is no such question
    measured: str = "n/a"  #: what was measured, as text
    predicted: str = ""  #: order in h, or a word; empty where theory says nothing
    agrees: bool = True  #: whether it is as predicted
    words: str = ""  #: what the table says of it behind the mark; what was measured when empty

    @property
    def text(self) -> str:
        """The entry in words."""
        words = ": ".join(filter(None, (self.mark, self.words or self.measured)))
        return words + ("" if self.agrees else MARK)


def _mark(good: bool, half: bool) -> str:
    return YES if good else PARTLY if half else NO


def _smallest(slope: Slope) -> float:
    return float(slope.values[np.argmin(slope.h)])


def _number(value: float) -> str:
    return f"{value:.1g}".replace("e-0", "e-").replace("e+0", "e")


def _fitted(slope: Slope) -> str:
    return f"{slope.fit.slope:.1f}".replace("-0.0", "0.0").replace("-", "−")


def _like(order: float) -> str:
    """An order in words; empty where there is none."""
    if not np.isfinite(order):
        return ""
    if order == 0:
        return "constant"
    return f"{'falls' if order > 0 else 'grows'} like {power('h', f'{order:g}')}"


def _listed(*parts: str) -> str:
    return ", ".join(filter(None, parts))


def _of_order(slope: Slope, good: float, half: float) -> Cell:
    """The entry for an order that should be about 0, with least slopes for yes and partly."""
    fitted = slope.fit.slope
    # However few its points are, a fit must be near its order.
    agrees = slope.verdict != MISS and not abs(fitted - slope.expected) > _FAR
    words = _listed(_like(slope.expected), f"fitted {_fitted(slope)}")
    mark, predicted = _mark(fitted > good, fitted > half), format_order(slope.expected)
    return Cell(mark, _fitted(slope), predicted, agrees, words)


def _tolerance(results: Results, cure: Cure) -> Cell:
    # Neither recovered λ nor a corrected start changes what Newton's method does.
    iterated = cure.on(*(set(cure.axes) - {"start"}))
    reported_alone = "multipliers" in cure.axes and "projection" not in cure.axes
    of_matrix = cure.on("preconditioning", "formulation")
    slope = (of_matrix if reported_alone else iterated).damped.series(
        results, "newton", "tolerance", study=TOLERANCE_STUDY, stop="absolute 1e-08"
    )
    if slope is None:
        return Cell()
    share = _smallest(slope)
    orders = [
        series.expected
        for unknown in ("a", "lambda", "eta")
        for variant in (iterated.damped, iterated)
        if (series := variant.series(results, unknown, "correction"))
        and np.isfinite(series.expected)
    ]
    least = min(orders, default=np.nan)
    agrees = not (least >= 0 and share < 1)
    return Cell(
        _mark(share == 1, share >= 0.5), f"{100 * share:.0f} %", format_order(least), agrees
    )


def _condition(results: Results, cure: Cure) -> Cell:
    slope = cure.series(results, "jacobian", "condition")
    return Cell() if slope is None else _of_order(slope, -0.25, -1.5)


def _krylov(results: Results, cure: Cure) -> Cell:
    of_matrix = cure.on("preconditioning", "formulation")
    slope = of_matrix.series(
        results, "jacobian", "krylov_iterations", "random-chain(links=200)",
        study=KRYLOV_STUDY, linear_solver=GMRES,
    )  # fmt: skip
    if slope is None:
        return Cell()
    ends = np.argmax(slope.h), np.argmin(slope.h)
    counts = " to ".join(
        f"{'more than ' if slope.statuses[i] == 'stagnated' else ''}{slope.values[i]:.0f}"
        for i in ends
    )
    condition = of_matrix.series(results, "jacobian", "condition")
    predicted = ""
    if condition is not None and np.isfinite(condition.expected):
        predicted = "same" if condition.expected >= 0 else "grow"
    stagnated = "stagnated" in slope.statuses
    few = slope.values[ends[1]] < 1.3 * slope.values[ends[0]]
    mark = _mark(bool(few) and not stagnated, not stagnated)
    return Cell(mark, counts, predicted, not (predicted == "same" and mark == NO))


def _error(problem: str, results: Results, cure: Cure) -> Cell:
    slope = of_problem(problem).get(cure.name, cure).series(results, "lambda", "error", problem)
    if slope is None:
        return Cell()
    value = _smallest(slope)
    # A corrected start ends at larger steps than the others.
    falling = slope.verdict == PASS and value == np.min(slope.values)
    words = _listed(_number(value), _like(slope.expected))
    mark, predicted = _mark(value < 1e-5 or falling, value < 1e-2), format_order(slope.expected)
    return Cell(mark, _number(value), predicted, slope.verdict != MISS, words)


def _floor(evaluation: str, results: Results, cure: Cure) -> Cell:
    ours = Cure(cure.name, {**cure.axes, "evaluation": evaluation})
    if "start" in cure.axes:
        return Cell()
    if cure.axes.get("multipliers") == "recovered":
        # Nothing that is left of Newton's λ is reported.
        slope = ours.damped.series(results, "multiplier", "invariant")
        words = "constant, recovered"
        return Cell() if slope is None else Cell(YES, _number(_smallest(slope)), "0", words=words)
    for variant in (ours.damped, ours):
        if slope := variant.series(results, "lambda", "physical_correction"):
            return _of_order(slope, -0.3, -1.5)
    return Cell()


def _drift(quantity: str, results: Results, cure: Cure) -> Cell:
    slope = cure.series(results, quantity, "invariant")
    if slope is None:
        return Cell()
    agrees, value = slope.verdict != MISS, float(np.max(slope.values))
    order = format_order(slope.expected)
    if value < 1e-11:
        return Cell(YES, _number(value), order or "eps", agrees, f"rounding, {_number(value)}")
    at_end = _number(_smallest(slope))
    # Rounding may leave no two step sizes to fit.
    fitted = _fitted(slope) if np.isfinite(slope.fit.slope) else ""
    words = _listed(at_end, _like(slope.expected), fitted and f"fitted {fitted}")
    mark = _mark(False, slope.fit.slope > 1.5)
    return Cell(mark, _listed(fitted, at_end), order, agrees, words)


def _cost(results: Results, cure: Cure) -> Cell:
    ratios = _per_step(results, cure) / _per_step(results, CURES[0])
    if not np.isfinite(ratios).any():
        return Cell()
    ratio = float(np.nanmedian(ratios))
    return Cell(_mark(ratio <= 1.3, ratio <= 2), f"{ratio:.1f}", words=f"{ratio:.1f} times")


def _per_step(results: Results, cure: Cure) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """(points,) operations per step at the three smallest step sizes; NaN if not known."""
    slope = cure.series(results, "u", "error")
    if slope is None:
        return np.full(3, np.nan)
    operations = costs(results, [slope])[slope.key]
    return np.asarray((operations / slope.steps)[np.argsort(slope.h)[:3]])


class Symptom(NamedTuple):
    """A column: its name, what it says in a sentence, and its entry for a cure."""

    name: str
    about: str
    cell: Callable[[Results, Cure], Cell]


#: Title → columns of each table.
TABLES: Mapping[str, Iterable[Symptom]] = {
    "Which cure helps the solver": (
        Symptom(
            "fixed tolerance",
            "whether Newton's method meets a tolerance of 1e-8 on its scaled correction, and in "
            "which share of the steps at h = 1e-6",
            _tolerance,
        ),
        Symptom(
            "condition number",
            "whether that of Newton's matrix stays as it is when h falls: the predicted and the "
            "fitted order in h",
            _condition,
        ),
        Symptom(
            "GMRES iterations",
            "whether they stay few: their number at h = 1e-2 and at h = 1e-6, on a chain of 200 "
            "links",
            _krylov,
        ),
        Symptom(
            "cheap",
            "multiplications and additions of a step over those of index 3, the median of the "
            "three smallest h",
            _cost,
        ),
        Symptom(
            "needs",
            "what a problem or you must supply besides the constraints Φ and their gradients G: "
            "the rate tangent is how the rate Gᵀv of the constraints changes with the positions "
            "u; the curvature κ is what Φ'' has besides accelerations; the decay rate α and the "
            "penalty factor are numbers to choose",
            lambda results, cure: Cell(NONE, cure.needs),
        ),
    ),
    "Which cure helps the multipliers": (
        Symptom(
            "error of λ from rest",
            "error at the end of the run at the smallest h, with its predicted order, of Andrews' "
            "mechanism, which starts from rest",
            partial(_error, PROBLEM),
        ),
        Symptom(
            "error of λ in motion",
            "the same of a slider-crank that starts in motion",
            partial(_error, MOVING),
        ),
        Symptom(
            "rounding of λ",
            "whether the last correction of λ in physical units, which is what rounding leaves of "
            "it, stays as it is when h falls; λ that is recovered from u and v is free of it",
            partial(_floor, "direct"),
        ),
        Symptom(
            "rounding of λ, compensated",
            "the same in compensated evaluation",
            partial(_floor, COMPENSATED),
        ),
    ),
    "Which cure holds the constraints": (
        Symptom(
            "positions hold",
            "largest relative misfit of Φ = 0; where it is more than rounding at the smallest h, "
            "with its predicted and its fitted order",
            partial(_drift, "position"),
        ),
        Symptom(
            "velocities hold",
            "the same of the rate of the constraints, Gᵀv = 0",
            partial(_drift, "velocity"),
        ),
    ),
}
SYMPTOMS = tuple(symptom for symptoms in TABLES.values() for symptom in symptoms)

COLUMNS = ("group", "cure", "symptom", "mark", "predicted", "measured", "agrees")
LEGEND = (
    ("", "Every entry is measured; powers of h are predicted."),
    ("", MARKED),
    *((symptom.name, f"{symptom.about}.") for symptom in SYMPTOMS),
)


def build(results: Results) -> dict[tuple[str, str], Cell]:
    """Entries by cure and symptom; raises `ResultsError` when the study has no results."""
    results = replace(results, slopes=[slope for slope in results.slopes if slope.shipped])
    if all(slope.study != STUDY for slope in results.slopes):
        raise ResultsError(
            f"no results of the shipped {STUDY}; run 'newmark-study run {STUDY}' first"
        )
    return {(c.name, s.name): s.cell(results, c) for c in CURES for s in SYMPTOMS}


def collect(folder: Path) -> Results:
    """Results of those of the studies that a folder has."""
    there = [study for study in TABLED if (folder / f"{study}.csv").exists()]
    return Results(folder, slopes.collect(folder, there or TABLED))


def report(cells: Mapping[tuple[str, str], Cell]) -> Report:
    """The tables, and their entries as records."""
    groups = {cure.name: cure.group for cure in CURES}
    records = [
        {
            "group": groups[cure], "cure": cure, "symptom": symptom, "mark": cell.mark,
            "predicted": cell.predicted, "measured": cell.measured,
            "agrees": "yes" if cell.agrees else "no", "text": cell.text,
        }
        for (cure, symptom), cell in cells.items()
    ]  # fmt: skip
    tables = []
    for title, symptoms in TABLES.items():
        names = {symptom.name for symptom in symptoms}
        ours = [record for record in records if record["symptom"] in names]
        tables.append(pivoted(title, ours, {"cure": str}, "symptom", lambda one: str(one["text"])))
    return Report("cures", tuple(tables), LEGEND, records, COLUMNS)
