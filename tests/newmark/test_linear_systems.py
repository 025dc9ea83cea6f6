"""Linear systems of marches: those that Newton's iteration solves."""

import numpy as np
import pytest
from conftest import SWING

import newmark_cli as newmark
from newmark_cli.newmark.linear import sparse
from newmark_cli.support.errors import ArgumentError, InputError


def swing(tmp_path):
    """A problem in plain Python."""
    (tmp_path / "mine.py").write_text(SWING)
    return newmark.problem(f"{tmp_path}/mine.py:swing")


@pytest.mark.parametrize("formulation", ["ggl", "augmented-lagrangian"])
def test_systems_are_those_that_the_march_solves(tmp_path, monkeypatch, formulation):
    """Bit by bit, where Python solves: what LU is given, iteration by iteration."""
    problem, solves = swing(tmp_path), []

    class Watched(sparse.SparseFactors):
        def __init__(self, ordered, rows, columns):
            super().__init__(ordered, rows, columns)
            self.matrix = np.zeros(ordered.shape)
            self.matrix[np.ix_(rows, columns)] = ordered.toarray()

        def solve(self, rhs):
            solves.append((self.matrix, rhs.copy()))
            return super().solve(rhs)

    monkeypatch.setattr(sparse, "SparseFactors", Watched)
    how = {"h": 1e-3, "form": "u-v-lambda", "formulation": formulation, "scaling": "left"}
    how["linear_solver"] = "sparse-lu"
    newmark.march(problem, steps=3, **how, every=0)
    before, solves[:] = solves[:], []
    newmark.march(problem, steps=2, **how, every=0)
    of_step = before[len(solves) :]
    found = [*newmark.linear_systems(problem, steps=[3], every_iteration=True, **how)]
    assert [system.iteration for system in found] == list(range(1, len(of_step) + 1))
    for system, (matrix, rhs) in zip(found, of_step, strict=True):
        assert np.array_equal(system.matrix.toarray(), matrix)
        assert np.array_equal(system.rhs, rhs)
        assert sum(system.sizes) == len(rhs)
        assert len(system.unknowns) == len(system.rows) == len(system.sizes)
    ends = [*newmark.linear_systems(problem, steps=[3], **how)]
    assert [system.iteration for system in ends] == [1, len(of_step)]
    assert all(system.iterations == len(of_step) for system in ends)


def test_systems_of_steps_of_other_sizes():
    """Of a change of h, and of a state that is continued: size, time and number of the step."""
    how = {"form": "a-lambda", "scaling": "none"}
    sizes = [1e-3] * 5 + [5e-4] * 5
    first, *_ = newmark.linear_systems("pendulum", h=sizes, steps=[7], **how)
    assert (first.h, first.t, first.left["D"]) == (5e-4, pytest.approx(0.006, abs=1e-12), 1.0)
    # Row C is Gᵀ ∂u/∂a = βh² (x, y).
    passed = newmark.march("pendulum", h=sizes, **how)
    predicted = passed.u[6] + 5e-4 * passed.v[6]
    row = first.matrix.toarray()[2, :2]
    assert row == pytest.approx(5e-4**2 / 4 * predicted, rel=1e-6)
    state = newmark.march("pendulum", h=1e-3, steps=100).state
    for h in (1e-3, 5e-4, [5e-4] * 3):
        later = newmark.march("pendulum", h=h, steps=3, state=state)
        assert later.numbers.tolist() == [100, 101, 102, 103]
        first, *_ = newmark.linear_systems("pendulum", h=h, steps=[103], state=state)
        assert (first.step, first.t) == (103, pytest.approx(later.t[-1], abs=1e-12))
    for h, steps, told in (
        (5e-4, [100], "steps must be at least 101 after this state, given 100"),
        ([5e-4] * 3, [104], "h has the sizes of 3 steps, 104 is beyond them"),
    ):
        with pytest.raises(newmark.ArgumentError, match=told):
            newmark.linear_systems("pendulum", h=h, steps=steps, state=state)


def test_a_system_is_that_of_the_equations():
    """Written out again for the pendulum, eqs. 30; no code in common."""
    h, beta, gamma = 1e-3, 0.3025, 0.6
    how = {"h": h, "integrator": f"newmark beta={beta} gamma={gamma}", "scaling": "optimal"}
    march = newmark.march("pendulum", steps=9, **how)
    u, v, a, (multiplier,) = march.u[-1], march.v[-1], march.a[-1], march.multipliers[-1]
    system = next(newmark.linear_systems("pendulum", steps=[10], **how))
    u_new = u + h * v
    a_new = (u_new - u - h * v) / (beta * h**2) - (1 / (2 * beta) - 1) * a
    gravity = np.array([0.0, newmark.problem("pendulum").evaluate(0, u, v, [0.0]).force[1]])
    left, right = np.array([beta * h**2] * 2 + [1]), np.array([1, 1, 1 / (beta * h**2)])
    jacobian = np.zeros((3, 3))
    jacobian[:2, :2] = np.eye(2) * (1 / (beta * h**2) - multiplier)
    jacobian[:2, 2], jacobian[2, :2] = -u_new, u_new
    residual = [*(a_new - gravity - multiplier * u_new), (u_new @ u_new - 1) / 2]
    expected = left[:, None] * jacobian * right
    np.testing.assert_allclose(system.matrix.toarray(), expected, rtol=1e-12)
    np.testing.assert_allclose(system.rhs, -left * residual, rtol=1e-6, atol=1e-16)
    assert (system.beta, system.gamma, system.t) == (beta, gamma, pytest.approx(0.01))
    assert system.left == {"D": beta * h**2, "C": 1.0}
    assert system.right == {"u": 1.0, "lambda": pytest.approx(1 / (beta * h**2), rel=1e-15)}


@pytest.mark.parametrize(("options", "message"), [
    ({"steps": 3}, "steps must be a list of numbers, given 3"),
    ({"steps": []}, "steps must name a step, given none"),
    ({"steps": [0]}, "steps must be at least 1, given 0"),
    ({"steps": [1], "every": 2}, "every: linear_systems keeps nothing"),
    ({"steps": [1], "every_iteration": 1}, "every_iteration must be True or False"),
    ({"steps": [1], "precision": "float32"}, "precision float32: only systems of marches in"),
])  # fmt: skip
def test_what_no_systems_are_to_be_had_of(options, message):
    with pytest.raises((ArgumentError, InputError), match=f"^{message}"):
        newmark.linear_systems("pendulum", h=1e-3, **options)
