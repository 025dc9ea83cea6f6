"""One integrator, form and scaling at one step size: everything but the problem."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark.forms import Elimination, Form, eliminate
from newmark_cli.newmark.integrator import FIELDS, Newmark, Relations
from newmark_cli.newmark.kernel import StepTables
from newmark_cli.newmark.scaling import Scaling

#: Far from the solution Newton's corrections also grow.  An increase means
#: saturation only in the terminal phase: the displacement parts of the
#: correction to be recorded and of the one before it are below this fraction of
#: ‖u‖.  One alone is not enough: at h = 1e-4 the first correction of the pendulum
#: is h²/2 = 5e-9, and where λ hardly changes the unscaled norm of the second,
#: which is rounding of λ, exceeds it.  Two such steps of 30,000 would turn the
#: slope of u from 0 into −1.8.  After two, convergence being quadratic, what
#: is recorded is rounding.
SETTLED_BELOW = float(np.sqrt(np.finfo(float).eps))


@dataclass(frozen=True)
class Scheme:
    """What the march needs beside the problem.

    Attributes:
        integrator: Integrator of the family.
        form: Kept unknowns and rows.
        scaling: Left and right factors.
        h: Step size (s).
        iteration_cap: Most Newton corrections computed in a step.
    """

    integrator: Newmark
    form: Form
    scaling: Scaling
    h: float
    iteration_cap: int = 50

    @cached_property
    def relations(self) -> Relations:
        """Update relations at this step size."""
        return self.integrator.relations(self.h)

    @cached_property
    def elimination(self) -> Elimination:
        """What the form makes of the relations."""
        return eliminate(self.form, self.relations)

    @cached_property
    def left(self) -> Array:
        """(rows,) numbers of D_L, a row block each."""
        values = self.integrator.symbols(self.h)
        return np.array([self.scaling.left[row](values) for row in self.form.rows])

    @cached_property
    def right(self) -> Array:
        """(unknowns,) numbers of D_R, an unknown each."""
        values = self.integrator.symbols(self.h)
        return np.array([self.scaling.right[unknown](values) for unknown in self.form.unknowns])

    @cached_property
    def tables(self) -> StepTables:
        """All of it as the numbers that the engines read.

        Eliminated rates of a kept field are formed from its change over the
        step, as in the update of v in the (u, λ) form, γ/(βh) (u − u_n) + …
        Row D keeps the paper's undifferenced M u/(βh²) − j_n (eq. 30a).
        """
        relations, elimination = self.relations, self.elimination
        kept = np.array([FIELDS.index(f) for f in self.form.kept])
        past = elimination.past.copy()
        differenced = np.zeros(3)
        for field in range(3):
            for k, source in enumerate(kept):
                if elimination.weights[field, k] != 0 and field > source:
                    differenced[field] = 1.0
                    past[field, relations.own_past[source]] += elimination.weights[field, k]

        new_a, of_past = relations.acceleration[0], relations.acceleration[1:]
        a_predicted = (relations.u_predicted - relations.u_past) / relations.u_from_a
        v_predicted = relations.v_from_a * a_predicted + relations.v_past
        return StepTables(
            kept=kept,
            weights=elimination.weights,
            past_weights=past,
            differenced=differenced,
            own_past=np.array(relations.own_past)[kept],
            dynamic_weights=new_a * elimination.weights[2],
            dynamic_past=new_a * elimination.past[2] + of_past,
            row_weights=elimination.rows,
            row_past=elimination.rows_past,
            predictor=np.array([relations.u_predicted, v_predicted, a_predicted]),
            acceleration=relations.acceleration,
            advance=relations.advance,
            left=self.left,
            right=self.right,
        )
