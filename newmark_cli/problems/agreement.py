"""Whether what a problem in Python says twice agrees: G with Φ, tangents with forces, and so on.

A given derivative is compared with difference quotients, forward, backward and central, of
steps that shrink from a tenth of the coordinates to rounding.  It agrees where one of them
confirms it.  It is wrong only where none does and the quotients settle elsewhere: over four
steps in a row, in which the function is smooth, they hardly change.  Noise, kinks, jumps and
states in which the function has no value or no derivative decide nothing.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from newmark_cli.problems import user_code
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import ContradictionError, Problem
from newmark_cli.support.arrays import Array

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
#: How far states next to the start are from it, relative to the coordinates: the first distance
#: from which Newton's method finds the constraints; and the largest gap that it may leave.
_NEAR, _MET = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8), 1e-9

_State = tuple[float, Array, Array]


class _Claim(NamedTuple):
    """Given numbers, (k,), that should be the derivative of a function of one number at 0."""

    key: str
    given: Array
    function: Callable[[float], Any]
    longest: float  #: the longest step
    nothing: Array  #: (k,) differences that do not count
    places: Sequence[tuple[int, ...]]  #: of the numbers in what the user's function returns
    first: int = _FIRST  #: number of the step that is tried first


@dataclass(frozen=True)
class Agreement:
    """What a definition says twice."""

    problem: Problem
    functions: Mapping[str, Any]  #: ``force``, ``constraints`` and ``gradient``
    #: what these imply already: tangents, terms of Φ' and Φ'', and ``energy``
    restated: Mapping[str, Any]
    named: Callable[[str], str]  #: how errors name a function

    def require(self) -> None:
        """Compare at the start, and at two states next to it, where terms show that vanish there.

        G first: what else is right would seem wrong with it.

        Raises:
            ContradictionError: Names function, entry, time, and both values.
        """
        with np.errstate(all="ignore"):
            states = [*self._states()]
            for claims in (self._of_gradient, self._of_tangents, self._of_rows):
                for state in states:
                    for claim in claims(*state):
                        if wrong := _contradicted(claim):
                            self._refuse(claim, *wrong, self._where(state))
            for state in states:
                self._require_energy(state)

    def _where(self, state: _State) -> str:
        """How errors name a state."""
        t, u, _ = state
        if u is self.problem.u0:
            return "at the start"
        return "next to the start" + (f", at t = {t:.9g}" if t != self.problem.t0 else "")

    def _refuse(self, claim: _Claim, k: int, expected: float, where: str) -> None:
        place = [number + 1 for number in claim.places[k]]
        entry = ("component {}", "row {}, column {}")[len(place) - 1].format(*place)
        raise ContradictionError(
            f"{self.named(claim.key)} disagrees with differences in {entry} {where}: "
            f"given {claim.given[k]:.9g}, differences say {expected:.9g}"
        )

    # -- each function -----------------------------------------------------------------------

    def _of_gradient(self, t: float, u: Array, v: Array) -> Iterator[_Claim]:
        """G is the derivative of Φ."""
        phi, sizes, g = self.functions["constraints"], _sizes(u), self._gradient(t, u)
        units, scaled = np.abs(g).max(axis=0), (np.abs(g) * sizes[:, None]).max(axis=0)
        nothing = _NOTHING * np.minimum(units, scaled / sizes[:, None])

        def values(i: int, s: float) -> Any:
            return phi(_moved(u, i, s), t)

        yield from _columns("gradient", g.T, values, sizes, nothing.T)

    def _of_tangents(self, t: float, u: Array, v: Array) -> Iterator[_Claim]:
        """X and Y are those of f + Gλ."""
        force, gradient = self.functions["force"], self.functions["gradient"]
        n, m, sizes = self.problem.n, self.problem.m, _sizes(u)
        units = np.abs(self._gradient(t, u)).max(axis=0)
        load = float(np.abs(_value(n, force, u, v, t)).max())
        multipliers = np.linspace(1.0, 2.0, m) * (load or 1.0) / np.where(units > 0, units, 1.0)

        def pull(j: int, s: float) -> Any:
            there = _moved(u, j, s)
            return -(force(there, v, t) + gradient(there, t) @ multipliers)

        def resistance(j: int, s: float) -> Any:
            return -force(u, _moved(v, j, s), t)

        for key, arguments, function, largest in (
            ("stiffness", (u, v, multipliers, t), pull, sizes),
            ("damping", (u, v, t), resistance, _sizes(v) if np.any(v) else sizes),
        ):
            if key in self.restated:
                matrix = _value(n * n, self.restated[key], *arguments).reshape(n, n)
                size = max(float(np.abs(matrix).max()), load / largest.max())
                nothing = np.full((n, n), _NOTHING * size)
                yield from _columns(key, matrix, function, largest, nothing)

    def _of_rows(self, t: float, u: Array, v: Array) -> Iterator[_Claim]:
        """Terms of Φ' and Φ''; what is not given of them follows from differences."""
        phi, gradient = self.functions["constraints"], self.functions["gradient"]
        n, m, size = self.problem.n, self.problem.m, float(_sizes(u).max())
        w = size * np.random.default_rng(1).normal(size=n)
        units = np.abs(self._gradient(t, u)).max(axis=0)
        units *= 1 + (np.abs(v).max() / size) ** 2
        at_pace = min(1.0, size / float(np.abs(v).max()) if np.any(v) else 1.0)
        at_once = min(at_pace, size / float(np.abs(w).max()))

        def moving(s: float) -> Any:
            rate, _ = self.problem.constraint_derivatives(t + s, u + s * v, v)
            return gradient(u + s * v, t + s).T @ v + rate

        def turning(s: float) -> Any:
            r = self.problem.constraint_rows(t + s, u + s * v, v, 0 * v).r
            return gradient(u + s * w, t) + r.reshape(n, m)

        rows: dict[str, tuple[tuple[Any, ...], Callable[[float], Any], float, tuple[int, ...]]] = {
            "constraint_rate": ((u, t), lambda s: phi(u, t + s), 1.0, (m,)),
            "curvature": ((u, v, t), moving, at_pace, (m,)),
            "rate_gradient": ((u, v, t), lambda s: gradient(u + s * v, t + s), at_pace, (n, m)),
            "acceleration_gradient": ((u, v, w, t), turning, at_once, (n, m)),
        }
        for key, (arguments, function, longest, shape) in rows.items():
            if key in self.restated:
                places = [*np.ndindex(shape)]
                values = _value(len(places), self.restated[key], *arguments)
                nothing = np.broadcast_to(units * (size if len(shape) == 1 else 1.0), shape)
                yield _Claim(
                    key, values, function, _LONGEST * longest, _NOTHING * nothing.ravel(), places
                )

    def _require_energy(self, of: _State) -> None:
        """The energy changes by nothing but dissipation, where neither depends on time.

        Half its rate on a motion less half of that on the motion with −v: dissipation takes
        from both.
        """
        energy, force, problem = self.restated.get("energy"), self.functions["force"], self.problem
        t, u, v = of
        loads = [_value(problem.n, force, u, v, t + s) for s in (0.0, 1e-3)]
        if energy is None or not (self._is_rigid and np.array_equal(loads[0], loads[1])):
            return
        direction = np.random.default_rng(2).normal(size=problem.n)
        state = self._onto(t, u, float(_sizes(u).max()) * direction)
        if state is None:
            return
        _, u, v = state
        load = float(np.abs(loads[0]).max())
        try:
            # Fast enough to need forces as large as these: coordinates say little of lengths.
            slow, fast = (self._system.accelerations(t, u, way)[0] for way in (0 * v, v))
            bend = float(np.abs(problem.M @ (fast - slow)).max())
            if bend and load:
                v = v * np.sqrt(load / bend)
            ahead, behind = (self._system.accelerations(t, u, way)[0] for way in (v, -v))
        except Exception:  # a singular position, or a function without a value
            return

        def change(s: float) -> Any:
            forth = energy(u + s * v, v + s * ahead, t)
            back = energy(u - s * v, -v + s * behind, t)
            return energy(u, v, t) + (forth - back) / 2  # its size tells what is rounding

        speed = float(np.abs(v).max())
        fastest = max(speed / _sizes(u).max(), np.abs(ahead).max() / (speed or 1.0)) or 1.0
        nothing = np.full(1, _TOLERANCE * load * speed)
        none = _Claim("energy", np.zeros(1), change, _LONGEST / fastest, nothing, [])
        if wrong := _contradicted(none):
            raise ContradictionError(
                f"{self.named('energy')} is not conserved {self._where(of)}: on a motion without "
                f"dissipation it changes by {wrong[1]:.3g} in a second"
            )

    def _gradient(self, t: float, u: Array) -> Array:
        n, m = self.problem.n, self.problem.m
        return _value(n * m, self.functions["gradient"], u, t).reshape(n, m)

    # -- states ------------------------------------------------------------------------------

    @cached_property
    def _system(self) -> Index1:
        return Index1(self.problem)

    @cached_property
    def _is_rigid(self) -> bool:
        """Whether the constraints do not depend on time."""
        problem, phi = self.problem, self.functions["constraints"]
        values = [_value(problem.m, phi, problem.u0, problem.t0 + s) for s in (0.0, 1e-3, 0.137)]
        return all(np.array_equal(values[0], other) for other in values[1:])

    def _states(self) -> Iterator[_State]:
        """The start, and two states next to it on the constraints, if there are any."""
        problem, random = self.problem, np.random.default_rng(0)
        t, u, v = problem.t0, problem.u0, problem.v0
        yield t, u, v
        largest = float(_sizes(u).max())
        sizes = np.where(np.abs(u) > 1e-6 * largest, np.abs(u), largest)
        for _ in range(2):
            away, turn = sizes * random.normal(size=problem.n), random.normal(size=problem.n)
            later = 0.0 if self._is_rigid else random.uniform(10.0, 100.0)
            for reach in _NEAR:
                speed = float(np.abs(v).max()) or reach / _NEAR[0] * largest
                near = self._onto(t + reach * later, u + reach * away, v + speed * turn)
                if near is not None:
                    yield near
                    break

    def _onto(self, t: float, u: Array, v: Array) -> _State | None:
        """The nearest state on the constraints; None where there is none close by.

        What a definition says need not hold elsewhere: a length may stand for a distance.
        """
        try:
            u, v = self._system.projected(t, self._system.nearest(t, u), v)
        except BaseException as error:  # an exit included
            if user_code.is_interrupt(error):
                raise
            return None
        missed = np.abs(_value(self.problem.m, self.functions["constraints"], u, t))
        lengths = np.linalg.norm(self._gradient(t, u), axis=0)
        met = np.all(missed <= _MET * float(_sizes(u).max()) * lengths)
        return (t, u, v) if met and np.all(np.isfinite(v)) else None


# -- one function of one number -------------------------------------------------------------


def _columns(
    key: str, matrix: Array, along: Callable[[int, float], Any], sizes: Array, nothing: Array
) -> Iterator[_Claim]:
    """That column j of a matrix, of G of its transpose, is the derivative of ``along(j, s)``."""
    largest = float(sizes.max())
    for j, own in enumerate(sizes.tolist()):
        first = _FIRST + round(np.log(largest / own) / np.log(_RATIO))
        places = [(j, i) if key == "gradient" else (i, j) for i in range(len(matrix))]
        yield _Claim(
            key, matrix[:, j], partial(along, j), _LONGEST * largest, nothing[:, j], places, first
        )


def _contradicted(claim: _Claim) -> tuple[int, float] | None:
    """The derivative that is most certainly wrong, and what it is; None where none is.

    Steps are numbered from the longest, 0.
    """
    given, first = claim.given, claim.first
    here = _value(len(given), claim.function, 0.0)
    quotients = np.full((_STEPS, 3, len(given)), np.nan)  # forward, backward and central
    doubted, load = np.isfinite(given), np.abs(here) / claim.longest
    lengths = _RATIO ** -np.arange(float(_STEPS))[:, None]
    for number in sorted(range(_STEPS), key=lambda number: abs(number - first)):
        step = claim.longest * _RATIO**-number
        ahead, behind = (_value(len(given), claim.function, shift) for shift in (step, -step))
        forward, backward = (ahead - here) / step, (here - behind) / step
        quotients[number] = latest = np.array([forward, backward, (forward + backward) / 2])
        sizes = np.maximum(np.abs(given), np.abs(latest))
        confirmed = np.abs(latest - given) <= _TOLERANCE * sizes + claim.nothing
        if number > first:  # the function may have changed by less than its rounding
            slope = np.nanmax(np.abs(quotients[first]), axis=0, initial=0.0)
            differences = np.abs(quotients) * lengths[:, :, None]
            rounding = _ROUNDING * (load + np.nanmax(differences, axis=(0, 1), initial=0.0))
            confirmed &= (latest != 0) | (slope * lengths[number] > rounding)
        doubted &= ~confirmed.any(axis=0)
        if not doubted.any():
            return None
    central = quotients[:, 2]
    # Quotients of rounded numbers are 0 over short steps; others only if all are.
    still = ~np.any(np.nan_to_num(quotients), axis=(0, 1)) & (np.abs(given) > 1e-6 * load)
    away = np.abs(central - given)
    worst, answer = 0.0, None
    for begin in range(1, _STEPS - _IN_A_ROW + 1):
        row = slice(begin, begin + _IN_A_ROW)
        settled = central[begin + 1]
        least, smallest = (np.abs(x[row]).min(axis=0) for x in (away, central))
        varied = np.ptp(central[row], axis=0)
        wrong = ((smallest > 0) | still) & (varied <= _SETTLED * least) & doubted
        # Longer steps see past backlash, and past the stairs that rounding makes.
        farther = np.minimum(np.abs(central[:begin] - settled), np.abs(given))
        wrong &= ~np.any(away[:begin] <= _NEARER * farther, axis=0)
        certainty = np.where(wrong, least / (varied + 1e-3 * least), 0.0)
        if (most := float(certainty.max())) > worst:
            k = int(np.argmax(certainty))
            worst, answer = most, (k, float(settled[k]))
    return answer


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
