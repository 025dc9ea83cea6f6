"""Cells on dask workers: scheduler and workers as processes of their own."""

import contextlib
import json
import os
import re
import shutil
import signal
import socket
import sys
import tempfile
from pathlib import Path

import pytest
from command_line import CommandLine
from conftest import (
    SWING,
    require_failed_alone,
    require_interrupts_taken,
    wait_for_cells,
    write_swings,
)

import newmark_cli

pytest.importorskip("distributed")
import dask

STUDY = """\
study: spread
problem: [pendulum, mine.yaml]
form: [u-lambda, a-lambda]
preconditioning: [none, optimal]
h: [1e-2, 1e-3, 1e-4]
t_end: 3.0
"""
MINE = """\
points: {O: {fixed: [0, 0]}, P: {at: [2, 0], mass: 1}}
bars: {rod: {from: O, to: P, length: 2}}
gravity: [0, -9.81]
"""


@pytest.fixture(scope="module")
def threaded(tmp_path_factory):
    """The study's CSV from threads."""
    cli = CommandLine(tmp_path_factory.mktemp("threads"))
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)
    cli("run", "spread.yaml")
    return (cli.folder / "results/spread.csv").read_bytes()


@pytest.fixture
def study(cli, threaded):
    """A study with a mechanism file, and its CSV from threads."""
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)
    return threaded


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The common folder for temporary files, here and in commands."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def running(cli, address, *options):
    """A run on the scheduler, started and not waited for."""
    return cli.start(
        "run", "spread.yaml", "--results", "dask", "--executor", "dask", "--scheduler", address,
        *options,
    )  # fmt: skip


def test_workers_may_come_late_and_die(cli, study, scheduler):
    """The run says that it waits; three come and one is killed: the same bytes as from threads."""
    _, address, workers = scheduler
    run = running(cli, address, "-v")
    assert run.stderr.readline() == f"24 cells on the workers of {address}\n"
    line = run.stderr.readline()
    assert line == f"waiting for workers: the dask scheduler at {address} has none\n"
    first, *_ = workers(3)
    wait_for_cells(cli.folder / "dask", 2)
    first.send_signal(signal.SIGKILL)
    output, errors = run.communicate(timeout=120)
    assert run.returncode == 0, errors
    assert output.startswith("spread: 24 ok")
    assert (cli.folder / "dask/spread.csv").read_bytes() == study


def test_a_lost_scheduler_ends_the_run(cli, study, scheduler):
    main, address, workers = scheduler
    workers(1)
    run = running(cli, address)
    wait_for_cells(cli.folder / "dask", 2)
    main.send_signal(signal.SIGKILL)
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 1
    assert len(errors.splitlines()) == 1, errors
    (line,) = errors.splitlines()
    assert line.startswith(f"newmark-study: the dask scheduler at {address} is lost")
    assert not (cli.folder / "dask/spread.csv").exists()
    done = cli("run", "spread.yaml", "--results", "dask")
    assert re.search(r"24 ok \(\d+ cached\)", done.stdout)
    assert (cli.folder / "dask/spread.csv").read_bytes() == study


def test_no_scheduler(cli):
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)
    with dask.config.set({"distributed.comm.timeouts.connect": "500ms"}):
        done = cli(
            "run", "spread.yaml", "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9", code=1
        )
    (line,) = done.stderr.splitlines()
    assert "no dask scheduler at tcp://127.0.0.1:9" in line


def test_interrupts_are_for_the_run(cli, temporary):
    """Ctrl-C goes to all processes of a terminal, workers included, which leave no file."""
    where = "1 cell on the workers of this machine\n"
    moments = ((0.5, signal.SIGINT), (None, signal.SIGTERM))
    require_interrupts_taken(cli, moments, where, "--executor", "dask", "--jobs", 1)
    assert [*temporary.iterdir()] == []


#: What another copy of the package has that this one has not, and what is said of it.
OTHERS = {
    "newmark/kernel.py": "numerical core of the same version",
    "mechanisms/shipped/pendulum.yaml": "set of shipped mechanisms of the same version",
}

#: A worker whose package is the one beside this script, as far as files are read.
ELSEWHERE = """from pathlib import Path

import newmark_cli
from dask.__main__ import main
from newmark_cli.mechanisms import registry
from newmark_cli.running import store

package = Path(__file__).parent
newmark_cli.__file__ = str(package / "__init__.py")
registry._FOLDER = package / "mechanisms/shipped"
for known in (store.core, registry.digest):
    known.cache_clear()
main()
"""


@pytest.mark.parametrize("file", OTHERS)
def test_a_worker_with_another_core_is_refused(cli, scheduler, file):
    _, address, workers = scheduler
    package = Path(newmark_cli.__file__).parent
    other = cli.folder / "other"
    shutil.copytree(package, other, ignore=shutil.ignore_patterns("__pycache__"))
    with (other / file).open("a") as changed:
        changed.write("# changed\n")
    workers(1, script=cli.write("other/elsewhere.py", ELSEWHERE))
    require_refused(cli, address, f"computes with another {OTHERS[file]}; ")


def require_refused(cli, address, why):
    """The run ends in one line, and nothing is kept."""
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)
    run = running(cli, address)
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 1
    (line,) = errors.splitlines()
    assert why in line
    assert not list((cli.folder / "dask/cells").iterdir())


@pytest.mark.parametrize("scheduler", ["500ms"], indirect=True)
def test_workers_that_never_come(cli, scheduler):
    _, address, _ = scheduler
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)
    run = running(cli, address)
    _, errors = run.communicate(timeout=120)
    assert run.returncode == 1
    (line,) = errors.splitlines()
    assert line.startswith(f"newmark-study: the dask scheduler at {address} has no workers; ")


def test_a_cell_that_does_not_come_back_fails_alone(cli, scheduler):
    """Plain Python runs in a process of the worker, which outlives it, however it ends."""
    _, address, workers = scheduler
    workers(1)
    write_swings(cli, "hang", "exit", "")
    run = cli.start(
        "run", "swings.yaml", "--allow-code", "--executor", "dask", "--scheduler", address,
        "--timeout", 3, "-v",
    )  # fmt: skip
    output, errors = run.communicate(timeout=120)
    assert run.returncode == 1, errors
    assert output == "swings: 2 failed, 1 ok -> results/swings.csv\n", errors
    waits = f"waiting for workers: the dask scheduler at {address} has none\n"
    require_failed_alone(errors.replace(waits, ""), f"3 cells on the workers of {address}")


#: The command; before it reads the first result, others try to get into its cluster.
INTRUDER = """import gc

import distributed
from newmark_cli.cli import main
from newmark_cli.running import cluster

as_done = cluster._as_done


def after_intruders(*arguments):
    mine = distributed.default_client()
    address = mine.scheduler.address
    assert address.startswith("tls://127.0.0.1:"), address
    for where, security in [
        (address.replace("tls://", "tcp://"), None),
        (address, None),
        (address, distributed.Security.temporary()),
        (address, mine.security),
    ]:
        try:
            distributed.Client(where, security=security, timeout=1, set_as_default=False).close()
        except Exception as error:
            print("refused", type(error).__name__)
        else:
            print("let in")
        # A refused client that is collected while the next one starts blocks it for good.
        gc.collect()
    return as_done(*arguments)


if __name__ == "__main__":
    cluster._as_done = after_intruders
    main()
"""


def test_nobody_else_gets_in(cli, study):
    """Who has not the credentials of the run is refused by its scheduler; the run goes on."""
    script = cli.write("intruder.py", INTRUDER)
    with socket.socket() as dashboard:
        # Somebody else's, which dask would tell of.
        with contextlib.suppress(OSError):
            dashboard.bind(("127.0.0.1", 8787))
            dashboard.listen()
        run = cli.python(script, "run", "spread.yaml", "--executor", "dask", "--jobs", 1)
    assert run.stderr == ""
    *tried, summary = run.stdout.splitlines()
    assert [line.split()[0] for line in tried] == ["refused"] * 3 + ["let"]
    assert summary == "spread: 24 ok -> results/spread.csv"
    assert (cli.folder / "results/spread.csv").read_bytes() == study


#: A module that notes that somebody has imported it.
PLANTED = 'open(__file__ + ".ran", "w").close()\nraise ImportError("planted")\n'

#: A problem that notes where its process imports from, and who may write there.
LOOKS_AROUND = (
    SWING
    + """
import json
import sys
from pathlib import Path

from half import LENGTH


def looks_around():
    modes = {}
    for folder in sys.path:
        for part in (folder, *map(str, Path(folder).parents)):
            if os.path.isdir(part):
                modes[part] = oct(os.stat(part).st_mode & 0o777), os.stat(part).st_uid
    with open("seen", "a") as file:
        file.write(json.dumps([modes, os.environ.get("PYTHONSAFEPATH")]) + "\\n")
    return swing(after=LENGTH)
"""
)

OWN = """\
study: own
problem: {python: "own/problem.py:looks_around"}
form: u-lambda
preconditioning: none
h: 0.1
t_end: 1.0
expect: [{measure: correction, at_least: 1.0e-99}]
"""


def test_nothing_of_others_is_imported(cli, temporary):
    """Modules in the current folder, and where dask would have the folders of workers.

    Everybody knows the name of that folder, and may have made it before.
    """
    shared = temporary / "dask-scratch-space"
    shared.mkdir()
    for folder in (cli.folder, shared):
        for name in (*sys.stdlib_module_names, "distributed", "newmark_cli", "numba", "numpy"):
            (folder / f"{name}.py").write_text(PLANTED)
    cli.write("own/half.py", "LENGTH = 0.5\n")
    cli.write("own/problem.py", LOOKS_AROUND)
    cli.write("own.yaml", OWN)
    options = ("--allow-code", "--executor", "dask", "--jobs", 1)
    output, errors = cli.start("run", "own.yaml", *options).communicate(timeout=120)
    assert [*cli.folder.rglob("*.ran")] == []
    assert (output, errors) == ("own: 1 ok -> results/own.csv\n", "")
    seen = [json.loads(line) for line in (cli.folder / "seen").read_text().splitlines()]
    below = {}
    for modes, safe in seen:
        assert not safe  # the user's code may start a Python that relies on its folder
        below |= {
            folder: mode for folder, mode in modes.items() if Path(folder).parent == temporary
        }
    assert {*map(tuple, below.values())} == {("0o700", os.getuid())}
    assert [*temporary.iterdir()] == [shared]
