"""What is made of raw corrections: physical units, eliminated fields, statistics.

The march returns, for each step, the norms of the recorded correction's blocks
in the unknowns the solver sees.  What becomes of them is decided here.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.invariants import Misfit
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.statistics import Measurement, statistics
from newmark_cli.problems.reference import Reference, relative_error


def corrections(scheme: Scheme, norms: Array, iterations: IndexArray) -> list[Measurement]:
    """Measurements of the recorded Newton corrections.

    Physical corrections are D_R times the scaled ones; an eliminated field's
    follows from the weights of the form, one kept field each.

    Args:
        scheme: The scheme that was marched.
        norms: (steps, p + 1) norms of the scaled blocks.
        iterations: (steps,) corrections computed; steps with a negative count
            did not converge and are left out.
    """
    counted = norms[iterations > 0]
    form = scheme.form
    scaled = dict(zip(form.unknowns, counted.T, strict=True))
    right = dict(zip(form.unknowns, scheme.right, strict=True))
    physical = {unknown: right[unknown] * scaled[unknown] for unknown in form.unknowns}
    for field in form.eliminated:
        weights = np.abs(scheme.elimination.weights[FIELDS.index(field)])
        source = int(np.argmax(weights))
        physical[field] = weights[source] * physical[form.kept[source]]

    found = [
        Measurement(unknown, "correction", "primary", statistics(scaled[unknown]))
        for unknown in form.unknowns
    ]
    for quantity in (*FIELDS, "lambda"):
        role = "recovered" if quantity in form.eliminated else "primary"
        found.append(
            Measurement(quantity, "physical_correction", role, statistics(physical[quantity]))
        )
    return found


def condition(values: Array) -> Measurement:
    """Measurement of condition numbers at the sampled states; shape (samples,)."""
    return Measurement("jacobian", "condition", "primary", statistics(values))


def history(multipliers: Sequence[Array]) -> Measurement:
    """Measurement of max|λ| over the recorded steps; multipliers (m,) each."""
    largest = np.array([np.abs(values).max() for values in multipliers])
    return Measurement("lambda", "history", "primary", statistics(largest))


def newton(iterations: IndexArray) -> Measurement:
    """Measurement of the Newton corrections computed in each step; shape (steps,)."""
    return Measurement("newton", "tolerance", "primary", statistics(np.abs(iterations) * 1.0))


def krylov(iterations: Sequence[int], residuals: Sequence[float]) -> list[Measurement]:
    """Measurements of a Krylov solver over all solves.

    Args:
        iterations, residuals: Of each; see `newmark_cli.newmark.linear.krylov.KrylovSystem`.
    """
    return [
        Measurement("jacobian", measure, "primary", statistics(np.array(values, float)))
        for measure, values in (("krylov_iterations", iterations), ("krylov_residual", residuals))
    ]


def sensitivities(samples: Sequence[Mapping[tuple[str, str], float]]) -> list[Measurement]:
    """Measurements of `newmark_cli.newmark.perturbation` at the sampled states."""
    return [
        Measurement(
            unknown,
            "sensitivity",
            "primary",
            statistics(np.array([sample[row, unknown] for sample in samples])),
            row,
        )
        for row, unknown in (samples[0] if samples else ())
    ]


def errors(reference: Reference | None, state: State) -> list[Measurement]:
    """Measurements of a final state's errors, largest component over largest component.

    Args:
        reference: The solution at the state's time; None where there is none to be
            had, and the statistics are empty.
        state: The state.
    """
    found: dict[str, list[float]] = {"u": [], "v": [], "lambda": []}
    if reference is not None:
        found["u"].append(relative_error(state.fields[0], reference.u))
        found["v"].append(relative_error(state.fields[1], reference.v))
        found["lambda"].append(relative_error(state.multipliers, reference.multipliers))
    return [
        Measurement(quantity, "error", "primary", statistics(np.array(values)))
        for quantity, values in found.items()
    ]


def invariants(samples: Sequence[Mapping[str, Misfit]]) -> list[Measurement]:
    """Measurements of `newmark_cli.newmark.invariants` at the sampled states.

    Each error is divided by the largest size among the samples; 0 where all vanish.
    """
    found = []
    for name in samples[0] if samples else ():
        misfit, sizes = np.array([sample[name] for sample in samples]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(misfit == 0, 0.0, misfit / sizes.max())
        found.append(Measurement(name, "invariant", "primary", statistics(relative)))
    return found


def sample_steps(steps: int, samples: int) -> IndexArray:
    """Up to ``samples`` evenly spread steps, counted from 1, the last among them."""
    return np.unique(np.round(np.linspace(0, steps, min(steps, samples) + 1)[1:]).astype(np.int64))
