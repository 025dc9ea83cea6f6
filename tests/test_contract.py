"""What holds for every mechanism, and for every way to march one."""

import pickle
from functools import cache

import mechanisms
import numpy as np
import pytest
import spatial
import yaml
from covering import covering
from damped import damped
from marching import FORMULATIONS, INTEGRATORS, STEP, assert_same_step, formulated, march_of
from test_planar_parts import CART
from test_spatial_laws import BODIES
from test_spring_laws import PLANAR, SPATIAL

import newmark_cli as newmark
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.registry import SHIPPED, problem
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.invariants import INVARIANTS, invariants
from newmark_cli.newmark.linear.choice import DENSE, SPARSE, STATIC
from newmark_cli.newmark.march import March, initial_state
from newmark_cli.newmark.march_data import DIVERGED, SINGULAR, State
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.problems.index_1 import Index1

# -- mechanisms -------------------------------------------------------------------------------


def member(family, size):
    """Nets grow by both of their sizes."""
    return Sized(family, tuple((name, size) for name in FAMILIES[family].parameters)).load()


def conservative():
    """Every element in space that neither damps nor drives."""
    data = yaml.safe_load(spatial.everything("pairs"))
    for section in ("dampers", "torsion_dampers", "torques", "motions"):
        del data[section]
    return newmark.problem(data)


#: Torques drive Andrews' mechanism and the four-bar linkage, dampers slow the governor.
CONSERVATIVE = {
    "pendulum", "double-pendulum", "slider-crank", "bricard", "heavy-top", "spatial-slider-crank",
}  # fmt: skip
#: Those of which every joint, element and law is a part, between them.
WITH_EVERYTHING = {
    "planar": mechanisms.everything,
    "planar, quadratic": lambda: mechanisms.everything(driven=False),
    "angles, wheels and laws": lambda: mechanisms.built(CART),
    **{
        f"spatial, {name}": lambda name=name: mechanisms.built(spatial.everything(name))
        for name in spatial.SETS
    },
    "spatial, conservative": conservative,
    "spatial, laws": lambda: mechanisms.built(BODIES),
    "springs by laws": lambda: mechanisms.built(PLANAR),
    "spatial, springs by laws": lambda: mechanisms.built(SPATIAL),
}
MEMBERS = {
    f"{family} of {size}": lambda family=family, size=size: member(family, size)
    for family in FAMILIES
    for size in (1, 4)
}
MAKERS = {
    **{name: lambda name=name: problem(name) for name in SHIPPED}, **MEMBERS, **WITH_EVERYTHING,
}  # fmt: skip
EVERY = pytest.mark.parametrize("name", MAKERS)


@cache
def subject_of(name):
    """A mechanism by its name here."""
    return MAKERS[name]()


def test_every_joint_is_among_them():
    sets = "".join(spatial.SETS.values())
    assert {kind for kind in JOINTS if f"type: {kind}," in sets} == set(JOINTS)


@EVERY
def test_tangents(name):
    """X, Y, G by complex steps; f and Φ by Python; f = −∂V/∂u and T = vᵀMv/2 where there is V.

    Whatever a wrong entry is, a random direction sees it.
    """
    subject, random, t = subject_of(name), np.random.default_rng(7), 0.4
    size = np.abs(subject.u0).max()
    u = subject.u0 + 0.1 * size * random.normal(size=subject.n)
    v, multipliers = random.normal(size=subject.n), random.normal(size=subject.m)
    found = subject.evaluate(t, u, v, multipliers)
    for direction in random.normal(size=(3, subject.n)):
        force, phi = mechanisms.complex_terms(subject, t, u + 1e-30j * direction, v, multipliers)
        faster, _ = mechanisms.complex_terms(subject, t, u, v + 1e-30j * direction, multipliers)
        for matrix, change in ((-found.X, force), (found.G.T, phi), (-found.Y, faster)):
            expected = change.imag / 1e-30
            largest = np.abs(expected).max()
            np.testing.assert_allclose(
                matrix @ direction, expected, rtol=0, atol=1e-10 * max(largest, 1e-3)
            )
    for values, exact in ((found.force, force.real), (found.phi, phi.real)):
        np.testing.assert_allclose(values, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    at_rest = np.zeros(subject.n), np.zeros(subject.m)
    if subject.energies(t, u, at_rest[0]) is not None:
        force = subject.evaluate(t, u, *at_rest).force
        step = 1e-4 * size
        above, below = (
            subject.energies(t, u + side * step * direction, at_rest[0])[1] for side in (1, -1)
        )
        rounding = 1e-12 * max(abs(above), abs(below)) / step
        expected = pytest.approx(force @ direction, rel=1e-5, abs=rounding)
        assert -(above - below) / (2 * step) == expected
        assert subject.energies(t, u, v)[0] == pytest.approx(v @ subject.M @ v / 2, rel=1e-13)


@EVERY
def test_rates_of_constraints(name):
    """Φ', Φ'' and their tangents against differences of Φ along a motion, and of each other."""
    subject, random, t = subject_of(name), np.random.default_rng(7), 0.4
    size = np.abs(subject.u0).max()
    u = subject.u0 + 0.1 * size * random.normal(size=subject.n)
    v, w, direction = size * random.normal(size=(3, subject.n))

    def phi(s):
        return subject.constraint_values(t + s, u + s * v + s**2 / 2 * w)

    def rates(u):
        rows, g = subject.constraint_rows(t, u, v, w), gradient(u)
        return np.array([g.T @ v + rows.rate, g.T @ w + rows.curvature])

    def gradient(u):
        return subject.evaluate(t, u, v, np.zeros(subject.m)).G

    values = np.array([phi(k * 1e-3) for k in range(-3, 4)])
    first, second = rates(u)
    expected = np.array([-1, 9, -45, 0, 45, -9, 1]) @ values / 0.06
    np.testing.assert_allclose(first, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    expected = np.array([2, -27, 270, -490, 270, -27, 2]) @ values / 180e-6
    np.testing.assert_allclose(second, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    step = 1e-3
    sides = [rates(u + k * step * direction) for k in (-2, -1, 1, 2)]
    rows = subject.constraint_rows(t, u, v, w)
    for tangent, change in zip(
        (rows.r, rows.q), np.tensordot([1, -8, 8, -1], sides, 1), strict=True
    ):
        matrix = np.zeros((subject.n, subject.m))
        np.add.at(matrix, (subject.pattern.g_rows, subject.pattern.g_columns), tangent)
        expected = change / (12 * step)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(
            matrix.T @ direction, expected, rtol=0, atol=1e-7 * max(largest, size**2)
        )


@pytest.mark.bits("the start itself is what is tested")
@EVERY
def test_starts(name):
    """Φ, Φ', Φ'' vanish, forces balance, and nothing that is conserved is missing at the start.

    Damping, torques and laws of time leave no energy to conserve.
    """
    subject = subject_of(name)
    a, multipliers = Index1(subject).accelerations(subject.t0, subject.u0, subject.v0)
    terms = subject.evaluate(subject.t0, subject.u0, subject.v0, multipliers)
    rate, curvature = subject.constraint_derivatives(subject.t0, subject.u0, subject.v0)
    size, speed, fast = (max(np.abs(x).max(), 1e-3) for x in (subject.u0, subject.v0, a))
    np.testing.assert_allclose(terms.phi, 0, atol=1e-14 * max(size, size**2))
    np.testing.assert_allclose(terms.G.T @ subject.v0 + rate, 0, atol=1e-13 * max(speed, 1))
    np.testing.assert_allclose(terms.G.T @ a + curvature, 0, atol=1e-12 * fast)
    balance = 1e-11 * max(np.abs(terms.force).max(), np.abs(subject.M @ a).max(), 1)
    np.testing.assert_allclose(subject.M @ a - terms.force, 0, atol=balance)
    assert np.linalg.matrix_rank(terms.G) == subject.m
    assert np.linalg.eigvalsh(subject.M)[0] >= -1e-15 * np.abs(subject.M).max()
    scheme = formulated("index-3", "u-lambda", 1e-2)
    found = invariants(subject, subject.t0, initial_state(subject, scheme))
    conserved = subject.energies(subject.t0, subject.u0, subject.v0) is not None
    assert tuple(found) == INVARIANTS[: 4 if conserved else 3]
    assert name not in SHIPPED or conserved == (name in CONSERVATIVE)
    for misfit in found.values():
        assert np.all(np.abs(misfit.errors) <= 1e-12 * max(np.max(misfit.sizes), 1e-3))


@EVERY
def test_problems_can_be_sent_to_other_processes(name):
    """What arrives has the same content and names: one for each number, all different."""
    subject = subject_of(name)
    sent = pickle.loads(pickle.dumps(subject))
    assert sent.content == subject.content
    for names, found, count in (
        (subject.coordinate_names, sent.coordinate_names, subject.n),
        (subject.constraint_names, sent.constraint_names, subject.m),
    ):
        assert names == found
        assert len(names) == len({*names}) == count


# -- marches ----------------------------------------------------------------------------------

STEPPED = {**{name: lambda name=name: problem(name) for name in SHIPPED}, "damped": damped}
PROJECTED = ("none", "velocity", "position-velocity accelerations")


@pytest.mark.parametrize(
    ("name", "formulation", "variant", "integrator", "projection"),
    covering(STEPPED, FORMULATIONS[:6], VARIANTS, INTEGRATORS, PROJECTED),
)
def test_all_forms_take_the_same_step(name, formulation, variant, integrator, projection):
    """Section 3.6: elimination is exact, so every form gives the same u, v, a, λ.

    But for an augmented Lagrangian's λ, which is iterated.
    """
    subject, results = STEPPED[name](), {}
    for form in FORMS:
        scheme = formulated(
            formulation, form, STEP[name], integrator, scaling=variant, projection=projection
        )
        march = march_of(subject, scheme)
        march.advance(3)
        results[form] = march.state
    for form in FORMS:
        assert_same_step(subject, scheme, results["u-lambda"], results[form])


@pytest.mark.parametrize("solver", [DENSE, SPARSE, STATIC])
def test_what_cannot_be_solved_ends_the_march(solver):
    """A status, not a traceback, where G vanishes, and for a correction that is not finite."""
    subject, scheme = problem("pendulum"), formulated("index-3", "u-lambda", 0.1, Newmark())
    still = State(*(np.zeros(shape) for shape in ((4, 2), (3, 2), 1, (2, 2), 1, 1, 1, 2, 3)))
    fast = initial_state(subject, scheme)
    fast.past[1] = 1e200
    for state, ending in ((still, SINGULAR), (fast, DIVERGED)):
        march = March(subject, scheme, solver, state=state)
        with np.errstate(all="ignore"):
            march.advance(3)
        assert (march.ending, march.done) == (ending, 0), solver
