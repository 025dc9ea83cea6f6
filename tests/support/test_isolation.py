"""Code of the user's touches no other problem, and not the run."""

import csv
import os

import pytest
from command_line import CommandLine
from conftest import SWING

from newmark_cli.mechanisms.spec import PythonFactory, portable, with_problem

#: What a problem may do to the process that it runs in, in a line of Python.
HARM = {"patches": "np.median = lambda values: 42.0", "folder": "os.chdir('/')"}

#: Cells of a problem that does harm, of one that does not, and of a shipped one.
STUDY = """\
study: mixed
form: u-lambda
preconditioning: [none, optimal]
t_end: 1.0
cases:
  - problem: {python: "own/bad.py:swing"}
    h: 0.05
  - problem: [{python: "own/good.py:swing"}, pendulum]
    h: 0.1
expect: [{measure: correction, at_least: 1.0e-99}]
"""


def write_problem(cli, name, at_import="", in_calls=""):
    """A problem in a file, with what it does."""
    head = "    def force(u, v, t):\n"
    assert head in SWING
    called = SWING.replace(head, f"{head}        {in_calls or 'pass'}\n")
    cli.write(f"own/{name}.py", f"{called}\n{at_import}\n")


def write_study(cli, *bad):
    """The study, with any problems in place of the first."""
    cli.write("own/good.py", SWING)
    own = '{python: "own/bad.py:swing"}'
    named = ", ".join(own.replace("bad", name) for name in bad)
    cli.write("mixed.yaml", STUDY.replace(own, f"[{named}]"))


def rows(folder, *problems):
    """Rows of some problems in the study's CSV."""
    with (folder / "mixed.csv").open() as file:
        found = [row for row in csv.reader(file) if row[1] in problems]
    assert {row[1] for row in found} == {*problems}
    return found


def test_harm_stays_in_its_problem(cli, tmp_path_factory):
    """Who replaces a function of NumPy changes its own rows only, who changes the folder none."""
    clean = CommandLine(tmp_path_factory.mktemp("clean"))
    write_problem(clean, "bad")
    write_study(clean, "bad")
    clean("run", "mixed.yaml", "--allow-code")
    usual = clean.folder / "results"
    write_problem(cli, "patches", in_calls=HARM["patches"])
    write_problem(cli, "folder", at_import=HARM["folder"])
    names = ["patches", "folder"]
    write_study(cli, *names)
    cli("run", "mixed.yaml", "--allow-code", "--jobs", 1)
    found = cli.folder / "results"
    assert rows(found, "good.py:swing", "pendulum") == rows(usual, "good.py:swing", "pendulum")
    without = rows(usual, "bad.py:swing")
    for name in names:
        theirs = [[row[0], *row[2:]] for row in rows(found, f"{name}.py:swing")]
        if name.startswith("folder"):
            assert theirs == [[row[0], *row[2:]] for row in without]
            continue
        for row, other in zip(theirs, without, strict=True):
            assert row[1:] != other[2:]
            assert "42.0" in row
    assert sorted(path.name for path in cli.folder.iterdir()) == ["mixed.yaml", "own", "results"]


#: Exceptions that are hard to tell of, with what is said of them.
HARD = {
    "exit-in-str": (
        "raise type('Mute', (Exception,), {'__str__': lambda self: exit(3)})()",
        "Mute: (its text cannot be shown: SystemExit)",
    ),
    "surrogate": ("raise ValueError('half \\ud800 of two')", "ValueError: half \\ud800 of two"),
    "interrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "exit": ("raise SystemExit(0)", "SystemExit: 0"),
}
#: Ends of a process, with what is said of them.
ENDS = {
    "well": ("os._exit(0)", "its process ended with code 0"),
    "killed": ("os.kill(os.getpid(), 9)", "its process ended with code -9"),
}


def write_studies(cli, at_import="", in_calls=""):
    """A problem for each kind of mistake, whose code stands for CODE; how each is spelled."""
    cli.write("own/good.py", SWING)
    for kind, (code, _) in {**HARD, **ENDS}.items():
        write_problem(cli, kind, at_import.replace("CODE", code), in_calls.replace("CODE", code))
    return {kind: f'{{python: "own/{kind}.py:swing"}}' for kind in (*HARD, *ENDS)}


def test_whatever_a_cell_raises_fails_it_alone(cli):
    """A CSV with all other cells, one line for each that says why, and nothing else."""
    spelled = write_studies(cli, in_calls="if t > 0.5: CODE")
    bad = '{python: "own/bad.py:swing"}'
    study = STUDY.replace("[none, optimal]", "optimal")
    cli.write("mixed.yaml", study.replace(bad, f"[{', '.join(spelled.values())}]"))
    done = cli("run", "mixed.yaml", "--allow-code", code=1)
    assert done.stdout == "mixed: 6 failed, 2 ok -> results/mixed.csv\n"
    line = SWING[: SWING.index("def force")].count("\n") + 2
    expected = [f"own/{kind}.py, line {line}: {text}" for kind, (_, text) in HARD.items()]
    expected += [text for _, text in ENDS.values()]
    assert done.stderr.splitlines() == [
        f"newmark-study: mixed: 1 of 8 cells failed: {text}" for text in expected
    ]


def test_whatever_an_import_raises_is_one_line(cli):
    """It names the config's line, and that of the code where it raised something."""
    spelled = write_studies(cli, at_import="CODE")
    for kind, problem in spelled.items():
        cli.write(f"{kind}.yaml", STUDY.replace('{python: "own/bad.py:swing"}', problem))
    line = SWING.count("\n") + 3
    where = {kind: f"own/{kind}.py, line {line}" for kind in HARD}
    where |= {kind: f"own/{kind}.py:swing: cannot be loaded" for kind in ENDS}
    expected = [
        f"newmark-study: {kind}.yaml, line 6: cases[1].problem: {where[kind]}: {text}"
        for kind, (_, text) in {**HARD, **ENDS}.items()
    ]
    files = [f"{kind}.yaml" for kind in spelled]
    assert cli("validate", *files, "--allow-code", code=2).stderr.splitlines() == expected
    # As when it runs.
    assert cli.refused("run", files[-1], "--allow-code") == expected[-1]
    assert not (cli.folder / "results").exists()


def test_no_code_runs_here(tmp_path):
    """A problem that is loaded is described by another process; a cell runs it there."""
    file = tmp_path / "mine.py"
    file.write_text(SWING + "\nos.changed = True\n")
    spec = PythonFactory(file, "swing", (), "mine.py:swing")
    problem = spec.load()
    assert not hasattr(os, "changed")
    assert (problem.n, problem.m, problem.compiled) == (2, 1, False)
    assert problem.sources == {"mine.py": file.read_bytes()}
    for one in (spec, portable(spec)):
        problem = one.load()
        with pytest.raises(RuntimeError, match="only runs in separate processes"):
            problem.evaluate(0.0, problem.u0, problem.v0, problem.u0[:1])
        assert not hasattr(os, "changed")
    assert with_problem(spec, type(problem).constraint_values, 0.0, 2 * problem.u0) == [1.5]
