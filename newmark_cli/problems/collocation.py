"""Motions through singular positions: collocation at the nodes of Gauss.

Where the columns of G depend on each other, the index-1 system has no solution, and
close to it none that an explicit method could use: stages of a step miss the
constraints by the error of the stage, and the system multiplies that by 1/σ, σ the
smallest singular value of G.  The motion may be smooth all the same: a linkage runs
through its dead centre.  Such a motion is close to a polynomial u of degree N + 1 over a
step, which is found from

    M u'' = f + G λ,        0 = Φ(u, t)

at N nodes inside the step, by Newton's method for all nodes at once.  No node needs
to be where σ vanishes, so the matrix is regular; which of the branches that meet
there the motion takes is decided by its velocity, because the others have a kink.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss, legint, legval, legvander

from newmark_cli.problems.algebra import Factors, product
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.singular import crossings, gradient, scaled
from newmark_cli.support.arrays import Array

#: Most unknowns n + m: the matrix of a step has as many rows for each node.
LARGEST = 60
#: Degree up to which the polynomial of a step is a guess for the next one.
_GUESSED = 3
#: Newton corrections of a step, at most, and where they end (relative to max |u|):
#: converged, or as far as rounding lets them.
_MOST_CORRECTIONS, _CONVERGED, _ROUNDED = 15, 1e-14, 1e-9
#: Largest |Φ| at a singular position in parts of the coordinates, over which G would
#: have lost rank to rounding; a motion that comes close to one takes a sharp turn.
_MET = 1e-12
#: Shares of a step that are tried to keep its nodes away from a singular position, and
#: the distance that is far enough, in parts of the step.
_SHARES, _CLEAR = np.linspace(1.0, 0.5, 26), 0.03
#: A step that is shorter than this part of the longest one is not going anywhere.
_SHORTEST = 1e-7
_MOST_STEPS = 20_000


class NotSmoothError(Exception):
    """The motion does not go on as a smooth one at t (s); the text, a sentence's end, says why."""

    def __init__(self, t: float, reason: str) -> None:
        super().__init__(reason)
        self.t = t


@dataclass(frozen=True)
class Passage:
    """State at the end of a motion, and where it was singular on the way."""

    u: Array  #: (n,) coordinates and velocities
    v: Array
    singular: tuple[float, ...]  #: times at which G lost rank (s)


@dataclass(frozen=True)
class _Step:
    """A step that Newton's method has found."""

    u: Array  #: (n,) at its end
    v: Array
    g: Array  #: (N, n, m) G at the nodes
    coefficients: Array  #: (N, n + m) of u'' and λ in Legendre's polynomials over the step


class _Tables:
    """Nodes c (N,) in [0, 1]; weights (N + 1, N) that integrate once and twice.

    Their last row is for the end of the step.
    """

    def __init__(self, nodes: int) -> None:
        self.c = (leggauss(nodes)[0] + 1) / 2
        self.inverse = Factors(legvander(2 * self.c - 1, nodes - 1)).inverse()
        basis = [Legendre.basis(k, domain=[0, 1]) for k in range(nodes)]
        ends = np.append(self.c, 1.0)
        self.once, self.twice = (
            product(np.column_stack([p.integ(times, lbnd=0)(ends) for p in basis]), self.inverse)
            for times in (1, 2)
        )


_tables = cache(_Tables)


def motion(
    problem: Problem,
    end: float,
    sizes: Array,
    nodes: int,
    tolerance: float,
    projected: Callable[[float, Array, Array], tuple[Array, Array]],
    on_work: Callable[[], None],
) -> Passage:
    """The motion up to a time, through singular positions that it passes smoothly.

    Args:
        problem: The problem, of at most `LARGEST` unknowns.
        end: Time (s), not before the problem's start.
        sizes: (2,) of coordinates and velocities that errors refer to at first.
        nodes: N of a step, even.
        tolerance: Local, relative to the largest velocity.
        projected: Takes time and state to the nearest state on the constraints.
        on_work: Called now and then; an exception that it raises ends the work.

    Raises:
        NotSmoothError: The motion gets no further, or not in a way that is unique.
        numpy.linalg.LinAlgError: A matrix is singular.
    """
    t, u, v = problem.t0, problem.u0, problem.v0
    tables = _tables(nodes)
    middle = nodes // 2
    length, speed = sizes
    size = longest = min(end - t, 0.1 * length / speed)
    guess = None
    last = np.array([t]), gradient(problem, t, u)[None]
    singular: list[float] = []
    for _ in range(_MOST_STEPS):
        if t >= end:
            return Passage(u, v, tuple(singular))
        on_work()
        if size < _SHORTEST * longest:
            raise NotSmoothError(t, "it ends or is not smooth there")
        h = min(size, end - t)
        length, speed = max(length, np.abs(u).max()), max(speed, np.abs(v).max())
        step = _stepped(problem, tables, t, h, u, v, length, guess)
        if step is None:
            size = h / 2
            continue
        # Coefficients fall like a geometric series: the last one is about the square
        # of the middle one, which is well above rounding.
        error = np.abs(step.coefficients[middle : middle + 2, : problem.n]).max()
        error *= h / (np.sqrt(tolerance) * speed)
        # Three digits, as the last bits of powers are not the same everywhere.
        best = (
            round(float(np.clip(0.9 * error ** (-1 / middle), 0.3, 1.5)), 3) if error > 0 else 1.5
        )
        if error > 3:
            size = best * h
            continue
        times, g = _sampled(problem, tables, t, h, u, step)
        # With the end of the step before, whose last samples may be next to a zero.
        passed = [
            crossing
            for crossing in crossings(np.append(last[0], times), np.concatenate([last[1], g]))
            if crossing.t > last[0][-1]
        ]
        share = _share(tables, [(crossing.t - t) / h for crossing in passed])
        if share < 1:
            size = share * h
            continue
        for then, straight in passed:
            if not straight:
                raise NotSmoothError(then, "branches of the motion touch, and it may take either")
            gap = _gap(problem, t, h, u, v, step, then) / length
            if gap > _MET:
                raise NotSmoothError(then, f"up to a gap of {gap:.1g}, where the motion turns")
        singular += [crossing.t for crossing in passed]
        t = end if h == end - t else t + h
        u, v = projected(t, step.u, step.v)
        last, guess = (times[-2:], g[-2:]), step
        size, longest = best * h, max(longest, h)
    raise NotSmoothError(t, f"{_MOST_STEPS} steps reached no further")


def _sampled(
    problem: Problem, tables: _Tables, t: float, h: float, u: Array, step: _Step
) -> tuple[Array, Array]:
    """Times (N + 1,) and scaled G (N + 1, n, m) at the nodes and the end of a step."""
    end = gradient(problem, t + h, step.u)
    return t + h * np.append(tables.c, 1.0), np.concatenate([scaled(step.g), end[None]])


def _gap(
    problem: Problem, t: float, h: float, u: Array, v: Array, step: _Step, then: float
) -> float:
    """Distance (m) of a step's polynomial from the constraints at a time."""
    twice = legint(step.coefficients[:, : problem.n], 2, lbnd=-1, scl=0.5)
    share = (then - t) / h
    place = u + (then - t) * v + h * h * legval(2 * share - 1, twice)
    terms = problem.evaluate(then, place, v, np.zeros(problem.m))
    lengths = np.linalg.norm(terms.G, axis=0)
    return float(np.max(np.abs(terms.phi) / np.where(lengths > 0, lengths, 1.0)))


def _share(tables: _Tables, places: Sequence[float]) -> float:
    """Part of a step that keeps its nodes and ends away from places in it; 1 if it does."""
    marks = np.concatenate([[0], tables.c, [1]])

    def clearance(share: float) -> float:
        return min(float(np.abs(place / share - marks).min()) for place in places)

    if not places or clearance(1.0) >= _CLEAR:
        return 1.0
    return float(max(_SHARES, key=clearance))


def _stepped(
    problem: Problem,
    tables: _Tables,
    t: float,
    h: float,
    u: Array,
    v: Array,
    length: float,
    before: _Step | None,
) -> _Step | None:
    """One step, or None where Newton's method does not converge."""
    n, m, nodes = problem.n, problem.m, len(tables.c)
    once, twice = h * tables.once, h * h * tables.twice
    unit = float(np.abs(problem.mass_values).max())
    mass = problem.M / unit
    unknowns = _guess(tables, problem, before)
    drift = u + h * tables.c[:, None] * v
    before_size = np.inf
    for _ in range(_MOST_CORRECTIONS):
        a, multipliers = unknowns[:, :n], unknowns[:, n:]
        terms = [
            problem.evaluate(time, *state)
            for time, *state in zip(
                t + h * tables.c,
                drift + product(twice[:-1], a),
                v + product(once[:-1], a),
                multipliers,
                strict=True,
            )
        ]
        x, y, g = (np.array([getattr(term, name) for term in terms]) for name in "XYG")
        matrix = np.zeros((nodes, n + m, nodes, n + m))
        matrix[:, :n, :, :n] = np.einsum("ij,irc->irjc", twice[:-1] / unit, x)
        matrix[:, :n, :, :n] += np.einsum("ij,irc->irjc", once[:-1] / unit, y)
        matrix[:, n:, :, :n] = np.einsum("ij,icr->irjc", tables.twice[:-1], g)
        here = np.arange(nodes)
        matrix[here, :n, here, :n] += mass
        matrix[here, :n, here, n:] = -g
        residual = np.array(
            [
                np.concatenate([product(mass, a[i]) - term.force / unit, term.phi / (h * h)])
                for i, term in enumerate(terms)
            ]
        )
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(residual))):
            return None
        rows = nodes * (n + m)
        try:
            change = Factors(matrix.reshape(rows, rows)).solve(-residual.ravel())
        except np.linalg.LinAlgError:
            return None
        change = change.reshape(nodes, n + m)
        unknowns = unknowns + change * np.concatenate([np.ones(n), np.full(m, unit)])
        size = float(np.abs(product(twice, change[:, :n])).max()) / length
        if size <= _CONVERGED or before_size <= size <= _ROUNDED:
            a = unknowns[:, :n]
            coefficients = product(tables.inverse, unknowns)
            ahead, faster = product(twice[-1], a), product(once[-1], a)
            return _Step(u + h * v + ahead, v + faster, g, coefficients)
        before_size = size
    return None


def _guess(tables: _Tables, problem: Problem, before: _Step | None) -> Array:
    """(N, n + m) u'' and λ at the nodes, as the step before goes on."""
    if before is None:
        return np.zeros((len(tables.c), problem.n + problem.m))
    low = before.coefficients[: _GUESSED + 1]
    return product(legvander(2 * tables.c + 1, _GUESSED), low)
