"""Jacobian matrices, block by block as in the paper.

The engines' own assembly is checked against this literal one.
"""

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.newmark.integrator import FIELDS, Relations
from newmark_cli.newmark.scaling import sensitivity
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Terms

Blocks = dict[str, dict[str, Array]]


def four_field(terms: Terms, mass_matrix: Array, relations: Relations) -> Blocks:
    """Blocks of the Jacobian of the (u, v, a, λ) form, row → column → block."""
    n, m = terms.G.shape
    identity, zero = np.eye(n), np.zeros((n, n))
    none = np.zeros((n, m))
    return {
        "D": {
            "u": terms.X,
            "v": terms.Y,
            "a": relations.acceleration[0] * mass_matrix,
            "lambda": -terms.G,
        },
        "V": {"u": zero, "v": identity, "a": -relations.v_from_a * identity, "lambda": none},
        "K": {"u": identity, "v": zero, "a": -relations.u_from_a * identity, "lambda": none},
        "C": {"u": terms.G.T, "v": none.T, "a": none.T, "lambda": np.zeros((m, m))},
    }


def form_blocks(scheme: Scheme, terms: Terms, mass_matrix: Array) -> list[list[Array]]:
    """Blocks of a form's Jacobian: columns combined by its weights, rows selected."""
    full = four_field(terms, mass_matrix, scheme.relations)

    def combined(row: str, weights: Array) -> Array:
        # Field by field, so that a sparse assembly can add the same numbers alike.
        u, v, a = (weight * full[row][f] for weight, f in zip(weights, FIELDS, strict=True))
        return np.asarray(u + v + a)

    return [
        [*(combined(row, weights) for weights in scheme.elimination.weights.T), full[row]["lambda"]]
        for row in scheme.form.rows
    ]


def scaled_jacobian(scheme: Scheme, terms: Terms, mass_matrix: Array) -> Array:
    """J̄ = D_L J D_R as one matrix."""
    n, m = terms.G.shape
    left, right = scaling_factors(scheme, n, m)
    jacobian = np.block(form_blocks(scheme, terms, mass_matrix))
    return np.asarray(left[:, None] * jacobian * right[None, :])


def scaling_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """D_L and D_R, a factor for each row and each unknown."""
    sizes = [n] * len(scheme.form.kept) + [m]
    return np.repeat(scheme.left, sizes), np.repeat(scheme.right, sizes)


def balancing_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """Factors that balance the blocks: by the sensitivities to displacement."""
    balanced = sensitivity(scheme.form)
    values = scheme.integrator.symbols(scheme.h)
    sizes = [n] * len(scheme.form.kept) + [m]
    return (
        np.repeat([balanced.left[row](values) for row in scheme.form.rows], sizes),
        np.repeat([balanced.right[unknown](values) for unknown in scheme.form.unknowns], sizes),
    )
