"""The floor of Newton's corrections, predicted from one state: rounding as independent noise.

Far down, Newton's correction is what rounding makes of it.  Let q* solve the equations of a
step, d = q − q* be what the iterate q lacks, and b̂ = J d + ρ(d) the computed residual, ρ
its rounding error.  Then one correction and the iterate after it are

    c = −d − J⁻¹ ρ(d),    d' = d + c + η = −J⁻¹ ρ(d) + η,

η being the rounding of the unknowns to which the correction is added.  Only rounding errors
that *change* with d matter: those of what is fixed during a step, its past for one, merely
move q*.

An operation rounds its result to a machine number.  The model takes where the exact result
lies between two of them as random, uniform, and independent of all other operations
(Higham & Mary 2019); it has no constant that could be fitted.  The error of an operation
whose result moves by less than a unit in the last place then changes only now and then, as
it does in the march, and where nothing rounds differently a correction is exactly zero.

The operations of the integrator (M times an unknown in row D, the sums of rows D, V and K,
updates of the unknowns, recovery of eliminated fields) are taken from its coefficients.
Those within f, Gλ, Φ and its derivatives are the problem's own: its function is evaluated at
machine numbers near the state.  From many draws the march's rule takes what it records: the
last correction that decreases, and of formulations the last one of each block.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from newmark_cli.newmark.constraints import constraining_of
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.systems import LinearSystem
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems import algebra
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support.arrays import Array, IndexArray

#: Units in the last place by which the first of the iterates is off, so that the second
#: rounds anew everywhere, as after Newton's last correction that was not rounding.
_UNITS_OFF = 8
#: Units in the last place between the exact fields of a draw and the state, at most.
_UNITS_ASIDE = 16
#: Largest relative change of G within a step of which one state can tell the increments.
_MOST_TURNED = 0.25
#: Corrections of a draw, at most; the march has a cap as well.
_MOST_CORRECTIONS = 50
_SEED = 20061012


@dataclass(frozen=True)
class Floor:
    """Expected size of the last Newton correction; see `newmark_cli.newmark.floor`.

    NaN where the evaluation is compensated and G changes by more than a quarter within the
    step: its increments cannot be told from one state then.

    Attributes:
        scaled: Unknown → rms of the 2-norm of its correction, as the solver sees it.
        physical: The same in the unknown's own units.
        zeros: Unknown → share of the corrections that are exactly zero.

    Examples:
        >>> import newmark_cli as newmark
        >>> found = newmark.floor("pendulum", h=1e-3, form="v-lambda")
        >>> 5e-14 < found.physical["v"] < 1e-13
        True
    """

    scaled: Mapping[str, float]
    physical: Mapping[str, float]
    zeros: Mapping[str, float]


def floor(
    problem: Problem,
    scheme: Scheme,
    t: float,
    state: State,
    system: LinearSystem | None = None,
    samples: int = 32,
) -> Floor:
    """Predict the last Newton corrections of steps near a state.

    Args:
        problem: The problem.
        scheme: Form, scaling, integrator, step size, evaluation and precision.
        t: Time (s).
        state: State at which it is predicted.
        system: Linear system of the scheme on the problem; dense when omitted.
        samples: Draws of the rounding errors; where one direction dominates, the
            prediction scatters by about 1/√(2 samples).

    Raises:
        numpy.linalg.LinAlgError: When J is singular.
        ValueError: For a scheme that `unpredicted` refuses.
    """
    if reason := unpredicted(scheme):
        raise ValueError(reason)
    drawn = _Model(problem, scheme, t, state, system).draws(samples)
    right = dict(zip(scheme.form.unknowns, scheme.right, strict=True))
    sizes = [algebra.norm(column / np.sqrt(samples)) for column in drawn.T]
    scaled = dict(zip(scheme.recorded, sizes, strict=True))
    physical = {name: size * float(right.get(name, 1.0)) for name, size in scaled.items()}
    zeros = dict(zip(scheme.recorded, np.mean(drawn == 0, axis=0).tolist(), strict=True))
    return Floor(*(MappingProxyType(values) for values in (scaled, physical, zeros)))


def unpredicted(scheme: Scheme) -> str:
    """Why the model does not hold for a scheme; empty where it does."""
    if scheme.formulation.kind.penalised:
        return "with a penalty λ comes from an iteration of its own, not from Newton's correction"
    if scheme.stop is not None:
        return "Newton's iteration stops at a tolerance, before rounding stops it"
    return ""


class _Results:
    """Results of operations, which are rounded to machine numbers."""

    def __init__(self, values: Array, dtype: type[Any], random: np.random.Generator) -> None:
        self.unit = _unit(values, dtype)
        # Units are powers of two: their reciprocals are exact.  Exact zeros have none.
        self._rounds = self.unit > 0
        self._per_unit = np.divide(1.0, self.unit, out=np.zeros_like(self.unit), where=self._rounds)
        self._phase = random.uniform(-0.5, 0.5, size=self.unit.shape)

    def lie(self, off: Array) -> None:
        """Set how far exact results are from the machine numbers that `rounded` starts from."""
        self._phase = off * self._per_unit

    def lie_like(self, others: "_Results", where: Any) -> None:
        """Place exact results between machine numbers as others are."""
        self._phase = np.where(where, others._phase, self._phase)

    def rounded(self, moved: Array) -> Array:
        """By how much the rounded results move when the exact ones do."""
        return np.asarray(self.unit * np.rint(moved * self._per_unit + self._phase))

    def errors(self, moved: Array) -> Array:
        """Rounding errors of the moved results."""
        return np.asarray((self.rounded(moved) - self.exact(moved)) * self._rounds)

    def exact(self, moved: Array) -> Array:
        """How far the exact results are from the machine numbers that `rounded` starts from."""
        return np.asarray(moved + self.unit * self._phase)

    def nearest(self, moved: Array) -> Array:
        """By how much the exact results move, each with its rounding error."""
        return moved + self.errors(moved)


class _Sums:
    """Rows of a residual that subtract products in turn from what they should sum up to.

    ``rows`` has the row of each product, in the order of the subtractions; ``exact`` says
    whether a product does not round, its factor being one.
    """

    def __init__(self, rows: IndexArray, size: int, products: Array, exact: Array) -> None:
        self._order = np.argsort(rows, kind="stable")
        self._rows, self._size = rows[self._order], size
        self._products, self._exact = products[self._order], exact[self._order]
        self._last = np.diff(self._rows, append=size) > 0
        self._begins = np.flatnonzero(np.diff(self._rows, prepend=-1))
        self._lengths = np.diff(self._begins, append=len(rows))

    def _before(self, values: Array) -> Array:
        """Sums of each row before each of its terms."""
        total = np.cumsum(values) - values
        return np.asarray(total - np.repeat(total[self._begins], self._lengths))

    def draw(self, dtype: type[Any], random: np.random.Generator) -> None:
        """Where the exact results lie."""
        before = self._before(self._products)
        totals = (before + self._products)[self._last]
        left = np.repeat(totals, self._lengths) - before
        # Without the rounding of this subtraction.
        left[self._last] = self._products[self._last]
        self._of_left = _Results(left, dtype, random)
        self._of_products = _Results(np.where(self._exact, 0.0, self._products), dtype, random)
        # The last product equals what is left, so that zero can be reached.
        self._of_products.lie_like(self._of_left, self._last)

    def errors(self, moved: Array, target: Array) -> Array:
        """(size,) rounding errors when the products move, and (size,) what they sum up to."""
        moved = moved[self._order]
        errors = self._of_products.errors(moved)
        errors -= self._of_left.errors(target[self._rows] - self._before(moved))
        return np.asarray(np.bincount(self._rows, errors, minlength=self._size), float)


class _Model:
    """Newton's iteration under rounding, linear but for it, at one state of a scheme."""

    def __init__(
        self, problem: Problem, scheme: Scheme, t: float, state: State, system: LinearSystem | None
    ) -> None:
        self.problem, self.scheme, self.t, self.state = problem, scheme, t, state
        system = system or DenseSystem(problem, scheme)
        self.constraining = constraining_of(problem, scheme)
        self.jacobian = system.balanced(t, state)
        self.left, self.right = scaling_factors(scheme, problem.n, problem.m)
        self.ends = np.cumsum(scheme.form.sizes(problem.n, problem.m))
        self.kept = scheme.tables.kept
        self.weights = scheme.tables.weights.astype(float)
        fields = state.fields.astype(float)
        self.fields, self.acceleration = fields[:3], fields[3]
        self.multipliers = state.multipliers.astype(float)
        #: What Newton iterates on: the fields, or their increments over a step.
        self.moving = self.fields.copy()
        if scheme.compensated:
            # Those of the step that ends here: even where a alternates, they do not.
            u, v = self.fields[:2]
            smooth = Index1(problem).accelerations(t, u, v)[0]
            marched = scheme.marched
            past = algebra.product(scheme.relations.start, np.array([u, v, smooth]))
            self.moving[0] = marched.u_from_a * smooth + algebra.product(marched.u_past, past)
            self.moving[1] = marched.v_from_a * smooth + algebra.product(marched.v_past, past)
        #: Fields that are formed in every iteration, so that they round then.
        self.formed = [f for f in range(3) if scheme.compensated or f not in self.kept]
        #: Δ = h v_n + w of the step that ends at the state.
        self.shift = scheme.h * (self.fields[1] - self.moving[1]) + self.moving[0]
        self.values = self._values(*self._machine(self.fields, self.acceleration, self.multipliers))
        self.entries = Values(*(array.astype(float) for array in self.values))
        if scheme.compensated or self.constraining:
            self._differentiate()
        self.sums = [self._dynamics(), *map(self._relation, scheme.tables.row_weights)]

    def draws(self, samples: int) -> Array:
        """(samples, blocks) norms of the blocks that the march would record."""
        if self.scheme.compensated:
            turned = algebra.norm(self._by_shift)
            if turned > _MOST_TURNED * algebra.norm(self.entries.g):
                return np.full((samples, len(self.scheme.recorded)), np.nan)
        random = np.random.default_rng(_SEED)
        return np.array([self._draw(random) for _ in range(samples)])

    def _draw(self, random: np.random.Generator) -> Array:
        """(blocks,) norms of one draw."""
        own = self.scheme.formulated
        self._draw_roundings(random)
        off = self._nearest(self._off(random))
        recorded = np.zeros(len(self.scheme.recorded))
        done = np.zeros(len(recorded), bool)
        last, last_norm = np.full(len(recorded), np.inf), np.inf
        for count in range(1, _MOST_CORRECTIONS + 1):
            scaled = -off / self.right - self.jacobian.solve(self.left * self._roundings(off))
            norms, norm = self._norms(scaled), algebra.norm(scaled)
            # The first one is not rounding yet; the second is recorded in any case.
            if count > 2:
                done |= (norms >= last) if own else norm >= last_norm
            recorded[~done] = norms[~done]
            if done.all() or not np.any(scaled):
                break
            last, last_norm = norms, norm
            off = self._nearest(off + self.right * scaled)
        return recorded

    def _split(self, vector: Array) -> list[Array]:
        """(N,) block by block."""
        return [vector[begin:end] for begin, end in zip((0, *self.ends), self.ends, strict=False)]

    def _nearest(self, off: Array) -> Array:
        """(N,) how far off the nearest machine numbers of the unknowns are; η as it is."""
        parts = self._split(off)
        for k, results in enumerate(self._of_unknowns):
            parts[k] = results.nearest(parts[k])
        return np.concatenate(parts)

    def _off(self, random: np.random.Generator) -> Array:
        """(N,) by how much the first iterate is off in the unknowns."""
        dtype, sizes = self.scheme.dtype, []
        in_u = _UNITS_OFF * _unit(self.fields[0], dtype)
        for k, source in enumerate(self.kept):
            enough = _UNITS_OFF * _unit(self.moving[source], dtype)
            if weight := abs(float(self.weights[0, k])):
                enough = np.maximum(enough, in_u / weight)
            if self.scheme.compensated:
                # An increment is off by no more than it is.
                enough = np.minimum(enough, np.sqrt(np.mean(self.moving[source] ** 2)))
            sizes.append(enough)
        sizes.append(_UNITS_OFF * _unit(self.multipliers, dtype))
        amplitudes = np.concatenate(sizes)
        off = np.zeros(self.jacobian.size)
        off[: len(amplitudes)] = amplitudes * random.normal(size=len(amplitudes))
        return off

    def _norms(self, scaled: Array) -> Array:
        """(blocks,) norms of what the march records of a correction."""
        parts = self._split(scaled)
        if self.constraining:
            return np.array(self.constraining.norms(parts, self._directions))
        return np.array([algebra.norm(part) for part in parts])

    # -- rounding of the integrator's operations --------------------------------------------

    def _dynamics(self) -> _Sums:
        """Row D: M times the acceleration that the kept fields make."""
        tables, pattern = self.scheme.tables, self.problem.pattern
        used = np.flatnonzero(tables.dynamic_weights)
        factors = np.outer(tables.dynamic_weights[used], self.problem.mass_values).astype(float)
        self._of_dynamics = [
            (int(k), of_field, pattern.mass_columns)
            for k, of_field in zip(used, factors, strict=True)
        ]
        products = [
            factor * self.moving[self.kept[k]][columns] for k, factor, columns in self._of_dynamics
        ]
        rows = np.tile(pattern.mass_rows, len(used))
        return _Sums(rows, self.problem.n, _joined(products), np.zeros(len(rows), bool))

    def _relation(self, weights: Array) -> _Sums:
        """Row V or K: a sum of multiples of the kept fields."""
        n, used = self.problem.n, np.flatnonzero(weights)
        products = [weights[k] * self.moving[self.kept[k]] for k in used]
        exact = np.repeat(np.abs(weights[used]) == 1, n)
        return _Sums(np.tile(np.arange(n), len(used)), n, _joined(products), exact)

    def _draw_roundings(self, random: np.random.Generator) -> None:
        """Where the exact results of all operations lie."""
        scheme, tables, dtype = self.scheme, self.scheme.tables, self.scheme.dtype
        for sums in self.sums:
            sums.draw(dtype, random)
        unknowns = [*(self.moving[source] for source in self.kept), self.multipliers]
        self._of_unknowns = [_Results(values, dtype, random) for values in unknowns]
        self._of_fields = {f: _Results(self.fields[f], dtype, random) for f in self.formed}
        self._of_shift = _Results(self.shift, dtype, random)
        self._keep_to_constraints(random)
        self._of_products = {}
        for f in range(3):
            for k, source in enumerate(self.kept):
                if f != source and self.weights[f, k]:
                    factor = self.moving[source]
                    if tables.differenced[f]:
                        factor = scheme.h * self.fields[source + 1]
                    product = self.weights[f, k] * factor
                    self._of_products[f, k] = _Results(product, dtype, random)

    def _keep_to_constraints(self, random: np.random.Generator) -> None:
        """Let the exact fields lie in a random direction that no row of constraints notices.

        Whether rounding allows a residual of exactly zero depends on where they lie.
        """
        rhs = np.zeros(self.jacobian.size)
        rhs[: self.problem.n] = random.normal(size=self.problem.n)
        parts = self._split(self.right * self.jacobian.solve(self.left * rhs))
        directions = algebra.product(self.weights, np.array(parts[: len(self.kept)]))
        if self.scheme.compensated:
            self._of_shift.lie(directions[0] * _factor(directions[0], self._of_shift.unit))
            return
        u = self._of_fields.get(0) or self._of_unknowns[0]
        factor = _factor(directions[0], u.unit)
        levels = 3 if self.constraining and self.constraining.differentiated else 1
        for f in range(levels):
            of_field = self._of_fields.get(f)
            if of_field is None:
                of_field = self._of_unknowns[list(self.kept).index(f)]
            of_field.lie(factor * directions[f])

    def _roundings(self, off: Array) -> Array:
        """(N,) ρ, the rounding error of the residual, but for what does not change."""
        n, p = self.problem.n, len(self.kept)
        parts = self._split(off)
        push = np.zeros(n)
        if self.constraining and self.constraining.stabilised:
            push = self.constraining.pushed(self._directions, parts[p + 1])
        force, change, rows = self._roundings_of_functions(parts[:p], parts[p], push)
        errors = np.zeros(self.jacobian.size)
        moved = [factor * parts[k][columns] for k, factor, columns in self._of_dynamics]
        errors[:n] = self.sums[0].errors(_joined(moved), change) - force
        fixed = np.zeros(n)
        for r, weights in enumerate(self.scheme.tables.row_weights):
            moved = [weights[k] * parts[k] for k in np.flatnonzero(weights)]
            errors[(1 + r) * n : (2 + r) * n] = self.sums[1 + r].errors(_joined(moved), fixed)
        errors[n * (1 + len(self.scheme.tables.row_weights)) :] += rows
        return errors

    # -- rounding of the problem's functions ------------------------------------------------

    def _machine(self, *arrays: Array) -> tuple[Array, ...]:
        """Fields, accelerations and λ as the arguments of the problem's functions."""
        fields, acceleration, multipliers = (array.astype(self.scheme.dtype) for array in arrays)
        return fields[0], fields[1], acceleration, multipliers

    def _values(self, u: Array, v: Array, acceleration: Array, multipliers: Array) -> Values:
        """The problem's values in the march's precision."""
        return self.problem.values(self.t, u, v, multipliers, self.scheme.dtype)

    def _differentiate(self) -> None:
        """Set the entries of R and Q, and what compensated sums have of the step's beginning."""
        problem, t, g = self.problem, self.t, self.entries.g
        u, v, none = self.fields[0], self.fields[1], np.zeros(problem.n)
        rows = problem.constraint_rows(t, u, v, self.acceleration)
        self._r, self._q = rows.r, rows.q
        if self.constraining:
            self._directions = self.constraining.directions(g)
        if self.scheme.compensated:
            # Φ is quadratic: G and R are affine in u and v.
            self._by_shift = problem.constraint_rows(t, u, self.shift, none).r
            self._by_increment = problem.constraint_rows(t, u, self.moving[1], none).r
            self._g_old = (g - self._by_shift).astype(self.scheme.dtype)
            self._r_old = (self._r - self._by_increment).astype(self.scheme.dtype)

    def _along(self, entries: Array, vector: Array) -> Array:
        """(m,) a matrix at the pattern of Gᵀ times (n,), in the march's precision."""
        pattern = self.problem.pattern
        total = np.zeros(self.problem.m, entries.dtype)
        np.add.at(total, pattern.g_columns, entries * vector[pattern.g_rows])
        return total

    def _roundings_of_functions(
        self, of_fields: list[Array], of_multipliers: Array, push: Array
    ) -> tuple[Array, Array, Array]:
        """Rounding errors of f + Gλ (n,), its change, and errors of the rows of constraints.

        From how far kept unknowns (n,) and λ (m,) are off, and Pη (n,), by which others are.
        """
        problem, pattern, scheme = self.problem, self.problem.pattern, self.scheme
        change = np.zeros((3, problem.n))
        there, exact = self.fields.copy(), np.zeros((3, problem.n))
        for f in range(3):
            for k, off in enumerate(of_fields):
                change[f] += self.weights[f, k] * off
            if f not in self.kept:
                change[f] += scheme.elimination.eta[f] * push
            moved = change[f].copy()
            for k, off in enumerate(of_fields):
                if (f, k) in self._of_products:
                    moved += self._of_products[f, k].errors(self.weights[f, k] * off)
            if results := self._of_fields.get(f):
                there[f] += results.rounded(moved)
                exact[f] = results.exact(change[f])
        for k, source in enumerate(self.kept):
            if source not in self._of_fields:
                exact[source] = self._of_unknowns[k].rounded(of_fields[k])
                there[source] += exact[source]
        of_multipliers = self._of_unknowns[-1].rounded(of_multipliers)
        acceleration = self.acceleration + float(scheme.tables.acceleration[0]) * exact[2]
        arguments = self._machine(there, acceleration, self.multipliers + of_multipliers)
        values = self._values(*arguments)
        linear = np.bincount(pattern.g_rows, self.entries.g * of_multipliers[pattern.g_columns],
                             minlength=problem.n)  # fmt: skip
        for rows, columns, entries, moved in (
            (pattern.x_rows, pattern.x_columns, self.entries.x, exact[0]),
            (pattern.y_rows, pattern.y_columns, self.entries.y, exact[1]),
        ):
            linear = linear - np.bincount(rows, entries * moved[columns], minlength=problem.n)
        change_of_force = values.force.astype(float) - self.entries.force
        rows_there = self._rows(values, arguments, change, self._of_shift.rounded(change[0]))
        if scheme.compensated:
            # The state belongs to a step with slightly different increments.
            rows_there = rows_there - self._rows_here
        rows_there = rows_there - self._linear_rows(exact, change)
        return change_of_force - linear, change_of_force, rows_there

    def _linear_rows(self, exact: Array, change: Array) -> Array:
        """(k m,) by how much the rows of constraints change but for rounding.

        From (3, n) how far u, v and a are from those of the state, not yet rounded, and off.
        """
        along, g = self.problem.along, self.entries.g
        u, v, a = exact
        if self.scheme.compensated:
            shift = self._of_shift.exact(change[0])
            first = along(g - self._by_shift / 2, shift) + along(self._by_shift / 2, u)
        else:
            first = along(g, u)
        if self.constraining is None:
            return first
        if self.scheme.compensated:
            second = along(g - self._by_shift / 2, change[1]) + along(self._by_shift / 2, v)
            second += along(self._r - self._by_increment / 2, shift)
            second += along(self._by_increment / 2, u)
        else:
            second = along(g, v) + along(self._r, u)
        third = along(self._q, u) + along(2 * self._r, v)
        third += along(self.constraining.inertia * g, a)
        return np.asarray(self.constraining.values(first, second, third), float).ravel()

    @cached_property
    def _rows_here(self) -> Array:
        """(k m,) the rows of constraints at the state."""
        arguments = self._machine(self.fields, self.acceleration, self.multipliers)
        none = np.zeros_like(self.fields)
        return self._rows(self.values, arguments, none, none[0])

    def _rows(
        self, values: Values, arguments: tuple[Array, ...], change: Array, of_shift: Array
    ) -> Array:
        """(k m,) the rows of constraints as the march computes them at a point.

        From (3, n) exact changes of u, v and a since the state, and (n,) of Δ as it is rounded.
        """
        problem, constraining = self.problem, self.constraining
        scheme, dtype = self.scheme, self.scheme.dtype
        u, v, acceleration, _ = arguments
        phi, half = values.phi, dtype(0.5)
        if scheme.compensated:
            shift = (self.shift + of_shift).astype(dtype)
            mean = half * (self._g_old + values.g)
            phi = self._along(mean, shift)
        if constraining is None:
            return phi.astype(float)
        first = second = np.zeros_like(phi)
        if constraining.differentiated:
            rows = problem.constraint_rows(self.t, u, v, acceleration, dtype)
            if scheme.compensated:
                increment = (self.moving[1] + change[1]).astype(dtype)
                first = self._along(mean, increment)
                first = first + self._along(half * (self._r_old + rows.r), shift)
            else:
                first = rows.rate + self._along(values.g, v)
            second = self._along(values.g, acceleration) + rows.curvature
        return constraining.values(phi, first, second).astype(float).ravel()


def _unit(values: Array, dtype: type[Any]) -> Array:
    """Units in the last place of values in a precision; 0 of exact zeros."""
    values = np.asarray(values, float)
    units = np.abs(np.spacing(values.astype(dtype))).astype(float)
    return np.where(values == 0, 0.0, units)


def _factor(direction: Array, unit: Array) -> float:
    """Factor that makes a direction as long as some units in the last place."""
    there = unit > 0
    longest = np.max(np.abs(direction[there]) / unit[there], initial=0.0)
    return _UNITS_ASIDE / longest if longest > 0 else 0.0


def _joined(arrays: list[Array]) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros(0)
