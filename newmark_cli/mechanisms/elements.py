"""Element loop of all mechanisms, in the plane and in space, compiled once.

A constraint is a row of quadratic data, Φ = ½ (L·L − c) or Φ = L·K + b·u − law(t), with
combinations of the vectors of the mechanism,

    L = L0 + Σ_k C_k V_k,

L0 what the ground contributes.  In space V_k is a position or a director of a body, and C_k a
weight.  In the plane V_k is the position of a moving point P_k, and C_k = a_k + b_k R with the
quarter turn R to the left: a body-fixed point is a rotated and stretched combination of the two
points that carry its body.  The factors are kept, not their products: ½ uᵀQu would round with
the size of u.  As Φ is quadratic, Φ'' and the tangents of Φ' and Φ'' are Φ and G of the same rows
without what is constant, at the velocities and at the accelerations.

A force F conjugate to L loads the vectors with C_kᵀ F, and its tangents ∂F/∂L, ∂F/∂L' enter as
C_kᵀ (…) C_l.

Both tables have one row.  In ``ints`` each element is a header, see the columns below, and the
places in u of the vectors of its first and its second combination, and of its single coordinates
(b, angles).  In ``reals`` it has L0, K0 (and P0 of `ANGLE`, `COUPLE`, `HINGE`), parameters, and the
weights: a and b of each vector where weights are turned, else one; of the first combination of
`ANGLE` and `HINGE` two, of Q and of P.

========  ===================================================================
kind      what it is, and its parameters
========  ===================================================================
LOAD      a constant force on one vector; the force
LINK      Φ = ½ (L·L − c), L between plain points of the plane: the commonest, in its own loop
SQUARE    the same of any L: a distance, a director of length 1
PRODUCT   Φ = L·K + b·u − law(t); the law, or a constant, or nothing
ANGLE     Φ = (cos θ Q − sin θ P)·K, θ = law(t): a driven angle; the law
SPRING    stiffness, rest length
DAMPER    damping of the rate of |L|
TORQUE    of the plane: a torque through the angle of L; the torque
COUPLE    the same Φ as of `ANGLE`, θ the single coordinate
FORCE     of the plane: the force n law(t) on L; n, the law
TWIST     torque on q = b·u: angle of rest, stiffness, damping
MOMENT    a torque with constant components, on the three directors of a body; these
FOLLOWER  the same with components in the body's axes
HINGE     torque, stiffness, angle of rest and damping about the axis of a joint; its angle
          is φ = atan2(Q·K, P·K), within ±π
========  ===================================================================

Laws of time may stand behind all elements, see `timed`.  The functions ``…_timed`` put values
of laws into a copy of the table.
"""

from typing import Any

import numpy as np

from newmark_cli.mechanisms import timed
from newmark_cli.support.cached_code import cached_njit, part_njit

sine_cosine, at_time, _law = timed.sine_cosine, timed.at_time, timed.law
#: Functions by themselves, and parts of others.  In most of them nothing is allocated, so
#: references are not counted: that would take longer than a small mechanism.
_OPTIONS: Any = {"nogil": True, "error_model": "numpy"}
_compile, _compile_allocating = cached_njit(**_OPTIONS, _nrt=False), cached_njit(**_OPTIONS)
_part, _part_allocating = part_njit(**_OPTIONS, _nrt=False), part_njit(**_OPTIONS)
#: Handing on arrays costs time in each call: parts that are inlined by LLVM, and, where there is
#: but one call, by numba, which compiles sooner.
_inline, _once = (
    part_njit(**_OPTIONS, _nrt=False, forceinline=True),
    part_njit(**_OPTIONS, inline="always"),
)

#: Kinds; those from `COUPLE` on are left to `_accumulate_further`.
(
    LOAD, LINK, SQUARE, PRODUCT, ANGLE, SPRING, DAMPER, TORQUE, COUPLE, FORCE, TWIST, MOMENT,
    FOLLOWER, HINGE,
) = range(14)  # fmt: skip
#: Kinds that are a constraint, one row each: without and with an angle.
QUADRATIC, ANGULAR = (LINK, SQUARE, PRODUCT), (ANGLE, COUPLE)
CONSTRAINTS = (*QUADRATIC, *ANGULAR)

#: Columns of a header: entries of the element in ``ints``, where its numbers begin in ``reals``,
#: its parameters and weights, its row, the first entries in the values of X, Y and G, the
#: components of a vector, whether weights are turned, parameters, and terms of each sum.
(
    KIND, SIZE, REALS, PARAMETERS, WEIGHTS, ROW, X_START, Y_START, G_START, COMPONENTS, TURNED,
    GIVEN, FIRST, SECOND, SINGLE, PLACES,
) = range(16)  # fmt: skip
#: Parameters of a law of time.
LAW = 6
#: Which derivative of a law: each literal number would compile it once more.
_VALUE, _RATE, _SECOND = np.int64(0), np.int64(1), np.int64(2)

#: The angle of a torsion spring jumps at ±π; closer to it than this (rad) there is no force.
_WOUND = 0.05


@_inline
def _sum(vector, ints, reals, place, weight, count, components, turned):
    """Σ C_k V_k of the terms from a place and a weight on."""
    x, y, z = vector.dtype.type(0), vector.dtype.type(0), vector.dtype.type(0)
    for k in range(count):
        i = ints[0, place + k]
        if turned != 0:
            a, b = reals[0, weight + 2 * k], reals[0, weight + 2 * k + 1]
            dx, dy = a * vector[i] - b * vector[i + 1], b * vector[i] + a * vector[i + 1]
        else:
            a = reals[0, weight + k]
            dx, dy = a * vector[i], a * vector[i + 1]
            if components == 3:
                dz = a * vector[i + 2]
                z = dz if k == 0 else z + dz
        x, y = (dx, dy) if k == 0 else (x + dx, y + dy)
    return x, y, z


@_inline
def _spread(values, g, reals, weight, components, turned, x, y, z):
    """C_kᵀ (x, y, z) of a term, as values."""
    a = reals[0, weight]
    if turned != 0:
        b = reals[0, weight + 1]
        values[g] = a * x + b * y
        values[g + 1] = a * y - b * x
    else:
        values[g] = a * x
        values[g + 1] = a * y
        if components == 3:
            values[g + 2] = a * z


@_part
def _gradient(vector, whole, ints, reals, e, values):
    """Row e at a vector: its products, and its columns of G as values at their places.

    Args:
        vector: (n,).
        whole: 1; 0 without what is constant or linear in it.
        ints, reals: Element tables, see the module.
        e: Where the row begins; not of `ANGLE` and `COUPLE`.
        values: Entries of G, of which those of the row are overwritten.
    """
    kind, components, turned = ints[0, e + KIND], ints[0, e + COMPONENTS], ints[0, e + TURNED]
    first, second, at = ints[0, e + FIRST], ints[0, e + SECOND], e + PLACES
    r, weight, g = ints[0, e + REALS], ints[0, e + WEIGHTS], ints[0, e + G_START]
    w = weight + (1 + turned) * first
    product = vector.dtype.type(0)
    if components > 0:
        dx, dy, dz = _sum(vector, ints, reals, at, weight, first, components, turned)
        dx += whole * reals[0, r]
        dy += whole * reals[0, r + 1]
        if components == 3:
            dz += whole * reals[0, r + 2]
        if kind in (LINK, SQUARE):
            ex, ey, ez = dx, dy, dz
        else:
            ex, ey, ez = _sum(vector, ints, reals, at + first, w, second, components, turned)
            ex += whole * reals[0, r + components]
            ey += whole * reals[0, r + components + 1]
            if components == 3:
                ez += whole * reals[0, r + 5]
        product = dx * ex + dy * ey
        if components == 3:
            product += dz * ez
        for k in range(first):
            _spread(values, g, reals, weight + (1 + turned) * k, components, turned, ex, ey, ez)
            g += components
        for k in range(second):
            _spread(values, g, reals, w + (1 + turned) * k, components, turned, dx, dy, dz)
            g += components
    if kind == PRODUCT:
        w += (1 + turned) * second
        for k in range(ints[0, e + SINGLE]):
            i, a = ints[0, at + first + second + k], whole * reals[0, w + k]
            product += a * vector[i]
            values[g + k] = a
    return product


@_part
def _angular_gradient(vector, whole, cosine, sine, ints, reals, e, values, g):
    """The same of `ANGLE` and `COUPLE`, with cosine Q − sine P; values from a place g on."""
    components, first = ints[0, e + COMPONENTS], ints[0, e + FIRST]
    second, turned = ints[0, e + SECOND], ints[0, e + TURNED]
    r, weight = ints[0, e + REALS], ints[0, e + WEIGHTS]
    p, w = r + 2 * components, weight + 2 * first
    dx, dy, dz = vector.dtype.type(0), vector.dtype.type(0), vector.dtype.type(0)
    for k in range(first):
        i = ints[0, e + PLACES + k]
        a = cosine * reals[0, weight + 2 * k] - sine * reals[0, weight + 2 * k + 1]
        dx += a * vector[i]
        dy += a * vector[i + 1]
        dz += a * vector[i + 2]
    dx += whole * (cosine * reals[0, r] - sine * reals[0, p])
    dy += whole * (cosine * reals[0, r + 1] - sine * reals[0, p + 1])
    ex, ey, ez = _sum(vector, ints, reals, e + PLACES + first, w, second, components, turned)
    ex += whole * reals[0, r + components]
    ey += whole * reals[0, r + components + 1]
    product = dx * ex + dy * ey
    if components == 3:
        dz += whole * (cosine * reals[0, r + 2] - sine * reals[0, p + 2])
        ez += whole * reals[0, r + 5]
        product += dz * ez
    for k in range(first):
        a = cosine * reals[0, weight + 2 * k] - sine * reals[0, weight + 2 * k + 1]
        values[g], values[g + 1], values[g + 2] = a * ex, a * ey, a * ez
        g += components
    for k in range(second):
        _spread(values, g, reals, w + (1 + turned) * k, components, turned, dx, dy, dz)
        g += components
    return product


@_inline
def _blocks(x_values, x, reals, weight, other, turned, components, multiplier):
    """−λ C_kᵀ C_l as values, and where they end: the diagonal, or all four of a turned block."""
    a, p = reals[0, weight], reals[0, other]
    if turned != 0:
        b, q = reals[0, weight + 1], reals[0, other + 1]
        even = -multiplier * (a * p + b * q)
        odd = -multiplier * (a * q - b * p)
        x_values[x], x_values[x + 1] = even, -odd
        x_values[x + 2], x_values[x + 3] = odd, even
        x += 4
    else:
        tangent = -multiplier * a * p
        for c in range(components):
            x_values[x + c] = tangent
        x += components
    return x


@_once
def _line(u, ints, reals, e):
    """L of an element, and L·L."""
    components, r = ints[0, e + COMPONENTS], ints[0, e + REALS]
    dx, dy, dz = _sum(
        u, ints, reals, e + PLACES, ints[0, e + WEIGHTS], ints[0, e + FIRST], components,
        ints[0, e + TURNED],
    )  # fmt: skip
    dx += reals[0, r]
    dy += reals[0, r + 1]
    square = dx * dx + dy * dy
    if components == 3:
        dz += reals[0, r + 2]
        square += dz * dz
    return dx, dy, dz, square


@_inline
def _row(t, u, multipliers, ints, reals, e, force, phi, x_values, g_values):
    """Φ = ½ (L·L − c), or L·K + b·u − law(t)."""
    components, turned = ints[0, e + COMPONENTS], ints[0, e + TURNED]
    first, second, at = ints[0, e + FIRST], ints[0, e + SECOND], e + PLACES
    x, weight, row = ints[0, e + X_START], ints[0, e + WEIGHTS], ints[0, e + ROW]
    law, multiplier = u.dtype.type(0), multipliers[row]
    if ints[0, e + GIVEN] == LAW:
        law = _law(t, reals, ints[0, e + PARAMETERS], _VALUE)
    elif ints[0, e + GIVEN] > 0:
        law = reals[0, ints[0, e + PARAMETERS]]
    product = _gradient(u, u.dtype.type(1), ints, reals, e, g_values)
    g = _push(multiplier, ints, e, force, g_values)
    is_square = ints[0, e + KIND] == SQUARE
    phi[row] = u.dtype.type(0.5) * (product - law) if is_square else product - law
    for k in range(ints[0, e + SINGLE]):
        force[ints[0, at + first + second + k]] += multiplier * g_values[g + k]
    others, skipped = (first, 0) if is_square else (second, first)
    for k in range(first):
        w = weight + (1 + turned) * k
        for j in range(others):
            other = weight + (1 + turned) * (skipped + j)
            x = _blocks(x_values, x, reals, w, other, turned, components, multiplier)
            if not is_square:
                x = _blocks(x_values, x, reals, other, w, turned, components, multiplier)


@_once
def _push(multiplier, ints, e, force, g_values):
    """Add λ times the columns of G of the vectors of a row; where those of coordinates begin."""
    components, g = ints[0, e + COMPONENTS], ints[0, e + G_START]
    for k in range(ints[0, e + FIRST] + ints[0, e + SECOND]):
        i = ints[0, e + PLACES + k]
        for c in range(components):
            force[i + c] += multiplier * g_values[g + c]
        g += components
    return g


@_part
def _driven(t, u, multipliers, ints, reals, e, force, phi, x_values, g_values):
    """The row of a driven angle."""
    components, first, row = ints[0, e + COMPONENTS], ints[0, e + FIRST], ints[0, e + ROW]
    x, g, weight = ints[0, e + X_START], ints[0, e + G_START], ints[0, e + WEIGHTS]
    stride = 1 + ints[0, e + TURNED]
    real, multiplier = u.dtype.type, multipliers[row]
    angle = _law(t, reals, ints[0, e + PARAMETERS], _VALUE)
    sine, cosine = sine_cosine(angle, real)
    phi[row] = _angular_gradient(u, real(1), cosine, sine, ints, reals, e, g_values, g)
    _push(multiplier, ints, e, force, g_values)
    for k in range(first):
        w = weight + 2 * k
        turning = cosine * reals[0, w] - sine * reals[0, w + 1]
        for j in range(ints[0, e + SECOND]):
            tangent = -multiplier * turning * reals[0, weight + 2 * first + stride * j]
            for c in range(2 * components):
                x_values[x + c] = tangent
            x += 2 * components


@_once
def _line_force(u, v, ints, reals, e, force, x_values, y_values):
    """A force −tension L with the tangent −L mᵀ − tension, or that of a torque, across L."""
    kind, components, turned = ints[0, e + KIND], ints[0, e + COMPONENTS], ints[0, e + TURNED]
    parameter, weight = ints[0, e + PARAMETERS], ints[0, e + WEIGHTS]
    first, at = ints[0, e + FIRST], e + PLACES
    real = u.dtype.type
    one, two = real(1), real(2)
    dx, dy, dz, square = _line(u, ints, reals, e)
    damping, tension, mx, my, mz = real(0), real(0), real(0), real(0), real(0)
    if kind == TORQUE:  # the virtual work of τ through the angle of L
        torque = reals[0, parameter] / square
        txx = two * torque * dx * dy / square
        txy = torque * (dy * dy - dx * dx) / square
        pull, tangent = (-torque * dy, torque * dx), (txx, txy, txy, -txx)
    else:
        if kind == SPRING:
            length = np.sqrt(square)
            tension = reals[0, parameter] * (one - reals[0, parameter + 1] / length)
            rank = reals[0, parameter] * reals[0, parameter + 1] / (length * square)
            mx, my, mz = rank * dx, rank * dy, rank * dz
        else:
            wx, wy, wz = _sum(v, ints, reals, at, weight, first, components, turned)
            damping = reals[0, parameter] / square
            product = dx * wx + dy * wy + dz * wz
            tension, twice = damping * product, two * product / square
            mx = damping * (wx - twice * dx)
            my = damping * (wy - twice * dy)
            mz = damping * (wz - twice * dz)
        # In space the compiler drops these, but counts of operations have them.
        pull, txx, tyy = (-tension * dx, -tension * dy), -tension - mx * dx, -tension - my * dy
        txy, tyx = -mx * dy, -mx * dy
        if kind == DAMPER:
            txy, tyx = -dx * my, -dy * mx
        tangent = (txx, txy, tyx, tyy)
    if turned != 0:
        line = dx, dy
        _spread_turned(ints, reals, e, pull, tangent, line, damping, force, x_values, y_values)
    else:
        spatial, rank_one = (dx, dy, dz), (mx, my, mz)
        _spread_plain(ints, reals, e, tension, spatial, rank_one, square, force, x_values, y_values)


@_once
def _spread_turned(ints, reals, e, pull, tangent, line, damping, force, x_values, y_values):
    """A force on L of the plane, its tangent T, and −damping L Lᵀ, for all terms of L."""
    first, weight, at = ints[0, e + FIRST], ints[0, e + WEIGHTS], e + PLACES
    x, y = ints[0, e + X_START], ints[0, e + Y_START]
    (fx, fy), (txx, txy, tyx, tyy), (dx, dy) = pull, tangent, line
    for k in range(first):
        i, a, b = ints[0, at + k], reals[0, weight + 2 * k], reals[0, weight + 2 * k + 1]
        force[i] += a * fx + b * fy
        force[i + 1] += a * fy - b * fx
        # Rows of C_kᵀ T, and C_kᵀ L
        sxx, sxy = a * txx + b * tyx, a * txy + b * tyy
        syx, syy = a * tyx - b * txx, a * tyy - b * txy
        px, py = a * dx + b * dy, a * dy - b * dx
        for j in range(first):
            a, b = reals[0, weight + 2 * j], reals[0, weight + 2 * j + 1]
            x_values[x] = -(sxx * a + sxy * b)
            x_values[x + 1] = -(sxy * a - sxx * b)
            x_values[x + 2] = -(syx * a + syy * b)
            x_values[x + 3] = -(syy * a - syx * b)
            x += 4
            if ints[0, e + KIND] == DAMPER:
                qx, qy = a * dx + b * dy, a * dy - b * dx
                y_values[y] = damping * px * qx
                y_values[y + 1] = damping * px * qy
                y_values[y + 2] = damping * py * qx
                y_values[y + 3] = damping * py * qy
                y += 4


@_once
def _spread_plain(ints, reals, e, tension, line, rank_one, square, force, x_values, y_values):
    """The force −tension L in space, and its tangents, for all terms of L."""
    first, weight, at = ints[0, e + FIRST], ints[0, e + WEIGHTS], e + PLACES
    x, y = ints[0, e + X_START], ints[0, e + Y_START]
    (dx, dy, dz), (mx, my, mz) = line, rank_one
    for k in range(first):
        i, a = ints[0, at + k], reals[0, weight + k]
        force[i] -= a * tension * dx
        force[i + 1] -= a * tension * dy
        force[i + 2] -= a * tension * dz
        for j in range(first):
            both = a * reals[0, weight + j]
            x_values[x] = both * (dx * mx + tension)
            x_values[x + 1], x_values[x + 2] = both * dx * my, both * dx * mz
            x_values[x + 3], x_values[x + 5] = both * dy * mx, both * dy * mz
            x_values[x + 4] = both * (dy * my + tension)
            x_values[x + 6], x_values[x + 7] = both * dz * mx, both * dz * my
            x_values[x + 8] = both * (dz * mz + tension)
            x += 9
            if ints[0, e + KIND] == DAMPER:
                both = both * reals[0, ints[0, e + PARAMETERS]] / square
                y_values[y] = both * dx * dx
                y_values[y + 1], y_values[y + 2] = both * dx * dy, both * dx * dz
                y_values[y + 3], y_values[y + 5] = both * dy * dx, both * dy * dz
                y_values[y + 4] = both * dy * dy
                y_values[y + 6], y_values[y + 7] = both * dz * dx, both * dz * dy
                y_values[y + 8] = both * dz * dz
                y += 9


@_compile
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """Force f + Gλ, constraints Φ, and the values of X, Y, G, of the kinds before `COUPLE`.

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
    force[:] = 0
    # Constants in the precision of the state: others would raise that of their terms.
    zero, half = u.dtype.type(0), u.dtype.type(0.5)
    e = np.int64(0)  # a literal would compile what it is handed to once more
    while e < ints.shape[1]:
        kind, parameter, begin, at = ints[0, e + KIND], ints[0, e + PARAMETERS], e, e + PLACES
        if kind == LINK:
            r, weight, first = ints[0, e + REALS], ints[0, e + WEIGHTS], ints[0, e + FIRST]
            x, g, row = ints[0, e + X_START], ints[0, e + G_START], ints[0, e + ROW]
            e = at + first
            multiplier, dx, dy = multipliers[row], zero, zero
            for k in range(first):
                i, a = ints[0, at + k], reals[0, weight + k]
                px, py = a * u[i], a * u[i + 1]
                dx, dy = (px, py) if k == 0 else (dx + px, dy + py)
            dx += reals[0, r]
            dy += reals[0, r + 1]
            phi[row] = half * (dx * dx + dy * dy - reals[0, parameter])
            for k in range(first):
                i, a = ints[0, at + k], reals[0, weight + k]
                g_values[g + 2 * k] = a * dx
                g_values[g + 2 * k + 1] = a * dy
                force[i] += multiplier * a * dx
                force[i + 1] += multiplier * a * dy
                for j in range(first):
                    tangent = -multiplier * a * reals[0, weight + j]
                    x_values[x] = tangent
                    x_values[x + 1] = tangent
                    x += 2
            continue
        e += ints[0, e + SIZE]
        if kind == LOAD:
            for c in range(ints[0, begin + COMPONENTS]):
                force[ints[0, at] + c] += reals[0, parameter + c]
        elif kind in (SQUARE, PRODUCT):
            _row(t, u, multipliers, ints, reals, begin, force, phi, x_values, g_values)
        elif kind == ANGLE:
            _driven(t, u, multipliers, ints, reals, begin, force, phi, x_values, g_values)
        elif kind in (SPRING, DAMPER, TORQUE):
            _line_force(u, v, ints, reals, begin, force, x_values, y_values)


@_part
def _along(vector, ints, reals, e, columns):
    """The columns (k,) of G of the vectors of the row at e, times a vector (n,)."""
    total, components = vector.dtype.type(0), ints[0, e + COMPONENTS]
    for k in range(columns.shape[0]):
        place = ints[0, e + PLACES + k // components]
        total += columns[k] * vector[place + k % components]
    return total


@_part
def _couple(u, multipliers, ints, reals, e, force, phi, x_values, g_values):
    """The angle of a vector as a coordinate."""
    one, g, x = u.dtype.type(1), ints[0, e + G_START], ints[0, e + X_START]
    entries = 2 * ints[0, e + SECOND]
    place, row = ints[0, e + PLACES + ints[0, e + SECOND]], ints[0, e + ROW]
    multiplier = multipliers[row]
    sine, cosine = sine_cosine(u[place], u.dtype.type)
    turned = _angular_gradient(u, one, -sine, cosine, ints, reals, e, g_values, g)
    for k in range(entries):  # in row and column of the angle
        x_values[x + 2 * k] = x_values[x + 2 * k + 1] = -multiplier * g_values[g + k]
    phi[row] = _angular_gradient(u, one, cosine, sine, ints, reals, e, g_values, g)
    _push(multiplier, ints, e, force, g_values)
    g_values[g + entries] = turned
    force[place] += multiplier * turned
    x_values[x + 2 * entries] = multiplier * phi[row]


@_part
def _twist(u, v, ints, reals, e, force, x_values, y_values):
    """A torque on a sum of angles."""
    count, w, parameter = ints[0, e + SINGLE], ints[0, e + WEIGHTS], ints[0, e + PARAMETERS]
    wound, turning = u.dtype.type(-reals[0, parameter]), u.dtype.type(0)
    for k in range(count):
        wound += reals[0, w + k] * u[ints[0, e + PLACES + k]]
        turning += reals[0, w + k] * v[ints[0, e + PLACES + k]]
    stiffness, damping = reals[0, parameter + 1], reals[0, parameter + 2]
    torque = -stiffness * wound - damping * turning
    x, y = ints[0, e + X_START], ints[0, e + Y_START]
    for k in range(count):
        force[ints[0, e + PLACES + k]] += reals[0, w + k] * torque
        for j in range(count):
            x_values[x] = stiffness * reals[0, w + k] * reals[0, w + j]
            y_values[y] = damping * reals[0, w + k] * reals[0, w + j]
            x += 1
            y += 1


@_part_allocating
def _moment(u, ints, reals, e, force, x_values):
    """A torque τ on a body: ½ τ × d_i on each director, τ in global axes or in its own."""
    p, place, x = ints[0, e + PARAMETERS], ints[0, e + PLACES], ints[0, e + X_START]
    follows, half = ints[0, e + KIND] == FOLLOWER, u.dtype.type(0.5)
    torque = np.zeros(3, u.dtype)
    for c in range(3):
        for j in range(3):
            if follows:
                torque[c] += half * reals[0, p + j] * u[place + 3 * j + c]
        if not follows:
            torque[c] += half * reals[0, p + c]
    for i in range(3):
        for c in range(3):
            d, f = (c + 1) % 3, (c + 2) % 3
            force[place + 3 * i + c] += (
                torque[d] * u[place + 3 * i + f] - torque[f] * u[place + 3 * i + d]
            )
        for j in range(3):
            if follows or i == j:
                for c in range(3):  # −∂(τ × d_i)/∂d_j is [τ_j d_i]×, and −[τ]× where i = j
                    turning = u.dtype.type(0)
                    if follows:
                        turning += half * reals[0, p + j] * u[place + 3 * i + c]
                    if i == j:
                        turning -= torque[c]
                    # Places (c + 1, c + 2) and (c + 2, c + 1) of [r]×.
                    x_values[x] = -turning
                    x_values[x + 1] = turning
                    x += 2


@_part_allocating
def _angle(u, ints, reals, e):
    """Sine and cosine of the angle of a hinge, times what they have in common; Q, P and K."""
    first, components = ints[0, e + FIRST], ints[0, e + COMPONENTS]
    r, w = ints[0, e + REALS], ints[0, e + WEIGHTS]
    q, b, p = np.empty(3, u.dtype), np.empty(3, u.dtype), np.empty(3, u.dtype)
    sine, cosine = u.dtype.type(0), u.dtype.type(0)
    for c in range(components):
        q[c], b[c], p[c] = reals[0, r + c], reals[0, r + 3 + c], reals[0, r + 6 + c]
        for k in range(first):
            i = ints[0, e + PLACES + k]
            q[c] += reals[0, w + 2 * k] * u[i + c]
            p[c] += reals[0, w + 2 * k + 1] * u[i + c]
        for k in range(ints[0, e + SECOND]):
            b[c] += reals[0, w + 2 * first + k] * u[ints[0, e + PLACES + first + k] + c]
        sine += q[c] * b[c]
        cosine += p[c] * b[c]
    return sine, cosine, q, p, b


@_part_allocating
def _hinge(u, v, ints, reals, e, force, x_values, y_values):
    """A hinge: the force Q g on both bodies, g = ∂φ/∂u, and its tangents."""
    two = u.dtype.type(2)
    first, weight = ints[0, e + FIRST], ints[0, e + WEIGHTS]
    count = first + ints[0, e + SECOND]
    sine, cosine, q, p, b = _angle(u, ints, reals, e)
    square = sine * sine + cosine * cosine
    of_sine, of_cosine = np.empty((count, 3), u.dtype), np.empty((count, 3), u.dtype)
    g, turned = np.empty((count, 3), u.dtype), np.zeros((count, 3), u.dtype)
    rate = u.dtype.type(0)
    for k in range(count):
        for c in range(3):
            if k < first:
                of_sine[k, c] = reals[0, weight + 2 * k] * b[c]
                of_cosine[k, c] = reals[0, weight + 2 * k + 1] * b[c]
            else:
                of_sine[k, c] = reals[0, weight + first + k] * q[c]
                of_cosine[k, c] = reals[0, weight + first + k] * p[c]
            g[k, c] = (cosine * of_sine[k, c] - sine * of_cosine[k, c]) / square
            rate += g[k, c] * v[ints[0, e + PLACES + k] + c]
    parameter = ints[0, e + PARAMETERS]
    stiffness, damping = reals[0, parameter + 1], reals[0, parameter + 3]
    torque = reals[0, parameter] - damping * rate
    if stiffness != 0:
        angle = np.arctan2(sine.real, cosine.real)
        if np.abs(angle) > np.pi - _WOUND:
            torque = torque + u.dtype.type(np.nan)  # wound further than the angle can tell
        # The derivative of atan2, for what is differentiated by complex steps.
        small = (cosine.real * sine - sine.real * cosine) / (
            cosine.real * cosine + sine.real * sine
        )
        angle = u.dtype.type(angle) + (small - small.real)
        torque = torque - stiffness * (angle - reals[0, parameter + 2])
    hessian = np.empty((count, 3, count, 3), u.dtype)
    for k in range(count):
        for j in range(count):
            mixed = u.dtype.type(0)
            if (k < first) != (j < first):
                of_first, other = 2 * min(k, j), reals[0, weight + first + max(k, j)]
                mixed = other * (
                    cosine * reals[0, weight + of_first] - sine * reals[0, weight + of_first + 1]
                )
            for c in range(3):
                for d in range(3):
                    entry = of_sine[k, c] * of_cosine[j, d] - of_cosine[k, c] * of_sine[j, d]
                    if c == d:
                        entry += mixed
                    along = cosine * of_cosine[j, d] + sine * of_sine[j, d]
                    hessian[k, c, j, d] = (entry - two * g[k, c] * along) / square
                    turned[k, c] += hessian[k, c, j, d] * v[ints[0, e + PLACES + j] + d]
    x, y = ints[0, e + X_START], ints[0, e + Y_START]
    for k in range(count):
        i = ints[0, e + PLACES + k]
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


@_part_allocating
def _accumulate_further(
    t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
):
    """What `evaluate` leaves out: elements that few mechanisms have."""
    e = np.int64(0)
    while e < ints.shape[1]:
        kind = ints[0, e + KIND]
        if kind == COUPLE:
            _couple(u, multipliers, ints, reals, e, force, phi, x_values, g_values)
        elif kind == FORCE:
            p, w = ints[0, e + PARAMETERS], ints[0, e + WEIGHTS]
            law = _law(t, reals, p + 2, _VALUE)
            fx, fy = reals[0, p] * law, reals[0, p + 1] * law
            for k in range(ints[0, e + FIRST]):
                i, a, b = ints[0, e + PLACES + k], reals[0, w + 2 * k], reals[0, w + 2 * k + 1]
                force[i] += a * fx + b * fy
                force[i + 1] += a * fy - b * fx
        elif kind == TWIST:
            _twist(u, v, ints, reals, e, force, x_values, y_values)
        elif kind in (MOMENT, FOLLOWER):
            _moment(u, ints, reals, e, force, x_values)
        elif kind == HINGE:
            _hinge(u, v, ints, reals, e, force, x_values, y_values)
        e += ints[0, e + SIZE]


@_compile_allocating
def evaluate_all(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate`, of all kinds of elements."""
    evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
    _accumulate_further(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)


@_compile_allocating
def evaluate_timed(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate_all`, of a table with laws behind its elements."""
    now, frozen = reals.dtype.type(0), at_time(t, ints, reals)
    evaluate_all(now, u, v, multipliers, ints, frozen, force, phi, x_values, y_values, g_values)


@_compile
def constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """Terms of Φ' and Φ'' besides Gᵀ v and Gᵀ u'', and the tangents of both to u.

    Not of `ANGLE` and `COUPLE`.

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
    zero, two, e = u.dtype.type(0), u.dtype.type(2), np.int64(0)
    while e < ints.shape[1]:
        kind, row, begin = ints[0, e + KIND], ints[0, e + ROW], e
        e += ints[0, e + SIZE]
        if kind in QUADRATIC:
            # Φ'' and the tangents are Φ and G of v and w.
            product = zero
            for k in range(2):
                vector, values = (w, acceleration_values) if k == 0 else (v, rate_values)
                product = _gradient(vector, zero, ints, reals, begin, values)
            rate[row], curvature[row] = zero, product if kind != PRODUCT else two * product
            if ints[0, begin + GIVEN] == LAW:
                parameters = ints[0, begin + PARAMETERS]
                rate[row] = -_law(t, reals, parameters, _RATE)
                curvature[row] -= _law(t, reals, parameters, _SECOND)


@_part_allocating
def _turn(u, v, w, angle, turn, faster, ints, reals, e, rate, curvature, rates, accelerations):
    """A row of an angle with its rates: N = cos θ Q − sin θ P, N' and N''."""
    one, zero, two = u.dtype.type(1), u.dtype.type(0), u.dtype.type(2)
    row, g = ints[0, e + ROW], ints[0, e + G_START]
    size = ints[0, e + COMPONENTS] * (ints[0, e + FIRST] + ints[0, e + SECOND])
    sine, cosine = sine_cosine(angle, u.dtype.type)
    # N at w and v, N' and N'' at u, N' at v.
    columns, products = np.empty((5, size), u.dtype), np.empty(5, u.dtype)
    vectors, wholes = (w, v, u, u, v), (zero, zero, one, one, zero)
    cosines, sines = (cosine, cosine, -sine, -cosine, -sine), (sine, sine, cosine, -sine, cosine)
    for k in range(5):
        products[k] = _angular_gradient(
            vectors[k], wholes[k], cosines[k], sines[k], ints, reals, e, columns[k], np.int64(0)
        )
    by_angle, again, turned = products[2], products[3], products[4]
    mixed, bent = _along(v, ints, reals, e, columns[2]), _along(v, ints, reals, e, columns[3])
    for i in range(size):
        rates[g + i] = columns[1, i] + turn * columns[2, i]
        accelerations[g + i] = columns[0, i] + (
            faster * columns[2, i] + turn * turn * columns[3, i]
        )
        accelerations[g + i] += two * turn * columns[4, i]
    curvature[row] = two * products[1] + two * turn * mixed
    curvature[row] += turn * turn * again
    if ints[0, e + KIND] == ANGLE:
        rate[row] = turn * by_angle
        curvature[row] += faster * by_angle
    else:  # the angle is a coordinate, with a column of its own
        rate[row] = zero
        rates[g + size] = mixed + turn * again
        pushed = _along(w, ints, reals, e, columns[2])
        accelerations[g + size] = (
            pushed + faster * again + two * turned + two * turn * bent - turn * turn * by_angle
        )


@_compile_allocating
def all_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same of all kinds of elements."""
    constraint_derivatives(
        t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
    )
    e = np.int64(0)
    while e < ints.shape[1]:
        angle, turn, faster = u.dtype.type(0), u.dtype.type(0), u.dtype.type(0)
        if ints[0, e + KIND] == COUPLE:
            place = ints[0, e + PLACES + ints[0, e + SECOND]]
            angle, turn, faster = u[place], v[place], w[place]
        elif ints[0, e + KIND] == ANGLE:
            parameters = ints[0, e + PARAMETERS]
            angle = _law(t, reals, parameters, _VALUE)
            turn = _law(t, reals, parameters, _RATE)
            faster = _law(t, reals, parameters, _SECOND)
        if ints[0, e + KIND] in ANGULAR:
            _turn(
                u, v, w, angle, turn, faster, ints, reals, e, rate, curvature, rate_values,
                acceleration_values,
            )  # fmt: skip
        e += ints[0, e + SIZE]


@_compile_allocating
def timed_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same of a table with laws behind its elements."""
    now, frozen = reals.dtype.type(0), at_time(t, ints, reals)
    all_constraint_derivatives(
        now, u, v, w, ints, frozen, rate, curvature, rate_values, acceleration_values
    )


@_compile_allocating
def potential(t, u, v, ints, reals):
    """Potential energy of springs, torsion springs and loads (J): ½ k (|L| − l)², −F·P.

    Args:
        t: Time (s).
        u, v: (n,) coordinates and velocities; v is not used.
        ints, reals: Element tables, see the module.
    """
    energy, e = 0.0, np.int64(0)
    while e < ints.shape[1]:
        kind, components, turned = ints[0, e + KIND], ints[0, e + COMPONENTS], ints[0, e + TURNED]
        r, p, at = ints[0, e + REALS], ints[0, e + PARAMETERS], e + PLACES
        weight, count = ints[0, e + WEIGHTS], ints[0, e + FIRST]
        if kind == LOAD:
            work = 0.0
            for c in range(components):
                work += reals[0, p + c] * u[ints[0, at] + c]
            energy -= work
        elif kind in (SPRING, FORCE):
            x, y, z = _sum(u, ints, reals, at, weight, count, components, turned)
            if kind == SPRING:
                x += reals[0, r]
                y += reals[0, r + 1]
                if components == 3:
                    z += reals[0, r + 2]
                stretch = np.sqrt(x * x + y * y + z * z) - reals[0, p + 1]
                energy += reals[0, p] * stretch * stretch / 2
            else:
                energy -= (reals[0, p] * x + reals[0, p + 1] * y) * _law(t, reals, p + 2, _VALUE)
        elif kind == TWIST:
            wound = -reals[0, p]
            for k in range(ints[0, e + SINGLE]):
                wound += reals[0, weight + k] * u[ints[0, at + k]]
            energy += reals[0, p + 1] * wound * wound / 2
        elif kind == HINGE:
            sine, cosine, _q, _p, _b = _angle(u, ints, reals, e)
            wound = np.arctan2(sine, cosine) - reals[0, p + 2]
            energy += reals[0, p + 1] * wound * wound / 2
        e += ints[0, e + SIZE]
    return energy


@_compile_allocating
def timed_potential(t, u, v, ints, reals):
    """The same as `potential`, of a table with laws behind its elements."""
    return potential(reals.dtype.type(0), u, v, ints, at_time(t, ints, reals))
