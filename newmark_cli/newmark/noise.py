"""Noise of λ along a march: rounding of the positions, as the update relations carry it on.

At every step the positions are machine numbers, off by their rounding δ, and the constraints
are met no better than that: Gᵀ δ.  The accelerations that follow from such positions through V
and K, and with them λ, are off by ∂v'/∂u δ in the step itself, and what stays in the past
vectors adds to the next steps.  With numerical dissipation it dies out, and the sum has a
variance that the relations alone give; without, it grows for ever.
"""

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from newmark_cli.arrays import Array
from newmark_cli.newmark.balance import Inverted
from newmark_cli.newmark.integrator import Integrator

#: Rms relative error of a rounding, in units of eps, for mantissas spread log-uniformly.
ROUNDING = 0.212


def carried(integrator: Integrator) -> float:
    """Rms of v' when positions have independent errors, over that of a single error's v'.

    It does not depend on h; infinite without numerical dissipation.
    """
    relations = integrator.relations(1.0)
    unit = np.eye(len(relations.u_past))
    # A row for each field: its part from the past vectors, then from the new u.
    u = np.append(0 * unit[0], 1.0)
    a = np.append(-relations.u_past, 1.0) / relations.u_from_a
    v = relations.v_from_a * a + np.append(relations.v_past, 0.0)
    true = relations.acceleration[0] * a + np.append(relations.acceleration[1:], 0.0)
    increments = (u - np.append(unit[0] + unit[1], 0.0), v - np.append(unit[1], 0.0))
    advanced = np.array([u, v, a, true, *increments])[relations.advance]
    passing, entering = advanced[:, :-1], advanced[:, -1]
    if not (integrator.damped and np.max(np.abs(np.linalg.eigvals(passing))) < 1):
        return np.inf
    variance = solve_discrete_lyapunov(passing, np.outer(entering, entering))
    past, now = true[:-1], true[-1]
    return float(np.sqrt(past @ variance @ past + now**2) / abs(now))


def multiplier_noise(jacobian: Array, gradient: Array, moved: Array, eps: float) -> float:
    """Rms of the change of ‖λ‖ that the rounding of positions in one step makes.

    Args:
        jacobian: (n + m, n + m) J of the (u, λ) form, index 3.
        gradient: (n, m) G.
        moved: (n,) what is rounded: u, or in compensated evaluation its change in a step.
        eps: Rounding unit of the arithmetic, as `numpy.finfo` has it.

    Raises:
        numpy.linalg.LinAlgError: When J is singular.
    """
    n, m = gradient.shape
    reaction = Inverted(jacobian, [n, m]).inverse()[n:, n:]
    return float(np.linalg.norm(reaction @ gradient.T * (ROUNDING * eps * moved)))
