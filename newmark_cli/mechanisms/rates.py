"""Rates of the constraints of `newmark_cli.mechanisms.elements`, and the energy of its forces."""

from typing import Any

import numpy as np

from newmark_cli.mechanisms.elements import (
    ACCELERATION,
    ANGLE,
    ANGULAR,
    AXES,
    COUPLE,
    FIRST,
    FORCE,
    G_START,
    GIVEN,
    HINGE,
    KIND,
    LAW,
    LOAD,
    PARAMETERS,
    PLACES,
    PLAIN,
    QUADRATIC,
    RATE,
    ROW,
    SECOND,
    SINGLE,
    SIZE,
    SPRING,
    SQUARE,
    STRETCH,
    TURNED,
    TWIST,
    VALUE,
    WEIGHTS,
    first_sums,
    gradient_of,
    hinge_angle,
    shape_of,
    times_columns,
)
from newmark_cli.mechanisms.timed import at_time, interval, law, sine_cosine
from newmark_cli.support.cached_code import cached_njit, part_njit

_OPTIONS: Any = {"nogil": True, "error_model": "numpy"}
_compile, _compile_allocating = cached_njit(**_OPTIONS, _nrt=False), cached_njit(**_OPTIONS)


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
    turn = (PLAIN, zero, zero)
    while e < ints.shape[1]:
        kind, row, begin = ints[0, e + KIND], ints[0, e + ROW], e
        e += ints[0, e + SIZE]
        if kind in QUADRATIC:
            # Φ'' and the tangents are Φ and G of v and w.
            g, product = ints[0, begin + G_START], zero
            for k in range(2):
                vector, values = (w, acceleration_values) if k == 0 else (v, rate_values)
                product = gradient_of(vector, zero, turn, ints, reals, begin, values, g)
            rate[row], curvature[row] = zero, product if kind == SQUARE else two * product
            if ints[0, begin + GIVEN] == LAW:
                parameters = ints[0, begin + PARAMETERS]
                rate[row] = -law(t, reals, parameters, RATE)
                curvature[row] -= law(t, reals, parameters, ACCELERATION)


@part_njit(**_OPTIONS)
def _turn(u, v, w, angle, turn, faster, ints, reals, e, rate, curvature, rates, accelerations):
    """A row of an angle with its rates: N = cos θ Q − sin θ P, N' and N''."""
    one, zero, two = u.dtype.type(1), u.dtype.type(0), u.dtype.type(2)
    row, g = ints[0, e + ROW], ints[0, e + G_START]
    size = ints[0, e + AXES] * (ints[0, e + FIRST] + ints[0, e + SECOND])
    sine, cosine = sine_cosine(angle, u.dtype.type)
    # N at w and v, N' and N'' at u, N' at v.
    columns, products = np.empty((5, size), u.dtype), np.empty(5, u.dtype)
    vectors, wholes = (w, v, u, u, v), (zero, zero, one, one, zero)
    cosines, sines = (cosine, cosine, -sine, -cosine, -sine), (sine, sine, cosine, -sine, cosine)
    for k in range(5):
        sides = (TURNED, cosines[k], sines[k])
        products[k] = gradient_of(
            vectors[k], wholes[k], sides, ints, reals, e, columns[k], np.int64(0)
        )
    by_angle, again, turned = products[2], products[3], products[4]
    mixed, bent = (
        times_columns(v, ints, reals, e, columns[2]),
        times_columns(v, ints, reals, e, columns[3]),
    )
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
        pushed = times_columns(w, ints, reals, e, columns[2])
        accelerations[g + size] = (
            pushed + faster * again + two * turned + two * turn * bent - turn * turn * by_angle
        )


@_compile_allocating
def all_constraint_derivatives(
    t, u, v, w, ints, reals, rate, curvature, rate_values, acceleration_values
):
    """The same of all kinds of elements, and of laws of time behind them."""
    t, reals = at_time(t, ints, reals)
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
            angle = law(t, reals, parameters, VALUE)
            turn = law(t, reals, parameters, RATE)
            faster = law(t, reals, parameters, ACCELERATION)
        if ints[0, e + KIND] in ANGULAR:
            _turn(
                u, v, w, angle, turn, faster, ints, reals, e, rate, curvature, rate_values,
                acceleration_values,
            )  # fmt: skip
        e += ints[0, e + SIZE]


@_compile_allocating
def potential(t, u, v, ints, reals):
    """Potential energy of springs, torsion springs and loads (J): ½ k (|L| − l)², −F·P.

    Args:
        t: Time (s).
        u, v: (n,) coordinates and velocities; v is not used.
        ints, reals: Element tables, see the module.
    """
    t, reals = at_time(t, ints, reals)
    energy, e = 0.0, np.int64(0)
    while e < ints.shape[1]:
        kind, p, at = ints[0, e + KIND], ints[0, e + PARAMETERS], e + PLACES
        weight = ints[0, e + WEIGHTS]
        if kind == LOAD:
            work = 0.0
            for c in range(ints[0, e + AXES]):
                work += reals[0, p + c] * u[ints[0, at] + c]
            energy -= work
        elif kind == SPRING:
            x, y, z = first_sums(u, 1.0, (PLAIN, 1.0, 0.0), shape_of(ints, e), ints, reals, e)
            stretch = np.sqrt(x * x + y * y + z * z) - reals[0, p + 1]
            energy += reals[0, p] * stretch * stretch / 2
        elif kind == STRETCH:
            x, y, z = first_sums(u, 1.0, (PLAIN, 1.0, 0.0), shape_of(ints, e), ints, reals, e)
            length = np.sqrt(x * x + y * y + z * z)
            degree = int(reals[0, p + 1])
            r = interval(length, reals, p + 2, int(reals[0, p]), degree + 3)
            behind, work = length - reals[0, r], 0.0
            for k in range(degree, -1, -1):
                work = work * behind + reals[0, r + 2 + k] / (k + 1)
            energy += reals[0, r + 1] + work * behind
        elif kind == FORCE:
            work = 0.0
            for k in range(ints[0, e + SINGLE]):
                work += reals[0, weight + k] * u[ints[0, at + k]]
            energy -= work * law(t, reals, p, VALUE)
        elif kind == TWIST:
            wound = -reals[0, p]
            for k in range(ints[0, e + SINGLE]):
                wound += reals[0, weight + k] * u[ints[0, at + k]]
            energy += reals[0, p + 1] * wound * wound / 2
        elif kind == HINGE:
            size = ints[0, e + AXES] * (ints[0, e + FIRST] + ints[0, e + SECOND])
            gradients = np.empty((2, size))
            sine, cosine = hinge_angle(u, ints, reals, e, gradients[0], gradients[1])
            wound = np.arctan2(sine, cosine) - reals[0, p + 2]
            energy += reals[0, p + 1] * wound * wound / 2
        e += ints[0, e + SIZE]
    return energy
