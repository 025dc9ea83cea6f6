"""The Python library: trajectories, stepping, restarts, starts, errors."""

import dataclasses
import math
import pickle
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.newmark.callbacks import Callbacks
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha

#: Every integrator, in each of its spellings.
INTEGRATORS = {
    "trapezoidal": "trapezoidal",
    "newmark": "newmark beta=0.3025 gamma=0.6",
    "generalized-alpha": {"method": "generalized-alpha", "rho": 0.9},
    "hht": "hht alpha=0.1",
    "bdf1": {"method": "bdf1"},
    "bdf2": BDF2(),
}


def same(*pairs):
    """Equal to the last bit."""
    for one, other in pairs:
        assert np.asarray(one).dtype == np.asarray(other).dtype
        assert np.array_equal(one, other)


def double_pendulum(**more):
    """Unit masses and lengths, level, under gravity 9.81."""
    return newmark.Definition(
        mass_matrix=np.eye(4),
        u0=[1.0, 0.0, 2.0, 0.0],
        v0=np.zeros(4),
        force=lambda u, v, t: np.array([0.0, -9.81, 0.0, -9.81]),
        constraints=lambda u, t: (
            np.array([u[0] ** 2 + u[1] ** 2 - 1, (u[2] - u[0]) ** 2 + (u[3] - u[1]) ** 2 - 1]) / 2
        ),
        gradient=lambda u, t: np.array(
            [[u[0], u[0] - u[2]], [u[1], u[1] - u[3]], [0, u[2] - u[0]], [0, u[3] - u[1]]]
        ),
        **more,
    )


DOUBLE = {
    "points": {
        "O": {"fixed": (0, 0)},
        "A": {"at": (1, 0), "mass": 1.0},
        "B": {"at": np.array([2.0, 0.0]), "mass": np.float64(1.0)},
    },
    "bars": {
        "upper": {"from": "O", "to": "A", "length": 1.0},
        "lower": {"from": "A", "to": "B", "length": 1},
    },
    "gravity": [0, -9.81],
}


@pytest.mark.parametrize(("every", "kept"), [(1, 13), (4, 4), (5, 4), (12, 2), (100, 2), (0, 1)])
def test_what_is_kept_does_not_change_the_march(every, kept):
    """The start, every k-th step and the last; with 0 the last."""
    whole = newmark.march("andrews", h=1e-4, steps=12)
    found = newmark.march("andrews", h=1e-4, steps=12, every=every)
    numbers = sorted({*range(0, 13, every), 12}) if every else [12]
    assert len(found.t) == len(numbers) == kept
    same((found.t, whole.t[numbers]), (found.u, whole.u[numbers]), (found.v, whole.v[numbers]))
    same((found.a, whole.a[numbers]), (found.multipliers, whole.multipliers[numbers]))
    same((found.iterations, whole.iterations[numbers]))
    same((found.state.carried.state.past, whole.state.carried.state.past))
    assert (found.steps, found.newton_iterations) == (12, whole.iterations.sum())


@pytest.mark.parametrize("solver", ["dense-lu", "gmres"])
def test_steps_are_recorded_alike_by_every_solver(solver):
    how = {"h": 1e-3, "t_end": 0.047, "linear_solver": solver}
    whole = newmark.march("double-pendulum", **how)
    seen = list(newmark.march("double-pendulum", steps=True, **how))
    assert len(seen) == 47
    same((whole.u[1:], [step.u for step in seen]), (whole.a[1:], [step.a for step in seen]))
    same((whole.iterations[1:], [step.iterations for step in seen]))


def test_times_are_met_by_the_nearest_steps():
    """In any order, each once; they say which steps they are."""
    found = newmark.march("pendulum", h=0.1, at=[0.52, 0.0, 0.18, 0.22, 0.5])
    assert found.t.tolist() == pytest.approx([0.0, 0.2, 0.5])
    assert found.steps == 6
    whole = newmark.march("pendulum", h=0.1, t_end=1.0)
    same((found.u, whole.u[[0, 2, 5]]))
    longer = newmark.march("pendulum", h=0.1, t_end=1.0, at=[0.18])
    assert (longer.t.tolist(), longer.steps, longer.state.t) == ([0.2], 10, whole.t[-1])


def test_arrays_have_names():
    """Coordinates, points and constraints by name, and as a DataFrame."""
    found = newmark.march(newmark.problem(DOUBLE), h=1e-2, t_end=0.5, every=10)
    assert found.coordinate_names == ("A.x", "A.y", "B.x", "B.y")
    same((found.coordinate("B.x", "v"), found.v[:, 2]), (found.point("B"), found.u[:, 2:]))
    same((found.constraint("bars.lower"), found.multipliers[:, 1]))
    frame = found.to_frame()
    assert isinstance(frame, pd.DataFrame)
    names = ["A.x", "A.y", "B.x", "B.y"]
    assert list(frame.columns) == [
        "t", *(f"{field}[{name}]" for field in "uva" for name in names),
        "lambda[bars.upper]", "lambda[bars.lower]", "energy",
    ]  # fmt: skip
    assert len(frame) == 6
    same((frame["a[B.y]"].to_numpy(), found.a[:, 3]))
    # Both masses at their own height, and their speed.
    heights = found.u[:, 1] + found.u[:, 3]
    assert found.energy == pytest.approx((found.v**2).sum(axis=1) / 2 + 9.81 * heights, abs=1e-12)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_is_the_true_acceleration(integrator):
    """M v' = f + G λ at every step, whatever acceleration the integrator carries."""
    how = INTEGRATORS[integrator]
    found = newmark.march(newmark.problem(DOUBLE), h=1e-3, t_end=0.1, every=5, integrator=how)
    for step in range(len(found.t)):
        state = (found.t[step], found.u[step], found.v[step], found.multipliers[step])
        force = found.problem.evaluate(*state).force
        assert force == pytest.approx(found.a[step], abs=1e-6)


def test_a_double_pendulum_from_a_definition_a_dict_and_its_equations_agree():
    """Three descriptions take the same steps, to rounding."""
    how = {"h": 1e-3, "t_end": 0.5, "every": 100}
    one = newmark.march(double_pendulum(quadratic=True), **how)
    other = newmark.march(newmark.problem(DOUBLE), **how)
    assert (one.status, other.status) == ("ok", "ok")
    assert one.u == pytest.approx(other.u, abs=1e-11)
    assert one.multipliers == pytest.approx(other.multipliers, rel=1e-4)
    # Angles from the horizontal fall as two unit masses on unit rods do: at the start
    # a_A = −g, a_B = −g, whatever λ, which vanish there.
    assert other.a[0] == pytest.approx([0, -9.81, 0, -9.81])
    assert other.multipliers[0] == pytest.approx([0, 0], abs=1e-14)


def test_families_files_factories_and_problems_are_taken(tmp_path, monkeypatch):
    """Whatever describes a problem; a file is read anew."""
    monkeypatch.chdir(tmp_path)
    chain = newmark.problem("chain", links=3)
    assert (chain.n, chain.m, newmark.problem(chain)) == (6, 3, chain)
    file = Path("mine.yaml")
    for length in (1, 2):
        file.write_text(
            f"points: {{O: {{fixed: [0, 0]}}, P: {{at: [{length}, 0], mass: 1}}}}\n"
            f"bars: {{rod: {{from: O, to: P, length: {length}}}}}\n"
        )
        assert newmark.problem(file).u0.tolist() == [length, 0.0]
        assert newmark.march("mine.yaml", h=0.1, steps=1).u[0] == pytest.approx([length, 0.0])
    example = Path(__file__).parents[2] / "docs/examples/car_axis.py"
    assert newmark.problem(f"{example}:car_axis", compiled=False).n == 4


def test_a_march_is_stepped_and_left():
    """What was seen is usable, and the march goes on from there."""
    whole = newmark.march("pendulum", h=0.01, t_end=1.0)
    stepped = newmark.march("pendulum", h=0.01, steps=True)
    for step in stepped:
        if step.t > 0.495:
            break
    found = stepped.trajectory
    assert (found.status, found.success, found.steps) == ("stopped", True, 50)
    same((found.u, whole.u[:51]), (found.multipliers, whole.multipliers[:51]))
    assert set(step.norms) == {"u", "lambda"}
    assert 0 <= step.norms["u"] < 1e-10
    later = newmark.march("pendulum", h=0.01, t_end=1.0, state=step)
    same((later.u, whole.u[50:]), (later.t, whole.t[50:]))
    # Going on with the same iterator, too.
    assert next(stepped).t == pytest.approx(0.51)


@pytest.mark.parametrize(
    ("integrator", "evaluation"),
    [*((name, "direct") for name in INTEGRATORS), ("hht", "compensated"), ("bdf2", "compensated")],
)
def test_a_restart_takes_the_same_steps_to_the_bit(integrator, evaluation):
    """From any step, whatever the integrator remembers; and from a restart again."""
    how = {"h": 1e-4, "integrator": INTEGRATORS[integrator], "evaluation": evaluation}
    whole = newmark.march("andrews", t_end=0.01, **how)
    part = newmark.march("andrews", t_end=0.0033, every=0, **how)
    part = newmark.march("andrews", steps=17, state=part.state, every=0, **how)
    kept = pickle.loads(pickle.dumps(part.state))
    rest = newmark.march("andrews", t_end=0.01, state=kept, **how)
    assert rest.numbers.tolist() == [*range(50, 101)]
    assert (rest.steps, len(rest.t)) == (50, 51)
    for name in ("t", "u", "v", "a", "multipliers"):
        same((getattr(rest, name), getattr(whole, name)[50:]))
    same((rest.iterations[1:], whole.iterations[51:]))
    for array, other in zip(rest.state.carried.state, whole.state.carried.state, strict=True):
        same((array, other))


def test_callbacks_see_kept_steps_and_stop_the_march():
    seen = []

    def watch(step):
        seen.append(step.t)
        if step.t > 0.45:
            raise StopIteration

    found = newmark.march("pendulum", h=0.1, t_end=3.0, every=2, callback=watch)
    assert seen == pytest.approx([0.2, 0.4, 0.6])
    assert found.t.tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert (found.status, found.success) == ("stopped", True)
    seen.clear()
    at = newmark.march("pendulum", h=0.1, t_end=1.0, at=[0.2, 0.4], callback=seen.append)
    assert [step.t for step in seen] == pytest.approx([0.2, 0.4])
    assert (len(at.t), at.steps, at.status) == (2, 10, "ok")


@pytest.mark.parametrize("error", [RuntimeError("no"), KeyboardInterrupt()])
def test_an_exception_in_a_callback_leaves_a_usable_trajectory(error):
    """It travels on as it is; what was marched is its attribute, and can be gone on from."""

    def fail(step):
        if step.t > 0.45:
            raise error

    with pytest.raises(type(error)) as caught:
        newmark.march("pendulum", h=0.1, t_end=3.0, callback=fail)
    assert caught.value is error
    part = error.trajectory
    assert (part.status, part.success, len(part.t)) == ("interrupted", False, 6)
    whole = newmark.march("pendulum", h=0.1, t_end=1.0)
    rest = newmark.march("pendulum", h=0.1, t_end=1.0, state=part.state)
    same((part.u, whole.u[:6]), (rest.u, whole.u[5:]))


def test_an_exception_in_a_problem_leaves_what_was_marched():
    """The user's error travels on; the state is that before the stretch that it ended."""

    def force(u, v, t):
        if t > 0.305:
            raise ZeroDivisionError("here")
        return np.array([0.0, -9.81, 0.0, -9.81])

    given = dataclasses.replace(double_pendulum(), force=force)
    with pytest.raises(ZeroDivisionError) as caught:
        newmark.march(given, h=0.01, t_end=1.0)
    part = caught.value.trajectory
    assert (part.status, part.steps) == ("interrupted", 20)
    assert np.all(np.isfinite(part.u))
    well = newmark.march(double_pendulum(), h=0.01, steps=20)
    same((part.u, well.u))


@contextmanager
def interruptible():
    """Where SIGINT raises, as it must."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt) as caught:
            yield caught
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("compiled", [True, False])
def test_an_interrupt_is_not_lost_on_the_way_to_the_kernel(monkeypatch, compiled):
    """No handler raises where compiled code could not hand an exception on."""
    served, asked = Callbacks.served, []

    @contextmanager
    def interrupted(self, *arguments):
        with served(self, *arguments):
            signal.raise_signal(signal.SIGINT)
            asked.append(self)
            yield

    monkeypatch.setattr(Callbacks, "served", interrupted)
    with interruptible() as caught:
        newmark.march("pendulum" if compiled else double_pendulum(), h=1e-2, steps=5)
    assert len(asked) == 1
    assert caught.value.trajectory.status == "interrupted"


def test_an_interrupt_ends_functions_in_python_at_once():
    """Not only after the stretch of steps that asks for them."""
    calls = []

    def force(u, v, t):
        calls.append(t)
        if t > 0.305:
            signal.raise_signal(signal.SIGINT)
            calls.append(np.inf)  # it goes on
        return np.array([0.0, -9.81, 0.0, -9.81])

    with interruptible() as caught:
        newmark.march(dataclasses.replace(double_pendulum(), force=force), h=0.01, t_end=1.0)
    assert max(calls) < 0.32
    assert caught.value.trajectory.steps == 20


#: A point that is pulled out of its line of motion ever faster: λ and u overflow.
RUNAWAY = {
    "mass_matrix": np.eye(2),
    "u0": [1.0, 0.0],
    "v0": [0.0, 0.0],
    "force": lambda u, v, t: np.array([1e3 * u[0], 0.0]) if u[0] < 1e6 else np.full(2, np.nan),
    "constraints": lambda u, t: np.array([u[1]]),
    "gradient": lambda u, t: np.array([[0.0], [1.0]]),
}


@pytest.mark.parametrize("every", [1, 7, 0])
def test_a_march_that_diverges_ends_with_its_last_whole_step(every):
    """No NaN, no exception: a status, and a state to look at."""
    found = newmark.march(newmark.Definition(**RUNAWAY), h=0.01, t_end=10.0, every=every)
    assert (found.status, found.success) == ("diverged", False)
    assert "left the range of floating point" in found.message
    for values in (found.t, found.u, found.v, found.a, found.multipliers):
        assert np.all(np.isfinite(values))
    good = newmark.march(newmark.Definition(**RUNAWAY), h=0.01, steps=found.steps)
    assert good.success
    same((found.u[-1], good.u[-1]), (found.state.a, good.a[-1]))
    assert found.t[-1] == found.state.t == good.t[-1]
    # Stepping ends there as well.
    stepped = newmark.march(newmark.Definition(**RUNAWAY), h=0.01, t_end=10.0, steps=True)
    assert sum(1 for _ in stepped) == found.steps
    assert stepped.trajectory.status == "diverged"


def test_steps_that_do_not_converge_are_counted_and_named():
    """A cap of one correction: every step of a moving pendulum ends too early."""
    found = newmark.march("pendulum", h=0.1, t_end=1.0, iteration_cap=1)
    assert (found.status, found.success) == ("not_converged", False)
    assert found.not_converged == np.count_nonzero(~found.converged) > 0
    assert found.converged[0]


@pytest.mark.bits("the start itself is what is tested")
def test_a_start_of_ones_own_is_marched_from():
    """As arrays, by points, by coordinates: all the same."""
    up = {"u0": [0.0, 1.0], "v0": [-1.0, 0.0]}
    by_point = {"u0": {"P": (0.0, 1.0)}, "v0": {"P.x": -1.0}}
    one, other = (newmark.march("pendulum", h=1e-3, t_end=1.0, **start) for start in (up, by_point))
    same((one.u, other.u), (one.u[0], np.array([0.0, 1.0])), (one.v[0], np.array([-1.0, 0.0])))
    # |v|² + y λ … : λ = −(v² − y g)/L² from the start's centripetal acceleration.
    assert one.multipliers[0, 0] == pytest.approx(0.0, abs=1e-15)
    assert np.ptp(one.energy) < 1e-6


def test_inconsistent_starts_are_refused_with_numbers():
    """|Φ| and |Gᵀ v + Φ_t|, and what to do."""
    for start, said in (
        ({"u0": [2.0, 0.0]}, "u0 misses the constraints: max |Φ| = 1.5, by 0.75 at bars.rod; "),
        (
            {"v0": {"P": [0.5, 1.0]}},
            "v0 misses the constraints: max |Gᵀv + Φ_t| = 0.5, by 0.5 at bars.rod; ",
        ),
    ):
        with pytest.raises(newmark.ArgumentError) as caught:
            newmark.march("pendulum", h=0.1, t_end=1.0, **start)
        assert str(caught.value).startswith(f"{said}correct it, or let project")


def test_a_projection_is_the_nearest_in_the_metric_of_M():
    """Against a search over both angles; velocities by their normal equations."""
    from scipy.optimize import minimize

    mass = np.diag([1.0, 2.0, 3.0, 4.0])
    given = newmark.problem(dataclasses.replace(double_pendulum(), mass_matrix=mass))
    u0, v0 = np.array([0.8, 0.5, 1.9, -0.4]), np.array([1.0, 2.0, 3.0, 4.0])
    start = newmark.march(given, h=0.1, steps=0, u0=u0, v0=v0, project=True)

    def placed(angles):
        upper, lower = (np.array([math.cos(angle), math.sin(angle)]) for angle in angles)
        return np.concatenate([upper, upper + lower])

    def distance(angles):
        return (placed(angles) - u0) @ mass @ (placed(angles) - u0)

    best = minimize(
        distance, [0.3, -0.6], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-16}
    )
    assert start.u[0] == pytest.approx(placed(best.x), abs=1e-7)
    gradient = given.evaluate(0.0, start.u[0], v0, np.zeros(2)).G
    inverse = np.linalg.inv(mass)
    push = np.linalg.solve(gradient.T @ inverse @ gradient, gradient.T @ v0)
    assert start.v[0] == pytest.approx(v0 - inverse @ gradient @ push, abs=1e-12)
    assert np.abs(given.constraint_values(0.0, start.u[0])).max() < 1e-15


def test_scalings_follow_the_integrator_and_the_variant():
    """β and γ of generalized-α per unit of v'; one side only; one's own."""
    alpha = GeneralizedAlpha(0.9)
    factors = newmark.scaling("u-lambda", h=1e-3, integrator="generalized-alpha rho=0.9")
    assert factors.right["lambda"] == 1 / (alpha.symbols(1e-3)["beta"] * 1e-3**2)
    left = newmark.scaling("u-lambda", h=1e-3, preconditioning="left")
    assert (left.left["D"], dict(left.right)) == (0.25e-6, {"u": 1.0, "lambda": 1.0})
    own = {"name": "half", "right": {"lambda": "1/h"}}
    assert newmark.scaling("v-lambda", h=1e-3, preconditioning=own).right["lambda"] == 1e3


def pendulum(**more):
    return newmark.march("pendulum", **({"h": 0.1, "t_end": 1.0} | more))


@pytest.mark.parametrize(("call", "message"), [
    (lambda: pendulum(h=0), "h must be positive, given 0"),
    (lambda: pendulum(h=1e-200), "h is too large or too small, given 1e-200"),
    (lambda: pendulum(t_end=0.01), "t_end: shorter than the step h = 0.1, given 0.01"),
    (lambda: pendulum(t_end=None), "t_end or steps: give one of them"),
    (lambda: pendulum(steps=3), "t_end or steps: give one of them, not both"),
    (lambda: pendulum(form="u-lamda"), "unknown form 'u-lamda'; did you mean 'u-lambda'?"),
    (lambda: pendulum(scaling="best"), "unknown scaling 'best'; allowed: none, left"),
    (lambda: pendulum(integrator="trapezoid"), "integrator: unknown method"),
    (lambda: pendulum(integrator="hht alpha=0.5"), "integrator: alpha: alpha = 0.5: must be"),
    (lambda: pendulum(precision="float32", linear_solver="sparse-lu"), "precision: float32 needs"),
    (lambda: pendulum(linear_solver="minres"), "unknown linear_solver 'minres'; it is gone: take"),
    (lambda: pendulum(linear_solver="static-lu", formulation="ggl"), "solves index 3 without"),
    (lambda: pendulum(linear_solver="static-lu", projection="velocity"), "solves index 3"),
    (lambda: pendulum(linear_solver="static-lu", precision="float32"), "needs dense-lu"),
    (lambda: pendulum(stop={"relative": -1e-3}), "relative: must be greater than 0"),
    (lambda: pendulum(stop=1e-8), "stop: must be a mapping of keys such as test, absolute"),
    (lambda: pendulum(every=2, at=[1.0]), "give either every or at, not both"),
    (lambda: pendulum(at=[1.0, 1.2]), "at: 1.2 s is outside the march, 0 to 1 s"),
    (lambda: pendulum(t_end=1e300), "1e+301 steps are more than there can be"),
    (lambda: newmark.march(newmark.Definition(**RUNAWAY), h=0.1, steps=1, u0=[1e7, 0]),
     "definition: the start leads to numbers that are not finite"),
    (lambda: pendulum(at=[], t_end=None), "at must name a time, given none"),
    (lambda: pendulum(keep="u"), "keep must be a list of names, given 'u'"),
    (lambda: pendulum(keep=["u"]).v, "v was not kept; kept: u; see 'keep' of march"),
    (lambda: pendulum().constraint("rod"), "unknown constraint 'rod'; "),
    (lambda: pendulum(u0=[1.0]), "u0 must be an array of 2 numbers, given [1.0]"),
    (lambda: pendulum(u0={"Q": (1, 0)}), "unknown point or coordinate 'Q'; allowed: P, P.x, P.y"),
    (lambda: pendulum(u0=[0.0, 0.0], project=True), "u0 cannot be projected"),
    (lambda: pendulum(state=3), "state must be a Step, such as trajectory.state, given 3"),
    (lambda: pendulum(state=newmark.march("andrews", h=0.1, steps=0).state),
     "state has 8 coordinates and 7 multipliers, pendulum 2 and 1"),
    (lambda: pendulum(state=pendulum().state, u0=[1, 0]),
     "state is a start: give neither u0, v0 nor project"),
    (lambda: pendulum(state=pendulum().state), "t_end: the march is already at t = 1, given 1"),
    (lambda: pendulum(steps=True, callback=print), "steps=True: the loop is the callback"),
    (lambda: pendulum(steps=True, every=0), "every must be at least 1 with steps=True"),
    (lambda: pendulum(h=1e-8, t_end=1.0),
     "100000001 steps to keep take more than 1e+09 bytes of memory"),
    (lambda: newmark.problem("pendulm"), "unknown problem 'pendulm'; did you mean 'pendulum'?"),
    (lambda: newmark.problem("chain"), "chain: links: missing"),
    (lambda: newmark.problem(DOUBLE | {"bars": {"upper": {"from": "O", "to": "A", "length": 2}}}),
     "mechanism: bars.upper: O and A start 1 m apart, given length 2"),
    (lambda: newmark.march(double_pendulum(), h=0.1, steps=1, evaluation="compensated"),
     "evaluation: "),
    (lambda: newmark.march(double_pendulum(), h=0.1, steps=1, precision="float32"), "precision: "),
    (lambda: newmark.problem("pendulum").evaluate(0.0, [1.0], [0, 0], [0]), "u must be 2 numbers"),
    (lambda: newmark.scaling("u-lambda", h=1.0, gamma=0.4), "gamma = 0.4: must be at least 0.5"),
    (lambda: newmark.scaling("u-lambda", h=1.0, beta=1.0, integrator="bdf2"),
     "give either an integrator or beta and gamma, not both"),
    (lambda: newmark.scaling("u-lambda", h=1e-300), "h is too large or too small"),
])  # fmt: skip
def test_what_cannot_be_used_is_refused_in_one_sentence(call, message):
    """A documented class, one line that says what was given and what is allowed."""
    with pytest.raises(newmark.NewmarkError) as caught:
        call()
    text = str(caught.value)
    assert message in text
    assert "\n" not in text
    assert ", line " not in text
    assert type(caught.value).__name__ in newmark.__all__


IMPORTS = """\
import sys
before = {*sys.modules}
import newmark_cli
print(*{*sys.modules} - before, newmark_cli.__version__ != "",
      {*newmark_cli.__all__} <= {*dir(newmark_cli)})
from newmark_cli.cli import main
try:
    main(["--help"])
except SystemExit:
    heavy = {"numpy", "pandas", "scipy", "numba", "matplotlib", "pydantic", "yaml"}
    print("heavy:", *heavy & {*sys.modules})
"""


def test_importing_takes_no_library():
    """Nothing but the standard library, and little of the package; --help nothing that is heavy."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS], text=True, capture_output=True, check=True
    )
    first, *_, last = done.stdout.splitlines()
    *modules, versioned, listed = first.split()
    assert (versioned, listed) == ("True", "True")
    packages = {module.partition(".")[0] for module in modules}
    assert packages <= sys.stdlib_module_names | {"newmark_cli"}
    assert {module for module in modules if module.startswith("newmark_cli")} == {"newmark_cli"}
    assert last == "heavy:"


MEMORY = """\
from pathlib import Path
import newmark_cli as newmark

def most():
    # Not getrusage: it counts what the process was before it was this one.
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

for every in (1000, 1):  # compiles all code that is needed
    newmark.march("pendulum", h=1e-7, steps=30_000, every=every)
for steps, every in ((750_000, 1000), (200_000, 1)):
    before = most()
    found = newmark.march("pendulum", h=1e-7, steps=steps, every=every)
    print(found.steps, len(found.t), found.status, (most() - before) / 1024)
"""
INTERRUPTED = """\
import signal
signal.signal(signal.SIGVTALRM, lambda number, frame: signal.raise_signal(signal.SIGINT))
newmark.march("pendulum", h=1e-6, steps=10)
for delay in (0.05, 0.21):
    # Seconds that the process computes, however busy the machine is.
    signal.setitimer(signal.ITIMER_VIRTUAL, delay)
    try:
        newmark.march("pendulum", h=1e-6, steps=10**9, every=1000)
    except KeyboardInterrupt as error:
        part = error.trajectory
    again = newmark.march("pendulum", h=1e-6, steps=part.steps, every=1000)
    rest = newmark.march("pendulum", h=1e-6, steps=5, state=part.state)
    print(part.status, part.steps > 0, (again.u[:-1] == part.u[: len(again.u) - 1]).all(),
          (again.u[-1] == part.u[-1]).all(), len(again.u) == len(part.u), rest.status)
"""


def test_long_marches_in_a_process_of_their_own(cli):
    """Eight bytes for each of 750,000 steps would be 6 MB; all of 200,000 take 30.

    Ctrl-C in the middle leaves what was kept, and a state to go on from.
    """
    done = cli.python(cli.write("march.py", MEMORY + INTERRUPTED))
    assert done.stderr == ""
    thinned, whole, *interrupted = done.stdout.splitlines()
    *facts, grown = thinned.split()
    assert facts == ["750000", "751", "ok"]
    assert float(grown) < 3
    assert float(whole.split()[-1]) > 15
    assert interrupted == ["interrupted True True True True ok"] * 2


def test_stepping_ends_at_t_end_and_skips():
    """Every k-th step and the last."""
    times = [step.t for step in newmark.steps("pendulum", h=0.1, t_end=1.0, every=4)]
    assert times == pytest.approx([0.4, 0.8, 1.0])
