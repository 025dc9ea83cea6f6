"""Orders in h measured at h = 1e-20, in numbers long enough for it.

Nothing here comes from the package: the four-field Jacobian, the rows and the
weights of each form are written out a second time, so that a slip in the
package's assembly or exponent arithmetic cannot cancel against itself.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from mpmath import MPContext

#: The unscaled (u, λ) form has condition h⁻⁴ = 1e88 at the smaller step and
#: blocks between h² and h⁻²: 240 digits leave some 60 beyond all of that.
DIGITS = 240
#: Next terms are smaller by a factor h, or by h times the ratios of the system's own
#: numbers (1e9 for Andrews' X and M at most): slopes are whole far within the tolerance.
STEPS = ("1e-20", "1e-22")
SLOPE_TOLERANCE = 1e-6
#: Entries of an inverse that are this much smaller than the largest are rounding
#: of a zero: genuine ones span h⁻² to h², 88 decades, rounding starts below 1e-150.
_ROUNDING = "1e-120"

# A context of one's own: the digits of mpmath's are for whoever else uses it.
mp = MPContext()
mp.dps = DIGITS
mpf = mp.mpf

Row = list[mpf]
Matrix = list[Row]
Array = np.ndarray
#: From the numbers of beta, gamma and h to the factors of the rows and of the unknowns.
FactorFunction = Callable[[Mapping[str, mpf]], tuple[Sequence[mpf], Sequence[mpf]]]

#: Form → (kept fields, rows).
LAYOUT: Mapping[str, tuple[str, str]] = {
    "u-v-a-lambda": ("uva", "DVKC"),
    "u-v-lambda": ("uv", "DKC"),
    "u-lambda": ("u", "DC"),
    "v-lambda": ("v", "DC"),
    "a-lambda": ("a", "DC"),
    "u-a-lambda": ("ua", "DKC"),
    "v-a-lambda": ("va", "DVC"),
}

#: Form → ∂(u, v, a)/∂(kept), rows u, v, a, as functions of β, γ, h.
WEIGHTS: Mapping[str, Callable[[mpf, mpf, mpf], Matrix]] = {
    "u-v-a-lambda": lambda b, g, h: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "u-v-lambda": lambda b, g, h: [[1, 0], [0, 1], [0, 1 / (g * h)]],
    "u-lambda": lambda b, g, h: [[1], [g / (b * h)], [1 / (b * h**2)]],
    "v-lambda": lambda b, g, h: [[b * h / g], [1], [1 / (g * h)]],
    "a-lambda": lambda b, g, h: [[b * h**2], [g * h], [1]],
    "u-a-lambda": lambda b, g, h: [[1, 0], [0, g * h], [0, 1]],
    "v-a-lambda": lambda b, g, h: [[0, b * h**2], [1, 0], [0, 1]],
}


@dataclass(frozen=True)
class System:
    """A linearised system and the numbers of its integrator.

    Attributes:
        M, X, Y: (n, n).
        G: (n, m).
        beta, gamma: Newmark's numbers.
    """

    M: Matrix
    X: Matrix
    Y: Matrix
    G: Matrix
    beta: mpf
    gamma: mpf

    @classmethod
    def of(
        cls,
        M: Iterable[Iterable[float]],
        X: Iterable[Iterable[float]],
        Y: Iterable[Iterable[float]],
        G: Iterable[Iterable[float]],
        beta: float = 0.25,
        gamma: float = 0.5,
    ) -> "System":
        """System from rows of ints or floats, each taken to be exact."""
        return cls(*(_exact(matrix) for matrix in (M, X, Y, G)), mpf(beta), mpf(gamma))

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.M)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.G[0])

    @property
    def damped(self) -> bool:
        """Whether Y ≠ 0."""
        return any(map(any, self.Y))

    @property
    def stiff(self) -> bool:
        """Whether X ≠ 0."""
        return any(map(any, self.X))

    def in_general_position(self) -> bool:
        """Whether the orders are those of O(1) blocks.

        G must have full rank.  A Y that is not zero must act both along the
        constraints and across: M⁻¹Y would otherwise have no multiplier, or no
        motion, that answers it.
        """
        if rank(_transpose(self.G)) < self.m:
            return False
        if not self.damped:
            return True
        both = [[*g, *y] for g, y in zip(self.G, self.Y, strict=True)]
        normal = product(_transpose(self.G), product(inverse(self.M), self.Y))
        size = max(abs(x) for row in normal for x in row)
        return rank(both) > self.m and size > mpf(_ROUNDING)


@dataclass(frozen=True)
class Norms:
    """A form at one step size: Frobenius norms of blocks.

    Attributes:
        weights: (3, p) |W|.
        jacobian: (rows, unknowns).
        inverse: (unknowns, rows).
        residual: (rows,) largest term of each row.
    """

    weights: Array
    jacobian: Array
    inverse: Array
    residual: Array


@dataclass(frozen=True)
class Factors:
    """Numbers of a scaling at both step sizes, outer index the step.

    Attributes:
        left: (2, rows).
        right: (2, unknowns).
    """

    left: Array
    right: Array

    @classmethod
    def of(cls, function: FactorFunction, system: System) -> "Factors":
        """Evaluate a scaling's factors with the system's β and γ."""
        sides = [function(_symbols(system, mpf(h))) for h in STEPS]
        left, right = (
            np.array([[float(x) for x in row] for row in side]) for side in zip(*sides, strict=True)
        )
        return cls(left, right)


class Measured:
    """Orders of one form, from its norms at both step sizes."""

    def __init__(self, norms: Sequence[Norms]) -> None:
        self._norms = norms

    @property
    def weights(self) -> Array:
        """Orders of W."""
        return _orders(*(norms.weights for norms in self._norms))

    @property
    def jacobian(self) -> Array:
        """Orders of the blocks of J."""
        return _orders(*(norms.jacobian for norms in self._norms))

    @property
    def inverse(self) -> Array:
        """Orders of the blocks of J⁻¹."""
        return _orders(*(norms.inverse for norms in self._norms))

    @property
    def residual(self) -> Array:
        """Orders of the perturbation of the residual."""
        return _orders(*(norms.residual for norms in self._norms))

    def corrections(self, factors: Factors | None = None) -> Array:
        """Orders of the corrections of the unknowns, scaled ones with factors."""
        return _orders(
            *(
                norms.inverse @ norms.residual / (1 if factors is None else factors.right[step])
                for step, norms in enumerate(self._norms)
            )
        )

    def physical_corrections(self) -> Array:
        """Orders of the corrections of u, v, a, λ, the eliminated ones through W."""
        found = []
        for norms in self._norms:
            kept = norms.inverse @ norms.residual
            found.append(np.append(norms.weights @ kept[:-1], kept[-1]))
        return _orders(*found)

    def scaled(self, factors: Factors) -> tuple[Array, Array]:
        """Orders of the blocks of J̄ and of J̄⁻¹ = D_R⁻¹ J⁻¹ D_L⁻¹."""
        jacobians, inverses = self._scaled_norms(factors)
        return _orders(*jacobians), _orders(*inverses)

    def condition(self, factors: Factors) -> float:
        """Order of ‖J̄‖·‖J̄⁻¹‖, Frobenius norms."""
        jacobians, inverses = self._scaled_norms(factors)
        found = [
            np.sqrt(np.sum(jacobian**2)) * np.sqrt(np.sum(inverted**2))
            for jacobian, inverted in zip(jacobians, inverses, strict=True)
        ]
        return float(_orders(*found))

    def _scaled_norms(self, factors: Factors) -> tuple[list[Array], list[Array]]:
        jacobians, inverses = [], []
        for norms, left, right in zip(self._norms, factors.left, factors.right, strict=True):
            jacobians.append(norms.jacobian * left[:, None] * right)
            inverses.append(norms.inverse / right[:, None] / left)
        return jacobians, inverses


def measure(system: System, form: str) -> Measured:
    """Orders of a form, its own matrix assembled and inverted."""
    found = []
    for h in map(mpf, STEPS):
        matrix = jacobian(system, form, h)
        found.append(_norms(system, form, h, matrix, inverse(matrix)))
    return Measured(found)


def measure_all(system: System) -> dict[str, Measured]:
    """Orders of every form from one inversion a step size.

    A form's inverse is the block rows and columns that it keeps of the inverse
    of the four-field matrix.
    """
    found: dict[str, list[Norms]] = {form: [] for form in LAYOUT}
    for h in map(mpf, STEPS):
        whole = inverse(jacobian(system, "u-v-a-lambda", h))
        for form, norms in found.items():
            part = kept_part(system, form, whole)
            norms.append(_norms(system, form, h, jacobian(system, form, h), part))
    return {form: Measured(norms) for form, norms in found.items()}


def measure_scaled(
    system: System,
    form: str,
    factors: FactorFunction,
) -> tuple[Array, Array, float]:
    """Orders of J̄, of J̄⁻¹ and of the condition number, J̄ formed and inverted as it is.

    Args:
        system: The system.
        form: The form.
        factors: The scaling.
    """
    jacobians, inverses, conditions = [], [], []
    row_sizes, unknown_sizes = block_sizes(system, form)
    for h in map(mpf, STEPS):
        left, right = factors(_symbols(system, h))
        row_factors = [f for f, size in zip(left, row_sizes, strict=True) for _ in range(size)]
        column_factors = [
            f for f, size in zip(right, unknown_sizes, strict=True) for _ in range(size)
        ]
        matrix = [
            [x * row_factor * factor for x, factor in zip(row, column_factors, strict=True)]
            for row, row_factor in zip(jacobian(system, form, h), row_factors, strict=True)
        ]
        inverted = inverse(matrix)
        jacobians.append(block_norms(matrix, row_sizes, unknown_sizes))
        inverses.append(block_norms(inverted, unknown_sizes, row_sizes))
        conditions.append(np.linalg.norm(jacobians[-1]) * np.linalg.norm(inverses[-1]))
    return _orders(*jacobians), _orders(*inverses), float(_orders(*map(np.asarray, conditions)))


def jacobian(system: System, form: str, h: mpf) -> Matrix:
    """Jacobian of a form: four-field blocks, columns combined by W, rows selected."""
    n, m = system.n, system.m
    beta, gamma = system.beta, system.gamma
    one, none = _diagonal(n, mpf(1)), _diagonal(n, mpf(0))
    G = system.G
    four_field = {
        "D": ((system.X, system.Y, system.M), [[-x for x in row] for row in G]),
        "V": ((none, one, _diagonal(n, -gamma * h)), _zeros(n, m)),
        "K": ((one, none, _diagonal(n, -beta * h**2)), _zeros(n, m)),
        "C": ((_transpose(G), _zeros(m, n), _zeros(m, n)), _zeros(m, m)),
    }
    kept, rows = LAYOUT[form]
    weights = WEIGHTS[form](beta, gamma, h)
    matrix: Matrix = []
    for row in rows:
        fields, multipliers = four_field[row]
        for i, last in enumerate(multipliers):
            line: Row = []
            for k in range(len(kept)):
                of_fields = [(block[i], weights[f][k]) for f, block in enumerate(fields)]
                line += [
                    sum((block[j] * w for block, w in of_fields if w), mpf(0)) for j in range(n)
                ]
            matrix.append(line + last)
    return matrix


def kept_part(system: System, form: str, whole: Matrix) -> Matrix:
    """Block rows and columns of the four-field inverse that belong to a form."""
    n = system.n
    kept, rows = LAYOUT[form]
    size = 3 * n + system.m
    unknowns = [i for f in kept for i in range(n * "uva".index(f), n * "uva".index(f) + n)]
    equations = [j for r in rows[:-1] for j in range(n * "DVK".index(r), n * "DVK".index(r) + n)]
    last = list(range(3 * n, size))
    return [[whole[i][j] for j in equations + last] for i in unknowns + last]


def block_sizes(system: System, form: str) -> tuple[list[int], list[int]]:
    """Sizes of a form's row blocks and of its unknowns."""
    kept, rows = LAYOUT[form]
    return (
        [*[system.n] * (len(rows) - 1), system.m],
        [*[system.n] * len(kept), system.m],
    )


def inverse(matrix: Matrix) -> Matrix:
    """Inverse by Gauss-Jordan elimination with partial pivoting.

    Entries that are nothing but rounding become 0.

    Raises:
        ZeroDivisionError: When a column has no pivot.
    """
    size = len(matrix)
    work = [[*row, *unit] for row, unit in zip(matrix, _diagonal(size, mpf(1)), strict=True)]
    for k in range(size):
        pivot = max(range(k, size), key=lambda i: abs(work[i][k]))
        work[k], work[pivot] = work[pivot], work[k]
        reciprocal = 1 / work[k][k]
        # Much of the matrix is zero, and stays so for a while.
        live = [(j, x * reciprocal) for j, x in enumerate(work[k]) if j >= k and x]
        for j, x in live:
            work[k][j] = x
        for i, row in enumerate(work):
            factor = row[k]
            if i != k and factor:
                for j, x in live:
                    row[j] -= factor * x
    inverted = [row[size:] for row in work]
    rounding = max(abs(x) for row in inverted for x in row) * mpf(_ROUNDING)
    return [[x if abs(x) > rounding else mpf(0) for x in row] for row in inverted]


def rank(matrix: Matrix) -> int:
    """Rank of a matrix of moderate numbers."""
    work = [list(row) for row in matrix]
    found = 0
    for k in range(len(work[0])):
        candidates = [i for i in range(found, len(work)) if abs(work[i][k]) > mpf(_ROUNDING)]
        if not candidates:
            continue
        pivot = candidates[0]
        work[found], work[pivot] = work[pivot], work[found]
        for i in range(found + 1, len(work)):
            factor = work[i][k] / work[found][k]
            work[i] = [x - factor * y for x, y in zip(work[i], work[found], strict=True)]
        found += 1
    return found


def product(left: Matrix, right: Matrix) -> Matrix:
    """Matrix product."""
    columns = _transpose(right)
    return [[mp.fdot(row, column) for column in columns] for row in left]


def block_norms(matrix: Matrix, rows: Sequence[int], columns: Sequence[int]) -> Array:
    """Frobenius norms of blocks; they fit into doubles, which the entries' digits need not."""
    values = np.array([[float(x) for x in row] for row in matrix])
    squares = np.add.reduceat(values**2, np.cumsum([0, *rows[:-1]]), axis=0)
    return np.sqrt(np.add.reduceat(squares, np.cumsum([0, *columns[:-1]]), axis=1))


def _norms(system: System, form: str, h: mpf, matrix: Matrix, inverted: Matrix) -> Norms:
    rows, unknowns = block_sizes(system, form)
    weights = WEIGHTS[form](system.beta, system.gamma, h)
    size = np.abs([[float(w) for w in row] for row in weights])
    # D holds M a, f and Gλ; V holds v and γh a; K holds u and βh² a; the fields,
    # λ and f are O(1), and what is not kept stands there as W times what is.
    mass = max(abs(float(x)) for row in system.M for x in row)
    largest = {
        "D": max(1.0, mass * size[2].max()),
        "V": max(size[1].max(), float(system.gamma * h) * size[2].max()),
        "K": max(size[0].max(), float(system.beta * h**2) * size[2].max()),
        "C": 1.0,
    }
    return Norms(
        weights=size,
        jacobian=block_norms(matrix, rows, unknowns),
        inverse=block_norms(inverted, unknowns, rows),
        residual=np.array([largest[row] for row in LAYOUT[form][1]]),
    )


def _orders(first: Array, second: Array) -> Array:
    """Slopes between the two steps, whole where they are; +∞ for zeros."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    there = (first > 0) & (second > 0)
    ratio = np.divide(second, first, out=np.ones_like(first), where=there)
    slopes = np.log(ratio) / math.log(float(STEPS[1]) / float(STEPS[0]))
    whole = np.round(slopes)
    slopes = np.where(np.abs(slopes - whole) < SLOPE_TOLERANCE, whole, slopes)
    return np.where(there, slopes, np.where(first == second, np.inf, np.nan))


def _symbols(system: System, h: mpf) -> dict[str, mpf]:
    return {"beta": system.beta, "gamma": system.gamma, "h": h}


def _exact(matrix: Iterable[Iterable[float]]) -> Matrix:
    return [[mpf(x) for x in row] for row in matrix]


def _diagonal(n: int, value: mpf) -> Matrix:
    return [[value if i == j else mpf(0) for j in range(n)] for i in range(n)]


def _zeros(rows: int, columns: int) -> Matrix:
    return [[mpf(0)] * columns for _ in range(rows)]


def _transpose(matrix: Matrix) -> Matrix:
    return [list(column) for column in zip(*matrix, strict=True)]
