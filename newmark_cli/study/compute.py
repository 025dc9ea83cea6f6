"""Marching a cell and measuring it."""

from collections.abc import Callable

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark import march_data, measures, perturbation
from newmark_cli.newmark.engine import march_with
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.initial import initial_state
from newmark_cli.newmark.invariants import Misfit, invariants
from newmark_cli.newmark.linear import choice, systems
from newmark_cli.newmark.linear.krylov import KrylovSystem
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.statistics import Measurement
from newmark_cli.problems.reference import Reference
from newmark_cli.study.cell import Cell, Outcome

#: Most steps between two signs of life; an interrupt waits for no longer.
_STRETCH = {choice.DENSE: 5_000, choice.SPARSE: 20, choice.GMRES: 1, choice.MINRES: 1}
_ENDINGS = {
    march_data.SINGULAR: "singular",
    march_data.DIVERGED: "diverged",
    march_data.STAGNATED: "stagnated",
}


def compute(
    cell: Cell,
    reference: Reference | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> Outcome:
    """March a cell and measure it.

    Args:
        cell: What to compute.
        reference: The solution at the end, where errors are measured; without one
            the errors are empty.
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
    system = systems.system(solver, subject, scheme, cell.krylov)
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
            sensitivities.append(perturbation.sensitivities(subject, scheme, time, here, system))

    sampled = set(measures.sample_steps(cell.steps, cell.samples).tolist())
    recorded: set[int] = set()
    if "history" in cell.measure:
        # An error that alternates from step to step shows in pairs of steps alone.
        recorded = sampled | {step - 1 for step in sampled if step > 1}
    longest = _STRETCH[solver]
    stops = sorted(sampled.union(recorded, range(longest, cell.steps, longest)))
    ending, done = march_data.COMPLETED, 0
    if cell.steps == 0:
        sample()
        on_steps(1)
    for stop in stops:
        stretch = slice(done, stop)
        ending, taken = march(subject, scheme, state, done, norms[stretch], iterations[stretch])
        done += taken
        on_steps(taken)
        if ending != march_data.COMPLETED:
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
