"""The Newton march in plain SciPy: the kernel's algorithm and verbs, on whole vectors.

It is the reference that the kernel is tested against, and the march of problems
whose linear systems are not solved by the kernel.
"""

from collections.abc import Iterable

import numpy as np

from newmark_cli import algebra
from newmark_cli.arrays import Array, IndexArray
from newmark_cli.newmark.constraints import Constraining, Tangents
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.linear.choice import Stagnation
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.systems import LinearSystem
from newmark_cli.newmark.march_data import (
    COMPLETED,
    DIVERGED,
    MOST_POSITIONS,
    SINGULAR,
    STAGNATED,
    Record,
    State,
)
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import ConstraintRows, Problem, Values


class _Step:
    """One time step: what is fixed while Newton iterates."""

    def __init__(self, scheme: Scheme, system: LinearSystem, past: Array) -> None:
        self.scheme = scheme
        self.system = system
        self.past = past
        tables = scheme.tables
        self.field_history = algebra.product(tables.past_weights, past)
        self.dynamic_history = system.times_mass(algebra.product(tables.dynamic_past, past))
        self.row_history = algebra.product(tables.row_past, past)

    def predict(self, moving: Array) -> None:
        """Set u = u_n + h v_n, and v and a to what the update relations give with it."""
        moving[:] = algebra.product(self.scheme.tables.predictor, self.past)

    def residual(self, moving: Array, force: Array) -> list[Array]:
        """Row blocks of b: D and the kept ones of V and K."""
        tables = self.scheme.tables
        kept = moving[tables.kept]
        dynamics = self.system.times_mass(algebra.product(tables.dynamic_weights, kept))
        return [
            dynamics + self.dynamic_history - force,
            *(algebra.product(tables.row_weights, kept) + self.row_history),
        ]

    def right_hand_side(self, rows: Iterable[Array]) -> Array:
        """(N,) −D_L b from its row blocks."""
        blocks = zip(self.scheme.left, rows, strict=True)
        return np.asarray(-np.concatenate([factor * row for factor, row in blocks]))

    def correct(self, correction: Array, moving: Array, multipliers: Array) -> list[Array]:
        """Apply the correction (N,); return its blocks, one for each unknown."""
        tables, right = self.scheme.tables, self.scheme.right
        blocks = self.blocks(correction)
        p = len(tables.kept)
        for source, block, factor in zip(tables.kept, blocks, right, strict=False):
            moving[source] += factor * block
        if len(blocks) > p:
            multipliers += right[p] * blocks[p]
        return blocks

    def blocks(self, correction: Array) -> list[Array]:
        """A correction (N,), block by block."""
        n, m = self.past.shape[1], self.system.problem.m
        sizes = self.scheme.form.sizes(n, m)
        return np.split(correction, np.cumsum(sizes)[:-1])

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
            norms: Norms of its blocks, the kept fields first.
            state: With the correction applied.
        """
        scheme = self.scheme
        if scheme.stop is not None:
            return norm <= _limit(scheme, scheme.stop, state)
        p = len(scheme.tables.kept)
        displacement = algebra.norm(scheme.tables.weights[0] * scheme.right[:p] * norms[:p])
        threshold = scheme.settled_below * algebra.norm(state.fields[0])
        return norm == 0 or bool(displacement < threshold)

    def form_acceleration(self, fields: Array) -> None:
        """Set v', the last of the fields, from the new a and the past."""
        tables = self.scheme.tables
        fields[3] = tables.acceleration[0] * fields[2] + algebra.product(
            tables.acceleration[1:], self.past
        )

    def advance(self, moving: Array, fields: Array) -> Array:
        """(P, n) what the past vectors become."""
        scheme, tables = self.scheme, self.scheme.tables
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
        return self.state.phi + self.problem.along(0.5 * (self.g + g), self.shift(moving))

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


class _Formulated:
    """A formulation beside index 3, or a projection, while a step is taken.

    Attributes:
        eta: (m,) η.
        directions: Terms of P.
    """

    def __init__(
        self, constraining: Constraining, state: State, carried: _Compensated | None
    ) -> None:
        self.constraining, self.state, self.carried = constraining, state, carried
        self.problem, self.scheme = constraining.problem, constraining.scheme
        self._index_1 = Index1(self.problem)
        self._done = np.zeros(len(self.scheme.recorded), bool)
        self._last = np.zeros(len(self.scheme.recorded))

    def begin_step(self, t: float) -> None:
        """Set η = 0, and P and R to those at the beginning of the step."""
        u, v = self.state.past[:2]
        self.eta = np.zeros(self.problem.m)
        g = self.problem.values(t, u, v, self.state.multipliers).g
        self.directions = self.constraining.directions(g)
        if self.carried and self.constraining.rated:
            self._r_old = self.problem.constraint_rows(t, u, v, self.state.fields[3]).r
        self._phi: Array | None = None

    def _push(self) -> Array:
        """(n,) Pη."""
        return self.constraining.pushed(self.directions, self.eta)

    def _constraints(self, t: float, moving: Array, multipliers: Array) -> tuple[Values, Array]:
        """The problem at the iterate, and Φ as it is evaluated."""
        u, v = self.state.fields[:2]
        values = self.problem.values(t, u, v, multipliers)
        return values, self.carried.phi(moving, values.g) if self.carried else values.phi

    def rate(self, t: float, moving: Array) -> Array:
        """(m,) Gᵀv + Φ_t; compensated: Ψ_n + ½(G_n + G)ᵀν + ½(R_n + R)Δ."""
        u, v, _, acceleration = self.state.fields
        g = self.problem.values(t, u, v, self.state.multipliers).g
        found = self.problem.constraint_rows(t, u, v, acceleration)
        return self._rate(moving, g, found)

    def _rate(self, moving: Array, g: Array, found: ConstraintRows) -> Array:
        along = self.problem.along
        if not self.carried:
            return found.rate + along(g, self.state.fields[1])
        change = along(0.5 * (self.carried.g + g), moving[1])
        change += along(0.5 * (self._r_old + found.r), self.carried.shift(moving))
        return np.asarray(self.state.psi + change)

    def linearised(
        self, step: _Step, t: float, moving: Array
    ) -> tuple[Values, list[Array], Tangents]:
        """The problem at the iterate, the row blocks of b, and what J has of the formulation."""
        constraining, fields, multipliers = (
            self.constraining,
            self.state.fields,
            self.state.multipliers,
        )
        if constraining.penalty:
            if self._phi is None:
                _, self._phi = self._constraints(t, moving, multipliers)
            multipliers = multipliers - constraining.penalty * self._phi
        values, phi = self._constraints(t, moving, multipliers)
        step.form_acceleration(fields)
        u, v, _, acceleration = fields
        rows = step.residual(moving, values.force)
        if constraining.stabilised:
            push = self._push()
            rows[0] = rows[0] + step.system.times_mass(
                constraining.inertia * constraining.eta[2] * push
            )
            for k, factor in enumerate(constraining.rows_eta):
                rows[1 + k] = rows[1 + k] + factor * push
        first, second, none = np.zeros_like(phi), np.zeros_like(phi), np.zeros_like(values.g)
        found = ConstraintRows(first, second, none, none)
        if constraining.differentiated:
            found = self.problem.constraint_rows(t, u, v, acceleration)
            first = self._rate(moving, values.g, found)
            second = self.problem.along(values.g, acceleration) + found.curvature
        rows.extend(constraining.values(phi, first, second))
        tangents = Tangents(constraining.tangents(values.g, found.r, found.q), self.directions)
        return values, rows, tangents

    def advance(
        self, step: _Step, correction: Array, t: float, moving: Array, norms: Array, settled: int
    ) -> tuple[Array, bool]:
        """Apply a correction, unless no block decreases any more.

        With a penalty λ follows from Φ after the correction, which is applied then.

        Args:
            step, t, moving: The step, its end (s) and the iterate.
            correction: (N,) in the scaled unknowns.
            norms: Overwritten where a block still decreases.
            settled: Corrections in a row that were in the terminal phase.

        Returns:
            Norms of the recorded blocks, and whether the step is over.
        """
        now = self._norms(step.blocks(correction))
        if self.constraining.penalty:
            self._apply(step, correction, moving)
            _, self._phi = self._constraints(t, moving, self.state.multipliers)
            update = -self.constraining.penalty * self._phi
            self.state.multipliers[:] += update
            now.append(algebra.norm(update / self.scheme.right[len(now)]))
        found = np.array(now)
        over = self._take_norms(found, norms, settled)
        if not (over or self.constraining.penalty):
            self._apply(step, correction, moving)
        return found, over

    def _norms(self, blocks: list[Array]) -> list[float]:
        """Norms of the blocks; with η, of the corrections of eliminated fields too."""
        constraining, scheme = self.constraining, self.scheme
        p = len(scheme.form.kept)
        now = [algebra.norm(block) for block in blocks]
        if constraining.stabilised:
            pushed = constraining.pushed(self.directions, scheme.right[p + 1] * blocks[p + 1])
            for field in map(FIELDS.index, scheme.form.eliminated):
                factors = scheme.elimination.weights[field] * scheme.right[:p]
                moved = constraining.eta[field] * pushed + algebra.product(
                    factors, np.array(blocks[:p])
                )
                now.append(algebra.norm(moved))
        return now

    def _apply(self, step: _Step, correction: Array, moving: Array) -> None:
        constraining, scheme = self.constraining, self.scheme
        blocks = step.correct(correction, moving, self.state.multipliers)
        step.recover(moving)
        if constraining.stabilised:
            p = len(scheme.form.kept)
            self.eta += scheme.right[p + 1] * blocks[p + 1]
            for field in map(FIELDS.index, scheme.form.eliminated):
                moving[field] += constraining.eta[field] * self._push()
        self._take(moving)

    def _take(self, moving: Array) -> None:
        if self.carried:
            self.carried.take(moving)

    def _take_norms(self, found: Array, norms: Array, settled: int) -> bool:
        """Record the blocks that still decrease; True when none does any more.

        Far from the solution all are recorded.
        """
        if settled >= 2:
            self._done |= found >= self._last
        else:
            self._done[:] = False
        norms[~self._done] = found[~self._done]
        self._last = found
        return bool(self._done.all())

    def project(self, t: float, moving: Array) -> int:
        """Project positions and velocities, as far as the scheme asks for it.

        Returns:
            Corrections of the positions.

        Raises:
            numpy.linalg.LinAlgError: When the matrix of the projection is singular.
        """
        level, state, taken = self.scheme.projection.level, self.state, 0
        while level > 1 and taken < MOST_POSITIONS:
            taken += 1
            _, phi = self._constraints(t, moving, state.multipliers)
            change, _ = self._index_1.least_change(t, state.fields[0], -phi)
            moving[0] += change
            self._take(moving)
            # The next one would be of the order of the square.
            least = self.scheme.settled_below * algebra.norm(state.fields[0])
            if not algebra.norm(change) > least:
                break
        if level > 0:
            wanted = -self.rate(t, moving)
            change, impulse = self._index_1.least_change(t, state.fields[0], wanted)
            moving[1] += change
            state.impulse[:] = impulse
            self._take(moving)
        return taken

    def project_accelerations(self, t: float, moving: Array) -> None:
        """Set v' to that of the index-1 system, and change a alike.

        a belongs to another time than v' in generalized-α: set to v' it would cost an order.
        """
        fields = self.state.fields
        implied, _ = self._index_1.accelerations(t, fields[0], fields[1])
        difference = implied - fields[3]
        fields[3] += difference
        moving[2] += difference
        self._take(moving)


def march(
    problem: Problem,
    scheme: Scheme,
    state: State,
    first: int,
    norms: Array,
    iterations: IndexArray,
    system: LinearSystem | None = None,
    record: Record | None = None,
    positions: IndexArray | None = None,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps; the arguments are the kernel's.

    Args:
        problem, scheme: What to march.
        state: Overwritten.
        first: Steps taken since the initial time.
        norms: (steps, k) overwritten with the norms of the recorded
            correction's blocks, those of `Scheme.recorded`.
        iterations: (steps,) overwritten with the corrections computed, negative
            where the step did not converge, or missed the tolerance.
        system: Linear system of the scheme on the problem; dense when omitted.
        record: Overwritten with the states after the steps that it names.
        positions: (steps,) overwritten with the corrections of positions by projections.

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
    extra = _Formulated(system.constraining, state, carried) if system.constraining else None
    # What Newton iterates on: the fields, or their increments over the step.
    moving = np.empty((3, problem.n)) if carried else fields[:3]
    places = {} if record is None else {int(s): k for k, s in enumerate(record.steps)}
    for s in range(len(norms)):
        t = problem.t0 + (first + s + 1) * scheme.h
        step = _Step(scheme, system, state.past.copy())
        if extra:
            extra.begin_step(problem.t0 + (first + s) * scheme.h)
        step.predict(moving)
        if carried:
            carried.take(moving)
        previous, settled, solves = np.inf, 0, 0
        while solves < scheme.iteration_cap:
            # Outside of `try`: errors of the problem's own functions are not the solver's.
            tangents: Tangents | None = None
            if extra:
                values, rows, tangents = extra.linearised(step, t, moving)
            else:
                values = problem.values(t, fields[0], fields[1], multipliers)
                phi = carried.phi(moving, values.g) if carried else values.phi
                rows = [*step.residual(moving, values.force), phi]
            try:
                correction = system.solve(values, step.right_hand_side(rows), tangents)
            except Stagnation:
                return STAGNATED, s
            except np.linalg.LinAlgError:
                return SINGULAR, s
            solves += 1
            if extra:
                phase = settled if scheme.stop is None else 0
                now, over = extra.advance(step, correction, t, moving, norms[s], phase)
                norm = algebra.norm(now[: len(scheme.form.unknowns)])
                if not np.isfinite(norm):
                    return DIVERGED, s
                if over:
                    break
            else:
                norm = algebra.norm(correction)
                if not np.isfinite(norm):
                    return DIVERGED, s
                if settled >= 2 and norm >= previous and scheme.stop is None:
                    break
                previous = norm
                blocks = step.correct(correction, moving, multipliers)
                now = norms[s] = np.array([algebra.norm(block) for block in blocks], float)
                step.recover(moving)
                if carried:
                    carried.take(moving)
            small = step.is_small(norm, now, state)
            settled = settled + 1 if small else 0
            if small and (norm == 0 or scheme.stop is not None):
                break
        iterations[s] = solves if settled else -solves
        try:
            if extra:
                projected = extra.project(t, moving)
                if positions is not None:
                    positions[s] = projected
            step.form_acceleration(fields)
            if extra and scheme.projection.accelerations:
                extra.project_accelerations(t, moving)
        except np.linalg.LinAlgError:
            return SINGULAR, s
        new_past = step.advance(moving, fields)
        if carried:
            if extra and extra.constraining.rated:
                state.psi[:] = extra.rate(t, moving)
            carried.end_step(t, moving, new_past)
        state.past[:] = new_past
        if record is not None and s in places:
            record.fields[places[s]], record.multipliers[places[s]] = fields, multipliers
            if scheme.total:
                record.multipliers[places[s]] += state.impulse / scheme.acting
    return COMPLETED, len(norms)


def _limit(scheme: Scheme, stop: Tolerance, state: State) -> float:
    """Norm of the scaled correction at which Newton stops."""
    p = len(scheme.tables.kept)
    kept = state.fields[scheme.tables.kept] / scheme.right[:p, None]
    size = np.hypot(algebra.norm(kept), algebra.norm(state.multipliers / scheme.right[p]))
    return float(stop.absolute + stop.relative * size)
