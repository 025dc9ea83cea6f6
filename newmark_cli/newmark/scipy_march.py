"""The Newton march in plain SciPy: the kernel's algorithm and verbs, on whole vectors.

It is the reference that the kernel is tested against, and the march of problems
whose linear systems are not solved by the kernel.
"""

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.linear.choice import Stagnation
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.systems import LinearSystem
from newmark_cli.newmark.march_data import (
    COMPLETED,
    DIVERGED,
    SINGULAR,
    STAGNATED,
    Record,
    State,
)
from newmark_cli.newmark.scheme import Scheme, Tolerance
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

    def predict(self, moving: Array) -> None:
        """Set u = u_n + h v_n, and v and a to what the update relations give with it."""
        moving[:] = self.scheme.tables.predictor @ self.past

    def residual(self, moving: Array, force: Array, phi: Array) -> list[Array]:
        """Row blocks of b: D, the kept ones of V and K, C."""
        tables = self.scheme.tables
        kept = moving[tables.kept]
        dynamics = self.system.times_mass(tables.dynamic_weights @ kept)
        return [
            dynamics + self.dynamic_history - force,
            *(tables.row_weights @ kept + self.row_history),
            phi,
        ]

    def right_hand_side(self, moving: Array, force: Array, phi: Array) -> Array:
        """(N,) −D_L b."""
        blocks = zip(self.scheme.left, self.residual(moving, force, phi), strict=True)
        return np.asarray(-np.concatenate([factor * row for factor, row in blocks]))

    def correct(self, correction: Array, moving: Array, multipliers: Array) -> list[Array]:
        """Apply the correction (N,); return its blocks, one for each unknown."""
        tables, right = self.scheme.tables, self.scheme.right
        n, p = moving.shape[1], len(tables.kept)
        blocks = np.split(correction, [n * (k + 1) for k in range(p)])
        for source, block, factor in zip(tables.kept, blocks, right, strict=False):
            moving[source] += factor * block
        multipliers += right[-1] * blocks[-1]
        return blocks

    def recover(self, moving: Array) -> None:
        """Evaluate the eliminated fields afresh from the kept ones."""
        tables = self.scheme.tables
        for field, name in enumerate(FIELDS):
            if name in self.scheme.form.kept:
                continue
            moving[field] = self.field_history[field]
            for k, source in enumerate(tables.kept):
                if weight := tables.weights[field, k]:
                    origin = self.past[source] if tables.differenced[field] else 0.0
                    moving[field] += weight * (moving[source] - origin)

    def is_small(self, norm: float, norms: Array, state: State) -> bool:
        """Whether a correction is in the terminal phase, or meets the tolerance.

        Args:
            norm: Norm of the whole correction.
            norms: (p + 1,) norms of its blocks.
            state: With the correction applied.
        """
        scheme = self.scheme
        if scheme.stop is not None:
            return norm <= _limit(scheme, scheme.stop, state)
        displacement = np.linalg.norm(scheme.tables.weights[0] * scheme.right[:-1] * norms[:-1])
        threshold = scheme.settled_below * np.linalg.norm(state.fields[0])
        return norm == 0 or bool(displacement < threshold)

    def advance(self, moving: Array, fields: Array) -> Array:
        """(P, n) what the past vectors become; sets v', the last of the fields."""
        scheme, tables = self.scheme, self.scheme.tables
        fields[3] = tables.acceleration[0] * fields[2] + tables.acceleration[1:] @ self.past
        if scheme.compensated:
            increments = moving[:2]
        else:
            u_n, v_n = self.past[:2]
            increments = np.array([fields[0] - u_n - scheme.h * v_n, fields[1] - v_n])
        return np.asarray(np.concatenate([fields, increments])[tables.advance])


class _Compensated:
    """Carries u and v as sums of two numbers and Φ by its exact increments.

    Attributes:
        state: The march's.
        h: Step size (s).
        g: Values of G at the beginning of the step.
    """

    def __init__(self, problem: Problem, state: State, t: float, h: float) -> None:
        self.problem, self.state, self.h = problem, state, h
        self.g = problem.values(t, state.past[0], state.past[1], state.multipliers).g

    def shift(self, moving: Array) -> Array:
        """(n,) Δ = h v_n + w."""
        past, lows = self.state.past, self.state.lows
        return np.asarray(self.h * past[1] + (self.h * lows[1] + moving[0]))

    def take(self, moving: Array) -> None:
        """Set u, v and a to what the increments lead to."""
        past, lows, fields = self.state.past, self.state.lows, self.state.fields
        fields[0] = past[0] + (lows[0] + self.shift(moving))
        fields[1] = past[1] + (lows[1] + moving[1])
        fields[2] = moving[2]

    def phi(self, moving: Array, g: Array) -> Array:
        """(m,) Φ_n + G(u_n + Δ/2)ᵀ Δ; G is affine in u, so its value midway is the mean."""
        pattern = self.problem.pattern
        increase = 0.5 * (self.g + g) * self.shift(moving)[pattern.g_rows]
        change = np.bincount(pattern.g_columns, increase, minlength=self.problem.m)
        return np.asarray(self.state.phi + change)

    def end_step(self, t: float, moving: Array, new_past: Array) -> None:
        """Carry Φ, G and the rounding errors of u and v over to the next step."""
        fields, lows = self.state.fields, self.state.lows
        g = self.problem.values(t, fields[0], fields[1], self.state.multipliers).g
        self.state.phi[:] = self.phi(moving, g)
        self.g = g
        for field, increment in enumerate((self.shift(moving), moving[1])):
            high, added = self.state.past[field], lows[field] + increment
            new_past[field] = high + added
            # Knuth's two-sum: what the addition lost.
            of_added = new_past[field] - high
            lows[field] = (high - (new_past[field] - of_added)) + (added - of_added)


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
    system: LinearSystem | None = None,
    record: Record | None = None,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps; the arguments are the kernel's.

    Args:
        problem, scheme: What to march.
        state: Overwritten.
        first: Steps taken since the initial time.
        norms: (steps, p + 1) overwritten with the norms of the recorded
            correction's blocks, in the scaled unknowns.
        iterations: (steps,) overwritten with the corrections computed, negative
            where the step did not converge, or missed the tolerance.
        system: Linear system of the scheme on the problem; dense when omitted.
        record: Overwritten with the states after the steps that it names.

    Returns:
        How the march ended and the steps done.
    """
    system = system or DenseSystem(problem, scheme)
    fields, multipliers = state.fields, state.multipliers
    carried = (
        _Compensated(problem, state, problem.t0 + first * scheme.h, scheme.h)
        if scheme.compensated
        else None
    )
    # What Newton iterates on: the fields, or their increments over the step.
    moving = np.empty((3, problem.n)) if carried else fields[:3]
    places = {} if record is None else {int(s): k for k, s in enumerate(record.steps)}
    for s in range(len(norms)):
        t = problem.t0 + (first + s + 1) * scheme.h
        step = _Step(scheme, system, state.past.copy())
        step.predict(moving)
        if carried:
            carried.take(moving)
        previous, settled, solves = np.inf, 0, 0
        while solves < scheme.iteration_cap:
            values = problem.values(t, fields[0], fields[1], multipliers)
            phi = carried.phi(moving, values.g) if carried else values.phi
            try:
                correction = system.solve(values, step.right_hand_side(moving, values.force, phi))
            except Stagnation:
                return STAGNATED, s
            except np.linalg.LinAlgError:
                return SINGULAR, s
            solves += 1
            norm = float(np.linalg.norm(correction))
            if not np.isfinite(norm):
                return DIVERGED, s
            if settled >= 2 and norm >= previous and scheme.stop is None:
                break
            previous = norm
            blocks = step.correct(correction, moving, multipliers)
            norms[s] = [np.linalg.norm(block) for block in blocks]
            step.recover(moving)
            if carried:
                carried.take(moving)
            small = step.is_small(norm, norms[s], state)
            settled = settled + 1 if small else 0
            if small and (norm == 0 or scheme.stop is not None):
                break
        iterations[s] = solves if settled else -solves
        new_past = step.advance(moving, fields)
        if carried:
            carried.end_step(t, moving, new_past)
        state.past[:] = new_past
        if record is not None and s in places:
            record.fields[places[s]], record.multipliers[places[s]] = fields, multipliers
    return COMPLETED, len(norms)


def _limit(scheme: Scheme, stop: Tolerance, state: State) -> float:
    """Norm of the scaled correction at which Newton stops."""
    kept = state.fields[scheme.tables.kept] / scheme.right[:-1, None]
    size = np.hypot(np.linalg.norm(kept), np.linalg.norm(state.multipliers / scheme.right[-1]))
    return float(stop.absolute + stop.relative * size)
