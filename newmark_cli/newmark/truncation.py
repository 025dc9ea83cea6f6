"""Orders of errors and of drift: what a formulation, a projection and a start leave of them.

Exponents of h again, of the truncation error.  +∞ stands for what rounding alone disturbs,
NaN for what theory says nothing of.
"""

import math
from dataclasses import dataclass, replace

from newmark_cli.newmark.formulation import (
    CORRECTED,
    NEWTON,
    RECOVERED,
    Formulation,
    Projection,
    is_formulated,
)
from newmark_cli.newmark.integrator import RESCALE_VELOCITY, Integrator, Newmark
from newmark_cli.newmark.steps import CONSTANT, Change, StepSequence

ROUNDING = math.inf
UNKNOWN = math.nan


@dataclass(frozen=True)
class Marched:
    """Properties that decide the order of a march."""

    integrator: Integrator
    formulation: Formulation
    projection: Projection  #: what is projected after each step
    reported: str  #: which multipliers are reported
    start: str  #: from which velocities it starts
    compensated: bool  #: whether the evaluation is compensated
    sequence: StepSequence = CONSTANT  #: how the step size varies
    auxiliary: str = RESCALE_VELOCITY  #: what becomes of the past where it changes

    @property
    def order(self) -> int:
        """Order of u and v.  The corrected start changes v by O(h²)."""
        return self.integrator.order if self.start != CORRECTED else min(self.integrator.order, 2)

    @property
    def formulated(self) -> bool:
        """Whether it is anything but index 3, as the paper has it."""
        return is_formulated(self.formulation, self.projection)

    @property
    def recovers(self) -> bool:
        """Whether u and v imply the λ that is reported."""
        return self.reported == RECOVERED

    @property
    def by_position(self) -> bool:
        """Whether Φ itself determines λ: index 3, and the augmented Lagrangian."""
        return self.formulation.kind.rows == ("C",) or self.formulation.kind.penalised

    @property
    def settles(self) -> bool:
        """Whether the augmented Lagrangian's iteration ends at Φ = 0, however small h is.

        With a fixed penalty it contracts ever less as h falls, and ends at the cap.
        """
        parameter = self.formulation.parameter
        return parameter is None or parameter[0] != "penalty"

    @property
    def alternates(self) -> bool:
        """Whether v along G, and with it λ, may keep an error that alternates from step to step.

        Φ = 0 at every step leaves it undamped without dissipation.  The projection of v
        removes it, rows of derivatives do not let it in.
        """
        return self.by_position and not self.integrator.damped and not self.projection.level

    @property
    def corrected(self) -> bool:
        """Whether the start leaves the trapezoidal rule no alternation; rounding still feeds it."""
        return self.start == CORRECTED and self.integrator == Newmark()

    def error(self, quantity: str) -> float:
        """Order of the error of u, v or λ at the end."""
        if not self.settles:
            return UNKNOWN
        order = self._multipliers() if quantity == "lambda" else float(self.order)
        if self.sequence == CONSTANT or math.isnan(order):
            return order
        if isinstance(self.sequence, Change):
            # What one change leaves behind has died out, or alternates.
            alternates = self.alternates and self.auxiliary != RESCALE_VELOCITY
            return UNKNOWN if alternates and quantity == "lambda" else order
        return UNKNOWN  # sizes and their order decide what changes that recur add up to

    def largest_error(self, quantity: str, since_start: bool) -> float:
        """Order of the largest error of u, v or λ over a part of the motion.

        Args:
            quantity: One of them.
            since_start: Whether it is the first part: like a change of h that restarts the
                integrator, a start may leave λ O(h), so that this is its order at least.
        """
        once = isinstance(self.sequence, Change)
        if not self.settles or not (once or self.sequence == CONSTANT):
            return UNKNOWN
        if quantity == "lambda":
            if self.formulation.scheduled or (self.alternates and not self.corrected):
                return UNKNOWN
            fed = once and self.auxiliary != RESCALE_VELOCITY
            if not self.recovers and (fed or (self.by_position and self.projection.level)):
                return UNKNOWN
            if not self.recovers and since_start:
                return 1.0 if self.order > 1 else UNKNOWN
        return float(self.order)

    def _multipliers(self) -> float:
        projected = self.projection.level > 0
        if not projected:
            if self.alternates and not (self.corrected and self.compensated):
                # Recovering λ from v that alternates does not repair it.
                return UNKNOWN
            return float(self.order)
        if self.recovers:
            return float(self.order)
        if self.projection.accelerations or self.formulation.scheduled:
            return UNKNOWN
        if not self.by_position:
            # The projection's μ is O(h³): λ of Newton needs no correction, and μ/h does no harm.
            return float(self.order)
        if self.reported == NEWTON:
            return 1.0  # the projection does part of λ's work
        return float(self.order) if self.integrator.damped else UNKNOWN

    def drift(self, invariant: str) -> float:
        """Order of what Φ, Gᵀv + Φ_t and λ miss of what an exact motion keeps."""
        if not self.settles:
            return UNKNOWN
        if self.sequence != CONSTANT:
            order = replace(self, sequence=CONSTANT).drift(invariant)
            return order if order == ROUNDING else UNKNOWN
        rows = self.formulation.kind.rows
        if invariant == "position":
            if self.by_position or "C" in rows or self.projection.level == 2:
                return ROUNDING
            if self.formulation.scheduled:
                # α² Φ with α = c/h keeps Φ an order below the rest.
                plain = not self.projection.level and self.order == 2
                return self.order + 1.0 if plain else UNKNOWN
            return float(self.order)
        if invariant == "velocity":
            if "Cv" in rows or self.projection.level:
                return ROUNDING
            return UNKNOWN if self.alternates else float(self.order)
        if invariant == "multiplier":
            exact = self.recovers or (rows == ("Ca",) and not self.projection.level)
            return ROUNDING if exact else UNKNOWN
        return UNKNOWN
