"""Marches that go on from a state of another march: what is lost, and who is told."""

import copy
import pickle
import warnings

import numpy as np
import pytest
from oracles import swing

import newmark_cli as newmark

ALPHA = "generalized-alpha rho=0.9"
INTEGRATORS = ("trapezoidal", ALPHA, "generalized-alpha rho=0.5", "hht alpha=0.1", "bdf2")
#: What leaves velocities off the constraints by something of its own h, and what does not.
LOSES = ("index-3", "augmented-lagrangian", "baumgarte rate_h=1")
KEEPS = ("index-2", "ggl", "index-1", "baumgarte rate=10", "velocity", "position-velocity")


def error(trajectory):
    """Largest error of λ = 3 sin θ after the first second."""
    t, found = trajectory.t, trajectory.constraint("bars.rod")
    return float(np.abs(found - 3 * np.sin(swing(t)[0]))[t > 1 + 1e-9].max())


def how(kind, integrator=ALPHA):
    """Options of a formulation or projection."""
    if kind in ("velocity", "position-velocity"):
        return {"integrator": integrator, "projection": kind}
    return {"integrator": integrator, "formulation": kind, "form": "a-lambda"}


def halfway(h, **options):
    """The state after a second."""
    return newmark.march("pendulum", h=h, t_end=1, every=0, **options).state


def changed(h, ratio, options):
    """Largest error of λ in the second that follows on one with another h; warnings."""
    first = halfway(h, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return error(
            newmark.march("pendulum", h=h * ratio, t_end=2, state=first, **options)
        ), caught


CHANGES = [
    *(("index-3", integrator, 2) for integrator in INTEGRATORS),
    ("index-3", ALPHA, 1 / 10),
    *((kind, INTEGRATORS[k % 5], 1 / 2) for k, kind in enumerate(KEEPS)),
]


@pytest.mark.parametrize(("kind", "integrator", "ratio"), CHANGES)
def test_what_keeps_its_order(kind, integrator, ratio):
    """Index 3 where velocities are scaled, other formulations and projections: nothing is said."""
    options = how(kind, integrator)
    (first, _), (second, caught) = (changed(h, ratio, options) for h in (0.01, 0.005))
    assert not caught
    assert 1.85 < np.log2(first / second) < 2.2
    coarser = error(newmark.march("pendulum", h=0.005 * max(1, ratio), t_end=2, **options))
    assert second < 3 * coarser


@pytest.mark.parametrize("kind", LOSES)
def test_what_enforces_constraints_alone_is_told_of(kind):
    """In every integrator, finer and coarser; a penalty is index 3, c/h of Baumgarte nearly."""
    right = error(newmark.march("pendulum", h=0.01, t_end=2, **how(kind)))
    for integrator in (*INTEGRATORS, "bdf1", "newmark beta=0.3025 gamma=0.6"):
        options = how(kind, integrator) | {"auxiliary": "rescale"}
        state = halfway(0.01, **options)
        for ratio in (1 / 2, 1 + 1e-6, 2):
            with pytest.warns(newmark.NewmarkWarning) as caught:
                newmark.march("pendulum", h=0.01 * ratio, steps=1, state=state, **options)
            assert len(caught) == 1
        assert changed(0.01, 1 / 10, options)[0] > 5 * right


def test_what_is_said():
    """What differs, and what to do; where the line of the caller is."""
    state = halfway(0.01, integrator=ALPHA)
    with pytest.warns(newmark.NewmarkWarning) as caught:
        newmark.march("pendulum", h=0.005, steps=1, state=state)
    (warning,) = caught
    assert str(warning.message) == (
        "state: made with h = 0.01, here 0.005; integrator generalized-alpha rho=0.9, here newmark "
        "beta=0.25 gamma=0.5: λ loses its order of accuracy, because the state does not meet the "
        "constraints as steps of this march leave them; take projection='velocity', or "
        "formulation='index-2' in both marches"
    )
    assert warning.filename == __file__
    # The way out needs nothing of the first march.
    rest = newmark.march(
        "pendulum", h=0.005, t_end=2, state=state, integrator=ALPHA, projection="velocity"
    )
    assert error(rest) < 2e-4


def test_states_remember_their_h():
    """Pickled, copied, of a loop or of a callback; going on by any of the ways to march."""
    seen = []
    trajectory = newmark.march("pendulum", h=0.01, t_end=0.1, callback=seen.append)
    step = next(iter(newmark.steps("pendulum", h=0.01)))
    for state in (
        seen[-1], trajectory.state, copy.deepcopy(step), pickle.loads(pickle.dumps(step))
    ):  # fmt: skip
        newmark.march("pendulum", h=0.01, steps=1, state=state)
        for march in (newmark.march, newmark.steps):
            with pytest.warns(newmark.NewmarkWarning, match="h = 0.01, here 0.02") as caught:
                march("pendulum", h=0.02, t_end=1, state=state, auxiliary="keep")
            assert [warning.filename for warning in caught] == [__file__]


@pytest.mark.bits("a start on the constraints is no longer on them")
def test_nothing_is_said_where_nothing_is_lost():
    """The same h, but for rounding; no step taken; rest; straight lines; λ recovered."""
    state, usual = halfway(0.01, integrator=ALPHA), {"integrator": ALPHA}
    for h in (0.01, np.nextafter(0.01, 1), 1 / 99.99999999999999):
        rest = newmark.march("pendulum", h=h, t_end=2, state=state, **usual)
        assert (rest.steps, error(rest)) == (100, pytest.approx(1.1e-4, rel=0.05))
        newmark.march("pendulum", h=h, steps=1, state=state, **how("augmented-lagrangian"))
    newmark.march("pendulum", h=0.02, steps=1, state=state, multipliers="recovered", **usual)
    start = newmark.march("pendulum", h=0.01, steps=0, v0=[0, 1]).state
    newmark.march("pendulum", h=0.02, steps=1, state=start)
    hanging = {
        "points": {"O": {"fixed": (0, 0)}, "P": {"at": (0.6, -0.8), "mass": 2}},
        "bars": {"rod": {"from": "O", "to": "P", "length": 1}},
        "forces": {"wind": {"at": "P", "force": (0.75 * 2 * 9.81, 0)}},
        "gravity": (0, -9.81),
    }
    sliding = {
        "points": {"P": {"at": (0, 0), "velocity": (2, 1), "mass": 2}},
        "sliders": {"rail": {"point": "P", "through": (0, 0), "direction": (2, 1)}},
        "gravity": (0, -9.81),
    }
    for mechanism, evaluation in ((hanging, "direct"), (sliding, "compensated")):
        usual["evaluation"] = evaluation
        state = newmark.march(mechanism, h=0.01, t_end=3, every=0, **usual).state
        newmark.march(mechanism, h=0.005, steps=1, state=state, **usual)
