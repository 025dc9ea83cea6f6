"""Series of a study, as figures and claims name them."""

from collections.abc import Mapping
from dataclasses import dataclass

from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.linear.choice import DENSE

TRAPEZOIDAL = Newmark().label

#: Columns of the CSV that tell the series of all studies apart.
KEY = (
    "study", "problem", "quantity", "measure", "form", "preconditioning", "integrator",
    "evaluation", "precision", "linear_solver", "stop", "row_block",
)  # fmt: skip


@dataclass(frozen=True)
class Curve:
    """One series, and its name in a legend.

    Attributes:
        label: Name in a legend and in claims.
        study, problem, quantity, measure, form, preconditioning, integrator, evaluation,
        precision, linear_solver, stop, row_block: As in the CSV.
    """

    label: str
    study: str
    problem: str
    quantity: str
    measure: str
    form: str = "u-lambda"
    preconditioning: str = "none"
    integrator: str = TRAPEZOIDAL
    evaluation: str = "direct"
    precision: str = "float64"
    linear_solver: str = DENSE
    stop: str = "saturation"
    row_block: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """Its values in the columns of `KEY`."""
        return tuple(getattr(self, column) for column in KEY)


def key_of(row: Mapping[str, str]) -> tuple[str, ...]:
    """Values of a row of the CSV in the columns of `KEY`."""
    return tuple(row[column] for column in KEY)
