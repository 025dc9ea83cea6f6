"""Integrators of the Newmark family as two update relations.

A scheme of the family ties the new fields by

    V:  v = γ̃ a + (past),        γ̃ = γ h for Newmark
    K:  u = β̃ a + (past),        β̃ = β h²

and puts into row D the acceleration v' = c a + (past), c = 1 for Newmark.  The
past is a short list of vectors that every step renews.  Nothing else in the
core knows an integrator: another of the family is another set of coefficients
(`Relations`), from which its sensitivities and so its scaling follow.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.errors import InputError

FIELDS = ("u", "v", "a")
#: What tables and figures call Newmark's scheme with β = 1/4 and γ = 1/2.
TRAPEZOIDAL_NAME = "trapezoidal"

#: What a past vector may become (`Relations.advance`): a new field, the true
#: acceleration v', or an increment over the step, w = u − u_n − h v_n, ν = v − v_n.
NEW_U, NEW_V, NEW_A, TRUE_ACCELERATION, NEW_W, NEW_NU = range(6)

KEEP, RESCALE, RESTART, RESCALE_VELOCITY = "keep", "rescale", "restart", "rescale-velocity"
#: What an integrator carries over where the step size changes: the past is kept; what an
#: auxiliary acceleration differs by from v' is scaled with h; it starts anew from u, v, v'; or
#: besides scaling a, the part of the velocity across the constraints is scaled alike.
AUXILIARY = (RESCALE_VELOCITY, RESCALE, KEEP, RESTART)


#: By how much coefficients may be off that are given in decimals.
ROUNDED = 1e-8


class IntegratorError(InputError):
    """The parameters do not give a usable integrator; says which and why.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.scaling("u-lambda", h=1e-3, beta=-1)
        Traceback (most recent call last):
        ...
        newmark_cli.newmark.integrator.IntegratorError: beta = -1: must be positive, ...
    """


@dataclass(frozen=True)
class Relations:
    """Update relations at one step size; P past vectors, the first two u_n and v_n.

    The past part of K begins with u_n + h v_n and that of V with v_n in every
    scheme; all else in them is as small as the increments w and ν.

    Attributes:
        v_from_a: ∂v/∂a through V (s); γh for Newmark.
        u_from_a: ∂u/∂a through K (s²); βh² for Newmark.
        v_past: (P,) past part of V.
        u_past: (P,) past part of K.
        acceleration: (1 + P,) v' in row D from the new a and the past.
        advance: (P,) what each past vector becomes, `NEW_U` … `NEW_NU`.
        start: (P, 3) past vectors at the initial time from u0, v0 and a0.
    """

    v_from_a: float
    u_from_a: float
    v_past: Array
    u_past: Array
    acceleration: Array
    advance: IndexArray
    start: Array

    def carried(self, auxiliary: str, behind: float, ratio: float, moved: float = 0.0) -> Array:
        """What becomes of the past where the step size changes.

        Smooth motion leaves the auxiliary acceleration of generalized-α off v' by a
        multiple of h; the increments of BDF2 are those of the last step, whatever its size,
        as its coefficients know, but for what the velocity is moved by.

        Args:
            auxiliary: One of `AUXILIARY`.
            behind: Size of the last step (s).
            ratio: The new step size over that.
            moved: Part of the velocity across the constraints that is added to it.

        Returns:
            (P, P + 2) the new past vectors from the old ones, the last v', and the part of
            the velocity across the constraints, M⁻¹G(GᵀM⁻¹G)⁻¹(Gᵀv + Φ_t).
        """
        places = len(self.advance)
        carried = np.eye(places, places + 2)
        if auxiliary == RESTART:
            of_start = np.zeros((3, places + 2))
            of_start[0, 0] = of_start[1, 1] = of_start[2, places] = 1
            return np.asarray(self.start @ of_start)
        for place, what in enumerate(self.advance):
            if what == NEW_V:
                carried[place, -1] = moved
            elif what == NEW_W:
                carried[place, -1] = -behind * moved
            elif what == NEW_A and auxiliary != KEEP:
                carried[place, place], carried[place, places] = ratio, 1 - ratio
        return carried


class Integrator(ABC):
    """Interface of an integrator to the core; a frozen, hashable value."""

    @property
    def label(self) -> str:
        """How the CSV names it, to the last bit; `parse` reads it back."""
        method = next(name for name, kind in INTEGRATORS.items() if isinstance(self, kind))
        values = (f" {name}={float(getattr(self, name))!r}" for name in parameters(method))
        return method + "".join(values)

    @property
    @abstractmethod
    def order(self) -> int:
        """Order of u and v on index-3 systems with constant step size."""

    @property
    @abstractmethod
    def damped(self) -> bool:
        """Whether errors of a and λ that alternate from step to step die out."""

    def symbols(self, h: float, ratio: float = 1.0) -> dict[str, float]:
        """Numbers of the symbols that a scaling may use.

        β and γ are ∂u/∂v' h⁻² and ∂v/∂v' h⁻¹ of the scheme: γ/(βh) = ∂v/∂u and
        1/(βh²) = ∂v'/∂u, the sensitivities to displacement.
        """
        unit = self.relations(1.0, ratio)
        share = float(unit.acceleration[0])
        return {"beta": unit.u_from_a / share, "gamma": unit.v_from_a / share, "h": h}

    def across(self, h: float, before: float) -> float:
        """What Gᵀv + Φ_t is in proportion to, where index 3 holds the constraints alone.

        At constant h it is −h²/12 Gᵀu‴ in the trapezoidal rule, and likewise a constant times
        h² in generalized-α; −h (h + before)/6 Gᵀu‴ in BDF2, ``before`` being the size of the
        step before that of size h (s); −h/2 Gᵀu″ in BDF1.
        """
        return h * h

    @abstractmethod
    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients at step size h (s), which is ``ratio`` times that of the step before."""

    @property
    def note(self) -> str:
        """What a user should be told of its parameters; empty where there is nothing."""
        return ""


class _Alpha(Integrator):
    """Newmark's V and K in an auxiliary acceleration a, which v' follows.

    (1 − α_m) a + α_m a_n = (1 − α_f) v' + α_f v'_n,  a_0 = v'_0; the past is
    (u_n, v_n, a_n, v'_n).
    """

    @property
    def order(self) -> int:
        """Two where γ = ½ − α_m + α_f, as of any of these but `Alpha`."""
        return 2

    @property
    @abstractmethod
    def parameters(self) -> tuple[float, float, float, float]:
        """β, γ, α_m, α_f."""

    def symbols(self, h: float, ratio: float = 1.0) -> dict[str, float]:
        """β and γ per unit of v': Newmark's times (1 − α_f)/(1 − α_m)."""
        beta, gamma, alpha_m, alpha_f = self.parameters
        share = (1 - alpha_f) / (1 - alpha_m)
        return {"beta": beta * share, "gamma": gamma * share, "h": h}

    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients over the past (u_n, v_n, a_n, v'_n) at step size h (s)."""
        beta, gamma, alpha_m, alpha_f = self.parameters
        return Relations(
            v_from_a=gamma * h,
            u_from_a=beta * h**2,
            v_past=np.array([0.0, 1.0, (1 - gamma) * h, 0.0]),
            u_past=np.array([1.0, h, (0.5 - beta) * h**2, 0.0]),
            acceleration=np.array([1 - alpha_m, 0.0, 0.0, alpha_m, -alpha_f]) / (1 - alpha_f),
            advance=np.array([NEW_U, NEW_V, NEW_A, TRUE_ACCELERATION]),
            start=np.eye(3)[[0, 1, 2, 2]],
        )


def _refuse_outside(name: str, value: float, low: float, high: float, why: str) -> None:
    if not low <= value <= high:
        raise IntegratorError(f"{name} = {value:g}: must be within [{low:g}, {high:g}]; {why}")


def _refuse_beta(beta: float) -> None:
    if not (np.isfinite(beta) and beta > 0):
        raise IntegratorError(
            f"beta = {beta:g}: must be positive, or the displacements would not "
            "depend on the new acceleration and could not meet the constraints"
        )


def at_infinity(integrator: Integrator) -> tuple[Array, Array]:
    """A step of h = 1 in which the constraints alone say where u is.

    Returns:
        (P, P + 1) the new past vectors and (P + 1,) v', from the old past and the new u.
    """
    relations = integrator.relations(1.0)
    unit = np.eye(len(relations.u_past))
    # A row for each field: its part from the past vectors, then from the new u.
    u = np.append(0 * unit[0], 1.0)
    a = np.append(-relations.u_past, 1.0) / relations.u_from_a
    v = relations.v_from_a * a + np.append(relations.v_past, 0.0)
    true = relations.acceleration[0] * a + np.append(relations.acceleration[1:], 0.0)
    increments = (u - np.append(unit[0] + unit[1], 0.0), v - np.append(unit[1], 0.0))
    return np.array([u, v, a, true, *increments])[relations.advance], true


def fading(integrator: Integrator) -> float:
    """What a step leaves of an error of a and λ: ρ∞, the spectral radius at infinite frequency."""
    known: float | None = getattr(integrator, "rho_infinity", None)
    return spectral_radius(integrator) if known is None else known


def spectral_radius(integrator: Integrator) -> float:
    """ρ∞ from the relations."""
    advanced, _ = at_infinity(integrator)
    return float(np.abs(np.linalg.eigvals(advanced[:, :-1])).max())


@dataclass(frozen=True)
class Newmark(Integrator):
    """Newmark's scheme (eqs. 12b, 12c); β = 1/4, γ = 1/2 is the trapezoidal rule.

    Under constraints an alternating error of a and λ grows by a factor in every step
    where β < γ/2; at β = γ/2, as in the trapezoidal rule, nothing damps it.

    Attributes:
        beta: β > 0; at β = 0 the displacements do not depend on the new
            acceleration and the constraint cannot be met.
        gamma: γ ≥ 1/2; below it the scheme feeds energy into every mode.

    Raises:
        IntegratorError: For other β, γ.
    """

    description: ClassVar[str] = (
        "Newmark's scheme; beta > 0 and gamma >= 1/2, "
        "by default 1/4 and 1/2, which is the trapezoidal rule"
    )
    beta: float = 0.25
    gamma: float = 0.5

    def __post_init__(self) -> None:
        _refuse_beta(self.beta)
        if not (np.isfinite(self.gamma) and self.gamma >= 0.5):
            raise IntegratorError(
                f"gamma = {self.gamma:g}: must be at least 0.5; below it the scheme amplifies "
                "every mode and is unstable at any step size"
            )

    @property
    def order(self) -> int:
        """Two for γ = 1/2, else one."""
        return 2 if self.gamma == 0.5 else 1

    @property
    def damped(self) -> bool:
        """Whether γ > 1/2 and β > γ/2."""
        return self.gamma > 0.5 and 2 * self.beta > self.gamma

    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients over the past (u_n, v_n, a_n) at step size h (s)."""
        beta, gamma = self.beta, self.gamma
        return Relations(
            v_from_a=gamma * h,
            u_from_a=beta * h**2,
            v_past=np.array([0.0, 1.0, (1 - gamma) * h]),
            u_past=np.array([1.0, h, (0.5 - beta) * h**2]),
            acceleration=np.array([1.0, 0.0, 0.0, 0.0]),
            advance=np.array([NEW_U, NEW_V, NEW_A]),
            start=np.eye(3),
        )


@dataclass(frozen=True)
class GeneralizedAlpha(_Alpha):
    """Generalized-α for constrained systems (Chung & Hulbert 1993; Arnold & Brüls 2007).

    Attributes:
        rho: ρ∞ in [0, 1], the spectral radius at infinite frequency; 1 is the
            trapezoidal rule, 0 damps an alternating error in one step.

    Raises:
        IntegratorError: For other ρ∞.
    """

    description: ClassVar[str] = (
        "generalized-α method, order 2; "
        "rho from 0, the strongest damping, to 1, the trapezoidal rule"
    )
    rho: float

    def __post_init__(self) -> None:
        _refuse_outside("rho", self.rho, 0, 1, "above 1 the scheme is unstable")

    @property
    def damped(self) -> bool:
        """Whether ρ∞ < 1."""
        return self.rho < 1

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """β, γ, α_m, α_f: optimal damping for this ρ∞."""
        alpha_m = (2 * self.rho - 1) / (self.rho + 1)
        alpha_f = self.rho / (self.rho + 1)
        gamma = 0.5 + alpha_f - alpha_m
        return (gamma + 0.5) ** 2 / 4, gamma, alpha_m, alpha_f


@dataclass(frozen=True)
class HHT(_Alpha):
    """The method of Hilber, Hughes and Taylor (1977): generalized-α with α_m = 0.

    Attributes:
        alpha: α_f in [0, 1/3]; 0 is the trapezoidal rule.

    Raises:
        IntegratorError: For other α.
    """

    description: ClassVar[str] = (
        "Hilber, Hughes and Taylor's method, order 2; "
        "alpha from 0, the trapezoidal rule, to 1/3, the strongest damping"
    )
    alpha: float

    def __post_init__(self) -> None:
        _refuse_outside(
            "alpha", self.alpha, 0, 1 / 3,
            "above 1/3 the damping does not grow any further; some texts write -alpha for it",
        )  # fmt: skip

    @property
    def damped(self) -> bool:
        """Whether α > 0."""
        return self.alpha > 0

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """β, γ, α_m, α_f."""
        return (1 + self.alpha) ** 2 / 4, 0.5 + self.alpha, 0.0, self.alpha


@dataclass(frozen=True)
class Alpha(_Alpha):
    """Any member of the family of Chung and Hulbert (1993), by its four coefficients.

    With α_f = 0 it is the method of Wood, Bossak and Zienkiewicz (1980), whose α_B is α_m:
    γ = ½ − α_B and β = (1 − α_B)²/4.

    Attributes:
        beta: β > 0.
        gamma: γ; another one than ½ − α_m + α_f gives order 1.
        alpha_m: α_m of inertial forces, at most ½.
        alpha_f: α_f of the other forces, at most ½.

    Raises:
        IntegratorError: For coefficients with which the method is unstable.
    """

    description: ClassVar[str] = (
        "any member of the generalized-α family, such as Wood, Bossak and Zienkiewicz's: alpha_m "
        "= -0.1, alpha_f = 0; order 2 if gamma = 1/2 - alpha_m + alpha_f"
    )
    beta: float
    gamma: float
    alpha_m: float
    alpha_f: float

    def __post_init__(self) -> None:
        for name, value in zip(("beta", "gamma", "alpha_m", "alpha_f"), self.parameters,
                               strict=True):  # fmt: skip
            if not np.isfinite(value):
                raise IntegratorError(f"{name} = {value:g}: must be finite")
        _refuse_beta(self.beta)
        if self.alpha_m > 0.5:
            raise IntegratorError(
                f"alpha_m = {self.alpha_m:g}: must be at most 0.5; above it the auxiliary "
                "acceleration grows by α_m/(α_m − 1) in every step, at any step size"
            )
        if not self.alpha_f < 1 or fading(self) > 1 + ROUNDED:
            name = "alpha_f" if self.alpha_f > 0.5 else "beta"
            grows = fading(self) if self.alpha_f < 1 else np.inf
            raise IntegratorError(
                f"{name} = {getattr(self, name):g}: multipliers would grow by a factor of "
                f"{grows:.5g} in every step; it takes α_f ≤ 1/2 and β ≥ γ/2"
            )

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """β, γ, α_m, α_f."""
        return self.beta, self.gamma, self.alpha_m, self.alpha_f

    @property
    def order(self) -> int:
        """Two for γ = ½ − α_m + α_f, else one."""
        return 2 if abs(self.gamma - self._of_order_2) < ROUNDED else 1

    @property
    def _of_order_2(self) -> float:
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def note(self) -> str:
        """That its order is 1, which γ has order 2, and what a smaller γ does."""
        if self.order == 2:
            return ""
        gains = " and feeds energy into motions" if self.gamma < self._of_order_2 else ""
        return (f"gamma = {self.gamma:g} is not 1/2 - alpha_m + alpha_f = {self._of_order_2:g}: "
                f"the method has order 1{gains}")  # fmt: skip

    @property
    def damped(self) -> bool:
        """Whether ρ∞ < 1."""
        return fading(self) < 1 - ROUNDED


@dataclass(frozen=True)
class BDF1(Integrator):
    """Implicit Euler: u = u_n + h v, v = v_n + h v', so that β = γ = 1."""

    description: ClassVar[str] = "implicit Euler method, order 1; no parameters"
    order: ClassVar[int] = 1
    damped: ClassVar[bool] = True

    def across(self, h: float, before: float) -> float:
        """What index 3 leaves of Gᵀv + Φ_t is in proportion to h."""
        return h

    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients over the past (u_n, v_n) at step size h (s)."""
        return Relations(
            v_from_a=h,
            u_from_a=h**2,
            v_past=np.array([0.0, 1.0]),
            u_past=np.array([1.0, h]),
            acceleration=np.array([1.0, 0.0, 0.0]),
            advance=np.array([NEW_U, NEW_V]),
            start=np.eye(3)[:2],
        )


@dataclass(frozen=True)
class BDF2(Integrator):
    """Two-step backward differences (Brenan, Campbell & Petzold 1996, Chapter 3).

    With h = ω h_n, b = (1 + ω)/(1 + 2ω) and c = ω²/(1 + 2ω), which are 2/3 and 1/3 where the
    step size is constant, u = u_n + c (u_n − u_n−1) + b h v.  With the increments of the last
    step, w_n and ν_n, in place of u and v of the step before, it and likewise v become

        V:  ν = b h v' + c ν_n,        K:  w = (b h)² v' + c w_n + c (b − 1/ω) h ν_n.

    The step before the first is a Taylor expansion backwards from the start.
    """

    description: ClassVar[str] = "two-step backward differences, order 2; no parameters"
    order: ClassVar[int] = 2
    damped: ClassVar[bool] = True

    def across(self, h: float, before: float) -> float:
        """What index 3 leaves of Gᵀv + Φ_t is in proportion to h times both sizes together."""
        return h * (h + before)

    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients over the past (u_n, v_n, w_n, ν_n) at step size h (s); β = b² and γ = b."""
        own = 1 + 2 * ratio
        of_last = ratio * ratio / own
        of_nu = h * (ratio * (ratio * ratio - ratio - 1)) / (own * own)
        return Relations(
            v_from_a=(1 + ratio) / own * h,
            u_from_a=(1 + ratio) * (1 + ratio) / (own * own) * h**2,
            v_past=np.array([0.0, 1.0, 0.0, of_last]),
            u_past=np.array([1.0, h, of_last, of_nu]),
            acceleration=np.array([1.0, 0.0, 0.0, 0.0, 0.0]),
            advance=np.array([NEW_U, NEW_V, NEW_W, NEW_NU]),
            start=np.array([[1, 0, 0], [0, 1, 0], [0, 0, h**2 / 2], [0, 0, h]]),
        )


#: Integrators by the name of their method; a class's fields are its parameters.
INTEGRATORS: Mapping[str, type[Newmark | GeneralizedAlpha | HHT | Alpha | BDF1 | BDF2]] = (
    MappingProxyType({
        "newmark": Newmark,
        "generalized-alpha": GeneralizedAlpha,
        "hht": HHT,
        "alpha": Alpha,
        "bdf1": BDF1,
        "bdf2": BDF2,
    })
)  # fmt: skip


def is_trapezoidal(integrator: Integrator) -> bool:
    """Whether an integrator is the trapezoidal rule, by whatever name."""
    rule, own = Newmark().relations(1.0), integrator.relations(1.0)
    places = len(rule.advance)
    further = (0, max(0, len(own.advance) - places))
    return bool(
        np.array_equal(own.advance[:places], rule.advance)
        and np.array_equal(own.v_past, np.pad(rule.v_past, further))
        and np.array_equal(own.u_past, np.pad(rule.u_past, further))
        and (own.v_from_a, own.u_from_a) == (rule.v_from_a, rule.u_from_a)
        # With a = v' at the start it is so ever after.
        and (own.acceleration[0], own.acceleration[1:].sum()) == (1.0, 0.0)
    )


def parameters(method: str) -> tuple[str, ...]:
    """Names of a method's parameters."""
    return tuple(field.name for field in fields(INTEGRATORS[method]))
