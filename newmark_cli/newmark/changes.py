"""Changes of the step size: what they do to errors of u, v and λ, and what avoids it.

Across the constraints index 3 prescribes the motion, x(t) say, and the update relations
differentiate it.  At constant h they leave v off by e = C h² x‴ (C h x'' with BDF1), which is
Gᵀv + Φ_t, and the auxiliary acceleration of generalized-α off by θ h x‴.  Where h changes, what
is left of the old h enters v' as e/h, and λ with it.  Rows of rates prescribe x', and along the
constraints v' is free of all that; there changes only add up.

`Model` follows this exactly, in powers of h: each field is a sum of multiples of
x, x', …, x⁗, and a term with x⁽ᵏ⁾ stands for an error of v' of h^(k−2).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from newmark_cli.newmark.formulation import RECOVERED, TOTAL, Formulation, Projection
from newmark_cli.newmark.integrator import (
    NEW_A,
    NEW_NU,
    NEW_U,
    NEW_V,
    NEW_W,
    RESCALE_VELOCITY,
    RESTART,
    TRUE_ACCELERATION,
    Integrator,
)
from newmark_cli.newmark.steps import Change, Constant, Random, StepSequence
from newmark_cli.support.arrays import Array

#: Derivatives of x that are followed: up to the fourth, by which λ of order 2 is off.
_TERMS = 5
#: What is smaller is rounding.
_ZERO = 1e-4
#: Steps over which growth shows, and random sequences of which the mean square is taken.
_MANY, _SEEDS = 1024, 32
#: Powers of the number of steps above which errors grow exponentially.
_POLYNOMIAL = 4.0
#: Steps that are looked at for the end of a transient.
_LONGEST = 4096
#: Which rows of constraints prescribe what; none: accelerations along the constraints.
POSITION, VELOCITY, NOTHING = "position", "velocity", "nothing"


@dataclass(frozen=True)
class Errors:
    """Errors of a sequence of steps, in multiples of x'', x‴ and x⁗.

    Attributes:
        x, v, a, true: (..., steps, 3) those of x, v, the acceleration that V and K take, and of v'
            or what is reported in its place, each in the unit of steps of size 1.
    """

    x: Array
    v: Array
    a: Array
    true: Array


@dataclass(frozen=True)
class Model:
    """A motion in one direction, of which rows of constraints prescribe something.

    Attributes:
        integrator: The integrator.
        rule: What becomes of the past where h changes.
        prescribed: `POSITION`, `VELOCITY` or, along the constraints, `NOTHING`.
        projected: Whether v is projected after each step.
        total: Whether what the projection changes v by is part of v'.
    """

    integrator: Integrator
    rule: str
    prescribed: str
    projected: bool = False
    total: bool = False

    def matrix(self, h: float, last: float, before: float) -> Array:
        """(P + 5, P + 5) a step: rows past, v', x, v, a, v' as reported; see `errors`.

        Columns are the past and v' before it and x' there, then x, x' and x'' after it.
        """
        changed = h != last
        relations = self.integrator.relations(h, 1.0 if self.rule == RESTART else h / last)
        places = len(relations.advance)
        rows = np.eye(places + 5)
        past, true, rate_before = rows[:places], rows[places], rows[places + 1]
        x_there, v_there, a_there = rows[places + 2 :]
        hidden = past[1] - rate_before
        moved = 0.0
        if self._scaled:
            moved = self.integrator.across(h, last) / self.integrator.across(last, before) - 1
        if changed or moved:
            carried = relations.carried(self.rule, last, h / last, moved)
            past = carried @ np.concatenate([rows[: places + 1], [hidden]])
        of_x, of_v, of_true = (
            row @ past for row in (relations.u_past, relations.v_past, relations.acceleration[1:])
        )
        if self.prescribed == POSITION:
            a = (x_there - of_x) / relations.u_from_a
        elif self.prescribed == VELOCITY:
            a = (v_there - of_v) / relations.v_from_a
        else:
            a = (a_there - of_true) / relations.acceleration[0]
        x, v = of_x + relations.u_from_a * a, of_v + relations.v_from_a * a
        true = of_true + relations.acceleration[0] * a
        reported = true
        if self.total:
            of_a = relations.v_past[relations.advance == NEW_A].sum()
            reported = true + (v_there - v) / (relations.v_from_a + of_a)
        if self.projected:
            v = v_there
        if self.prescribed != NOTHING:
            x = x_there
        advanced = {
            NEW_U: x, NEW_V: v, NEW_A: a, TRUE_ACCELERATION: true, NEW_W: x - past[0] - h * past[1],
            NEW_NU: v - past[1],
        }  # fmt: skip
        new = [advanced[what] for what in relations.advance.tolist()]
        return np.array([*new, true, x, v, a, reported])

    @property
    def _scaled(self) -> bool:
        return self.rule == RESCALE_VELOCITY and self.prescribed == POSITION and not self.projected

    @cached_property
    def _steady(self) -> Array:
        """(P + 1, 5) past and v' that steps of size 1 reproduce.

        What is exact after each step is so from the start, and along the constraints u and v.
        """
        matrix, shift = self.matrix(1.0, 1.0, 1.0), _shift(1.0)
        size = len(matrix) - 4
        exact = np.eye(_TERMS)
        known = [0] if self.prescribed == POSITION and not self.projected else [0, 1]
        free = [row for row in range(size) if row not in known]
        steady = np.zeros((size, _TERMS))
        steady[known] = exact[known]
        own = np.eye(len(free)) - matrix[np.ix_(free, free)]
        for term in range(_TERMS):
            # Terms of lower derivatives of a step before, and of this one.
            before = steady @ np.where(np.arange(_TERMS) == term, shift[:, [term]], 0.0)
            inputs = np.concatenate([before, [exact[1] @ shift], exact[:3]])[:, term]
            steady[free, term] = np.linalg.solve(own, matrix[free] @ inputs)
        return steady

    @property
    def decay(self) -> float:
        """Factor by which errors of the past fall in a step at constant h, in the long run."""
        free = slice(1 if self.prescribed == POSITION and not self.projected else 2, None)
        matrix = self.matrix(1.0, 1.0, 1.0)
        size = len(matrix) - 4
        values = np.linalg.eigvals(matrix[:size, :size][free, free])
        return float(np.abs(values).max(initial=0.0))

    def errors(self, sizes: Array) -> Errors:
        """Errors after each step, of sequences that follow steps of size 1.

        Args:
            sizes: (..., steps) step sizes.
        """
        count = sizes.shape[-1]
        before = np.concatenate([np.ones((*sizes.shape[:-1], 2)), sizes], axis=-1)
        triples = np.stack([before[..., 2:], before[..., 1:-1], before[..., :-2]], axis=-1)
        if not self._scaled:
            triples[..., 2] = triples[..., 1]
        kinds, which = np.unique(triples.reshape(-1, 3), axis=0, return_inverse=True)
        which = which.reshape(sizes.shape)
        matrices = np.array([self.matrix(*kind) for kind in kinds.tolist()])
        shifts = np.array([_shift(size) for size in kinds[:, 0].tolist()])
        exact = np.eye(_TERMS)
        state = np.broadcast_to(self._steady, (*sizes.shape[:-1], *self._steady.shape))
        fields = np.empty((*sizes.shape, 4, _TERMS))
        there = np.broadcast_to(exact[:3], (*sizes.shape[:-1], 3, _TERMS))
        with np.errstate(all="ignore"):
            for k in range(count):
                shift, kind = shifts[which[..., k]], which[..., k]
                rows = [state @ shift, (exact[1] @ shift)[..., None, :], there]
                new = matrices[kind] @ np.concatenate(rows, axis=-2)
                state, fields[..., k, :, :] = new[..., :-4, :], new[..., -4:, :]
        off = (fields - exact[[0, 1, 2, 2]])[..., 2:]
        return Errors(*np.moveaxis(off, -2, 0))


def _shift(h: float) -> Array:
    """(5, 5) x⁽ʲ⁾ before a step in terms of those after it."""
    powers = np.array([(-h) ** k / math.factorial(k) for k in range(_TERMS)])
    return np.array(
        [[powers[m - j] if m >= j else 0.0 for m in range(_TERMS)] for j in range(_TERMS)]
    )


@dataclass(frozen=True)
class Transient:
    """What one change of h does to λ.

    Attributes:
        order: Of the error of λ, in h, in the steps after the change.
        size: Its largest over h^order and |(GᵀM⁻¹G)⁻¹ Gᵀu⁽ᵏ⁾|, k = order + 2, h that before.
        steps: Until what the change has added is down to a hundredth; +∞ where that stays.
    """

    order: int
    size: float
    steps: float


def transient(model: Model, change: float, window: int = 40) -> Transient:
    """What a change of the step size by a factor does to λ.

    Args:
        model: The motion across the constraints.
        change: New step size over the old one.
        window: Steps in which the largest error is looked for.
    """
    true = model.errors(np.full(window, change)).true
    place = next((k for k in range(3) if np.abs(true[:, k]).max() > _ZERO), 2)
    rate = model.decay
    count = window if rate >= 1 else _LONGEST
    added = true[:, place] if rate >= 1 else model.errors(np.full(count, change)).true[:, place]
    added = np.abs(added - (added[-1] if rate < 1 else 0.0))
    left = np.flatnonzero(added > 0.01 * added.max())
    steps = math.inf if rate >= 1 else (float(left[-1] + 1) if added.max() > _ZERO else 0.0)
    return Transient(place, float(np.abs(true[:, place]).max()), steps)


def across(integrator: Integrator, formulation: Formulation, rule: str) -> Model:
    """The motion across the constraints, without projections.

    Args:
        integrator, formulation: What is marched.
        rule: What becomes of the past where h changes.
    """
    rows = formulation.kind.rows
    if rows == ("C",) or formulation.kind.penalised:
        return Model(integrator, rule, POSITION)
    return Model(integrator, rule, VELOCITY if "Cv" in rows else NOTHING)


def orders(
    integrator: Integrator,
    formulation: Formulation,
    projection: Projection,
    reported: str,
    rule: str,
    sequence: StepSequence,
) -> tuple[float, float]:
    """Orders of the errors of u and v, and of λ, in steps after changes of h.

    Args:
        integrator, formulation, projection, reported: What is marched, and which λ.
        rule: What becomes of the past where h changes.
        sequence: How h varies; of a single change what follows it.

    Returns:
        Order of u and v, and of λ; −∞ where errors grow exponentially.
    """
    model = across(integrator, formulation, rule)
    model = replace(model, projected=projection.level > 0, total=reported == TOTAL)
    if isinstance(sequence, Constant | Change):
        # Steps of one size: a change by a factor of 1.
        change = getattr(sequence, "change", 1.0)
        state = float(integrator.order)
        of_v = float(transient(model, change).order)
    else:
        drawn = (
            [replace(sequence, seed=k) for k in range(_SEEDS)]
            if isinstance(sequence, Random)
            else [sequence]
        )
        sizes = np.array([sample.factors(_MANY, 1.0) for sample in drawn])
        along, ahead = Model(integrator, rule, NOTHING).errors(sizes), model.errors(sizes)
        # Without damping, what random changes leave adds up as a random walk.
        walks = isinstance(sequence, Random) and model.decay >= 1
        order = partial(_order, powers=0.5 if walks else 1.0)
        # Accelerations across turn into others along the constraints, as these turn.
        turned = np.cumsum(ahead.a * sizes[..., None] ** 2, axis=1)
        state = min(
            float(integrator.order),
            order(along.x, 2),
            order(along.v, 1),
            order(ahead.v, 1),
            order(turned, 2),
        )
        of_v = order(ahead.true, 0)
    if reported == RECOVERED or model.prescribed == NOTHING:
        return state, state
    return state, min(of_v, state)


def _order(errors: Array, unit: int, powers: float) -> float:
    """Order in h of errors at a time, of which the term x⁽ᵏ⁾ has the unit h^(k − 2 + unit).

    A term that grows with the number of steps is followed by others that add up what it leaves
    while x⁽ᵏ⁾ changes; they have the same order.
    """
    early, late = (
        np.sqrt(np.mean(np.square(errors[:, first : 2 * first]), axis=(0, 1)))
        for first in (_MANY // 8, _MANY // 2)
    )
    order = math.inf
    for place in range(len(late)):
        if not late[place] <= 1 / _ZERO**2:
            return -math.inf
        if late[place] <= _ZERO:
            continue
        grown = math.log2(late[place] / max(early[place], _ZERO)) / 2
        power = max(powers * round(grown / powers), 0.0)
        if power > _POLYNOMIAL:
            return -math.inf
        order = min(order, place + unit - power)
        if power > 0:
            break
    return order
