"""Orders in h without rounding: h is a large prime, and an order is how often it divides.

Every entry of J and of its inverse is a rational function of h.  With a prime p for h and
small whole numbers for everything else, its order in h is its p-adic valuation: p divides
none of the other numbers but by a chance of 1e-18.  Sums that cancel, cancel exactly.

Nothing here comes from the package: rows and relations are written out a second time for all
formulations, and the weights of each form are those of `oracles`.
"""

import itertools
import math
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import oracles

#: In place of h.
PRIME = 2**61 - 1
#: Digits of a number in base p: more than any sum cancels.
DIGITS = 24
_POWERS = [PRIME**k for k in range(DIGITS + 1)]
_MODULUS = _POWERS[DIGITS]

Matrix = list[list["Number"]]


class Number:
    """pᵏ · unit, the unit known to `DIGITS` digits; order +∞ for zero."""

    __slots__ = ("order", "unit")

    def __init__(self, order: float, unit: int) -> None:
        self.order, self.unit = order, unit

    @classmethod
    def of(cls, value: int) -> "Number":
        """A whole number."""
        return cls._normal(0, value % _MODULUS)

    @classmethod
    def _normal(cls, order: float, unit: int) -> "Number":
        if unit == 0:
            return ZERO
        while unit % PRIME == 0:
            unit //= PRIME
            order += 1
        return cls(order, unit)

    def __add__(self, other: "Number") -> "Number":
        if not self.unit:
            return other
        if not other.unit:
            return self
        return Number._sum(self.order, self.unit, other.order, other.unit)

    @classmethod
    def _sum(cls, order: float, unit: int, other_order: float, other_unit: int) -> "Number":
        shift = int(other_order - order)
        if shift < 0:
            order, unit, other_unit, shift = other_order, other_unit, unit, -shift
        total = (unit + other_unit * _POWERS[min(shift, DIGITS)]) % _MODULUS
        found = cls._normal(order, total)
        # What is left of a sum that cancels to its last digits is no digit of it.
        return ZERO if found.order - order > DIGITS // 2 else found

    def minus_product(self, one: "Number", other: "Number") -> "Number":
        """Itself less the product of two that are not zero."""
        order, unit = one.order + other.order, -one.unit * other.unit
        if not self.unit:
            return Number(order, unit % _MODULUS)
        return Number._sum(self.order, self.unit, order, unit)

    def __neg__(self) -> "Number":
        return Number(self.order, -self.unit % _MODULUS)

    def __sub__(self, other: "Number") -> "Number":
        return self + -other

    def __mul__(self, other: "Number") -> "Number":
        if not self.unit or not other.unit:
            return ZERO
        return Number(self.order + other.order, self.unit * other.unit % _MODULUS)

    def __pow__(self, power: int) -> "Number":
        return self if power == 1 else self * self ** (power - 1)

    def __rtruediv__(self, other: int) -> "Number":
        return Number.of(other) / self

    def __truediv__(self, other: "Number") -> "Number":
        if not self.unit:
            return ZERO
        unit = self.unit * pow(other.unit, -1, _MODULUS) % _MODULUS
        return Number(self.order - other.order, unit)


ZERO = Number(math.inf, 0)
ONE = Number(0, 1)
H = Number(1, 1)

#: Form → (kept fields, kept relations).
LAYOUT = {form: (kept, rows[1:-1]) for form, (rows, kept, _) in oracles.FORMS.items()}
#: Formulation → rows of constraints.
CONSTRAINTS: Mapping[str, tuple[str, ...]] = {
    "index-3": ("C",),
    "index-2": ("Cv",),
    "index-1": ("Ca",),
    "baumgarte rate=1000.0": ("B",),
    "baumgarte rate_h=1.0": ("B",),
    "ggl": ("C", "Cv"),
    "augmented-lagrangian factor=10.0": (),
    "augmented-lagrangian penalty=5.0": (),
}


@dataclass(frozen=True)
class System:
    """A linearised system in whole numbers.

    Attributes:
        M, X, Y: (n, n).
        G, P: (n, m); P is what stands before η.
        A, Q: (m, n) ∂(Gᵀv)/∂u and ∂(Gᵀv')/∂u + ∂κ/∂u; ∂κ/∂v is 2A.
        beta, gamma, c: ∂u/∂a = β h², ∂v/∂a = γ h, ∂v'/∂a.
    """

    M: Matrix
    X: Matrix
    Y: Matrix
    G: Matrix
    P: Matrix
    A: Matrix
    Q: Matrix
    beta: Number
    gamma: Number
    c: Number
    about: str = field(default="", compare=False)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.M)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.G[0])


def random_system(
    rng: random.Random,
    damped: bool = True,
    stiff: bool = True,
    moving: bool = True,
    by_mass: bool = True,
) -> System:
    """A system in general position.

    Args:
        rng: Where its numbers come from.
        damped, stiff: Whether Y and X are not zero.
        moving: Whether v ≠ 0, and so A; Q stays, for λ.
        by_mass: Whether P = M⁻¹G rather than G.
    """
    n, m = rng.randint(3, 6), rng.randint(1, 2)

    def matrix(rows: int, columns: int, there: bool = True) -> Matrix:
        # Zeros and equal numbers would be no general position.
        return [
            [Number.of(rng.choice((-1, 1)) * rng.randint(1, 999) * there) for _ in range(columns)]
            for _ in range(rows)
        ]

    root = matrix(n, n)
    M = product(root, transposed(root))
    G = matrix(n, m)
    return System(
        M=M,
        X=matrix(n, n, stiff),
        Y=matrix(n, n, damped),
        G=G,
        P=product(inverse(M), G) if by_mass else G,
        A=matrix(m, n, moving),
        Q=matrix(m, n),
        beta=Number.of(rng.randint(2, 99)) / Number.of(rng.randint(100, 200)),
        gamma=Number.of(rng.randint(2, 99)) / Number.of(rng.randint(100, 200)),
        c=Number.of(rng.randint(2, 99)) / Number.of(rng.randint(100, 200)),
        about=f"n {n}, m {m}, Y {damped}, X {stiff}, A {moving}, P by mass {by_mass}",
    )


def transposed(matrix: Matrix) -> Matrix:
    """Rows as columns."""
    return [list(column) for column in zip(*matrix, strict=True)]


def product(left: Matrix, right: Matrix) -> Matrix:
    """Matrix product."""
    columns = transposed(right)
    return [[_dot(row, column) for column in columns] for row in left]


def _dot(left: Iterable[Number], right: Iterable[Number]) -> Number:
    total = ZERO
    for x, y in zip(left, right, strict=True):
        total = total + x * y
    return total


def _times(factor: Number, matrix: Matrix) -> Matrix:
    return [[factor * x for x in row] for row in matrix]


def _sum(*matrices: Matrix) -> Matrix:
    first, *rest = matrices
    for other in rest:
        first = [
            [x + y for x, y in zip(a, b, strict=True)] for a, b in zip(first, other, strict=True)
        ]
    return first


def _none(rows: int, columns: int) -> Matrix:
    return [[ZERO] * columns for _ in range(rows)]


def _unit(n: int) -> Matrix:
    return [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]


def inverse(matrix: Matrix) -> Matrix:
    """Gauss and Jordan, pivots of least order.

    Raises:
        ZeroDivisionError: For a singular matrix.
    """
    size = len(matrix)
    work = [[*row, *unit] for row, unit in zip(matrix, _unit(size), strict=True)]
    for k in range(size):
        pivot = min(range(k, size), key=lambda i: work[i][k].order)
        if not work[pivot][k].unit:
            raise ZeroDivisionError("singular")
        work[k], work[pivot] = work[pivot], work[k]
        reciprocal = ONE / work[k][k]
        live = [(j, x * reciprocal) for j, x in enumerate(work[k]) if j >= k and x.unit]
        for j, x in live:
            work[k][j] = x
        for i, row in enumerate(work):
            multiple = row[k]
            if i != k and multiple.unit:
                for j, x in live:
                    row[j] = row[j].minus_product(multiple, x)
    return [row[size:] for row in work]


def _least(block: Iterable[Iterable[Number]]) -> float:
    return min((x.order for row in block for x in row), default=math.inf)


class Measured:
    """Orders of a form in a formulation on one system.

    Attributes:
        rows, unknowns: Blocks.
        jacobian, inverse: (blocks, blocks) orders.
    """

    def __init__(self, system: System, form: str, formulation: str) -> None:
        self._system, self._form, self._formulation = system, form, formulation
        self._kept, relations = LAYOUT[form]
        constraints = CONSTRAINTS[formulation]
        self.rows = ("D", *relations, *constraints)
        multipliers = ("lambda", "eta") if formulation == "ggl" else ("lambda",)
        self.unknowns = (*self._kept, *(multipliers if constraints else ()))
        self._weights, self._of_eta = self._eliminated()
        n, m = system.n, system.m
        row_sizes = [n if row in "DVK" else m for row in self.rows]
        sizes = [n if unknown in "uva" else m for unknown in self.unknowns]
        self._spans = _spans(row_sizes), _spans(sizes)
        self._matrix = self._assembled()
        self._inverse = inverse(self._matrix)
        self.jacobian = self._blocks(self._matrix, *self._spans)
        self.inverse = self._blocks(self._inverse, *reversed(self._spans))

    @staticmethod
    def _blocks(matrix: Matrix, rows: Sequence[slice], columns: Sequence[slice]) -> np.ndarray:
        return np.array([[_least(row[c] for row in matrix[r]) for c in columns] for r in rows])

    def _eliminated(self) -> tuple[dict[str, list[Number]], dict[str, Number]]:
        """u, v, a of the kept fields, and the coefficients of Pη, worked out by hand."""
        s = self._system
        b, g = s.beta * H * H, s.gamma * H
        table = oracles.FORMS[self._form][2](s.beta, s.gamma, H)
        weights = [[x if isinstance(x, Number) else Number.of(x) for x in row] for row in table]
        # K reads u = β̃ a + Pη + …: where it eliminates u, η moves u; where a, it moves a and v.
        of_eta = {"u": ZERO, "v": ZERO, "a": ZERO}
        if self._kept in ("v", "a", "va"):
            of_eta["u"] = ONE
        if self._kept == "u":
            of_eta |= {"v": -(g / b), "a": -(ONE / b)}
        return dict(zip("uva", weights, strict=True)), of_eta

    def _constraint(self, row: str) -> tuple[Matrix, Matrix, Matrix]:
        """Derivatives of a row of constraints in u, v and a."""
        s = self._system
        Gt, none, two = transposed(s.G), _none(s.m, s.n), Number.of(2)
        accelerations = (s.Q, _times(two, s.A), _times(s.c, Gt))
        if row == "C":
            return Gt, none, none
        if row == "Cv":
            return s.A, Gt, none
        if row == "Ca":
            return accelerations
        rate = self._rate
        return (
            _sum(s.Q, _times(two * rate, s.A), _times(rate * rate, Gt)),
            _sum(_times(two, s.A), _times(two * rate, Gt)),
            _times(s.c, Gt),
        )

    @property
    def _rate(self) -> Number:
        return ONE / H if "rate_h" in self._formulation else Number.of(1000)

    @property
    def penalty(self) -> Number:
        """p of the augmented Lagrangian."""
        factor = Number.of(5)
        if "factor" in self._formulation:
            factor = factor * self._system.c / (self._system.beta * H * H)
        return factor

    def _assembled(self) -> Matrix:
        s = self._system
        n, m = s.n, s.m
        stiffness = s.X
        if not CONSTRAINTS[self._formulation]:
            penalised = _times(self.penalty, product(s.G, transposed(s.G)))
            stiffness = _sum(s.X, penalised)
        relations = {
            "D": (stiffness, s.Y, _times(s.c, s.M)),
            "V": (_none(n, n), _unit(n), _times(-s.gamma * H, _unit(n))),
            "K": (_unit(n), _none(n, n), _times(-s.beta * H * H, _unit(n))),
        }
        matrix: Matrix = []
        for row in self.rows:
            fields = relations[row] if row in relations else self._constraint(row)
            size = len(fields[0])
            lines: Matrix = [[] for _ in range(size)]
            for k in range(len(self._kept)):
                combined = _sum(
                    *(
                        _times(self._weights[f][k], block)
                        for f, block in zip("uva", fields, strict=True)
                    )
                )
                lines = [line + more for line, more in zip(lines, combined, strict=True)]
            if "lambda" in self.unknowns:
                of_lambda = _times(-ONE, s.G) if row == "D" else _none(size, m)
                lines = [line + more for line, more in zip(lines, of_lambda, strict=True)]
            if "eta" in self.unknowns:
                of_fields = _sum(
                    *(
                        _times(self._of_eta[f], block)
                        for f, block in zip("uva", fields, strict=True)
                    )
                )
                of_eta = product(of_fields, s.P)
                if row == "K":
                    of_eta = _sum(of_eta, _times(-ONE, s.P))
                lines = [line + more for line, more in zip(lines, of_eta, strict=True)]
            matrix += lines
        return matrix

    def residual(self, compensated: bool = False) -> dict[str, float]:
        """Order of each row's largest term, fields, f and λ O(1), or of increments.

        Increments are w, O(h²), and ν, O(h), a, and the constraint and its rate, which
        change by O(h) and O(h) in a step.
        """
        sizes = {"u": 2, "v": 1, "a": 0} if compensated else dict.fromkeys("uva", 0)

        def of_field(name: str) -> float:
            weights = self._weights[name]
            terms = [w.order + sizes[k] for w, k in zip(weights, self._kept, strict=True)]
            return min(terms)

        u, v, a = map(of_field, "uva")
        position = 1.0 if compensated else 0.0
        velocity = 1.0 if compensated else min(0.0, v)
        acceleration = min(0.0, a) if compensated else min(0.0, v, a)
        rate = self._rate.order
        found = {
            "D": min(0.0, a),
            "V": min(v, 1 + a),
            "K": min(u, 2 + a),
            "C": position,
            "Cv": velocity,
            "Ca": acceleration,
            "B": min(acceleration, rate + velocity, 2 * rate + position),
        }
        if not CONSTRAINTS[self._formulation]:
            found["D"] = min(found["D"], self.penalty.order + position)
        return {row: found[row] for row in self.rows}

    def corrections(
        self, rng: random.Random, compensated: bool = False, rows: str | None = None
    ) -> dict[str, float]:
        """Orders of −J⁻¹ Δb for a Δb in general position, eliminated fields included.

        Args:
            rng: Where Δb comes from.
            compensated: Whether Δb is that of compensated evaluation.
            rows: Only rows that begin with one of these letters are perturbed.
        """
        orders = self.residual(compensated)
        right: list[list[Number]] = []
        for row, span in zip(self.rows, self._spans[0], strict=True):
            there = rows is None or row[0] in rows
            right += [
                [Number(orders[row], rng.randint(1, 10**9)) if there else ZERO]
                for _ in range(span.stop - span.start)
            ]
        change = product(self._inverse, right)
        parts = dict(zip(self.unknowns, (change[span] for span in self._spans[1]), strict=True))
        eta = product(self._system.P, parts["eta"]) if "eta" in parts else None
        found = {}
        for name in "uva":
            terms = [
                _times(weight, parts[k])
                for weight, k in zip(self._weights[name], self._kept, strict=True)
            ]
            if eta is not None:
                terms.append(_times(self._of_eta[name], eta))
            found[name] = _least(_sum(*terms))
        for name in ("lambda", "eta"):
            if name in parts:
                found[name] = _least(parts[name])
        return found

    def condition(self, left: Mapping[str, int], right: Mapping[str, int]) -> float:
        """Order of C for powers of h of the rows and unknowns."""
        ell = np.array([left[row] for row in self.rows])
        r = np.array([right[unknown] for unknown in self.unknowns])
        scaled = self.jacobian + ell[:, None] + r
        inverted = self.inverse - r[:, None] - ell
        return float(np.min(scaled) + np.min(inverted))


def _spans(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(ends)]
