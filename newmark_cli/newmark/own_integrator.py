"""Integrators of a user's own: any object with update relations, as numbers.

All of a relation's coefficients have the dimension of a power of h, so that those at h = 1 are
those at every h.  The object is asked once, and what marches is a frozen value like any other.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from newmark_cli.newmark.integrator import (
    NEW_A,
    NEW_NU,
    NEW_U,
    NEW_V,
    NEW_W,
    ROUNDED,
    TRUE_ACCELERATION,
    Integrator,
    IntegratorError,
    Relations,
    spectral_radius,
)

#: What a past vector may become, by name.
ADVANCES = {"u": NEW_U, "v": NEW_V, "a": NEW_A, "rate": TRUE_ACCELERATION, "w": NEW_W, "nu": NEW_NU}
#: Power of h in the dimension of each, a coordinate having 0.
_POWERS = {NEW_U: 0, NEW_V: 1, NEW_A: 2, TRUE_ACCELERATION: 2, NEW_W: 0, NEW_NU: 1}
#: Name of a class in a file.
NAMED = re.compile(r".+\.py:[A-Za-z_]\w*")
#: Steps of the two quadratures that tell an order, and the highest order that they can tell.
_STEPS, _HIGHEST = (80, 160), 4
#: How far coefficients may be from those of h = 1.
_SAME = 1e-9


@dataclass(frozen=True)
class OwnIntegrator(Integrator):
    """An integrator of a user's own; its `label` tells it from others.

    Attributes:
        name: What it is called, such as ``mine.py:Bossak``.
        power: Order of u and v.
        rho_infinity: ρ∞, what a step leaves of an alternation of a and λ.
        beta, gamma: ∂u/∂v' h⁻² and ∂v/∂v' h⁻¹, which scalings use.
        digest: Of its coefficients.
        unit: Its relations at h = 1; None of one that is known from results only.
        stated: Order that its class states; 0 where it states none.
    """

    name: str
    power: int
    rho_infinity: float
    beta: float
    gamma: float
    digest: str
    unit: Relations | None = field(default=None, compare=False, repr=False)
    stated: int = field(default=0, compare=False, repr=False)

    @property
    def label(self) -> str:
        """How the CSV names it; `read` reads it back."""
        return (
            f"{self.name} order={self.order} rho={self.rho_infinity!r} beta={self.beta!r} "
            f"gamma={self.gamma!r} digest={self.digest}"
        )

    @property
    def order(self) -> int:
        """Order of u and v, as a quadrature shows it."""
        return self.power

    @property
    def note(self) -> str:
        """That its class states another order."""
        if self.stated in (0, self.power):
            return ""
        return f"order = {self.stated} is stated, and its relations have order {self.power}"

    @property
    def damped(self) -> bool:
        """Whether ρ∞ < 1."""
        return self.rho_infinity < 1 - ROUNDED

    def symbols(self, h: float, ratio: float = 1.0) -> dict[str, float]:
        """β and γ, of ∂u/∂v' = β h² and ∂v/∂v' = γ h."""
        return {"beta": self.beta, "gamma": self.gamma, "h": h}

    def relations(self, h: float, ratio: float = 1.0) -> Relations:
        """Coefficients at step size h (s).

        Raises:
            IntegratorError: If the step size of several-step relations changes, or nothing but
                results is known of it.
        """
        if self.unit is None:
            raise IntegratorError(f"{self.name}: is code, which runs only with --allow-code")
        if ratio != 1 and not {NEW_W, NEW_NU}.isdisjoint(self.unit.advance.tolist()):
            raise IntegratorError(
                f"{self.name}: takes steps of one size, as w and nu are increments of the last"
            )
        return _scaled(self.unit, h)


def _scaled(unit: Relations, h: float) -> Relations:
    """Relations at a step size from those at h = 1."""
    powers = h ** np.array([_POWERS[int(what)] for what in unit.advance], float)
    return Relations(
        unit.v_from_a * h,
        unit.u_from_a * h**2,
        unit.v_past * powers / h,
        unit.u_past * powers,
        unit.acceleration * np.append(1.0, powers / h**2),
        unit.advance,
        unit.start * h ** np.array([0.0, 1.0, 2.0]) / powers[:, None],
    )


def of(name: str, given: Any) -> OwnIntegrator:
    """The integrator that an object is.

    Args:
        name: What it is called.
        given: A class or object with ``relations(h)``, which returns `Relations` or a mapping
            of its fields; ``advance`` may have the names of `ADVANCES`.

    Raises:
        IntegratorError: If it has no relations, or they give no integrator: which, and why.
    """
    given = given() if isinstance(given, type) else given
    if not callable(getattr(given, "relations", None)):
        raise IntegratorError(f"{name}: has no method relations(h)")
    unit = _relations(name, given.relations(1.0))
    for h in (0.5, 1e-3):
        _refuse_others(name, h, _relations(name, given.relations(h)), _scaled(unit, h))
    share = float(unit.acceleration[0])
    if not (unit.u_from_a > 0 and share > 0):
        raise IntegratorError(
            f"{name}: u_from_a = {unit.u_from_a:g} and acceleration[0] = {share:g} must be "
            "positive, or displacements could not meet the constraints"
        )
    order = _order(unit)
    if order < 1:
        raise IntegratorError(f"{name}: does not converge: its relations do not integrate v' to v "
                              "and v to u")  # fmt: skip
    text = " ".join(repr(np.asarray(getattr(unit, part.name)).tolist()) for part in fields(unit))
    own = OwnIntegrator(
        name, order, 0.0, unit.u_from_a / share, unit.v_from_a / share,
        hashlib.sha256(text.encode()).hexdigest()[:12], unit,
    )  # fmt: skip
    rho = spectral_radius(own)
    if not rho <= 1 + ROUNDED:
        raise IntegratorError(
            f"{name}: multipliers would grow by a factor of {rho:.5g} in every step"
        )
    stated = getattr(given, "order", 0)
    # Last digits of eigenvalues differ between machines, and labels must not.
    return replace(own, rho_infinity=round(rho, 9), stated=stated if isinstance(stated, int) else 0)


def _relations(name: str, given: Any) -> Relations:
    """Relations as the core has them, from what a user's method returns."""
    wanted = [part.name for part in fields(Relations)]
    values = given if isinstance(given, Mapping) else getattr(given, "__dict__", {})
    if missing := [key for key in wanted if key not in values]:
        raise IntegratorError(f"{name}: relations lack {', '.join(missing)}")
    try:
        advance = np.array([ADVANCES.get(what, what) for what in values["advance"]], np.int64)
        arrays = {key: np.asarray(values[key], float) for key in wanted if key != "advance"}
    except (TypeError, ValueError) as error:
        raise IntegratorError(f"{name}: relations: {error}") from None
    places = len(advance)
    shapes = {"v_past": (places,), "u_past": (places,), "acceleration": (1 + places,),
              "start": (places, 3), "v_from_a": (), "u_from_a": ()}  # fmt: skip
    for key, shape in shapes.items():
        if arrays[key].shape != shape:
            raise IntegratorError(
                f"{name}: {key} has shape {arrays[key].shape}, must have {shape}, as advance names "
                f"{places} past vectors"
            )
        if not np.isfinite(arrays[key]).all():
            raise IntegratorError(f"{name}: {key} = {arrays[key].tolist()}: must be finite")
    if tuple(advance[:2]) != (NEW_U, NEW_V) or not set(advance.tolist()) <= _POWERS.keys():
        raise IntegratorError(f"{name}: advance must begin with u and v, and name {[*ADVANCES]}")
    return Relations(
        float(arrays["v_from_a"]), float(arrays["u_from_a"]), arrays["v_past"], arrays["u_past"],
        arrays["acceleration"], advance, arrays["start"],
    )  # fmt: skip


def _refuse_others(name: str, h: float, given: Relations, wanted: Relations) -> None:
    for part in fields(wanted):
        one, other = (np.asarray(getattr(x, part.name), float) for x in (given, wanted))
        if not np.allclose(one, other, rtol=_SAME, atol=0):
            raise IntegratorError(
                f"{name}: {part.name} at h = {h:g} is not that of h = 1 times a power of h, which "
                "the dimension of a coefficient is"
            )


def _order(unit: Relations) -> int:
    """Order with which relations integrate a given v' = −sin t, from how errors fall with h."""
    errors = []
    for steps in _STEPS:
        h = 2.0 / steps
        relations = _scaled(unit, h)
        past = relations.start @ np.array([0.0, 1.0, 0.0])
        for k in range(1, steps + 1):
            true = -np.sin(k * h)
            a = (true - relations.acceleration[1:] @ past) / relations.acceleration[0]
            v = relations.v_from_a * a + relations.v_past @ past
            u = relations.u_from_a * a + relations.u_past @ past
            increments = u - past[0] - h * past[1], v - past[1]
            past = np.array([u, v, a, true, *increments])[relations.advance]
        off = np.abs([u - np.sin(2.0), v - np.cos(2.0)]).max()
        errors.append(off if np.isfinite(off) else np.inf)
    if not errors[0] < 0.5 or errors[1] == 0:
        return 0
    return min(round(float(np.log2(errors[0] / errors[1]))), _HIGHEST)


def read(label: str) -> OwnIntegrator:
    """What a label says of an integrator; it cannot march.

    Raises:
        IntegratorError: If it is no label of one.
    """
    name, *parts = label.split(" ")
    values = dict(part.partition("=")[::2] for part in parts)
    try:
        rho, beta, gamma = (float(values[key]) for key in ("rho", "beta", "gamma"))
        return OwnIntegrator(name, int(values["order"]), rho, beta, gamma, values["digest"])
    except (KeyError, ValueError):
        raise IntegratorError(
            f"integrator {label!r}: is no label of an integrator of your own"
        ) from None
