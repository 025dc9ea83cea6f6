"""A singular mass matrix, where constraints hold what it leaves free."""

import numpy as np
import pytest

import newmark_cli as newmark
from newmark_cli.newmark.constraints import projector
from newmark_cli.problems.problem import ProblemError
from newmark_cli.support.documents import DocumentError

DAMPED = "generalized-alpha rho=0.9"


def shadowed(held):
    """The shipped pendulum with a coordinate without mass, which follows x where it is held."""

    def constraints(u, t):
        return np.array([(u[0] ** 2 + u[1] ** 2 - 1) / 2, u[2] - u[0]])[: 1 + held]

    def gradient(u, t):
        return np.array([[u[0], -1.0], [u[1], 0.0], [0.0, 1.0]])[:, : 1 + held]

    return newmark.Definition(
        mass_matrix=np.diag([1.0, 1.0, 0.0]),
        u0=np.array([1.0, 0.0, 1.0]),
        v0=np.zeros(3),
        force=lambda u, v, t: np.array([0.0, -1.0, 0.0]),
        constraints=constraints,
        gradient=gradient,
        quadratic=True,
    )


def test_a_python_problem_marches_with_a_singular_mass_matrix():
    subjects = [newmark.problem(given) for given in (shadowed(True), "pendulum")]
    ggl = {"form": "a-lambda", "formulation": "ggl"}
    # GGL pushes along G in place of M⁻¹G there, and differs as far as it is of order 2.
    for how, allowed in (({}, 1e-10), ({"evaluation": "compensated"}, 1e-10), (ggl, 1e-5)):
        options = {"h": 1e-2, "t_end": 1.0, "every": 0, "integrator": DAMPED, **how}
        found, plain = (newmark.march(p, **options) for p in subjects)
        np.testing.assert_allclose(found.u[-1, :2], plain.u[-1], rtol=0, atol=allowed)
        np.testing.assert_allclose(found.u[-1, 2], plain.u[-1, 0], rtol=0, atol=allowed)
        one, other = found.multipliers[-1, 0], plain.multipliers[-1, 0]
        np.testing.assert_allclose(one, other, atol=max(1e-7, 30 * allowed))


def test_a_python_problem_with_a_free_massless_coordinate_is_refused():
    """Nothing says how a coordinate moves that has neither mass nor constraint."""
    with pytest.raises(ProblemError, match="singular on motions that the constraints allow"):
        newmark.problem(shadowed(False))


def test_a_massless_point_that_moves_is_refused():
    """Driven along x only it may move along y."""
    given = {
        "points": {
            "C": {"at": (0, 0), "velocity": (0.8, 0)},
            "P": {"at": (1, 0), "mass": 1, "velocity": (0.8, 0)},
        },
        "bars": {"rod": {"from": "C", "to": "P", "length": 1}},
        "motions": {"drive": {"point": "C", "x": {"amplitude": 0.1, "frequency": 8}}},
        "gravity": (0, -9.81),
    }
    with pytest.raises(DocumentError, match="C carries no mass of its own"):
        newmark.problem(given)


#: A disc, one director of which has no mass, on a rod that has its whole tensor.
DISC_ON_ROD = {
    "dimensions": 3,
    "bodies": {
        "rod": {"position": (0, 0, 0), "mass": 2, "centre": (0.5, 0, 0), "box": (1, 0.1, 0.2)},
        "disc": {"position": (1, 0, 0), "mass": 3, "inertia": (0.2, 0.4, 0.2)},
    },
    "joints": {
        "A": {"type": "spherical", "from": "ground", "to": "rod", "at": (0, 0, 0)},
        "B": {"type": "revolute", "from": "rod", "to": "disc", "at": (1, 0, 0), "axis": (0, 1, 0)},
    },
    "gravity": (0, 0, -9.81),
}


def test_directions_of_stabilisation_are_those_of_the_regular_bodies():
    """P = M⁻¹G wherever M can be inverted, though a director of another body has no mass."""
    subject = newmark.problem(DISC_ON_ROD)
    values = subject.values(0.0, subject.u0, subject.v0, np.zeros(subject.m)).g
    terms = projector(subject)
    found = np.zeros((subject.n, subject.m))
    np.add.at(found, (terms.rows, terms.columns), terms.values * values[terms.sources])
    gradient = np.zeros((subject.n, subject.m))
    pattern = subject.pattern
    np.add.at(gradient, (pattern.g_rows, pattern.g_columns), values)
    massless = np.flatnonzero(~subject.M.any(axis=0))
    assert massless.tolist() == [18, 19, 20]  # its second director, along the axis
    heavy = np.setdiff1d(np.arange(subject.n), massless)
    part = subject.M[np.ix_(heavy, heavy)]
    np.testing.assert_allclose(found[heavy], np.linalg.solve(part, gradient[heavy]), atol=1e-12)
    # Those that have none move as if they had as much as the heaviest.
    np.testing.assert_allclose(found[massless], gradient[massless] / subject.M.max(), atol=1e-15)
    assert np.linalg.eigvalsh(gradient.T @ found)[0] > 0
    options = {"h": 2e-3, "t_end": 0.2, "every": 0, "integrator": DAMPED}
    plain = newmark.march(subject, **options)
    ggl = newmark.march(subject, formulation="ggl", **options)
    np.testing.assert_allclose(ggl.u[-1], plain.u[-1], atol=1e-4)
