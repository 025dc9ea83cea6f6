"""Orders in h by exponent arithmetic: every slope that theory predicts.

The order of a product adds, the order of a sum is the smallest (Section 2 of
the paper reads eq. 8b block by block in this sense).  A structural zero has
order +∞.  All arrays are exponents of h, not values.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark.forms import ROWS, Form, eliminate
from newmark_cli.newmark.integrator import FIELDS, Newmark
from newmark_cli.newmark.scaling import Scaling

UNKNOWNS = (*FIELDS, "lambda")

#: Orders of u, v, a relative to a change of u through the update relations.
_RATE_ORDERS = np.array([0, -1, -2])

#: Orders of the blocks of J⁻¹ of the four-field system: unknown → (D, V, K, C).
#: Its sub-tables are eqs. 23 and 34.
INVERSE_ORDERS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {"u": (2, 2, 0, 0), "v": (1, 0, -1, -1), "a": (0, 0, -2, -2), "lambda": (0, 0, -2, -2)}
)
#: The same without damping.  A perturbation of V reaches row D through Y alone:
#: where Y = 0 it changes v and nothing else.
UNDAMPED_INVERSE_ORDERS: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "u": (2, np.inf, 0, 0),
        "v": (1, 0, -1, -1),
        "a": (0, np.inf, -2, -2),
        "lambda": (0, np.inf, -2, -2),
    }
)


def min_plus(left: Array, right: Array) -> Array:
    """Orders of a product of block matrices: min_k (left_ik + right_kj).

    Args:
        left: (p, q) orders.
        right: (q,) or (q, r) orders.
    """
    columns = right.reshape(right.shape[0], -1)
    product = np.min(left[:, :, None] + columns[None, :, :], axis=1)
    return np.asarray(product.reshape((left.shape[0], *right.shape[1:])))


@dataclass(frozen=True)
class FormOrders:
    """Orders of the unscaled system of a form.

    Attributes:
        form: The form.
        weights: (3, p) orders of W = ∂(u, v, a)/∂(kept).
        jacobian: (rows, unknowns) orders of J (eqs. 21, 33).
        inverse: (unknowns, rows) orders of J⁻¹ (eqs. 23, 34).
        residual: (rows,) orders of the residual's perturbation: each row's
            largest term (eqs. 25, 36).
    """

    form: Form
    weights: Array
    jacobian: Array
    inverse: Array
    residual: Array

    def corrections(self, scaling: Scaling | None = None) -> dict[str, float]:
        """Orders of the corrections of the unknowns (eqs. 26, 37, 40, 45).

        Args:
            scaling: When given, of the scaled corrections q̄; the rows' factors
                cancel, the unknowns' divide.
        """
        orders = min_plus(self.inverse, self.residual)
        return {
            unknown: float(order - (scaling.right[unknown].order() if scaling else 0))
            for unknown, order in zip(self.form.unknowns, orders, strict=True)
        }

    def physical_corrections(self) -> dict[str, float]:
        """Orders of the corrections of u, v, a, λ in physical units.

        The eliminated fields' follow from the weights.  No diagonal scaling
        changes them.
        """
        kept = self.corrections()
        fields = min_plus(self.weights, np.array([kept[f] for f in self.form.kept]))
        orders = {f: float(order) for f, order in zip(FIELDS, fields, strict=True)}
        return {**orders, "lambda": kept["lambda"]}

    def condition(self, scaling: Scaling) -> float:
        """Order of C = ‖J̄‖·‖J̄⁻¹‖ of the scaled matrix (eqs. 24, 35, 42, 47)."""
        jacobian, inverse = self.scaled(scaling)
        return float(np.min(jacobian) + np.min(inverse))

    def scaled(self, scaling: Scaling) -> tuple[Array, Array]:
        """Orders of J̄ = D_L J D_R and of its inverse (eqs. 39, 44)."""
        left = np.array([scaling.left[row].order() for row in self.form.rows])
        right = np.array([scaling.right[unknown].order() for unknown in self.form.unknowns])
        return (
            self.jacobian + left[:, None] + right[None, :],
            self.inverse - right[:, None] - left[None, :],
        )


def form_orders(
    form: Form, damped: bool = True, stiff: bool = True, compensated: bool = False
) -> FormOrders:
    """Orders of a form for any integrator of the family.

    M and G, and X and Y where present, are taken to be O(1) and in general
    position: fewer constraints than coordinates, and M⁻¹Y neither tangent to the
    constraints nor normal to them.  The fields and λ are O(1).  Corrections and
    condition numbers are the same with and without X and Y; single blocks are not.

    Args:
        form: The form.
        damped: Whether Y ≠ 0.
        stiff: Whether X ≠ 0.
        compensated: Whether residuals are evaluated in increments.  Their terms are
            then as small as w, O(h²), and ν, O(h), and Φ changes by O(h) in a step.
    """
    # Which weights and row entries are there does not depend on h or on the
    # integrator's numbers; their orders are those of the rates.
    elimination = eliminate(form, Newmark(0.3, 0.6).relations(0.1))
    rates_of_kept = np.array([_RATE_ORDERS[FIELDS.index(f)] for f in form.kept])
    weights = np.where(elimination.weights != 0, _RATE_ORDERS[:, None] - rates_of_kept, np.inf)

    relation = {  # V: v − γh a,  K: u − βh² a
        "V": np.array([np.inf, 0, 1]),
        "K": np.array([0, np.inf, 2]),
    }
    dynamic = np.where([stiff, damped, True], 0.0, np.inf)  # X, Y, M
    blocks = {
        "D": np.append(min_plus(dynamic[None, :], weights)[0], 0),
        "C": np.append(weights[0], np.inf),
    }
    # Residual: f and Gλ beside M times the kept fields in D; fields in V, K; Φ.
    # Of w, ν and a, where the evaluation is in increments.
    sizes = 2 + rates_of_kept if compensated else np.zeros(len(form.kept))
    residual = {"D": min(0.0, np.min(weights[2] + sizes)), "C": 1.0 if compensated else 0.0}
    for row in form.extra_rows:
        in_kept = min_plus(relation[row][None, :], weights)[0]
        blocks[row] = np.append(in_kept, np.inf)
        residual[row] = float(np.min(in_kept + sizes))

    inverse = INVERSE_ORDERS if damped else UNDAMPED_INVERSE_ORDERS
    columns = [ROWS.index(row) for row in form.rows]
    return FormOrders(
        form=form,
        weights=weights,
        jacobian=np.array([blocks[row] for row in form.rows]),
        inverse=np.array([inverse[u] for u in form.unknowns], float)[:, columns],
        residual=np.array([residual[row] for row in form.rows]),
    )


def derive_scaling(orders: FormOrders) -> tuple[dict[str, int], dict[str, int]]:
    """Least powers of h that make every block of J̄ and J̄⁻¹ O(1), from orders alone.

    With ℓ_i the power of row i and r_j that of unknown j, every block asks for

        −ord(J)_ij ≤ ℓ_i + r_j ≤ ord(J⁻¹)_ji,

    a system of difference constraints in ℓ and −r.  Row C keeps ℓ = 0 as in
    Table 2, which fixes the common factor that a scaling is free to have; the
    least solution is then found by relaxation, as longest paths are.

    Args:
        orders: Orders of a form.

    Returns:
        Row block → ℓ and unknown → r.

    Raises:
        ValueError: When no powers do it.
    """
    rows, unknowns = orders.form.rows, orders.form.unknowns
    low, high = -orders.jacobian, orders.inverse.T
    left = np.array([0.0 if row == "C" else -np.inf for row in rows])
    shrink = np.full(len(unknowns), -np.inf)  # −r
    for _ in range(len(rows) + len(unknowns) + 1):
        new_shrink = np.maximum(shrink, np.max(left[:, None] - high, axis=0))
        new_left = np.maximum(left, np.max(low + new_shrink[None, :], axis=1))
        if np.array_equal(new_left, left) and np.array_equal(new_shrink, shrink):
            break
        left, shrink = new_left, new_shrink
    powers = left[:, None] - shrink[None, :]
    if left[rows.index("C")] != 0 or np.any(powers < low) or np.any(powers > high):
        raise ValueError(f"no powers of h make the blocks of {orders.form.name} O(1)")
    return (
        {row: int(power) for row, power in zip(rows, left, strict=True)},
        {unknown: -int(power) for unknown, power in zip(unknowns, shrink, strict=True)},
    )
