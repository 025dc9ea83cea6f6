"""Problems in Python: a published reference, engines, and what is refused."""

import examples
import marching
import numpy as np
import pytest
from marching import scheme_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.march import initial_state
from newmark_cli.problems import python_problem
from newmark_cli.problems.problem import ProblemError

#: IVP test set, t = 3: x_l, y_l, x_r, y_r and their rates.
REFERENCE = np.array(
    [0.493455784275402809122e-1, 0.496989460230171153861, 0.104174252488542151681e1,
     0.373911027265361256927]
)  # fmt: skip
REFERENCE_RATES = np.array(
    [-0.770583684040972357970e-1, 0.744686658723778553466e-2, 0.175568157537232222276e-1,
     0.770341043779251976443]
)  # fmt: skip


def march(subject, h, t_end, form="u-lambda"):
    scheme = scheme_of(form, "optimal", h)
    state = initial_state(subject, scheme)
    _, iterations = marching.march(marching.compiled, subject, scheme, state, 0, round(t_end / h))
    assert np.all(iterations > 0)
    return state


def test_car_axis_converges_to_the_published_reference():
    """Φ depends on time; positions and velocities at t = 3 converge at order 2."""
    errors = []
    for step in (1e-3, 5e-4):
        u, v = march(examples.car_axis(True), step, 3.0).fields[:2]
        errors.append([np.abs(u - REFERENCE).max(), np.abs(v - REFERENCE_RATES).max()])
    np.testing.assert_allclose(np.log2(np.divide(*errors)), 2, atol=0.05)
    assert errors[1][0] < 8e-5


GOOD = """
import numpy as np
class Problem:
    mass_matrix = np.eye(2)
    u0 = np.array([1.0, 0.0])
    v0 = np.array([0.0, 0.0])
    def force(self, u, v, t): return np.array([0.0, -1.0])
    def constraints(self, u, t): return np.array([(u @ u - 1) / 2])
    def gradient(self, u, t): return u[:, None]
    def stiffness(self, u, v, multipliers, t): return -multipliers[0] * np.eye(2)
    def damping(self, u, v, t): return np.zeros((2, 2))
def factory(scale=1.0):
    return Problem()
"""


def write(tmp_path, text):
    path = tmp_path / "mine.py"
    path.write_text(text)
    return path


def test_any_object_with_the_attributes_serves(tmp_path):
    """No base class is asked for; its terms are those of the package's pendulum."""
    mine = python_problem.load(write(tmp_path, GOOD), "factory", {"scale": 2}, "mine")
    assert not mine.compiled
    state = np.array([0.6, 0.8]), np.array([0.4, -0.3]), np.array([2.0])
    for one, other in zip(
        mine.evaluate(0.1, *state), problem("pendulum").evaluate(0.1, *state), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("return Problem()", "raise KeyError('oops')", "line 13: factory failed: KeyError: 'oops'"),
    ("return Problem()", "return 3", "line 12: factory returned 3, which lacks mass_matrix, u0"),
    ("def factory", "def other", "has no function 'factory'"),
    ("import numpy", "import nmpy", "line 2: ModuleNotFoundError"),
    ("class Problem:", "class Problem", "line 3: SyntaxError"),
    ("np.array([0.0, -1.0])", "np.zeros(3)",
     "line 7: force returned an array of shape (3,), expected an array of shape (2,)"),
    ("np.array([0.0, -1.0])", "[0, [1]]", "line 7: force returned a list, expected an array"),
    ("np.array([0.0, -1.0])", "1 / 0", "mine.py, line 7: force failed: ZeroDivisionError"),
    ("np.array([0.0, -1.0])", "np.array([0.0, np.nan])",
     "line 7: force is not finite at the start: component 2 is nan"),
    ("np.array([(u @ u - 1) / 2])", "(u @ u - 1) / 2",
     "line 8: constraints returned 0.0, expected an array of shape (m,)"),
    ("u[:, None]", "2 * u[:, None]",
     "line 9: gradient disagrees with differences in row 1, column 1"),
    ("u[:, None]", "0 * u[:, None]", "redundant"),
    ("-multipliers[0] * np.eye", "multipliers[0] * np.eye", "line 10: stiffness disagrees with"),
    ("np.zeros((2, 2))", "np.ones((2, 2))",
     "line 11: damping disagrees with differences in row 1"),
    ("np.eye(2)\n    u0", "np.zeros((2, 2))\n    u0",
     "mass_matrix must be positive: it has a negative eigenvalue, or is 0"),
    ("np.eye(2)\n    u0", "np.eye(3)\n    u0",
     "mass_matrix must be an array of shape (2, 2), given an array"),
    ("u0 = np.array([1.0, 0.0])", "u0 = 'here'",
     "line 12: factory: u0 must be an array of shape (n,), given 'here'"),
    ("u0 = np.array([1.0, 0.0])", "u0 = np.array([1.1, 0.0])", "u0 violates the constraints"),
    ("    u0 =", "    t0 = None\n    u0 =", "t0 must be a number, given None"),
    ("v0 = np.array([0.0, 0.0])", "v0 = np.array([1.0, 0.0])", "v0 violates the constraints"),
    ("v0 = np.array([0.0, 0.0])", "v0 = [0, .nan]".replace(".", "np."), "v0 must be finite"),
    ("    u0 =", "    energy = 3\n    u0 =", "factory: energy must be a function, given 3"),
])  # fmt: skip
def test_mistakes_are_named(tmp_path, old, new, words):
    assert old in GOOD
    with pytest.raises(ProblemError) as caught:
        python_problem.load(write(tmp_path, GOOD.replace(old, new, 1)), "factory", {}, "mine")
    text = str(caught.value)
    assert "mine.py" in text
    assert words in text, text
    assert "\n" not in text
