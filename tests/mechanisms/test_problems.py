"""Problems: tangents, mass matrices, consistent starts, the mechanism model."""

import re

import mechanisms
import numpy as np
import oracles
import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import built
from mpmath import mp

from newmark_cli.mechanisms.registry import PROBLEMS, problem
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support.documents import DocumentError

REFERENCED = [name for name in PROBLEMS if name in oracles.REFERENCES]


@each("name", REFERENCED)
@given(st.integers(0, 2**32 - 1))
def test_terms_against_mpmath(name, seed):
    """M, f + Gλ, Φ against the formulas typed again."""
    subject, reference = problem(name), oracles.REFERENCES[name]()
    random = np.random.default_rng(seed)
    u = subject.u0 * (1 + 0.1 * random.normal(size=subject.n)) + 1e-3
    multipliers = random.normal(size=subject.m)
    terms = subject.evaluate(0.0, u, np.zeros(subject.n), multipliers)
    with mp.workdps(oracles.DIGITS):
        exact = [mp.mpf(float(x)) for x in u]
        force = reference.force(exact, [mp.mpf(float(x)) for x in multipliers])
        phi = reference.phi(exact)
        mass = np.array(reference.mass.tolist(), dtype=float)
    force, phi = np.array(force, float), np.array(phi, float)
    np.testing.assert_allclose(subject.M, mass, rtol=1e-13, atol=1e-13 * np.abs(mass).max())
    np.testing.assert_allclose(terms.force, force, rtol=0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(terms.phi, phi, rtol=0, atol=1e-14 * np.sum(u**2))


def test_start_of_andrews():
    """β'' = 14222.4439199541 to 1e-12; the digits of the file are those of the initial angles."""
    subject = problem("andrews")
    a, _ = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    f, df = subject.u0[2:4], a[2:4]
    beta = (f[0] * df[1] - f[1] * df[0]) / (f @ f)
    assert beta == pytest.approx(14222.4439199541, rel=1e-12)
    angles = (
        "-0.0617138900142764496358948458001", 0, "0.455279819163070380255912382449",
        "0.222668390165885884674473185609", "0.487364979543842550225598953530",
        "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
    )  # fmt: skip
    with mp.workdps(40):
        points, _ = oracles.andrews_points(angles, [0] * 7)
    np.testing.assert_array_equal(problem("andrews").u0, [float(x) for x in points])


def test_states_of_any_kind_take_the_compiled_code_that_is_there():
    """Read-only, parts of arrays, in single precision, whole numbers as times."""
    subject = problem("double-pendulum")
    state = [subject.u0, subject.v0 + 0.5, np.ones(subject.m)]
    functions = subject.function, subject.derivatives, subject.potential

    def computed(t, u, v, multipliers):
        values = *subject.values(t, u, v, multipliers), *subject.constraint_rows(t, u, v, v)
        return np.concatenate([*values, subject.energies(t, u, v)])

    expected = computed(0.0, *state)
    compiled = [function.signatures[:] for function in functions]
    fixed = [array.copy() for array in state]
    for array in fixed:
        array.flags.writeable = False
    for kind in (fixed, [np.repeat(a, 2)[::2] for a in state], [a.astype("f4") for a in state]):
        np.testing.assert_array_equal(computed(0, *kind), expected)
    assert [function.signatures for function in functions] == compiled


@pytest.fixture(scope="module")
def everything():
    """A mechanism with every element, driven."""
    return mechanisms.everything()


def test_projected_velocities_fit(everything):
    """They meet Φ' = 0, with the crank at its rate, and are the nearest to the given ones."""
    u, v = everything.u0, everything.v0
    gradient = everything.evaluate(0.0, u, v, np.zeros(everything.m)).G
    rate, _ = everything.constraint_derivatives(0.0, u, v)
    np.testing.assert_allclose(gradient.T @ v + rate, 0, atol=1e-13)
    b, vb = complex(*u[:2]), complex(*v[:2])
    assert (vb / (1j * b)).real == pytest.approx(2 + 0.1 * 5, rel=1e-12)
    # Given as zero: M times the change is in the range of G, so its kinetic energy is the least.
    change = everything.M @ v
    np.testing.assert_allclose(
        gradient @ np.linalg.lstsq(gradient, change, rcond=None)[0], change, atol=1e-12
    )


def test_assembled_positions_meet_the_constraints():
    """The four-bar linkage starts from a guess and ends on its bars to rounding."""
    subject = problem("four-bar")
    guess = [c for p in subject.drawing.points.values() for c in p.at or ()]
    assert np.abs(subject.u0 - guess).max() > 1e-4
    np.testing.assert_allclose(subject.constraint_values(0.0, subject.u0), 0, atol=1e-16)


RECTANGLE = """\
points:
  A: {fixed: [0, 0]}
  B: {fixed: [2, 0]}
  C: {at: [2, 1], mass: 1}
  D: {at: [0, 1], mass: 1}
bars:
  left: {from: A, to: D, length: 1}
  right: {from: B, to: C, length: 1}
  top: {from: D, to: C, length: 2}
"""


@each("change, line, words", [
        (
            ("gravity", "bars:\n", "bars:\n  one: {from: A, to: C, length: 2.23606797749979}\n"
             "  two: {from: B, to: D, length: 2.23606797749979}\n"),
            11, "redundant: these constraints depend on each other: bars.one, bars.two",
        ),
        (
            ("mass", "C: {at: [2, 1], mass: 1}\n  D: {at: [0, 1], mass: 1}",
             "C: {at: [2, 1]}\n  D: {at: [0, 1], mass: 1}\n  E: {at: [1, 1]}"),
            6, "E carries no mass",
        ),
        (
            ("velocity", "D: {at: [0, 1], mass: 1}", "D: {at: [0, 1], mass: 1, velocity: [0, 1]}"),
            7, "initial velocities violate this constraint by",
        ),
        (
            ("slider", "bars:", "sliders:\n  s: {point: C, through: [0, 0], direction: [0, 0]}\n"
             "bars:"), 7, "must not be [0, 0]: it has no direction",
        ),
        (
            ("slider", "bars:", "sliders:\n  s: {point: C, through: [0, 0], direction: [1, 0]}\n"
             "bars:"), 7, "starts 1 m off the line",
        ),
        (("guess", "length: 2}", "length: 9}\nassemble: true"), 10, "no position found"),
        (("motion", "bars:", "motions:\n  m: {point: C}\nbars:"), 7, "needs a point with x or y"),
        (
            ("motion", "bars:", "motions:\n  m: {point: C, x: {value: 3}}\nbars:"),
            7, "the law starts at 3, the mechanism at 2",
        ),
        (("motion", "bars:", "motions:\n  m: {point: A, x: {}}\nbars:"), 7, "A is fixed"),
        (("bars", RECTANGLE[RECTANGLE.index("bars") :], ""), 1, "no constraint"),
    ])  # fmt: skip
def test_inconsistent_starts_are_refused(change, line, words):
    """Singular mass, redundant bars, velocities and positions that do not fit."""
    _, old, new = change
    assert old in RECTANGLE
    with pytest.raises(DocumentError) as caught:
        built(RECTANGLE.replace(old, new), "r")
    assert f"r.yaml, line {line}: " in str(caught.value), str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


_DIAGONALS = (
    "  one: {from: A, to: C, length: 2.23606797749979}\n"
    "  two: {from: B, to: D, length: 2.23606797749979}\n"
)
#: A coupler on three parallel cranks of one length: one is redundant wherever it moves to,
#: although G has full rank off the constraints.
_CRANKS = """\
points:
  A: {fixed: [0, 0]}
  B: {fixed: [2, 0]}
  E: {fixed: [1, 0]}
  D: {at: [0, 1], mass: 1}
  C: {at: [2, 1], mass: 1}
bodies:
  coupler: {from: D, to: C, length: 2, mass: 1, centre: [1, 0], inertia: 1}
body_points:
  M: {on: coupler, at: [1, 0]}
bars:
  left: {from: A, to: D, length: 1}
  right: {from: B, to: C, length: 1}
  middle: {from: E, to: M, length: 1}
"""
#: Two bars in a line between supports: nothing moves, and neither bar is redundant.
_STRETCHED = """\
points:
  A: {fixed: [0, 0]}
  B: {fixed: [2, 0]}
  C: {at: [1, 0], mass: 1}
  D: {at: [5, 0], mass: 1}
bars:
  free: {from: B, to: D, length: 3}
  left: {from: A, to: C, length: 1}
  right: {from: B, to: C, length: 1}
"""
#: Crank and rod in a line, driven at the slider: a dead centre.
_DEAD_CENTRE = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1, 0], mass: 1}
  Q: {at: [3, 0], mass: 1}
bars:
  crank: {from: O, to: P, length: 1}
  rod: {from: P, to: Q, length: 2}
sliders:
  guide: {point: Q, through: [0, 0], direction: [1, 0]}
motions:
  drive: {point: Q, x: {amplitude: 0.1, frequency: 1}}
project_velocities: true
"""
_LINE = RECTANGLE.replace("[2, 1]", "[3, 0]").replace("[0, 1]", "[1, 0]")

_EXACTLY, _NEARBY = ("exact", "assembled"), ("exact", "assembled", "guessed")
#: From a guess the last two start next to the singular position, or not at all.
_DEPENDENT = [
    (RECTANGLE + _DIAGONALS, "line 11: bars.two: redundant: .*, bars.one, bars.two", _NEARBY),
    (
        RECTANGLE + "  again: {from: D, to: C, length: 2}\n",
        "line 10: bars.again: redundant: these constraints depend on each other: "
        "bars.top, bars.again$",
        _NEARBY,
    ),
    (_CRANKS, "line 14: bars.middle: redundant: .*: bars.left, bars.right, bars.middle$", _NEARBY),
    (
        _STRETCHED,
        "line 9: bars.right: the start is a singular position, such as a dead centre: only here do "
        "these constraints depend on each other: bars.left, bars.right; start from another",
        _NEARBY,
    ),
    (
        _LINE,
        "line 9: bars.top: the start is a singular position, .*: bars.left, bars.right, bars.top;",
        _EXACTLY,
    ),
    (
        _DEAD_CENTRE,
        "line 11: motions.drive.x: the start is a singular position, .*: bars.crank, bars.rod, "
        "motions.drive.x; start",
        _EXACTLY,
    ),
]


@each(
    "text, said, start",
    [(text, said, start) for text, said, starts in _DEPENDENT for start in starts],
)
def test_dependent_constraints_are_told_apart(text, said, start):
    """Redundant everywhere, or at this position only; from a guess as from exact positions."""
    if start == "guessed":
        # Every moving point a little off.
        text = re.sub(
            r"at: \[([\d.]+), ([\d.]+)\](?=, mass)",
            lambda found: f"at: [{float(found[1]) + 0.01}, {float(found[2]) + 0.003}]",
            text,
        )
    text += "assemble: true\n" if start != "exact" else ""
    with pytest.raises(DocumentError, match=f"m.yaml, {said}") as caught:
        built(text, "m")
    assert len(caught.value.mistakes) == 1


def test_contradicting_lengths():
    """Named with how far the closest position is from each; midway between two equal bars."""
    again = "  again: {from: D, to: C, length: 2.1}\nassemble: true\n"
    with pytest.raises(DocumentError) as caught:
        built(RECTANGLE + again, "m")
    found = re.fullmatch(
        r".*m\.yaml, line 11: assemble: no position found from this guess: the closest one misses "
        r"bars\.top by (\S+) m, bars\.again by (\S+) m; these contradict each other, or .*",
        str(caught.value),
    )
    # Φ of both is half the difference of squares: they share 2.1² − 2².
    between = np.sqrt((2.1**2 + 2**2) / 2)
    assert float(found[1]) == pytest.approx(between - 2, rel=1e-2)
    assert float(found[2]) == pytest.approx(2.1 - between, rel=1e-2)
