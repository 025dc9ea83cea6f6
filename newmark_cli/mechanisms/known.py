"""Solutions of shipped problems that are known without integrating anything."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from scipy.special import ellipj

from newmark_cli.mechanisms import registry
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.multipliers import weights
from newmark_cli.problems.reference import Reference
from newmark_cli.support.arrays import Array

_EPS = float(np.finfo(float).eps)


def _pendulum(t: float) -> Reference:
    """Release from the horizontal, by Jacobi's functions of modulus √½.

    The angle θ from the downward vertical has sin(θ/2) = √½ cd t, hence θ' = −sd t,
    x = cn t / dn² t and y = −½ sd² t.  Along the exact motion λ = 3y.
    """
    sn, cn, _, _ = ellipj(t, 0.5)
    # SciPy's dn loses two digits around t = K.
    dn = np.sqrt(1 - sn**2 / 2)
    rate = -sn / dn
    u = np.array([cn / dn**2, -(rate**2) / 2])
    v = rate * np.array([-u[1], u[0]])
    multipliers = 3 * u[1:]
    # The functions are good to a few units, and as if their argument were so, too.
    shift = 2 * t * max(1.0, 1 / (abs(float(rate)) or np.inf))
    return Reference(
        t=t,
        u=u,
        v=v,
        multipliers=multipliers,
        scales=np.abs(multipliers),
        source="exact",
        u_error=(8 + 2 * t) * _EPS,
        v_error=(8 + shift) * _EPS,
        multipliers_error=(8 + 2 * shift) * _EPS,
    )


#: Time of the published table of Andrews' mechanism (s), and the angles beta, Theta,
#: delta, epsilon with their rates there.  Source: Mazzia and Magherini, Test Set for
#: Initial Value Problem Solvers, "Andrews' squeezing mechanism", reference solution.
_ANDREWS_TIME = 0.03
_ANDREWS_ANGLES = (
    (15.81077119629904, 1139.920302151208),
    (-15.75637105984298, -1424.379294994111),
    (0.5244099658805304, 0.5735699284790808),
    (1.048080741042263, 0.3231791658026955),
)


def _andrews(t: float) -> Reference | None:
    """The published table at t = 0.03; nothing at other times.

    Its errors are those found against a solution with 64 bits of mantissa: 8e-12 m,
    1.1e-8 m/s, and 2.6e-10 in λ.
    """
    if not math.isclose(t, _ANDREWS_TIME, rel_tol=1e-12):
        return None
    beta, theta, delta, epsilon = (np.array(pair) for pair in _ANDREWS_ANGLES)
    crank = _turned(0.007, 0.0, beta)
    points = np.array(
        [
            crank + _turned(-0.028, 0.0, beta + theta),  # E
            crank,  # F
            _turned(0.04, 0.0, delta),  # G, from A
            _turned(0.0, -0.04, epsilon),  # H, from A
        ]
    )
    points[2:, 0] += (-0.06934, -0.00227)
    u, v = points[:, 0].ravel(), points[:, 1].ravel()
    problem = registry.problem("andrews")
    _, multipliers = Index1(problem).accelerations(t, u, v)
    return Reference(
        t=t,
        u=u,
        v=v,
        multipliers=multipliers,
        scales=weights(problem, t, u).scales(multipliers),
        source="published",
        u_error=2.5e-10,
        v_error=1.5e-9,
        multipliers_error=3e-10,
    )


def _turned(along: float, across: float, angle: Array) -> Array:
    """(2, 2) a vector turned by an angle, and its rate; ``angle`` is the angle and its rate."""
    cosine, sine = np.cos(angle[0]), np.sin(angle[0])
    vector = np.array([along * cosine - across * sine, along * sine + across * cosine])
    return np.array([vector, angle[1] * np.array([-vector[1], vector[0]])])


#: Solutions by name of a shipped problem: time since its start (s) → the solution, or
#: None at times where it is not known.
KNOWN: Mapping[str, Callable[[float], Reference | None]] = MappingProxyType(
    {"andrews": _andrews, "pendulum": _pendulum}
)
