"""The figures as entries: what each shows, the series it draws, and what they must show.

Figures 1 to 9 are the paper's.  Nothing here draws; see `newmark_cli.report.draw`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.scaling import PAPER_VARIANTS
from newmark_cli.report.claims import (
    BoundClaim,
    Claim,
    RatioClaim,
    SlopeClaim,
    SpreadClaim,
    StatusClaim,
)
from newmark_cli.report.curves import TRAPEZOIDAL, Curve


@dataclass(frozen=True)
class OrderFigure:
    """A quantity against the step size on logarithmic axes, a series for each variant.

    Attributes:
        name: Number in the paper, or a word.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, form, quantity, measure: Which rows.
        tolerance: Largest |fitted − predicted slope|.
        variants: Series, in the order of the legend.
    """

    name: str
    title: str
    study: str
    problem: str
    form: str
    quantity: str
    measure: str
    tolerance: float
    variants: tuple[str, ...] = PAPER_VARIANTS

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series."""
        return _variants(
            self.study, self.problem, self.quantity, self.measure, self.variants, form=self.form
        )


@dataclass(frozen=True)
class MechanismFigure:
    """A mechanism in its initial position; read from the problem's definition.

    Attributes:
        name: Number in the paper, or a word.
        title: What it shows.
        problem: Which mechanism.
    """

    name: str
    title: str
    problem: str


@dataclass(frozen=True)
class SensitivityFigure:
    """Sensitivities to each row block, a panel for each row block and unknown.

    Attributes:
        name: A word.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, form: Which rows.
        tolerance: Largest |fitted − predicted slope|.
        variants: Series of each panel.
        measure: Which rows.
    """

    name: str
    title: str
    study: str
    problem: str
    form: str
    tolerance: float
    variants: tuple[str, ...] = ("none", "optimal")
    measure: str = "sensitivity"

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        form = FORMS[self.form]
        return tuple(
            curve
            for unknown, row in product(form.unknowns, form.rows)
            for curve in _variants(
                self.study, self.problem, unknown, self.measure, self.variants,
                form=self.form, row_block=row,
            )
        )  # fmt: skip


@dataclass(frozen=True)
class StudyFigure:
    """Series of a study past the paper against the step size, and what they must show.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV it reads.
        curves: Series of one quantity and measure, in the order of the legend.
        claims: What they must show.
        linear: Whether the ordinate is linear, from zero.
        note: What the legend says above the series.
    """

    name: str
    title: str
    study: str
    curves: tuple[Curve, ...]
    claims: tuple[Claim, ...]
    linear: bool = False
    note: str = ""


@dataclass(frozen=True)
class PrecisionFigure:
    """Corrections in two precisions, a panel for each unknown, and what they must show.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, integrator, form: Which rows are drawn; the claim holds for every form.
        factor: How far the quotient of the precisions may be from that of their unit roundoffs.
        variants: Series of each panel and precision.
        precisions: The two, their unit roundoffs 2^29 apart.
    """

    name: str
    title: str
    study: str
    problem: str
    integrator: str
    form: str
    factor: float
    variants: tuple[str, ...] = PAPER_VARIANTS
    precisions: tuple[str, str] = ("float32", "float64")

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel and in each panel precision by precision."""
        return self._of_form(self.form)

    def _of_form(self, form: str) -> tuple[Curve, ...]:
        return tuple(
            Curve(
                f"{variant}, {precision}", self.study, self.problem, unknown, "correction",
                form=form, preconditioning=variant, integrator=self.integrator,
                precision=precision,
            )
            for unknown in FORMS[form].unknowns
            for precision in self.precisions
            for variant in self.variants
        )  # fmt: skip

    @property
    def claims(self) -> tuple[Claim, ...]:
        """Corrections are proportional to the unit roundoff."""
        single, double = (
            [
                curve
                for form in FORMS
                for curve in self._of_form(form)
                if curve.precision == precision
            ]
            for precision in self.precisions
        )
        what = f"{' / '.join(self.precisions)} / 2²⁹, every form, unknown, variant and h"
        pairs = tuple(zip(single, double, strict=True))
        return (RatioClaim(what, pairs, 1 / self.factor, self.factor, unit=2**29),)


@dataclass(frozen=True)
class HistoryFigure:
    """A multiplier over time, in the range of the solution and in its own.

    Of the multipliers the one is drawn that is largest in the last curve.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV and time series it reads.
        h: Step size (s).
        curves: Which cells; their largest |λ| are what claims read.
        claims: What they must show.
    """

    name: str
    title: str
    study: str
    h: float
    curves: tuple[Curve, ...]
    claims: tuple[Claim, ...]


SeriesFigure = OrderFigure | SensitivityFigure | StudyFigure | PrecisionFigure
#: Figures past the paper, which make claims.
ClaimingFigure = StudyFigure | PrecisionFigure | HistoryFigure
Figure = SeriesFigure | HistoryFigure | MechanismFigure


_GENERALIZED_ALPHA = GeneralizedAlpha(0.9).label


def _variants(
    study: str,
    problem: str,
    quantity: str,
    measure: str,
    variants: tuple[str, ...] = PAPER_VARIANTS,
    **columns: str,
) -> tuple[Curve, ...]:
    return tuple(
        Curve(variant, study, problem, quantity, measure, preconditioning=variant, **columns)
        for variant in variants
    )


def _multipliers() -> StudyFigure:
    columns = ("multipliers", "andrews", "lambda", "physical_correction")
    direct = _variants(*columns)
    none, *_, optimal = direct
    compensated = Curve(
        "optimal, compensated", *columns, preconditioning="optimal", evaluation="compensated"
    )
    return StudyFigure(
        "10", "Andrews' mechanism: multipliers in physical units", "multipliers",
        curves=(*direct, compensated),
        claims=(
            *(SlopeClaim(curve, -2, 0.15) for curve in direct),
            SlopeClaim(compensated, -1, 0.15),
            RatioClaim("optimal / none, every h", ((optimal, none),), 0.5, 2),
            RatioClaim(
                "optimal, direct / compensated, h = 1e-07", ((optimal, compensated),), 1e4,
                at=(1e-7, 1e-7),
            ),
        ),
    )  # fmt: skip


def _error() -> StudyFigure:
    columns = ("error", "andrews", "lambda", "error")
    trapezoidal = tuple(
        Curve(f"trapezoidal, {variant}", *columns, preconditioning=variant)
        for variant in PAPER_VARIANTS
    )
    trapezoidal_compensated = Curve(
        "trapezoidal, compensated", *columns, preconditioning="optimal", evaluation="compensated"
    )
    direct, compensated = (
        Curve(
            f"generalized-α, {evaluation}", *columns, preconditioning="optimal",
            integrator=_GENERALIZED_ALPHA, evaluation=evaluation,
        )
        for evaluation in ("direct", "compensated")
    )  # fmt: skip
    return StudyFigure(
        "11", "Andrews' mechanism: error of the multipliers", "error",
        curves=(*trapezoidal, trapezoidal_compensated, direct, compensated),
        claims=(
            SlopeClaim(compensated, 2, 0.1),
            BoundClaim(compensated, high=5e-9, h=1e-7),
            BoundClaim(direct, low=1e-6, h=1e-7),
            RatioClaim(
                f"{direct.label}, h = 1e-07 / h = 1e-06", ((direct, direct),), 1, at=(1e-7, 1e-6)
            ),
            *(BoundClaim(curve, low=10, h=1e-6) for curve in trapezoidal),
        ),
    )  # fmt: skip


def _tolerance() -> StudyFigure:
    curves = _variants(
        "tolerance", "andrews", "newton", "tolerance",
        integrator=_GENERALIZED_ALPHA, stop="absolute 1e-08",
    )  # fmt: skip
    none, left, right, optimal = curves
    return StudyFigure(
        "12", "Andrews' mechanism: steps that meet ‖Δq̄‖ ≤ 10⁻⁸", "tolerance",
        curves=curves,
        claims=(
            *(BoundClaim(curve, low=1, high=1) for curve in (right, optimal)),
            *(BoundClaim(curve, high=0.5, h=1e-7) for curve in (none, left)),
        ),
        linear=True,
        note="generalized-α, ρ∞ = 0.9",
    )  # fmt: skip


def _krylov() -> StudyFigure:
    curves = _variants(
        "krylov", "random-chain(links=1000)", "jacobian", "krylov_iterations", linear_solver="gmres"
    )
    none, *_, optimal = curves
    return StudyFigure(
        "13", "1000 random links: GMRES iterations", "krylov",
        curves=curves,
        claims=(SpreadClaim(optimal, 0.3), StatusClaim(none, "stagnated")),
        linear=True,
    )  # fmt: skip


def _history() -> HistoryFigure:
    columns = ("history", "andrews", "lambda", "history")
    trapezoidal, compensated, damped = (
        Curve(
            label, *columns, preconditioning="optimal", integrator=integrator,
            evaluation=evaluation,
        )
        for label, integrator, evaluation in (
            ("trapezoidal, direct", TRAPEZOIDAL, "direct"),
            ("trapezoidal, compensated", TRAPEZOIDAL, "compensated"),
            ("generalized-α, direct", _GENERALIZED_ALPHA, "direct"),
        )
    )  # fmt: skip
    return HistoryFigure(
        "15", "Andrews' mechanism: a multiplier over time", "history", 1e-6,
        curves=(trapezoidal, compensated, damped),
        claims=(
            RatioClaim(
                f"max |λ|, {trapezoidal.label} / {damped.label}", ((trapezoidal, damped),), 100
            ),
        ),
    )  # fmt: skip


FIGURES: Mapping[str, Figure] = MappingProxyType(
    {
        figure.name: figure
        for figure in (
            OrderFigure(
                "1", "Pendulum, (u, λ) form: displacements",
                "pendulum-u", "pendulum", "u-lambda", "u", "correction", 0.15,
            ),
            OrderFigure(
                "2", "Pendulum, (u, λ) form: multiplier",
                "pendulum-u", "pendulum", "u-lambda", "lambda", "correction", 0.15,
            ),
            OrderFigure(
                "3", "Pendulum, (u, λ) form: condition number",
                "pendulum-u", "pendulum", "u-lambda", "jacobian", "condition", 0.02,
            ),
            OrderFigure(
                "4", "Pendulum, (v, λ) form: velocities",
                "pendulum-v", "pendulum", "v-lambda", "v", "correction", 0.15,
            ),
            OrderFigure(
                "5", "Pendulum, (a, λ) form: accelerations",
                "pendulum-a", "pendulum", "a-lambda", "a", "correction", 0.15,
            ),
            MechanismFigure("6", "Andrews' squeezing mechanism, initial position", "andrews"),
            OrderFigure(
                "7", "Andrews' mechanism, (u, λ) form: displacements",
                "andrews-u", "andrews", "u-lambda", "u", "correction", 0.1,
            ),
            OrderFigure(
                "8", "Andrews' mechanism, (u, λ) form: multipliers",
                "andrews-u", "andrews", "u-lambda", "lambda", "correction", 0.1,
            ),
            OrderFigure(
                "9", "Andrews' mechanism, (u, λ) form: condition number",
                "andrews-u", "andrews", "u-lambda", "jacobian", "condition", 0.05,
            ),
            SensitivityFigure(
                "sensitivity", "Andrews' mechanism: sensitivity of each unknown to each row",
                "sensitivity", "andrews", "u-v-a-lambda", 0.05,
            ),
            _multipliers(),
            _error(),
            _tolerance(),
            _krylov(),
            PrecisionFigure(
                "14", "Pendulum, (u, λ) form: single and double precision",
                "precision", "pendulum", "bdf2", "u-lambda", 4,
            ),
            _history(),
        )
    }
)  # fmt: skip
