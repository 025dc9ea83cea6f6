"""What a motion keeps, and what energy is: misfits of known size, independent energies."""

import numpy as np
import oracles
import pytest
from mechanisms import built
from test_reference import pendulum

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.invariants import INVARIANTS, invariants
from newmark_cli.newmark.march_data import State
from newmark_cli.study import observers


def state_of(subject, u, v, multipliers, t=0.0):
    """A state; its accelerations play no part."""
    fields = np.array([u, v, np.zeros_like(u), np.zeros_like(u)])
    multipliers = np.asarray(multipliers, float)
    none = np.zeros_like(multipliers)
    return State(fields, fields[2:], multipliers, fields[2:], none, none, none, none, none)


def consistent(subject, u, v, t=0.0):
    """A state with the multipliers that follow from u and v."""
    return state_of(subject, u, v, oracles.index_1(subject, t, u, v)[1])


def relative(subject, samples):
    """Largest relative value of each invariant."""
    return {name: abs(off).max() for name, off in observers.invariants(subject, samples).items()}


@pytest.mark.parametrize("t", [0.3, 3.708])
def test_exact_motion_of_the_pendulum_keeps_all(t):
    """Elliptic functions by mpmath; sizes are those of the whole motion, 3.708 is a turn."""
    subject = problem("pendulum")
    samples = [invariants(subject, s, state_of(subject, *pendulum(s))) for s in (t, 1.85)]
    found = relative(subject, samples)
    assert set(found) == set(INVARIANTS)
    assert all(value < 2e-15 for value in found.values())


def test_misfits_of_the_pendulum():
    """Off its circle, off its tangent, with another λ: by how much, in metres and so on."""
    subject = problem("pendulum")
    u, v = np.array([0.6, -0.8]) * (1 + 1e-6), np.array([0.8, 0.6]) + 1e-5 * np.array([0.6, -0.8])
    found = invariants(subject, 0.0, state_of(subject, u, v, [5.0]))
    found = {name: (misfit.error, *misfit.sizes) for name, misfit in found.items()}
    assert found["position"] == pytest.approx((1e-6, 0.8 * (1 + 1e-6)), rel=1e-6)
    assert found["velocity"] == pytest.approx((1e-5, 0.8), rel=1e-4)
    # M a = f + Gλ along the rod: λ |u|² = u·(0, 1) − |v|².
    multiplier = (u[1] - v @ v) / (u @ u)
    assert found["multiplier"] == pytest.approx((5 - multiplier, -multiplier), rel=1e-12)
    # T = 1/2, V = −0.8, from rest at V = 0.
    error = 0.5 * v @ v + u[1]
    assert found["energy"] == pytest.approx((abs(error), 0.5 * v @ v - u[1]), rel=1e-12)


def test_driven_points_are_compared_with_their_laws():
    """Φ_t counts, in the misfit and in its size; a motion has no energy."""
    subject = built(
        "points: {O: {fixed: [0, 0]}, P: {at: [2, 0], mass: 3, velocity: [0, 8]}}\n"
        "bars: {arm: {from: O, to: P, length: 2}}\n"
        "motions: {drive: {point: P, y: {rate: 8}}}\n"
    )
    t = 0.1
    y = 8 * t
    x = np.sqrt(4 - y * y)
    u, v = np.array([x, y]), np.array([-8 * y / x, 8.0])
    found = invariants(subject, t, consistent(subject, u, v, t))
    assert set(found) == {"position", "velocity", "multiplier"}
    assert all(
        np.all(abs(misfit.errors) <= 1e-13 * np.max(misfit.sizes)) for misfit in found.values()
    )
    found = invariants(subject, t, consistent(subject, u + np.array([0, 1e-8]), v * 0, t))
    assert found["position"].error == pytest.approx(1e-8, rel=1e-6)
    velocity = found["velocity"]
    assert (velocity.error, *velocity.sizes) == pytest.approx((8.0, 8.0))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_states_that_are_not_finite(value):
    """Not a number, and no exception."""
    subject = problem("andrews")
    broken = np.full(subject.n, value)
    found = invariants(subject, 0.0, state_of(subject, broken, broken, np.zeros(7)))
    assert not np.isfinite(relative(subject, [found])["position"]) or value == 1e300
    assert not np.isfinite(relative(subject, [found])["multiplier"])
    # At the centre of its circle the pendulum's constraint has no direction.
    subject = problem("pendulum")
    found = invariants(subject, 0.0, state_of(subject, np.zeros(2), np.ones(2), [0.0]))
    assert np.isnan(relative(subject, [found])["multiplier"])


#: A body and a mass on a bar that hangs from it.
HUNG = """\
points:
  O: {fixed: [0, 0]}
  A: {at: [1, 0], velocity: [0, 0.5]}
  C: {at: [1, -1], mass: 2, velocity: [0.5, 0.5]}
bodies: {one: {from: O, to: A, length: 1, mass: 3, inertia: 0.5}}
bars: {rod: {from: A, to: C, length: 1}}
springs: {s: {from: O, to: C, stiffness: 7, rest_length: 0.3}}
gravity: [1, -9]
"""


@pytest.mark.parametrize(("addition", "conserved"), [
    ("", True),
    ("dampers: {d: {from: O, to: C, damping: 0}}\n", True),
    ("dampers: {d: {from: O, to: C, damping: 1}}\n", False),
    ("torques: {t: {on: one, torque: 0}}\n", True),
    ("torques: {t: {on: one, torque: 2}}\n", False),
    ("motions: {m: {point: C, x: {}}}\nproject_velocities: true\n", True),
    ("motions: {m: {point: C, x: {value: 1}}}\nproject_velocities: true\n", True),
    ("motions: {m: {point: C, x: {rate: 1}}}\nproject_velocities: true\n", False),
    ("motions: {m: {body: one, angle: {acceleration: 1}}}\nproject_velocities: true\n", False),
    ("motions: {m: {point: C, y: {amplitude: 1, frequency: 2}}}\nproject_velocities: true\n",
     False),
])  # fmt: skip
def test_what_conserves_energy(addition, conserved):
    """Nothing that damps, drives or moves with time."""
    subject = built(HUNG + addition)
    found = invariants(subject, 0.0, consistent(subject, subject.u0, subject.v0))
    assert ("energy" in found) == conserved
    assert (subject.energies(0.0, subject.u0, subject.v0) is not None) == conserved


def test_a_march_that_makes_kinetic_energy_is_called_unstable():
    """A heavy top spins up although each step converges; motions that turn and stop do not."""
    for integrator in ("trapezoidal", "generalized-alpha rho=0.9"):
        with pytest.warns(newmark.NewmarkWarning, match="the march is unstable") as caught:
            done = newmark.march("heavy-top", h=1e-3, t_end=0.2, integrator=integrator)
        assert done.status == "ok"
        assert done.energy[-1] > 5 * done.energy[0] > 0
        said = float(str(caught[0].message).partition(" times")[0].rpartition(" ")[2])
        assert said > 5
    # A whole period: there is hardly any energy of motion at its start and its end.
    newmark.march("pendulum", h=1e-2, t_end=2.0)
    newmark.march("heavy-top", h=1e-4, t_end=0.02, integrator="generalized-alpha rho=0.9")


def test_a_march_that_makes_energy_is_named_in_verdicts(tmp_path):
    """A study that measures invariants, at h at which a heavy top spins up."""
    study = {
        "study": "top", "problem": "heavy-top", "form": "u-lambda", "preconditioning": "optimal",
        "integrator": ["generalized-alpha rho=0.9"], "measure": ["invariant", "error"],
        "h": [1e-3, 5e-4, 2.5e-4], "t_end": 0.2,
    }  # fmt: skip
    told = newmark.slopes(newmark.run(study, results=tmp_path)).set_index("quantity")
    of_energy = told["reason"].str.contains("at h = 0.001 the energy, which is conserved, is off")
    assert of_energy[told["verdict"] == "undecided"].all()
    assert not of_energy[told["verdict"] == "pass"].any()
    assert set(told[of_energy].index) >= {"u", "v", "lambda"}


@pytest.mark.usefixtures("few_draws")
def test_advice_names_a_march_that_makes_energy():
    """Before it is run."""
    said = newmark.advise("heavy-top", h=[1e-3, 1e-4], integrator="generalized-alpha rho=0.9")
    unstable = [one for one in said.findings if "the march is unstable" in one]
    assert [one.partition(",")[0] for one in unstable] == ["h = 0.001"]


def test_energy_of_a_python_problem():
    """The user's total energy, of which the kinetic part is known."""
    told = newmark.problem(
        newmark.Definition(
            mass_matrix=np.diag([2.0, 3.0]),
            u0=np.array([1.0, 0.0]),
            v0=np.zeros(2),
            force=lambda u, v, t: np.array([0.0, -4.0]),
            constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
            gradient=lambda u, t: u[:, None],
            energy=lambda u, v, t: v[0] ** 2 + 1.5 * v[1] ** 2 + 4 * u[1] + 7,
        )
    )
    found = told.energies(0.0, np.array([0.6, -0.8]), np.array([1.0, 2.0]))
    assert found == pytest.approx((7, 7 - 3.2))
