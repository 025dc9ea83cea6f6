"""Which cure cures what: every entry predicted, and measured by the studies of cures.

A cure is the values of a few axes by which it differs from index 3, unscaled, with the
trapezoidal rule; the curves of Figure 16 define them.  Predictions are those of the series,
measured values come from the CSVs, and the cost from the operations in their records.  Only
the bounds beyond which a value counts as good or bad are numbers that somebody typed in.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from newmark_cli.report.judging.verdicts import MISS, PASS
from newmark_cli.report.reading.curves import TRAPEZOIDAL, Curve
from newmark_cli.report.tables.table import MARK, MARKED, MISSING, Report, pivoted
from newmark_cli.study import shipped
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.drawing import definitions
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope

#: Studies that the table reads.
TABLED = STUDY, TOLERANCE_STUDY, KRYLOV_STUDY = "cures", "cures-tolerance", "cures-krylov"
#: Where orders are read, and where the alternation starts with the motion.
PROBLEM, MOVING = "andrews", "slider-crank"
FORM = "a-lambda"
DAMPED = GeneralizedAlpha(0.9).label

#: What an entry comes to; nothing where there is no such question.
YES, PARTLY, NO, NONE = "yes", "partly", "no", ""

#: |fitted − predicted| that contradicts an order, of however few points.
_FAR = 0.5


@dataclass(frozen=True)
class Cure:
    """Something that somebody may do about small steps.

    Attributes:
        name: In legends and tables.
        axes: Axis → value, where it differs from the usual one.
    """

    name: str
    axes: Mapping[str, str] = field(default_factory=dict)

    def curve(self, study: str, problem: str, quantity: str, measure: str, **axes: str) -> Curve:
        """A series of it.

        Args:
            study, problem, quantity, measure: As in the CSV.
            axes: Values over those of the cure.
        """
        named = {"form": FORM, "preconditioning": "none", "integrator": TRAPEZOIDAL}
        every = {**named, **self.axes, **axes}
        return Curve(self.name, study, problem, quantity, measure, **every)

    @property
    def damped(self) -> "Cure":
        """The cure with dissipation, where corrections are not fed by an alternation."""
        return Cure(self.name, {**self.axes, "integrator": DAMPED})

    @property
    def on(self) -> "Cure":
        """The part of it that remains in the matrix of Newton's iteration."""
        of_matrix = ("preconditioning", "formulation")
        return Cure(self.name, {k: v for k, v in self.axes.items() if k in of_matrix})

    @property
    def needs(self) -> str:
        """Inputs that a problem or a user must supply besides those of index 3."""
        formulation = Formulation.parse(self.axes.get("formulation", "index-3"))
        projection = Projection.parse(self.axes.get("projection", "none"))
        needed = []
        if self.axes.get("evaluation") == COMPENSATED:
            needed.append("quadratic constraints")
        if formulation.kind.derivatives:
            needed.append("rate tangent")
        if formulation.kind.derivatives == 2:
            needed.append("curvature and its tangent")
        if formulation.parameter is not None:
            words = {"rate": "decay rate α", "rate_h": "decay αh", "factor": "penalty factor"}
            needed.append(words[formulation.parameter[0]])
        if projection.level or self.axes.get("multipliers") == "recovered":
            needed.append("curvature")
        if self.axes.get("start") == "corrected":
            needed.append("derivatives of the curvature")
        return "; ".join(needed) or MISSING


@cache
def of_problem(problem: str) -> Mapping[str, tuple[str, Cure]]:
    """Name → group and cure, of those that a problem admits.

    A rate of Baumgarte's must suit its step sizes, and compensated evaluation is not for all.

    Args:
        problem: One of the study's.
    """
    every = definitions(shipped.configs()[STUDY]) or ()
    (figure,) = (each for each in every if each.figure == "16")
    return {
        line.label: (
            line.panel,
            Cure(line.label, {a: v[0] for a, v in line.choice.items() if a != "problem"}),
        )
        for line in figure.curves
        if problem in line.choice.get("problem", (problem,))
    }


#: The cures of Andrews' mechanism.
CURES = tuple(cure for _, cure in of_problem(PROBLEM).values())


@dataclass(frozen=True)
class Cell:
    """One entry of the table.

    Attributes:
        mark: `YES`, `PARTLY`, `NO`, or nothing where there is no such question.
        measured: What was measured, as text.
        predicted: Order in h, or a word; empty where theory says nothing.
        agrees: Whether it is as predicted.
        said: What the table says of it behind the mark; what was measured when empty.
    """

    mark: str = NONE
    measured: str = "n/a"
    predicted: str = ""
    agrees: bool = True
    said: str = ""

    @property
    def text(self) -> str:
        """The entry in words."""
        words = ": ".join(filter(None, (self.mark, self.said or self.measured)))
        return words + ("" if self.agrees else MARK)


class Evidence:
    """Series of the studies, by cure."""

    def __init__(self, results: Results) -> None:
        """Take results that have the studies."""
        self._results = results

    def series(
        self, cure: Cure, quantity: str, measure: str, problem: str = PROBLEM, **axes: str
    ) -> "Slope | None":
        """A series of a cure; None where the results lack it."""
        study = axes.pop("study", STUDY)
        return self._results.by_key.get(cure.curve(study, problem, quantity, measure, **axes).key)

    @cached_property
    def _operations(self) -> Mapping[SeriesKey, Any]:
        ours = [
            slope
            for slope in self._results.slopes
            if (slope.study, slope.problem, slope.measure) == (STUDY, PROBLEM, "error")
        ]
        return costs(self._results, ours)

    def per_step(self, cure: Cure) -> Any:
        """(points,) operations per step at the three smallest step sizes; NaN if not known."""
        slope = self.series(cure, "u", "error")
        if slope is None:
            return np.full(3, np.nan)
        chosen = np.argsort(slope.h)[:3]
        return (self._operations[slope.key] / slope.steps)[chosen]


def _smallest(slope: "Slope") -> float:
    """The value at the smallest step size."""
    return float(slope.values[np.argmin(slope.h)])


def _number(value: float) -> str:
    return f"{value:.1g}".replace("e-0", "e-").replace("e+0", "e")


def _fitted(slope: "Slope") -> str:
    return f"{slope.fit.slope:.1f}".replace("-0.0", "0.0").replace("-", "−")


def _like(order: float) -> str:
    """An order in words; empty where there is none."""
    if not np.isfinite(order):
        return ""
    if order == 0:
        return "constant"
    return f"{'falls' if order > 0 else 'grows'} like {power('h', f'{order:g}')}"


def _of_order(slope: "Slope", good: float, half: float) -> Cell:
    """An order that should not be far below 0.

    Args:
        slope: The series.
        good, half: Least slopes for yes and for partly.
    """
    fitted = slope.fit.slope
    mark = YES if fitted > good else PARTLY if fitted > half else NO
    # However few its points are, a fit must be near its order.
    near = not abs(fitted - slope.expected) > _FAR
    said = ", ".join(filter(None, (_like(slope.expected), f"fitted {_fitted(slope)}")))
    return Cell(
        mark, _fitted(slope), format_order(slope.expected), slope.verdict != MISS and near, said
    )


def _tolerance(found: Evidence, cure: Cure) -> Cell:
    # Neither recovered λ nor a corrected start changes what Newton's method does.
    kept = {k: v for k, v in cure.axes.items() if k != "start"}
    iterated = Cure(cure.name, kept)
    alone = "multipliers" in kept and "projection" not in kept
    slope = found.series(
        (cure.on if alone else iterated).damped, "newton", "tolerance",
        study=TOLERANCE_STUDY, stop="absolute 1e-08",
    )  # fmt: skip
    if slope is None:
        return Cell()
    share = _smallest(slope)
    orders = [
        series.expected
        for unknown in ("a", "lambda", "eta")
        for one in (iterated.damped, iterated)
        if (series := found.series(one, unknown, "correction")) and np.isfinite(series.expected)
    ]
    least = min(orders, default=np.nan)
    mark = YES if share == 1 else NO if share < 0.5 else PARTLY
    text = f"{100 * share:.0f} %"
    return Cell(mark, text, format_order(least), not (least >= 0 and share < 1))


def _condition(found: Evidence, cure: Cure) -> Cell:
    slope = found.series(cure, "jacobian", "condition")
    return Cell() if slope is None else _of_order(slope, -0.25, -1.5)


def _krylov(found: Evidence, cure: Cure) -> Cell:
    slope = found.series(
        cure.on, "jacobian", "krylov_iterations", "random-chain(links=200)",
        study=KRYLOV_STUDY, linear_solver=GMRES,
    )  # fmt: skip
    if slope is None:
        return Cell()
    ends = np.argmax(slope.h), np.argmin(slope.h)
    low, high = (slope.values[i] for i in ends)
    more = ["more than " if slope.statuses[i] == "stagnated" else "" for i in ends]
    counts = f"{more[0]}{low:.0f} to {more[1]}{high:.0f}"
    condition = found.series(cure.on, "jacobian", "condition")
    predicted = ""
    if condition is not None and np.isfinite(condition.expected):
        predicted = "same" if condition.expected >= 0 else "grow"
    stagnated = "stagnated" in slope.statuses
    mark = NO if stagnated else YES if high < 1.3 * low else PARTLY
    return Cell(mark, counts, predicted, not (predicted == "same" and mark == NO))


def _error(problem: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        _, ours = of_problem(problem).get(cure.name, ("", cure))
        slope = found.series(ours, "lambda", "error", problem)
        if slope is None:
            return Cell()
        value = _smallest(slope)
        # A corrected start ends at larger steps than the others.
        falling = slope.verdict == PASS and value == np.min(slope.values)
        mark = YES if value < 1e-5 or falling else PARTLY if value < 1e-2 else NO
        said = ", ".join(filter(None, (_number(value), _like(slope.expected))))
        predicted = format_order(slope.expected)
        return Cell(mark, _number(value), predicted, slope.verdict != MISS, said)

    return cell


def _floor(evaluation: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        if "start" in cure.axes:
            return Cell()
        ours = Cure(cure.name, {**cure.axes, "evaluation": evaluation})
        if cure.axes.get("multipliers") == "recovered":
            # Nothing that is left of Newton's λ is reported.
            slope = found.series(ours.damped, "multiplier", "invariant")
            if slope is None:
                return Cell()
            return Cell(YES, _number(_smallest(slope)), "0", said="constant, recovered")
        for one in (ours.damped, ours):
            slope = found.series(one, "lambda", "physical_correction")
            if slope is not None:
                return _of_order(slope, -0.3, -1.5)
        return Cell()

    return cell


def _drift(quantity: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        slope = found.series(cure, quantity, "invariant")
        if slope is None:
            return Cell()
        agrees, value = slope.verdict != MISS, float(np.max(slope.values))
        order = format_order(slope.expected)
        if value < 1e-11:
            return Cell(YES, _number(value), order or "eps", agrees, f"rounding, {_number(value)}")
        at_end = _number(_smallest(slope))
        # Rounding may leave no two step sizes to fit.
        fitted = _fitted(slope) if np.isfinite(slope.fit.slope) else ""
        mark = PARTLY if slope.fit.slope > 1.5 else NO
        said = [at_end, _like(slope.expected), fitted and f"fitted {fitted}"]
        measured = ", ".join(filter(None, (fitted, at_end)))
        return Cell(mark, measured, order, agrees, ", ".join(filter(None, said)))

    return cell


def _cost(found: Evidence, cure: Cure) -> Cell:
    ratios = found.per_step(cure) / found.per_step(CURES[0])
    if not np.isfinite(ratios).any():
        return Cell()
    ratio = float(np.nanmedian(ratios))
    mark = YES if ratio <= 1.3 else PARTLY if ratio <= 2 else NO
    return Cell(mark, f"{ratio:.1f}", said=f"{ratio:.1f} times")


def _needs(found: Evidence, cure: Cure) -> Cell:
    return Cell(NONE, cure.needs)


@dataclass(frozen=True)
class Symptom:
    """A column: its name, what it says in a sentence, and its entry for a cure."""

    name: str
    about: str
    cell: Callable[[Evidence, Cure], Cell]


#: Title → columns of each table.
TABLES: Mapping[str, Sequence[Symptom]] = {
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
            _needs,
        ),
    ),
    "Which cure helps the multipliers": (
        Symptom(
            "error of λ from rest",
            "error at the end of the run at the smallest h, with its predicted order, of Andrews' "
            "mechanism, which starts from rest",
            _error(PROBLEM),
        ),
        Symptom(
            "error of λ in motion",
            "the same of a slider-crank that starts in motion",
            _error(MOVING),
        ),
        Symptom(
            "rounding of λ",
            "whether the last correction of λ in physical units, which is what rounding leaves of "
            "it, stays as it is when h falls; λ that is recovered from u and v is free of it",
            _floor("direct"),
        ),
        Symptom("rounding of λ, compensated", "the same in compensated evaluation",
                _floor("compensated")),
    ),
    "Which cure holds the constraints": (
        Symptom(
            "positions hold",
            "largest relative misfit of Φ = 0; where it is more than rounding at the smallest h, "
            "with its predicted and its fitted order",
            _drift("position"),
        ),
        Symptom("velocities hold", "the same of the rate of the constraints, Gᵀv = 0",
                _drift("velocity")),
    ),
}  # fmt: skip
SYMPTOMS = tuple(symptom for several in TABLES.values() for symptom in several)

COLUMNS = ("group", "cure", "symptom", "mark", "predicted", "measured", "agrees")
LEGEND = (
    ("", "Every entry is measured; powers of h are predicted."),
    ("", MARKED),
    *((symptom.name, f"{symptom.about}.") for symptom in SYMPTOMS),
)


def build(results: Results) -> dict[tuple[str, str], Cell]:
    """Entries by cure and symptom.

    Raises:
        ResultsError: When the results have no series of the study.
    """
    if all(slope.study != STUDY for slope in results.slopes):
        raise ResultsError(f"no results of {STUDY}; run 'newmark-study run {STUDY}' first")
    evidence = Evidence(results)
    return {
        (cure.name, symptom.name): symptom.cell(evidence, cure)
        for cure in CURES
        for symptom in SYMPTOMS
    }


def collect(folder: Path) -> Results:
    """Results of those of the studies that a folder has."""
    there = [study for study in TABLED if (folder / f"{study}.csv").exists()]
    return Results(folder, slopes.collect(folder, there or TABLED))


def report(cells: Mapping[tuple[str, str], Cell]) -> Report:
    """The tables, and their entries as records.

    Args:
        cells: As `build` makes them.
    """
    groups = {name: group for name, (group, _) in of_problem(PROBLEM).items()}
    records = [
        {
            "group": groups[cure], "cure": cure, "symptom": symptom, "mark": cell.mark,
            "predicted": cell.predicted, "measured": cell.measured,
            "agrees": "yes" if cell.agrees else "no", "text": cell.text,
        }
        for (cure, symptom), cell in cells.items()
    ]  # fmt: skip
    tables = []
    for title, several in TABLES.items():
        names = {symptom.name for symptom in several}
        ours = [record for record in records if record["symptom"] in names]
        tables.append(pivoted(title, ours, {"cure": str}, "symptom", lambda one: str(one["text"])))
    return Report("cures", tuple(tables), LEGEND, records, COLUMNS)
