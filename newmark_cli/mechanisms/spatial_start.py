"""Consistent starts of spatial mechanisms, and constraints that are redundant."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli import documents
from newmark_cli.algebra import Factors, solver
from newmark_cli.arrays import Array
from newmark_cli.documents import KeyPath
from newmark_cli.mechanisms.spatial_outputs import SpatialOutputs
from newmark_cli.mechanisms.start import (
    DENSE_UP_TO,
    MISSED,
    MOST_CORRECTIONS,
    MOST_NAMED,
    RANK_TOLERANCE,
    RANK_TOLERANCE_FOUND,
    VELOCITY_TOLERANCE,
    column_norms,
    gradient_of,
)
from newmark_cli.problems import index_1, redundancy
from newmark_cli.problems.problem import Problem
from newmark_cli.spelling import nearest

if TYPE_CHECKING:
    from newmark_cli.mechanisms.spatial import Builder

#: Largest inertia, relative to others, with which a motion has none.
_NO_INERTIA = 1e-13
#: Part of the largest share in what is redundant that a row must have to be dropped.
_SHARE = 0.5
#: What a sparse solution may miss, relative to what was asked for.
_SOLVED = 1e-6
#: How far from the start it is looked whether the start is singular.
_ASIDE = 0.05
#: Least size of a direction's part, relative to the largest, that words mention.
_SEEN = 1e-6


def consistent(builder: "Builder") -> Problem:
    """The problem of a mechanism, with a consistent start and without redundant rows.

    Raises:
        DocumentError: When constraints depend on each other or contradict each other, the
            start is a singular position, nothing can move, a motion has no inertia, or
            velocities do not fit.
    """
    problem = builder.problem()
    if builder.mechanism.assemble:
        problem = replace(problem, u0=_assembled(builder, problem))
    found = _independent(builder, problem)
    u0, v0 = problem.u0, problem.v0
    gradient = gradient_of(problem, u0)
    if found.released:
        problem = replace(builder.problem(found.released), u0=u0)
    known = replace(
        problem.drawing,
        shared=found.shared,
        freedom=found.freedom,
        mass_rank=_mass_rank(problem),
        loose=_loose(builder),
    )
    assert isinstance(problem.outputs, SpatialOutputs)
    outputs = replace(problem.outputs, shared=found.shared)
    problem = replace(problem, drawing_given=known, outputs=outputs)
    _require_inertia(builder, problem)
    return replace(problem, v0=_fitting_velocities(builder, problem, v0, gradient))


# -- redundancy -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Found:
    """Rows of an overconstrained mechanism that are dropped.

    Attributes:
        released: Numbers of the rows.
        shared: Joints whose rows have a share in what is redundant.
        freedom: Degrees of freedom.
    """

    released: tuple[int, ...]
    shared: frozenset[str]
    freedom: int


def _independent(builder: "Builder", problem: Problem) -> _Found:
    """Which rows to drop so that the rest is independent."""
    document, given = builder.document, builder.mechanism.redundant
    asked = _asked(builder)
    gradient = gradient_of(problem, problem.u0)
    sizes = column_norms(gradient)
    mistakes = documents.Mistakes()
    for k in map(int, np.flatnonzero(sizes == 0)):
        message = f"row {builder.rows[k][-1]} does not constrain the initial position"
        mistakes.note(document.error(builder.paths[k], message))
    mistakes.refuse()
    scaled = scipy.sparse.csc_array(gradient / sizes[None, :])
    tolerance = RANK_TOLERANCE_FOUND if builder.mechanism.assemble else RANK_TOLERANCE
    null = _null_space(scaled, tolerance)
    rank = scaled.shape[1] - null.shape[1]
    if rank == problem.n:
        _require_freedom(builder, scaled, tolerance)
    if null.shape[1] == 0:
        if asked:
            released = ", ".join(".".join(builder.rows[k]) for k in asked)
            message = f"nothing is redundant, {released} cannot be released"
            raise document.error(("redundant",), message)
        return _Found((), frozenset(), problem.n - rank)
    involved = [int(k) for k in np.flatnonzero(np.linalg.norm(null, axis=1) > 1e-6)]
    last = builder.paths[involved[-1]]
    if _singular_here(problem, scaled, tolerance, rank):
        raise document.error(
            last,
            "the start is a singular position: only here do these constraints depend on each "
            f"other: {_named(builder, involved)}; start from another position",
        )
    chosen = _dropped(builder, null)
    shared = frozenset(builder.owners[k][0] for k in involved if builder.owners[k][0])
    names = _named(builder, involved)
    if given == "refuse" or chosen is None:
        would = "no rows of joints can be dropped"
        if chosen is not None:
            listed = ", ".join(".".join(builder.rows[k]) for k in chosen)
            would = f"'redundant: drop' releases {listed}"
        raise document.error(
            last, f"redundant: these constraints depend on each other: {names}; {would}"
        )
    dropped = chosen if given == "drop" else asked
    kept = np.setdiff1d(np.arange(scaled.shape[1]), dropped).tolist()
    left = _null_space(scipy.sparse.csc_array(scaled[:, kept]), tolerance)
    if left.shape[1]:
        still = [kept[int(k)] for k in np.flatnonzero(np.linalg.norm(left, axis=1) > 1e-6)]
        raise document.error(
            ("redundant",),
            "these constraints still depend on each other: " + _named(builder, still),
        )
    if len(kept) < rank:
        listed = ", ".join(".".join(builder.rows[k]) for k in asked)
        raise document.error(
            ("redundant",),
            f"only {scaled.shape[1] - rank} of {listed} can be released: the rest is not redundant",
        )
    missed = np.abs(problem.constraint_values(problem.t0, problem.u0)) / sizes
    for k in dropped:
        if missed[k] > MISSED * max(1.0, float(np.abs(problem.u0).max())):
            raise document.error(
                builder.paths[k],
                f"cannot be closed: its row {builder.rows[k][-1]} is missed by {missed[k]:.3g}",
            )
    return _Found(tuple(dropped), shared, problem.n - rank)


def _asked(builder: "Builder") -> list[int]:
    """Rows that the file releases by name."""
    given, found = builder.mechanism.redundant, []
    if isinstance(given, str):
        return []
    document, mistakes = builder.document, documents.Mistakes()
    for joint, rows in given.items():
        path: KeyPath = ("redundant", joint)
        having = {row: k for k, (owner, row) in enumerate(builder.owners) if owner == joint}
        if not having:
            hint = nearest(joint, builder.mechanism.joints)
            mistakes.note(document.error(path, f"unknown joint {joint!r}{hint}"))
        for i, row in enumerate(rows):
            if having and row not in having:
                message = f"{joint} has no row {row!r}{nearest(row, having)}"
                mistakes.note(document.error((*path, i), message))
            elif having:
                found.append(having[row])
    mistakes.refuse()
    return sorted(set(found))


def _null_space(matrix: scipy.sparse.csc_array, tolerance: float) -> Array:
    """(m, k) orthonormal vectors with matrix @ vectors = 0; its columns have length 1."""
    if matrix.shape[0] > DENSE_UP_TO:
        return redundancy.null_space(matrix, tolerance)
    _, values, vectors = np.linalg.svd(np.asarray(matrix.toarray(), float), full_matrices=True)
    rank = int(np.count_nonzero(values > tolerance * values[0])) if len(values) else 0
    return np.asarray(vectors[rank:].T)


def _dropped(builder: "Builder", null: Array) -> list[int] | None:
    """The last row of the file with at least half of the largest share, until none has any.

    None where rows of joints do not suffice.
    """
    candidates = np.array([k for k, (owner, _) in enumerate(builder.owners) if owner], np.int64)
    found: list[int] = []
    while null.shape[1]:
        shares = np.linalg.norm(null[candidates], axis=1) if len(candidates) else np.zeros(1)
        largest = float(shares.max())
        if largest < 1e-6:
            return None
        place = int(np.flatnonzero(shares >= _SHARE * largest)[-1])
        row = int(candidates[place])
        candidates = np.delete(candidates, place)
        found.append(row)
        # Householder's reflection after which all but the first vector vanish in this row.
        axis = null[row].copy()
        axis[0] += math.copysign(float(np.linalg.norm(axis)), axis[0])
        axis /= np.linalg.norm(axis)
        null = null[:, 1:] - np.outer(2 * (null @ axis), axis[1:])
    return sorted(found)


def _singular_here(
    problem: Problem, scaled: scipy.sparse.csc_array, tolerance: float, rank: int
) -> bool:
    """Whether the rank of G is higher next to the start."""
    random = np.random.default_rng(0)
    free = _null_space(scaled.T.tocsc(), tolerance) if problem.n <= DENSE_UP_TO else None
    for _ in range(3):
        if free is None:
            direction = redundancy.along_null(scaled, random.normal(size=problem.n))
        elif free.shape[1]:
            direction = free @ random.normal(size=free.shape[1])
        else:
            return False
        moved = problem.u0 + _ASIDE * direction / np.abs(direction).max()
        u, missed = _closest(problem, moved)
        if missed > MISSED:
            continue
        gradient = gradient_of(problem, u)
        there = scipy.sparse.csc_array(gradient / column_norms(gradient)[None, :])
        if problem.m - _null_space(there, RANK_TOLERANCE_FOUND).shape[1] > rank:
            return True
    return False


def _closest(problem: Problem, u: Array) -> tuple[Array, float]:
    """A position next to another that meets all constraints, and what it misses of them.

    Newton's method of least change; least squares where constraints depend on each other.
    """
    size = max(1.0, float(np.abs(u).max()))
    missed = np.inf
    for _ in range(MOST_CORRECTIONS):
        phi = problem.constraint_values(problem.t0, u)
        missed = float(np.abs(phi).max()) / size
        if not np.isfinite(missed):
            break
        gradient = gradient_of(problem, u)
        if problem.n <= DENSE_UP_TO:
            change = _dense_change(gradient, phi)
        else:
            change = _least_change(gradient, phi)
        if not np.all(np.isfinite(change)):
            return u, np.inf
        # Far away Newton's steps are too long.
        step = float(np.abs(change).max())
        u = u - change * min(1.0, 0.5 * size / step if step else 1.0)
        if step <= 1e-15 * size:
            break
    phi = problem.constraint_values(problem.t0, u)
    return u, float(np.abs(phi).max()) / size


def _dense_change(gradient: scipy.sparse.csc_array, wanted: Array) -> Array:
    """Smallest d with Gᵀ d as wanted; the nearest where constraints depend on each other."""
    if (solve := _if_regular((gradient.T @ gradient).toarray())) is not None:
        return np.asarray(gradient @ solve(wanted))
    return np.asarray(np.linalg.lstsq(gradient.toarray().T, wanted, rcond=1e-9)[0])


def _if_regular(matrix: Array) -> Callable[[Array], Array] | None:
    """Solver of A x = rhs; None where A is singular, or close to it."""
    try:
        factors = Factors(matrix)
    except np.linalg.LinAlgError:
        return None
    pivots = np.abs(np.diagonal(factors.lu))
    return factors.solve if pivots.min() > RANK_TOLERANCE * pivots.max() else None


def _least_change(gradient: scipy.sparse.csc_array, wanted: Array) -> Array:
    """Smallest d with Gᵀ d as wanted, as far as constraints that depend on each other let it."""
    try:
        change = np.asarray(gradient @ solver(gradient.T @ gradient)(wanted))
    except np.linalg.LinAlgError:
        change = np.full(gradient.shape[0], np.nan)
    if np.linalg.norm(gradient.T @ change - wanted) <= _SOLVED * np.linalg.norm(wanted):
        return change
    return redundancy.least_change(gradient, wanted)


def _assembled(builder: "Builder", problem: Problem) -> Array:
    """Positions on the constraints near a guess."""
    u, missed = _closest(problem, problem.u0)
    if missed <= MISSED:
        return u
    phi = np.abs(problem.constraint_values(problem.t0, u))
    worst = sorted(np.argsort(-phi)[:MOST_NAMED].tolist()) if np.all(np.isfinite(phi)) else []
    named = ", ".join(
        f"{'.'.join(builder.rows[k])} by {phi[k]:.3g}" for k in worst if phi[k] > MISSED
    )
    raise builder.document.error(
        ("assemble",),
        f"no position found from this guess: the closest one misses {named or 'everything'}; "
        "these contradict each other, or the guess is too far away",
    )


def _named(builder: "Builder", rows: Sequence[int]) -> str:
    """Rows of joints, by joint; of other constraints where there are none."""
    joints: dict[str, list[str]] = {}
    for k in rows:
        owner, row = builder.owners[k]
        if owner:
            joints.setdefault(owner, []).append(row)
        elif len(builder.rows[k]) > 2:
            joints.setdefault(".".join(builder.rows[k]), [])
    if not joints:
        return ", ".join(".".join(builder.rows[k]) for k in rows[:MOST_NAMED])
    texts = [f"{joint} ({', '.join(of)})" if of else joint for joint, of in joints.items()]
    return ", ".join(texts[:MOST_NAMED]) + (", …" if len(texts) > MOST_NAMED else "")


def _require_freedom(builder: "Builder", scaled: scipy.sparse.csc_array, tolerance: float) -> None:
    """Where nothing is left free, motions have taken some of it."""
    passive = [k for k, path in enumerate(builder.paths) if path[0] != "motions"]
    null = _null_space(scipy.sparse.csc_array(scaled[:, passive]), tolerance)
    if len(passive) - null.shape[1] == scaled.shape[0]:
        raise builder.document.error(("joints",), "nothing can move: no freedom is left")


# -- inertia ----------------------------------------------------------------------------------


def _mass_rank(problem: Problem) -> int:
    """Rank of M, which is S ⊗ 1 for each body."""
    rank, diagonal = 0, np.zeros((problem.n // 12, 4, 4))
    rows, columns = problem.pattern.mass_rows, problem.pattern.mass_columns
    along = rows % 3 == 0
    body, i, j = rows[along] // 12, rows[along] % 12 // 3, columns[along] % 12 // 3
    diagonal[body, i, j] = problem.mass_values[along]
    values = np.linalg.eigvalsh(diagonal)
    for of_body in values:
        rank += 3 * int(np.count_nonzero(of_body > _NO_INERTIA * max(of_body[-1], 1e-300)))
    return rank


def _require_inertia(builder: "Builder", problem: Problem) -> None:
    """Whatever can move has inertia: M is positive on the kernel of Gᵀ."""
    gradient = gradient_of(problem, problem.u0)
    n = problem.n
    if n > DENSE_UP_TO:
        mass = _mass(problem)
        try:
            pivots = np.abs(scipy.sparse.linalg.splu(_saddle(mass, gradient)).U.diagonal())
            regular = bool(pivots.min() > _NO_INERTIA * pivots.max())
        except RuntimeError:
            regular = False
        if not regular:
            message = "something can move that has no inertia; the accelerations are undetermined"
            raise builder.document.error(("bodies",), message)
        return
    motions = index_1.weightless(problem.M, np.asarray(gradient.toarray()))
    if motions.size:
        raise builder.document.error(*_without_inertia(builder, problem.u0, motions[:, 0]))


def _without_inertia(builder: "Builder", u: Array, motion: Array) -> tuple[KeyPath, str]:
    """Key and words of a motion that has no inertia."""
    bodies = tuple(builder.mechanism.bodies)
    moving = motion.reshape(len(bodies), 4, 3)
    worst = int(np.argmax(np.abs(moving).max(axis=(1, 2))))
    directors, change = u.reshape(len(bodies), 4, 3)[worst, 1:], moving[worst, 1:]
    spin = directors @ (np.cross(directors, change).sum(axis=0) / 2)  # in body axes
    name, path = bodies[worst], ("bodies", bodies[worst])
    if np.abs(spin).max() < _SEEN * np.abs(moving[worst]).max():
        return path, f"nothing stops {name} from moving, and it has no mass"
    spin = spin / spin[int(np.argmax(np.abs(spin)))]
    axis = next(
        (letter for i, letter in enumerate("xyz") if np.abs(np.delete(spin, i)).max() < _SEEN),
        f"[{', '.join(f'{part:.3g}' for part in spin)}]",
    )
    return path, f"nothing stops {name} from spinning about {axis}, and it has no inertia there"


def _loose(builder: "Builder") -> tuple[str, ...]:
    """Bodies that no joint, spring or damper connects with anything, in free space."""
    held = {side.body for joint in builder.joints.values() for side in joint.sides}
    return tuple(name for i, name in enumerate(builder.mechanism.bodies) if i not in held)


# -- velocities -------------------------------------------------------------------------------


def _fitting_velocities(
    builder: "Builder", problem: Problem, v: Array, every: scipy.sparse.csc_array
) -> Array:
    """Velocities that fit the constraints, as the file asks for them.

    Args:
        builder: The mechanism.
        problem: Its problem, at its start.
        v: (n,) velocities that the file gives, for the directors of the file.
        every: G with the rows that were dropped.
    """
    mechanism, document = builder.mechanism, builder.document
    if mechanism.assemble:
        # The directors have moved, angular velocities are what they were.
        frames = problem.u0.reshape(-1, 4, 3)[:, 1:]
        v = v.copy().reshape(-1, 4, 3)
        for i, body in enumerate(mechanism.bodies.values()):
            v[i, 1:] = np.cross(body.angular_velocity, frames[i])
        v = v.ravel()
    gradient = gradient_of(problem, problem.u0)
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, v)
    if mechanism.rates or mechanism.project_velocities:
        return _projected(builder, problem, v, gradient, rate)
    sizes = column_norms(every)
    wanted = np.zeros(every.shape[1])
    names = set(problem.constraint_names)
    kept = [k for k, row in enumerate(builder.rows) if ".".join(row) in names]
    wanted[kept] = rate
    speed = max(float(np.abs(v).max()), float(np.abs(wanted / sizes).max()))
    missed = np.abs(every.T @ v + wanted)
    worst: dict[KeyPath, tuple[float, str]] = {}
    for k in map(int, np.flatnonzero(missed > VELOCITY_TOLERANCE * speed * sizes)):
        found = (float(missed[k]), builder.rows[k][-1])
        worst[builder.paths[k]] = max(worst.get(builder.paths[k], (0.0, "")), found)
    mistakes = documents.Mistakes()
    for path, (size, row) in worst.items():
        message = (
            f"initial velocities miss it by {size:.3g} (row {row}); correct them, give 'rates' of "
            "joints, or set 'project_velocities: true'"
        )
        mistakes.note(document.error(path, message))
    mistakes.refuse()
    return v


def _projected(
    builder: "Builder",
    problem: Problem,
    v: Array,
    gradient: scipy.sparse.csc_array,
    rate: Array,
) -> Array:
    """The velocities nearest to v in the norm of M that fit constraints and rates."""
    n = problem.n
    given = list(builder.rates(problem.u0))
    rows = scipy.sparse.csc_array(np.array([of_rate for _, of_rate, _ in given]).reshape(-1, n).T)
    every = scipy.sparse.csc_array(scipy.sparse.hstack([gradient, rows]))
    wanted = np.concatenate([-rate, [value for _, _, value in given]])
    sizes = column_norms(every)
    every, wanted = scipy.sparse.csc_array(every / sizes[None, :]), wanted / sizes
    mass = _mass(problem)
    saddle = _saddle(mass, every)
    solve = _solver_of_rates(saddle, n)
    for _ in range(3):  # the first leaves what is rounding of a large change
        v = v + solve(np.concatenate([np.zeros(n), wanted - every.T @ v]))[:n]
    left = np.abs(wanted - every.T @ v)
    speed = max(float(np.abs(v).max()), float(np.abs(wanted).max()))
    for k, (path, _, value) in enumerate(given, start=problem.m):
        if not left[k] <= VELOCITY_TOLERANCE * speed:
            reached = value - (wanted[k] - every[:, [k]].T @ v)[0] * sizes[k]
            raise builder.document.error(
                path,
                f"contradicts other rates or the constraints: {reached:.6g} is the nearest to "
                f"{value:g} that fits",
            )
    if not np.all(left <= VELOCITY_TOLERANCE * speed):
        k = int(np.argmax(left))
        raise builder.document.error(
            builder.paths[k] if k < len(builder.paths) else (),
            "no velocities found that fit this constraint and the rates",
        )
    return v


def _solver_of_rates(saddle: scipy.sparse.csc_array, n: int) -> Callable[[Array], Array]:
    """Solver of [[M, −G], [Gᵀ, 0]] x = rhs; the smallest x where rates depend on each other."""
    if n > DENSE_UP_TO:
        return lambda rhs: np.asarray(scipy.sparse.linalg.spsolve(saddle, rhs))
    dense = np.asarray(saddle.toarray(), float)
    return _if_regular(dense) or (
        lambda rhs: np.asarray(np.linalg.lstsq(dense, rhs, rcond=1e-13)[0])
    )


def _mass(problem: Problem) -> scipy.sparse.csc_array:
    """M, its largest entry 1."""
    pattern, values = problem.pattern, problem.mass_values
    places = pattern.mass_rows, pattern.mass_columns
    return scipy.sparse.csc_array((values / np.abs(values).max(), places), (problem.n,) * 2)


def _saddle(mass: scipy.sparse.csc_array, rows: scipy.sparse.csc_array) -> scipy.sparse.csc_array:
    """[[M, −G], [Gᵀ, 0]]."""
    blocks: list[list[Any]] = [[mass, -rows], [rows.T, None]]
    return scipy.sparse.csc_array(scipy.sparse.block_array(blocks))
