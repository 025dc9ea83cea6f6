"""Forces in Python on points of planar mechanisms."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import newmark_cli as newmark
from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.spec import ForcedMechanism, portable
from newmark_cli.problems.problem import ProblemError
from newmark_cli.support.documents import DocumentError, File

#: Drag on a tip, and functions with mistakes.
FORCES = """\
import numpy as np
from numba import njit
from beside import DENSITY


@njit
def drag(positions, velocities, t):
    x, y = velocities[0, 0], velocities[0, 1]
    scale = -DENSITY * (1 + np.sin(t)) * np.hypot(x, y)
    return np.array([[scale * x, scale * y], [0.0, 0.0]])


def plain(positions, velocities, t):
    return -DENSITY * velocities


def broken(positions, velocities, t):
    return positions[:, 0]


def late(positions, velocities, t):
    if t > 0.02:
        raise ValueError("no force")
    return 0 * positions


def ends(positions, velocities, t):
    import os

    if t > 0:
        os._exit(3)
    return 0 * positions
"""
PENDULUM = """\
points:
  O: {fixed: [0, 0]}
  W: {fixed: [0, 2]}
  A: {at: [1, 0], mass: 2}
bodies: {rod: {from: O, to: A, length: 1, mass: 0, inertia: 0}}
body_points: {M: {on: rod, at: [0.5, 0.1]}}
python_forces: {air: {python: "forces.py:drag", on: [A, O]}}
gravity: [0, -9.81]
"""


@pytest.fixture
def folder(cli):
    """A mechanism, its forces, a module that they import, and a study."""
    cli.write("forces.py", FORCES)
    cli.write("beside.py", "DENSITY = 0.3\n")
    cli.write("swing.yaml", PENDULUM)
    cli.write(
        "study.yaml",
        "study: s\nproblem: swing.yaml\nform: u-lambda\npreconditioning: [none, optimal]\n"
        "h: 3e-2\nt_end: 0.3\nexpect: [{measure: correction, at_least: 1.0e-99}]\n",
    )
    return cli


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.release)])
def test_drag(folder, compiled):
    """The angle's ODE at order 2; tangents by differences; compiled as a whole, if it is."""
    folder.write("forces.py", FORCES if compiled else FORCES.replace("@njit\n", ""))
    problem = loading.load(folder.folder / "swing.yaml", "swing", allow_code=True)
    assert problem.compiled == compiled
    assert set(problem.sources) == {"swing.yaml", "forces.py", "beside.py"}
    end = solve_ivp(
        lambda t, y: [y[1], -9.81 * np.cos(y[0]) - 0.3 / 2 * (1 + np.sin(t)) * abs(y[1]) * y[1]],
        (0, 0.6), [0, 0], method="DOP853", rtol=1e-12, atol=1e-12,
    ).y[0, -1]  # fmt: skip
    errors = []
    for h in (8e-3, 4e-3):
        u = newmark.march(problem, h=h, t_end=0.6, every=0).u[-1]
        errors.append(np.abs(u - [np.cos(end), np.sin(end)]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    v = np.array([1.0, -2.0])
    terms = problem.evaluate(0.2, problem.u0, v, np.zeros(1))
    speed, factor = np.hypot(*v), 0.3 * (1 + np.sin(0.2))
    expected = factor * (speed * np.eye(2) + np.outer(v, v) / speed)
    np.testing.assert_allclose(terms.Y, expected, rtol=1e-8)


def test_studies_with_forces_in_python(folder):
    """Refused without --allow-code in one line; code is part of a cell."""
    said = "line 7: python_forces.air.python: forces.py is code, which runs only with --allow-code"
    folder.write("swing.yaml", PENDULUM.replace(":drag", ":plain"))
    assert said in folder.refused("validate", "swing.yaml")
    assert said in folder.refused("run", "study.yaml")
    line = folder("validate", "--allow-code", "swing.yaml").stdout
    assert line == "swing.yaml: mechanism, 2 coordinates, 1 constraints, 1 degree of freedom\n"
    folder("run", "study.yaml", "--allow-code")
    done = folder("run", "study.yaml", "--allow-code", "--dry-run").stdout
    assert done.endswith("0 of 2 cells to run\n")
    folder.write("beside.py", "DENSITY = 0.4\n")
    changed = folder("run", "study.yaml", "--allow-code", "--dry-run").stdout
    assert changed.endswith("2 of 2 cells to run\n")
    folder.write("swing.yaml", PENDULUM.replace(":drag", ":late"))
    failed = folder("run", "study.yaml", "--allow-code", code=1)
    assert "forces.py, line 23: ValueError: no force" in failed.stderr + failed.stdout
    folder.write("swing.yaml", PENDULUM.replace(":drag", ":ends"))
    line = folder.refused("draw", "swing.yaml", "--at", "0.02", "--h", "0.01", "--allow-code")
    assert line.endswith("its process ended with code 3")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (":drag", ":drug", "forces.py: has no function 'drug'"),
        (":drag", ":broken", "forces.py, line 17: broken returned an array of shape"),
        ("forces.py", "none.py", "none.py: cannot be read: No such file"),
        ("on: [A, O]", "on: [A, Z]", "line 7: python_forces.air.on[2]: unknown point 'Z'"),
        ("on: [A, O]", "on: [W, O]", "line 7: python_forces.air.on: must name a point that moves"),
        ("forces.py:drag", "forces", 'python_forces.air.python: must be "file.py:function"'),
        ("on: [A, O]", "on: [A, A]", "python_forces.air.on: must name each point once"),
    ],
)
def test_mistakes_with_forces_in_python(folder, old, new, words):
    path = folder.folder / "swing.yaml"
    path.write_text(PENDULUM.replace(old, new))
    with pytest.raises((DocumentError, ProblemError)) as caught:
        loading.load(path, "swing", "swing.yaml", allow_code=True)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_elsewhere_travel(tmp_path):
    """From a folder above within the copies; one of an absolute path is left as it is."""
    own = tmp_path / "own"
    own.mkdir()
    push = tmp_path / f"push_of_{tmp_path.name}.py"
    push.write_text("def push(positions, velocities, t):\n    return [[1.0, 0.0]]\n")
    for where in (f"../{push.name}", str(push)):
        text = PENDULUM.replace("forces.py:drag", f"{where}:push").replace("[A, O]", "[A]")
        spec = ForcedMechanism(File("q.yaml", text.encode()), own / "q.yaml").read()
        carried = portable(spec)
        assert carried.load().content == spec.load().content
        before = push.read_text()
        push.write_text(before.replace("1.0", "2.0"))
        if where == str(push):
            with pytest.raises(ProblemError, match="python_forces: has changed since"):
                carried.load()
        else:
            assert carried.load().content == spec.load().content
        assert push.read_text() != before
        push.write_text(before)
    assert not (Path(tempfile.gettempdir()) / push.name).exists()
