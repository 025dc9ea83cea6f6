"""Every command on every kind of subject: it works, or says in one line why it cannot."""

import json

import examples
import numpy as np
import pytest
from command_line import invoke

PLANAR = """\
points: {O: {fixed: [0, 0]}, P: {at: [1, 0], mass: 2}}
bars: {rod: {from: O, to: P, length: 1}}
gravity: [0, -9.81]
"""
SPATIAL = """\
dimensions: 3
bodies: {top: {position: [0, 0, 0], mass: 2, centre: [0, 1, 0], inertia: [1, 0.5, 1]}}
joints: {O: {type: spherical, from: ground, to: top, at: [0, 0, 0]}}
gravity: [0, 0, -9.81]
"""
FILES = {
    "planar.yaml": PLANAR,
    "spatial.yaml": SPATIAL,
    "forced.yaml": PLANAR + 'python_forces: {air: {python: "air.py:drag", on: [P]}}\n',
    "air.py": "def drag(positions, velocities, t):\n    return -0.3 * velocities\n",
    "axis.py": examples.CAR_AXIS.read_text(),
    "study.yaml": (
        "study: mine\nproblem: planar.yaml\nform: u-lambda\npreconditioning: optimal\n"
        "h: [1e-1, 3e-2, 1e-2, 3e-3]\nt_end: 0.2\n"
    ),
}
MECHANISMS = ("pendulum", "planar.yaml", "spatial.yaml", "chain(links=3)", "forced.yaml")
PROBLEMS = (*MECHANISMS, "axis.py:car_axis")
STUDIES = ("study.yaml", "pendulum-u")
SUBJECTS = (
    *PROBLEMS, *STUDIES, "mine", "axis.py", "air.py:drag", "matrices.npz", "results/mine.csv",
    "missing.yaml", ".",
)  # fmt: skip
CODE = ("validate", "draw", "advise", "orders", "run")
#: Words of the command line before a subject, and the subjects that they work for.
COMMANDS = (
    ("validate", (*PROBLEMS, *STUDIES)),
    ("draw --at 0.1 --h 0.05 --frames 2 --animate a.gif", MECHANISMS),
    ("advise --h 1e-3", (*PROBLEMS, *STUDIES)),
    ("advise --h 1e-3 --matrices", ("matrices.npz",)),
    ("advise --jacobian", ()),
    ("run --dry-run", STUDIES),
    ("orders --config", STUDIES),
    ("plot", ("mine",)),
    ("show", ("mine",)),
    ("show --record", ("mine",)),
    ("check", ("mine",)),
    ("compare results", ()),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with all of them, and with results of a study."""
    folder = tmp_path_factory.mktemp("subjects")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    np.savez(folder / "matrices.npz", M=np.eye(2), G=[[1.0], [0.0]], X=np.eye(2), Y=np.eye(2))
    assert invoke(["run", "study.yaml"], folder).returncode == 0
    return folder


#: Every subject that a command works for, and a ninth of the others, so that each meets some.
#: Of forces in Python docs/advice.md has advice, which takes seconds.
TRIED = [
    (words, subject, subject in works)
    for i, (words, works) in enumerate(COMMANDS)
    for k, subject in enumerate(SUBJECTS)
    if (subject in works or (i + k) % 9 == 0)
    and (words.split()[0], subject)
    not in (("advise", s) for s in ("axis.py:car_axis", "forced.yaml"))
]


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize(("words", "subject", "works"), TRIED)
def test_commands_work_or_say_why_not(folder, words, subject, works):
    """Exit code 0 and something printed, or 2 and one line on stderr."""
    command = words.split()
    code = ["--allow-code"] if command[0] in CODE else []
    require(invoke([*command, subject, *code], folder), works)


def require(done, works):
    """Exit code 0 and something on stdout, or 2 and one line on stderr."""
    assert done.returncode == (0 if works else 2), done.stderr + done.stdout
    assert bool(done.stdout) == works
    if not works:
        (line,) = done.stderr.splitlines()
        assert line.startswith("newmark-study: ")


def test_an_option_that_went_from_one_command(folder):
    """`run` says what its `--format` is called now; `show` never had one."""
    done = invoke(["run", "pendulum-u", "--format", "parquet"], folder)
    way = "it is gone: take --trajectories csv or parquet"
    assert done.stderr == f"newmark-study: No such option '--format'; {way}\n"
    assert done.returncode == 2
    assert "it is gone" not in invoke(["show", "pendulum-u", "--format", "csv"], folder).stderr


def test_validate_has_the_same_as_json(folder):
    """Valid or not, a file is an entry; the exit code is the same."""
    names = ["pendulum-u", "planar.yaml", "nowhere.yaml"]
    told = invoke(["validate", *names], folder)
    done = invoke(["validate", *names, "--json"], folder)
    assert (done.returncode, done.stderr) == (told.returncode, "") == (2, "")
    *valid, wrong = json.loads(done.stdout)
    lines = [line for entry in valid for line in entry["description"]]
    assert lines == told.stdout.splitlines()
    assert [entry["mistakes"] for entry in valid] == [[], []]
    assert told.stderr == f"newmark-study: {wrong['mistakes'][0]}\n"


def test_a_mistake_in_a_drawn_file_is_told_of_the_file_only(cli, tmp_path):
    (tmp_path / "hello.yaml").write_text("hello\n")
    told = cli.run("draw", "hello.yaml")
    assert told.returncode == 2
    assert told.stderr.startswith("newmark-study: hello.yaml, line 1: must be a mapping of keys")
