"""A mechanism with every element, and elements as their documentation describes them."""

from contextlib import contextmanager
from fractions import Fraction

import numpy as np
import pytest

from newmark_cli.mechanisms import elements, loading, timed
from newmark_cli.support.documents import parse

_EVERYTHING = """\
points:
  A: {fixed: [0, 0]}
  W: {fixed: [2, 2]}
  B: {at: [0.3, 0.4]}
  C: {at: [0.9, 1.2], mass: 2}
  S: {at: [1.5, 0.5], mass: 1}
bodies:
  one: {from: A, to: B, length: 0.5, mass: 3, centre: [0.2, 0.1], inertia: 0.5}
  two: {from: B, to: C, length: 1, mass: 4, centre: [0.5, -0.2], inertia: 0.25}
body_points:
  P: {on: one, at: [0.25, 0.3]}
  Q: {on: two, at: [0.75, -0.1]}
bars:
  fixed on bodies: {from: P, to: S, length: LENGTH}
sliders:
  rail: {point: S, through: [1, 0], direction: [1, 1]}
springs:
  spring: {from: P, to: Q, stiffness: 7, rest_length: 0.3}
dampers:
  damper: {from: W, to: Q, damping: 3}
  between: {from: P, to: C, damping: 2}
torques:
  motor: {on: two, torque: 1.5}
MOTIONS
gravity: [1, -9]
project_velocities: true
"""

_MOTIONS = "motions: {crank: {body: one, angle: {rate: 2, amplitude: 0.1, frequency: 5}}}"


def built(text, name="mechanism"):
    """The problem of a mechanism from the text of its file."""
    return loading.built(name, parse(text, f"{name}.yaml"))


def everything(driven=True):
    """The mechanism, moving; without its law of time its constraints are quadratic in u."""
    along = (0.3 + 0.4j) / 0.5
    length = abs(1.5 + 0.5j - (0.25 + 0.3j) * along)
    text = _EVERYTHING.replace("LENGTH", repr(length)).replace(
        "MOTIONS", _MOTIONS if driven else ""
    )
    if not driven:
        text = text.replace("mass: 1}", "mass: 1, velocity: [0.5, 0.5]}")
    return built(text, "everything")


def complex_terms(problem, t, u, v, multipliers):
    """f + Gλ and Φ of complex states."""
    pattern, ints, reals = problem.pattern, problem.ints, problem.reals
    sizes = map(len, (pattern.x_rows, pattern.y_rows, pattern.g_rows))
    force, phi = np.zeros(problem.n, complex), np.zeros(problem.m, complex)
    given = (
        t, u.astype(complex), v.astype(complex), multipliers, ints, reals, force, phi,
        *(np.zeros(size, complex) for size in sizes),
    )  # fmt: skip
    with interpreted():
        elements.evaluate_all(*given)
    return force, phi


@contextmanager
def interpreted():
    """Elements and their laws by Python, but for sines, which NumPy rounds otherwise."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (elements, timed):
            for name, function in vars(module).items():
                if hasattr(function, "py_func") and name != "sine_cosine":
                    patch.setattr(module, name, function.py_func)
        yield patch


def exact_phi(problem, u):
    """Φ of quadratic constraints in rational arithmetic; u are fractions."""
    phi, ints, e = [Fraction(0)] * problem.m, problem.ints[0].tolist(), 0
    numbers = [Fraction(x) for x in problem.reals[0].tolist()]
    while e < len(ints):
        header, end = ints[e : e + elements.PLACES], e + ints[e + elements.SIZE]
        places = iter(ints[e + elements.PLACES : end])
        e = end
        square = header[elements.KIND] == elements.SQUARE
        if not square and header[elements.KIND] != elements.PRODUCT:
            continue
        sums, axes = header[elements.SUMS], header[elements.AXES]
        constants = iter(numbers[header[elements.REALS] :])
        weights = iter(numbers[header[elements.WEIGHTS] :])
        value = -numbers[header[elements.PARAMETERS]] if header[elements.GIVEN] else 0
        factors = []
        for count in header[elements.FIRST : elements.SINGLE]:
            at = [next(places) for _ in range(count)]
            factors.append([next(constants, 0) for _ in range(sums * axes)])
            for q in range(sums):
                of_sum = [next(weights) for _ in range(count)]
                for c in range(axes):
                    terms = (a * u[place + c] for a, place in zip(of_sum, at, strict=True))
                    factors[-1][axes * q + c] += sum(terms)
        value += sum(x * y for x, y in zip(factors[0], factors[0 if square else 1], strict=True))
        value += sum(next(weights) * u[next(places)] for _ in range(header[elements.SINGLE]))
        phi[header[elements.ROW]] = value / 2 if square else value
    return phi
