"""Element loop of the spatial mechanism, compiled once for every mechanism.

The coordinates are vectors of three components: the origin of each body and its three
directors.  An element acts on one or two combinations of them,

    L = L0 + Σ_k w_k V_k,

with L0 what the ground contributes, and V_k vectors of the bodies: a point with body
coordinates ξ has the weights 1, ξ, a direction with components α has 0, α.  Constraints
are at most quadratic in u.

Tables, one row per element, followed by a row for each term w_k V_k of its first and then
of its second combination:

=========  ==================================================================
``ints``   kind, terms of the first and the second combination, first entry in the
           X values, in the Y values, in the G values, constraint row (three of `POINT`,
           −1 for one that is dropped).  Of a term: `TERM`, place of V_k in u
``reals``  L0 of the first and the second combination, a third vector, parameters.
           Of a term: w_k; of `ANGLE` and `HINGE` the first combination has two weights,
           of q and of p, and the constants are those of q, p and the second combination
=========  ==================================================================

=========  ==================================================================
kind       what it is
=========  ==================================================================
BODY       six rows: (d_i·d_i − 1)/2, then d_1·d_2, d_1·d_3, d_2·d_3; no terms
POINT      three rows: L = 0
DOT        L·K − law(t), K the second combination: joints, driven coordinates
SQUARE     (L·L − parameter)/2: a distance
ANGLE      (cos θ q − sin θ p)·b, θ = law(t): a driven angle
SPRING     stiffness, rest length
DAMPER     damping of the rate of |L|
LOAD       a force that is constant, on one vector; no terms
TORQUE     a torque with constant global components, on a body; no terms
FOLLOWER   a torque with constant components in the body's axes; no terms
HINGE      torque, stiffness, angle of rest and damping about the axis of a joint; its angle
           is φ = atan2(q·b, p·b), within ±π
=========  ==================================================================

Driven elements have a law of time among their parameters, and rows of laws may stand behind
all elements, see `timed`.  The functions ``…_timed`` put values of laws into a copy of the
table, and call the others.
"""

import numpy as np

from newmark_cli.mechanisms import timed
from newmark_cli.support.cached_code import cached_njit

(
    BODY, POINT, DOT, SQUARE, ANGLE, SPRING, DAMPER, LOAD, TORQUE, FOLLOWER, HINGE, TERM,
) = range(12)  # fmt: skip

#: Columns of the integer and the real table; a term has its place in `FIRST`.
KIND, FIRST, SECOND, X_START, Y_START, G_START, ROW, INT_COLUMNS = 0, 1, 2, 3, 4, 5, 6, 9
OFFSET, OTHER, THIRD, PARAMETER, REAL_COLUMNS = 0, 3, 6, 9, 15

#: Pairs of directors of the last three rows of `BODY`.
PAIRS = ((0, 1), (0, 2), (1, 2))

sine_cosine, at_time, _law_of = timed.sine_cosine, timed.at_time, timed.law

#: The angle of a torsion spring jumps at ±π; closer to it than this (rad) there is no force.
_WOUND = 0.05


@cached_njit(nogil=True, error_model="numpy")
def _law(t, reals, e, derivative):
    """The law of a driven element, or a derivative of it."""
    return _law_of(t, reals, e, PARAMETER, derivative)


@cached_njit(nogil=True, error_model="numpy")
def _combined(vector, ints, reals, first, count, weight):
    """Σ w_k V_k of the terms in some rows of the tables, without what is constant."""
    x, y, z = vector.dtype.type(0), vector.dtype.type(0), vector.dtype.type(0)
    for k in range(first, first + count):
        i, w = ints[k, FIRST], reals[k, weight]
        x += w * vector[i]
        y += w * vector[i + 1]
        z += w * vector[i + 2]
    return x, y, z


@cached_njit(nogil=True, error_model="numpy")
def _cross_entries(values, place, x, y, z):
    """The six entries of [r]×, in the order (0,1), (0,2), (1,0), (1,2), (2,0), (2,1)."""
    values[place] = -z
    values[place + 1] = y
    values[place + 2] = z
    values[place + 3] = -x
    values[place + 4] = -y
    values[place + 5] = x


@cached_njit(nogil=True, error_model="numpy")
def _about_axis(t, u, v, ints, reals, e, force, x_values, y_values):
    """A hinge: the force Q g on both bodies, g = ∂φ/∂u, and its tangents."""
    two = u.dtype.type(2)
    first, second = ints[e, FIRST], ints[e, SECOND]
    count = first + second
    qx, qy, qz = _combined(u, ints, reals, e + 1, first, 0)
    px, py, pz = _combined(u, ints, reals, e + 1, first, 1)
    bx, by, bz = _combined(u, ints, reals, e + 1 + first, second, 0)
    q, p, b = np.empty(3, u.dtype), np.empty(3, u.dtype), np.empty(3, u.dtype)
    q[0], q[1], q[2] = qx, qy, qz
    p[0], p[1], p[2] = px, py, pz
    b[0], b[1], b[2] = bx, by, bz
    for c in range(3):
        q[c] += reals[e, OFFSET + c]
        p[c] += reals[e, OTHER + c]
        b[c] += reals[e, THIRD + c]
    sine = q[0] * b[0] + q[1] * b[1] + q[2] * b[2]
    cosine = p[0] * b[0] + p[1] * b[1] + p[2] * b[2]
    square = sine * sine + cosine * cosine
    of_sine, of_cosine = np.empty((count, 3), u.dtype), np.empty((count, 3), u.dtype)
    g, turned = np.empty((count, 3), u.dtype), np.zeros((count, 3), u.dtype)
    for k in range(count):
        for c in range(3):
            if k < first:
                of_sine[k, c] = reals[e + 1 + k, 0] * b[c]
                of_cosine[k, c] = reals[e + 1 + k, 1] * b[c]
            else:
                of_sine[k, c] = reals[e + 1 + k, 0] * q[c]
                of_cosine[k, c] = reals[e + 1 + k, 0] * p[c]
            g[k, c] = (cosine * of_sine[k, c] - sine * of_cosine[k, c]) / square
    rate = u.dtype.type(0)
    for k in range(count):
        i = ints[e + 1 + k, FIRST]
        for c in range(3):
            rate += g[k, c] * v[i + c]
    stiffness, damping = reals[e, PARAMETER + 1], reals[e, PARAMETER + 3]
    torque = reals[e, PARAMETER] - damping * rate
    if stiffness != 0:
        angle = np.arctan2(sine.real, cosine.real)
        if np.abs(angle) > np.pi - _WOUND:
            torque = torque + u.dtype.type(np.nan)  # wound further than the angle can tell
        # The derivative of atan2, for what is differentiated by complex steps.
        small = (cosine.real * sine - sine.real * cosine) / (
            cosine.real * cosine + sine.real * sine
        )
        angle = u.dtype.type(angle) + (small - small.real)
        torque = torque - stiffness * (angle - reals[e, PARAMETER + 2])
    hessian = np.empty((count, 3, count, 3), u.dtype)
    for k in range(count):
        for j in range(count):
            mixed = u.dtype.type(0)
            if k < first <= j:
                mixed = reals[e + 1 + j, 0] * (
                    cosine * reals[e + 1 + k, 0] - sine * reals[e + 1 + k, 1]
                )
            elif j < first <= k:
                mixed = reals[e + 1 + k, 0] * (
                    cosine * reals[e + 1 + j, 0] - sine * reals[e + 1 + j, 1]
                )
            for c in range(3):
                for d in range(3):
                    entry = of_sine[k, c] * of_cosine[j, d] - of_cosine[k, c] * of_sine[j, d]
                    if c == d:
                        entry += mixed
                    along = cosine * of_cosine[j, d] + sine * of_sine[j, d]
                    hessian[k, c, j, d] = (entry - two * g[k, c] * along) / square
                    turned[k, c] += hessian[k, c, j, d] * v[ints[e + 1 + j, FIRST] + d]
    x, y = ints[e, X_START], ints[e, Y_START]
    for k in range(count):
        i = ints[e + 1 + k, FIRST]
        for c in range(3):
            force[i + c] += torque * g[k, c]
        for j in range(count):
            for c in range(3):
                for d in range(3):
                    change = stiffness * g[j, d] + damping * turned[j, d]
                    x_values[x] = g[k, c] * change - torque * hessian[k, c, j, d]
                    y_values[y] = damping * g[k, c] * g[j, d]
                    x += 1
                    y += 1


@cached_njit(nogil=True, error_model="numpy")
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """Force f + Gλ, constraints Φ, and the values of X, Y, G of a mechanism.

    Args:
        t: Time (s).
        u, v: (n,) coordinates (m, directors without unit) and their rates.
        multipliers: (m,) λ.
        ints, reals: Element tables, see the module.
        force: (n,) overwritten with f(u, v, t) + G(u, t) λ.
        phi: (m,) overwritten with Φ(u, t).
        x_values: Overwritten with the entries of X = −∂(f + Gλ)/∂u.
        y_values: Overwritten with the entries of Y = −∂f/∂v.
        g_values: Overwritten with the entries of G = Φ_uᵀ.
    """
    # Constants in the precision of the state: others would raise that of their terms.
    half, one, two = u.dtype.type(0.5), u.dtype.type(1), u.dtype.type(2)
    force[:] = 0
    e = 0
    while e < ints.shape[0]:
        kind, first, second = ints[e, KIND], ints[e, FIRST], ints[e, SECOND]
        row, x, g = ints[e, ROW], ints[e, X_START], ints[e, G_START]
        if kind == BODY:
            for i in range(3):
                a = first + 3 * i
                multiplier = multipliers[row + i]
                phi[row + i] = half * (
                    u[a] * u[a] + u[a + 1] * u[a + 1] + u[a + 2] * u[a + 2] - one
                )
                for c in range(3):
                    g_values[g] = u[a + c]
                    force[a + c] += multiplier * u[a + c]
                    x_values[x] = -multiplier
                    g += 1
                    x += 1
            for k in range(3):
                i, j = PAIRS[k]
                a, b = first + 3 * i, first + 3 * j
                multiplier = multipliers[row + 3 + k]
                phi[row + 3 + k] = u[a] * u[b] + u[a + 1] * u[b + 1] + u[a + 2] * u[b + 2]
                for c in range(3):
                    g_values[g] = u[b + c]
                    g_values[g + 3] = u[a + c]
                    force[a + c] += multiplier * u[b + c]
                    force[b + c] += multiplier * u[a + c]
                    x_values[x] = -multiplier
                    x_values[x + 3] = -multiplier
                    g += 1
                    x += 1
                g += 3
                x += 3
            e += 1
            continue
        if kind == LOAD:
            for c in range(3):
                force[first + c] += reals[e, OFFSET + c]
            e += 1
            continue
        if kind == TORQUE:
            tx, ty, tz = half * reals[e, 0], half * reals[e, 1], half * reals[e, 2]
            for i in range(3):
                a = first + 3 * i
                force[a] += ty * u[a + 2] - tz * u[a + 1]
                force[a + 1] += tz * u[a] - tx * u[a + 2]
                force[a + 2] += tx * u[a + 1] - ty * u[a]
                _cross_entries(x_values, x + 6 * i, -tx, -ty, -tz)
            e += 1
            continue
        if kind == FOLLOWER:
            tx, ty, tz = u.dtype.type(0), u.dtype.type(0), u.dtype.type(0)
            for j in range(3):
                b, torque = first + 3 * j, half * reals[e, j]
                tx += torque * u[b]
                ty += torque * u[b + 1]
                tz += torque * u[b + 2]
            for i in range(3):
                a = first + 3 * i
                force[a] += ty * u[a + 2] - tz * u[a + 1]
                force[a + 1] += tz * u[a] - tx * u[a + 2]
                force[a + 2] += tx * u[a + 1] - ty * u[a]
                for j in range(3):
                    torque = half * reals[e, j]
                    rx, ry, rz = torque * u[a], torque * u[a + 1], torque * u[a + 2]
                    if i == j:
                        rx, ry, rz = rx - tx, ry - ty, rz - tz
                    _cross_entries(x_values, x + 18 * i + 6 * j, rx, ry, rz)
            e += 1
            continue
        if kind == HINGE:
            _about_axis(t, u, v, ints, reals, e, force, x_values, y_values)
            e += 1 + first + second
            continue

        dx, dy, dz = _combined(u, ints, reals, e + 1, first, 0)
        dx, dy, dz = dx + reals[e, OFFSET], dy + reals[e, OFFSET + 1], dz + reals[e, OFFSET + 2]
        if kind == POINT:
            for c in range(3):
                row = ints[e, ROW + c]
                if row < 0:
                    continue
                phi[row] = dx if c == 0 else dy if c == 1 else dz
                for k in range(e + 1, e + 1 + first):
                    g_values[g] = reals[k, 0]
                    force[ints[k, FIRST] + c] += multipliers[row] * reals[k, 0]
                    g += 1
        elif kind == DOT:
            multiplier = multipliers[row]
            kx, ky, kz = _combined(u, ints, reals, e + 1 + first, second, 0)
            kx, ky, kz = kx + reals[e, OTHER], ky + reals[e, OTHER + 1], kz + reals[e, OTHER + 2]
            phi[row] = dx * kx + dy * ky + dz * kz - _law(t, reals, e, 0)
            for k in range(e + 1, e + 1 + first + second):
                i, w = ints[k, FIRST], reals[k, 0]
                gx, gy, gz = w * kx, w * ky, w * kz
                if k > e + first:
                    gx, gy, gz = w * dx, w * dy, w * dz
                g_values[g], g_values[g + 1], g_values[g + 2] = gx, gy, gz
                force[i] += multiplier * gx
                force[i + 1] += multiplier * gy
                force[i + 2] += multiplier * gz
                g += 3
            for k in range(e + 1, e + 1 + first):
                for j in range(e + 1 + first, e + 1 + first + second):
                    tangent = -multiplier * reals[k, 0] * reals[j, 0]
                    for c in range(6):
                        x_values[x + c] = tangent
                    x += 6
        elif kind == SQUARE:
            multiplier = multipliers[row]
            phi[row] = half * (dx * dx + dy * dy + dz * dz - reals[e, PARAMETER])
            for k in range(e + 1, e + 1 + first):
                i, w = ints[k, FIRST], reals[k, 0]
                g_values[g], g_values[g + 1], g_values[g + 2] = w * dx, w * dy, w * dz
                force[i] += multiplier * w * dx
                force[i + 1] += multiplier * w * dy
                force[i + 2] += multiplier * w * dz
                g += 3
                for j in range(e + 1, e + 1 + first):
                    tangent = -multiplier * w * reals[j, 0]
                    x_values[x], x_values[x + 1], x_values[x + 2] = tangent, tangent, tangent
                    x += 3
        elif kind == ANGLE:
            multiplier, angle = multipliers[row], _law(t, reals, e, 0)
            sine, cosine = sine_cosine(angle, reals.dtype.type)
            px, py, pz = _combined(u, ints, reals, e + 1, first, 1)
            px, py, pz = px + reals[e, OTHER], py + reals[e, OTHER + 1], pz + reals[e, OTHER + 2]
            dx, dy, dz = (
                cosine * dx - sine * px, cosine * dy - sine * py, cosine * dz - sine * pz,
            )  # fmt: skip
            bx, by, bz = _combined(u, ints, reals, e + 1 + first, second, 0)
            bx, by, bz = bx + reals[e, THIRD], by + reals[e, THIRD + 1], bz + reals[e, THIRD + 2]
            phi[row] = dx * bx + dy * by + dz * bz
            for k in range(e + 1, e + 1 + first + second):
                i, w = ints[k, FIRST], reals[k, 0]
                gx, gy, gz = w * dx, w * dy, w * dz
                if k <= e + first:
                    w = cosine * w - sine * reals[k, 1]
                    gx, gy, gz = w * bx, w * by, w * bz
                    for j in range(e + 1 + first, e + 1 + first + second):
                        tangent = -multiplier * w * reals[j, 0]
                        for c in range(6):
                            x_values[x + c] = tangent
                        x += 6
                g_values[g], g_values[g + 1], g_values[g + 2] = gx, gy, gz
                force[i] += multiplier * gx
                force[i + 1] += multiplier * gy
                force[i + 2] += multiplier * gz
                g += 3
        else:  # SPRING or DAMPER: a force along L, and its tangent T = −∂F/∂L
            square = dx * dx + dy * dy + dz * dz
            if kind == SPRING:
                length = np.sqrt(square)
                tension = reals[e, PARAMETER] * (one - reals[e, PARAMETER + 1] / length)
                rank = reals[e, PARAMETER] * reals[e, PARAMETER + 1] / (length * square)
                vx, vy, vz = rank * dx, rank * dy, rank * dz
            else:
                rx, ry, rz = _combined(v, ints, reals, e + 1, first, 0)
                damping = reals[e, PARAMETER] / square
                product = dx * rx + dy * ry + dz * rz
                tension = damping * product
                rank = two * product / square
                vx, vy, vz = (
                    damping * (rx - rank * dx),
                    damping * (ry - rank * dy),
                    damping * (rz - rank * dz),
                )
            y = ints[e, Y_START]
            for k in range(e + 1, e + 1 + first):
                i, w = ints[k, FIRST], reals[k, 0]
                force[i] -= w * tension * dx
                force[i + 1] -= w * tension * dy
                force[i + 2] -= w * tension * dz
                for j in range(e + 1, e + 1 + first):
                    both = w * reals[j, 0]
                    x_values[x] = both * (dx * vx + tension)
                    x_values[x + 1] = both * dx * vy
                    x_values[x + 2] = both * dx * vz
                    x_values[x + 3] = both * dy * vx
                    x_values[x + 4] = both * (dy * vy + tension)
                    x_values[x + 5] = both * dy * vz
                    x_values[x + 6] = both * dz * vx
                    x_values[x + 7] = both * dz * vy
                    x_values[x + 8] = both * (dz * vz + tension)
                    x += 9
                    if kind == DAMPER:
                        both = both * reals[e, PARAMETER] / square
                        y_values[y] = both * dx * dx
                        y_values[y + 1] = both * dx * dy
                        y_values[y + 2] = both * dx * dz
                        y_values[y + 3] = both * dy * dx
                        y_values[y + 4] = both * dy * dy
                        y_values[y + 5] = both * dy * dz
                        y_values[y + 6] = both * dz * dx
                        y_values[y + 7] = both * dz * dy
                        y_values[y + 8] = both * dz * dz
                        y += 9
        e += 1 + first + second


@cached_njit(nogil=True, error_model="numpy")
def constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """Terms of Φ' and Φ'' besides Gᵀ v and Gᵀ u'', and the tangents of both to u.

    Args:
        t: Time (s).
        u, v, w: (n,) coordinates, velocities and accelerations.
        ints, reals: Element tables, see the module.
        rate: (m,) overwritten; Φ' = Gᵀ v + rate.
        curvature: (m,) overwritten; Φ'' = Gᵀ u'' + curvature.
        rate_values: Overwritten with the entries of ∂(Gᵀ v + rate)/∂u, transposed, at
            the places of those of G.
        acceleration_values: The same for ∂(Gᵀ w + curvature)/∂u.
    """
    zero, two = u.dtype.type(0), u.dtype.type(2)
    e = 0
    while e < ints.shape[0]:
        kind, first, second = ints[e, KIND], ints[e, FIRST], ints[e, SECOND]
        row, g = ints[e, ROW], ints[e, G_START]
        if kind == BODY:
            for i in range(3):
                a = first + 3 * i
                rate[row + i] = zero
                curvature[row + i] = v[a] * v[a] + v[a + 1] * v[a + 1] + v[a + 2] * v[a + 2]
                for c in range(3):
                    rate_values[g] = v[a + c]
                    acceleration_values[g] = w[a + c]
                    g += 1
            for k in range(3):
                i, j = PAIRS[k]
                a, b = first + 3 * i, first + 3 * j
                rate[row + 3 + k] = zero
                curvature[row + 3 + k] = two * (
                    v[a] * v[b] + v[a + 1] * v[b + 1] + v[a + 2] * v[b + 2]
                )
                for c in range(3):
                    rate_values[g + c] = v[b + c]
                    rate_values[g + 3 + c] = v[a + c]
                    acceleration_values[g + c] = w[b + c]
                    acceleration_values[g + 3 + c] = w[a + c]
                g += 6
            e += 1
            continue
        if kind in (LOAD, TORQUE, FOLLOWER):
            e += 1
            continue
        after = e + 1 + first + second
        if kind == POINT:
            for c in range(3):
                row = ints[e, ROW + c]
                if row >= 0:
                    rate[row], curvature[row] = zero, zero
                    for _ in range(first):
                        rate_values[g] = zero
                        acceleration_values[g] = zero
                        g += 1
        elif kind == DOT:
            vx, vy, vz = _combined(v, ints, reals, e + 1, first, 0)
            wx, wy, wz = _combined(w, ints, reals, e + 1, first, 0)
            kx, ky, kz = _combined(v, ints, reals, e + 1 + first, second, 0)
            lx, ly, lz = _combined(w, ints, reals, e + 1 + first, second, 0)
            rate[row] = -_law(t, reals, e, 1)
            curvature[row] = two * (vx * kx + vy * ky + vz * kz) - _law(t, reals, e, 2)
            for k in range(e + 1, after):
                weight = reals[k, 0]
                if k <= e + first:
                    rx, ry, rz, ax, ay, az = kx, ky, kz, lx, ly, lz
                else:
                    rx, ry, rz, ax, ay, az = vx, vy, vz, wx, wy, wz
                rate_values[g] = weight * rx
                rate_values[g + 1] = weight * ry
                rate_values[g + 2] = weight * rz
                acceleration_values[g] = weight * ax
                acceleration_values[g + 1] = weight * ay
                acceleration_values[g + 2] = weight * az
                g += 3
        elif kind == SQUARE:
            vx, vy, vz = _combined(v, ints, reals, e + 1, first, 0)
            wx, wy, wz = _combined(w, ints, reals, e + 1, first, 0)
            rate[row] = zero
            curvature[row] = vx * vx + vy * vy + vz * vz
            for k in range(e + 1, after):
                weight = reals[k, 0]
                rate_values[g] = weight * vx
                rate_values[g + 1] = weight * vy
                rate_values[g + 2] = weight * vz
                acceleration_values[g] = weight * wx
                acceleration_values[g + 1] = weight * wy
                acceleration_values[g + 2] = weight * wz
                g += 3
        elif kind == ANGLE:
            # N = cos θ q − sin θ p, its derivatives by time only, and along v and w.
            angle = _law(t, reals, e, 0)
            turn, faster = _law(t, reals, e, 1), _law(t, reals, e, 2)
            sine, cosine = sine_cosine(angle, reals.dtype.type)
            q, p, b = (
                np.empty((3, 3), u.dtype),
                np.empty((3, 3), u.dtype),
                np.empty((3, 3), u.dtype),
            )
            for field in range(3):
                vector = u if field == 0 else v if field == 1 else w
                q[field, 0], q[field, 1], q[field, 2] = _combined(
                    vector, ints, reals, e + 1, first, 0
                )
                p[field, 0], p[field, 1], p[field, 2] = _combined(
                    vector, ints, reals, e + 1, first, 1
                )
                b[field, 0], b[field, 1], b[field, 2] = _combined(
                    vector, ints, reals, e + 1 + first, second, 0
                )
            sums = zero
            rate[row] = zero
            for c in range(3):
                q[0, c] += reals[e, OFFSET + c]
                p[0, c] += reals[e, OTHER + c]
                b[0, c] += reals[e, THIRD + c]
                down, over = sine * q[0, c] + cosine * p[0, c], cosine * q[0, c] - sine * p[0, c]
                by_time = -turn * down
                again = -faster * down - turn * turn * over
                moving = cosine * q[1, c] - sine * p[1, c]
                mixed = -turn * (sine * q[1, c] + cosine * p[1, c])
                rate[row] += by_time * b[0, c]
                sums += two * (moving + by_time) * b[1, c] + (two * mixed + again) * b[0, c]
            curvature[row] = sums
            for k in range(e + 1, after):
                for c in range(3):
                    if k <= e + first:
                        over = cosine * reals[k, 0] - sine * reals[k, 1]
                        down = sine * reals[k, 0] + cosine * reals[k, 1]
                        by_time = -turn * down
                        again = -faster * down - turn * turn * over
                        rate_values[g] = over * b[1, c] + by_time * b[0, c]
                        acceleration_values[g] = (
                            over * b[2, c] + two * by_time * b[1, c] + again * b[0, c]
                        )
                    else:
                        down = sine * q[0, c] + cosine * p[0, c]
                        over = cosine * q[0, c] - sine * p[0, c]
                        moving = cosine * q[1, c] - sine * p[1, c]
                        mixed = -turn * (sine * q[1, c] + cosine * p[1, c])
                        accelerated = cosine * q[2, c] - sine * p[2, c]
                        weight = reals[k, 0]
                        rate_values[g] = weight * (moving - turn * down)
                        acceleration_values[g] = weight * (
                            accelerated + two * mixed - faster * down - turn * turn * over
                        )
                    g += 1
        e = after


@cached_njit(nogil=True, error_model="numpy")
def potential(t, u, v, ints, reals):
    """Potential energy of springs, torsion springs and loads (J).

    Args:
        t: Time (s); not used, as v is.
        u, v: (n,) coordinates and velocities.
        ints, reals: Element tables, see the module.
    """
    energy = 0.0
    e = 0
    while e < ints.shape[0]:
        kind, first, second = ints[e, KIND], ints[e, FIRST], ints[e, SECOND]
        if kind == LOAD:
            for c in range(3):
                energy -= reals[e, OFFSET + c] * u[first + c]
        elif kind == SPRING:
            dx, dy, dz = _combined(u, ints, reals, e + 1, first, 0)
            dx, dy = dx + reals[e, OFFSET], dy + reals[e, OFFSET + 1]
            dz = dz + reals[e, OFFSET + 2]
            stretch = np.sqrt(dx * dx + dy * dy + dz * dz) - reals[e, PARAMETER + 1]
            energy += reals[e, PARAMETER] * stretch * stretch / 2
        elif kind == HINGE:
            qx, qy, qz = _combined(u, ints, reals, e + 1, first, 0)
            px, py, pz = _combined(u, ints, reals, e + 1, first, 1)
            bx, by, bz = _combined(u, ints, reals, e + 1 + first, second, 0)
            bx, by, bz = bx + reals[e, THIRD], by + reals[e, THIRD + 1], bz + reals[e, THIRD + 2]
            sine = (
                (qx + reals[e, OFFSET]) * bx
                + (qy + reals[e, OFFSET + 1]) * by
                + (qz + reals[e, OFFSET + 2]) * bz
            )
            cosine = (
                (px + reals[e, OTHER]) * bx
                + (py + reals[e, OTHER + 1]) * by
                + (pz + reals[e, OTHER + 2]) * bz
            )
            wound = np.arctan2(sine, cosine) - reals[e, PARAMETER + 2]
            energy += reals[e, PARAMETER + 1] * wound * wound / 2
        if kind in (BODY, LOAD, TORQUE, FOLLOWER):
            e += 1
        else:
            e += 1 + first + second
    return energy


@cached_njit(nogil=True, error_model="numpy")
def evaluate_timed(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, PARAMETER)
    evaluate(
        reals.dtype.type(0), u, v, multipliers, own, frozen, force, phi, x_values, y_values,
        g_values,
    )  # fmt: skip


@cached_njit(nogil=True, error_model="numpy")
def timed_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same as `constraint_derivatives`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, PARAMETER)
    constraint_derivatives(
        reals.dtype.type(0), u, v, w, own, frozen, rate, curvature, rate_values,
        acceleration_values,
    )  # fmt: skip


@cached_njit(nogil=True, error_model="numpy")
def timed_potential(t, u, v, ints, reals):
    """The same as `potential`, of a table with rows of laws."""
    own, frozen = at_time(t, ints, reals, PARAMETER)
    return potential(t, u, v, own, frozen)
