"""Velocities of corrected starts; `test_formulations_accuracy` has what they are for."""

import numpy as np
from each import each
from marching import scheme_of
from mpmath import matrix, mp, mpf

from newmark_cli.newmark.formulation import CORRECTED
from newmark_cli.newmark.march import initial_state
from newmark_cli.problems import python_problem
from newmark_cli.problems.starting import constraint_jerk, corrected_velocity

RIPPLES = """
import numpy as np
from newmark_cli.problems.python_problem import Definition

def wave(t):
    return 0.1 * np.sin(3 * t + 0.5)

def factory(given=False):
    def curvature(u, v, t):
        c, s = np.cos(3 * u[0]), np.sin(3 * u[0])
        return np.array([1.8 * s * v[0]**2 + 2 * v[1]**2 + 9 * wave(t),
                         2 * (v[0]*v[0] + v[1]*v[1] + v[2]*v[2])])
    v = np.array([0.4, -0.2, 0.3])
    gradient = lambda u, t: np.array(
        [[-0.6 * np.cos(3 * u[0]), 2 * u[0]], [2 * u[1], 2 * u[1]], [1.0, 2 * u[2]]])
    constraints = lambda u, t: np.array(
        [u[2] + u[1]**2 - 0.2 * np.sin(3 * u[0]) - wave(t) - A, u @ u - B])
    u0 = np.array([0.5, 0.4, 0.7])
    G = gradient(u0, 0.0)
    v = v - np.linalg.pinv(G.T) @ (G.T @ v + np.array([-0.3 * np.cos(0.5), 0.0]))
    return Definition(
        mass_matrix=np.diag([1.0, 2.0, 3.0]), u0=u0, v0=v,
        force=lambda u, v, t: np.array([np.sin(t) - u[1], -v[0] * v[2], -9.81]),
        constraints=constraints, gradient=gradient, curvature=curvature if given else None,
    )
""".replace("- A", f"- {0.7 + 0.16 - 0.2 * np.sin(1.5) - 0.1 * np.sin(0.5)!r}").replace(
    "- B", "- 0.9"
)


def ripples_jerk(subject):
    """Gᵀu‴ at the start in mpmath: u'' from the index-1 system, once more by differences."""

    def gradient(u):
        return matrix([[-mpf(3) / 5 * mp.cos(3 * u[0]), 2 * u[0]], [2 * u[1]] * 2, [1, 2 * u[2]]])

    def acceleration(u, v, t):
        c = mpf(9) / 5 * mp.sin(3 * u[0]) * v[0] ** 2 + 2 * v[1] ** 2
        curvature = [c + mpf(9) / 10 * mp.sin(3 * t + 0.5), 2 * sum(x**2 for x in v)]
        force = [mp.sin(t) - u[1], -v[0] * v[2], mpf(-9.81)]
        bordered, g = matrix(5, 5), gradient(u)
        for i in range(3):
            bordered[i, i] = i + 1
            for k in range(2):
                bordered[i, 3 + k], bordered[3 + k, i] = -g[i, k], g[i, k]
        return list(mp.lu_solve(bordered, matrix([*force, *(-x for x in curvature)])))[:3]

    with mp.workdps(50):
        u, v = ([mpf(float(x)) for x in array] for array in (subject.u0, subject.v0))
        a, step = acceleration(u, v, mpf(0)), mpf(10) ** -15

        def then(s):
            place = [x + s * y + s**2 * z / 2 for x, y, z in zip(u, v, a, strict=True)]
            return acceleration(place, [y + s * z for y, z in zip(v, a, strict=True)], s)

        third = [(p - q) / (2 * step) for p, q in zip(then(step), then(-step), strict=True)]
        return np.array([float(x) for x in gradient(u).T * matrix(third)])


@each("given", [False, True])
def test_the_jerk_where_constraints_are_neither_quadratic_nor_free_of_time(tmp_path, given):
    """Against mpmath: Φ'' differentiated along the motion, given by the user or computed."""
    path = tmp_path / "mine.py"
    path.write_text(RIPPLES)
    subject = python_problem.load(path, "factory", {"given": given}, "mine")
    expected = ripples_jerk(subject)
    np.testing.assert_allclose(
        constraint_jerk(subject), expected, rtol=0, atol=1e-8 * np.abs(expected).max()
    )
    # Least change in the norm of M: M δv is in the range of G.
    change = corrected_velocity(subject, 0.01) - subject.v0
    gradient = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(2)).G
    np.testing.assert_allclose(gradient.T @ change, -1e-4 / 12 * expected, rtol=1e-6)
    pulled = subject.M @ change
    inside = gradient @ np.linalg.lstsq(gradient, pulled, rcond=None)[0]
    np.testing.assert_allclose(inside, pulled, rtol=0, atol=1e-9 * np.abs(pulled).max())
    # What the start leaves of Φ' in proportion to h² is what a change of h goes by.
    state = initial_state(subject, scheme_of("u-lambda", "none", 0.01, start=CORRECTED))
    np.testing.assert_allclose(1e-4 * state.rates[1:], state.psi, rtol=1e-6)
