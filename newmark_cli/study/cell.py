"""One cell of a study: one problem, integrator, form, scaling and step size."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from newmark_cli.arrays import Array
from newmark_cli.mechanisms.spec import ProblemSpec
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Integrator
from newmark_cli.newmark.linear.choice import AUTO, Krylov, choose
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.newmark.scheme import DIRECT, Tolerance
from newmark_cli.newmark.statistics import Measurement

#: Statuses of a cell, from good to bad.
STATUSES = ("ok", "not_converged", "stagnated", "singular", "diverged", "failed")


@dataclass(frozen=True)
class Cell:
    """What one cell computes; steps = 0 measures at the consistent initial state."""

    problem: ProblemSpec
    integrator: Integrator
    form: str
    preconditioning: Preconditioning
    h: float
    t_end: float
    steps: int
    measure: tuple[str, ...]
    iteration_cap: int
    samples: int
    linear_solver: str = AUTO
    evaluation: str = DIRECT
    precision: str = "float64"
    stop: Tolerance | None = None
    #: Decides what a run complains about; no part of what is computed.
    accept: tuple[str, ...] = field(default=(), compare=False)
    krylov: Krylov | None = None

    @property
    def solver(self) -> str:
        """The linear solver that is used; the problem's size decides where it may."""
        return choose(self.linear_solver, self.problem.load(), FORMS[self.form])

    @property
    def labels(self) -> dict[str, Any]:
        """What tells a cell from others, by the CSV's columns."""
        return {
            "problem": self.problem.label,
            "integrator": self.integrator.label,
            "form": self.form,
            "preconditioning": self.preconditioning.label,
            "evaluation": self.evaluation,
            "precision": self.precision,
            "linear_solver": self.solver,
            "h": self.h,
        }

    @property
    def weight(self) -> int:
        """Steps, as progress counts them; never zero."""
        return max(self.steps, 1)


@dataclass(frozen=True)
class Outcome:
    """What a cell found.

    Attributes:
        measurements: In the order of the CSV's rows.
        not_converged: Steps that ended above the terminal-phase threshold.
        newton_iterations: Corrections computed per step, mean; NaN without steps.
        status: One of `STATUSES`.
        reason: Why, where the status is failed.
        met: Steps that met the tolerance; None where rounding stops Newton.
        history: Rows of the time series, see `newmark_cli.study.results.history_rows`.
        lacks: Why rows of the CSV are empty although the march reached its end: the
            reason for each thing that was not to be had, such as a reference.
    """

    measurements: list[Measurement]
    not_converged: int
    newton_iterations: float
    status: str
    reason: str = ""
    met: int | None = None
    history: Sequence[tuple[int, Array]] = ()
    lacks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Done:
    """A cell that has ended.

    Attributes:
        outcome: What it found.
        seconds: Its wall time (s).
    """

    outcome: Outcome
    seconds: float
