"""Element loop of all mechanisms, in the plane and in space, compiled once.

An element is a few sums of coordinates, s = A u + a.  A constraint is a row of quadratic data,

    Φ = ½ (Σ s² − c)    or    Φ = Σ s t + b·u − law(t),    t = B u + d,

its column of G is Aᵀ t + Bᵀ s + b, and its tangent X = −λ (Aᵀ B + Bᵀ A).  The factors are kept,
not their products: ½ uᵀQu would round with the size of u.  Φ'' and the tangents of Φ' and Φ'' are
Φ and G of the same row, without what is constant, at the velocities and at the accelerations: see
`rates`.

Most sums come in twos or threes that differ by their axis only: x, y and z of a combination of
points, or of positions and directors.  Their weights stand once, and their places are those of x.
A combination of points of the plane that is turned, too, has a sum for x and one for y, on one
axis, and each coordinate is a place.

A force F conjugate to s loads u with Aᵀ F, and its tangents enter as Aᵀ (…) A.

Both tables have one row.  In ``ints`` each element is a header, see the columns below, and the
places in u of the terms of s, of t, and of b.  In ``reals`` it has a, d, parameters, and weights:
of s, of t, sum by sum, and b.  Where an angle θ turns s, it is cos θ q − sin θ p: each constant
and each weight of s is one of q and one of p.

========  ===================================================================
kind      what it is, and its parameters
========  ===================================================================
LOAD      a constant force on one vector; the force
SQUARE    Φ = ½ (Σ s² − c): a distance, a director of length 1; c
PRODUCT   Φ = Σ s t + b·u − law(t); the law, or a constant, or nothing
ANGLE     Φ = Σ (cos θ q − sin θ p) t, θ = law(t): a driven angle; the law
SPRING    between two points, whose difference is s; stiffness, rest length
DAMPER    damping of the rate of its length
TORQUE    of the plane: a torque through the angle of s; the torque
COUPLE    the same Φ as of `ANGLE`, θ the coordinate behind those of t
FORCE     the force b law(t); the law
TWIST     torque on b·u: value of rest, stiffness, damping
MOMENT    a torque with constant components, on the three directors of a body; these
FOLLOWER  the same with components in the body's axes
HINGE     torque, stiffness, angle of rest and damping about the axis of a joint; its angle
          is φ = atan2(Σ q t, Σ p t), within ±π
STRETCH   a spring whose force is pieces of polynomials in its length, see `spring_laws`
========  ===================================================================

Laws of time may stand behind all elements, see `timed`.
"""

from typing import Any

import numpy as np

from newmark_cli.mechanisms import timed
from newmark_cli.support.cached_code import cached_njit, part_njit

sine_cosine, at_time, _law = timed.sine_cosine, timed.at_time, timed.law
interval = timed.interval
#: Functions by themselves, and parts of others.  In most of them nothing is allocated, so
#: references are not counted: that would take longer than a small mechanism.
_OPTIONS: Any = {"nogil": True, "error_model": "numpy"}
_compile, _compile_allocating = cached_njit(**_OPTIONS, _nrt=False), cached_njit(**_OPTIONS)
_part, _part_allocating = part_njit(**_OPTIONS, _nrt=False), part_njit(**_OPTIONS)
#: Handing on arrays costs time in each call: parts that LLVM inlines.
_inline = part_njit(**_OPTIONS, _nrt=False, forceinline=True)

#: Kinds; those from `COUPLE` on are left to `evaluate_all`.
(
    LOAD, SQUARE, PRODUCT, ANGLE, SPRING, DAMPER, TORQUE, COUPLE, FORCE, TWIST, MOMENT, FOLLOWER,
    HINGE, STRETCH,
) = range(14)  # fmt: skip
#: Kinds that are a constraint, one row each: without and with an angle.
QUADRATIC, ANGULAR = (SQUARE, PRODUCT), (ANGLE, COUPLE)
CONSTRAINTS = (*QUADRATIC, *ANGULAR)
#: Kinds that act through the difference of two points.
ALONG_LINES = (SPRING, DAMPER, TORQUE, STRETCH)

#: Columns of a header: entries of the element in ``ints``, where its numbers begin in ``reals``,
#: its parameters and weights, its row, the first entries in the values of X, Y and G, sums whose
#: weights differ, axes on which each is repeated, parameters, and terms of s, of t and of b.
(
    KIND, SIZE, REALS, PARAMETERS, WEIGHTS, ROW, X_START, Y_START, G_START, SUMS, AXES,
    GIVEN, FIRST, SECOND, SINGLE, PLACES,
) = range(16)  # fmt: skip
#: Parameters of a law of time.
LAW = 6
#: Which derivative of a law: each literal number would compile it once more.
VALUE, RATE, ACCELERATION = np.int64(0), np.int64(1), np.int64(2)
#: How many weights a term of s has: two where an angle turns it.
PLAIN, TURNED = np.int64(1), np.int64(2)
#: The `shape_of` of a distance between points of the plane.
_BAR = (True, np.int64(1), np.int64(2))

#: The angle of a torsion spring jumps at ±π; closer to it than this (rad) there is no force.
_WOUND = 0.05


@_inline
def item(ints, k):
    """An entry of a table of elements that is an index.

    Numba tests signed indices for their sign, which LLVM drops where it sees that there is none.
    """
    return np.int64(np.uint32(ints[0, np.uint32(k)]))


@_inline
def shape_of(ints, e):
    """Whether a row is a square, sums with weights of their own, and axes."""
    return item(ints, e + KIND) == SQUARE, item(ints, e + SUMS), item(ints, e + AXES)


@_inline
def _counts(is_square, turn, ints, e):
    """Terms of s, t and b of a row; an angle that is a coordinate is none of these."""
    none = np.int64(0)
    first = item(ints, e + FIRST)
    if is_square:
        return first, none, none
    return first, item(ints, e + SECOND), none if turn[0] == 2 else item(ints, e + SINGLE)


@_inline
def _weight(reals, weight, turn):
    """A weight of s; turn is how many there are, and cos θ and sin θ where there are two."""
    if turn[0] == 1:
        return reals[0, weight]
    return turn[1] * reals[0, weight] - turn[2] * reals[0, weight + 1]


@_inline
def _sums(vector, whole, turn, shape, ints, reals, place, count, weight, constant):
    """Sums at a vector as x, y and z, from where places, weights and constants begin."""
    _, sums, axes = shape
    x, y, z = vector.dtype.type(0), vector.dtype.type(0), vector.dtype.type(0)
    for k in range(count):
        i, a = item(ints, place + k), _weight(reals, weight + turn[0] * k, turn)
        x += a * vector[i]
        if sums == 2:
            y += reals[0, weight + count + k] * vector[i]
        else:
            y += a * vector[i + 1]
            if axes == 3:
                z += a * vector[i + 2]
    x += whole * _weight(reals, constant, turn)
    y += whole * _weight(reals, constant + turn[0], turn)
    if axes == 3:
        z += whole * _weight(reals, constant + 2 * turn[0], turn)
    return x, y, z


@_inline
def first_sums(vector, whole, turn, shape, ints, reals, e):
    """The sums s of the element at e; 0 for whole leaves out what is constant."""
    return _sums(
        vector, whole, turn, shape, ints, reals, e + PLACES, item(ints, e + FIRST),
        item(ints, e + WEIGHTS), item(ints, e + REALS),
    )  # fmt: skip


@_inline
def _spread(values, g, turn, shape, reals, count, weight, vector):
    """Aᵀ (x, y, z) of the terms as values from g on; where they end."""
    _, sums, axes = shape
    x, y, z = vector
    for k in range(count):
        a = _weight(reals, weight + turn[0] * k, turn)
        if sums == 2:
            values[g] = a * x + reals[0, weight + count + k] * y
        else:
            values[g], values[g + 1] = a * x, a * y
            if axes == 3:
                values[g + 2] = a * z
        g += axes
    return g


@_inline
def gradient(vector, whole, turn, shape, ints, reals, e, values, g):
    """The row at e at a vector: its sum of products, and its column of G as values at its places.

    Args:
        vector: (n,).
        whole: 1; 0 without what is constant or linear in it.
        turn, shape: See `_weight` and `shape_of`.
        ints, reals: Element tables, see the module.
        e: Where the row begins.
        values: Entries of G, of which those of the row are overwritten.
        g: Where the first of them stands.
    """
    is_square, sums, axes = shape
    first, second, single = _counts(is_square, turn, ints, e)
    at, weight, plain = e + PLACES, item(ints, e + WEIGHTS), (PLAIN, turn[1], turn[2])
    behind = weight + turn[0] * sums * first
    product = vector.dtype.type(0)
    if axes > 0:
        s = t = first_sums(vector, whole, turn, shape, ints, reals, e)
        if not is_square:
            constant = item(ints, e + REALS) + turn[0] * sums * axes
            t = _sums(
                vector, whole, plain, shape, ints, reals, at + first, second, behind, constant
            )
        product = s[0] * t[0] + s[1] * t[1]
        if axes == 3:
            product += s[2] * t[2]
        g = _spread(values, g, turn, shape, reals, first, weight, t)
        g = _spread(values, g, plain, shape, reals, second, behind, s)
    for k in range(single):
        b = whole * reals[0, behind + sums * second + k]
        product += b * vector[item(ints, at + first + second + k)]
        values[g + k] = b
    return product


@_inline
def _row(law, turn, shape, u, multipliers, ints, reals, e, results):
    """Φ, G, X and the force of a row; results are force, Φ, and values of X and G."""
    force, phi, x_values, g_values = results
    is_square, sums, axes = shape
    first, second, single = _counts(is_square, turn, ints, e)
    row, x, g = item(ints, e + ROW), item(ints, e + X_START), item(ints, e + G_START)
    at, multiplier = e + PLACES, multipliers[row]
    product = gradient(u, u.dtype.type(1), turn, shape, ints, reals, e, g_values, g) - law
    phi[row] = u.dtype.type(0.5) * product if is_square else product
    for k in range(first + second):
        for c in range(axes):
            force[item(ints, at + k) + c] += multiplier * g_values[g + c]
        g += axes
    for k in range(single):
        force[item(ints, at + first + second + k)] += multiplier * g_values[g + k]
    # X = −λ (Aᵀ B + Bᵀ A), the same on all axes
    weight = item(ints, e + WEIGHTS)
    others, repeats, behind = second, 2 * axes, weight + turn[0] * sums * first
    if is_square:
        others, repeats, behind = first, axes, weight
    for k in range(first):
        a = -multiplier * _weight(reals, weight + turn[0] * k, turn)
        for j in range(others):
            tangent = a * reals[0, behind + j]
            if sums == 2:
                tangent -= multiplier * reals[0, weight + first + k] * reals[0, behind + others + j]
            for i in range(repeats):
                x_values[x + i] = tangent
            x += repeats


@_part
def _turned_row(angle, u, multipliers, ints, reals, e, results):
    """The same of a row that an angle turns."""
    sine, cosine = sine_cosine(angle, u.dtype.type)
    turn, zero = (TURNED, cosine, sine), u.dtype.type(0)
    _row(zero, turn, shape_of(ints, e), u, multipliers, ints, reals, e, results)


@_part
def gradient_of(vector, whole, turn, ints, reals, e, values, g):
    """The `gradient` of any row, not inlined: that would take long to compile."""
    return gradient(vector, whole, turn, shape_of(ints, e), ints, reals, e, values, g)


@_inline
def _block(values, at, shape, reals, weight, other, count, tensor):
    """Aᵀ T A of two terms as values from a place on, T by rows; where they end."""
    both = reals[0, weight] * reals[0, other]
    if shape[1] == 2:
        a, b = reals[0, weight + count], reals[0, other + count]
        values[at] = (
            both * tensor[0] + reals[0, weight] * tensor[1] * b
            + a * tensor[3] * reals[0, other] + a * tensor[4] * b
        )  # fmt: skip
        return at + 1
    values[at], values[at + 1] = both * tensor[0], both * tensor[1]
    if shape[2] == 2:
        values[at + 2], values[at + 3] = both * tensor[3], both * tensor[4]
        return at + 4
    values[at + 2], values[at + 3] = both * tensor[2], both * tensor[3]
    values[at + 4], values[at + 5] = both * tensor[4], both * tensor[5]
    values[at + 6], values[at + 7] = both * tensor[6], both * tensor[7]
    values[at + 8] = both * tensor[8]
    return at + 9


@_part
def _stretched(length, reals, parameter):
    """Force of a spring by its law, and its derivative."""
    count, degree = int(reals[0, parameter]), int(reals[0, parameter + 1])
    r = interval(length.real, reals, parameter + 2, count, degree + 3)
    x = length - reals[0, r]
    push, slope = x - x, x - x
    for k in range(degree, -1, -1):
        slope = slope * x + push
        push = push * x + reals[0, r + 2 + k]
    return push, slope


@_inline
def _along_line(u, v, ints, reals, e, force, x_values, y_values):
    """A spring or a damper, whose force is −tension L, or a torque, across L."""
    kind, first, shape = item(ints, e + KIND), item(ints, e + FIRST), shape_of(ints, e)
    parameter, weight, real = item(ints, e + PARAMETERS), item(ints, e + WEIGHTS), u.dtype.type
    plain = (PLAIN, real(1), real(0))
    x, y, z = first_sums(u, real(1), plain, shape, ints, reals, e)
    square = x * x + y * y + z * z
    tension, damping = real(0), reals[0, parameter] / square
    # The tangent of −F is tension 1 + L mᵀ; that of a torque L mᵀ + m Lᵀ.
    if kind == TORQUE:  # the virtual work of τ through the angle of L
        mx, my, mz = -damping * y / square, damping * x / square, real(0)
    elif kind == SPRING:
        length = np.sqrt(square)
        tension = reals[0, parameter] * (real(1) - reals[0, parameter + 1] / length)
        rank = reals[0, parameter] * reals[0, parameter + 1] / (length * square)
        mx, my, mz = rank * x, rank * y, rank * z
    elif kind == STRETCH:
        length = np.sqrt(square)
        push, slope = _stretched(length, reals, parameter)
        tension, rank = push / length, (slope - push / length) / square
        mx, my, mz = rank * x, rank * y, rank * z
    else:
        wx, wy, wz = first_sums(v, real(0), plain, shape, ints, reals, e)
        product = x * wx + y * wy + z * wz
        tension, twice = damping * product, real(2) * product / square
        mx, my = damping * (wx - twice * x), damping * (wy - twice * y)
        mz = damping * (wz - twice * z)
    pull = (-tension * x, -tension * y, -tension * z)
    tangent = (
        x * mx + tension, x * my, x * mz,
        y * mx, y * my + tension, y * mz,
        z * mx, z * my, z * mz + tension,
    )  # fmt: skip
    if kind == TORQUE:
        none, bend = real(0), x * my + y * mx
        pull = (-damping * y, damping * x, none)
        tangent = (real(2) * x * mx, bend, none, bend, real(2) * y * my, none, none, none, none)
    rates = (
        damping * x * x, damping * x * y, damping * x * z,
        damping * y * x, damping * y * y, damping * y * z,
        damping * z * x, damping * z * y, damping * z * z,
    )  # fmt: skip
    entry, rate_entry = item(ints, e + X_START), item(ints, e + Y_START)
    for k in range(first):
        i, w = item(ints, e + PLACES + k), weight + k
        if shape[1] == 2:
            force[i] += reals[0, w] * pull[0] + reals[0, w + first] * pull[1]
        else:
            force[i] += reals[0, w] * pull[0]
            force[i + 1] += reals[0, w] * pull[1]
            if shape[2] == 3:
                force[i + 2] += reals[0, w] * pull[2]
        for j in range(first):
            entry = _block(x_values, entry, shape, reals, w, weight + j, first, tangent)
            if kind == DAMPER:
                rate_entry = _block(y_values, rate_entry, shape, reals, w, weight + j, first, rates)


@_compile
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """Force f + Gλ, constraints Φ, and the values of X, Y, G.

    Of `STRETCH`, and the kinds before `COUPLE`.

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
    zero, one = u.dtype.type(0), u.dtype.type(1)
    results = (force, phi, x_values, g_values)
    e = np.int64(0)  # a literal would compile what it is handed to once more
    while e < ints.shape[1]:
        kind, parameter, begin = item(ints, e + KIND), item(ints, e + PARAMETERS), e
        e += item(ints, e + SIZE)
        if kind in QUADRATIC:
            turn, shape = (PLAIN, one, zero), shape_of(ints, begin)
            if shape == _BAR:  # the commonest row of the plane: code of its own
                law = reals[0, parameter]
                _row(law, turn, _BAR, u, multipliers, ints, reals, begin, results)
                continue
            law = zero
            if item(ints, begin + GIVEN) == LAW:
                law = _law(t, reals, parameter, VALUE)
            elif item(ints, begin + GIVEN) > 0:
                law = reals[0, parameter]
            _row(law, turn, shape, u, multipliers, ints, reals, begin, results)
        elif kind == LOAD:
            for c in range(item(ints, begin + AXES)):
                force[item(ints, begin + PLACES) + c] += reals[0, parameter + c]
        elif kind == ANGLE:
            angle = _law(t, reals, parameter, VALUE)
            _turned_row(angle, u, multipliers, ints, reals, begin, results)
        elif kind in ALONG_LINES:
            _along_line(u, v, ints, reals, begin, force, x_values, y_values)


@_part
def times_columns(vector, ints, reals, e, columns):
    """The columns (k,) of G of s and t of the row at e, times a vector (n,)."""
    axes, total = item(ints, e + AXES), vector.dtype.type(0)
    for k in range(columns.shape[0]):
        total += columns[k] * vector[item(ints, e + PLACES + k // axes) + k % axes]
    return total


@_part
def _couple(u, multipliers, ints, reals, e, results):
    """The angle of a vector as a coordinate."""
    force, phi, x_values, g_values = results
    x, g = item(ints, e + X_START), item(ints, e + G_START)
    entries = item(ints, e + AXES) * item(ints, e + SECOND)
    place, row = item(ints, e + PLACES + item(ints, e + SECOND)), item(ints, e + ROW)
    sine, cosine = sine_cosine(u[place], u.dtype.type)
    further = (TURNED, -sine, cosine)
    turned = gradient_of(u, u.dtype.type(1), further, ints, reals, e, g_values, g)
    for k in range(entries):  # in row and column of the angle
        x_values[x + 2 * k] = x_values[x + 2 * k + 1] = -multipliers[row] * g_values[g + k]
    _turned_row(u[place], u, multipliers, ints, reals, e, results)
    g_values[g + entries] = turned
    force[place] += multipliers[row] * turned
    x_values[x + 2 * entries] = multipliers[row] * phi[row]


@_part
def _twist(u, v, ints, reals, e, force, x_values, y_values):
    """A torque on a sum of angles."""
    count, w = item(ints, e + SINGLE), item(ints, e + WEIGHTS)
    parameter = item(ints, e + PARAMETERS)
    wound, turning = u.dtype.type(-reals[0, parameter]), u.dtype.type(0)
    for k in range(count):
        wound += reals[0, w + k] * u[item(ints, e + PLACES + k)]
        turning += reals[0, w + k] * v[item(ints, e + PLACES + k)]
    stiffness, damping = reals[0, parameter + 1], reals[0, parameter + 2]
    torque = -stiffness * wound - damping * turning
    x, y = item(ints, e + X_START), item(ints, e + Y_START)
    for k in range(count):
        force[item(ints, e + PLACES + k)] += reals[0, w + k] * torque
        for j in range(count):
            x_values[x] = stiffness * reals[0, w + k] * reals[0, w + j]
            y_values[y] = damping * reals[0, w + k] * reals[0, w + j]
            x += 1
            y += 1


@_part_allocating
def _moment(u, ints, reals, e, force, x_values):
    """A torque τ on a body: ½ τ × d_i on each director, τ in global axes or in its own."""
    p, place, x = item(ints, e + PARAMETERS), item(ints, e + PLACES), item(ints, e + X_START)
    follows, half = item(ints, e + KIND) == FOLLOWER, u.dtype.type(0.5)
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
def hinge_angle(u, ints, reals, e, of_sine, of_cosine):
    """Sine and cosine of a hinge's angle, times what they have in common, and their gradients."""
    one, zero, begin = u.dtype.type(1), u.dtype.type(0), np.int64(0)
    sine = gradient_of(u, one, (TURNED, one, zero), ints, reals, e, of_sine, begin)
    cosine = gradient_of(u, one, (TURNED, zero, -one), ints, reals, e, of_cosine, begin)
    return sine, cosine


@_part_allocating
def _hinge(u, v, ints, reals, e, force, x_values, y_values):
    """A hinge: the force Q g on both bodies, g = ∂φ/∂u, and its tangents."""
    two, weight, at = u.dtype.type(2), item(ints, e + WEIGHTS), e + PLACES
    first, x, y = item(ints, e + FIRST), item(ints, e + X_START), item(ints, e + Y_START)
    axes = item(ints, e + AXES)
    size = axes * (first + item(ints, e + SECOND))
    of_sine, of_cosine = np.empty(size, u.dtype), np.empty(size, u.dtype)
    sine, cosine = hinge_angle(u, ints, reals, e, of_sine, of_cosine)
    square = sine * sine + cosine * cosine
    g, turned = np.empty(size, u.dtype), np.zeros(size, u.dtype)
    for i in range(size):
        g[i] = (cosine * of_sine[i] - sine * of_cosine[i]) / square
    parameter, turn = item(ints, e + PARAMETERS), (TURNED, cosine, sine)
    stiffness, damping = reals[0, parameter + 1], reals[0, parameter + 3]
    torque = reals[0, parameter] - damping * times_columns(v, ints, reals, e, g)
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
    for i in range(size):
        k = i // axes
        force[item(ints, at + k) + i % axes] += torque * g[i]
        for j in range(size):
            # Second derivatives of φ, where the values of X will be.
            entry = of_sine[i] * of_cosine[j] - of_cosine[i] * of_sine[j]
            low, high = min(k, j // axes), max(k, j // axes)
            if i % axes == j % axes and low < first <= high:
                # Terms of s have two weights each, those of t behind them one.
                entry += reals[0, weight + first + high] * _weight(reals, weight + 2 * low, turn)
            along = cosine * of_cosine[j] + sine * of_sine[j]
            entry = (entry - two * g[i] * along) / square
            x_values[x + size * i + j] = entry
            turned[i] += entry * v[item(ints, at + j // axes) + j % axes]
    for i in range(size):
        for j in range(size):
            change = stiffness * g[j] + damping * turned[j]
            x_values[x + j] = g[i] * change - torque * x_values[x + j]
            y_values[y + j] = damping * g[i] * g[j]
        x, y = x + size, y + size


@_compile_allocating
def evaluate_all(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):
    """The same as `evaluate`, of all kinds of elements, and of laws of time behind them."""
    t, reals = at_time(t, ints, reals)
    evaluate(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
    e = np.int64(0)
    while e < ints.shape[1]:
        kind = item(ints, e + KIND)
        if kind == COUPLE:
            results = (force, phi, x_values, g_values)
            _couple(u, multipliers, ints, reals, e, results)
        elif kind == FORCE:
            w, law = item(ints, e + WEIGHTS), _law(t, reals, item(ints, e + PARAMETERS), VALUE)
            for k in range(item(ints, e + SINGLE)):
                force[item(ints, e + PLACES + k)] += reals[0, w + k] * law
        elif kind == TWIST:
            _twist(u, v, ints, reals, e, force, x_values, y_values)
        elif kind in (MOMENT, FOLLOWER):
            _moment(u, ints, reals, e, force, x_values)
        elif kind == HINGE:
            _hinge(u, v, ints, reals, e, force, x_values, y_values)
        e += item(ints, e + SIZE)
