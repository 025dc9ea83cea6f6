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
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support.arrays import Array

#: Ratio of a step to the next, and how many there are; the longest, relative to the
#: coordinates, and the last over which a smooth function changes by more than its rounding.
#: No round numbers, lest they fit a period.
_RATIO, _STEPS, _LONGEST, _LONG = 4.0, 22, 0.095, 5
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
    size: float  #: steps are relative to it
    places: Sequence[tuple[int, ...]]  #: of the numbers in what the user's function returns
    nothing: float = 0.0  #: a difference that does not count


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

        Raises:
            ProblemError: Names function, entry, time, and both values.
        """
        with np.errstate(all="ignore"):
            states = [*self._states()]
            claims = [(claim, state) for state in states for claim in self._claims(*state)]
            # G first: what else is right would seem wrong with it.
            for claim, state in sorted(claims, key=lambda pair: pair[0].key != "gradient"):
                if wrong := _contradicted(claim):
                    k, expected = wrong
                    place = [number + 1 for number in claim.places[k]]
                    entry = ("component {}", "row {}, column {}")[len(place) - 1].format(*place)
                    raise ProblemError(
                        f"{self.named(claim.key)} disagrees with differences in {entry} "
                        f"{self._where(state)}: given {claim.given[k]:.9g}, differences say "
                        f"{expected:.9g}"
                    )
            for state in states if "energy" in self.restated else ():
                if (power := self._power(*state)) and (wrong := _contradicted(power)):
                    raise ProblemError(
                        f"{self.named('energy')} is not conserved {self._where(state)}: on a "
                        f"motion without dissipation it changes by {wrong[1]:.3g} in a second"
                    )

    def _where(self, state: _State) -> str:
        """How errors name a state."""
        t, u, _ = state
        if u is self.problem.u0:
            return "at the start"
        return "next to the start" + (f", at t = {t:.9g}" if t != self.problem.t0 else "")

    def _claims(self, t: float, u: Array, v: Array) -> Iterator[_Claim]:
        """What is said twice of a state; what is not given of Φ'' follows from differences."""
        force, phi, gradient = (self.functions[key] for key in ("force", "constraints", "gradient"))
        n, m, size, pace = self.problem.n, self.problem.m, _size(u), float(np.abs(v).max())
        g = _value(n * m, gradient, u, t).reshape(n, m)
        units, load = np.abs(g).max(axis=0), float(np.abs(_value(n, force, u, v, t)).max())
        multipliers = np.linspace(1.0, 2.0, m) * (load or 1.0) / np.where(units > 0, units, 1.0)
        w = size * np.random.default_rng(1).normal(size=n)

        def moving(s: float) -> Any:
            rate, _ = self.problem.constraint_derivatives(t + s, u + s * v, v)
            return gradient(u + s * v, t + s).T @ v + rate

        def turning(s: float) -> Any:
            r = self.problem.constraint_rows(t + s, u + s * v, v, 0 * v).r
            return gradient(u + s * w, t) + r.reshape(n, m)

        def pull(s: float, axis: Array) -> Any:
            there = u + s * axis
            return -(force(there, v, t) + gradient(there, t) @ multipliers)

        matrices: dict[str, tuple[tuple[Any, ...], Callable[..., Any], float]] = {
            "gradient": ((u, t), lambda s, axis: phi(u + s * axis, t), size),
            "stiffness": ((u, v, multipliers, t), pull, size),
            "damping": ((u, v, t), lambda s, axis: -force(u, v + s * axis, t), pace or size),
        }
        given = {"gradient": gradient, **self.restated}
        for key, (arguments, along, longest) in matrices.items():
            if key not in given:
                continue
            columns = m if key == "gradient" else n
            values = _value(n * columns, given[key], *arguments).reshape(n, columns)
            numbers = np.arange(n * columns).reshape(n, columns)
            for j, axis in enumerate(np.eye(n)):
                own = (j, slice(None)) if key == "gradient" else (slice(None), j)
                places = [divmod(number, columns) for number in numbers[own].tolist()]
                yield _Claim(key, values[own], partial(along, axis=axis), longest, places)
        at_pace = min(1.0, size / (pace or 1.0))
        at_once = min(at_pace, size / float(np.abs(w).max()))
        rows: dict[str, tuple[tuple[Any, ...], Callable[[float], Any], float, tuple[int, ...]]] = {
            "constraint_rate": ((u, t), lambda s: phi(u, t + s), 1.0, (m,)),
            "curvature": ((u, v, t), moving, at_pace, (m,)),
            "rate_gradient": ((u, v, t), lambda s: gradient(u + s * v, t + s), at_pace, (n, m)),
            "acceleration_gradient": ((u, v, w, t), turning, at_once, (n, m)),
        }
        for key, (arguments, function, longest, shape) in rows.items():
            if key in given:
                values = _value(int(np.prod(shape)), given[key], *arguments)
                yield _Claim(key, values, function, longest, [*np.ndindex(shape)])

    def _power(self, t: float, u: Array, v: Array) -> _Claim | None:
        """The energy changes by nothing but dissipation, where neither depends on time.

        Half its rate on a motion less half of that on the motion with −v: dissipation takes
        from both.
        """
        energy, force, problem = self.restated["energy"], self.functions["force"], self.problem
        loads = [_value(problem.n, force, u, v, t + s) for s in (0.0, 1e-3)]
        state = None
        if self._is_rigid and np.array_equal(loads[0], loads[1]):
            direction = np.random.default_rng(2).normal(size=problem.n)
            state = self._onto(t, u, _size(u) * direction)
        if state is None:
            return None
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
            return None
        speed = float(np.abs(v).max())

        def change(s: float) -> Any:
            forth = energy(u + s * v, v + s * ahead, t)
            back = energy(u - s * v, -v + s * behind, t)
            return energy(u, v, t) + (forth - back) / 2  # its size tells what is rounding

        fastest = max(speed / _size(u), np.abs(ahead).max() / (speed or 1.0)) or 1.0
        return _Claim("energy", np.zeros(1), change, 1 / fastest, [], _TOLERANCE * load * speed)

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
        largest = _size(u)
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
            terms = self.problem.evaluate(t, u, v, np.zeros(self.problem.m))
        except BaseException as error:  # an exit included
            if user_code.is_interrupt(error):
                raise
            return None
        lengths = np.linalg.norm(terms.G, axis=0)
        met = np.all(np.abs(terms.phi) <= _MET * _size(u) * lengths)
        return (t, u, v) if met and np.all(np.isfinite(v)) else None


def _contradicted(claim: _Claim) -> tuple[int, float] | None:
    """The derivative that is most certainly wrong, and what it is; None where none is."""
    given, longest = claim.given, _LONGEST * claim.size
    here = _value(len(given), claim.function, 0.0)
    quotients = np.full((_STEPS, 3, len(given)), np.nan)  # forward, backward and central
    doubted, load = np.isfinite(given), np.abs(here) / longest
    lengths = _RATIO ** -np.arange(float(_STEPS))[:, None, None]
    for number in range(_STEPS):
        step = longest * _RATIO**-number
        ahead, behind = (_value(len(given), claim.function, shift) for shift in (step, -step))
        forward, backward = (ahead - here) / step, (here - behind) / step
        quotients[number] = latest = np.array([forward, backward, (forward + backward) / 2])
        sizes = np.maximum(np.abs(given), np.abs(latest))
        nothing = claim.nothing + _NOTHING * np.nanmax(sizes, initial=np.nanmax(load, initial=0))
        confirmed = np.abs(latest - given) <= _TOLERANCE * sizes + nothing
        if number > _LONG:  # the function may have changed by less than its rounding
            slope = np.nanmax(np.abs(quotients[_LONG]), axis=0, initial=0.0)
            changes = np.nanmax(np.abs(quotients) * lengths, axis=(0, 1), initial=0.0)
            confirmed &= (latest != 0) | (slope * lengths[number] > _ROUNDING * (load + changes))
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


def _size(vector: Array) -> float:
    """Of its largest component, which may be 0 at the moment."""
    return float(np.abs(vector).max()) or 1.0
