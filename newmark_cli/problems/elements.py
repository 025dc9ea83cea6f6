"""Element loop of the planar mechanism, compiled once for every mechanism.

An element acts on one vector in the plane, the difference of two sites,

    Δ = Δ0 + Σ_k (a_k + b_k R) P_k,        k = 1..K, K ≤ 4,

with P_k the moving points it depends on, R the quarter turn to the left, and
Δ0 what the fixed points contribute.  A plain point has (a, b) = (1, 0); a
body-fixed point is a rotated and stretched combination of the two points that
carry its body.  Writing C_k = a_k + b_k R, a force F conjugate to Δ loads the
points with C_kᵀ F, and its tangent T = ∂F/∂Δ enters as C_kᵀ T C_l.

Tables, one row per element:

=========  ==================================================================
``ints``   kind, K, first coordinate of each P_k (4 columns), constraint row,
           first entry in the X values, first entry in the G values
``reals``  a_1, b_1, …, a_4, b_4, Δ0 (2 columns), two parameters
=========  ==================================================================

A link is a bar between plain points, by far the commonest element: its blocks
C_kᵀ C_l are multiples of the identity, of which only the diagonal is kept.

The parameters are (L², –) of a bar or link, (stiffness, rest length) of a spring,
(torque, –) of a torque and the components of a load.
"""

import numpy as np
from numba import njit

LINK, BAR, SPRING, TORQUE, LOAD = range(5)

#: Columns of the integer and the real table.
KIND, COUNT, DOF, ROW, X_START, G_START, INT_COLUMNS = 0, 1, 2, 6, 7, 8, 9
OFFSET, PARAMETER, REAL_COLUMNS = 8, 10, 12


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """Force f + Gλ, constraints Φ, and the values of X, Y, G of a mechanism.

    Args:
        t: Time (s); the elements so far do not depend on it.
        u, v: (n,) coordinates (m) and velocities (m/s) of the moving points.
        multipliers: (m,) λ.
        ints, reals: Element tables, see the module.
        force: (n,) overwritten with f(u, v, t) + G(u, t) λ.
        phi: (m,) overwritten with Φ(u, t).
        x_values: Overwritten with the entries of X = −∂(f + Gλ)/∂u.
        y_values: Entries of Y = −∂f/∂v; no element depends on v yet.
        g_values: Overwritten with the entries of G = Φ_uᵀ.
    """
    force[:] = 0
    for e in range(ints.shape[0]):
        kind, count = ints[e, KIND], ints[e, COUNT]
        if kind == LOAD:
            i = ints[e, DOF]
            force[i] += reals[e, PARAMETER]
            force[i + 1] += reals[e, PARAMETER + 1]
            continue

        dx, dy = reals[e, OFFSET], reals[e, OFFSET + 1]
        if kind == LINK:
            row, x, g = ints[e, ROW], ints[e, X_START], ints[e, G_START]
            multiplier = multipliers[row]
            for k in range(count):
                i, a = ints[e, DOF + k], reals[e, 2 * k]
                dx += a * u[i]
                dy += a * u[i + 1]
            phi[row] = (dx * dx + dy * dy - reals[e, PARAMETER]) / 2
            for k in range(count):
                i, a = ints[e, DOF + k], reals[e, 2 * k]
                g_values[g + 2 * k] = a * dx
                g_values[g + 2 * k + 1] = a * dy
                force[i] += multiplier * a * dx
                force[i + 1] += multiplier * a * dy
                for j in range(count):
                    tangent = -multiplier * a * reals[e, 2 * j]
                    x_values[x] = tangent
                    x_values[x + 1] = tangent
                    x += 2
            continue

        for k in range(count):
            i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
            dx += a * u[i] - b * u[i + 1]
            dy += b * u[i] + a * u[i + 1]

        # (fx, fy) is conjugate to Δ; T = ∂(fx, fy)/∂Δ.
        square = dx * dx + dy * dy
        if kind == BAR:
            row = ints[e, ROW]
            multiplier = multipliers[row]
            phi[row] = (square - reals[e, PARAMETER]) / 2
            fx, fy = multiplier * dx, multiplier * dy
            txx, txy, tyx, tyy = multiplier, 0 * multiplier, 0 * multiplier, multiplier
            for k in range(count):
                g, a, b = ints[e, G_START] + 2 * k, reals[e, 2 * k], reals[e, 2 * k + 1]
                g_values[g] = a * dx + b * dy
                g_values[g + 1] = a * dy - b * dx
        elif kind == SPRING:
            length = np.sqrt(square)
            tension_over_length = reals[e, PARAMETER] * (1 - reals[e, PARAMETER + 1] / length)
            fx, fy = -tension_over_length * dx, -tension_over_length * dy
            rank_one = reals[e, PARAMETER] * reals[e, PARAMETER + 1] / (length * square)
            txx = -tension_over_length - rank_one * dx * dx
            txy = -rank_one * dx * dy
            tyx = txy
            tyy = -tension_over_length - rank_one * dy * dy
        else:  # TORQUE: the virtual work of τ through the angle of Δ
            torque = reals[e, PARAMETER] / square
            fx, fy = -torque * dy, torque * dx
            txx = 2 * torque * dx * dy / square
            txy = torque * (dy * dy - dx * dx) / square
            tyx = txy
            tyy = -txx

        x = ints[e, X_START]
        for k in range(count):
            i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
            force[i] += a * fx + b * fy
            force[i + 1] += a * fy - b * fx
            # Rows of C_kᵀ T
            sxx, sxy = a * txx + b * tyx, a * txy + b * tyy
            syx, syy = a * tyx - b * txx, a * tyy - b * txy
            for j in range(count):
                a, b = reals[e, 2 * j], reals[e, 2 * j + 1]
                x_values[x] = -(sxx * a + sxy * b)
                x_values[x + 1] = -(sxy * a - sxx * b)
                x_values[x + 2] = -(syx * a + syy * b)
                x_values[x + 3] = -(syy * a - syx * b)
                x += 4


@njit(cache=True, nogil=True, error_model="numpy")
def constraint_curvature(t, u, v, ints, reals, curvature):
    """Second time derivative of Φ along u'' = 0, needed for consistent accelerations.

    Args:
        t: Time (s).
        u, v: (n,) coordinates (m) and velocities (m/s).
        ints, reals: Element tables, see the module.
        curvature: (m,) overwritten; Φ'' = Gᵀ u'' + curvature.
    """
    for e in range(ints.shape[0]):
        if ints[e, KIND] != BAR and ints[e, KIND] != LINK:
            continue
        wx, wy = 0 * reals[e, OFFSET], 0 * reals[e, OFFSET]
        for k in range(ints[e, COUNT]):
            i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
            wx += a * v[i] - b * v[i + 1]
            wy += b * v[i] + a * v[i + 1]
        curvature[ints[e, ROW]] = wx * wx + wy * wy
