"""The level of rounding in Newton's corrections, from the rounding of each term.

A rounded operation has a relative error of rms 0.21 eps.  The terms of each row of the
residual at a state of the 33-digit run are taken as independent; their variances go
through (J⁻¹)², component by component.  No constant is fitted: measured values should lie
within a factor of three or so, and have the same slopes, where a step is rounding only.
"""

from collections.abc import Mapping

import conditions
import numpy as np

Array = np.ndarray
UNIT = 0.21 * float(np.finfo(float).eps)


def residual(
    form: str, integrator: str, h: float, compensated: bool, state: Mapping[str, Array]
) -> dict[str, Array]:
    """Standard deviations of the residual's rows, unscaled.

    Args:
        form: The form.
        integrator: As the CSV names it.
        h: Step size (s).
        compensated: Whether the residual is evaluated in increments.
        state: M, X, Y, G, and u, v, a, λ.
    """
    M, X, Y, G = (np.abs(state[name]) for name in "MXYG")
    u, v, a, force = (np.abs(state[name]) for name in ("u", "v", "a", "lambda"))
    beta, gamma, c = conditions.symbols(integrator)
    kept, _ = conditions.FORMS[form]
    gt, bt = gamma * h, beta * h * h
    if compensated:
        u_size, v_size, phi_size = h * h / 2 * a, h * a, G.T @ (h * v)
    else:
        u_size, v_size, phi_size = u, v, G.T @ u
    highest = kept[-1]
    inertia = c * {"u": u_size / bt, "v": v_size / gt, "a": a}[highest]
    # M q twice, in the new fields and in the history; forces by their stiffness and damping.
    D = 2 * (M @ inertia) ** 2 + (X @ u) ** 2 + (Y @ v) ** 2 + (G @ force) ** 2 + (M @ a) ** 2
    K = 2 * u_size**2 + (h * v) ** 2 * (0 if compensated else 1) + (bt * a) ** 2
    V = 2 * v_size**2 + (gt * a) ** 2
    C = 2 * phi_size**2
    return {name: UNIT * np.sqrt(x) for name, x in (("D", D), ("K", K), ("V", V), ("C", C))}


def corrections(
    form: str, integrator: str, h: float, compensated: bool, state: Mapping[str, Array]
) -> dict[str, float]:
    """Norms of the corrections of u, v, a, λ in physical units."""
    matrices = [state[name] for name in "MXYG"]
    _, inverted, rows, columns = conditions.inverse(form, integrator, h, *matrices)
    kept, names = conditions.FORMS[form]
    noise = residual(form, integrator, h, compensated, state)
    variance = {}
    for place, name in zip(columns, [*kept, "lambda"], strict=True):
        variance[name] = sum(
            float(np.sum(inverted[place, rows[k]] ** 2 @ noise[row] ** 2))
            for k, row in enumerate(names)
        )
    found = {name: float(np.sqrt(x)) for name, x in variance.items()}
    beta, gamma, _ = conditions.symbols(integrator)
    gt, bt = gamma * h, beta * h * h
    # Eliminated fields follow the kept one with the largest weight.
    order = {"u": 1.0, "v": gt / bt, "a": 1 / bt}
    for name in "uva":
        if name not in kept:
            sources = {"uv": "v", "ua": "a" if name == "v" else "u", "va": "a"}.get(kept, kept)
            found[name] = found[sources[-1]] * order[name] / order[sources[-1]]
    return found
