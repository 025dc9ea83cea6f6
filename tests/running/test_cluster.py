"""Cells on dask workers: scheduler and workers as processes of their own."""

import json
import os
import re
import signal
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import (
    SWING,
    require_ended,
    wait_for_cells,
    wait_until,
    write_swings,
)

from newmark_cli.mechanisms import registry
from newmark_cli.running import cluster, store
from newmark_cli.running.executors import Task
from newmark_cli.study import config
from newmark_cli.support.errors import ExecutorError

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

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


def write(cli):
    """Write the study and its mechanism."""
    cli.write("mine.yaml", MINE)
    cli.write("spread.yaml", STUDY)


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The common folder for temporary files, here and in commands."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def running(cli, address, results, *options):
    """A run on the scheduler, started and not waited for."""
    where = ("--executor", "dask", "--scheduler", address, "--results", results)
    return cli.start("run", "spread.yaml", *where, *options)


@pytest.mark.release
def test_workers_may_come_late_and_all_may_be_lost(cli, scheduler):
    """The run says that it waits; two come and one is killed: the same bytes as from threads.

    A scheduler that is killed ends the next run in one line; what is finished is kept.
    """
    main, address, workers = scheduler
    write(cli)
    cli("run", "spread.yaml")
    threaded = (cli.folder / "results/spread.csv").read_bytes()
    run = running(cli, address, "dask", "-v")
    assert run.stderr.readline() == f"24 cells on the workers of {address}\n"
    line = run.stderr.readline()
    assert line == f"waiting for workers: the dask scheduler at {address} has none\n"
    first, _ = workers(2)
    wait_for_cells(cli.folder / "dask", 2)
    first.send_signal(signal.SIGKILL)
    output, errors = run.communicate(timeout=120)
    assert run.returncode == 0, errors
    assert output.startswith("spread: 24 ok")
    assert (cli.folder / "dask/spread.csv").read_bytes() == threaded
    run = running(cli, address, "lost")
    wait_for_cells(cli.folder / "lost", 2)
    main.send_signal(signal.SIGKILL)
    _, errors = run.communicate(timeout=120)
    (line,) = errors.splitlines()
    assert run.returncode == 1
    assert line.startswith(f"newmark-study: the dask scheduler at {address} is lost")
    assert not (cli.folder / "lost/spread.csv").exists()
    done = cli("run", "spread.yaml", "--results", "lost")
    assert re.search(r"24 ok \(\d+ cached\)", done.stdout)
    assert (cli.folder / "lost/spread.csv").read_bytes() == threaded


def test_no_scheduler(cli):
    write(cli)
    where = ("--executor", "dask", "--scheduler", "tcp://127.0.0.1:9")
    with dask.config.set({"distributed.comm.timeouts.connect": "500ms"}):
        done = cli("run", "spread.yaml", *where, code=1)
    (line,) = done.stderr.splitlines()
    assert "no dask scheduler at tcp://127.0.0.1:9" in line


def test_workers_that_never_come(cli):
    write(cli)
    with (
        dask.config.set({"distributed.scheduler.no-workers-timeout": "500ms"}),
        distributed.LocalCluster(
            n_workers=0,
            processes=False,
            protocol="tcp://",
            host="127.0.0.1",
            dashboard_address=None,
        ) as there,
    ):
        address = there.scheduler_address
        where = ("--executor", "dask", "--scheduler", address)
        (line,) = cli("run", "spread.yaml", *where, code=1).stderr.splitlines()
    assert line.startswith(f"newmark-study: the dask scheduler at {address} has no workers; ")


@pytest.mark.parametrize(
    ("core", "numba", "shipped", "said"),
    [
        ("another", "", "", "computes with another numerical core of the same version"),
        ("", "", "another", "computes with another set of shipped mechanisms of the same version"),
        ("another", "0.1", "", r"computes with another numba \S+, here 0\.1"),
    ],
)
def test_a_worker_with_another_core_computes_nothing(monkeypatch, core, numba, shipped, said):
    """Whoever submits the cell says what it is to be computed with."""
    monkeypatch.setattr(distributed, "get_worker", lambda: SimpleNamespace(address="there"))
    versions = store.versions() | ({"numba": numba} if numba else {})
    wanted = core or store.core(), versions, shipped or registry.digest()
    (cell, *_) = config.load_shipped("pendulum-u").cells()
    with pytest.raises(ExecutorError, match=f"^the dask worker at there {said}$"):
        cluster._perform(Task(cell), None, wanted)


def test_workers_run_code_of_users_in_processes(cli):
    """So they outlive it, however it ends; see `test_a_cell_that_hangs_or_dies_fails_alone`."""
    write_swings(cli, "exit")
    (cell,) = config.load(cli.folder / "swings.yaml", allow_code=True).cells()
    wanted = store.core(), store.versions(), registry.digest()
    done = cluster._perform(Task(cell).of(cluster.portable(cell.problem)), None, wanted)
    assert (done.outcome.status, done.outcome.reason) == (
        "failed",
        "its process ended with code 3",
    )


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


def test_nobody_else_gets_in(cli, quick):
    """Who has not the credentials of the run is refused by its scheduler; the run goes on."""
    script = cli.write("intruder.py", INTRUDER)
    run = cli.python(script, "run", "quick.yaml", "--executor", "dask", "--jobs", 1)
    assert run.stderr == ""
    *tried, summary = run.stdout.splitlines()
    assert [line.split()[0] for line in tried] == ["refused"] * 2 + ["let"]
    assert summary == "quick: 4 ok -> results/quick.csv"
    cli("run", "quick.yaml", "--results", "threaded")
    of_both = [(cli.folder / name / "quick.csv").read_bytes() for name in ("results", "threaded")]
    assert of_both[0] == of_both[1]


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
    return swing("hang", after=LENGTH)
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

    Everybody knows the name of that folder, and may have made it before.  Ctrl-C goes to all
    processes of a terminal, workers included, which leave no file.
    """
    shared = temporary / "dask-scratch-space"
    shared.mkdir()
    for folder in (cli.folder, shared):
        for name in (*sys.stdlib_module_names, "distributed", "newmark_cli", "numba", "numpy"):
            (folder / f"{name}.py").write_text(PLANTED)
    cli.write("own/half.py", "LENGTH = 0.5\n")
    cli.write("own/problem.py", LOOKS_AROUND)
    cli.write("own.yaml", OWN)
    options = ("--allow-code", "--executor", "dask", "--jobs", 1, "-v")
    run = cli.start("run", "own.yaml", *options, start_new_session=True)
    assert run.stderr.readline() == "1 cell on the workers of this machine\n"
    wait_until((cli.folder / "hangs").exists)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    require_ended(run, signal.SIGINT, errors, 0, 1)
    assert len(errors.splitlines()) == 1
    assert [*cli.folder.rglob("*.ran")] == []
    seen = [json.loads(line) for line in (cli.folder / "seen").read_text().splitlines()]
    below = {}
    for modes, safe in seen:
        assert not safe  # the user's code may start a Python that relies on its folder
        below |= {
            folder: mode for folder, mode in modes.items() if Path(folder).parent == temporary
        }
    assert {*map(tuple, below.values())} == {("0o700", os.getuid())}
    assert [*temporary.iterdir()] == [shared]
