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
        number: Number in the paper.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, form, quantity, measure: Which rows.
        tolerance: Largest |fitted − predicted slope|.
        variants: Series, in the order of the legend.
    """

    number: int
    title: str
    study: str
    problem: str
    form: str
    quantity: str
    measure: str
    tolerance: float
    variants: tuple[str, ...] = PAPER_VARIANTS


@dataclass(frozen=True)
class MechanismFigure:
    """A mechanism in its initial position; read from the problem's definition.

    Attributes:
        number: Number in the paper.
        title: What it shows.
        problem: Which mechanism.
    """

    number: int
    title: str
    problem: str


FIGURES: Mapping[int, OrderFigure | MechanismFigure] = MappingProxyType(
    {
        figure.number: figure
        for figure in (
            OrderFigure(
                1, "Pendulum, (u, λ) form: displacements",
                "pendulum-u", "pendulum", "u-lambda", "u", "correction", 0.15,
            ),
            OrderFigure(
                2, "Pendulum, (u, λ) form: multiplier",
                "pendulum-u", "pendulum", "u-lambda", "lambda", "correction", 0.15,
            ),
            OrderFigure(
                3, "Pendulum, (u, λ) form: condition number",
                "pendulum-u", "pendulum", "u-lambda", "jacobian", "condition", 0.02,
            ),
            OrderFigure(
                4, "Pendulum, (v, λ) form: velocities",
                "pendulum-v", "pendulum", "v-lambda", "v", "correction", 0.15,
            ),
            OrderFigure(
                5, "Pendulum, (a, λ) form: accelerations",
                "pendulum-a", "pendulum", "a-lambda", "a", "correction", 0.15,
            ),
            MechanismFigure(6, "Andrews' squeezing mechanism, initial position", "andrews"),
            OrderFigure(
                7, "Andrews' mechanism, (u, λ) form: displacements",
                "andrews-u", "andrews", "u-lambda", "u", "correction", 0.1,
            ),
            OrderFigure(
                8, "Andrews' mechanism, (u, λ) form: multipliers",
                "andrews-u", "andrews", "u-lambda", "lambda", "correction", 0.1,
            ),
            OrderFigure(
                9, "Andrews' mechanism, (u, λ) form: condition number",
                "andrews-u", "andrews", "u-lambda", "jacobian", "condition", 0.05,
            ),
        )
    }
)  # fmt: skip
