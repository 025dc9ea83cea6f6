"""Integrators of the Newmark family as two update relations.

A one-step scheme of the family ties the new fields by

    V:  v = γ̃ a + (past),        γ̃ = γ h
    K:  u = β̃ a + (past),        β̃ = β h²

and puts into row D the acceleration v' = c a + (past), c = 1 for Newmark.  The
past is a short list of vectors that every step renews.  Nothing else in the
core knows an integrator: another of the family is another set of coefficients
(`Relations`) and other sensitivities.
"""

from dataclasses import dataclass

import numpy as np

from newmark_cli.arrays import Array, IndexArray
from newmark_cli.errors import InputError

FIELDS = ("u", "v", "a")


class IntegratorError(InputError):
    """The parameters do not give a usable integrator; says which and why."""


@dataclass(frozen=True)
class Relations:
    """Update relations at one step size; P past vectors.

    Attributes:
        v_from_a: ∂v/∂a through V (s); γh.
        u_from_a: ∂u/∂a through K (s²); βh².
        v_past: (P,) past part of V.
        u_past: (P,) past part of K.
        u_predicted: (P,) coefficients of the predictor u_n + h v_n.
        acceleration: (1 + P,) v' in row D from the new a and the past.
        advance: (P,) what each past vector becomes: 0..3 is the new u, v, a, v',
            4 + i the old past vector i.
        own_past: past vector that holds the old u, v, a, each; what a kept
            field is differenced against when its rates are formed.
    """

    v_from_a: float
    u_from_a: float
    v_past: Array
    u_past: Array
    u_predicted: Array
    acceleration: Array
    advance: IndexArray
    own_past: tuple[int, int, int] = (0, 1, 2)


@dataclass(frozen=True)
class Newmark:
    """Newmark's scheme (eqs. 12b, 12c); β = 1/4, γ = 1/2 is the trapezoidal rule.

    Attributes:
        beta: β > 0; at β = 0 the displacements do not depend on the new
            acceleration and the constraint cannot be met.
        gamma: γ ≥ 1/2; below it the scheme feeds energy into every mode.

    Raises:
        IntegratorError: For other β, γ.
    """

    beta: float = 0.25
    gamma: float = 0.5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.beta) and self.beta > 0):
            raise IntegratorError(
                f"beta = {self.beta:g}: must be positive, or the displacements would not "
                "depend on the new acceleration and could not meet the constraints"
            )
        if not (np.isfinite(self.gamma) and self.gamma >= 0.5):
            raise IntegratorError(
                f"gamma = {self.gamma:g}: must be at least 0.5; below it the scheme amplifies "
                "every mode and is unstable at any step size"
            )

    @property
    def label(self) -> str:
        """How the CSV names the integrator."""
        return f"newmark beta={self.beta:.17g} gamma={self.gamma:.17g}"

    def symbols(self, h: float) -> dict[str, float]:
        """Numbers of the symbols that a scaling may use."""
        return {"beta": self.beta, "gamma": self.gamma, "h": h}

    def relations(self, h: float) -> Relations:
        """Coefficients over the past (u_n, v_n, a_n) at step size h (s)."""
        beta, gamma = self.beta, self.gamma
        return Relations(
            v_from_a=gamma * h,
            u_from_a=beta * h**2,
            v_past=np.array([0.0, 1.0, (1 - gamma) * h]),
            u_past=np.array([1.0, h, (0.5 - beta) * h**2]),
            u_predicted=np.array([1.0, h, 0.0]),
            acceleration=np.array([1.0, 0.0, 0.0, 0.0]),
            advance=np.array([0, 1, 2]),
        )
