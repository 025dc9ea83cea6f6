"""Files that are edited between two calls in one process: each call is of what they say then."""

import hashlib
import json
import operator
import os
from dataclasses import replace
from pathlib import Path

import pytest

import newmark_cli as newmark
from newmark_cli.mechanisms.spec import ForcedMechanism, PythonFactory, with_problem
from newmark_cli.running import runner
from newmark_cli.support.documents import File
from newmark_cli.support.errors import InputError

#: A point of 1 kg that hangs on a bar and is pushed sideways: the push is its acceleration.
HANGS = """\
points: {O: {fixed: [0, 0]}, P: {at: [0, -1], mass: 1}}
bars: {rod: {from: O, to: P, length: 1}}
gravity: [0, -9.81]
"""
TABLE = HANGS + (
    "forces: {push: {at: P, force: [{table: {times: [0, 1, 2], values: [3, 1, 2]}}, 0]}}\n"
)
FORCED = HANGS + 'python_forces: {push: {python: "push.py:push", on: [P]}}\n'
BODY = """\
dimensions: 3
bodies: {ball: {position: [0, 0, -1], mass: 1, inertia: [1, 1, 1]}}
body_points: {tip: {on: ball, at: [0, 0, 0]}}
joints: {pin: {type: spherical, from: ground, to: ball, at: [0, 0, 0]}}
forces: {push: {at: tip, force: [3, 0, 0]}}
"""
PUSH = """\
from size import SIZE


def push(positions, velocities, t):
    return [[3 * SIZE, 0.0]]
"""
MINE = """\
import numpy as np
import newmark_cli as newmark
from size import SIZE


def hangs():
    return newmark.Definition(
        mass_matrix=np.eye(2),
        u0=[0.0, -1.0],
        v0=[0.0, 0.0],
        force=lambda u, v, t: np.array([3 * SIZE, 0.0]),
        constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
        gradient=lambda u, t: u[:, None],
    )
"""
SIZE = "SIZE = 1\n"
CODE = {"mine.py": MINE, "size.py": SIZE}
PUSHED = {"q.yaml": FORCED, "push.py": PUSH, "size.py": SIZE}
PYTHON = {"python": "mine.py:hangs"}

#: What a study names, its files, the one that is edited, how, and what is then twice as large.
KINDS = {
    "planar": ("q.yaml", {"q.yaml": HANGS}, "q.yaml", ("mass: 1", "mass: 2"), "lambda[bars.rod]"),
    "table": ("q.yaml", {"q.yaml": TABLE}, "q.yaml", ("[3,", "[6,"), "a[P.x]"),
    "spatial": ("q.yaml", {"q.yaml": BODY}, "q.yaml", ("[3,", "[6,"), "a[ball.origin.x]"),
    "forced": ("q.yaml", PUSHED, "q.yaml", ("mass: 1", "mass: 2"), "lambda[bars.rod]"),
    "force": ("q.yaml", PUSHED, "push.py", ("3 ", "6 "), "a[P.x]"),
    "module of a force": ("q.yaml", PUSHED, "size.py", ("1", "2"), "a[P.x]"),
    "python": (PYTHON, CODE, "mine.py", ("3 ", "6 "), "a[1]"),
    "module": (PYTHON, CODE, "size.py", ("1", "2"), "a[1]"),
}


def written(folder, files):
    """The files in a folder."""
    for name, text in files.items():
        (folder / name).write_text(text)


def edited(folder, kind):
    """Edit the file of a kind, which stays as large and as old as it was."""
    _, files, name, (old, new), _ = KINDS[kind]
    assert files[name].count(old) == 1
    times = (folder / name).stat()
    (folder / name).write_text(files[name].replace(old, new))
    os.utime(folder / name, ns=(times.st_atime_ns, times.st_mtime_ns))


def study(kind):
    """A study of two steps."""
    return {
        "study": "s",
        "problem": KINDS[kind][0],
        "form": "u-lambda",
        "preconditioning": "optimal",
        "h": 1e-3,
        "steps": 2,
        "measure": "trajectory",
    }


def at_start(frame, kind):
    """What is twice as large after an edit."""
    return newmark.trajectories(frame)[KINDS[kind][4]].iloc[0]


@pytest.mark.parametrize("kind", KINDS)
def test_runs_are_of_what_was_read(tmp_path, monkeypatch, kind):
    """One content throughout, which the record names; the next run is of the other.

    Given as a dict or as a file, into one folder of results.
    """
    begin = runner.run_studies

    def late(*arguments):
        edited(tmp_path, kind)
        return begin(*arguments)

    def recorded():
        """Checksum of the edited file as the record has it."""
        (files,) = json.loads((tmp_path / "out/s.json").read_text())["problem_files"].values()
        assert files.keys() == KINDS[kind][1].keys()
        return files[name]

    monkeypatch.chdir(tmp_path)
    _, files, name, *_ = KINDS[kind]
    written(tmp_path, files | {"s.yaml": json.dumps(study(kind))})
    with monkeypatch.context() as patched:
        patched.setattr(runner, "run_studies", late)
        frame = newmark.run(study(kind), allow_code=True, results="out", jobs=1)
    before, now = (
        hashlib.sha256(content).hexdigest()
        for content in (files[name].encode(), (tmp_path / name).read_bytes())
    )
    assert recorded() == before != now
    after = newmark.run("s.yaml", allow_code=True, results="out")
    assert at_start(after, kind) == pytest.approx(2 * at_start(frame, kind), rel=1e-12)
    assert recorded() == now
    assert len(list((tmp_path / "out/cells").iterdir())) == 2


@pytest.mark.parametrize("kind", ["force", "module of a force", "python", "module"])
def test_another_process_refuses_code_that_has_changed(tmp_path, monkeypatch, kind):
    """As one that takes the place of a process which has ended."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, KINDS[kind][1])
    if KINDS[kind][0] == PYTHON:
        named, spec = "mine.py:hangs", PythonFactory(Path("mine.py"), "hangs", (), "mine.py:hangs")
    else:
        named = "q.yaml: python_forces"
        spec = ForcedMechanism(File("q.yaml", FORCED.encode()), Path("q.yaml"))
    read = spec.read()
    edited(tmp_path, kind)
    assert with_problem(read, operator.attrgetter("code")) == read.code
    with pytest.raises(InputError, match=f"^{named}: has changed since the run began$"):
        with_problem(replace(read, reading=""), operator.attrgetter("code"))
