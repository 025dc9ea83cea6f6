"""A Jacobian from anywhere: which scaling is in it, and what to multiply it by."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import MOST_UNKNOWNS, within_range
from newmark_cli.advice.text import plain, titled
from newmark_cli.library import arguments
from newmark_cli.library.scalings import integrator_or_newmark
from newmark_cli.newmark.balance import Inverted, block_factors, block_sizes
from newmark_cli.newmark.forms import FORMS, Form
from newmark_cli.newmark.integrator import Integrator
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
                [f"row {row}", *(f"{of[name]:.2f}" if name in of else "0" for name in unknowns)]
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
    jacobians, file_blocks, steps = _matrices_and_steps(jacobian, h)
    method = integrator_or_newmark(beta, gamma, integrator)
    form, sizes = _blocks(blocks if blocks is not None else file_blocks)
    counts = [sizes[name] for name in form.unknowns]
    for where, matrix in jacobians.items():
        if matrix.shape != (sum(counts), sum(counts)):
            shape = " by ".join(map(str, matrix.shape))
            raise MatrixError(
                f"{where} must be {sum(counts)} by {sum(counts)}, as its blocks are, given {shape}"
            )
        jacobians[where] = within_range(matrix, where)
        if _is_inverse(jacobians[where], counts):
            raise MatrixError(
                f"{where} is the inverse of a Jacobian: its own inverse has zeros in row C, column "
                "lambda; give the Jacobian: invert it, or export it before it is factorized"
            )
    schemes = [Scheme(method, form, named_scaling("optimal", form), step) for step in steps]
    cut = [_cut(matrix, counts) for matrix in jacobians.values()]
    measured = len(set(steps)) > 1
    implied: dict[str, dict[str, float]] = {}
    orders: dict[str, dict[str, float]] = {}
    if measured:
        variant, orders, powers = _measured(form, cut, steps)
    else:
        implied = _fitting(cut[0], schemes[0])
        variant, powers = _likeliest(implied), None
    left, right = _formulas(form, variant, powers, cut[-1])
    factors = [_factors(form, left, right, method, step, counts) for step in steps]
    condition, balanced = zip(
        *(
            _conditions(matrix, counts, *both)
            for matrix, both in zip(jacobians.values(), factors, strict=True)
        ),
        strict=True,
    )
    further = _further(list(jacobians.values())[-1], counts, factors[-1], balanced[-1])
    findings = (*_findings(variant, measured, implied, condition, balanced), *further)
    return JacobianAdvice(
        form.name, sizes, tuple(steps), variant, measured, implied, orders, left, right,
        condition, balanced, findings,
    )  # fmt: skip


def _matrices_and_steps(jacobian: Any, h: Any) -> tuple[dict[str, Array], str | None, list[float]]:
    """Name → matrix, the blocks that a file names, and the step sizes."""
    jacobian = [Path(jacobian)] if isinstance(jacobian, str | Path) else _dense(jacobian)
    if not isinstance(jacobian, np.ndarray) and isinstance(jacobian, Iterable):
        jacobian = [_dense(item) for item in jacobian]
    if not isinstance(jacobian, list | np.ndarray) or getattr(jacobian, "ndim", 1) == 0:
        raise ArgumentError("jacobian must be a matrix, several of them, or paths of files")
    if not len(jacobian):
        raise ArgumentError("jacobian: no matrix")
    if all(isinstance(item, str | Path) for item in jacobian):
        jacobians, file_blocks, steps = _of_files(jacobian)
    else:
        jacobians, file_blocks, steps = _of_matrices(jacobian), None, []
    if h is not None:
        steps = np.reshape(h, -1).tolist() if isinstance(h, np.ndarray) else h
        steps = list(steps) if isinstance(steps, list | tuple) else [steps]
    if len(steps) == 1:
        steps *= len(jacobians)
    if len(steps) != len(jacobians):
        raise ArgumentError(
            f"h: one step size for each Jacobian: {len(jacobians)}, given {len(steps)}"
        )
    if max(matrix.shape[0] for matrix in jacobians.values()) > MOST_UNKNOWNS:
        raise ArgumentError(f"jacobian: at most {MOST_UNKNOWNS} rows")
    return jacobians, file_blocks, [arguments.step_size(step) for step in steps]


def _dense(matrix: Any) -> Any:
    """A sparse matrix as an array; anything else as it is."""
    return matrix.toarray() if callable(getattr(matrix, "toarray", None)) else matrix


def _of_files(paths: Iterable[Any]) -> tuple[dict[str, Array], str | None, list[Any]]:
    jacobians: dict[str, Array] = {}
    blocks: str | None = None
    steps: list[Any] = []
    for path in paths:
        arrays = matrices.read(Path(path), ("J", "h"), dimensions=(0, 1, 2, 3))
        if "J" not in arrays:
            raise MatrixError(f"{path}: J is missing")
        blocks = blocks or matrices.text_of(Path(path), "blocks")
        steps += arrays.get("h", np.empty(0)).reshape(-1).tolist()
        jacobians |= _apart(arrays["J"], str(path))
    return jacobians, blocks, steps


def _of_matrices(jacobian: Any) -> dict[str, Array]:
    stacked = isinstance(jacobian, np.ndarray) and jacobian.ndim == 3
    # A list of rows is one matrix; a list of matrices several.
    if not stacked and np.ndim(jacobian[0] if len(jacobian) else 0) < 2:
        return {"jacobian": matrices.array_of(jacobian, "jacobian")}
    names = [f"jacobian {place + 1}" for place in range(len(jacobian))]
    return dict(zip(names, map(matrices.array_of, jacobian, names), strict=True))


def _apart(array: Array, where: str) -> dict[str, Array]:
    if array.ndim == 3:
        return {f"{where}: J, {place + 1}": matrix for place, matrix in enumerate(array)}
    return {f"{where}: J": array}


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


def _cut(matrix: Array, counts: Sequence[int]) -> list[list[Array]]:
    ends = np.cumsum(counts)[:-1]
    return [list(np.split(rows, ends, axis=1)) for rows in np.split(matrix, ends)]


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


def _fitting(blocks: list[list[Array]], scheme: Scheme) -> dict[str, dict[str, float]]:
    """Variants whose undoing leaves G and Gᵀ, and the identities of V and K, in their places.

    With the sizes of M and G that each of them implies.
    """
    form, elimination = scheme.form, scheme.elimination
    symbols = scheme.symbols
    implied = {}
    for name in PAPER_VARIANTS:
        scaling = named_scaling(name, form)
        plain_blocks = [
            [
                block / (scaling.left[row](symbols) * scaling.right[unknown](symbols))
                for unknown, block in zip(form.unknowns, of_row, strict=True)
            ]
            for row, of_row in zip(form.rows, blocks, strict=True)
        ]
        gradient = plain_blocks[0][-1]
        expected = [
            [weight * np.eye(len(gradient)) for weight in weights] for weights in elimination.rows
        ]
        expected.append([weight * gradient.T for weight in elimination.weights[0]])
        pairs = [
            (plain_blocks[i + 1][k], block)
            for i, of_row in enumerate(expected)
            for k, block in enumerate(of_row)
        ]
        if all(_equal(*pair) for pair in pairs):
            implied[name] = {"M": _mass(plain_blocks[0], scheme), "G": _size(gradient)}
    return implied


def _equal(block: Array, expected: Array) -> bool:
    """Equal but for a sign, which codes choose as they like."""
    apart = min(_size(block - expected), _size(block + expected))
    return apart <= _EQUAL * max(_size(block), _size(expected))


def _size(block: Array) -> float:
    return float(np.linalg.norm(block, 2))


def _mass(row: list[Array], scheme: Scheme) -> float:
    """‖M‖ from the block of row D that it stands in with the largest weight."""
    weights = scheme.relations.acceleration[0] * scheme.elimination.weights[2]
    place = int(np.argmax(np.abs(weights)))
    return _size(row[place]) / abs(float(weights[place]))


def _likeliest(implied: Mapping[str, Mapping[str, float]]) -> str:
    """The variant with the least extreme sizes of M and G."""
    if not implied:
        return OTHER

    def extreme(name: str) -> tuple[float, float]:
        mass, gradient = (max(implied[name][key], 1e-300) for key in ("M", "G"))
        # Variants of (a, λ) differ by one common factor only.
        return round(abs(math.log10(mass / gradient)), 6), abs(math.log10(gradient))

    return min(implied, key=extreme)


def _measured(
    form: Form, cut: Sequence[list[list[Array]]], steps: Sequence[float]
) -> tuple[str, dict[str, dict[str, float]], tuple[Array, Array]]:
    """Scaling, orders of the blocks, and powers of h that are in rows and columns."""
    first, last = int(np.argmax(steps)), int(np.argmin(steps))
    sizes = [np.array([[_size(b) for b in row] for row in cut[k]]) for k in (first, last)]
    there = (sizes[0] > 0) & (sizes[1] > 0)
    ratio = np.divide(sizes[0], sizes[1], out=np.ones_like(sizes[0]), where=there)
    orders = np.log(ratio) / math.log(steps[first] / steps[last])
    expected = form_orders(form).jacobian
    there &= np.isfinite(expected)
    block_orders = {
        row: {name: float(orders[i, j]) for j, name in enumerate(form.unknowns) if there[i, j]}
        for i, row in enumerate(form.rows)
    }
    misfits = {}
    for name in PAPER_VARIANTS:
        scaling = named_scaling(name, form)
        left = np.array([scaling.left[row].order() for row in form.rows])
        right = np.array([scaling.right[unknown].order() for unknown in form.unknowns])
        apart = np.abs(orders - expected - left[:, None] - right[None, :])
        misfits[name] = float(apart[there].max())
    best = min(misfits, key=lambda name: misfits[name])
    # Powers in rows and columns, that of row C being 0.
    places = np.argwhere(there)
    size = len(form.rows)
    system = np.zeros((len(places) + 1, 2 * size))
    system[np.arange(len(places)), places[:, 0]] = 1
    system[np.arange(len(places)), size + places[:, 1]] = 1
    system[-1, size - 1] = 1
    wanted = np.append((orders - np.where(there, expected, 0))[there], 0.0)
    powers = np.linalg.lstsq(system, wanted, rcond=None)[0]
    return (
        best if misfits[best] < _NEAR else OTHER,
        block_orders,
        (np.rint(powers[:size]), np.rint(powers[size:])),
    )


def _formulas(
    form: Form, variant: str, powers: tuple[Array, Array] | None, blocks: list[list[Array]]
) -> tuple[dict[str, str], dict[str, str]]:
    """Factors from the scaling that is in the blocks to the optimal one."""
    optimal = named_scaling("optimal", form)
    if variant != OTHER:
        present = named_scaling(variant, form)
        return (
            {row: str(factor * present.left[row] ** -1) for row, factor in optimal.left.items()},
            {
                name: str(factor * present.right[name] ** -1)
                for name, factor in optimal.right.items()
            },
        )
    if powers is not None:
        left, right = (
            {
                name: str(factor * Monomial(1.0, (("h", -int(power)),) if power else ()))
                for (name, factor), power in zip(side.items(), of_side, strict=True)
            }
            for side, of_side in zip((optimal.left, optimal.right), powers, strict=True)
        )
        return left, right
    sizes = np.array([[_size(block) for block in row] for row in blocks])
    rows, columns = block_factors(sizes)
    return (
        dict(zip(form.rows, map(repr, rows.tolist()), strict=True)),
        dict(zip(form.unknowns, map(repr, columns.tolist()), strict=True)),
    )


def _factors(
    form: Form, left: Mapping[str, str], right: Mapping[str, str],
    method: Integrator, h: float, counts: Sequence[int],
) -> tuple[Array, Array]:  # fmt: skip
    symbols = method.symbols(h)
    return (
        np.repeat([Monomial.parse(left[row])(symbols) for row in form.rows], counts),
        np.repeat([Monomial.parse(right[name])(symbols) for name in form.unknowns], counts),
    )


def _conditions(
    matrix: Array, counts: Sequence[int], left: Array, right: Array
) -> tuple[float, float]:
    try:
        inverted = Inverted(matrix, counts)
    except np.linalg.LinAlgError:
        return math.inf, math.inf
    return inverted.condition(), inverted.condition(left, right)


def _further(
    matrix: Array, counts: Sequence[int], factors: tuple[Array, Array], balanced: float
) -> Iterator[str]:
    """Where blocks are of very different size in spite of the factors: what would mend that."""
    if not math.isfinite(balanced):
        return
    left, right = factors
    even = left[:, None] * matrix * right[None, :]
    rows, columns = block_factors(block_sizes(even, counts))
    better = Inverted(matrix, counts).condition(
        left * np.repeat(rows, counts), right * np.repeat(columns, counts)
    )
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
