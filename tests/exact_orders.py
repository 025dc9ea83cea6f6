"""Orders in h without rounding: h is a large prime, and an order is how often it divides.

Every entry of J and of its inverse is a rational function of h.  With a prime p for h and
small whole numbers for everything else, its order in h is its p-adic valuation: p divides
none of the other numbers but by a chance of 1e-18.  Sums that cancel, cancel exactly.

Nothing here comes from the package: rows and relations are written out a second time for all
formulations, and the weights of each form are those of `oracles`.
"""

import math
import operator
import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
import oracles
from mpmath import mp

#: In place of h.
PRIME = 2**61 - 1
#: Digits of a number in base p: more than any sum cancels.
DIGITS = 24
_POWERS = [PRIME**k for k in range(DIGITS + 1)]
_MODULUS = _POWERS[DIGITS]


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
        first, second = sorted((self, other), key=lambda number: number.order)
        shift = min(int(second.order - first.order), DIGITS)
        found = Number._normal(first.order, (first.unit + second.unit * _POWERS[shift]) % _MODULUS)
        # What is left of a sum that cancels to its last digits is no digit of it.
        return ZERO if found.order - first.order > DIGITS // 2 else found

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
    """A linearised system; its matrices are arrays of `Number`.

    Attributes:
        M, X, Y: (n, n).
        G, P: (n, m); P is what stands before η.
        A, Q: (m, n) ∂(Gᵀv)/∂u and ∂(Gᵀv')/∂u + ∂κ/∂u; ∂κ/∂v is 2A.
        beta, gamma, c: ∂u/∂a = β h², ∂v/∂a = γ h, ∂v'/∂a.
    """

    M: np.ndarray
    X: np.ndarray
    Y: np.ndarray
    G: np.ndarray
    P: np.ndarray
    A: np.ndarray
    Q: np.ndarray
    beta: Number
    gamma: Number
    c: Number
    about: str = field(default="", compare=False)


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

    def matrix(rows: int, columns: int, there: bool = True) -> np.ndarray:
        # Zeros and equal numbers would be no general position.
        return np.array(
            [
                [
                    Number.of(rng.choice((-1, 1)) * rng.randint(1, 999) * there)
                    for _ in range(columns)
                ]
                for _ in range(rows)
            ]
        )

    def share() -> Number:
        return Number.of(rng.randint(2, 99)) / Number.of(rng.randint(100, 200))

    root = matrix(n, n)
    M, G = root @ root.T, matrix(n, m)
    return System(
        M=M,
        X=matrix(n, n, stiff),
        Y=matrix(n, n, damped),
        G=G,
        P=inverse(M) @ G if by_mass else G,
        A=matrix(m, n, moving),
        Q=matrix(m, n),
        beta=share(),
        gamma=share(),
        c=share(),
        about=f"n {n}, m {m}, Y {damped}, X {stiff}, A {moving}, P by mass {by_mass}",
    )


def zeros(*shape: int) -> np.ndarray:
    """A matrix without entries."""
    return np.full(shape, ZERO, object)


def unit(n: int) -> np.ndarray:
    """The identity."""
    return np.where(np.eye(n, dtype=bool), ONE, ZERO)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Gauss and Jordan, pivots of least order.

    Raises:
        ZeroDivisionError: For a singular matrix.
    """
    size = len(matrix)
    work = np.hstack([matrix, unit(size)])
    for k in range(size):
        pivot = min(range(k, size), key=lambda i: work[i, k].order)
        if not work[pivot, k].unit:
            raise ZeroDivisionError("singular")
        work[[k, pivot]] = work[[pivot, k]]
        there = [j for j in range(k, 2 * size) if work[k, j].unit]
        work[k, there] = work[k, there] * (ONE / work[k, k])
        for i in range(size):
            if i != k and work[i, k].unit:
                work[i, there] = work[i, there] - work[k, there] * work[i, k]
    return work[:, size:]


def orders_of(matrix: np.ndarray) -> np.ndarray:
    """Order of every entry."""
    return np.array([x.order for x in matrix.flat], float).reshape(matrix.shape)


class Jacobian:
    """J of a form in a formulation, block by block; of `Number` or of floats.

    Attributes:
        rows, unknowns: Blocks.
        matrix: J.
    """

    def __init__(self, system, form, formulation, h, rate, penalty) -> None:
        self._system, self._h, self._rate, self._penalty = system, h, rate, penalty
        self._one, self._zero = system.beta / system.beta, system.beta - system.beta
        self._kept, relations = LAYOUT[form]
        self._constraints = CONSTRAINTS[formulation]
        self.rows = ("D", *relations, *self._constraints)
        multipliers = ("lambda", "eta") if formulation == "ggl" else ("lambda",)
        self.unknowns = (*self._kept, *(multipliers if self._constraints else ()))
        table = oracles.FORMS[form][2](system.beta, system.gamma, h)
        #: (3, kept) u, v and a of the kept fields, and (3,) of Pη, worked out by hand.
        plain = {0: self._zero, 1: self._one}
        self._weights = np.array(
            [[plain[x] if isinstance(x, int) else x for x in row] for row in table], object
        )
        self._of_eta = self._eliminated()
        self.matrix = self._assembled()

    def _zeros(self, rows: int, columns: int) -> np.ndarray:
        return np.full((rows, columns), self._zero, object)

    def _unit(self, n: int) -> np.ndarray:
        return np.where(np.eye(n, dtype=bool), self._one, self._zero)

    def _eliminated(self) -> list:
        """Coefficients of Pη: K reads u = β̃ a + Pη + …, whichever of u and a it eliminates."""
        s, h, zero = self._system, self._h, self._zero
        if self._kept in ("v", "a", "va"):
            return [self._one, zero, zero]
        if self._kept == "u":
            return [zero, -(s.gamma * h / (s.beta * h * h)), -(self._one / (s.beta * h * h))]
        return [zero, zero, zero]

    def _derivatives(self, row: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of a row in u, v and a."""
        s, h, rate = self._system, self._h, self._rate
        n, m = s.G.shape
        two, none = self._one + self._one, self._zeros(m, n)
        if row == "D":
            stiffness = s.X
            if not self._constraints:
                stiffness = stiffness + s.G @ s.G.T * self._penalty
            return stiffness, s.Y, s.M * s.c
        if row == "V":
            return self._zeros(n, n), self._unit(n), self._unit(n) * -(s.gamma * h)
        if row == "K":
            return self._unit(n), self._zeros(n, n), self._unit(n) * -(s.beta * h * h)
        if row == "C":
            return s.G.T, none, none
        if row == "Cv":
            return s.A, s.G.T, none
        if row == "Ca":
            return s.Q, s.A * two, s.G.T * s.c
        return (
            s.Q + s.A * (two * rate) + s.G.T * (rate * rate),
            s.A * two + s.G.T * (two * rate),
            s.G.T * s.c,
        )

    def _assembled(self) -> np.ndarray:
        s, bands = self._system, []
        for row in self.rows:
            fields = self._derivatives(row)
            band = [
                sum_of(block * w for block, w in zip(fields, of_kept, strict=True))
                for of_kept in self._weights.T
            ]
            if "lambda" in self.unknowns:
                band.append(-s.G if row == "D" else self._zeros(len(fields[0]), s.G.shape[1]))
            if "eta" in self.unknowns:
                pushed = sum_of(block * w for block, w in zip(fields, self._of_eta, strict=True))
                band.append(pushed @ s.P - s.P if row == "K" else pushed @ s.P)
            bands.append(band)
        return np.block(bands)


def form_jacobian(form, x, y, mass, g, h, beta=oracles.BETA, gamma=oracles.GAMMA):
    """J of index 3 in mpmath; h may be a float.

    Returns:
        The matrix, and the block of each row and column: names.
    """
    beta, gamma, h = map(mp.mpf, (beta, gamma, h))
    x, y, mass, g = (np.array(of.tolist(), object) for of in (x, y, mass, g))
    (n, m), zero = g.shape, mp.mpf(0)
    none = np.full((m, n), zero, object)
    system = System(mass, x, y, g, g, none, none, beta, gamma, mp.mpf(1))
    found = Jacobian(system, form, "index-3", h, zero, zero)
    sizes = {"C": m, "lambda": m}
    names = (
        [name for name in blocks for _ in range(sizes.get(name, n))]
        for blocks in (found.rows, found.unknowns)
    )
    return mp.matrix(found.matrix.tolist()), *names


class Measured(Jacobian):
    """Orders of a form in a formulation on one system.

    Attributes:
        jacobian, inverse: (blocks, blocks) orders.
    """

    def __init__(self, system: System, form: str, formulation: str) -> None:
        rate = ONE / H if "rate_h" in formulation else Number.of(1000)
        penalty = Number.of(5)
        if "factor" in formulation:
            penalty = penalty * system.c / (system.beta * H * H)
        super().__init__(system, form, formulation, H, rate, penalty)
        n, m = system.G.shape
        sides = ([n if of in own else m for of in blocks] for own, blocks in (
            ("DVK", self.rows), ("uva", self.unknowns),
        ))  # fmt: skip
        self._row_ends, self._ends = (np.cumsum(sizes)[:-1] for sizes in sides)
        self._inverse = inverse(self.matrix)
        self.jacobian = self._least(self.matrix, self._row_ends, self._ends)
        self.inverse = self._least(self._inverse, self._ends, self._row_ends)

    @staticmethod
    def _least(matrix: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        orders = orders_of(matrix)
        return np.array(
            [[part.min() for part in np.split(band, columns, 1)] for band in np.split(orders, rows)]
        )

    def residual(self, compensated: bool = False) -> dict[str, float]:
        """Order of each row's largest term, fields, f and λ O(1), or of increments.

        Increments are w, O(h²), and ν, O(h), a, and the constraint and its rate, which
        change by O(h) and O(h) in a step.
        """
        sizes = {"u": 2, "v": 1, "a": 0} if compensated else dict.fromkeys("uva", 0)

        kept = np.array([sizes[name] for name in self._kept], float)
        u, v, a = (orders_of(self._weights) + kept).min(axis=1)
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
        if not self._constraints:
            found["D"] = min(found["D"], self._penalty.order + position)
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
        orders, right = self.residual(compensated), []
        sizes = np.diff([0, *self._row_ends, len(self._inverse)])
        for row, size in zip(self.rows, sizes, strict=True):
            there = rows is None or row[0] in rows
            right += [
                Number(orders[row], rng.randint(1, 10**9)) if there else ZERO for _ in range(size)
            ]
        change = np.split(self._inverse @ np.array(right), self._ends)
        parts, found = dict(zip(self.unknowns, change, strict=True)), {}
        for name, weights, of_eta in zip("uva", self._weights, self._of_eta, strict=True):
            terms = [parts[k] * w for w, k in zip(weights, self._kept, strict=True)]
            if "eta" in parts:
                terms.append(self._system.P @ parts["eta"] * of_eta)
            found[name] = orders_of(sum_of(terms)).min()
        found |= {name: orders_of(parts[name]).min() for name in ("lambda", "eta") if name in parts}
        return found

    def condition(self, left: Mapping[str, int], right: Mapping[str, int]) -> float:
        """Order of C for powers of h of the rows and unknowns."""
        ell = np.array([left[row] for row in self.rows])
        r = np.array([right[unknown] for unknown in self.unknowns])
        scaled = self.jacobian + ell[:, None] + r
        inverted = self.inverse - r[:, None] - ell
        return float(np.min(scaled) + np.min(inverted))


def sum_of(matrices: Iterable[np.ndarray]) -> np.ndarray:
    """Their sum."""
    return reduce(operator.add, matrices)
