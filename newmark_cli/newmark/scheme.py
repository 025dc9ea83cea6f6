"""One integrator, form and scaling at one step size: everything but the problem."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from newmark_cli.newmark.forms import Elimination, Form, eliminate
from newmark_cli.newmark.formulation import (
    CONSISTENT,
    CONSTRAINTS,
    NEWTON,
    TOTAL,
    UNPROJECTED,
    Formulation,
    Projection,
    is_formulated,
)
from newmark_cli.newmark.integrator import (
    FIELDS,
    RESCALE,
    RESCALE_VELOCITY,
    RESTART,
    Integrator,
    Relations,
)
from newmark_cli.newmark.march_data import StepTables
from newmark_cli.newmark.scaling import Scaling
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.support.arrays import Array, IndexArray

#: Most schemes of steps that are kept.
_MOST_KNOWN = 1_000
#: Least ratio of the longest step to the shortest with which one may be too short.
_WIDE = 10.0
DIRECT, COMPENSATED = "direct", "compensated"
#: How residuals are evaluated.  Direct: in the unknowns themselves, as the paper
#: writes them.  Compensated: in the increments w = u − u_n − h v_n and
#: ν = v − v_n, with u and v carried as unevaluated sums of two numbers and Φ by
#: its exact increment, Φ + G(u_n + Δ/2)ᵀ Δ, Δ = h v_n + w.
EVALUATIONS = (DIRECT, COMPENSATED)

#: Arithmetic of the march by name.
PRECISIONS: Mapping[str, type[np.floating[Any]]] = MappingProxyType(
    {"float64": np.float64, "float32": np.float32}
)


#: What a test of Newton's iteration looks at: the scaled correction, the residual before
#: scaling, or what the correction changes in each field.
CORRECTION, RESIDUAL, BY_FIELD = "correction", "residual", "field"


@dataclass(frozen=True)
class Tolerance:
    """Stops Newton's iteration at a test, ‖…‖ ≤ absolute + relative × what it is relative to.

    A correction is relative to the scaled unknowns, ‖q̄ʲ‖ ≤ absolute + relative ‖q̄‖, a
    residual to that before the first correction of the step.  By field the root mean square
    of Δxᵢ / (absolute + relative |xᵢ|) must not exceed 1, in every field that is named.

    Attributes:
        absolute, relative: Not negative, one of them positive; by field zero.
        test: What is looked at.
        fields: By field: u, v, a or lambda, and its absolute and relative parts.
    """

    absolute: float = 0.0
    relative: float = 0.0
    test: str = CORRECTION
    fields: tuple[tuple[str, float, float], ...] = ()

    @property
    def label(self) -> str:
        """How the CSV names it."""
        parts = [self.test] if self.test == RESIDUAL else []
        for name, *limits in (("", self.absolute, self.relative), *self.fields):
            named = zip(("absolute", "relative"), limits, strict=True)
            parts += [name, *(f"{part} {value!r}" for part, value in named if value)]
        return " ".join(filter(None, parts))

    @property
    def limits(self) -> Array:
        """(4, 2) absolute and relative parts: of u, v, a, λ, or else of the first row."""
        table = np.zeros((4, 2))
        table[0] = self.absolute, self.relative
        for name, *limits in self.fields:
            table[(*FIELDS, "lambda").index(name)] = limits
        return table


@dataclass(frozen=True)
class Scheme:
    """What the march needs beside the problem.

    Attributes:
        integrator: Integrator of the family.
        form: Kept unknowns and rows.
        scaling: Left and right factors.
        h: Step size (s).
        iteration_cap: Most Newton corrections computed in a step.
        evaluation: One of `EVALUATIONS`.
        precision: One of `PRECISIONS`.
        stop: Tolerance at which Newton's iteration stops; where rounding stops
            it when omitted.
        formulation: What the form's rows of constraints are of; `form` and `scaling`
            have its rows and unknowns.
        projection: What is projected after a step.
        reported: Which multipliers are reported, one of `formulation.REPORTED`.
        start: From which velocities, one of `formulation.STARTS`.
        ratio: h over the size of the step before.
        auxiliary: What becomes of the past where h changes, one of `integrator.AUXILIARY`.
    """

    integrator: Integrator
    form: Form
    scaling: Scaling
    h: float
    _: KW_ONLY
    iteration_cap: int = 50
    evaluation: str = DIRECT
    precision: str = "float64"
    stop: Tolerance | None = None
    formulation: Formulation = CONSTRAINTS
    projection: Projection = UNPROJECTED
    reported: str = NEWTON
    start: str = CONSISTENT
    ratio: float = 1.0
    auxiliary: str = RESCALE_VELOCITY

    def at(self, h: float, ratio: float) -> "Scheme":
        """The scheme of a step of another size (s), ``ratio`` times that of the one before."""
        return replace(self, h=h, ratio=ratio)

    @property
    def compensated(self) -> bool:
        """Whether the evaluation is compensated."""
        return self.evaluation == COMPENSATED

    @property
    def dtype(self) -> type[np.floating[Any]]:
        """Type of the march's numbers."""
        return PRECISIONS[self.precision]

    @property
    def settled_below(self) -> float:
        """Threshold of the terminal phase, relative to ‖u‖: the root of the rounding unit.

        Far from the solution Newton's corrections also grow.  An increase means
        saturation only in the terminal phase: the displacement parts of the
        correction to be recorded and of the one before it are below this fraction
        of ‖u‖.  One alone is not enough: at h = 1e-4 the first correction of the
        pendulum is h²/2 = 5e-9, and where λ hardly changes the unscaled norm of
        the second, which is rounding of λ, exceeds it.  Two such steps of 30,000
        would turn the slope of u from 0 into −1.8.  After two, convergence being
        quadratic, what is recorded is rounding.
        """
        return float(np.sqrt(np.finfo(self.dtype).eps))

    @property
    def recorded(self) -> tuple[str, ...]:
        """Whose corrections the march records.

        The unknowns; with η also eliminated fields, whose corrections do not follow from
        norms of the others.
        """
        return (*self.form.unknowns, *(self.form.eliminated if self.stabilised else ()))

    @property
    def stabilised(self) -> bool:
        """Whether there are η."""
        return self.formulation.kind.stabilised

    @property
    def total(self) -> bool:
        """Whether the multiplier of the velocity projection is part of what is reported."""
        return self.reported == TOTAL

    @property
    def acting(self) -> float:
        """Time for which an acceleration acts on the velocity within a step (s).

        A change δ of the velocity in every step is worth an acceleration of δ over it: h,
        but 2h/3 in BDF2, where a third of the last step's change comes again.
        """
        relations = self.relations
        of_past = relations.v_past[: len(relations.advance)][relations.advance == FIELDS.index("a")]
        return float(relations.v_from_a + of_past.sum())

    @property
    def formulated(self) -> bool:
        """Whether anything but index 3, as the paper has it, is marched."""
        return is_formulated(self.formulation, self.projection)

    @cached_property
    def relations(self) -> Relations:
        """Update relations at this step size."""
        return self.integrator.relations(self.h, self._to_past)

    @property
    def _to_past(self) -> float:
        """Ratio of h to the step size of the past; 1 where the past starts anew."""
        return 1.0 if self.auxiliary == RESTART else self.ratio

    def carried(self, behind: float, moved: float = 0.0) -> Array:
        """(P, P + 2) the past that the step begins with; see `Relations.carried`."""
        if self.ratio == 1 and moved == 0:
            places = len(self.relations.advance)
            return np.eye(places, places + 2)
        return self.relations.carried(self.auxiliary, behind, self.ratio, moved)

    @property
    def across(self) -> bool:
        """Whether velocities across the constraints are scaled where h changes.

        Rows of velocities and projections leave nothing to scale; what rows of accelerations
        let drift is not of this step size.
        """
        kind = self.formulation.kind
        holds = kind.rows == ("C",) or kind.penalised
        return self.auxiliary == RESCALE_VELOCITY and holds and not self.projection.level

    @property
    def symbols(self) -> dict[str, float]:
        """Numbers of the symbols that a scaling may use."""
        return self.integrator.symbols(self.h, self._to_past)

    @cached_property
    def marched(self) -> Relations:
        """Relations between what the march iterates on.

        Between the increments w, ν and a they are those between u, v and a without
        their past u_n + h v_n and v_n.
        """
        if not self.compensated:
            return self.relations
        v_past, u_past = self.relations.v_past.copy(), self.relations.u_past.copy()
        v_past[:2] = u_past[:2] = 0
        return replace(self.relations, v_past=v_past, u_past=u_past)

    @cached_property
    def elimination(self) -> Elimination:
        """The relations in the unknowns of the form."""
        return eliminate(self.form, self.relations)

    @cached_property
    def left(self) -> Array:
        """(rows,) numbers of D_L, a row block each."""
        values = self.symbols
        return np.array([self.scaling.left[row](values) for row in self.form.rows])

    @cached_property
    def right(self) -> Array:
        """(unknowns,) numbers of D_R, an unknown each."""
        values = self.symbols
        return np.array([self.scaling.right[unknown](values) for unknown in self.form.unknowns])

    @cached_property
    def tables(self) -> StepTables:
        """All of it as the numbers that the engines read.

        Direct: eliminated rates of a kept field are formed from its change over
        the step, as in the update of v in the (u, λ) form, γ/(βh) (u − u_n) + …
        Row D keeps the paper's undifferenced M u/(βh²) − j_n (eq. 30a).
        Compensated: all in the increments, nothing is differenced.
        """
        relations, weights = self.marched, self.elimination.weights
        kept = np.array([FIELDS.index(f) for f in self.form.kept], np.uint32)
        elimination = eliminate(self.form, relations)
        past = elimination.past.copy()
        new_a, of_past = relations.acceleration[0], relations.acceleration[1:]
        dynamic_past = new_a * past[2] + of_past
        differenced = np.zeros(3)
        if not self.compensated:
            for field in range(3):
                for k, source in enumerate(kept):
                    if weights[field, k] != 0 and field > source:
                        differenced[field] = 1.0
                        past[field, source] += weights[field, k]

        u_predicted = np.where(np.arange(len(relations.u_past)) < 2, relations.u_past, 0.0)
        a_predicted = (u_predicted - relations.u_past) / relations.u_from_a
        v_predicted = relations.v_from_a * a_predicted + relations.v_past
        tables = StepTables(
            kept=kept,
            weights=weights,
            past_weights=past,
            differenced=differenced,
            dynamic_weights=new_a * weights[2],
            dynamic_past=dynamic_past,
            row_weights=elimination.rows,
            row_past=elimination.rows_past,
            predictor=np.array([u_predicted, v_predicted, a_predicted]),
            acceleration=relations.acceleration,
            advance=relations.advance.astype(np.uint32),
            left=self.left,
            right=self.right,
        )
        reals = {
            name: values.astype(self.dtype)
            for name, values in tables._asdict().items()
            if values.dtype == np.float64
        }
        return tables._replace(**reals)


class Schemes:
    """The scheme of each step of a march.

    Attributes:
        base: That of the march, at h.
        grid: Sizes of the steps.
    """

    def __init__(self, base: Scheme, grid: TimeGrid) -> None:
        self.base, self.grid = base, grid
        self._known: dict[int, Scheme] = {}

    def at(self, step: int) -> Scheme:
        """The scheme of a step, counted from 1; step 0 has that of the first."""
        if not self.grid.varies:
            return self.base
        return self.of_kind(int(self.grid.kinds(np.array([max(step, 1)]))[0]))

    def of_kind(self, number: int) -> Scheme:
        """The scheme of a kind of steps; see `TimeGrid.kinds`."""
        if number not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            self._known[number] = self.base.at(*self.grid.kind(number))
        return self._known[number]

    def carried(self, step: int) -> Array:
        """(P, P + 2) the past that a step begins with; see `Relations.carried`."""
        size, behind, before = (self.grid.size(step - k) for k in range(3))
        integrator = self.base.integrator
        across = integrator.across(size, behind) / integrator.across(behind, before)
        return self.at(step).carried(behind, across - 1 if self.base.across else 0.0)

    @cached_property
    def across(self) -> IndexArray:
        """Steps that begin with other velocities across the constraints, ascending."""
        if not (self.grid.varies and self.base.across):
            return np.empty(0, np.int64)
        integrator = self.base.integrator
        changed = [
            integrator.across(size, behind) != integrator.across(behind, before)
            for size, behind, before in self.grid.successive.T.tolist()
        ]
        return 1 + np.flatnonzero(changed)

    @cached_property
    def carrying(self) -> IndexArray:
        """Steps before which `newmark_cli.newmark.carrying` has a look, ascending.

        Those `across`, the first, and where sizes are `wide` all changes of the step size.
        """
        if not self.grid.varies or self.base.auxiliary not in (RESCALE, RESCALE_VELOCITY):
            return self.across
        sizes, behind, _ = self.grid.successive
        changed = sizes != behind
        if not self.wide:
            changed[1:] = False  # at the first it may have come from longer steps
        return np.union1d(self.across, 1 + np.flatnonzero(changed))

    @cached_property
    def wide(self) -> bool:
        """Whether sizes differ so much that a step may be too short for those beside it."""
        sizes = self.grid.successive
        return bool(sizes.max() >= _WIDE * sizes.min())


def contains(steps: IndexArray, step: int) -> bool:
    """Whether a step is one of ascending ones (k,)."""
    place = int(np.searchsorted(steps, step))
    return place < len(steps) and int(steps[place]) == step
