"""Shared fixtures: the command line as a user runs it, and small helpers."""

import csv
import multiprocessing
import os
import re
import runpy
import signal
import subprocess
import sys
import time
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from unittest import mock

# Before NumPy is imported, and as the commands have it: of several processes none is to
# wait for threads of BLAS that others hold up.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from command_line import CommandLine
from compiled import compile_all, is_kept
from hypothesis import HealthCheck, settings

from newmark_cli.support import processors

# Processes for user code are forks of one that has imported the package: to import it anew
# takes longer than most tests.
multiprocessing.set_forkserver_preload(["preloaded"])
multiprocessing.context._concrete_contexts["spawn"] = multiprocessing.get_context("forkserver")
ensure_running = forkserver._forkserver.ensure_running


def _with_preloaded():
    folders = filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH")))
    with mock.patch.dict(os.environ, PYTHONPATH=os.pathsep.join(folders)):
        ensure_running()


forkserver._forkserver.ensure_running = _with_preloaded
# Nobody pulls the plug.
os.fsync = lambda descriptor: None

# The first example of a test may wait for the kernel to be compiled; where nobody
# watches, the same examples are tried every time.
#: A busy machine says nothing about the code.
UNTIMED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("project", derandomize="CI" in os.environ, **UNTIMED)
settings.register_profile("release", max_examples=3_000, **UNTIMED)
settings.register_profile("fuzz", max_examples=20_000, **UNTIMED)
settings.load_profile("project")

# In GitHub's workflows `check` prints more.
os.environ.pop("GITHUB_ACTIONS", None)

# Processes that the suite starts share what Python has compiled of the package.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Under nohup, or in the background of a script, the suite ignores signals, and so would
# every process that it starts.  A handler that does nothing is not inherited.
for ignorable in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    if signal.getsignal(ignorable) == signal.SIG_IGN:
        signal.signal(ignorable, lambda number, frame: None)

#: Signals that end a command, with what it calls them.
ENDINGS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}

ONE_ULP = Path(__file__).parent / "one_ulp"


def pytest_addoption(parser):
    """Starts that differ in the last place: whatever the suite asserts must hold for them."""
    parser.addoption(
        "--one-ulp", type=int, metavar="SEED",
        help="march from starts one unit in the last place away, without tests of particular bits",
    )  # fmt: skip


def pytest_configure(config):
    """In this process, and in all that it starts."""
    config.addinivalue_line("markers", "bits(why): needs the last bits of marches as they are")
    config.addinivalue_line("markers", "release: takes long for a rare path; .ci/release runs it")
    if (seed := config.getoption("one_ulp")) is not None and "ONE_ULP" not in os.environ:
        path = os.environ.get("PYTHONPATH")
        os.environ |= {
            "ONE_ULP": str(seed),
            "PYTHONPATH": os.pathsep.join(filter(None, (str(ONE_ULP), path))),
        }
        runpy.run_path(str(ONE_ULP / "sitecustomize.py"))


def pytest_collection_modifyitems(config, items):
    """Tests that need particular bits say why."""
    if config.getoption("one_ulp") is not None:
        for item in items:
            if marked := item.get_closest_marker("bits"):
                item.add_marker(pytest.mark.skip(reason=marked.args[0]))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """One more than processors: many tests wait, for timeouts and for other processes."""
    return processors.usable() + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config):
    """Before the whole suite runs in several processes: what all of them need."""
    whole = config.args_source == config.ArgsSource.TESTPATHS and not config.option.keyword
    if whole and not is_kept():
        compile_all()


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler on loopback, its address, and a function that starts workers."""
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__NO_WORKERS_TIMEOUT": "120s"}
    # Elsewhere, so that nothing is found by its path.
    away = tmp_path / "away"
    away.mkdir()
    processes = []

    def start(*arguments, script=None, **added):
        code = [script] if script else ["-m", "dask"]
        command = [sys.executable, *code, *arguments]
        processes.append(
            subprocess.Popen(
                command, cwd=away, env=environment | added, text=True,
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            )
        )  # fmt: skip
        return processes[-1]

    main = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    for line in main.stderr:
        found = re.search(r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)", line)
        if found:
            address = found[1]
            break

    def workers(count, **how):
        return [
            start(
                "worker", address, "--nthreads", "1", "--nworkers", "1", "--no-dashboard",
                "--no-nanny", "--host", "127.0.0.1", **how,
            )
            for _ in range(count)
        ]  # fmt: skip

    try:
        yield main, address, workers
    finally:
        for process in processes:
            process.kill()
            process.wait()
            process.stderr.close()


@pytest.fixture(scope="session", autouse=True)
def _timed_once():
    """No test looks at how long a march takes."""
    from newmark_cli.study import compute

    compute._MEASURED = 1e-9


@pytest.fixture
def cli(tmp_path):
    """The command line in an empty folder."""
    return CommandLine(tmp_path)


QUICK = """\
study: quick
problem: pendulum
form: u-lambda
preconditioning: [none, optimal]
h: [1e-1, 1e-2]
t_end: 1.0
"""

#: 24 cells, of which the first to run take longest.
LONG = """\
study: long
problem: pendulum
form: [u-lambda, v-lambda, a-lambda]
preconditioning: [none, optimal]
h: [1e-2, 1e-3, 1e-4, 1e-5]
t_end: 1.0
"""

#: A problem in plain Python that is well, does not end, ends its process, leaves, or fails,
#: always or as long as there is no file "ready".  With ``steps`` it is well at their times:
#: where a march looks at it, but not a reference.  One that does not end writes a file "hangs".
SWING = """\
import os
import time

import numpy as np
from newmark_cli.problems.python_problem import Definition


def swing(what="", after=0.5, steps=0):
    def force(u, v, t):
        if t <= after or steps and abs(t * steps - round(t * steps)) < 1e-9:
            return np.array([0.0, -1.0])
        if what == "hang":
            open("hangs", "w").close()
            time.sleep(3600)
        if what == "exit":
            os._exit(3)
        if what == "leave":
            raise SystemExit(0)
        if what == "raise" or what == "wait" and not os.path.exists("ready"):
            raise RuntimeError(f"not after {after}")
        return np.array([0.0, -1.0])

    return Definition(
        mass_matrix=np.eye(2),
        u0=np.array([1.0, 0.0]),
        v0=np.zeros(2),
        force=force,
        constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
        gradient=lambda u, t: u[:, None],
        stiffness=lambda u, v, multipliers, t: -multipliers[0] * np.eye(2),
        damping=lambda u, v, t: np.zeros((2, 2)),
    )
"""


def write_swings(cli, *whats):
    """The study ``swings.yaml``: one cell of `SWING` for each of its ``what``."""
    cli.write("mine.py", SWING)
    cases = "".join(
        f'  - problem: {{python: "mine.py:swing", args: {{what: "{what}"}}}}\n' for what in whats
    )
    cli.write(
        "swings.yaml",
        "study: swings\nform: u-lambda\npreconditioning: optimal\nh: 0.1\nt_end: 1.0\n"
        "expect: [{measure: correction, at_least: 1.0e-99}]\n"
        f"cases:\n{cases}",
    )


def require_failed_alone(told, where):
    """What a run of hang, exit and "" says with ``-v`` and a timeout of 3 s."""
    first, well, ends, hangs, *complaints = sorted(told.splitlines())
    assert first == where
    assert complaints == [
        "newmark-study: swings: 1 of 3 cells failed: its process ended with code 3",
        "newmark-study: swings: 1 of 3 cells failed: took longer than 3 s",
    ]
    assert "(what=) " in well
    assert ": ok, " in well
    assert "(what=exit) " in ends
    assert "failed: its process ended with code 3" in ends
    assert "(what=hang) " in hangs
    assert "failed: took longer than 3 s" in hangs


def rows_in(path):
    """Rows of a CSV: column → text."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def wait_until(holds):
    """At most three minutes: code that a cell needs may have to be compiled first."""
    for _ in range(7200):
        if holds():
            return
        time.sleep(0.025)
    raise AssertionError("not within three minutes")


def wait_for_cells(folder, count):
    """Until so many cells are cached."""
    wait_until(lambda: len(list(folder.glob("cells/*.json"))) >= count)


def require_ended(run, ending, errors, kept, cells):
    """A run that a signal has ended says so in one line, last on stderr, and by its code."""
    *_, line = errors.splitlines()
    assert line == (
        f"newmark-study: {ENDINGS[ending]}; {kept} of {cells} cells are cached, "
        "run the same command again to continue"
    )
    assert run.returncode == 128 + ending


@pytest.fixture
def quick(cli):
    """A small valid config in the folder of ``cli``."""
    return cli.write("quick.yaml", QUICK)


@pytest.fixture
def of_float64(monkeypatch):
    """Advice on double precision only: marches in the other take half a minute to compile."""
    from newmark_cli.advice import advising

    monkeypatch.setattr(advising, "PRECISIONS", ("float64",))


@pytest.fixture
def few_draws(monkeypatch, of_float64):
    """Rounding is drawn less often, for what compares no number with what rounding does."""
    from newmark_cli.advice import linearised

    for name, value in (("SAMPLES", 2), ("ROUGHLY", 1), ("STATES", 3), ("STEPS_BETWEEN", 200)):
        monkeypatch.setattr(linearised, f"_{name}", value)


@pytest.fixture(scope="session")
def committed_folder():
    """The results of a full run that travel with the project."""
    return Path(__file__).parents[1] / "results"


@pytest.fixture(scope="session")
def committed_results(committed_folder):
    """Names of studies → their results in it, whose slopes are fitted once."""
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging.slopes import collect

    found = cache(lambda study: collect(committed_folder, [study]))
    return lambda *studies: Results(
        committed_folder, [slope for study in studies for slope in found(study)]
    )
