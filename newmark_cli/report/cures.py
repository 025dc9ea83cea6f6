"""Every cure on one footing: what it changes, and Figures 16 to 18.

A cure is the values of a few axes by which it differs from index 3, unscaled, with the
trapezoidal rule.  The cures stand in three groups of seven: a group is a column of panels
in the figures, and a column of the legend below them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from newmark_cli.errors import ResultsError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import METHODS, Formulation, Projection
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.report import traces
from newmark_cli.report.curves import TRAPEZOIDAL, Curve
from newmark_cli.report.history import Drift, read_drifts
from newmark_cli.report.kinds import Results
from newmark_cli.report.panels import Legend, Look, Panel, Sheet, Trace, look, spread
from newmark_cli.report.work import COSTS, costed
from newmark_cli.study.measures import symbol
from newmark_cli.study.results import drift_path

#: Studies that figures and table read.
STUDY, TOLERANCE_STUDY, KRYLOV_STUDY, DRIFT_STUDY = (
    "cures", "cures-tolerance", "cures-krylov", "drift",
)  # fmt: skip
#: What the table reads.
TABLED = (STUDY, TOLERANCE_STUDY, KRYLOV_STUDY)
FORM = "a-lambda"
DAMPED = GeneralizedAlpha(0.9).label
#: Problems of the study, and how figures call them: one from rest, one in motion, and one
#: with Φ(u, t).
PROBLEMS: Mapping[str, str] = MappingProxyType(
    {
        "andrews": "Andrews",
        "slider-crank": "slider-crank",
        "shaken-pendulum": "shaken pendulum",
    }
)
_NOT_QUADRATIC = ("shaken-pendulum",)
#: Baumgarte's fixed rate (1/s), where it is not that of `GROUPS`.
_RATES = {"slider-crank": 30.0, "shaken-pendulum": 30.0}


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

    def fits(self, problem: str) -> bool:
        """Whether it is to be had for a problem: compensated evaluation is not for all."""
        return self.axes.get("evaluation") != COMPENSATED or problem not in _NOT_QUADRATIC

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
        found = []
        if self.axes.get("evaluation") == COMPENSATED:
            found.append("quadratic Φ(u)")
        found += {1: ["A"], 2: ["A, κ, Q"]}.get(formulation.kind.derivatives, [])
        if formulation.parameter is not None:
            found.append({"rate": "α", "rate_h": "αh", "factor": "k"}[formulation.parameter[0]])
        if projection.level or self.axes.get("multipliers") == "recovered":
            found.append("κ")
        if self.axes.get("start") == "corrected":
            found.append("κ_t, ∂κ/∂u")
        return "; ".join(found) or "–"


_D = {"integrator": DAMPED}
_C = {"evaluation": COMPENSATED}


def _with(name: str, *axes: Mapping[str, str], **more: str) -> Cure:
    merged: dict[str, str] = {}
    for each in (*axes, more):
        merged |= each
    return Cure(name, merged)


def _formulation(name: str, label: str, *axes: Mapping[str, str]) -> Cure:
    return _with(name, *axes, formulation=Formulation.parse(label).label)


#: The cures by group: the heading of its panels, and seven cures each.
GROUPS: Mapping[str, tuple[Cure, ...]] = MappingProxyType(
    {
        "index 3": (
            Cure("index 3, trapezoidal"),
            _with("left scaling", preconditioning="left"),
            _with("right scaling", preconditioning="right"),
            _with("optimal scaling", preconditioning="optimal"),
            _with("dissipation", _D),
            _with("compensated", _C),
            _with("dissipation + compensated", _D, _C),
        ),
        "other constraint rows": (
            _formulation("index 2", "index-2"),
            _formulation("index 1", "index-1"),
            _formulation("Baumgarte, fixed α", "baumgarte rate=1000"),
            _formulation("Baumgarte, α = 1/h", "baumgarte rate_h=1"),
            _formulation("GGL", "ggl"),
            _formulation("index 2 + dissipation", "index-2", _D),
            _formulation("GGL + dissipation", "ggl", _D),
        ),
        "around the step": (
            _formulation("augmented Lagrangian", "augmented-lagrangian"),
            _formulation("aug. Lagr. + dissipation", "augmented-lagrangian", _D),
            _with("velocity projection", projection="velocity", multipliers="recovered"),
            _with("projection + dissipation", _D, projection="velocity", multipliers="recovered"),
            _with("recovered λ", multipliers="recovered"),
            _with("recovered λ + dissipation", _D, multipliers="recovered"),
            _with("corrected start, compensated", _C, start="corrected"),
        ),
    }
)
assert set(METHODS) >= {
    Formulation.parse(cure.axes["formulation"]).method
    for group in GROUPS.values()
    for cure in group
    if "formulation" in cure.axes
}
assert FORM in FORMS
CURES = tuple(cure for group in GROUPS.values() for cure in group)


def named(name: str) -> Cure:
    """The cure of this name."""
    return next(cure for cure in CURES if cure.name == name)


def for_problem(cure: Cure, problem: str) -> Cure:
    """The cure as the study has it for a problem.

    Where compensated evaluation is not to be had, the corrected start goes without; and
    Baumgarte's rate must suit the step sizes, αh being small.
    """
    axes = dict(cure.axes)
    if axes.get("start") == "corrected" and problem in _NOT_QUADRATIC:
        del axes["evaluation"]
    if problem in _RATES and "rate=" in axes.get("formulation", ""):
        axes["formulation"] = Formulation("baumgarte", ("rate", _RATES[problem])).label
    return Cure(cure.name, axes)


def of_problem(problem: str, group: str) -> list[Cure]:
    """Cures of a group that a problem admits."""
    found = [for_problem(cure, problem) for cure in GROUPS[group]]
    return [cure for cure in found if cure.fits(problem)]


def look_of(name: str) -> Look:
    """Look of a cure, the same in every figure; colours differ within a group."""
    return look([cure.name for cure in CURES].index(name))


def _legend(note: str) -> Legend:
    return Legend(note, columns=len(GROUPS))


_SETTINGS = {"legend.fontsize": 6.5, "legend.handlelength": 2.6, "legend.columnspacing": 2.0}


def _filled(panel_traces: Sequence[Trace], every: Sequence[Cure]) -> tuple[Trace, ...]:
    """Traces and, for the legend, empty ones of the cures that a panel lacks."""
    there = {trace.label: trace for trace in panel_traces}
    return tuple(
        there.get(cure.name) or Trace(cure.name, np.array([]), np.array([]), look_of(cure.name))
        for cure in every
    )


@dataclass(frozen=True)
class CuresFigure:
    """A quantity of every cure against the step size: problems down, groups across.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        quantity, measure: Which rows.
    """

    name: str
    title: str
    quantity: str
    measure: str
    study: ClassVar[str] = STUDY
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        return tuple(c for key in product(PROBLEMS, GROUPS) for c in self._panel_curves(*key))

    def _panel_curves(self, problem: str, group: str) -> list[Curve]:
        return [
            cure.curve(STUDY, problem, self.quantity, self.measure)
            for cure in of_problem(problem, group)
        ]

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """A row of panels for each problem."""
        slopes = {slope.key: slope for slope in results.series(self)}
        panels = []
        for problem in PROBLEMS:
            row = [s for s in slopes.values() if s.problem == problem]
            limits = spread([slope.values for slope in row])
            for group in GROUPS:
                found = [(c, slopes[c.key]) for c in self._panel_curves(problem, group)]
                drawn = [
                    traces.trace(
                        slope, curve.label, look_of(curve.label), size=0.75, fit="",
                        name=f"{PROBLEMS[problem]}, {curve.label}",
                    )
                    for curve, slope in found
                ]  # fmt: skip
                first = group == next(iter(GROUPS))
                panels.append(
                    Panel(
                        _filled(drawn, GROUPS[group]),
                        traces.step_label(problem),
                        f"{PROBLEMS[problem]}: error of {symbol(self.quantity)}" if first else "",
                        group if problem == next(iter(PROBLEMS)) else "",
                        y_limits=limits,
                    )
                )
        return Sheet(
            self.title,
            tuple(panels),
            len(GROUPS),
            _legend("(a, λ) form; error at the end, ‖Δλ‖ / ‖λ‖"),
            panel_size=(7.0 / len(GROUPS), 1.9),
            share_x=False,
            ticks=(6, 8),
            minor_ticks=False,
            settings=_SETTINGS,
        )


@dataclass(frozen=True)
class CureWorkFigure:
    """Errors of every cure against its work: quantities down, groups across.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        problem: Which problem.
        quantities: A row of panels each.
    """

    name: str
    title: str
    problem: str
    quantities: tuple[str, ...] = ("lambda", "u")
    study: ClassVar[str] = STUDY
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        return tuple(
            curve for key in product(self.quantities, GROUPS) for curve in self._panel_curves(*key)
        )

    def _panel_curves(self, quantity: str, group: str) -> list[Curve]:
        return [
            cure.curve(STUDY, self.problem, quantity, "error")
            for cure in of_problem(self.problem, group)
        ]

    def require(self, results: Results) -> None:
        """All series, and costs of their cells."""
        costed(self, results)

    def sheet(self, results: Results) -> Sheet:
        """Points of a series joined from the largest step size to the smallest."""
        slopes, found = costed(self, results)
        panels = []
        for quantity in self.quantities:
            limits = spread([s.values for s in slopes.values() if s.quantity == quantity])
            for group in GROUPS:
                drawn = []
                for curve in self._panel_curves(quantity, group):
                    slope, spent = slopes[curve.key], found[curve.key]
                    order = np.argsort(-slope.h)
                    best = int(np.argmin(slope.h))
                    drawn.append(
                        Trace(
                            curve.label,
                            spent[order],
                            slope.values[order],
                            look_of(curve.label),
                            bars=slope.rounding[order],
                            size=0.75,
                            said=f"{traces.quantity(slope)}, {curve.label}: "
                            f"{slope.values[best]:.3g} at h = {slope.h[best]:g}",
                        )
                    )
                first = group == next(iter(GROUPS))
                panels.append(
                    Panel(
                        _filled(drawn, GROUPS[group]),
                        COSTS[results.cost].label,
                        f"error of {symbol(quantity)}" if first else "",
                        group if quantity == self.quantities[0] else "",
                        y_limits=limits,
                    )
                )
        return Sheet(
            self.title,
            tuple(panels),
            len(GROUPS),
            _legend("each from the largest step size to the smallest"),
            panel_size=(7.0 / len(GROUPS), 2.1),
            share_x=True,
            ticks=(5, 8),
            minor_ticks=False,
            settings=_SETTINGS,
        )


#: What Figure 18 shows: problem → step size (s).
DRIFTING: Mapping[str, float] = MappingProxyType({"andrews": 1e-5, "shaken-pendulum": 1e-3})
#: Least drift that is drawn (m, m/s): what is smaller is rounding, or exactly 0.
_LEAST_DRIFT = 1e-18
_DRIFT_CURES = (
    Cure("index 3"),
    *(
        Cure(cure.name, {"formulation": cure.axes["formulation"]})
        for cure in GROUPS["other constraint rows"][:5]
    ),
    Cure("velocity projection", {"projection": "velocity", "multipliers": "recovered"}),
)


@dataclass(frozen=True)
class DriftFigure:
    """Misfits of the constraints and of their rate over time: misfits down, problems across.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
    """

    name: str
    title: str
    study: ClassVar[str] = DRIFT_STUDY
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """Largest misfits of its cells."""
        return tuple(
            drift_curve(cure, problem, quantity)
            for quantity, problem, cure in product(("position", "velocity"), DRIFTING, _DRIFT_CURES)
        )

    def drifts(self, results: Results) -> dict[tuple[str, str], Drift]:
        """Time series by problem and cure.

        Raises:
            ResultsError: When the results lack one.
        """
        wanted = {
            (problem, cure.name): (drift_curve(cure, problem, "position"), h)
            for problem, h in DRIFTING.items()
            for cure in _DRIFT_CURES
        }
        found = read_drifts(results.folder, self.study, list(wanted.values()))
        missing = [" ".join(key) for key, one in zip(wanted, found, strict=True) if one is None]
        if missing:
            raise ResultsError(
                f"{drift_path(results.folder, self.study)}: figure {self.name} needs "
                f"{', '.join(missing)}; run 'newmark-study run {self.study}' again"
            )
        return {key: one for key, one in zip(wanted, found, strict=True) if one is not None}

    def require(self, results: Results) -> None:
        """All time series."""
        self.drifts(results)

    def sheet(self, results: Results) -> Sheet:
        """Logarithmic ordinates: drifts differ by ten powers of ten."""
        drifts = self.drifts(results)
        panels = []
        for quantity, label in (
            ("position", r"$|\Phi_k|/\|G_k\|$ (m)"),
            ("velocity", r"$|(G^T v + \Phi_t)_k|/\|G_k\|$ (m/s)"),
        ):
            for problem, h in DRIFTING.items():
                drawn = []
                for place, cure in enumerate(_DRIFT_CURES):
                    drift = drifts[problem, cure.name]
                    values = getattr(drift, quantity)
                    ours = look(place)
                    drawn.append(
                        Trace(
                            cure.name,
                            drift.t,
                            np.where(values < _LEAST_DRIFT, np.nan, values),
                            Look(ours.color, linestyle=ours.linestyle, linewidth=0.9),
                            said=f"{PROBLEMS[problem]}, {quantity}, {cure.name}: up to "
                            f"{np.max(values):.2g}",
                        )
                    )
                panels.append(
                    Panel(
                        tuple(drawn),
                        "time $t$ (s)",
                        label,
                        f"{PROBLEMS[problem]}; h = {h:g} s" if quantity == "position" else "",
                        x_scale="linear",
                        y_limits=(
                            0.1 * _LEAST_DRIFT,
                            10 * max(float(np.nanmax(trace.y)) for trace in drawn),
                        ),
                        tell_zeros=False,
                    )
                )
        return Sheet(
            self.title,
            tuple(panels),
            len(DRIFTING),
            Legend("generalized-α, ρ∞ = 0.9; (a, λ) form, optimal scaling", columns=4),
            panel_size=(3.5, 2.0),
            share_x=False,
            ticks=(6, 8),
            minor_ticks=False,
            settings=_SETTINGS,
        )


def drift_curve(cure: Cure, problem: str, quantity: str) -> Curve:
    """Largest drift of a cure over its run."""
    return for_problem(cure, problem).curve(
        DRIFT_STUDY, problem, quantity, "drift", integrator=DAMPED, preconditioning="optimal"
    )


def error_figure() -> CuresFigure:
    """Figure 16."""
    return CuresFigure("16", "Error of the multipliers under every cure", "lambda", "error")


def work_figure() -> CureWorkFigure:
    """Figure 17."""
    return CureWorkFigure(
        "17", "Andrews' mechanism: error against work under every cure", "andrews"
    )


def drift_figure() -> DriftFigure:
    """Figure 18."""
    return DriftFigure("18", "Drift of the constraints and of their rate")
