"""The figures of the paper as entries: what each shows, and the data it draws.

Nothing here draws; see `newmark_cli.report.draw`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from newmark_cli.newmark.scaling import PAPER_VARIANTS


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
    def unit(self) -> str:
        """Unit of h; the pendulum has unit mass, length and gravity."""
        return "" if self.problem == "pendulum" else " (s)"


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


Figure = OrderFigure | MechanismFigure | SensitivityFigure

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
        )
    }
)  # fmt: skip
