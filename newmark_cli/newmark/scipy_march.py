"""The Newton march in plain SciPy: the kernel's algorithm and verbs, on whole vectors.

It is the reference that the kernel is tested against, and the march of problems
whose linear systems are not solved by the kernel.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from newmark_cli.newmark.carrying import Carrying
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
from newmark_cli.newmark.scheme import BY_FIELD, CORRECTION, Scheme, Schemes
from newmark_cli.problems import algebra
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import ConstraintRows, Problem, Values
from newmark_cli.support.arrays import Array, IndexArray


class _Ended(Exception):
    """Ends a march before its last step; the argument says how."""


def _solved(solve: Callable[..., Any], *arguments: Any) -> Any:
    """What a solver returns; ends the march if it gives up."""
    try:
        return solve(*arguments)
    except np.linalg.LinAlgError as error:
        raise _Ended(STAGNATED if isinstance(error, Stagnation) else SINGULAR) from None


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


class _Index3:
    """The march of index 3, as the paper has it; t is always a time in s.

    Attributes:
        moving: (3, n) what Newton iterates on: the fields, or their increments over the step.
    """

    def __init__(
        self, problem: Problem, schemes: Schemes, state: State, system: LinearSystem, first: int
    ) -> None:
        self.problem, self.schemes, self.state, self.system = problem, schemes, state, system
        self.scheme, t = schemes.at(first), schemes.grid.t(first)
        self.carried = (
            _Compensated(problem, state, t, self.scheme.h) if schemes.base.compensated else None
        )
        self.moving = np.empty((3, problem.n)) if self.carried else state.fields[:3]
        self._carrying = Carrying(problem, schemes)

    def change_size(
        self, step: int, system_at: Callable[[int], LinearSystem] | None, begun: bool
    ) -> None:
        """Go on with the size of a step; ``begun`` if the past has been carried over to it."""
        if not begun and self.schemes.is_carried(step):
            begun = _solved(self._carrying.to, step, self.state)
        before, now = self.schemes.grid.kinds(np.arange(step - 1, step + 1))
        if now == before and not begun:
            return
        self.scheme = scheme = self.schemes.at(step)
        self.system = system_at(step) if system_at else self.system
        if not begun:
            old = np.concatenate([self.state.past, self.state.fields[3:]])
            carried = scheme.carried(scheme.h / scheme.ratio)[:, :-1]
            self.state.past[:] = algebra.product(carried, old)
        if self.carried:
            self.carried.h = scheme.h

    def begin_step(self, t: float) -> None:
        """Collect what the past adds; set u = u_n + h v_n, and v and a to what follows from it."""
        tables, past = self.scheme.tables, self.state.past
        self._field_history = algebra.product(tables.past_weights, past)
        self._dynamic_history = self.system.times_mass(algebra.product(tables.dynamic_past, past))
        self._row_history = algebra.product(tables.row_past, past)
        self.moving[:] = algebra.product(tables.predictor, past)
        self._take()
        self._previous = np.inf

    def _take(self) -> None:
        if self.carried:
            self.carried.take(self.moving)

    def _values(self, t: float, multipliers: Array) -> Values:
        """The problem at the iterate; compensated: Φ by its increment."""
        values = self.problem.values(t, self.state.fields[0], self.state.fields[1], multipliers)
        if self.carried:
            return values._replace(phi=self.carried.phi(self.moving, values.g))
        return values

    def iterate(self, t: float, norms: Array) -> int:
        """Correct fields and λ until Newton's iteration of the step to t ends.

        ``norms`` is overwritten with those of the recorded blocks of the correction.  Returns the
        number of corrections, negative where they ended too large.
        """
        scheme, settled, solves = self.scheme, 0, 0
        while solves < scheme.iteration_cap:
            values, rows, tangents = self.linearised(t)
            rhs = -np.concatenate([f * row for f, row in zip(scheme.left, rows, strict=True)])
            if self.look(rhs, solves):
                return solves
            correction = _solved(self.system.solve, values, rhs, tangents)
            solves += 1
            norm, now, over = self.advance(correction, t, norms, 0 if scheme.stop else settled)
            if not np.isfinite(norm):
                raise _Ended(DIVERGED)
            if over:
                break
            settled = settled + 1 if self.is_small(norm, now) else 0
            if settled and (norm == 0 or scheme.stop):
                break
        return solves if settled else -solves

    def linearised(self, t: float) -> tuple[Values, list[Array], Tangents | None]:
        """The problem at the iterate, the row blocks of b, and what J has of a formulation."""
        values = self._values(t, self.state.multipliers)
        return values, [*self._residual(values.force), values.phi], None

    def _residual(self, force: Array) -> list[Array]:
        """Row blocks of b: D and the kept ones of V and K."""
        tables = self.scheme.tables
        kept = self.moving[tables.kept]
        dynamics = self.system.times_mass(algebra.product(tables.dynamic_weights, kept))
        return [
            dynamics + self._dynamic_history - force,
            *(algebra.product(tables.row_weights, kept) + self._row_history),
        ]

    def advance(
        self, correction: Array, t: float, norms: Array, settled: int
    ) -> tuple[float, Array, bool]:
        """Apply a correction (N,) in the scaled unknowns, unless it does not decrease any more.

        ``norms`` is overwritten where its blocks still decrease; ``settled`` counts corrections in
        a row in the terminal phase.  Returns its norm, those of its recorded blocks, and whether
        the step is over.
        """
        norm = algebra.norm(correction)
        if not np.isfinite(norm) or (settled >= 2 and norm >= self._previous):
            return norm, norms, True
        self._previous = norm
        norms[:] = [algebra.norm(block) for block in self._correct(correction)]
        self._recover()
        self._take()
        return norm, norms, False

    def _blocks(self, correction: Array) -> list[Array]:
        sizes = self.scheme.form.sizes(self.problem.n, self.problem.m)
        return np.split(correction, np.cumsum(sizes)[:-1])

    def _correct(self, correction: Array) -> list[Array]:
        """Apply the correction (N,); return its blocks, one for each unknown."""
        tables, right = self.scheme.tables, self.scheme.right
        blocks, p = self._blocks(correction), len(tables.kept)
        for source, block, factor in zip(tables.kept, blocks, right, strict=False):
            self.moving[source] += factor * block
        if len(blocks) > p:
            self.state.multipliers[:] += right[p] * blocks[p]
        return blocks

    def _recover(self) -> None:
        """Evaluate the eliminated fields afresh from the kept ones."""
        tables, moving = self.scheme.tables, self.moving
        for field, name in enumerate(FIELDS):
            if name in self.scheme.form.kept:
                continue
            moving[field] = self._field_history[field]
            for k, source in enumerate(tables.kept):
                if weight := tables.weights[field, k]:
                    origin = self.state.past[source] if tables.differenced[field] else 0.0
                    moving[field] += weight * (moving[source] - origin)

    def is_small(self, norm: float, norms: Array) -> bool:
        """Whether a correction of this norm, and of these of its blocks, meets the test.

        Without one, whether it is in the terminal phase.
        """
        scheme, fields = self.scheme, self.state.fields
        p, kept = len(scheme.tables.kept), scheme.tables.kept
        if (stop := scheme.stop) and stop.test == BY_FIELD:
            now = (*fields[:3], self.state.multipliers)
            return all(map(_changed_little, stop.limits, self._before, now))
        if stop:
            of_kept = algebra.norm(fields[kept] / scheme.right[:p, None])
            size = np.hypot(of_kept, algebra.norm(self.state.multipliers / scheme.right[p]))
            return stop.test == CORRECTION and norm <= float(stop.absolute + stop.relative * size)
        displacement = algebra.norm(scheme.tables.weights[0] * scheme.right[:p] * norms[:p])
        threshold = scheme.settled_below * algebra.norm(fields[0])
        return norm == 0 or bool(displacement < threshold)

    def look(self, rhs: Array, solves: int) -> bool:
        """Whether b, from −D_L b (N,), meets the test after so many; the first is kept."""
        stop, left = self.scheme.stop, self.scheme.left
        if stop is None:
            return False
        self._before = [*self.state.fields[:3].copy(), self.state.multipliers.copy()]
        of_motion = 1 + len(self.scheme.form.extra_rows)
        sizes = [self.problem.n] * of_motion + [self.problem.m] * (len(left) - of_motion)
        size = algebra.norm(rhs / np.repeat(left, sizes))
        if solves == 0:
            self._first = size
        limit = stop.absolute + stop.relative * self._first
        return stop.on_residual and solves > 0 and bool(size <= limit)

    def finish(self, t: float) -> int:
        """Set v' once Newton's iteration is over; returns corrections of positions.

        Raises:
            numpy.linalg.LinAlgError: When the matrix of a projection is singular.
        """
        self._form_acceleration()
        return 0

    def _form_acceleration(self) -> None:
        """Set v', the last of the fields, from the new a and the past."""
        weights, fields = self.scheme.tables.acceleration, self.state.fields
        fields[3] = weights[0] * fields[2] + algebra.product(weights[1:], self.state.past)

    @property
    def total(self) -> Array:
        """(m,) λ, with the impulse of the projection where it counts."""
        if not self.scheme.total:
            return self.state.multipliers
        return np.asarray(self.state.multipliers + self.state.impulse / self.scheme.acting)

    def end_step(self, t: float) -> None:
        """Set what the past vectors become."""
        fields, past = self.state.fields, self.state.past
        if self.carried:
            increments = self.moving[:2]
        else:
            increments = np.array(
                [fields[0] - past[0] - self.scheme.h * past[1], fields[1] - past[1]]
            )
        new_past = np.concatenate([fields, increments])[self.scheme.tables.advance]
        if self.carried:
            self.carried.end_step(t, self.moving, new_past)
        past[:] = new_past


class _Formulated(_Index3):
    """The march of a formulation beside index 3, or with a projection.

    Attributes:
        eta: (m,) η.
        directions: Terms of P.
    """

    def __init__(
        self, problem: Problem, schemes: Schemes, state: State, system: LinearSystem, first: int
    ) -> None:
        super().__init__(problem, schemes, state, system, first)
        self._index_1 = Index1(problem)
        self._done = np.zeros(len(self.scheme.recorded), bool)
        self._last = np.zeros(len(self.scheme.recorded))

    @property
    def constraining(self) -> Constraining:
        """The formulation at the size of the step."""
        assert self.system.constraining is not None
        return self.system.constraining

    def begin_step(self, t: float) -> None:
        """Also set η = 0, and P and R to those at the beginning of the step."""
        u, v = self.state.past[:2]
        self.eta = np.zeros(self.problem.m)
        g = self.problem.values(t, u, v, self.state.multipliers).g
        self.directions = self.constraining.directions(g)
        if self.carried and self.constraining.rated:
            self._r_old = self.problem.constraint_rows(t, u, v, self.state.fields[3]).r
        self._phi: Array | None = None
        super().begin_step(t)

    def _push(self) -> Array:
        """(n,) Pη."""
        return self.constraining.pushed(self.directions, self.eta)

    def _rate_now(self, t: float) -> Array:
        """(m,) Gᵀv + Φ_t at the iterate."""
        u, v, _, acceleration = self.state.fields
        g = self.problem.values(t, u, v, self.state.multipliers).g
        return self._rate(g, self.problem.constraint_rows(t, u, v, acceleration))

    def _rate(self, g: Array, rows: ConstraintRows) -> Array:
        """(m,) Gᵀv + Φ_t; compensated: Ψ_n + ½(G_n + G)ᵀν + ½(R_n + R)Δ."""
        along = self.problem.along
        if not self.carried:
            return rows.rate + along(g, self.state.fields[1])
        change = along(0.5 * (self.carried.g + g), self.moving[1])
        change += along(0.5 * (self._r_old + rows.r), self.carried.shift(self.moving))
        return np.asarray(self.state.psi + change)

    def linearised(self, t: float) -> tuple[Values, list[Array], Tangents | None]:
        """Rows of constraints of the formulation in place of Φ, Pη, and the penalty."""
        constraining, multipliers = self.constraining, self.state.multipliers
        if constraining.penalty:
            if self._phi is None:
                self._phi = self._values(t, multipliers).phi
            multipliers = multipliers - constraining.penalty * self._phi
        values = self._values(t, multipliers)
        self._form_acceleration()
        u, v, _, acceleration = self.state.fields
        rows = self._residual(values.force)
        if constraining.stabilised:
            push = self._push()
            rows[0] = rows[0] + self.system.times_mass(
                constraining.inertia * constraining.eta[2] * push
            )
            for k, factor in enumerate(constraining.rows_eta):
                rows[1 + k] = rows[1 + k] + factor * push
        first, second = np.zeros_like(values.phi), np.zeros_like(values.phi)
        none = np.zeros_like(values.g)
        terms = ConstraintRows(first, second, none, none)
        if constraining.differentiated:
            terms = self.problem.constraint_rows(t, u, v, acceleration)
            first = self._rate(values.g, terms)
            second = self.problem.along(values.g, acceleration) + terms.curvature
        rows.extend(constraining.values(values.phi, first, second))
        tangents = constraining.tangents(values.g, terms.r, terms.q)
        return values, rows, Tangents(tangents, self.directions)

    def advance(
        self, correction: Array, t: float, norms: Array, settled: int
    ) -> tuple[float, Array, bool]:
        """Apply a correction, unless no block decreases any more.

        With a penalty λ follows from Φ after the correction, which is applied then.
        """
        now = self.constraining.norms(self._blocks(correction), self.directions)
        penalty = self.constraining.penalty
        if penalty:
            self._apply(correction)
            self._phi = self._values(t, self.state.multipliers).phi
            update = -penalty * self._phi
            self.state.multipliers[:] += update
            now.append(algebra.norm(update / self.scheme.right[len(now)]))
        recorded = np.array(now)
        over = self._take_norms(recorded, norms, settled)
        if not (over or penalty):
            self._apply(correction)
        return algebra.norm(recorded[: len(self.scheme.form.unknowns)]), recorded, over

    def _apply(self, correction: Array) -> None:
        constraining, p = self.constraining, len(self.scheme.form.kept)
        blocks = self._correct(correction)
        self._recover()
        if constraining.stabilised:
            self.eta += self.scheme.right[p + 1] * blocks[p + 1]
            for field in map(FIELDS.index, self.scheme.form.eliminated):
                self.moving[field] += constraining.eta[field] * self._push()
        self._take()

    def _take_norms(self, recorded: Array, norms: Array, settled: int) -> bool:
        """Record the blocks that still decrease; True when none does any more.

        Far from the solution all are recorded.
        """
        if settled >= 2:
            self._done |= recorded >= self._last
        else:
            self._done[:] = False
        norms[~self._done] = recorded[~self._done]
        self._last = recorded
        return bool(self._done.all())

    def finish(self, t: float) -> int:
        """Project positions, velocities and accelerations, as far as the scheme asks for it."""
        projection, state, taken = self.scheme.projection, self.state, 0
        while projection.level > 1 and taken < MOST_POSITIONS:
            taken += 1
            phi = self._values(t, state.multipliers).phi
            change, _ = self._index_1.least_change(t, state.fields[0], -phi)
            self.moving[0] += change
            self._take()
            # The next change would be of the order of this one's square.
            least = self.scheme.settled_below * algebra.norm(state.fields[0])
            if not algebra.norm(change) > least:
                break
        if projection.level > 0:
            wanted = -self._rate_now(t)
            change, impulse = self._index_1.least_change(t, state.fields[0], wanted)
            self.moving[1] += change
            state.impulse[:] = impulse
            self._take()
        self._form_acceleration()
        if projection.accelerations:
            implied, _ = self._index_1.accelerations(t, state.fields[0], state.fields[1])
            # Changed alike: a belongs to another time; as v' it would cost generalized-α an order.
            difference = implied - state.fields[3]
            state.fields[3] += difference
            self.moving[2] += difference
            self._take()
        return taken

    def end_step(self, t: float) -> None:
        """Also carry Ψ over."""
        if self.carried and self.constraining.rated:
            self.state.psi[:] = self._rate_now(t)
        super().end_step(t)


def _changed_little(limits: Array, last: Array, now: Array) -> bool:
    """Whether the root mean square of changes over absolute + relative |now| is at most 1."""
    changed = now != last
    if not np.any(limits) or not np.any(changed):
        return True
    weights = limits[0] + limits[1] * np.abs(now[changed])
    with np.errstate(divide="ignore"):
        return bool(algebra.norm((now - last)[changed] / weights) ** 2 <= len(now))


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
    schemes: Schemes | None = None,
    system_at: Callable[[int], LinearSystem] | None = None,
    begun: bool = False,
) -> tuple[int, int]:
    """Advance ``state`` by ``len(norms)`` steps.

    Args:
        problem, scheme: What to march.
        state: Overwritten.
        first: Steps taken since the initial time.
        norms, iterations, positions: Overwritten; see `march_data.Counts`.
        system: Linear system of the scheme on the problem; dense when omitted.
        record: Overwritten with the states after the steps that it names.
        schemes: The scheme of each step; all are of one size when omitted.
        system_at: The linear system of a step; ``system`` of them all when omitted.
        begun: Whether the past has been carried over to the size of the first step.

    Returns:
        How the march ended and the steps done.
    """
    schemes = schemes or Schemes.of(problem, scheme)
    grid = schemes.grid
    system = system_at(first) if system_at else system or DenseSystem(problem, schemes.at(first))
    kind = _Formulated if system.constraining else _Index3
    own = kind(problem, schemes, state, system, first)
    s = 0
    try:
        for s in range(len(norms)):
            if grid.varies:
                own.change_size(first + s + 1, system_at, begun and s == 0)
            own.begin_step(grid.t(first + s))
            t = grid.t(first + s + 1)
            iterations[s] = own.iterate(t, norms[s])
            taken = _solved(own.finish, t)
            if positions is not None:
                positions[s] = taken
            own.end_step(t)
            if record:
                record.keep(state._replace(multipliers=own.total), s)
    except _Ended as end:
        return end.args[0], s
    return COMPLETED, len(norms)
