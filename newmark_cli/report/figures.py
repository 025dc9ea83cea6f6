"""The figures as entries: what each shows, the series it draws, and what they must show.

Figures 1 to 9 are the paper's.  Their kinds stand in `newmark_cli.report.kinds`.
"""

from collections.abc import Mapping
from types import MappingProxyType

from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.scaling import PAPER_VARIANTS
from newmark_cli.report import cure_table, cures
from newmark_cli.report.curves import TRAPEZOIDAL, Curve
from newmark_cli.report.kinds import (
    Figure,
    HistoryFigure,
    MechanismFigure,
    OrderFigure,
    PrecisionFigure,
    SensitivityFigure,
    StudyFigure,
    variants,
)

_GENERALIZED_ALPHA = GeneralizedAlpha(0.9).label


def _multipliers() -> StudyFigure:
    columns = ("multipliers", "andrews", "lambda", "physical_correction")
    direct = variants(*columns)
    compensated = Curve(
        "optimal, compensated", *columns, preconditioning="optimal", evaluation="compensated"
    )
    return StudyFigure(
        "10", "Andrews' mechanism: multipliers in physical units", "multipliers",
        curves=(*direct, compensated),
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
    )  # fmt: skip


def _tolerance() -> StudyFigure:
    curves = variants(
        "tolerance", "andrews", "newton", "tolerance",
        integrator=_GENERALIZED_ALPHA, stop="absolute 1e-08",
    )  # fmt: skip
    return StudyFigure(
        "12", "Andrews' mechanism: steps that meet ‖Δq̄‖ ≤ 10⁻⁸", "tolerance",
        curves=curves,
        linear=True,
        note="generalized-α, ρ∞ = 0.9",
    )  # fmt: skip


def _krylov() -> StudyFigure:
    curves = variants(
        "krylov", "random-chain(links=1000)", "jacobian", "krylov_iterations", linear_solver="gmres"
    )
    return StudyFigure(
        "13", "1000 random links: GMRES iterations", "krylov",
        curves=curves,
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
    )  # fmt: skip


_FIGURES: dict[str, Figure] = {
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
        MechanismFigure(
            "6", "Andrews' squeezing mechanism, initial position", "andrews-u", "andrews"
        ),
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
        cures.error_figure(),
        cures.work_figure(),
        cures.drift_figure(),
        cure_table.figure(),
    )
}  # fmt: skip

#: The figures by name.
FIGURES: Mapping[str, Figure] = MappingProxyType(_FIGURES)

#: Shipped studies that are made into tables: figures of them are drawn when asked for.
TABLED = ("all-forms", "integrators")
