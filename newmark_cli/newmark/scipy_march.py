"""The Newton march in plain SciPy: the same algorithm as the kernel, easy to read.

It is the reference that the kernel is tested against, and the march of problems
whose linear systems are not solved by the kernel.
"""

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.jacobian import DenseSystem
from newmark_cli.newmark.kernel import COMPLETED, DIVERGED, SINGULAR, State
from newmark_cli.newmark.linear import LinearSystem
from newmark_cli.newmark.scheme import SETTLED_BELOW, Scheme
from newmark_cli.problems.problem import Problem


class _Step:
    """One time step: what is fixed while Newton iterates."""

    def __init__(self, scheme: Scheme, system: LinearSystem, past: Array) -> None:
        self.scheme = scheme
        self.system = system
        self.past = past
        tables = scheme.tables
        self.field_history = tables.past_weights @ past
        self.dynamic_history = system.times_mass(tables.dynamic_past @ past)
        self.row_history = tables.row_past @ past

    def predicted(self) -> Array:
        """(3, n) u = u_n + h v_n, and v, a that the update relations give with it."""
        return np.asarray(self.scheme.tables.predictor @ self.past)

    def recover(self, fields: Array) -> None:
        """Evaluate the eliminated fields afresh from the kept ones."""
        tables = self.scheme.tables
        for field, name in enumerate(FIELDS):
            if name in self.scheme.form.kept:
                continue
            fields[field] = self.field_history[field]
            for k, source in enumerate(tables.kept):
                if weight := tables.weights[field, k]:
                    origin = self.past[tables.own_past[k]] if tables.differenced[field] else 0.0
                    fields[field] += weight * (fields[source] - origin)

    def residual(self, fields: Array, force: Array, phi: Array) -> list[Array]:
        """Row blocks of b: D, the kept ones of V and K, C."""
        tables = self.scheme.tables
        kept = fields[tables.kept]
        dynamics = self.system.times_mass(tables.dynamic_weights @ kept)
        return [
            dynamics + self.dynamic_history - force,
            *(tables.row_weights @ kept + self.row_history),
            phi,
        ]


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
    system: LinearSystem | None = None,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps; the arguments are the kernel's.

    Args:
        problem, scheme: What to march.
        state: Overwritten.
        first: Steps taken since the initial time.
        norms: (steps, p + 1) overwritten with the norms of the recorded
            correction's blocks, in the scaled unknowns.
        iterations: (steps,) overwritten with the corrections computed, negative
            where the step did not converge.
        system: Linear system of the scheme on the problem; dense when omitted.

    Returns:
        How the march ended and the steps done.
    """
    system = system or DenseSystem(problem, scheme)
    tables, n = scheme.tables, problem.n
    splits = [n * (k + 1) for k in range(len(tables.kept))]
    fields, multipliers = state.fields, state.multipliers
    for s in range(len(norms)):
        t = problem.t0 + (first + s + 1) * scheme.h
        step = _Step(scheme, system, state.past.copy())
        fields[:3] = step.predicted()
        previous, settled, solves = np.inf, 0, 0
        while solves < scheme.iteration_cap:
            values = problem.values(t, fields[0], fields[1], multipliers)
            b = step.residual(fields, values.force, values.phi)
            rhs = -np.concatenate([f * row for f, row in zip(scheme.left, b, strict=True)])
            try:
                correction = system.solve(values, rhs)
            except np.linalg.LinAlgError:
                return SINGULAR, s
            solves += 1
            norm = float(np.linalg.norm(correction))
            if not np.isfinite(norm):
                return DIVERGED, s
            if settled >= 2 and norm >= previous:
                break
            previous = norm

            blocks = np.split(correction, splits)
            norms[s] = [np.linalg.norm(block) for block in blocks]
            for source, block, factor in zip(tables.kept, blocks, scheme.right, strict=False):
                fields[source] += factor * block
            multipliers += scheme.right[-1] * blocks[-1]
            step.recover(fields)
            displacement = np.linalg.norm(tables.weights[0] * scheme.right[:-1] * norms[s, :-1])
            small = displacement < SETTLED_BELOW * np.linalg.norm(fields[0])
            settled = settled + 1 if small or norm == 0 else 0
            if norm == 0:
                break
        iterations[s] = solves if settled else -solves
        fields[3] = tables.acceleration[0] * fields[2] + tables.acceleration[1:] @ state.past
        state.past[:] = np.concatenate([fields, state.past])[tables.advance]
    return COMPLETED, len(norms)
