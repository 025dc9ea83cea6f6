"""Formulations and projections: their Jacobians, and the engines held to each other."""

import itertools
from functools import cache

import numpy as np
import pytest
from covering import covering
from damped import damped
from exact_orders import CONSTRAINTS, Jacobian, System
from examples import car_axis
from general import general
from marching import EPS, FORMULATIONS, INTEGRATORS, PROJECTIONS, formulated, march_of
from marching import STEP as USUAL
from mechanisms import built

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import constraints
from newmark_cli.newmark.constraints import (
    constraining_of,
    least_inertia,
)
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import (
    NEWTON,
    RECOVERED,
    REPORTED,
    TOTAL,
    Formulation,
    FormulationError,
    Projection,
)
from newmark_cli.newmark.integrator import GeneralizedAlpha, Newmark
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT, EVALUATIONS, Tolerance
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem

THROWN = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1, 0], mass: 1.5, velocity: [0, 1]}
bars:
  rod: {from: O, to: P, length: 1}
gravity: [0, -1]
"""
#: A crank whose angle is prescribed, and a link that hangs from it: Φ depends on time.
DRIVEN = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [0.3, 0.4], mass: 2}
  B: {at: [0.9, 1.2], mass: 1}
bars:
  arm: {from: O, to: A, length: 0.5}
  link: {from: A, to: B, length: 1}
motions: {crank: {point: A, x: {rate: 0.5, amplitude: 0.05, frequency: 3}}}
gravity: [0, -9.81]
project_velocities: true
"""


@cache
def subject_of(name) -> Problem:
    """A problem by name: a mechanism, or one of this file and its neighbours."""
    if name in _OWN:
        return _OWN[name]()
    return problem(name)


_OWN = {
    "thrown": lambda: built(THROWN),
    "driven": lambda: built(DRIVEN),
    "damped": damped,
    "general": general,
    "quadrics": lambda: general(hard=False),
    "singular mass": lambda: general(singular=True),
    "car axis": lambda: car_axis(compiled=False),
}
#: Step sizes large enough that every block of J is seen in a correction.
STEP = USUAL | {
    "thrown": 0.1,
    "andrews": 1e-4,
    "slider-crank": 5e-3,
    "driven": 0.02,
    "damped": 0.05,
    "general": 0.05,
    "quadrics": 0.05,
    "singular mass": 0.05,
    "car axis": 1e-2,
}
#: Forms in which each field is kept alone, with another, and with both.
KEPT = ["u-lambda", "v-lambda", "a-lambda", "u-a-lambda", "u-v-a-lambda"]
QUADRATIC = ["thrown", "pendulum", "andrews", "slider-crank", "heavy-top", "quadrics"]
OTHERS = ["driven", "shaken-pendulum", "general", "singular mass", "damped", "car axis"]


# -- Jacobians ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formulation", "form", "name"),
    covering(CONSTRAINTS, FORMS, ["general", "quadrics", "singular mass"]),
)
def test_jacobians_are_those_of_the_equations(formulation, form, name):
    """Dense and sparse J, not scaled and scaled, are made of M, X, Y, G, … as `exact_orders` is."""
    subject, h, t = subject_of(name), 0.1, 0.2
    scheme = formulated(formulation, form, h, GeneralizedAlpha(0.6))
    n, m, random = subject.n, subject.m, np.random.default_rng(5)
    v, w, before = random.normal(size=(3, n))
    u, multipliers = subject.u0, random.normal(size=m)
    values, terms = subject.values(t, u, v, multipliers), subject.evaluate(t, u, v, multipliers)
    constraining, tangents = constraining_of(subject, scheme), None
    directions = subject.evaluate(t, before, v, multipliers).G  # of the beginning of the step
    if constraining:
        tangents = constraining.tangents_at(t, u, v, w)
        of_old = constraining.directions(subject.values(t, before, v, multipliers).g)
        tangents = tangents._replace(directions=of_old)
    if np.linalg.matrix_rank(subject.M, tol=1e-9) == n:
        directions = np.linalg.solve(subject.M, directions)
    rates, pattern = np.zeros((2, m, n)), subject.pattern
    rows = subject.constraint_rows(t, u, v, w)
    for rate, of_rows in zip(rates, (rows.r, rows.q), strict=True):
        np.add.at(rate, (pattern.g_columns, pattern.g_rows), of_rows)
    relations = scheme.relations
    blocks = System(
        subject.M, terms.X, terms.Y, terms.G, directions, *rates,
        relations.u_from_a / h**2, relations.v_from_a / h, relations.acceleration[0],
    )  # fmt: skip
    rate = 1 / h if "rate_h" in formulation else 1000.0
    penalty = constraining.penalty if scheme.formulation.kind.penalised else 0.0
    expected = Jacobian(blocks, form, formulation, h, rate, penalty).matrix.astype(float)
    system, size = DenseSystem(subject, scheme), np.abs(expected).max()
    found = system.dense(system.entries(values, tangents))
    np.testing.assert_allclose(found, expected, rtol=0, atol=50 * EPS * size)
    for variant in ("none", "optimal"):
        scaled = formulated(formulation, form, h, GeneralizedAlpha(0.6), scaling=variant)
        left, right = scaling_factors(scaled, n, m)
        wanted = left[:, None] * expected * right
        system = SparseSystem(subject, scaled)
        matrix = system.dense(system.scaled_entries(values, tangents))
        sizes = 50 * EPS * size * np.abs(left)[:, None] * right
        assert np.all(np.abs(matrix - wanted) <= sizes), variant


@pytest.mark.parametrize("most", [300, 0])
@pytest.mark.parametrize("name", ["andrews", "slider-crank", "general"])
def test_least_inertia_is_the_least_eigenvalue(name, most, monkeypatch):
    """Of GᵀM⁻¹G at the start, by its inverse or without; p = factor · w_a over it."""
    monkeypatch.setattr(constraints, "_DENSE_UP_TO", most)
    subject = subject_of(name)
    g = subject.evaluate(subject.t0, subject.u0, subject.v0, np.zeros(subject.m)).G
    least = np.linalg.eigvalsh(g.T @ np.linalg.solve(subject.M, g))[0]
    assert least_inertia(subject) == pytest.approx(least, rel=1e-8)
    scheme = formulated("augmented-lagrangian factor=3", h=1e-3, integrator=Newmark())
    penalty = constraining_of(subject, scheme).penalty
    assert penalty == pytest.approx(3 * 4 / 1e-6 / least, rel=1e-8)


def test_directions_of_many_coupled_coordinates_are_those_of_the_diagonal(monkeypatch):
    """P = diag(M)⁻¹ G in place of M⁻¹G where a block of M is too large to be inverted."""
    monkeypatch.setattr(constraints, "_LARGEST_BLOCK", 4)
    subject = subject_of("general")
    terms = constraints.projector(subject)
    np.testing.assert_array_equal(terms.values, 1 / np.diag(subject.M)[terms.rows])
    np.testing.assert_array_equal(terms.sources, np.arange(subject.n * subject.m))


# -- engines held to each other ---------------------------------------------------------------

ENGINES = ("kernel", "dense", "sparse")


def balanced_difference(subject, scheme, one, other):
    """Differences of u, v, a, λ in units of displacement, relative to what is there."""
    symbols = scheme.integrator.symbols(scheme.h)
    w_a = 1 / (symbols["beta"] * scheme.h**2)
    w_v = symbols["gamma"] * w_a * scheme.h
    pairs = [
        (one.fields[0], other.fields[0], 1),
        (one.fields[1], other.fields[1], w_v),
        (one.fields[2], other.fields[2], w_a),
        (one.fields[3], other.fields[3], w_a),
        (one.multipliers, other.multipliers, w_a),
    ]
    differences = [np.abs(a - b).max() / w for a, b, w in pairs]
    sizes = [np.abs(a).max() / w for a, _, w in pairs]
    return max(differences), max(sizes)


@pytest.mark.parametrize(
    ("formulation", "form", "evaluation", "name", "variant", "integrator", "projection"),
    [
        *covering(FORMULATIONS, FORMS, EVALUATIONS, QUADRATIC, VARIANTS, INTEGRATORS, PROJECTIONS),
        *covering(FORMULATIONS, KEPT, [DIRECT], OTHERS, VARIANTS, INTEGRATORS[::2], PROJECTIONS),
    ],
)
def test_engines_agree(formulation, form, evaluation, name, variant, integrator, projection):
    """Two corrections, and a whole step, from a state along a run: equal to rounding."""
    subject = subject_of(name)
    options = {"scaling": variant, "evaluation": evaluation, "projection": projection}
    scheme = formulated(formulation, form, STEP[name], integrator, **options)
    start = march_of(subject, scheme)
    start.advance(2)
    balanced = formulated(formulation, form, STEP[name], integrator)
    condition = DenseSystem(subject, balanced).balanced(start.t, start.state).condition()
    caps = (2, 50) if variant in ("optimal", "optimal-printed") else (50,)
    for cap in caps:
        capped = formulated(formulation, form, STEP[name], integrator, iteration_cap=cap, **options)
        marches = [
            march_of(subject, capped, engine, state=start.state.copy(), done=start.done)
            for engine in ENGINES
        ]
        stretches = [march.advance(1) for march in marches]
        assert [march.ending for march in marches] == [COMPLETED] * len(marches)
        ours = marches[0].state
        for march, stretch in zip(marches[1:], stretches[1:], strict=True):
            difference, size = balanced_difference(subject, scheme, ours, march.state)
            rounding = 100 * EPS * condition * size
            assert difference <= rounding, (cap, condition)
            # An impulse is an inertia times a change of velocities.
            unit = rounding * np.abs(subject.mass_values).max() / scheme.h
            assert np.abs(ours.impulse - march.state.impulse).max() <= 10 * unit
            if cap < 3:
                # The recorded norms are of corrections, not yet of rounding.
                np.testing.assert_allclose(
                    stretches[0].norms, stretch.norms,
                    rtol=1e-6, atol=rounding / scheme.right.min(),
                )  # fmt: skip


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_carried_sums_are_the_constraints_at_the_end(formulation):
    """Compensated: Φ and Ψ, summed up from increments of several steps, are those of u and v."""
    subject, drifted = subject_of("quadrics"), []
    for projection in ("none", "position-velocity accelerations"):
        scheme = formulated(formulation, h=0.02, evaluation=COMPENSATED, projection=projection)
        march = March(subject, scheme, "dense-lu")
        march.advance(3)
        state = march.state
        phi = subject.constraint_values(march.t, state.fields[0])
        rate = Index1(subject).rate(march.t, *state.fields[:2])
        np.testing.assert_allclose(state.phi, phi, rtol=0, atol=1e-14)
        constraining = march.system.constraining
        if constraining and (constraining.differentiated or projection != "none"):
            np.testing.assert_allclose(state.psi, rate, rtol=0, atol=2e-15)
        drifted.append(np.abs([phi, rate]).max(axis=1) > 1e-6)
    # Where a sum is not asked to be zero, it is far from it.
    rows = Formulation.parse(formulation).kind.rows
    by_position = "C" in rows or formulation == "augmented-lagrangian factor=10"
    assert drifted[0].tolist() == [not by_position, "Cv" not in rows]


def test_each_block_is_recorded_until_it_grows():
    """In the terminal phase a block is done at its first increase, the step when all are."""
    subject, early, grown = subject_of("quadrics"), 0, 0
    small_steps = [("v-lambda", 1e-6 * 0.8**k) for k in range(6)]
    formulations = ["index-2", "ggl", "augmented-lagrangian factor=10"]
    for formulation, (form, h) in itertools.product(
        formulations, [("a-lambda", 1e-3), *small_steps]
    ):
        start = March(subject, formulated(formulation, form, h))
        start.advance(2)

        def step(**options):
            scheme = formulated(formulation, form, h, **options)  # noqa: B023
            march = March(subject, scheme, "dense-lu", state=start.state, done=2)  # noqa: B023
            stretch = march.advance(1)
            return scheme, march, stretch.norms[0], stretch.iterations[0]

        scheme, march, found, iterations = step()
        p = len(scheme.form.kept)
        to_displacement = scheme.tables.weights[0] * scheme.right[:p]
        done, last = np.zeros(len(found), bool), np.zeros(len(found))
        recorded, settled = np.zeros(len(found)), 0
        for cap in range(1, iterations + 1):
            *_, now, _ = step(iteration_cap=cap, stop=Tolerance(1e-300))
            early += settled == 1 and np.any(now >= last)
            done = (done | (now >= last)) & (settled >= 2)
            recorded[~done], last = now[~done], now
            assert done.all() == (cap == iterations)
            small = np.linalg.norm(to_displacement * now[:p])
            size = scheme.settled_below * np.linalg.norm(march.state.fields[0])
            settled = settled + 1 if small < size else 0
        np.testing.assert_array_equal(found, recorded, err_msg=f"{formulation} {form} {h}")
        grown += np.any(last > recorded)
    assert (early > 0, grown > 0) == (True, True), (early, grown)


@pytest.mark.parametrize(
    ("formulation", "reported", "engine", "evaluation"),
    covering(FORMULATIONS, REPORTED, ["kernel", "dense"], EVALUATIONS),
)
def test_a_march_goes_on_and_is_recorded_to_the_same_bits(
    formulation, reported, engine, evaluation
):
    """In pieces, restarted from a state, with looks or without: one march, bit by bit."""
    subject = subject_of("quadrics")
    scheme = formulated(
        formulation, "v-lambda", 0.02, projection="velocity accelerations",
        evaluation=evaluation, reported=reported,
    )  # fmt: skip
    whole, halted = march_of(subject, scheme, engine), march_of(subject, scheme, engine)
    (stretch,) = whole.stretches(6, looks=[2, 3, 6])
    seen = []
    for stop in (2, 3):
        halted.advance(stop - halted.done)
        seen.append(halted.seen)
    resumed = march_of(subject, scheme, engine, state=halted.state, done=halted.done)
    resumed.advance(3)
    seen.append(resumed.seen)
    for one, other in zip(whole.state, resumed.state, strict=True):
        np.testing.assert_array_equal(one, other)
    for k, state in enumerate(seen):
        np.testing.assert_array_equal(stretch.record.fields[k], state.fields)
        np.testing.assert_array_equal(stretch.record.multipliers[k], state.multipliers)


def test_what_is_reported_of_multipliers():
    """Newton's λ; λ + μ/h; and what the index-1 system makes of u and v."""
    subject, h = subject_of("quadrics"), 0.02
    found = {}
    for reported in REPORTED:
        march = March(subject, formulated("index-3", h=h, projection="velocity", reported=reported))
        march.advance(4)
        found[reported] = march.seen.multipliers
    state = march.state
    impulse = state.impulse / h
    assert np.abs(impulse).max() > 1e-4
    np.testing.assert_allclose(found[TOTAL], found[NEWTON] + impulse, rtol=1e-13)
    g = subject.evaluate(march.t, *state.fields[:2], np.zeros(2)).G
    free = subject.evaluate(march.t, *state.fields[:2], np.zeros(2)).force
    _, curvature = subject.constraint_derivatives(march.t, state.fields[0], state.fields[1])
    inverse = np.linalg.inv(subject.M)
    expected = np.linalg.solve(g.T @ inverse @ g, -(curvature + g.T @ inverse @ free))
    np.testing.assert_allclose(found[RECOVERED], expected, rtol=1e-11)


def test_projections_project():
    """Φ and Φ' vanish after a step, the change has least size, v' is the index-1 system's."""
    subject, h = subject_of("general"), 0.05
    plain = March(subject, formulated("index-1", h=h))
    plain.advance(1)
    for projection in PROJECTIONS[1:]:
        march = March(subject, formulated("index-1", h=h, projection=projection))
        march.advance(1)
        u, v, _, w = march.state.fields
        g = subject.evaluate(h, u, v, np.zeros(2)).G
        rows = subject.constraint_rows(h, u, v, w)
        np.testing.assert_allclose(g.T @ v + rows.rate, 0, atol=1e-13)
        missed = np.abs(subject.constraint_values(h, u)).max()
        before = np.abs(subject.constraint_values(h, plain.state.fields[0])).max()
        if projection.startswith("position"):
            assert missed < 0.02 * before
        else:
            assert missed == before
        if "accelerations" in projection:
            np.testing.assert_allclose(g.T @ w + rows.curvature, 0, atol=1e-12)
            # a has changed by as much as v'.
            change = march.state.fields[2:] - plain.state.fields[2:]
            np.testing.assert_allclose(change[0], change[1], rtol=1e-9, atol=1e-13)
            assert np.abs(change).max() > 1e-6
        if projection == "velocity":
            change = v - plain.state.fields[1]
            np.testing.assert_allclose(subject.M @ change, g @ march.state.impulse, atol=1e-13)


@pytest.mark.parametrize(
    ("read", "label", "words"),
    [
        (Formulation, "index-4", "unknown formulation 'index-4'"),
        (Formulation, "ggl rate=1", "formulation ggl has no 'rate'; it has none"),
        (Formulation, "baumgarte penalty=1", "has no 'penalty'; it has rate or rate_h"),
        (Formulation, "baumgarte rate=-1", "rate = -1: must be positive"),
        (Formulation, "baumgarte rate=fast", "rate must be a number"),
        (Projection, "velocities", "unknown projection 'velocities'"),
        (Projection, "none accelerations", "accelerations need velocities projected"),
    ],
)
def test_bad_labels_are_refused(read, label, words):
    """In one line, with what is allowed."""
    with pytest.raises(FormulationError, match=words):
        read.parse(label)
