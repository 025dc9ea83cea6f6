"""Orders in h by exponent arithmetic: every slope that theory predicts.

The order of a product adds, the order of a sum is the smallest (Section 2 of
the paper reads eq. 8b block by block in this sense).  A structural zero has
order +∞.  All arrays are exponents of h, not values.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from newmark_cli.newmark.forms import FORMS, MULTIPLIERS, Form, eliminate
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.integrator import FIELDS, Newmark
from newmark_cli.newmark.scaling import Scaling
from newmark_cli.support.arrays import Array

UNKNOWNS = (*FIELDS, *MULTIPLIERS)

#: Orders of u, v, a relative to a change of u through the update relations.
_RATE_ORDERS = np.array([0, -1, -2])
_INF = np.inf


#: Cases of J⁻¹: general position; Y = 0; and what a block has at most where Y, X or ∂(Gᵀv)/∂u is
#: zero (at rest), constraints are linear, or P = M⁻¹G.
GENERAL, UNDAMPED, SPECIAL = "general", "undamped", "special"
#: Formulation → case → unknown → orders of its blocks of J⁻¹ of the four-field system, by rows of
#: that; what a case does not name is as in those before.  Sub-tables of the first are eqs. 23
#: and 34.  Without damping a perturbation of V reaches row D of index 3 through Y alone: where
#: Y = 0 it changes v and nothing else.
INVERSES: Mapping[str, Mapping[str, Mapping[str, str]]] = MappingProxyType(
    {
        "index-3": {
            GENERAL: {"u": "2 2 0 0", "v": "1 0 -1 -1", "a": "0 0 -2 -2", "lambda": "0 0 -2 -2"},
            UNDAMPED: {"u": "2 inf 0 0", "a": "0 inf -2 -2", "lambda": "0 inf -2 -2"},
        },
        "index-2": {
            GENERAL: {"u": "2 1 0 1", "v": "1 0 0 0", "a": "0 -1 -1 -1", "lambda": "0 -1 -1 -1"},
            SPECIAL: {"v": "1 0 inf 0", "a": "0 -1 inf -1", "lambda": "0 -1 inf -1"},
        },
        "index-1": {
            GENERAL: {"u": "2 2 0 2", "v": "1 0 1 1", "a": "0 0 0 0", "lambda": "0 0 0 0"},
            SPECIAL: {
                "u": "2 inf 0 2",
                "v": "1 0 inf 1",
                "a": "0 inf inf 0",
                "lambda": "0 inf inf 0",
            },
        },
        "baumgarte": {
            GENERAL: {"u": "2 2 0 2", "v": "1 0 1 1", "a": "0 0 0 0", "lambda": "0 0 0 0"},
        },
        "baumgarte rate_h": {
            GENERAL: {"u": "2 1 0 2", "v": "1 0 -1 1", "a": "0 -1 -2 0", "lambda": "0 -1 -2 0"},
        },
        "ggl": {
            GENERAL: {
                "u": "2 1 0 0 1",
                "v": "1 0 0 0 0",
                "a": "0 -1 -1 -1 -1",
                "lambda": "0 -1 -1 -1 -1",
                "eta": "3 1 0 0 1",
            },
            SPECIAL: {
                "u": "2 inf 0 0 inf",
                "v": "1 0 inf inf 0",
                "a": "0 -1 inf inf -1",
                "lambda": "0 -1 inf inf -1",
                "eta": "inf 1 0 0 1",
            },
        },
        "augmented-lagrangian": {
            GENERAL: {"u": "2 2 0", "v": "1 0 -1", "a": "0 0 -2"},
            UNDAMPED: {"u": "2 inf 0", "a": "0 inf -2"},
        },
        "augmented-lagrangian penalty": {
            GENERAL: {"u": "2 2 0", "v": "1 0 1", "a": "0 0 0"},
            UNDAMPED: {"u": "2 inf 0", "a": "0 inf 0"},
        },
    }
)


def min_plus(left: Array, right: Array) -> Array:
    """Orders of a product of blocks (p, q) and (q,) or (q, r): min_k (left_ik + right_kj)."""
    columns = right.reshape(right.shape[0], -1)
    product = np.min(left[:, :, None] + columns[None, :, :], axis=1)
    return np.asarray(product.reshape((left.shape[0], *right.shape[1:])))


@dataclass(frozen=True)
class FormOrders:
    """Orders of the unscaled system of a form."""

    form: Form  #: the form, with the rows and multipliers of its formulation
    #: (3, p) orders of W = ∂(u, v, a)/∂(kept), and of a column for η where there is one
    weights: Array
    jacobian: Array  #: (rows, solved) orders of J (eqs. 21, 33).
    inverse: Array  #: (solved, rows) orders of J⁻¹ (eqs. 23, 34).
    #: (rows,) orders of the residual's perturbation: each row's largest term (eqs. 25, 36).
    residual: Array
    #: unknown, eliminated or not → (rows,) orders of its row of the four-field J⁻¹. W times the
    #: kept corrections would overstate those of eliminated fields where η cancels them.
    reactions: Mapping[str, Array]
    #: (solved, rows) orders of J⁻¹ that its blocks may have at most, where something is not in
    #: general position
    special: Array
    #: whether rows V and K are differences of numbers as large as the fields. These are often
    #: exact, so that the residual is smaller than its terms.
    differenced: bool = True
    penalty: float = _INF  #: order of the penalty p of an augmented Lagrangian, and +∞ without

    def corrections(self, scaling: Scaling | None = None) -> dict[str, float]:
        """Orders of the corrections of the unknowns (eqs. 26, 37, 40, 45).

        With a scaling those of the scaled q̄: the rows' factors cancel, the unknowns' divide.
        """
        physical = self.physical_corrections()
        return {
            unknown: physical[unknown] - (scaling.right[unknown].order() if scaling else 0)
            for unknown in self.form.unknowns
        }

    def physical_corrections(self) -> dict[str, float]:
        """Orders of the corrections of u, v, a, λ, and η if any, in physical units.

        No diagonal scaling changes them.
        """
        return {
            unknown: self._reaction(unknown, self.residual)
            for unknown in (*FIELDS, *self.form.multipliers)
        }

    def of_forces(self, unknown: str) -> float:
        """Order of an unknown's physical correction where only row D, of forces, is rounded.

        Where forces are stiff, K h² ≫ M, that is the largest part until h is smaller.
        """
        if unknown not in self.reactions:
            return np.nan
        return float(self.reactions[unknown][self.form.rows.index("D")])

    @property
    def bounded(self) -> dict[str, str]:
        """Unknowns whose correction may fall faster with h than predicted, and why."""
        if not self.differenced:
            return {}
        # Only what rows V and K contribute is uncertain.
        sharp = np.where([row in "VK" for row in self.form.rows], _INF, self.residual)
        reasons = {}
        for unknown, order in self.physical_corrections().items():
            if self._reaction(unknown, sharp) > order:
                reasons[unknown] = "differences in rows V and K are often exact"
        return reasons

    def _reaction(self, unknown: str, residual: Array) -> float:
        """Order of an unknown's correction for orders of the residual."""
        if unknown in self.reactions:
            return float(np.min(self.reactions[unknown] + residual))
        # λ is updated by −pΦ, of which the residual in row D has the order.
        return float(self.penalty + (0.0 if self.differenced else 1.0))

    def condition(self, scaling: Scaling) -> float:
        """Order of C = ‖J̄‖·‖J̄⁻¹‖ of the scaled matrix (eqs. 24, 35, 42, 47)."""
        jacobian, inverse = self.scaled(scaling)
        return float(np.min(jacobian) + np.min(inverse))

    def scaled(self, scaling: Scaling) -> tuple[Array, Array]:
        """Orders of J̄ = D_L J D_R and of its inverse (eqs. 39, 44)."""
        left = np.array([scaling.left[row].order() for row in self.form.rows])
        right = np.array([scaling.right[unknown].order() for unknown in self.form.solved])
        return (
            self.jacobian + left[:, None] + right[None, :],
            self.inverse - right[:, None] - left[None, :],
        )


def form_orders(
    form: Form, damped: bool = True, stiff: bool = True, compensated: bool = False
) -> FormOrders:
    """Orders of a form for any integrator of the family, in any formulation.

    M and G, and X and Y where present, are taken to be O(1) and in general
    position: fewer constraints than coordinates, and M⁻¹Y neither tangent to the
    constraints nor normal to them; ∂(Gᵀv)/∂u likewise.  The fields and λ are O(1).
    Corrections and condition numbers are the same with and without X and Y; single
    blocks are not.

    Args:
        form: The form, as `Formulation.applied` gives it.
        damped, stiff: Whether Y ≠ 0, and whether X ≠ 0.
        compensated: Whether residuals are evaluated in increments: their terms are as small as
            w, O(h²), and ν, O(h), and Φ and its rate change by O(h) in a step.
    """
    formulation = Formulation.parse(form.formulation)
    # Which weights and row entries are there does not depend on h or on the
    # integrator's numbers; their orders are those of the rates.
    elimination = eliminate(form, Newmark(0.3, 0.6).relations(0.1))
    rates_of_kept = np.array([_RATE_ORDERS[FIELDS.index(f)] for f in form.kept])
    weights = np.where(elimination.weights != 0, _RATE_ORDERS[:, None] - rates_of_kept, _INF)
    kept = weights
    if "eta" in form.multipliers:
        of_eta = np.where(elimination.eta != 0, _RATE_ORDERS, _INF)
        weights = np.column_stack([weights, of_eta])

    penalty = _penalty(formulation)
    residual = _residuals(form, formulation, kept, rates_of_kept, compensated)
    reactions = _rows_of_inverse(form, formulation, GENERAL, *[UNDAMPED] * (not damped))
    special = _rows_of_inverse(form, formulation, GENERAL, UNDAMPED, SPECIAL)
    return FormOrders(
        form=form,
        weights=weights,
        jacobian=_jacobian(form, formulation, weights, damped, stiff),
        inverse=np.array([reactions[u] for u in form.solved]),
        residual=np.array([residual[row] for row in form.rows]),
        reactions=reactions,
        special=np.array([special[u] for u in form.solved]),
        differenced=not compensated,
        penalty=penalty,
    )


def _rows_of_inverse(form: Form, formulation: Formulation, *cases: str) -> dict[str, Array]:
    """Unknown → (rows,) orders of its row of the four-field J⁻¹."""
    parameter, _ = formulation.parameter or ("", 0.0)
    of_method = INVERSES[formulation.method]
    tables = INVERSES.get(f"{formulation.method} {parameter}", of_method)
    every = formulation.applied(FORMS["u-v-a-lambda"]).rows
    columns = [every.index(row) for row in form.rows]
    texts = {unknown: row for of in cases for unknown, row in tables.get(of, {}).items()}
    return {unknown: np.array(row.split(), float)[columns] for unknown, row in texts.items()}


#: Orders of the blocks of the rows of constraints in u, v, a: Gᵀ; ∂(Gᵀv)/∂u, Gᵀ; and so on.
_CONSTRAINTS: Mapping[str, Array] = {
    "C": np.array([0, _INF, _INF]),
    "Cv": np.array([0, 0, _INF]),
    "Ca": np.zeros(3),
    "B": np.zeros(3),
}


def _jacobian(
    form: Form, formulation: Formulation, weights: Array, damped: bool, stiff: bool
) -> Array:
    """(rows, solved) orders of J from those of the weights."""
    dynamic = np.where([stiff, damped, True], 0.0, _INF)  # X, Y, M
    dynamic[0] = min(dynamic[0], _penalty(formulation))
    blocks = {
        "D": dynamic,
        "V": np.array([_INF, 0, 1]),  # v − γh a
        "K": np.array([0, _INF, 2]),  # u − βh² a
        **_CONSTRAINTS,
    }
    if formulation.scheduled:
        blocks["B"] = np.array([-2.0, -1.0, 0.0])  # α² Gᵀ, 2α Gᵀ, Gᵀ
    jacobian = []
    for row in form.rows:
        orders = min_plus(blocks[row][None, :], weights)[0]
        if form.constraint_rows:
            orders = np.insert(orders, len(form.kept), 0 if row == "D" else _INF)
        if row == "K" and "eta" in form.multipliers:
            orders[-1] = min(orders[-1], 0.0)
        jacobian.append(orders)
    return np.array(jacobian)


def _penalty(formulation: Formulation) -> float:
    """Order of p: as inertia, h⁻², or fixed."""
    if not formulation.kind.penalised:
        return _INF
    assert formulation.parameter is not None
    return -2.0 if formulation.parameter[0] == "factor" else 0.0


def _residuals(
    form: Form, formulation: Formulation, weights: Array, rates: Array, compensated: bool
) -> dict[str, float]:
    """Orders of each row's largest term."""
    # Of w, ν and a, where the evaluation is in increments.
    sizes = 2 + rates if compensated else np.zeros(len(rates))
    u, v, a = (float(order) for order in np.min(weights + sizes, axis=1))
    position = 1.0 if compensated else 0.0
    # Φ and its rate are carried; Gᵀv' and κ are evaluated afresh, both O(1).
    velocity = 1.0 if compensated else min(0.0, v)
    acceleration = min(0.0, a) if compensated else min(0.0, v, a)
    # f and Gλ beside M times the kept fields in D.
    dynamic = min(0.0, a, _penalty(formulation) + position)
    rate = -1.0 if formulation.scheduled else 0.0
    return {
        "D": dynamic,
        "V": min(v, 1 + a),
        "K": min(u, 2 + a),
        "C": position,
        "Cv": velocity,
        "Ca": acceleration,
        "B": min(acceleration, rate + velocity, 2 * rate + position),
    }


def derive_scaling(orders: FormOrders) -> tuple[dict[str, int], dict[str, int]]:
    """Least powers of h that make every block of J̄ and J̄⁻¹ O(1), from orders alone.

    With ℓ_i the power of row i and r_j that of unknown j, every block asks for

        −ord(J)_ij ≤ ℓ_i + r_j ≤ ord(J⁻¹)_ji,

    a system of difference constraints in ℓ and −r.  Row C keeps ℓ = 0 as in
    Table 2, which fixes the common factor that a scaling is free to have.  Where
    other rows of constraints stand, that leaves a choice: the fields then keep the
    powers of ∂u/∂u, ∂v/∂u and ∂a/∂u, as they have in Table 2.  The least solution is
    found by relaxation, as longest paths are.
    """
    rows, unknowns = orders.form.rows, orders.form.solved
    low, high = -orders.jacobian, orders.inverse.T
    # −r in shrink.
    if orders.form.constraint_rows == ("C",):
        left = np.array([0.0 if row == "C" else -np.inf for row in rows])
        shrink = np.full(len(unknowns), -np.inf)
    else:
        left = np.full(len(rows), -np.inf)
        shrink = np.array(
            [-_RATE_ORDERS[FIELDS.index(u)] if u in FIELDS else -np.inf for u in unknowns]
        )
    anchored_left, anchored_shrink = left, shrink
    for _ in range(len(rows) + len(unknowns) + 1):
        new_shrink = np.maximum(shrink, np.max(left[:, None] - high, axis=0))
        new_left = np.maximum(left, np.max(low + new_shrink[None, :], axis=1))
        if np.array_equal(new_left, left) and np.array_equal(new_shrink, shrink):
            break
        left, shrink = new_left, new_shrink
    powers = left[:, None] - shrink[None, :]
    moved = any(
        bool(np.any((before > -np.inf) & (after != before)))
        for before, after in ((anchored_left, left), (anchored_shrink, shrink))
    )
    if moved or np.any(powers < low) or np.any(powers > high):
        raise ValueError(f"no powers of h make the blocks of {orders.form.described} O(1)")
    return (
        {row: int(power) for row, power in zip(rows, left, strict=True)},
        {unknown: -int(power) for unknown, power in zip(unknowns, shrink, strict=True)},
    )
