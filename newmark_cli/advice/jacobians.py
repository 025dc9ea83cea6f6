"""A Jacobian from anywhere: which scaling is in it, and what to multiply it by."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import MOST_UNKNOWNS
from newmark_cli.advice.sections import plain, titled
from newmark_cli.library import arguments
from newmark_cli.library.scalings import integrator_or_newmark
from newmark_cli.newmark.balance import Inverted, block_factors, block_sizes
from newmark_cli.newmark.forms import FORMS, Form
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import PAPER_VARIANTS, named_scaling
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.support import matrices
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.matrices import MatrixError

OTHER = "none of the four"
#: How far blocks that a scaling makes equal may differ, relative to their size.
_EQUAL = 1e-6
#: How far a measured order may be from that of a scaling.
_NEAR = 0.3
#: Of blocks of one size: the corner of what a matrix is the inverse of counts as zero up to the
#: first, its own as there from the second on.  The first is up to 2e-5 of inverses, 1e-3 or more
#: of Jacobians with their rows in any order.
_ZERO, _THERE = 1e-4, 1e-6
#: How many times better conditioned is worth another factor.
_MUCH = 100.0


@dataclass(frozen=True)
class JacobianAdvice:
    """Facts about Jacobians of which only the blocks are known.

    Attributes:
        form: Name of the form.
        blocks: Unknown → size of its block.
        h: Step sizes (s).
        found: The scaling in them: ``"none"``, ``"left"``, ``"right"``, ``"optimal"``, or
            ``"none of the four"``.
        measured: Whether that is measured, from two step sizes, rather than inferred from one.
        implied: Variant that the blocks of one Jacobian fit → ‖M‖ and ‖G‖ that it implies.
        orders: Row → unknown → measured order in h of the block; empty with one step size.
        left, right: Row, unknown → what to multiply it by, as a formula; a number where no
            formula is known.
        condition: 2-norm condition number of each, now.
        balanced: The same after the multiplication.
        findings: All this in sentences.

    Examples:
        >>> import newmark_cli as newmark
        >>> h = 1e-3
        >>> unscaled = [[4 / h**2, 0, -1], [0, 4 / h**2, 0], [1, 0, 0]]
        >>> advice = newmark.advise_jacobian(unscaled, blocks={"u": 2, "lambda": 1}, h=h)
        >>> advice.found, dict(advice.left), dict(advice.right)
        ('none', {'D': 'beta*h^2', 'C': '1'}, {'u': '1', 'lambda': '1/(beta*h^2)'})
        >>> f"{advice.condition[0]:.2g}", f"{advice.balanced[0]:.2g}"
        ('1.6e+13', '2.6')
    """

    form: str
    blocks: Mapping[str, int]
    h: tuple[float, ...]
    found: str
    measured: bool
    implied: Mapping[str, Mapping[str, float]]
    orders: Mapping[str, Mapping[str, float]]
    left: Mapping[str, str]
    right: Mapping[str, str]
    condition: tuple[float, ...]
    balanced: tuple[float, ...]
    findings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain mappings, lists, numbers and text."""
        values: dict[str, Any] = plain(asdict(self))
        return values

    def __str__(self) -> str:
        sizes = ", ".join(f"{name} = {size}" for name, size in self.blocks.items())
        factors = [["", "multiply by"]]
        factors += [[f"row {row}", text] for row, text in self.left.items()]
        factors += [[name, text] for name, text in self.right.items()]
        rows = [["h", "C now", "C after"]]
        for h, now, after in zip(self.h, self.condition, self.balanced, strict=True):
            rows.append([f"{h:g}", f"{now:.4g}", f"{after:.4g}"])
        parts = [
            f"Jacobian of form {self.form}, {sizes}: scaling {self.found}",
            titled("Condition number (2-norm)", rows),
            titled("Factors to the optimal scaling", factors),
        ]
        if self.orders:
            unknowns = [*self.blocks]
            table = [["", *unknowns]]
            table += [
                [
                    f"row {row}",
                    *(
                        f"{round(of[name], 2) + 0.0:.2f}" if name in of else "0"
                        for name in unknowns
                    ),
                ]
                for row, of in self.orders.items()
            ]
            parts.append(titled("Measured order in h of each block (0: a block of zeros)", table))
        return "\n\n".join([*parts, "\n".join(f"- {text}" for text in self.findings)])


def advise_jacobian(
    jacobian: Any,
    *,
    blocks: Any = None,
    h: Any = None,
    beta: float | None = None,
    gamma: float | None = None,
    integrator: Any = None,
) -> JacobianAdvice:
    """Find the scaling that is in a Jacobian of your own, and what to multiply it by.

    With one Jacobian the answer is an inference: the blocks of G and Gᵀ, and of V and K, say
    which sides are scaled, and only the sizes of M and G can tell what they leave open.  With
    two, at two step sizes, the order in h of every block is measured.

    Args:
        jacobian: (N, N) matrix, dense or sparse; a list of them; or the path of an .npz file
            with ``J``, of one matrix or (k, N, N), and if you like ``h`` and ``blocks``, or of
            an .mtx file; or a list of paths.  Signs of G and of rows do not matter.
        blocks: Unknown → size, in the order of the columns; rows in the order D, V, K, C. As
            text ``"u=8,lambda=7"``.
        h: Step size (s) of each.
        beta: Parameter of Newmark's scheme; 1/4 when omitted.
        gamma: Parameter of Newmark's scheme; 1/2 when omitted.
        integrator: An integrator in place of β and γ, as `march` takes it.

    Returns:
        The advice.

    Raises:
        ArgumentError: For an argument of the wrong type, size or name.
        NewmarkError: When a matrix cannot be used, as the inverse of a Jacobian cannot; says
            which and why.

    Examples:
        >>> import newmark_cli as newmark
        >>> def left(h):
        ...     return [[1, 0, -h**2 / 4], [0, 1, 0], [1, 0, 0]]
        >>> steps = [1e-3, 1e-4]
        >>> advice = newmark.advise_jacobian(map(left, steps), blocks="u=2,lambda=1", h=steps)
        >>> advice.found, advice.measured, advice.right["lambda"]
        ('left', True, '1/(beta*h^2)')
    """
    jacobians, file_blocks, steps = _given(jacobian, h)
    method = integrator_or_newmark(beta, gamma, integrator)
    form, sizes = _blocks(blocks if blocks is not None else file_blocks)
    counts = [*sizes.values()]
    for where, matrix in jacobians.items():
        if matrix.shape != (sum(counts), sum(counts)):
            shape = " by ".join(map(str, matrix.shape))
            raise MatrixError(
                f"{where} must be {sum(counts)} by {sum(counts)}, as its blocks are, given {shape}"
            )
        if _is_inverse(matrix, counts):
            raise MatrixError(
                f"{where} is the inverse of a Jacobian: its own inverse has zeros in row C, column "
                "lambda; give the Jacobian: invert it, or export it before it is factorized"
            )
    implied, orders = dict[str, dict[str, float]](), dict[str, dict[str, float]]()
    several = [*jacobians.values()]
    if measured := len(set(steps)) > 1:
        found, orders, powers = _measured(form, [block_sizes(j, counts) for j in several], steps)
    else:
        scheme = Scheme(method, form, named_scaling("optimal", form), steps[0])
        implied = _fitting(several[0], counts, scheme)
        found = min(implied, key=lambda name: _extreme(**implied[name]), default=OTHER)
        powers = block_factors(block_sizes(several[-1], counts))
    left, right = _formulas(form, found, measured, powers)
    factors = [
        [
            np.repeat([Monomial.parse(text)(method.symbols(h)) for text in side.values()], counts)
            for side in (left, right)
        ]
        for h in steps
    ]
    inverted = [_inverted(matrix, counts) for matrix in several]
    condition = tuple(one.condition() if one else math.inf for one in inverted)
    balanced = tuple(
        one.condition(*both) if one else math.inf
        for one, both in zip(inverted, factors, strict=True)
    )
    return JacobianAdvice(
        form.name, sizes, tuple(steps), found, measured, implied, orders, left, right, condition,
        balanced, (*_findings(found, measured, implied, condition, balanced),
                   *_further(inverted[-1], counts, factors[-1], balanced[-1])),
    )  # fmt: skip


def _given(jacobian: Any, h: Any) -> tuple[dict[str, Array], Any, list[float]]:
    """Name → matrix, the blocks that a file names, and the step sizes."""
    single = isinstance(jacobian, str | Path) or hasattr(jacobian, "toarray")
    try:
        items = [jacobian] if single else list(jacobian)
    except TypeError:
        raise ArgumentError(
            "jacobian must be a matrix, several of them, or paths of files"
        ) from None
    if not items:
        raise ArgumentError("jacobian: no matrix")
    jacobians: dict[str, Array] = {}
    blocks, steps = None, []
    if all(isinstance(item, str | Path) for item in items):
        for path in map(Path, items):
            arrays = matrices.read(path, ("J", "h"), dimensions=(0, 1, 2, 3))
            if "J" not in arrays:
                raise MatrixError(f"{path}: J is missing")
            blocks = blocks or matrices.text_of(path, "blocks")
            steps += np.ravel(arrays.get("h", ())).tolist()
            several = arrays["J"].ndim == 3
            for place, matrix in enumerate(arrays["J"] if several else [arrays["J"]], 1):
                jacobians[f"{path}: J" + f", {place}" * several] = matrix
    elif np.ndim(items[0]) < 2:  # rows of one matrix
        jacobians["jacobian"] = matrices.array_of(jacobian, "jacobian")
    else:
        for place, item in enumerate(items, 1):
            name = "jacobian" if single else f"jacobian {place}"
            jacobians[name] = matrices.array_of(item, name)
    if h is not None:
        steps = list(h) if isinstance(h, list | tuple | np.ndarray) and np.ndim(h) else [h]
    if len(steps) == 1:
        steps *= len(jacobians)
    if len(steps) != len(jacobians):
        raise ArgumentError(
            f"h: one step size for each Jacobian: {len(jacobians)}, given {len(steps)}"
        )
    if max(len(matrix) for matrix in jacobians.values()) > MOST_UNKNOWNS:
        raise ArgumentError(f"jacobian: at most {MOST_UNKNOWNS} rows")
    return jacobians, blocks, [arguments.step_size(step) for step in steps]


def _blocks(blocks: Any) -> tuple[Form, dict[str, int]]:
    """The form and the sizes of its unknowns from names and sizes of blocks."""
    if blocks is None:
        raise ArgumentError("blocks: give names and sizes of the unknowns, such as u=8,lambda=7")
    if isinstance(blocks, str):
        pairs = [part.partition("=") for part in blocks.split(",")]
        try:
            counts = [(name.strip(), int(size)) for name, _, size in pairs]
        except ValueError:
            raise ArgumentError(
                "blocks must be names and sizes such as u=8,lambda=7, given "
                f"{arguments.shown(blocks)}"
            ) from None
        if len(dict(counts)) < len(counts):
            raise ArgumentError(f"blocks: a name is there twice, given {arguments.shown(blocks)}")
        blocks = dict(counts)
    if not isinstance(blocks, Mapping):
        raise ArgumentError(f"blocks must be a mapping of names to sizes, given {blocks!r}")
    sizes = {str(name): arguments.count(f"blocks: {name}", n, 1) for name, n in blocks.items()}
    form = next((form for form in FORMS.values() if form.unknowns == tuple(sizes)), None)
    if form is None:
        allowed = "; ".join(",".join(form.unknowns) for form in FORMS.values())
        raise ArgumentError(f"blocks: no form has {','.join(sizes)} in this order; it is {allowed}")
    if len({sizes[name] for name in form.kept}) > 1:
        raise ArgumentError(f"blocks: {', '.join(form.kept)} must have the same size")
    if sizes["lambda"] > (n := sizes[form.kept[0]]):
        raise ArgumentError(
            f"blocks: lambda must be at most {n}, the number of coordinates, given "
            f"{sizes['lambda']}: more constraints are redundant"
        )
    return form, sizes


def _is_inverse(matrix: Array, counts: Sequence[int]) -> bool:
    """Whether this is J⁻¹: it is dense where J has zeros, row C and column λ, and J is not.

    False where the matrix is too ill-conditioned, with blocks of one size, to tell.
    """
    m = counts[-1]
    if not np.any(matrix[-m:, -m:]):
        return False
    rows, columns = (
        np.repeat(factors, counts) for factors in block_factors(block_sizes(matrix, counts))
    )
    even = rows[:, None] * matrix * columns[None, :]
    try:
        inverse = np.asarray(np.linalg.inv(even), float)
    except np.linalg.LinAlgError:
        return False
    in_rows, in_columns = _size(inverse[-m:]), _size(inverse[:, -m:])
    return bool(
        _size(inverse) < 1 / _THERE
        and _size(even[-m:, -m:]) > _THERE * _size(even)
        and _size(inverse[-m:, -m:]) <= _ZERO * in_rows * in_columns / _size(inverse)
    )


def _fitting(matrix: Array, counts: Sequence[int], scheme: Scheme) -> dict[str, dict[str, float]]:
    """Variants whose undoing leaves G and Gᵀ, and the identities of V and K, in their places.

    With the sizes of M and G that each of them implies.
    """
    form, elimination = scheme.form, scheme.elimination
    of_mass = scheme.relations.acceleration[0] * elimination.weights[2]
    place = int(np.argmax(np.abs(of_mass)))
    ends = np.cumsum(counts)[:-1]
    implied = {}
    for name in PAPER_VARIANTS:
        scaling = replace(scheme, scaling=named_scaling(name, form))
        left, right = scaling_factors(scaling, counts[0], counts[-1])
        undone = matrix / left[:, None] / right
        first, *others = ([*np.split(rows, ends, axis=1)] for rows in np.split(undone, ends))
        gradient = first[-1]
        expected = [
            [weight * np.eye(len(gradient)) for weight in weights] for weights in elimination.rows
        ]
        expected.append([weight * gradient.T for weight in elimination.weights[0]])
        if all(
            _equal(block, wanted)
            for blocks, row in zip(others, expected, strict=True)
            for block, wanted in zip(blocks, row, strict=False)
        ):
            mass = _size(first[place]) / abs(float(of_mass[place]))
            implied[name] = {"M": mass, "G": _size(gradient)}
    return implied


def _equal(block: Array, expected: Array) -> bool:
    """Equal but for a sign, which codes choose as they like."""
    apart = min(_size(block - expected), _size(block + expected))
    return apart <= _EQUAL * max(_size(block), _size(expected))


def _size(block: Array) -> float:
    return float(np.linalg.norm(block, 2))


def _extreme(M: float, G: float) -> tuple[float, float]:
    """How extreme the sizes of M and G are that a scaling would mean."""
    mass, gradient = max(M, 1e-300), max(G, 1e-300)
    # Variants of (a, λ) differ by one common factor only.
    return round(abs(math.log10(mass / gradient)), 6), abs(math.log10(gradient))


def _measured(
    form: Form, of_steps: Sequence[Array], steps: Sequence[float]
) -> tuple[str, dict[str, dict[str, float]], tuple[Array, Array]]:
    """Scaling, orders of the blocks from their sizes, and powers of h in rows and columns."""
    first, last = int(np.argmax(steps)), int(np.argmin(steps))
    large, small = of_steps[first], of_steps[last]
    there = (large > 0) & (small > 0)
    ratio = np.divide(large, small, out=np.ones_like(large), where=there)
    orders = np.log(ratio) / math.log(steps[first] / steps[last])
    predicted = form_orders(form)
    there &= np.isfinite(predicted.jacobian)
    block_orders = {
        row: {name: float(orders[i, j]) for j, name in enumerate(form.unknowns) if there[i, j]}
        for i, row in enumerate(form.rows)
    }
    misfits = {
        name: float(np.abs(orders - predicted.scaled(named_scaling(name, form))[0])[there].max())
        for name in PAPER_VARIANTS
    }
    best = min(misfits, key=lambda name: misfits[name])
    # Powers in rows and columns, that of row C being 0.
    rows, columns = (
        np.log2(factors)
        for factors in block_factors(np.where(there, np.exp2(predicted.jacobian - orders), 0.0))
    )
    powers = np.rint(rows - rows[-1]), np.rint(columns + rows[-1])
    return best if misfits[best] < _NEAR else OTHER, block_orders, powers


def _formulas(
    form: Form, found: str, measured: bool, of_blocks: tuple[Array, Array]
) -> Iterator[dict[str, str]]:
    """Factors to the optimal scaling, of rows and of unknowns.

    From the scaling that was found; else from measured powers of h, or as numbers, of blocks.
    """
    optimal = named_scaling("optimal", form)
    present = None if found == OTHER else named_scaling(found, form)
    for side, values in zip(("left", "right"), of_blocks, strict=True):
        factors: Mapping[str, Monomial] = getattr(optimal, side)
        if present is not None:
            there = getattr(present, side)
            yield {name: str(factor * there[name] ** -1) for name, factor in factors.items()}
        elif measured:
            yield {
                name: str(factor * Monomial(1.0, (("h", -int(power)),) if power else ()))
                for (name, factor), power in zip(factors.items(), values, strict=True)
            }
        else:
            yield dict(zip(factors, map(repr, values.tolist()), strict=True))


def _inverted(matrix: Array, counts: Sequence[int]) -> Inverted | None:
    try:
        return Inverted(matrix, counts)
    except np.linalg.LinAlgError:
        return None


def _further(
    inverted: Inverted | None, counts: Sequence[int], factors: Sequence[Array], balanced: float
) -> Iterator[str]:
    """Where blocks are of very different size in spite of the factors: what would mend that."""
    if inverted is None:
        return
    left, right = factors
    even = left[:, None] * inverted.jacobian * right
    rows, columns = block_factors(block_sizes(even, counts))
    better = inverted.condition(left * np.repeat(rows, counts), right * np.repeat(columns, counts))
    if better * _MUCH < balanced:
        shown = ", ".join(f"{value:.3g}" for value in (*rows, *columns))
        yield (
            f"its blocks are of very different size all the same, because of units or of another "
            f"scaling in it: with the further factors {shown} of its rows and columns C = "
            f"{better:.3g}"
        )


def _findings(
    variant: str,
    measured: bool,
    implied: Mapping[str, Mapping[str, float]],
    condition: Sequence[float],
    balanced: Sequence[float],
) -> Iterator[str]:
    if not all(map(math.isfinite, condition)):
        yield "a Jacobian is singular to rounding: constraints are redundant, or a row is zero"
        return
    if measured:
        yield f"the scaling in it is {variant}: the orders of its blocks in h are measured"
    elif not implied:
        yield (
            "the scaling in it is not one of the four: its blocks of G and Gᵀ do not fit. The "
            "factors bring its blocks to one size; a second Jacobian at another h would tell "
            "their powers"
        )
    else:
        sizes = "; ".join(
            f"{name} would mean ‖M‖ = {of['M']:.2g}, ‖G‖ = {of['G']:.2g}"
            for name, of in implied.items()
        )
        only = "its blocks fit no other" if len(implied) == 1 else sizes
        yield (
            f"the scaling in it is {variant}, inferred from one Jacobian: {only}"
            + ("" if len(implied) == 1 else ". A second Jacobian at another h would tell")
        )
    gain = condition[-1] / balanced[-1]
    if gain > 10:
        yield f"it is {gain:.3g} times worse conditioned than with the factors above"
    else:
        yield "it is as well conditioned as with the optimal scaling"
