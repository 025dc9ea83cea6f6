"""Jacobian matrices, block by block as in the paper.

The engines' own assembly is checked against this literal one.
"""

import numpy as np

from newmark_cli.newmark.constraints import Constraining, Tangents
from newmark_cli.newmark.integrator import FIELDS, Relations
from newmark_cli.newmark.scaling import sensitivity
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.algebra import product
from newmark_cli.problems.problem import Terms
from newmark_cli.support.arrays import Array

Blocks = dict[str, dict[str, Array]]


def four_field(
    terms: Terms,
    mass_matrix: Array,
    relations: Relations,
    constraining: Constraining | None = None,
    tangents: Tangents | None = None,
) -> Blocks:
    """Blocks of the Jacobian of the (u, v, a, λ) form, row → column → block.

    With those of a formulation beside index 3, which may have η, from its tangents.
    """
    n, m = terms.G.shape
    identity, zero = np.eye(n), np.zeros((n, n))
    none, nothing = np.zeros((n, m)), np.zeros((m, m))
    blocks: Blocks = {
        "D": {
            "u": terms.X,
            "v": terms.Y,
            "a": relations.acceleration[0] * mass_matrix,
            "lambda": -terms.G,
        },
        "V": {"u": zero, "v": identity, "a": -relations.v_from_a * identity, "lambda": none},
        "K": {"u": identity, "v": zero, "a": -relations.u_from_a * identity, "lambda": none},
        "C": {"u": terms.G.T, "v": none.T, "a": none.T, "lambda": nothing},
    }
    if constraining is None or tangents is None:
        return blocks
    del blocks["C"]
    if constraining.penalty:
        blocks["D"]["u"] = terms.X + product(constraining.penalty * terms.G, terms.G.T)
    for row, of_row in zip(constraining.scheme.form.constraint_rows, tangents.rows, strict=True):
        blocks[row] = {
            field: constraining.dense(entries)
            for field, entries in zip(FIELDS, of_row, strict=True)
        } | {"lambda": nothing}
    if constraining.stabilised:
        directions = constraining.dense_directions(tangents.directions)
        for row, of_fields in blocks.items():
            through = np.zeros((len(of_fields["u"]), m))
            for field, weight in zip(FIELDS, constraining.eta, strict=True):
                through = through + product(weight * of_fields[field], directions)
            of_fields["eta"] = through - directions if row == "K" else through
    return blocks


def form_blocks(
    scheme: Scheme,
    terms: Terms,
    mass_matrix: Array,
    constraining: Constraining | None = None,
    tangents: Tangents | None = None,
) -> list[list[Array]]:
    """Blocks of a form's Jacobian: columns combined by its weights, rows selected."""
    full = four_field(terms, mass_matrix, scheme.relations, constraining, tangents)

    def combined(row: str, weights: Array) -> Array:
        # Field by field, so that a sparse assembly can add the same numbers alike.
        u, v, a = (weight * full[row][f] for weight, f in zip(weights, FIELDS, strict=True))
        return np.asarray(u + v + a)

    multipliers = [name for name in scheme.form.solved if name not in FIELDS]
    return [
        [
            *(combined(row, weights) for weights in scheme.elimination.weights.T),
            *(full[row][name] for name in multipliers),
        ]
        for row in scheme.form.rows
    ]


def scaled_jacobian(
    scheme: Scheme,
    terms: Terms,
    mass_matrix: Array,
    constraining: Constraining | None = None,
    tangents: Tangents | None = None,
) -> Array:
    """J̄ = D_L J D_R as one matrix."""
    n, m = terms.G.shape
    left, right = scaling_factors(scheme, n, m)
    jacobian = np.block(form_blocks(scheme, terms, mass_matrix, constraining, tangents))
    return np.asarray(left[:, None] * jacobian * right[None, :])


def scaling_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """D_L and D_R, a factor for each row and each unknown."""
    sizes = scheme.form.sizes(n, m)
    return np.repeat(scheme.left, sizes), np.repeat(scheme.right[: len(sizes)], sizes)


def balancing_factors(scheme: Scheme, n: int, m: int) -> tuple[Array, Array]:
    """Factors that balance the blocks: by the sensitivities to displacement."""
    balanced = sensitivity(scheme.form)
    values = scheme.symbols
    sizes = scheme.form.sizes(n, m)
    return (
        np.repeat([balanced.left[row](values) for row in scheme.form.rows], sizes),
        np.repeat([balanced.right[unknown](values) for unknown in scheme.form.solved], sizes),
    )
