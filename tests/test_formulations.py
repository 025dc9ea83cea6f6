"""Formulations and projections: their Jacobians, and the engines held to each other."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from covering import covering
from damped import damped
from general import constraint, force, general, gradient
from marching import EPS, copy

from newmark_cli.errors import InputError
from newmark_cli.mechanisms import planar
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import compiled_march, scipy_march
from newmark_cli.newmark.constraints import (
    constraining_of,
    least_inertia,
    projector,
)
from newmark_cli.newmark.formulation import (
    CORRECTED,
    METHODS,
    NEWTON,
    RECOVERED,
    REPORTED,
    TOTAL,
    Formulation,
    FormulationError,
    Projection,
)
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import BDF2, HHT, GeneralizedAlpha, Newmark
from newmark_cli.newmark.jacobian import form_blocks, scaling_factors
from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.linear.dense import condition_number
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED, State
from newmark_cli.newmark.scaling import VARIANTS, named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT, EVALUATIONS, Scheme, Tolerance
from newmark_cli.problems import python_problem
from newmark_cli.problems.problem import Problem

FORMULATIONS = [
    "index-3",
    "index-2",
    "index-1",
    "baumgarte rate=20",
    "baumgarte rate_h=1",
    "ggl",
    "augmented-lagrangian factor=10",
    "augmented-lagrangian penalty=50",
]
PROJECTIONS = [
    "none",
    "velocity",
    "velocity accelerations",
    "position-velocity",
    "position-velocity accelerations",
]
INTEGRATORS = [Newmark(), Newmark(0.3025, 0.6), GeneralizedAlpha(0.8), HHT(0.1), BDF2()]
LABEL = lambda value: getattr(value, "label", value)  # noqa: E731

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


def _mechanism(text, name):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.yaml"
        path.write_text(text)
        return planar.load(path, name)


_OWN = {
    "thrown": lambda: _mechanism(THROWN, "thrown"),
    "driven": lambda: _mechanism(DRIVEN, "driven"),
    "damped": damped,
    "general": general,
    "quadrics": lambda: general(hard=False),
    "singular mass": lambda: general(singular=True),
    "car axis": lambda: python_problem.load(
        Path(__file__).parents[1] / "docs/examples/car_axis.py",
        "car_axis",
        {"compiled": True},
        "car axis",
    ),
}
#: Step sizes large enough that every block of J is seen in a correction.
STEP = {
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
QUADRATIC = ["thrown", "andrews", "slider-crank", "quadrics"]
OTHERS = ["driven", "general", "singular mass", "damped", "car axis"]


def scheme_of(formulation, form="a-lambda", h=1e-2, integrator=None, **options):
    """A scheme with a formulation and projection given by their labels."""
    of = Formulation.parse(formulation)
    form = of.applied(FORMS[form])
    scaling = named_scaling(options.pop("scaling", "optimal"), form)
    projection = Projection.parse(options.pop("projection", "none"))
    return Scheme(
        integrator or GeneralizedAlpha(0.9),
        form,
        scaling,
        h,
        formulation=of,
        projection=projection,
        **options,
    )


def march_of(subject, scheme, engine="kernel", **options) -> March:
    """A march by one of the engines: the kernel, SciPy dense or sparse."""
    march = March(subject, scheme, "sparse-lu" if engine == "sparse" else "dense-lu", **options)
    if engine == "dense":
        march._engine = partial(scipy_march.march, system=march.system)
    return march


# -- Jacobians against residuals written down again -------------------------------------------


class Literal:
    """Rows of the four fields, of one step, from the page of equations; complex numbers."""

    def __init__(self, subject, scheme, state, t):
        self.subject, self.scheme, self.t = subject, scheme, t
        relations = scheme.relations
        self.beta, self.gamma = relations.u_from_a, relations.v_from_a
        self.c = relations.acceleration[0]
        self.u_hat, self.v_hat = relations.u_past @ state.past, relations.v_past @ state.past
        self.d = relations.acceleration[1:] @ state.past
        g = gradient(subject, state.fields[0], t)
        regular = np.linalg.matrix_rank(subject.M, tol=1e-9) == subject.n
        self.p = np.linalg.solve(subject.M, g) if regular else g

    def fields(self, kept, push):
        """U, v, a from the kept ones."""
        given = dict(zip(self.scheme.form.kept, kept, strict=True))
        u, v, a = (given.get(name) for name in "uva")
        beta, gamma, u_hat, v_hat = self.beta, self.gamma, self.u_hat, self.v_hat
        if a is None:
            a = (v - v_hat) / gamma if v is not None else (u - u_hat - push) / beta
        if v is None:
            v = gamma * a + v_hat
        if u is None:
            u = beta * a + u_hat + push
        return u, v, a

    def second(self, u, v, w):
        """Gᵀw + κ."""
        reals, n, t = self.subject.reals, self.subject.n, self.t
        found = []
        for k in range(self.subject.m):
            s = reals[1 + (2 + k) * n : 1 + (3 + k) * n]
            e = 1 + k + np.arange(n)
            turn, pull = (
                reals[0, 1] * 2 * np.cos(2 * t + 0.3),
                -4 * reals[0, 1] * np.sin(2 * t + 0.3),
            )
            found.append(
                v @ s @ v + 2 * reals[0, 0] * np.sum(u * v * v) + 2 * turn * e @ v + pull * e @ u
            )
        return gradient(self.subject, u, t).T @ w + np.array(found)

    def rate(self, u, v):
        """Gᵀv + Φ_t."""
        n, t = self.subject.n, self.t
        turn = self.subject.reals[0, 1] * 2 * np.cos(2 * t + 0.3)
        of_time = [turn * (1 + k + np.arange(n)) @ u for k in range(self.subject.m)]
        return gradient(self.subject, u, t).T @ v + np.array(of_time)

    def rows(self, z, multipliers):
        """Rows of the form at its solved unknowns, one vector."""
        subject, form, t = self.subject, self.scheme.form, self.t
        formulation = self.scheme.formulation
        n, m, p = subject.n, subject.m, len(form.kept)
        kept = [z[k * n : (k + 1) * n] for k in range(p)]
        rest = z[p * n :]
        eta = rest[m:] if "eta" in form.solved else np.zeros(m)
        push = self.p @ eta
        u, v, a = self.fields(kept, push)
        w = self.c * a + self.d
        phi = constraint(subject, u, t)
        if formulation.method == "augmented-lagrangian":
            pull = multipliers - constraining_of(subject, self.scheme).penalty * phi
        else:
            pull = rest[:m]
        rate = 1.0
        if formulation.method == "baumgarte":
            name, value = formulation.parameter
            rate = value / self.scheme.h if name == "rate_h" else value
        of_row = {
            "D": lambda: subject.M @ w - force(subject, u, v, t) - gradient(subject, u, t) @ pull,
            "V": lambda: v - self.gamma * a - self.v_hat,
            "K": lambda: u - self.beta * a - self.u_hat - push,
            "C": lambda: phi,
            "Cv": lambda: self.rate(u, v),
            "Ca": lambda: self.second(u, v, w),
            "B": lambda: self.second(u, v, w) + 2 * rate * self.rate(u, v) + rate**2 * phi,
        }
        return np.concatenate([of_row[row]() for row in form.rows])


@pytest.mark.parametrize("name", ["general", "quadrics", "singular mass"])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_jacobians_are_those_of_the_equations(formulation, form, name):
    """Dense and sparse J, not scaled and scaled, are the derivative of the residual.

    The residual is written down again from the equations and differentiated by a complex
    step, which is exact to rounding.
    """
    subject, h, t = subject_of(name), 0.1, 0.2
    scheme = scheme_of(formulation, form, h, GeneralizedAlpha(0.6))
    n, m, p = subject.n, subject.m, len(scheme.form.kept)
    random = np.random.default_rng(5)
    multipliers = random.normal(size=m)
    past = random.normal(size=(len(scheme.relations.u_past), n))
    fields = np.array([subject.u0, *random.normal(size=(3, n))])
    state = State(fields, past, multipliers, *np.zeros((4, 1)))
    literal = Literal(subject, scheme, state, t)
    # A state that meets V and K, at η = 0, so that all forms are at the same one.
    kept = [fields["uva".index(name)] for name in scheme.form.kept]
    u, v, a = literal.fields(kept, np.zeros(n))
    w = literal.c * a + literal.d
    literal.p = literal.p @ np.eye(m)
    shift = multipliers
    constraining = constraining_of(subject, scheme)
    if scheme.formulation.kind.penalised:
        shift = multipliers - constraining.penalty * constraint(subject, u, t)
    z = np.concatenate([*kept, *([multipliers, np.zeros(m)][: len(scheme.form.constraint_rows)])])
    step = 1e-30
    expected = np.stack(
        [literal.rows(z + 1j * step * unit, multipliers).imag / step for unit in np.eye(len(z))],
        axis=1,
    )
    terms, values = subject.evaluate(t, u, v, shift), subject.values(t, u, v, shift)
    tangents = None
    if constraining:
        tangents = constraining.tangents_at(t, u, v, w)
        # P is that of the beginning of the step.
        before = subject.values(t, state.fields[0], v, multipliers).g
        tangents = tangents._replace(directions=constraining.directions(before))
    found = np.block(form_blocks(scheme, terms, subject.M, constraining, tangents))
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=50 * EPS * size)

    for variant in VARIANTS:
        scaled = scheme_of(formulation, form, h, GeneralizedAlpha(0.6), scaling=variant)
        left, right = scaling_factors(scaled, n, m)
        wanted = left[:, None] * expected * right
        system = SparseSystem(subject, scaled)
        matrix = np.zeros_like(expected)
        entries = system.scaled_entries(values, tangents)
        np.add.at(matrix, (system.rows, system.columns), entries)
        sizes = 50 * EPS * size * np.abs(left)[:, None] * right
        assert np.all(np.abs(matrix - wanted) <= sizes), variant
    assert p * n + m * len(scheme.form.constraint_rows) == len(z)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_optimal_scaling_balances_every_formulation(formulation):
    """No block of J̄, and none of its inverse, grows as h falls: C is the same at all h."""
    subject = subject_of("quadrics")
    for form in FORMS:
        found = []
        for h in (1e-5, 1e-7):
            scheme = scheme_of(formulation, form, h)
            march = March(subject, scheme)
            found.append(condition_number(subject, scheme, 0.0, march.state))
        assert found[1] == pytest.approx(found[0], rel=1e-2), form


def test_directions_are_those_of_least_change():
    """P = M⁻¹G where M is regular, G where it is singular; also from sparse tables."""
    for name in ("general", "andrews", "singular mass"):
        subject = subject_of(name)
        terms = projector(subject)
        g = subject.values(subject.t0, subject.u0, subject.v0, np.zeros(subject.m)).g
        found = np.zeros((subject.n, subject.m))
        np.add.at(found, (terms.rows, terms.columns), terms.values * g[terms.sources])
        full = subject.evaluate(subject.t0, subject.u0, subject.v0, np.zeros(subject.m)).G
        expected = full if name == "singular mass" else np.linalg.solve(subject.M, full)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["andrews", "slider-crank", "general"])
def test_least_inertia_is_the_least_eigenvalue(name):
    """Least eigenvalue of GᵀM⁻¹G at the start; p = factor · w_a over it."""
    subject = subject_of(name)
    g = subject.evaluate(subject.t0, subject.u0, subject.v0, np.zeros(subject.m)).G
    least = np.linalg.eigvalsh(g.T @ np.linalg.solve(subject.M, g))[0]
    assert least_inertia(subject) == pytest.approx(least, rel=1e-8)
    scheme = scheme_of("augmented-lagrangian factor=3", h=1e-3, integrator=Newmark())
    penalty = constraining_of(subject, scheme).penalty
    assert penalty == pytest.approx(3 * 4 / 1e-6 / least, rel=1e-8)


# -- engines held to each other ---------------------------------------------------------------


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


def assert_engines_agree(name, formulation, form, integrator, variant, evaluation, projection):
    """One correction, two, and a whole step, from states along a run: equal to rounding.

    Rounding of the balanced residual times the condition number of the balanced matrix;
    what the solver loses in an unscaled one, Newton's iteration makes good, so that single
    corrections are compared where the scaling is balanced.
    """
    subject = subject_of(name)
    options = {"scaling": variant, "evaluation": evaluation, "projection": projection}
    scheme = scheme_of(formulation, form, STEP[name], integrator, **options)
    start = march_of(subject, scheme)
    balanced = scheme_of(formulation, form, STEP[name], integrator)
    caps = (1, 2, 50) if variant in ("optimal", "optimal-printed") else (50,)
    for _ in range(2):
        condition = condition_number(subject, balanced, start.t, start.state)
        for cap in caps:
            capped = scheme_of(
                formulation, form, STEP[name], integrator, iteration_cap=cap, **options
            )
            marches = [
                march_of(subject, capped, engine, state=copy(start.state), done=start.done)
                for engine in ("kernel", "dense", "sparse")
            ]
            stretches = [march.advance(1) for march in marches]
            assert [march.ending for march in marches] == [COMPLETED] * 3
            ours = marches[0].state
            for march, stretch in zip(marches[1:], stretches[1:], strict=True):
                difference, size = balanced_difference(subject, scheme, ours, march.state)
                assert difference <= 100 * EPS * condition * size, (cap, condition)
                np.testing.assert_allclose(
                    ours.impulse / scheme.h, march.state.impulse / scheme.h,
                    rtol=0, atol=100 * EPS * condition * size / scheme.h**2
                    * np.abs(subject.mass_values).max() * 10,
                )  # fmt: skip
                if cap < 3:
                    # The recorded norms are of corrections, not yet of rounding.
                    first, second = stretches[0].norms[0], stretch.norms[0]
                    unit = 100 * EPS * condition * size / scheme.right.min()
                    np.testing.assert_allclose(first, second, rtol=1e-6, atol=unit)
        start.advance(3)


@pytest.mark.parametrize(
    ("formulation", "form", "evaluation", "name", "variant", "integrator", "projection"),
    covering(FORMULATIONS, FORMS, EVALUATIONS, QUADRATIC, VARIANTS, INTEGRATORS, PROJECTIONS),
    ids=LABEL,
)
def test_engines_agree(formulation, form, evaluation, name, variant, integrator, projection):
    """Kernel, dense and sparse SciPy march take the same step where Φ is quadratic."""
    assert_engines_agree(name, formulation, form, integrator, variant, evaluation, projection)


@pytest.mark.parametrize(
    ("formulation", "form", "name", "variant", "integrator", "projection"),
    covering(FORMULATIONS, FORMS, OTHERS, VARIANTS, INTEGRATORS, PROJECTIONS),
    ids=LABEL,
)
def test_engines_agree_on_other_constraints(
    formulation, form, name, variant, integrator, projection
):
    """The same where Φ depends on time or is not quadratic, and where M is singular."""
    assert_engines_agree(name, formulation, form, integrator, variant, DIRECT, projection)
