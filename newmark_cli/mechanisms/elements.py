"""Element loop of the planar mechanism, compiled once for every mechanism.

`evaluate` is the loop over the kinds that most mechanisms are made of; `evaluate_all` also
goes over those from FORCE on.

An element acts on one vector in the plane, the difference of two sites,

    Δ = Δ0 + Σ_k (a_k + b_k R) P_k,        k = 1..K, K ≤ 4,

with P_k the moving points it depends on, R the quarter turn to the left, and
Δ0 what the fixed points contribute.  A plain point has (a, b) = (1, 0); a
body-fixed point is a rotated and stretched combination of the two points that
carry its body.  Writing C_k = a_k + b_k R, a force F conjugate to Δ loads the
points with C_kᵀ F, and its tangents ∂F/∂Δ, ∂F/∂Δ' enter as C_kᵀ (…) C_l.

Tables, one row per element:

=========  ==================================================================
``ints``   kind, K, first coordinate of each P_k (4 columns), constraint row,
           first entry in the X values, in the Y values, in the G values
``reals``  a_1, b_1, …, a_4, b_4, Δ0 (2 columns), eight parameters
=========  ==================================================================

A link is a bar between plain points, by far the commonest element: its blocks
C_kᵀ C_l are multiples of the identity, of which only the diagonal is kept.

========  ===================================================================
kind      parameters
========  ===================================================================
LINK      L²;  Φ = (|Δ|² − L²)/2
BAR       L²;  the same for body-fixed points
LINE      n_x, n_y, law;  Φ = n·Δ − law(t): a slider, a driven coordinate
ANGLE     –, –, law;  Φ = n·Δ, n = (−sin, cos) of law(t): a driven angle
SPRING    stiffness, rest length
DAMPER    damping of the rate of |Δ|
TORQUE    torque through the angle of Δ
LOAD      force, two components, on one point
FORCE     n_x, n_y, law;  the force n law(t) on a site
COUPLE    –;  Φ = n(θ)·Δ, n = (−sin θ, cos θ): the angle θ of Δ as a coordinate
PAIR      D0 (2 columns), law;  Φ = D × Δ + Σ_j w_j θ_j − law(t), see below
TWIST     angle of rest, stiffness, damping of q = Σ_j w_j θ_j
========  ===================================================================

A pair acts on two vectors, D = D0 + Σ_k (c_k + d_k R) P_k over the same points, and on up to
four angles.  Its second row, of kind `MORE`, has c_k and d_k where the first has a_k and
b_k, the coordinates θ_j in place of those of P_k, J in place of K, and w_j as parameters.
So has `TWIST` its angles and w_j in place of points and a_k, b_k, …; the coordinate θ of
`COUPLE` stands in the Y column.

Rows of laws of time may stand behind all elements, see `timed`.  The functions ``…_timed`` put
values of laws into a copy of the table, and call the others.
"""

import numpy as np

from newmark_cli.mechanisms import timed
from newmark_cli.support.cached_code import cached_njit

sine_cosine, at_time, _law_of = timed.sine_cosine, timed.at_time, timed.law
#: A function that becomes a part of its caller: handing on arrays costs time in each call.
_inline = cached_njit(nogil=True, error_model="numpy", inline="always")

(
    LINK, BAR, LINE, ANGLE, SPRING, DAMPER, TORQUE, LOAD, FORCE, COUPLE, PAIR, TWIST, MORE,
) = range(13)  # fmt: skip

#: Kinds that are a constraint, one row each.
CONSTRAINTS = (LINK, BAR, LINE, ANGLE, COUPLE, PAIR)

#: Columns of the integer and the real table.
KIND, COUNT, DOF, ROW, X_START, Y_START, G_START, INT_COLUMNS = 0, 1, 2, 6, 7, 8, 9, 10
OFFSET, PARAMETER, LAW, REAL_COLUMNS = 8, 10, 12, 18


@cached_njit(nogil=True, error_model="numpy")
def _law(t, reals, e, derivative):
    """The law of an element, or a derivative of it."""
    return _law_of(t, reals, e, LAW, derivative)


@cached_njit(nogil=True, error_model="numpy")
def _vector(u, ints, reals, e, weights):
    """Σ (a_k + b_k R) P_k of element e, its weights in another row or its own."""
    x, y = u.dtype.type(0), u.dtype.type(0)
    for k in range(ints[e, COUNT]):
        i, a, b = ints[e, DOF + k], reals[weights, 2 * k], reals[weights, 2 * k + 1]
        x += a * u[i] - b * u[i + 1]
        y += b * u[i] + a * u[i + 1]
    return x, y


@cached_njit(nogil=True, error_model="numpy")
def _evaluate_further(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """What `evaluate` leaves out, for `evaluate_all`: elements that few mechanisms have."""
    for e in range(ints.shape[0]):
        if ints[e, KIND] < FORCE:
            continue
        kind, count = ints[e, KIND], ints[e, COUNT]
        row, x, g = ints[e, ROW], ints[e, X_START], ints[e, G_START]
        if kind == FORCE:
            law = _law(t, reals, e, 0)
            fx, fy = reals[e, PARAMETER] * law, reals[e, PARAMETER + 1] * law
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                force[i] += a * fx + b * fy
                force[i + 1] += a * fy - b * fx
        elif kind == COUPLE:
            dx, dy = _vector(u, ints, reals, e, e)
            dx, dy = dx + reals[e, OFFSET], dy + reals[e, OFFSET + 1]
            j, multiplier = ints[e, Y_START], multipliers[row]
            sine, cosine = sine_cosine(u[j], u.dtype.type)
            along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
            phi[row] = across
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                gx, gy = b * cosine - a * sine, a * cosine + b * sine
                g_values[g] = gx
                g_values[g + 1] = gy
                force[i] += multiplier * gx
                force[i + 1] += multiplier * gy
                # λ C_kᵀ (cos θ, sin θ), in row and column of θ.
                x_values[x] = x_values[x + 1] = multiplier * gy
                x_values[x + 2] = x_values[x + 3] = -multiplier * gx
                x += 4
                g += 2
            g_values[g] = -along
            force[j] -= multiplier * along
            x_values[x] = multiplier * across
        elif kind == PAIR:
            multiplier = multipliers[row]
            ex, ey = _vector(u, ints, reals, e, e)
            ex, ey = ex + reals[e, OFFSET], ey + reals[e, OFFSET + 1]
            dx, dy = _vector(u, ints, reals, e, e + 1)
            dx, dy = dx + reals[e, PARAMETER], dy + reals[e, PARAMETER + 1]
            phi[row] = dx * ey - dy * ex - _law(t, reals, e, 0)
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                c, d = reals[e + 1, 2 * k], reals[e + 1, 2 * k + 1]
                gx = b * dx - a * dy + (c * ey - d * ex)
                gy = a * dx + b * dy - (c * ex + d * ey)
                g_values[g] = gx
                g_values[g + 1] = gy
                force[i] += multiplier * gx
                force[i + 1] += multiplier * gy
                g += 2
                for j in range(count):
                    r, s = reals[e, 2 * j], reals[e, 2 * j + 1]
                    p, q = reals[e + 1, 2 * j], reals[e + 1, 2 * j + 1]
                    even = -multiplier * (b * p - a * q + c * s - d * r)
                    odd = -multiplier * (a * p + b * q - c * r - d * s)
                    x_values[x] = even
                    x_values[x + 1] = -odd
                    x_values[x + 2] = odd
                    x_values[x + 3] = even
                    x += 4
            for k in range(ints[e + 1, COUNT]):
                j, weight = ints[e + 1, DOF + k], reals[e + 1, PARAMETER + k]
                phi[row] += weight * u[j]
                g_values[g + k] = weight
                force[j] += multiplier * weight
        elif kind == TWIST:
            wound, turning = u.dtype.type(-reals[e, PARAMETER]), u.dtype.type(0)
            for k in range(count):
                wound += reals[e, k] * u[ints[e, DOF + k]]
                turning += reals[e, k] * v[ints[e, DOF + k]]
            stiffness, damping = reals[e, PARAMETER + 1], reals[e, PARAMETER + 2]
            torque = -stiffness * wound - damping * turning
            y = ints[e, Y_START]
            for k in range(count):
                force[ints[e, DOF + k]] += reals[e, k] * torque
                for j in range(count):
                    x_values[x] = stiffness * reals[e, k] * reals[e, j]
                    y_values[y] = damping * reals[e, k] * reals[e, j]
                    x += 1
                    y += 1


@_inline
def _accumulate(
    first, last, t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
):  # fmt: skip
    """Do what `evaluate` does for the rows first ≤ e < last; force is added to."""
    # Constants in the precision of the state: others would raise that of their terms.
    zero, half, one, two = u.dtype.type(0), u.dtype.type(0.5), u.dtype.type(1), u.dtype.type(2)
    for e in range(first, last):
        kind, count = ints[e, KIND], ints[e, COUNT]
        if kind == LOAD:
            i = ints[e, DOF]
            force[i] += reals[e, PARAMETER]
            force[i + 1] += reals[e, PARAMETER + 1]
            continue
        if kind >= FORCE:
            continue

        dx, dy = reals[e, OFFSET], reals[e, OFFSET + 1]
        if kind == LINK:
            row, x, g = ints[e, ROW], ints[e, X_START], ints[e, G_START]
            multiplier = multipliers[row]
            for k in range(count):
                i, a = ints[e, DOF + k], reals[e, 2 * k]
                dx += a * u[i]
                dy += a * u[i + 1]
            phi[row] = half * (dx * dx + dy * dy - reals[e, PARAMETER])
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

        if kind in (LINE, ANGLE):
            # Linear in u: a force along the normal, no tangent.
            row, g = ints[e, ROW], ints[e, G_START]
            law = _law(t, reals, e, 0)
            if kind == LINE:
                nx, ny = reals[e, PARAMETER], reals[e, PARAMETER + 1]
                phi[row] = nx * dx + ny * dy - law
            else:
                sine, cosine = sine_cosine(law, reals.dtype.type)
                nx, ny = -sine, cosine
                phi[row] = nx * dx + ny * dy
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                g_values[g] = a * nx + b * ny
                g_values[g + 1] = a * ny - b * nx
                force[i] += multipliers[row] * g_values[g]
                force[i + 1] += multipliers[row] * g_values[g + 1]
                g += 2
            continue

        # (fx, fy) is conjugate to Δ; T = ∂(fx, fy)/∂Δ.
        square = dx * dx + dy * dy
        if kind == BAR:
            row, g = ints[e, ROW], ints[e, G_START]
            multiplier = multipliers[row]
            phi[row] = half * (square - reals[e, PARAMETER])
            fx, fy = multiplier * dx, multiplier * dy
            txx, txy, tyx, tyy = multiplier, zero, zero, multiplier
            for k in range(count):
                a, b = reals[e, 2 * k], reals[e, 2 * k + 1]
                g_values[g] = a * dx + b * dy
                g_values[g + 1] = a * dy - b * dx
                g += 2
        elif kind == SPRING:
            length = np.sqrt(square)
            tension_over_length = reals[e, PARAMETER] * (one - reals[e, PARAMETER + 1] / length)
            fx, fy = -tension_over_length * dx, -tension_over_length * dy
            rank_one = reals[e, PARAMETER] * reals[e, PARAMETER + 1] / (length * square)
            txx = -tension_over_length - rank_one * dx * dx
            txy = -rank_one * dx * dy
            tyx = txy
            tyy = -tension_over_length - rank_one * dy * dy
        elif kind == DAMPER:
            wx, wy = zero, zero
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                wx += a * v[i] - b * v[i + 1]
                wy += b * v[i] + a * v[i + 1]
            damping = reals[e, PARAMETER] / square
            product = dx * wx + dy * wy
            fx, fy = -damping * product * dx, -damping * product * dy
            twice = two * product / square
            txx = -damping * (dx * wx + product - twice * dx * dx)
            txy = -damping * (dx * wy - twice * dx * dy)
            tyx = -damping * (dy * wx - twice * dy * dx)
            tyy = -damping * (dy * wy + product - twice * dy * dy)
            # Y: the tangent for Δ' is −damping Δ Δᵀ.
            y = ints[e, Y_START]
            for k in range(count):
                a, b = reals[e, 2 * k], reals[e, 2 * k + 1]
                px, py = a * dx + b * dy, a * dy - b * dx
                for j in range(count):
                    a, b = reals[e, 2 * j], reals[e, 2 * j + 1]
                    qx, qy = a * dx + b * dy, a * dy - b * dx
                    y_values[y] = damping * px * qx
                    y_values[y + 1] = damping * px * qy
                    y_values[y + 2] = damping * py * qx
                    y_values[y + 3] = damping * py * qy
                    y += 4
        else:  # TORQUE: the virtual work of τ through the angle of Δ
            torque = reals[e, PARAMETER] / square
            fx, fy = -torque * dy, torque * dx
            txx = two * torque * dx * dy / square
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


@cached_njit(nogil=True, error_model="numpy")
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """Force f + Gλ, constraints Φ, and the values of X, Y, G, of the kinds before FORCE.

    Args:
        t: Time (s).
        u, v: (n,) coordinates (m) and velocities (m/s) of the moving points.
        multipliers: (m,) λ.
        ints, reals: Element tables, see the module.
        force: (n,) overwritten with f(u, v, t) + G(u, t) λ.
        phi: (m,) overwritten with Φ(u, t).
        x_values: Overwritten with the entries of X = −∂(f + Gλ)/∂u.
        y_values: Overwritten with the entries of Y = −∂f/∂v.
        g_values: Overwritten with the entries of G = Φ_uᵀ.
    """
    force[:] = 0
    _accumulate(
        0, ints.shape[0], t, u, v, multipliers, ints, reals, force, phi, x_values, y_values,
        g_values,
    )  # fmt: skip


#: By itself, for `newmark_cli.newmark.linear.written.specialised`.
accumulate = cached_njit(nogil=True, error_model="numpy")(
    getattr(_accumulate, "py_func", _accumulate)
)


@cached_njit(nogil=True, error_model="numpy")
def _differentiate_further(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """What `constraint_derivatives` leaves out: elements that few mechanisms have."""
    zero, two = u.dtype.type(0), u.dtype.type(2)
    for e in range(ints.shape[0]):
        kind, count, row, g = ints[e, KIND], ints[e, COUNT], ints[e, ROW], ints[e, G_START]
        if kind == COUPLE:
            dx, dy = _vector(u, ints, reals, e, e)
            dx, dy = dx + reals[e, OFFSET], dy + reals[e, OFFSET + 1]
            wx, wy = _vector(v, ints, reals, e, e)
            ax, ay = _vector(w, ints, reals, e, e)
            j = ints[e, Y_START]
            sine, cosine = sine_cosine(u[j], u.dtype.type)
            turn, faster = v[j], w[j]
            along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
            with_v, against_v = cosine * wx + sine * wy, cosine * wy - sine * wx
            with_w = cosine * ax + sine * ay
            rate[row] = zero
            curvature[row] = -two * turn * with_v - turn * turn * across
            # n' and n'' of n = (−sin θ, cos θ).
            nx, ny = -turn * cosine, -turn * sine
            mx, my = turn * turn * sine - faster * cosine, -turn * turn * cosine - faster * sine
            for k in range(count):
                a, b = reals[e, 2 * k], reals[e, 2 * k + 1]
                rate_values[g] = a * nx + b * ny
                rate_values[g + 1] = a * ny - b * nx
                acceleration_values[g] = a * mx + b * my
                acceleration_values[g + 1] = a * my - b * mx
                g += 2
            rate_values[g] = -with_v - turn * across
            acceleration_values[g] = (
                -with_w - faster * across - two * turn * against_v + turn * turn * along
            )
        elif kind == PAIR:
            # Bilinear: Gᵀ w changes with u as Gᵀ u with w.
            rx, ry = _vector(v, ints, reals, e, e)
            px, py = _vector(v, ints, reals, e, e + 1)
            ax, ay = _vector(w, ints, reals, e, e)
            bx, by = _vector(w, ints, reals, e, e + 1)
            rate[row] = -_law(t, reals, e, 1)
            curvature[row] = two * (px * ry - py * rx) - _law(t, reals, e, 2)
            for k in range(count):
                a, b = reals[e, 2 * k], reals[e, 2 * k + 1]
                c, d = reals[e + 1, 2 * k], reals[e + 1, 2 * k + 1]
                rate_values[g] = b * px - a * py + (c * ry - d * rx)
                rate_values[g + 1] = a * px + b * py - (c * rx + d * ry)
                acceleration_values[g] = b * bx - a * by + (c * ay - d * ax)
                acceleration_values[g + 1] = a * bx + b * by - (c * ax + d * ay)
                g += 2
            for k in range(ints[e + 1, COUNT]):
                rate_values[g + k] = zero
                acceleration_values[g + k] = zero


@cached_njit(nogil=True, error_model="numpy")
def constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """Terms of Φ' and Φ'' besides Gᵀ v and Gᵀ u'', and the tangents of both to u.

    An element's columns of G are C_kᵀ Δ, or C_kᵀ n with a normal n(t).  Along a motion
    with u' = v that is C_kᵀ Δ' and C_kᵀ n'; Gᵀ w and Φ'' change with u by C_kᵀ W, with
    W = Σ C_k w_k, and by C_kᵀ n''.

    Args:
        t: Time (s).
        u, v, w: (n,) coordinates (m), velocities (m/s) and accelerations (m/s²).
        ints, reals: Element tables, see the module.
        rate: (m,) overwritten; Φ' = Gᵀ v + rate.
        curvature: (m,) overwritten; Φ'' = Gᵀ u'' + curvature.
        rate_values: Overwritten with the entries of ∂(Gᵀ v + rate)/∂u, transposed, at
            the places of those of G.
        acceleration_values: The same for ∂(Gᵀ w + curvature)/∂u.
    """
    zero, two = u.dtype.type(0), u.dtype.type(2)
    for e in range(ints.shape[0]):
        kind, count, row, g = ints[e, KIND], ints[e, COUNT], ints[e, ROW], ints[e, G_START]
        if kind == LINE:
            rate[row] = -_law(t, reals, e, 1)
            curvature[row] = -_law(t, reals, e, 2)
            for k in range(2 * count):
                rate_values[g + k] = zero
                acceleration_values[g + k] = zero
        elif kind in (LINK, BAR, ANGLE):
            dx, dy = reals[e, OFFSET], reals[e, OFFSET + 1]
            wx, wy = zero, zero
            ax, ay = zero, zero
            for k in range(count):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                dx += a * u[i] - b * u[i + 1]
                dy += b * u[i] + a * u[i + 1]
                wx += a * v[i] - b * v[i + 1]
                wy += b * v[i] + a * v[i + 1]
                ax += a * w[i] - b * w[i + 1]
                ay += b * w[i] + a * w[i + 1]
            if kind == ANGLE:
                angle, turn = _law(t, reals, e, 0), _law(t, reals, e, 1)
                faster = _law(t, reals, e, 2)
                sine, cosine = sine_cosine(angle, reals.dtype.type)
                along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
                rate[row] = -turn * along
                curvature[row] = (
                    -faster * along - turn * turn * across - two * turn * (cosine * wx + sine * wy)
                )
                # n' and n'' of n = (−sin, cos).
                wx, wy = -turn * cosine, -turn * sine
                ax, ay = turn * turn * sine - faster * cosine, -turn * turn * cosine - faster * sine
            else:
                rate[row] = zero
                curvature[row] = wx * wx + wy * wy
            for k in range(count):
                a, b = reals[e, 2 * k], reals[e, 2 * k + 1]
                rate_values[g] = a * wx + b * wy
                rate_values[g + 1] = a * wy - b * wx
                acceleration_values[g] = a * ax + b * ay
                acceleration_values[g + 1] = a * ay - b * ax
                g += 2


@cached_njit(nogil=True, error_model="numpy")
def evaluate_all(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate`, of all kinds of elements.

    Not for mechanisms that `evaluate` serves: handing arrays on counts references to them,
    which takes longer than a small mechanism.
    """
    evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
    _evaluate_further(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)


@cached_njit(nogil=True, error_model="numpy")
def all_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same as `constraint_derivatives`, of all kinds of elements."""
    constraint_derivatives(
        t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
    )
    _differentiate_further(
        t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
    )


@cached_njit(nogil=True, error_model="numpy")
def potential(t, u, v, ints, reals):
    """Potential energy of springs and loads (J): ½ k (|Δ| − L)², ½ k q² and −F·P.

    Args:
        t: Time (s); not used, as v is.
        u, v: (n,) coordinates (m) and velocities (m/s).
        ints, reals: Element tables, see the module.
    """
    energy = 0.0
    for e in range(ints.shape[0]):
        kind = ints[e, KIND]
        if kind == LOAD:
            i = ints[e, DOF]
            energy -= reals[e, PARAMETER] * u[i] + reals[e, PARAMETER + 1] * u[i + 1]
        elif kind == SPRING:
            dx, dy = reals[e, OFFSET], reals[e, OFFSET + 1]
            for k in range(ints[e, COUNT]):
                i, a, b = ints[e, DOF + k], reals[e, 2 * k], reals[e, 2 * k + 1]
                dx += a * u[i] - b * u[i + 1]
                dy += b * u[i] + a * u[i + 1]
            stretch = np.sqrt(dx * dx + dy * dy) - reals[e, PARAMETER + 1]
            energy += reals[e, PARAMETER] * stretch * stretch / 2
        elif kind == FORCE:
            x, y = _vector(u, ints, reals, e, e)
            law = _law(t, reals, e, 0)
            energy -= (reals[e, PARAMETER] * x + reals[e, PARAMETER + 1] * y) * law
        elif kind == TWIST:
            wound = -reals[e, PARAMETER]
            for k in range(ints[e, COUNT]):
                wound += reals[e, k] * u[ints[e, DOF + k]]
            energy += reals[e, PARAMETER + 1] * wound * wound / 2
    return energy


@cached_njit(nogil=True, error_model="numpy")
def evaluate_timed(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate_all`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, LAW)
    evaluate_all(
        reals.dtype.type(0), u, v, multipliers, own, frozen, force, phi, x_values, y_values,
        g_values,
    )  # fmt: skip


@cached_njit(nogil=True, error_model="numpy")
def timed_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same as `all_constraint_derivatives`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, LAW)
    all_constraint_derivatives(
        reals.dtype.type(0), u, v, w, own, frozen, rate, curvature, rate_values,
        acceleration_values,
    )  # fmt: skip


@cached_njit(nogil=True, error_model="numpy")
def timed_potential(t, u, v, ints, reals):
    """The same as `potential`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, LAW)
    return potential(reals.dtype.type(0), u, v, own, frozen)
