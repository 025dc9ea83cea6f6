"""F(t, y, y') = 0 for codes that solve general DAEs, and advice on what to set in them."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import own_mechanisms
import pytest
from each import each

import newmark_cli as newmark
from newmark_cli.problems import reference
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.residual_form import ROWS

#: Pendulum of two masses, in a unit of length, turned by an angle, at a distance from the origin.
ARMS = 0.3, 0.2


def double(unit=1.0, angle=0.0, away=0.0):
    along = np.array([np.cos(angle), np.sin(angle)])
    origin = np.array([away, away / 2]) * unit
    at = [origin + length * unit * along for length in (ARMS[0], sum(ARMS))]
    down = 9.81 * unit * np.array([along[1], -along[0]])
    return newmark.problem({
        "points": {"O": {"fixed": origin.tolist()}, "P": {"at": at[0].tolist(), "mass": 2.0},
                   "Q": {"at": at[1].tolist(), "mass": 1.0}},
        "bars": {"upper": {"from": "O", "to": "P", "length": ARMS[0] * unit},
                 "lower": {"from": "P", "to": "Q", "length": ARMS[1] * unit}},
        "gravity": down.tolist(),
    })  # fmt: skip


@each("name, t", [("shaken-pendulum", 0.2), ("heavy-top", 0.03)])
@each("equations", ROWS)
@each("integrals", [False, True])
def test_a_motion_solves_the_equations(name, t, equations, integrals):
    """Driven and in space: F vanishes along the reference, and not next to it."""
    problem = newmark.problem(name)
    at, dae = reference.solution(problem, t), newmark.dae(problem, equations, integrals=integrals)
    a, _ = Index1(problem).accelerations(t, at.u, at.v)
    y, yp = np.zeros((2, len(dae.y0)))
    n, m = problem.n, problem.m
    y[: 2 * n], yp[: 2 * n] = np.concatenate([at.u, at.v]), np.concatenate([at.v, a])
    (yp if integrals else y)[2 * n : 2 * n + m] = at.multipliers
    size = np.abs(problem.evaluate(t, at.u, at.v, at.multipliers).force).max() + np.abs(a).max()
    size = max(size, np.abs(problem.M @ a).max())
    assert np.abs(dae.residual(t, y, yp)).max() < 1e-9 * size
    assert np.abs(dae.residual(dae.t0, dae.y0, dae.yp0)).max() < 1e-9 * size
    assert np.abs(dae.residual(t, y * 1.01, yp)).max() > 1e-4 * size
    for found, expected in zip(dae.state(y, yp), (at.u, at.v, at.multipliers), strict=True):
        assert np.array_equal(found, expected)


@each("name", ["shaken-pendulum", "heavy-top"])
@each("equations", ROWS)
@each("integrals", [False, True])
def test_jacobians_are_those_of_differences(name, equations, integrals):
    dae = newmark.dae(name, equations, integrals=integrals)
    random = np.random.default_rng(1)
    y, yp = (x + random.normal(size=len(x)) for x in (dae.y0, dae.yp0))
    size = 1e-5 * np.eye(len(y))
    for found, on_y in zip(dae.jacobian(0.3, y, yp), (1, 0), strict=True):
        columns = [
            [dae.residual(0.3, y + sign * on_y * step, yp + sign * (1 - on_y) * step)
             for sign in (1, -1)] for step in size
        ]  # fmt: skip
        expected = np.array([(after - before) / 2e-5 for after, before in columns]).T
        assert np.abs(found - expected).max() < 1e-6 * max(1.0, np.abs(expected).max())


@each("equations, power", [("index-3", 2), ("ggl", 1)])
def test_rounding_in_the_multipliers_is_the_predicted_one(equations, power):
    """Steps of backward Euler from starts one unit in the last place apart, for two step sizes."""
    problem, accuracy = double(), 1e-6
    advice = newmark.advise_dae(problem, accuracy=accuracy, t_end=1.0)
    sizes = np.array([*advice.sizes.values()])
    n, m = problem.n, problem.m
    motion = np.linalg.norm(sizes[:n]) / np.linalg.norm(sizes[n : 2 * n])
    of_lambda = sizes[2 * n : 2 * n + m] / motion
    dae, at = newmark.dae(problem, equations, integrals=False), reference.solution(problem, 0.4)
    start = np.zeros(len(dae.y0))
    start[: 2 * n + m] = np.concatenate([at.u, at.v, at.multipliers])
    random = np.random.default_rng(2)
    for h in (1e-4, 1e-5):
        ends = []
        for _ in range(40):
            past = start + random.integers(-1, 2, len(start)) * np.spacing(start)
            y = start.copy()
            for _ in range(8):
                of_y, of_yp = dae.jacobian(0.0, y, (y - past) / h)
                y = y - np.linalg.solve(of_y + of_yp / h, dae.residual(0.0, y, (y - past) / h))
            ends.append(y[2 * n : 2 * n + m])
        measured = np.sqrt(np.mean((np.std(ends, axis=0) / of_lambda) ** 2))
        predicted = accuracy * (advice.amplified[equations]["rounding"] / h) ** power
        assert 0.1 < measured / predicted < 3, (h, measured, predicted)


def test_tolerances_follow_the_units_and_not_the_axes():
    """In millimetres and turned; a kilometre away rtol makes up for the distance."""
    advice, turned, small, away = (
        newmark.advise_dae(double(**how), code="bdf", t_end=0.5)
        for how in ({}, {"angle": 0.7}, {"unit": 1e3}, {"away": 1e3})
    )
    sizes, of_turned, of_small = (
        np.array([*one.sizes.values()]) for one in (advice, turned, small)
    )
    assert of_turned == pytest.approx(sizes, rel=1e-3)
    assert of_small[:8] == pytest.approx(1e3 * sizes[:8], rel=1e-3)
    assert [*advice.atol.values()] == pytest.approx(1e-6 * sizes, rel=0.06)
    assert advice.rtol == turned.rtol == small.rtol == 1e-6
    assert 5e-10 < away.rtol < 1e-9
    assert away.smallest > 1e3 * advice.smallest
    assert "rtol counts from the origin" in " ".join(away.findings)
    # Sizes: how far points move, and how fast they get.
    motion = newmark.march(double(), h=1e-3, t_end=0.5)
    far = np.linalg.norm((motion.u - motion.u[0])[:, 2:], axis=1).max()
    fast = np.linalg.norm(motion.v[:, 2:], axis=1).max()
    assert advice.sizes["u[Q.x]"] == pytest.approx(far, rel=0.05)
    assert advice.sizes["v[Q.y]"] == pytest.approx(fast, rel=0.05)


def test_newtons_test_can_be_met():
    """Far from the origin weights times κ stay above rounding: BDF's κ is the smaller one."""
    loose, strict, beyond = (
        newmark.advise_dae(double(away=1e3), code=code, accuracy=accuracy, t_end=0.5)
        for code, accuracy in (("ida", 1e-9), ("bdf", 1e-9), ("ida", 1e-13))
    )
    raised = np.array([*strict.atol.values()]) / np.array([*loose.atol.values()])
    assert raised.min() >= 1
    assert raised.max() > 1.2
    assert "not for this one" in " ".join(beyond.findings)


class Standin:
    """Stands for IDA and for solve_dae: asks once for all that they are handed."""

    def __init__(self, residual, **options):
        self.residual, self.options = residual, options

    def solve(self, span, y0, yp0):
        """As of IDA."""
        res, full = np.ones(len(y0)), np.full((len(y0), len(y0)), np.nan)
        self.residual(span[0], y0, yp0, res)
        self.options["jacfn"](span[0], y0, yp0, res, 1e3, full)
        return self._found(span, y0, yp0, res, full)

    @classmethod
    def solve_dae(cls, residual, span, y0, yp0, *, method, jac, **options):
        """As `solve_dae`."""
        assert method in ("Radau", "BDF")
        of_y, of_yp = jac(span[0], y0, yp0)
        found = cls(residual, **options)._found(
            span, y0, yp0, residual(span[0], y0, yp0), of_y + 1e3 * of_yp
        )
        found.y, found.yp = found.y.T, found.yp.T
        return found

    def _found(self, span, y0, yp0, res, full):
        assert span[1] == 0.25
        assert np.abs(res).max() < 1e-10
        assert np.linalg.cond(full) < 1e16
        assert len(self.options["atol"]) == len(y0)
        assert self.options["rtol"] == 1e-7
        return SimpleNamespace(message="done", y=np.array([y0]), yp=np.array([yp0]))


@each("code", ["ida", "radau", "bdf"])
def test_lines_of_the_command_run(cli, monkeypatch, capsys, code):
    """With stand-ins for the codes; text and JSON hold the same lines and numbers."""
    stubs = {
        "sksundae.ida": {"IDA": Standin},
        "solve_dae.integrate": {"solve_dae": Standin.solve_dae},
    }
    for name, names in stubs.items():
        monkeypatch.setitem(sys.modules, name.partition(".")[0], SimpleNamespace())
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**names))
    cli.write("mine.yaml", json.dumps(own_mechanisms.slider_crank()))
    command = ("advise", "mine.yaml", "--code", code, "--accuracy", "1e-7", "--t-end", "0.25")
    text = cli(*command).stdout
    found = json.loads(cli(*command, "--json").stdout)
    lines = "\n".join(found["lines"])
    assert text.endswith(f"\n\n{lines}\n")
    monkeypatch.chdir(cli.folder)
    exec(lines, names := {})
    assert capsys.readouterr().out.startswith("done [")
    assert names["atol"].tolist() == [*found["atol"].values()]
    assert [*found["atol"]] == [*names["dae"].names]
    assert found["amplified"]["index-2"]["power"] == -1


def test_what_cannot_be_advised_is_refused_in_one_line(cli):
    cli.write("rest.yaml", json.dumps(own_mechanisms.pendulum(1.0, 1.0, -90.0, 0.0, (0, 0))))
    for words, said in (
        (("andrews", "--code", "ida", "--h", "1e-3"), "--h does not go with --code"),
        (("andrews", "--code", "ida", "--form", "u-lambda"), "--form does not go with --code"),
        (("andrews", "--accuracy", "1e-3"), "--accuracy needs --code"),
        (("andrews", "--code", "ida", "--accuracy", "2"), "accuracy must be below 1, given 2"),
        (("andrews", "--code", "ida", "--accuracy", "0"), "accuracy must be positive"),
        (("pendulum-u", "--code", "ida"), "--code needs a problem"),
        (("rest.yaml", "--code", "ida"), "needs a motion, but it is at rest"),
        (("andrews", "--code", "ida", "--t-end", "1"), "could not be marched"),
    ):
        assert said in cli.refused("advise", *words), words
