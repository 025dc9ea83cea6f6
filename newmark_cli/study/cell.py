"""One cell of a study: one problem, integrator, form, scaling and step size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark import kernel, linear, measures, sensitivity
from newmark_cli.newmark.engine import march_with
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.initial import initial_state
from newmark_cli.newmark.integrator import Integrator
from newmark_cli.newmark.invariants import Misfit, invariants
from newmark_cli.newmark.kernel import State
from newmark_cli.newmark.krylov import Krylov, KrylovSystem
from newmark_cli.newmark.measures import Measurement
from newmark_cli.newmark.scaling import Preconditioning
from newmark_cli.newmark.scheme import DIRECT, Scheme, Tolerance
from newmark_cli.problems.reference import Reference
from newmark_cli.problems.spec import ProblemSpec

#: Statuses of a cell, from good to bad.
STATUSES = ("ok", "not_converged", "stagnated", "singular", "diverged", "failed")
#: Most steps between two signs of life; an interrupt waits for no longer.
_STRETCH = {linear.DENSE: 5_000, linear.SPARSE: 20, linear.GMRES: 1, linear.MINRES: 1}
_ENDINGS = {
    kernel.SINGULAR: "singular",
    kernel.DIVERGED: "diverged",
    kernel.STAGNATED: "stagnated",
}


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
    linear_solver: str = linear.AUTO
    evaluation: str = DIRECT
    precision: str = "float64"
    stop: Tolerance | None = None
    accept: tuple[str, ...] = ()
    krylov: Krylov | None = None

    @property
    def solver(self) -> str:
        """The linear solver that is used; the problem's size decides where it may."""
        return linear.choose(self.linear_solver, self.problem.load(), FORMS[self.form])

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
    """

    measurements: list[Measurement]
    not_converged: int
    newton_iterations: float
    status: str
    reason: str = ""
    met: int | None = None
    history: Sequence[tuple[int, Array]] = ()


@dataclass(frozen=True)
class Done:
    """A cell that has ended.

    Attributes:
        outcome: What it found.
        seconds: Its wall time (s).
    """

    outcome: Outcome
    seconds: float


def run(
    cell: Cell,
    reference: Reference | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> Outcome:
    """March a cell and measure it.

    Args:
        cell: What to compute.
        reference: The solution at the end, where errors are measured.
        on_steps: Told how many steps were done, now and then; an exception
            that it raises ends the march.
    """
    form = FORMS[cell.form]
    scheme = Scheme(
        cell.integrator,
        form,
        cell.preconditioning.scaling(form),
        cell.h,
        cell.iteration_cap,
        cell.evaluation,
        cell.precision,
        cell.stop,
    )
    subject = cell.problem.load()
    solver = cell.solver
    system = linear.system(solver, subject, scheme, cell.krylov)
    march = march_with(solver, subject, system)
    state = initial_state(subject, scheme)
    norms = np.zeros((cell.steps, len(form.unknowns)))
    iterations = np.zeros(cell.steps, np.int64)
    conditions: list[float] = []
    sensitivities: list[dict[tuple[str, str], float]] = []
    history: list[tuple[int, Array]] = []
    misfits: list[dict[str, Misfit]] = []

    def sample() -> None:
        time = subject.t0 + done * cell.h
        # Whatever the march's precision, its state is looked at in double.
        here = State(*(array.astype(float) for array in state))
        if "condition" in cell.measure:
            conditions.append(system.balanced(time, here).condition())
        if "invariant" in cell.measure:
            misfits.append(invariants(subject, time, here))
        if "sensitivity" in cell.measure:
            sensitivities.append(sensitivity.sensitivities(subject, scheme, time, here, system))

    sampled = set(measures.sample_steps(cell.steps, cell.samples).tolist())
    recorded: set[int] = set()
    if "history" in cell.measure:
        # An error that alternates from step to step shows in pairs of steps alone.
        recorded = sampled | {step - 1 for step in sampled if step > 1}
    longest = _STRETCH[solver]
    stops = sorted(sampled.union(recorded, range(longest, cell.steps, longest)))
    ending, done = kernel.COMPLETED, 0
    if cell.steps == 0:
        sample()
        on_steps(1)
    for stop in stops:
        stretch = slice(done, stop)
        ending, taken = march(subject, scheme, state, done, norms[stretch], iterations[stretch])
        done += taken
        on_steps(taken)
        if ending != kernel.COMPLETED:
            break
        if stop in recorded:
            history.append((stop, state.multipliers.astype(float)))
        if stop in sampled:
            sample()

    found: list[Measurement] = []
    if "correction" in cell.measure:
        found += measures.corrections(scheme, norms[:done], iterations[:done])
    if "condition" in cell.measure:
        found.append(measures.condition(np.array(conditions)))
    if "sensitivity" in cell.measure:
        found += measures.sensitivities(sensitivities)
    if "error" in cell.measure and done == cell.steps:
        assert reference is not None
        found += measures.errors(reference, state)
    if "invariant" in cell.measure:
        found += measures.invariants(misfits)
    if isinstance(system, KrylovSystem) and "krylov" in cell.measure:
        found += measures.krylov(system.iterations, system.residuals)
    if "tolerance" in cell.measure:
        found.append(measures.newton(iterations[:done]))
    if "history" in cell.measure:
        found.append(measures.history([multipliers for _, multipliers in history]))
    not_converged = int(np.count_nonzero(iterations[:done] < 0))
    return Outcome(
        measurements=found,
        not_converged=not_converged,
        newton_iterations=float(np.mean(np.abs(iterations[:done]))) if done else np.nan,
        status=_ENDINGS.get(ending, "not_converged" if not_converged else "ok"),
        met=done - not_converged if cell.stop else None,
        history=history,
    )
