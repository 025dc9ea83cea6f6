"""Whether what a problem in Python says twice agrees: G with Φ, tangents with forces, and so on.

A given derivative is compared with difference quotients, forward, backward and central, of
steps that shrink from a tenth of the coordinates to rounding.  It agrees where one of them
confirms it.  It is wrong only where none does and the quotients settle elsewhere: over four
steps in a row, in which the function is smooth, they hardly change.  Noise, kinks, jumps and
states in which the function has no value or no derivative decide nothing.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.problems import user_code
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import ContradictionError, Problem, ProblemError
from newmark_cli.support.arrays import Array, Mask

#: Ratio of a step to the next, and how many there are; the longest, relative to the
#: coordinates, and the first that is tried.  No round numbers, lest they fit a period.
_RATIO, _STEPS, _LONGEST, _FIRST = 4.0, 22, 0.095, 5
#: Largest relative difference of a given derivative from a quotient that confirms it, and
#: largest difference, relative to the largest derivative of the function, that is none.
_TOLERANCE, _NOTHING = 1e-5, 1e-10
#: Steps in a row, and how little quotients change in them, relative to what the given
#: derivative is away; how much nearer to it, relatively, those of longer steps may not be.
_IN_A_ROW, _SETTLED, _NEARER = 4, 0.1, 0.25
#: Differences of a function, relative to it, that may be nothing but rounding.
_ROUNDING = 1e-13
#: Coordinates next to the start differ from it by this part, or less where Φ bends.
_NEAR = 1e-2


class _Part(NamedTuple):
    """A derivative of a function of one number at 0."""

    function: Callable[[float], Any]
    longest: float  #: the longest step
    order: int = 1


class _Wrong(NamedTuple):
    """What is wrong in a function, with the values that show it."""

    key: str
    what: str
    values: str


_Comparison = Callable[[float, Array, Array], Iterator[_Wrong]]


@dataclass(frozen=True)
class Agreement:
    """What a definition says twice, to be compared at any state."""

    problem: Problem
    functions: Mapping[str, Any]  #: ``force``, ``constraints`` and ``gradient``
    #: what these imply already: tangents, terms of Φ' and Φ'', and ``energy``
    restated: Mapping[str, Any]
    named: Callable[[str], str]  #: how errors name a function

    def reached(self, t: float, u: Array, v: Array) -> None:
        """Compare at the position and velocity on the constraints next to a state of a march.

        Raises:
            ContradictionError: Names function, entry, time, and both values.
        """
        with np.errstate(all="ignore"):
            if (state := self._onto(t, u, v)) is not None:
                of_all = (self._of_gradient, self._of_tangents, self._of_rows, self._of_energy)
                self._compare(of_all, t, *state, f"at t = {t:.9g}", ContradictionError)

    def at_load(self) -> None:
        """Compare at the start, and next to it, where terms show that vanish at the start.

        G first: what else is right would seem wrong with it.  Terms of Φ' and Φ'' off the
        constraints, too, where formulations of lower index drift.

        Raises:
            ProblemError: As of `reached`.
        """
        problem, rows = self.problem, self._of_rows
        others = (self._of_tangents, rows, self._of_energy)
        chosen: tuple[_Comparison, ...]
        for chosen in ((self._of_gradient,), others):
            with np.errstate(all="ignore"):
                self._compare(chosen, problem.t0, problem.u0, problem.v0, "at the start")
                for t, u, v in self._states():
                    where = "next to the start" + (f", at t = {t:.9g}" if t != problem.t0 else "")
                    if rows in chosen:
                        self._compare((rows,), t, u, v, where)
                    if (state := self._onto(t, u, v)) is not None:
                        self._compare(chosen, t, *state, where)

    def _compare(
        self,
        chosen: Sequence[_Comparison],
        t: float,
        u: Array,
        v: Array,
        where: str,
        error: type[ProblemError] = ProblemError,
    ) -> None:
        for comparison in chosen:
            for key, what, values in comparison(t, u, v):
                raise error(f"{self.named(key)} {what} {where}: {values}")

    # -- each function -----------------------------------------------------------------------

    def _of_gradient(self, t: float, u: Array, v: Array) -> Iterator[_Wrong]:
        """What is wrong in G at a state."""
        phi, sizes, g = self.functions["constraints"], _sizes(u), self._gradient(t, u)
        units, scaled = np.abs(g).max(axis=0), (np.abs(g) * sizes[:, None]).max(axis=0)
        yield from _columns(
            "gradient", g.T, lambda i: lambda s: phi(_moved(u, i, s), t), sizes,
            np.minimum(units, scaled / sizes[:, None]),
        )  # fmt: skip

    def _of_tangents(self, t: float, u: Array, v: Array) -> Iterator[_Wrong]:
        """What is wrong in X and Y at a state."""
        force, gradient = self.functions["force"], self.functions["gradient"]
        n, m, restated, sizes = self.problem.n, self.problem.m, self.restated, _sizes(u)
        speeds = _sizes(v) if np.any(v) else sizes
        units = np.abs(self._gradient(t, u)).max(axis=0)
        load = float(np.abs(_value(n, force, u, v, t)).max())
        multipliers = np.linspace(1.0, 2.0, m) * (load or 1.0) / np.where(units > 0, units, 1.0)
        if stiffness := restated.get("stiffness"):
            x = _value(n * n, stiffness, u, v, multipliers, t).reshape(n, n)

            def pull(j: int) -> Callable[[float], Any]:
                def of(s: float) -> Any:
                    there = _moved(u, j, s)
                    return -(force(there, v, t) + gradient(there, t) @ multipliers)

                return of

            yield from _columns("stiffness", x, pull, sizes, load / sizes.max())
        if damping := restated.get("damping"):
            y = _value(n * n, damping, u, v, t).reshape(n, n)
            yield from _columns(
                "damping", y, lambda j: lambda s: -force(u, _moved(v, j, s), t), speeds,
                load / speeds.max(),
            )  # fmt: skip

    def _of_rows(self, t: float, u: Array, v: Array) -> Iterator[_Wrong]:
        """What is wrong in the terms of Φ' and Φ'' at a state."""
        phi, gradient = self.functions["constraints"], self.functions["gradient"]
        n, m, size = self.problem.n, self.problem.m, float(_sizes(u).max())
        w = size * np.random.default_rng(1).normal(size=n)
        units = np.abs(self._gradient(t, u)).max(axis=0)
        units *= 1 + (np.abs(v).max() / size) ** 2
        in_time, along_v, along_w = (
            _LONGEST * min(longest, size / float(np.abs(d).max()) if np.any(d) else 1.0)
            for longest, d in ((1.0, 0 * v), (1.0, v), (np.inf, w))
        )

        def turned(s: float) -> Any:
            return gradient(u + s * v, t + s)

        def moving(s: float) -> Any:
            return turned(s).T @ v + (rate(u + s * v, t + s) if rate else 0.0)

        # First derivatives of what has been compared lose less than second ones.
        rate, turn = self.restated.get("constraint_rate"), self.restated.get("rate_gradient")
        bend = _Part(lambda s: phi(u + s * v, t + s), along_v, 2)
        if rate or self._is_rigid(t, u):
            bend = _Part(moving, along_v)
        bent = _Part(turned, along_v, 2)
        if turn:
            bent = _Part(lambda s: turn(u + s * v, v, t + s), along_v)
        rows: dict[str, tuple[tuple[Any, ...], Sequence[_Part], tuple[int, ...]]] = {
            "constraint_rate": ((u, t), [_Part(lambda s: phi(u, t + s), in_time)], (m,)),
            "curvature": ((u, v, t), [bend], (m,)),
            "rate_gradient": ((u, v, t), [_Part(turned, along_v)], (n, m)),
            "acceleration_gradient": (
                (u, v, w, t),
                [_Part(lambda s: gradient(u + s * w, t), along_w), bent],
                (n, m),
            ),
        }
        for key, (arguments, parts, shape) in rows.items():
            if key in self.restated:
                values = _value(int(np.prod(shape)), self.restated[key], *arguments)
                nothing = np.broadcast_to(units * (size if len(shape) == 1 else 1.0), shape)
                if wrong := _contradicted(values, parts, _NOTHING * nothing.ravel()):
                    index, expected = wrong
                    yield _wrong(key, np.unravel_index(index, shape), values[index], expected)

    def _of_energy(self, t: float, u: Array, v: Array) -> Iterator[_Wrong]:
        """The rate of the energy besides dissipation, if there is any.

        Half its rate on a motion less half of that on the motion with −v: dissipation takes
        from both.  Only where nothing depends on time, so that both are motions.
        """
        energy, force = self.restated.get("energy"), self.functions["force"]
        if energy is None or not self._is_free_of_time(t, u, v):
            return
        direction = np.random.default_rng(2).normal(size=self.problem.n)
        state = self._onto(t, u, float(_sizes(u).max()) * direction)
        if state is None:
            return
        u, v = state
        system = Index1(self.problem)
        try:
            # Fast enough to need forces as large as these: coordinates say little of lengths.
            slow, fast = (system.accelerations(t, u, way)[0] for way in (0 * v, v))
            bend = float(np.abs(self.problem.M @ (fast - slow)).max())
            load = float(np.abs(_value(self.problem.n, force, u, v, t)).max())
            if bend and load:
                v = v * np.sqrt(load / bend)
            ahead, behind = (system.accelerations(t, u, way)[0] for way in (v, -v))
        except Exception:  # a singular position, or a function without a value
            return

        def change(s: float) -> Any:
            forth = energy(u + s * v, v + s * ahead, t)
            back = energy(u - s * v, -v + s * behind, t)
            return energy(u, v, t) + (forth - back) / 2  # its size tells what is rounding

        speed = float(np.abs(v).max())
        fastest = max(speed / _sizes(u).max(), np.abs(ahead).max() / (speed or 1.0)) or 1.0
        nothing = np.full(1, _TOLERANCE * load * speed)
        wrong = _contradicted(np.zeros(1), [_Part(change, _LONGEST / fastest)], nothing)
        if wrong:
            change_of = f"on a motion without dissipation it changes by {wrong[1]:.3g} in a second"
            yield _Wrong("energy", "is not conserved", change_of)

    def _gradient(self, t: float, u: Array) -> Array:
        n, m = self.problem.n, self.problem.m
        return _value(n * m, self.functions["gradient"], u, t).reshape(n, m)

    # -- states ------------------------------------------------------------------------------

    def _states(self) -> Iterator[tuple[float, Array, Array]]:
        """Time, coordinates and velocities of two states next to the start."""
        problem, random = self.problem, np.random.default_rng(0)
        t0, u0, v0, n = problem.t0, problem.u0, problem.v0, problem.n
        phi, gradient = self.functions["constraints"], self.functions["gradient"]
        here, g = phi(u0, t0), gradient(u0, t0)
        free, rate = self._is_rigid(t0, u0), self._rate(t0, u0)
        largest = float(_sizes(u0).max())
        sizes = np.where(np.abs(u0) > 1e-6 * largest, np.abs(u0), largest)
        for _ in range(2):
            away, turn = sizes * random.normal(size=n), random.normal(size=n)
            later = 0.0 if free else random.uniform(10.0, 100.0)
            reach = _NEAR
            for _ in range(20):  # as far as Φ changes by what G and Φ_t predict
                expected = reach * (g.T @ away + later * rate)
                u, t = u0 + reach * away, t0 + reach * later
                missed = _value(problem.m, phi, u, t) - here - expected
                if np.all(
                    np.abs(missed) <= 0.1 * reach * (np.abs(g).T @ np.abs(away) + later * abs(rate))
                ):
                    break
                reach /= _RATIO
            else:
                continue
            speed = float(np.abs(v0).max()) or reach / _NEAR * largest
            yield t, u, v0 + speed * turn

    def _onto(self, t: float, u: Array, v: Array) -> tuple[Array, Array] | None:
        """Coordinates and velocities on the constraints; None where there are none close by.

        What a definition says need not hold elsewhere: a length may stand for a distance.
        """
        m, least = self.problem.m, np.inf
        try:
            for _ in range(30):
                phi = _value(m, self.functions["constraints"], u, t)
                g = self._gradient(t, u)
                change = np.linalg.lstsq(g.T, -phi)[0]
                size = float(np.abs(change).max()) / float(_sizes(u).max())
                if not np.isfinite(size):
                    return None
                u = u + change
                if size <= 1e-14 or (size >= least / 2 and size <= 1e-9):
                    break
                least = size
            else:
                return None
            v = v - np.linalg.lstsq(g.T, g.T @ v + self._rate(t, u))[0]
        except np.linalg.LinAlgError:
            return None
        return (u, v) if np.all(np.isfinite(u)) and np.all(np.isfinite(v)) else None

    def _rate(self, t: float, u: Array) -> Array:
        """(m,) Φ_t."""
        m, phi = self.problem.m, self.functions["constraints"]
        if rate := self.restated.get("constraint_rate"):
            return _value(m, rate, u, t)
        ahead, behind = t + 1e-6, t - 1e-6
        there = _value(m, phi, u, ahead) - _value(m, phi, u, behind)
        return there / (ahead - behind)

    def _is_rigid(self, t: float, u: Array) -> bool:
        """Whether the constraints do not depend on time."""
        phi, m = self.functions["constraints"], self.problem.m
        values = [_value(m, phi, u, t + s) for s in (0.0, 1e-3, 0.137)]
        return all(np.array_equal(values[0], other) for other in values[1:])

    def _is_free_of_time(self, t: float, u: Array, v: Array) -> bool:
        force, n = self.functions["force"], self.problem.n
        values = [_value(n, force, u, v, t + s) for s in (0.0, 1e-3)]
        return np.array_equal(values[0], values[1]) and self._is_rigid(t, u)


# -- one function of one number -------------------------------------------------------------


def _columns(
    key: str, matrix: Array, along: Callable[[int], Callable[[float], Any]], sizes: Array, unit: Any
) -> Iterator[_Wrong]:
    """What is wrong in a matrix, each of whose columns is the derivative of ``along(j)``.

    For G, ``matrix`` is its transpose.  ``unit`` is the size of the derivatives to each
    coordinate, by rows, that count at least.
    """
    size = float(np.abs(matrix).max()) if key != "gradient" else 0.0
    nothing = _NOTHING * np.broadcast_to(np.maximum(size, unit), matrix.T.shape)
    largest = float(sizes.max())
    for j, own in enumerate(sizes.tolist()):
        part = _Part(along(j), _LONGEST * largest)
        first = round(np.log(largest / own) / np.log(_RATIO))
        if wrong := _contradicted(matrix[:, j], [part], nothing[j], _FIRST + first):
            i, expected = wrong
            yield _wrong(key, (j, i) if key == "gradient" else (i, j), matrix[i, j], expected)


def _contradicted(
    derivatives: Array, parts: Sequence[_Part], nothing: Array, first: int = _FIRST
) -> tuple[int, float] | None:
    """The derivative that is most certainly wrong, and what it is; None where none is.

    The (k,) derivatives are sums of those of the parts; (k,) differences up to ``nothing`` do not
    count.  Steps are numbered from the longest, 0; ``first`` is tried first.
    """
    here = [_value(len(derivatives), part.function, 0.0) for part in parts]
    quotients = np.full((_STEPS, 3, len(derivatives)), np.nan)
    doubted = np.isfinite(derivatives)
    order = max(part.order for part in parts)
    lengths = _RATIO ** -(order * np.arange(float(_STEPS)))[:, None]  # to this power
    load = np.sum(
        [np.abs(at) / part.longest**part.order for part, at in zip(parts, here, strict=True)],
        axis=0,
    )
    for number in sorted(range(_STEPS), key=lambda number: abs(number - first)):
        quotients[number] = latest = sum(
            _quotients(part, part.longest * _RATIO**-number, at)
            for part, at in zip(parts, here, strict=True)
        )
        sizes = np.maximum(np.abs(derivatives), np.abs(latest))
        confirmed = np.abs(latest - derivatives) <= _TOLERANCE * sizes + nothing
        if number > first:  # the function may have changed by less than its rounding
            slope = np.nanmax(np.abs(quotients[first]), axis=0, initial=0.0)
            differences = np.abs(quotients) * lengths[:, :, None]
            rounding = _ROUNDING * (load + np.nanmax(differences, axis=(0, 1), initial=0.0))
            confirmed &= (latest != 0) | (slope * lengths[number] > rounding)
        doubted &= ~confirmed.any(axis=0)
        if not doubted.any():
            return None
    return _settled(derivatives, doubted, quotients, load)


def _settled(
    derivatives: Array, doubted: Mask, quotients: Array, load: Array
) -> tuple[int, float] | None:
    """What `_contradicted` returns of quotients at all steps, none of which confirms a value.

    Quotients are (steps, 3, k) forward, backward and central ones; the load is the (k,) size of
    the function over the longest step, to the power of the order.
    """
    forward, backward, central = quotients.swapaxes(0, 1)
    # Quotients of rounded numbers are 0 over short steps; others only if all are.
    still = np.all((quotients == 0) | np.isnan(quotients), axis=(0, 1)) & doubted
    still &= (np.isfinite(central).sum(axis=0) >= _IN_A_ROW) & (np.abs(derivatives) > 1e-6 * load)
    if still.any():
        return int(np.argmax(still)), 0.0
    gap = forward - backward
    bends = np.abs(gap[1:] - gap[:-1] / _RATIO)  # 0 but for rounding and high derivatives
    away = np.abs(central - derivatives)
    worst, answer = 0.0, None
    for begin in range(1, _STEPS - _IN_A_ROW + 1):
        row = slice(begin, begin + _IN_A_ROW)
        settled = central[begin + 1]
        least, smallest = (np.abs(x[row]).min(axis=0) for x in (away, central))
        varied = np.ptp(central[row], axis=0)
        varied = np.maximum(varied, bends[begin - 1 : begin - 1 + _IN_A_ROW].max(axis=0))
        wrong = (smallest > 0) & (varied <= _SETTLED * np.minimum(least, smallest)) & doubted
        # Longer steps see past backlash, and past the stairs that rounding makes.
        farther = np.minimum(np.abs(central[:begin] - settled), np.abs(derivatives))
        wrong &= ~np.any(away[:begin] <= _NEARER * farther, axis=0)
        certainty = np.where(wrong, least / (varied + 1e-3 * least), 0.0)
        if (most := float(certainty.max())) > worst:
            k = int(np.argmax(certainty))
            worst, answer = most, (k, float(settled[k]))
    return answer


def _quotients(part: _Part, step: float, here: Array) -> Array:
    """(3, k) forward, backward and central difference quotient of a step."""
    k = len(here)
    ahead, behind = (_value(k, part.function, shift) for shift in (step, -step))
    if part.order == 1:
        forward, backward = (ahead - here) / step, (here - behind) / step
        return np.array([forward, backward, (forward + backward) / 2])
    farther = (_value(k, part.function, shift) for shift in (2 * step, -2 * step))
    sides = [
        (far - near - (near - here)) for far, near in zip(farther, (ahead, behind), strict=True)
    ]
    return np.array([*sides, ahead - here + (behind - here)]) / step**2


def _value(count: int, function: Callable[..., Any], *arguments: Any) -> Array:
    """(count,) what a function returns, or NaN where it fails."""
    try:
        value = np.array(function(*arguments), float).ravel()
        return value if len(value) == count else np.full(count, np.nan)
    except BaseException as error:  # an exit included
        if user_code.is_interrupt(error):
            raise
        return np.full(count, np.nan)


def _sizes(vector: Array) -> Array:
    """(n,) magnitude of each component, which may be 0 at the moment."""
    largest = float(np.abs(vector).max()) or 1.0
    return np.maximum(np.abs(vector), 1e-3 * largest)


def _moved(vector: Array, i: int, step: float) -> Array:
    moved = vector.copy()
    moved[i] += step
    return moved


def _wrong(key: str, index: Sequence[Any], stated: float, expected: float) -> _Wrong:
    numbers = [int(place) + 1 for place in index]
    entry = ("row {}, column {}" if len(numbers) == 2 else "component {}").format(*numbers)
    values = f"given {stated:.9g}, differences say {expected:.9g}"
    return _Wrong(key, f"disagrees with differences in {entry}", values)
