"""Consistent starts: positions on the constraints, no redundant row, velocities that fit."""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from newmark_cli.mechanisms import laws
from newmark_cli.mechanisms.builder import Builder, Row
from newmark_cli.mechanisms.positions import (
    DENSE_UP_TO,
    MISSED,
    RANK_TOLERANCE,
    least_change,
    on_constraints,
    size_of,
    solver_if_regular,
)
from newmark_cli.problems import index_1, redundancy
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.redundancy import column_norms, gradient_of
from newmark_cli.support import documents
from newmark_cli.support.arrays import Array
from newmark_cli.support.documents import KeyPath
from newmark_cli.support.spelling import nearest

#: `RANK_TOLERANCE` after a search, which finds a singular position only to half the digits.
RANK_TOLERANCE_FOUND = 1e-7
VELOCITY_TOLERANCE = 1e-9
#: Constraints that an error names.
MOST_NAMED = 12
#: Parts that are named where no position is found.
_MOST_PARTS = 4
#: Part of a row in what depends on each other, from which on it has a share in it.
_INVOLVED = 1e-6
#: Part of the largest share in what is redundant that a row must have to be dropped.
_SHARE = 0.5
#: Part of what makes a choice good at the start that it must keep along the motion, what is left
#: of a number that counts as equal, and most work of looking for another choice.
_LASTING, _TIE, _MOST_WORK = 0.2, 0.999, 1e8
#: States of the motion that are looked at ahead, fewest of a large mechanism, coordinates from
#: which on it is one, what a step between two states is of a turn (rad) or the mechanism's size,
#: its corrections, and how many directions are taken where there are several degrees of freedom.
_STATES, _FEWEST, _SMALL, _STEP, _CORRECTED, _WALKS = 80, 8, 60, 0.15, 4, 4
#: What rows that a file releases by name may lack to be redundant.
_NEARLY = 1e-4
#: Largest singular value, relative to the largest of G, that rounding of data can make of 0; the
#: largest of it some way from the start; how far that is; and how far others are above it.
_ALMOST, _ALMOST_ASIDE, _AWAY, _APART = 1e-6, 1e-3, 1e-2, 100.0
#: Least pivot, relative to the largest, with which accelerations are determined.
_NO_INERTIA = 1e-13
#: How far from the start it is looked whether the start is singular, of the largest
#: coordinate, and the tolerance of the rank there.
_ASIDE, _RANK_TOLERANCE_ASIDE = 1e-6, 1e-8


def consistent(builder: Builder) -> Problem:
    """The problem of a mechanism, with a consistent start and without redundant rows.

    Raises:
        DocumentError: When constraints depend on each other or contradict each other, the
            start is a singular position, nothing can move, a motion has no inertia, or
            velocities do not fit.
    """
    problem, mechanism, document = builder.problem(), builder.mechanism, builder.document
    if problem.m == 0:
        raise document.error((), "has no constraints: the problem is not of index 3")
    named = _released_by_name(builder)
    if mechanism.assemble:
        problem = replace(problem, u0=_assembled(builder, builder.problem(named), named))
    mistakes = documents.Mistakes()
    every = gradient_of(problem, problem.u0)
    with mistakes.gathered():
        tolerance = RANK_TOLERANCE_FOUND if mechanism.assemble else RANK_TOLERANCE
        released, shared = _independent(builder, problem, every, tolerance, named)
        if released:
            scaled = scipy.sparse.csc_array(every.multiply(_scale(problem.u0)[:, None]))
            gaps = partial(redundancy.gaps, problem, released, column_norms(scaled))
            problem = replace(builder.problem(released, shared), u0=problem.u0, gaps=gaps)
        problem = replace(problem, v0=_velocities(builder, problem, released, every))
    if problem.n > DENSE_UP_TO:
        mistakes.refuse()  # inertia is looked for with rows that are independent
    with mistakes.gathered():
        _require_inertia(builder, problem)
    mistakes.refuse()
    return problem


# -- positions --------------------------------------------------------------------------------


def _assembled(builder: Builder, problem: Problem, named: Sequence[int]) -> Array:
    """Positions on the constraints near a guess; the problem lacks rows that the file names."""
    u = on_constraints(problem, problem.u0)
    missed = _missed_by_part(builder, problem, u, named)
    if not missed:
        return u
    hint, unit = "", " m"
    if len(problem.axes) == 3:  # where what one joint misses is soon spread over all bodies
        guessed, unit = _missed_by_part(builder, problem, problem.u0, named), ""
        hint = "".join(f" {part} is open by {by:.3g} there;" for part, by in [*guessed.items()][:1])
    parts = ", ".join(f"{part} by {by:.3g}{unit}" for part, by in [*missed.items()][:_MOST_PARTS])
    raise builder.document.error(
        ("assemble",),
        f"no position found from this guess:{hint} the closest one misses {parts}"
        f"{', …' if len(missed) > _MOST_PARTS else ''}; these contradict each other, or the guess "
        "is too far away",
    )


def _missed_by_part(
    builder: Builder, problem: Problem, u: Array, named: Sequence[int]
) -> dict[str, float]:
    """Part → largest misfit among its constraints, in descending order."""
    missed = np.zeros(len(builder.rows))
    missed[_without(len(missed), named)] = problem.constraint_values(problem.t0, u)
    for k, square in builder.squares.items():  # by how much the length is missed
        missed[k] = np.sqrt(max(0.0, square + 2 * missed[k])) - np.sqrt(square)
    largest: dict[tuple[bool, str], float] = {}
    for row, by in zip(builder.rows, np.abs(missed).tolist(), strict=True):
        if not by <= MISSED * size_of(u):
            rigid = not row.owner  # what keeps a body rigid comes last
            part = rigid, str(row.parts[0]) if row.name else row.full
            largest[part] = max(largest.get(part, 0.0), by)
    order = sorted(largest, key=lambda part: (part[0], -largest[part]))
    return {part[1]: largest[part] for part in order}


# -- redundancy -------------------------------------------------------------------------------


def _independent(
    builder: Builder, problem: Problem, gradient: scipy.sparse.csc_array, tolerance: float,
    named: Sequence[int] = (),
) -> tuple[list[int], frozenset[str]]:  # fmt: skip
    """Rows to drop, and parts that share in the redundancy.

    Rows that the file names are released before anything is asked of the rest.
    """
    document, rows = builder.document, builder.rows
    redundant = getattr(builder.mechanism, "redundant", "refuse")
    sizes = column_norms(gradient)
    useless = [rows[k] for k in np.flatnonzero(sizes == 0)]
    message = "does not constrain the initial position"
    document.refuse(
        (row.path, f"row {row.name} {message}" if row.name else message) for row in useless
    )
    scaled = scipy.sparse.csc_array(gradient / sizes[None, :])
    null = _null_space(scaled, RANK_TOLERANCE if named else tolerance)
    rank = problem.m - null.shape[1]
    found, kept = null, _without(problem.m, named)
    if named:
        found = _released_null(builder, scaled, kept, named, tolerance)
    _require_distinct(builder, problem, scaled, kept, tolerance)
    if problem.m - found.shape[1] == problem.n:
        _require_freedom(builder, problem, scaled, kept, tolerance)
    if found.shape[1] == 0:
        return [], frozenset()
    involved = _involved(found)
    last, names = rows[involved[-1]].path, _by_part(rows, involved)
    if null.shape[1] and not named and _singular_here(problem, scaled, tolerance, rank):
        raise document.error(
            last,
            "the start is a singular position, such as a dead centre: only here do these "
            f"constraints depend on each other: {names}; start from another position",
        )
    dropped: Sequence[int] | None = named
    if not named and (dropped := _dropped(rows, found)):
        dropped = _exchanged(rows, dropped, _along(builder, found, problem.u0, tolerance))
    if redundant == "refuse" or dropped is None:
        message = f"redundant: these constraints depend on each other: {names}"
        if dropped is not None:
            message += f"; 'redundant: drop' releases {_listed(rows, dropped)}"
        elif redundant != "refuse":
            message += "; no rows of joints can be dropped"
        raise document.error(last, message)
    missed = np.abs(problem.constraint_values(problem.t0, problem.u0)) / sizes
    for k in dropped:
        if missed[k] > (_NEARLY if named else MISSED) * max(1.0, size_of(problem.u0)):
            message = f"cannot be closed: its row {rows[k].name} is missed by {missed[k]:.3g}"
            raise document.error(rows[k].path, message)
    shared = frozenset(rows[k].owner for k in involved if rows[k].name and rows[k].owner)
    return list(dropped), shared


def _without(count: int, numbers: Sequence[int]) -> list[int]:
    return [int(k) for k in np.setdiff1d(np.arange(count), numbers)]


def _released_null(
    builder: Builder, scaled: scipy.sparse.csc_array, kept: Sequence[int], named: Sequence[int],
    tolerance: float,
) -> Array:  # fmt: skip
    """(m, k) orthonormal: how rows that the file names depend on the rest, nearly at least.

    Raises:
        DocumentError: When the rest depends on itself, or they do not depend on it.
    """
    rows, rest = builder.rows, scipy.sparse.csc_array(scaled[:, kept])
    left = _null_space(rest, tolerance)
    if left.shape[1]:
        still = _by_part(rows, [kept[k] for k in _involved(left)])
        message = f"these constraints still depend on each other: {still}"
        raise builder.document.error(("redundant",), message)
    null, away = redundancy.dependence(rest, scaled[:, named].toarray())
    needed = int(np.count_nonzero(np.linalg.svd(away, compute_uv=False) > _NEARLY))
    if needed:
        listed = _listed(rows, named)
        message = f"nothing is redundant, {listed} cannot be released"
        if needed < len(named):
            message = f"only {len(named) - needed} of {listed} can be released: the rest is "
            message += "not redundant"
        raise builder.document.error(("redundant",), message)
    every = np.empty((scaled.shape[1], len(named)))
    every[kept], every[list(named)] = -null, np.eye(len(named))
    return np.asarray(np.linalg.qr(every)[0])


def _require_distinct(
    builder: Builder, problem: Problem, scaled: scipy.sparse.csc_array, kept: Sequence[int],
    tolerance: float, most: float = _ALMOST,
) -> None:  # fmt: skip
    """Refuse rows that are redundant but for the last digits of their data.

    Next to a dead centre singular values are as small, but not aside of it.
    """
    rows = builder.rows
    passive = _passive(builder, kept)
    if problem.n > DENSE_UP_TO or not passive:
        return
    dense = np.asarray(scaled[:, passive].toarray(), float)
    values = np.linalg.svd(dense, compute_uv=False)
    values = values[values > tolerance * values[0]]
    large = values[values > most * values[0]]
    free = problem.n - len(large)
    if len(large) == len(values) or not free or large[-1] < _APART * values[len(large)]:
        return
    vectors, _, turned = np.linalg.svd(dense)
    direction = vectors[:, -free:] @ np.random.default_rng(0).normal(size=free)
    direction *= _AWAY * size_of(problem.u0) / np.abs(direction).max()
    aside = gradient_of(problem, problem.u0 + direction).toarray()[:, passive]
    aside = np.linalg.svd(aside / np.linalg.norm(aside, axis=0), compute_uv=False)
    if not aside[min(len(large), len(aside) - 1)] < _ALMOST_ASIDE * aside[0]:
        return
    null = np.zeros((len(rows), len(passive) - len(large)))
    null[passive] = turned[len(large) :].T
    chosen, involved = _dropped(rows, null), _involved(null)
    way_out = "correct what is a little off, or leave out what is redundant"
    if chosen is not None:
        of_joints: dict[str, list[str]] = {}
        for k in chosen:
            of_joints.setdefault(rows[k].owner, []).append(rows[k].name)
        named = ", ".join(f"{joint}: [{', '.join(of)}]" for joint, of in of_joints.items())
        way_out = f"correct what is a little off, or release rows: 'redundant: {{{named}}}'"
    raise builder.document.error(
        rows[involved[-1]].path,
        f"these constraints nearly depend on each other: {_by_part(rows, involved)}; the least "
        f"singular value of G is {values[-1]:.2g}; {way_out}",
    )


def _released_by_name(builder: Builder) -> list[int]:
    """Rows that the file releases by name."""
    redundant = getattr(builder.mechanism, "redundant", "refuse")
    if isinstance(redundant, str):
        return []
    mistakes: list[tuple[KeyPath, str]] = []
    released = []
    for joint, names in redundant.items():
        path: KeyPath = ("redundant", joint)
        having = {row.name: k for k, row in enumerate(builder.rows) if row.owner == joint}
        if not having:
            hint = nearest(joint, builder.mechanism.joints)
            mistakes.append((path, f"unknown joint {joint!r}{hint}"))
        for i, name in enumerate(names):
            if having and name not in having:
                mistakes.append(((*path, i), f"{joint} has no row {name!r}{nearest(name, having)}"))
            elif having:
                released.append(having[name])
    builder.document.refuse(mistakes)
    return sorted(set(released))


def _null_space(matrix: scipy.sparse.csc_array, tolerance: float) -> Array:
    """(m, k) orthonormal basis of the null space; the matrix has columns of length 1."""
    if matrix.shape[0] > DENSE_UP_TO:
        return redundancy.null_space(matrix, tolerance)
    dense = np.asarray(matrix.toarray(), float)
    # Vectors take ten times as long as values, and are seldom needed.
    values = np.linalg.svd(dense, compute_uv=False)
    rank = int(np.count_nonzero(values > tolerance * values[0])) if len(values) else 0
    if rank == dense.shape[1]:
        return np.zeros((rank, 0))
    return np.asarray(np.linalg.svd(dense, full_matrices=True)[2][rank:].T)


def _involved(null: Array) -> list[int]:
    return [int(k) for k in np.flatnonzero(np.linalg.norm(null, axis=1) > _INVOLVED)]


def _dropped(rows: Sequence[Row], null: Array) -> list[int] | None:
    """The last row of the file with at least half of the largest share, until none has any.

    None where rows of joints do not suffice.
    """
    candidates = np.array([k for k, row in enumerate(rows) if row.path[0] == "joints"], np.int64)
    chosen: list[int] = []
    while null.shape[1]:
        shares = np.linalg.norm(null[candidates], axis=1) if len(candidates) else np.zeros(1)
        largest = float(shares.max())
        if largest < _INVOLVED:
            return None
        place = int(np.flatnonzero(shares >= _SHARE * largest)[-1])
        row = int(candidates[place])
        candidates = np.delete(candidates, place)
        chosen.append(row)
        # Householder's reflection after which all but the first vector vanish in this row.
        axis = null[row].copy()
        axis[0] += math.copysign(float(np.linalg.norm(axis)), axis[0])
        axis /= np.linalg.norm(axis)
        null = null[:, 1:] - np.outer(2 * (null @ axis), axis[1:])
    return sorted(chosen)


def _exchanged(rows: Sequence[Row], chosen: Sequence[int], nulls: Sequence[Array]) -> list[int]:
    """The same rows where they are redundant along the motion, too, or others that are.

    Rows are redundant together as far as their part of a null space (m, k) is regular, by its least
    singular value.  Where that falls below a part of the start's, one row after the other is
    exchanged for the one that raises the least along the motion most.
    """
    null, best = np.array(nulls), list(chosen)
    candidates = [k for k, row in enumerate(rows) if row.path[0] == "joints"]

    def least(choices: Any) -> Array:
        values = np.linalg.svd(null[:, np.array(choices)], compute_uv=False)
        return np.asarray(values[..., -1].min(axis=0))

    here = float(least([best])[0])
    if here >= _LASTING * np.linalg.svd(null[0, best], compute_uv=False)[-1]:
        return best
    while True:
        others = [
            sorted({*best} - {out} | {into})
            for out in best
            for into in candidates
            if into not in best
        ]
        if not others or len(null) * len(others) * len(best) ** 3 > _MOST_WORK:
            return best
        values = least(others)
        if not values.max() > here / _TIE:
            return best
        here = float(values.max())
        best = max(others[k] for k in np.flatnonzero(values >= _TIE * here))


def _along(builder: Builder, null: Array, u: Array, tolerance: float) -> list[Array]:
    """A null space (m, k) at the start, and those along the motion, at most `_STATES`.

    The motion is that of all constraints without what drives them.  Where it has one degree of
    freedom it is followed for a turn and more, otherwise in some random directions.
    """
    passive = _passive(builder, range(len(builder.rows)))
    rows = [builder.rows[k] for k in passive]
    problem = builder.problem(_without(len(builder.rows), passive))
    nulls, random, scale = [null], np.random.default_rng(0), _scale(u)
    scaled, found = _null_at(problem, u, tolerance)
    if found.shape[1] != null.shape[1]:
        return nulls  # what drives has a share in it
    single = problem.n - problem.m + found.shape[1] == 1
    states = max(_FEWEST, int(_STATES * min(1.0, (_SMALL / problem.n) ** 2)))
    for _ in range(1 if single else _WALKS):
        place, here, there = u, scaled, found
        direction = random.normal(size=problem.n) * scale
        for _ in range(states if single else states // _WALKS):
            # Rows that are independent here are followed: off the motion all of them contradict
            # each other.
            if (chosen := _dropped(rows, there)) is None:
                break
            direction = redundancy.along_null(here, direction)
            step = direction * (_STEP / max(float(np.abs(direction / scale).max()), 1e-300))
            moved, kept = place + step, _without(problem.m, chosen)
            for _ in range(_CORRECTED):
                missed = problem.constraint_values(problem.t0, moved)[kept]
                moved = moved - least_change(gradient_of(problem, moved)[:, kept], missed)
            if not np.abs((moved - place - step) / scale).max() < _STEP:
                break  # the motion ends here
            direction, place = moved - place, moved
            here, there = _null_at(problem, place, _RANK_TOLERANCE_ASIDE)
            if there.shape[1] == null.shape[1]:
                every = np.zeros_like(null)
                every[passive] = there
                nulls.append(every)
    return nulls


def _null_at(problem: Problem, u: Array, tolerance: float) -> tuple[scipy.sparse.csc_array, Array]:
    """G with columns of length 1, and its null space, at a position."""
    gradient = gradient_of(problem, u)
    scaled = scipy.sparse.csc_array(gradient / column_norms(gradient)[None, :])
    return scaled, _null_space(scaled, tolerance)


def _scale(u: Array) -> Array:
    """(n,) what is large of a coordinate in space: the size of the mechanism, 1 of directors."""
    scale = np.ones((len(u) // 12, 4, 3))
    places = u.reshape(-1, 4, 3)[:, 0]
    scale[:, 0] = float(np.ptp(places, axis=0).max()) or float(np.abs(places).max()) or 1.0
    return scale.ravel()


def _singular_here(
    problem: Problem, scaled: scipy.sparse.csc_array, tolerance: float, rank: int
) -> bool:
    """Whether constraints that depend on each other at the start are independent elsewhere.

    Where the rank of G is the same all around, constraints can be followed in every
    direction that G allows.  At a singular position they cannot.
    """
    random, size = np.random.default_rng(0), size_of(problem.u0)
    free = _null_space(scaled.T.tocsc(), tolerance) if problem.n <= DENSE_UP_TO else None
    for _ in range(3):
        if free is None:
            direction = redundancy.along_null(scaled, random.normal(size=problem.n))
        elif free.shape[1]:
            direction = free @ random.normal(size=free.shape[1])
        else:
            return False  # nothing can move: there are too many constraints everywhere
        direction *= _ASIDE * size / np.abs(direction).max()
        moved = on_constraints(problem, problem.u0 + direction)
        if np.abs(moved - problem.u0 - direction).max() > 0.1 * np.abs(direction).max():
            return True
        _, null = _null_at(problem, moved, _RANK_TOLERANCE_ASIDE)
        if problem.m - null.shape[1] > rank:
            return True
    return False


def _listed(rows: Sequence[Row], numbers: Sequence[int]) -> str:
    return ", ".join(rows[k].full for k in numbers)


def _by_part(rows: Sequence[Row], numbers: Sequence[int]) -> str:
    """Rows by the part that they belong to; what keeps bodies rigid only where it is all."""
    parts: dict[str, list[str]] = {}
    for k in numbers:
        if rows[k].owner:
            parts.setdefault(rows[k].owner, []).extend(filter(None, [rows[k].name]))
    texts = [f"{part} ({', '.join(of)})" if of else part for part, of in parts.items()]
    texts = texts or [rows[k].full for k in numbers]
    return ", ".join(texts[:MOST_NAMED]) + (", …" if len(texts) > MOST_NAMED else "")


def _passive(builder: Builder, kept: Iterable[int]) -> list[int]:
    return [k for k in kept if builder.rows[k].path[0] != "motions"]


def _require_freedom(
    builder: Builder, problem: Problem, scaled: scipy.sparse.csc_array, kept: Sequence[int],
    tolerance: float,
) -> None:  # fmt: skip
    """Where nothing is left free, motions have taken some of it."""
    passive = _passive(builder, kept)
    null = _null_space(scipy.sparse.csc_array(scaled[:, passive]), tolerance)
    if hasattr(builder.mechanism, "joints") and len(passive) - null.shape[1] == scaled.shape[0]:
        _require_distinct(builder, problem, scaled, kept, tolerance, _NEARLY)
        raise builder.document.error(("joints",), "nothing can move: no freedom is left")


# -- inertia ----------------------------------------------------------------------------------


def _require_inertia(builder: Builder, problem: Problem) -> None:
    """Require M to be positive on the kernel of Gᵀ: whatever can move has inertia."""
    gradient = gradient_of(problem, problem.u0)
    if problem.n <= DENSE_UP_TO:
        motions = index_1.weightless(problem.M, np.asarray(gradient.toarray()))
        if motions.size:
            builder.document.refuse(builder.without_inertia(problem.u0, motions))
        return
    try:
        pivots = np.abs(scipy.sparse.linalg.splu(_saddle(problem, gradient)).U.diagonal())
        regular = bool(pivots.min() > _NO_INERTIA * pivots.max())
    except RuntimeError:
        regular = False
    if not regular:
        message = "something can move that has no inertia; the accelerations are undetermined"
        raise builder.document.error(("bodies",), message)


def _saddle(problem: Problem, rows: scipy.sparse.csc_array) -> scipy.sparse.csc_array:
    """[[M, −G], [Gᵀ, 0]], the largest entry of M 1."""
    pattern, values = problem.pattern, problem.mass_values
    places = pattern.mass_rows, pattern.mass_columns
    mass = scipy.sparse.csc_array((values / np.abs(values).max(), places), (problem.n,) * 2)
    blocks: list[list[Any]] = [[mass, -rows], [rows.T, None]]
    return scipy.sparse.csc_array(scipy.sparse.block_array(blocks))


# -- velocities -------------------------------------------------------------------------------


def _velocities(
    builder: Builder, problem: Problem, released: Sequence[int], every: scipy.sparse.csc_array
) -> Array:
    """Velocities that fit the constraints, as the file asks; ``every`` is G with released rows."""
    mechanism, rows = builder.mechanism, builder.rows
    v = builder.velocities(problem.u0)
    kept = np.setdiff1d(np.arange(len(rows)), released)
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, v)
    spatial = mechanism.dimensions == 3
    if mechanism.project_velocities or (spatial and mechanism.rates):
        return _nearest(builder, problem, v, gradient_of(problem, problem.u0), rate)
    sizes, wanted = column_norms(every), np.zeros(len(rows))
    wanted[kept] = rate
    driven = (motion.driven.values() for motion in mechanism.motions.values())
    paces = map(laws.pace, itertools.chain.from_iterable(driven))
    speed = max(float(np.abs(v).max()), float(np.abs(wanted / sizes).max()), *paces)
    misfit = np.abs(every.T @ v + wanted)
    missed: dict[KeyPath, tuple[float, str]] = {}
    tolerance = np.full(len(rows), VELOCITY_TOLERANCE)
    tolerance[list(released)] = _NEARLY
    for k in map(int, np.flatnonzero(misfit > tolerance * sizes * speed)):
        # Rows of joints are places and angles themselves, not halves of squares of lengths.
        size = float(misfit[k] if rows[k].path[0] == "joints" else misfit[k] / sizes[k])
        missed[rows[k].path] = max(missed.get(rows[k].path, (0.0, "")), (size, rows[k].name))
    rates = ", give 'rates' of joints," if spatial else ""
    builder.document.refuse(
        (
            path,
            f"initial velocities violate this constraint by {size:.3g} m/s"
            f"{f' (row {row})' if row else ''}; correct them{rates} or set "
            "'project_velocities: true'",
        )
        for path, (size, row) in missed.items()
    )
    return v


def _nearest(
    builder: Builder, problem: Problem, v: Array, gradient: scipy.sparse.csc_array, rate: Array
) -> Array:
    """The velocities nearest to v in the norm of M that fit constraints and rates."""
    n = problem.n
    rates = list(builder.rates(problem.u0))
    rows = scipy.sparse.csc_array(np.array([of_rate for _, of_rate, _ in rates]).reshape(-1, n).T)
    every = scipy.sparse.csc_array(scipy.sparse.hstack([gradient, rows]))
    wanted = np.concatenate([-rate, [value for _, _, value in rates]])
    sizes = column_norms(every)
    every, wanted = scipy.sparse.csc_array(every / sizes[None, :]), wanted / sizes
    solve = _solver_of_rates(_saddle(problem, every), n)
    with np.errstate(all="ignore"):
        for _ in range(3):  # the first leaves what is rounding of a large change
            v = v + solve(np.concatenate([np.zeros(n), wanted - every.T @ v]))[:n]
        left = np.abs(wanted - every.T @ v)
        speed = max(float(np.abs(v).max()), float(np.abs(wanted).max()))
    for k, (path, _, value) in enumerate(rates, start=problem.m):
        if not left[k] <= VELOCITY_TOLERANCE * speed:
            reached = value - (wanted[k] - every[:, [k]].T @ v)[0] * sizes[k]
            raise builder.document.error(
                path,
                f"contradicts other rates or the constraints: {reached:.6g} is the nearest to "
                f"{value:g} that fits",
            )
    if not np.all(left <= VELOCITY_TOLERANCE * speed):
        if not problem.released:
            _independent(builder, problem, gradient, RANK_TOLERANCE_FOUND)
        worst = int(np.argmax(np.where(np.isfinite(left), left, np.inf)))
        raise builder.document.error(
            builder.rows[worst].path,
            "no velocities found that fit this constraint: the start is too close to a singular "
            "position, such as a dead centre; start from another position",
        )
    return v


def _solver_of_rates(saddle: scipy.sparse.csc_array, n: int) -> Callable[[Array], Array]:
    """Solver of [[M, −G], [Gᵀ, 0]] x = rhs; of least norm where rates are dependent."""
    if n > DENSE_UP_TO:
        return lambda rhs: np.asarray(scipy.sparse.linalg.spsolve(saddle, rhs))
    dense = np.asarray(saddle.toarray(), float)
    return solver_if_regular(dense) or (
        lambda rhs: np.asarray(np.linalg.lstsq(dense, rhs, rcond=1e-13)[0])
    )
