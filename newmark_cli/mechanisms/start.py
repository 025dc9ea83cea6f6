"""Consistent starts: positions on the constraints, velocities that fit, no redundancy."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli import documents
from newmark_cli.algebra import solver
from newmark_cli.arrays import Array
from newmark_cli.documents import Document, KeyPath
from newmark_cli.mechanisms import elements, laws
from newmark_cli.mechanisms.models import Law
from newmark_cli.problems import index_1
from newmark_cli.problems.problem import Problem

#: Coordinates up to which ranks are found by dense factorisations, which also tell
#: which constraints depend on each other; beyond, pivots of a sparse one must do.
DENSE_UP_TO = 600
RANK_TOLERANCE = 1e-10
#: The same after a search, which finds a singular position only to half the digits.
RANK_TOLERANCE_FOUND = 1e-7
VELOCITY_TOLERANCE = 1e-9
MOST_CORRECTIONS = 50
#: What a position that was looked for may miss of a constraint, of the largest coordinate.
MISSED = 1e-9
#: Constraints that an error names.
MOST_NAMED = 12
#: How far from the start it is looked whether the start is singular, likewise.
_ASIDE = 1e-7


class Options(Protocol):
    """Requests of a mechanism about its start."""

    @property
    def assemble(self) -> bool:
        """Whether initial positions are a guess."""

    @property
    def project_velocities(self) -> bool:
        """Whether initial velocities are to be projected."""


def consistent(
    problem: Problem, options: Options, document: Document, paths: Sequence[KeyPath]
) -> Problem:
    """The problem with a consistent start.

    Args:
        problem: As given; its start may be a guess.
        options: Whether positions are assembled and velocities projected.
        document: Where the problem came from, for errors.
        paths: Key of each constraint in the document.

    Raises:
        DocumentError: When M is singular, constraints depend on each other or contradict
            each other, the start is a singular position, or velocities do not fit.
    """
    mistakes = documents.Mistakes()
    with mistakes.gathered():
        _require_mass(problem, document)
    if problem.m == 0:
        mistakes.note(document.error((), "has no constraints: the problem is not of index 3"))
        mistakes.refuse()
    with mistakes.gathered():
        problem = _fitted(problem, options, document, paths)
    mistakes.refuse()
    return problem


def law_parameters(
    law: Law, now: float, document: Document, path: KeyPath, period: float, guessed: bool
) -> tuple[float, ...]:
    """Parameters of a law of time that starts where the mechanism does.

    Args:
        law: The law.
        now: Where the mechanism starts.
        document, path: Where the law came from, for errors.
        period: Values that differ by it are the same; infinite for a length.
        guessed: Whether the start is a guess, which any law may leave.

    Raises:
        DocumentError: When it starts elsewhere.
    """
    parameters = law.parameters(now)
    begin = laws.begin(law, parameters[0])
    away = begin - now if math.isinf(period) else math.remainder(begin - now, period)
    if not guessed and abs(away) > 1e-9 * max(1.0, abs(now)):
        raise document.error(path, f"the law starts at {begin:.12g}, the mechanism at {now:.12g}")
    return parameters


def _fitted(
    problem: Problem, options: Options, document: Document, paths: Sequence[KeyPath]
) -> Problem:
    """The problem with positions on its constraints and velocities that fit them."""
    if options.assemble:
        problem = replace(problem, u0=_assembled(problem, document, paths))
    gradient = gradient_of(problem, problem.u0)
    tolerance = RANK_TOLERANCE_FOUND if options.assemble else RANK_TOLERANCE
    _require_independent(problem, gradient, tolerance, document, paths)
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, problem.v0)
    misfit = gradient.T @ problem.v0 + rate
    if options.project_velocities:
        return replace(problem, v0=_projected(problem, gradient, rate, document, paths))
    sizes = column_norms(gradient)
    speed = max(float(np.abs(problem.v0).max()), float(np.abs(rate / sizes).max()))
    mistakes = documents.Mistakes()
    missed = np.abs(misfit) / sizes
    for k in map(int, np.flatnonzero(np.abs(misfit) > VELOCITY_TOLERANCE * sizes * speed)):
        mistakes.note(
            document.error(
                paths[k],
                f"initial velocities violate this constraint by {missed[k]:.3g} "
                "m/s; correct them or set 'project_velocities: true'",
            )
        )
    mistakes.refuse()
    return problem


def _projected(
    problem: Problem,
    gradient: scipy.sparse.csc_array,
    rate: Array,
    document: Document,
    paths: Sequence[KeyPath],
) -> Array:
    """Velocities next to the initial ones with Gᵀv + Φ_t = 0.

    Next to a singular position the normal equations are singular long before G is, and
    velocities that a motion asks for there are beyond all bounds.
    """
    v, sizes = problem.v0, column_norms(gradient)
    left = np.abs(gradient.T @ v + rate) / sizes
    with np.errstate(all="ignore"):
        for _ in range(2):  # the first leaves what is rounding of a large change
            try:
                v = v - _least_change(gradient, gradient.T @ v + rate)
            except np.linalg.LinAlgError:  # exactly singular
                break
            left = np.abs(gradient.T @ v + rate) / sizes
            speed = max(float(np.abs(v).max()), float(np.abs(rate / sizes).max()))
            if np.all(left <= VELOCITY_TOLERANCE * speed):
                return v
    _require_independent(problem, gradient, RANK_TOLERANCE_FOUND, document, paths)
    worst = int(np.argmax(np.where(np.isfinite(left), left, np.inf)))
    raise document.error(
        paths[worst],
        "no velocities found that fit this constraint: the start is too close to a singular "
        "position, such as a dead centre; start from another position",
    )


def gradient_of(problem: Problem, u: Array) -> scipy.sparse.csc_array:
    """(n, m) sparse G at a position."""
    n, m, pattern = problem.n, problem.m, problem.pattern
    values = problem.values(problem.t0, u, problem.v0, np.zeros(m)).g
    return scipy.sparse.csc_array((values, (pattern.g_rows, pattern.g_columns)), shape=(n, m))


def column_norms(gradient: scipy.sparse.csc_array) -> Array:
    """(m,) 2-norms of the columns."""
    return np.asarray(np.sqrt(gradient.multiply(gradient).sum(axis=0))).ravel()


def _least_change(gradient: scipy.sparse.csc_array, misfit: Array) -> Array:
    """Smallest d with Gᵀ d = misfit."""
    return np.asarray(gradient @ solver(gradient.T @ gradient)(misfit))


def _damped_solver(gradient: scipy.sparse.csc_array, damping: float) -> Callable[[Array], Array]:
    """Solver of (GᵀG + damping I) x = rhs."""
    identity = scipy.sparse.eye_array(gradient.shape[1])
    return solver(gradient.T @ gradient + damping * identity)


def _damped_change(gradient: scipy.sparse.csc_array, misfit: Array, damping: float) -> Array:
    """The d of least |Gᵀ d − misfit|² + damping |d|², from the smaller of GᵀG and GGᵀ."""
    n, m = gradient.shape
    if m <= n:
        return np.asarray(gradient @ _damped_solver(gradient, damping)(misfit))
    transposed = scipy.sparse.csc_array(gradient.T)
    return np.asarray(_damped_solver(transposed, damping)(gradient @ misfit))


def _assembled(problem: Problem, document: Document, paths: Sequence[KeyPath]) -> Array:
    """Positions on the constraints near a guess, by Newton's method of least change."""
    u = problem.u0.copy()
    size = float(np.abs(u).max()) or 1.0
    # With more constraints than coordinates GᵀG is singular everywhere.
    for _ in range(MOST_CORRECTIONS if problem.m <= problem.n else 0):
        phi = problem.constraint_values(problem.t0, u)
        try:
            change = _least_change(gradient_of(problem, u), phi)
        except np.linalg.LinAlgError:  # exactly singular
            break
        if not np.all(np.isfinite(change)):
            break
        u -= change
        if np.abs(change).max() < 1e-15 * size:
            return u
    misfit = float(np.abs(problem.constraint_values(problem.t0, u)).max())
    if misfit < 1e-14 * size**2:
        return u
    u = _closest(problem, problem.u0)
    distances = _distances(problem, u)
    off = [k for k in range(problem.m) if distances[k] > MISSED * size]
    if not off:
        gradient = gradient_of(problem, u)
        if _dependent(gradient, RANK_TOLERANCE_FOUND):
            return u  # `_require_independent` says how they depend on each other there
        away = np.abs(u - problem.u0)
        point = problem.point_of(int(np.argmax(away)))
        raise document.error(
            ("assemble",),
            f"no position found near this guess: the closest moves {point} by {away.max():.3g} m; "
            "give a better guess",
        )
    worst = sorted(off, key=lambda k: -distances[k])[:MOST_NAMED]
    named = ", ".join(f"{_spelled(paths[k])} by {distances[k]:.3g} m" for k in sorted(worst))
    raise document.error(
        ("assemble",),
        "no position found from this guess: the closest one misses "
        f"{named}{', …' if len(off) > len(worst) else ''}; these contradict each other, or the "
        "guess is too far away",
    )


def _distances(problem: Problem, u: Array) -> Array:
    """(m,) by how much each length or place that a constraint asks for is missed (m)."""
    missed = problem.constraint_values(problem.t0, u)
    for ints, reals in zip(problem.ints, problem.reals, strict=True):
        if ints[elements.KIND] in (elements.LINK, elements.BAR):
            square, row = reals[elements.PARAMETER], ints[elements.ROW]
            missed[row] = np.sqrt(max(0.0, square + 2 * missed[row])) - np.sqrt(square)
    return np.abs(missed)


def _closest(problem: Problem, u: Array) -> Array:
    """Position near another that meets the constraints as well as possible.

    The method of Levenberg and Marquardt, which also converges where constraints depend
    on each other: the damping falls with what is missed.
    """
    scale = 1.0

    def missed(u: Array) -> tuple[float, Array]:
        phi = problem.constraint_values(problem.t0, u)
        size = float(np.linalg.norm(phi))
        return (size if np.isfinite(size) else np.inf), phi

    norm, phi = missed(u)
    for _ in range(MOST_CORRECTIONS):
        gradient = gradient_of(problem, u)
        largest = float(column_norms(gradient).max()) ** 2 or 1.0
        damping = scale * min(1.0, norm / largest) * largest + 1e-15 * largest
        try:
            step = _damped_change(gradient, phi, damping)
        except np.linalg.LinAlgError:
            break
        if not np.all(np.isfinite(step)) or np.abs(step).max() <= 1e-16 * np.abs(u).max():
            break
        moved = u - step
        found, phi_there = missed(moved)
        if found < norm:
            u, norm, phi, scale = moved, found, phi_there, scale / 8
        else:
            scale *= 10
    return u


def _require_mass(problem: Problem, document: Document) -> None:
    """Whatever can move carries mass: M is positive on the kernel of Gᵀ."""
    n, pattern = problem.n, problem.pattern
    diagonal = np.zeros(n)
    on = pattern.mass_rows == pattern.mass_columns
    np.add.at(diagonal, pattern.mass_rows[on], problem.mass_values[on])
    weak = np.flatnonzero(diagonal <= 0)
    if len(weak) == 0 and n <= DENSE_UP_TO:
        values = np.linalg.eigvalsh(problem.M)
        if values[0] <= 1e-13 * values[-1]:
            _, vectors = np.linalg.eigh(problem.M)
            weak = np.array([int(np.argmax(np.abs(vectors[:, 0])))])
    if len(weak) == 0:
        return
    if n <= DENSE_UP_TO and problem.m:
        gradient = np.asarray(gradient_of(problem, problem.u0).toarray())
        motions = index_1.weightless(problem.M, gradient)
        sizes = np.abs(motions).max(axis=1, initial=0.0)
        weak = np.flatnonzero(sizes > 1e-6 * sizes.max(initial=0.0))
    mistakes = documents.Mistakes()
    for point in dict.fromkeys(problem.point_of(int(i)) for i in weak):
        message = f"{point} carries no mass of its own; the mass matrix is singular"
        mistakes.note(document.error(("points", point), message))
    mistakes.refuse()


def _require_independent(
    problem: Problem,
    gradient: scipy.sparse.csc_array,
    tolerance: float,
    document: Document,
    paths: Sequence[KeyPath],
) -> None:
    """G must have full rank; names the constraints that depend on each other."""
    sizes = column_norms(gradient)
    idle = np.flatnonzero(sizes == 0)
    if len(idle):
        mistakes = documents.Mistakes()
        for k in map(int, idle):
            mistakes.note(document.error(paths[k], "does not constrain the initial position"))
        mistakes.refuse()
    involved = _dependent(gradient, tolerance)
    if not involved:
        return
    names = ", ".join(_spelled(paths[k]) for k in involved[:MOST_NAMED])
    message = f"redundant: these constraints depend on each other: {names}"
    if _singular_here(problem, gradient):
        message = (
            "the start is a singular position, such as a dead centre: only here do these "
            f"constraints depend on each other: {names}; start from another position"
        )
    raise document.error(paths[involved[-1]], message)


def _spelled(path: KeyPath) -> str:
    return ".".join(map(str, path))


def _dependent(gradient: scipy.sparse.csc_array, tolerance: float = RANK_TOLERANCE) -> list[int]:
    """Constraints with a share in a dependence, by their columns of G; none at full rank."""
    n, m = gradient.shape
    sizes = column_norms(gradient)
    scaled = scipy.sparse.csc_array(gradient / np.where(sizes > 0, sizes, 1.0)[None, :])
    if n <= DENSE_UP_TO:
        dense = np.asarray(scaled.toarray(), float)
        # Vectors take ten times as long as values, and are needed for the error only.
        values = np.linalg.svd(dense, compute_uv=False)
        rank = int(np.count_nonzero(values > tolerance * values[0]))
        if rank == m:
            return []
        _, _, vectors = np.linalg.svd(dense, full_matrices=False)
        # Length of each constraint's share in the null space; what is not in it is here.
        return _shared_in(np.sqrt(np.maximum(0.0, 1 - (vectors[:rank] ** 2).sum(axis=0))))
    try:
        factors = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(scaled.T @ scaled))
    except RuntimeError:
        pass
    else:
        pivots = np.abs(factors.U.diagonal())
        # Pivots of GᵀG are squares of what a rank would be judged by.
        if np.all(pivots >= tolerance**1.5 * pivots.max()):
            return []
    # Inverse iteration ends in the null space.
    solve = _damped_solver(scaled, 1e-13)
    vector = np.random.default_rng(0).normal(size=m)
    for _ in range(4):
        vector = solve(vector)
        vector /= np.abs(vector).max()
    return _shared_in(np.abs(vector))


def _shared_in(shares: Array) -> list[int]:
    return [int(k) for k in np.flatnonzero(shares > 1e-6)]


def _singular_here(problem: Problem, gradient: scipy.sparse.csc_array) -> bool:
    """Whether constraints that depend on each other at the start are independent elsewhere.

    Where the rank of G is the same all around, constraints can be followed in every
    direction that G allows.  At a singular position they cannot.
    """
    if problem.m > problem.n:
        return False
    u = problem.u0
    size = float(np.abs(u).max()) or 1.0
    solve = _damped_solver(gradient, 1e-13 * float(column_norms(gradient).max()) ** 2)
    random = np.random.default_rng(0)
    for _ in range(3):
        direction = random.normal(size=problem.n)
        direction -= direction.mean()
        length = np.linalg.norm(direction)
        for _ in range(2):
            direction = direction - gradient @ solve(gradient.T @ direction)
        if np.linalg.norm(direction) < 1e-6 * length:
            return False  # nothing can move: there are too many constraints everywhere
        direction *= _ASIDE * size / np.abs(direction).max()
        moved = _closest(problem, u + direction)
        if np.abs(moved - u - direction).max() > 0.1 * np.abs(direction).max():
            return True
        if not _dependent(gradient_of(problem, moved)):
            return True
    return False
