"""Runs that are interrupted, resumed, or refused."""

import json
import math
import os
import re
import signal
import subprocess
from csv import DictReader

import numpy as np
import pytest
from conftest import (
    ENDINGS,
    LONG,
    QUICK,
    SWING,
    CommandLine,
    require_ended,
    require_failed_alone,
    wait_for_cells,
    wait_until,
    write_swings,
)
from damaging import damaged
from hypothesis import given
from hypothesis import strategies as st
from test_show import on_a_terminal

import newmark_cli
from newmark_cli.newmark.statistics import Measurement, Statistics
from newmark_cli.running import runner, store
from newmark_cli.study import config, csv_files, trajectories
from newmark_cli.study.cell import STATUSES, Done, Outcome

ROD = """\
points: {O: {fixed: [0, 0]}, P: {at: [2, 0], mass: 1}}
bars: {rod: {from: O, to: P, length: 2}}
gravity: [0, -9.81]
"""


def line_of(words):
    """Number of the line of `SWING` that has these words."""
    return 1 + SWING[: SWING.index(words)].count("\n")


def csv(folder, name="quick"):
    """Bytes of a study's CSV."""
    return (folder / f"{name}.csv").read_bytes()


def reasons(cli, *arguments):
    """What a dry run says of each cell, and its last line."""
    *lines, last = cli("run", "quick.yaml", "--dry-run", *arguments).stdout.splitlines()
    return [line.split(": ", 2)[2] for line in lines], last


def test_a_second_run_computes_nothing(cli, quick):
    """Same bytes; the summary and the dry run say that all was kept."""
    assert reasons(cli) == (["to run: not run yet"] * 4, "4 of 4 cells to run")
    assert not (cli.folder / "results").exists(), "a dry run writes nothing"
    assert cli("run", "quick.yaml").stdout == "quick: 4 ok -> results/quick.csv\n"
    first = csv(cli.folder / "results")
    assert reasons(cli) == (["done, ok"] * 4, "0 of 4 cells to run")
    assert cli("run", "quick.yaml").stdout == "quick: 4 ok (4 cached) -> results/quick.csv\n"
    assert csv(cli.folder / "results") == first
    assert reasons(cli, "--force") == (["to run: forced"] * 4, "4 of 4 cells to run")
    assert cli("run", "quick.yaml", "--force").stdout == "quick: 4 ok -> results/quick.csv\n"
    assert csv(cli.folder / "results") == first


def test_dry_runs_say_why(cli):
    """Another problem of the same name, other libraries, another core, a damaged file."""
    cli.write("rod.yaml", ROD)
    cli.write("quick.yaml", QUICK.replace("problem: pendulum", "problem: rod.yaml"))
    cli("run", "quick.yaml")
    assert reasons(cli)[0] == ["done, ok"] * 4
    os.utime(cli.folder / "rod.yaml", (1, 1))
    assert reasons(cli)[0] == ["done, ok"] * 4, "file times mean nothing"
    cli.write("rod.yaml", ROD.replace("mass: 1", "mass: 3"))
    assert reasons(cli)[0] == ["to run: the problem has changed"] * 4
    cli.write("rod.yaml", ROD)
    files = sorted((cli.folder / "results/cells").glob("*.json"))
    kept = {file: json.loads(file.read_text()) for file in files}
    for file, change in zip(files, ("versions", "core", "cut", "outcome"), strict=True):
        record = json.loads(json.dumps(kept[file]))
        if change in ("versions", "core"):
            record["key"]["core"] = "0" * 64
            if change == "versions":
                record["versions"]["numba"] = "0.1"
            parts = file.stem.split("-")
            file.unlink()
            file = file.with_name("-".join([*parts[:2], "0" * 16]) + ".json")
        if change == "outcome":
            del record["outcome"]["measurements"][0]["statistics"]["rms"]
        text = json.dumps(record)
        file.write_text(text[:100] if change == "cut" else text)
    found = sorted(reasons(cli)[0])
    assert found[:2] == ["to run: cached result is damaged"] * 2
    assert found[2].startswith("to run: numba 0.1 -> ")
    assert found[3] == "to run: the numerical core has changed"
    before = csv(cli.folder / "results")
    assert "(4 cached)" not in cli("run", "quick.yaml").stdout
    assert csv(cli.folder / "results") == before


def test_damaged_cells_are_computed_again(cli, quick):
    """One flipped bit, cut, or empty: never read as a result."""
    cli("run", "quick.yaml")
    before = csv(cli.folder / "results")
    studies = [config.load(quick)]
    file = sorted((cli.folder / "results/cells").glob("*.json"))[0]
    for content in damaged(file.read_bytes()):
        file.write_bytes(content)
        planned = runner.plan(studies, cli.folder / "results")
        assert sorted(entry.why for entry in planned) == ["", "", "", "cached result is damaged"]
    assert "(3 cached)" in cli("run", "quick.yaml").stdout
    assert csv(cli.folder / "results") == before


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The CSV of the long study from a run that nothing has interrupted, on one thread."""
    cli = CommandLine(tmp_path_factory.mktemp("whole"))
    cli.write("long.yaml", LONG)
    cli("run", "long.yaml", "--jobs", 1)
    return csv(cli.folder / "results", "long")


def test_an_interrupted_run_goes_on(cli, whole):
    """One line and the code of the signal; however it ended, the CSV is the same at last.

    Ctrl-C is sent in `test_interrupts` and `test_cluster`.
    """
    cli.write("long.yaml", LONG)
    kept = 0
    # The first with threads side by side; then one cell after the other.
    for ending, jobs in ((signal.SIGHUP, 2), (signal.SIGKILL, 1)):
        run = cli.start("run", "long.yaml", "--jobs", jobs)
        wait_for_cells(cli.folder / "results", kept + 1)
        run.send_signal(ending)
        _, errors = run.communicate(timeout=60)
        kept = len(list((cli.folder / "results/cells").glob("*.json")))
        if ending in ENDINGS:
            require_ended(run, ending, errors, kept, 24)
            assert errors.count("\n") == 1
        else:
            assert run.returncode == -ending
        assert not (cli.folder / "results/long.csv").exists()
    done = cli("run", "long.yaml").stdout
    assert "24 ok (" in done
    assert csv(cli.folder / "results", "long") == whole


def test_a_cell_that_hangs_or_dies_fails_alone(cli):
    """Plain Python runs in processes: the timeout ends one, an exit fails its cell alone."""
    write_swings(cli, "hang", "exit", "")
    arguments = ("run", "swings.yaml", "--allow-code")
    done = cli(*arguments, "--timeout", 3, "--jobs", 2, "-v", code=1)
    assert done.stdout == "swings: 2 failed, 1 ok -> results/swings.csv\n"
    require_failed_alone(done.stderr, "3 cells, 2 at a time")
    dry = cli(*arguments, "--dry-run").stdout
    assert dry.count("to run: failed before: ") == 2
    assert dry.endswith("2 of 3 cells to run\n")


def test_fail_fast_skips_the_rest(cli):
    """Skipped is neither failed nor not converged: no CSV, and the summary says so.

    The same command again does not go past the failure that ended it.
    """
    cli.write("long.yaml", LONG + "iteration_cap: 1\nmeasure: correction\n")
    arguments = ("run", "long.yaml", "--fail-fast", "--jobs", 1)
    first, again = (cli(*arguments, code=1).stdout for _ in range(2))
    assert "1 not_converged" in first
    assert " skipped" in first
    assert "cached in results/cells" in first
    assert not (cli.folder / "results/long.csv").exists()
    counts = re.findall(r"\d+ [a-z_]+", first)
    assert re.findall(r"\d+ [a-z_]+", again)[: len(counts)] == counts
    assert "12 not_converged, 12 ok (" in cli("run", "long.yaml", code=1).stdout


def test_failures_replace_no_results(cli, quick):
    """A forced run that fails leaves what is kept, and the next run writes it again."""
    cli("run", "quick.yaml")
    first = csv(cli.folder / "results")
    assert "4 failed" in cli("run", "quick.yaml", "--force", "--timeout", "1e-9", code=1).stdout
    assert cli("run", "quick.yaml").stdout == "quick: 4 ok (4 cached) -> results/quick.csv\n"
    assert csv(cli.folder / "results") == first


ERRORS = """\
study: errors
problem: {python: "mine.py:swing", args: {what: WHAT, steps: 10}}
form: u-lambda
preconditioning: [none, optimal]
h: 0.1
t_end: 1.0
expect: [{measure: correction, at_least: 1.0e-99}]
measure: [correction, error]
"""


def measured(folder):
    """Quantity → rms and max of the errors in a CSV, a pair for each cell; and all statuses."""
    rows = list(DictReader((folder / "results/errors.csv").read_text().splitlines()))
    errors = [row for row in rows if row["measure"] == "error"]
    found = {
        quantity: [(row["rms"], row["max"]) for row in errors if row["quantity"] == quantity]
        for quantity in ("u", "v", "lambda")
    }
    assert sum(map(len, found.values())) == len(errors)
    corrections = [float(row["max"]) for row in rows if row["measure"] == "correction"]
    assert len(corrections) == 4
    assert all(0 < value < 1 for value in corrections)
    return found, {row["status"] for row in rows}


REASONS = {
    "hang": "took longer than 3 s",
    "exit": "its process ended with code 3",
    "leave": f"mine.py, line {line_of('SystemExit')}: SystemExit: 0",
    "raise": f"mine.py, line {line_of('RuntimeError')}: RuntimeError: not after 0.5",
}


@pytest.mark.parametrize("what", REASONS)
def test_references_that_never_come(cli, what):
    """They cost the cells that need them only the error; why is told once, kept, and recorded."""
    cli.write("quick.yaml", QUICK)
    cli.write("mine.py", SWING)
    cli.write("errors.yaml", ERRORS.replace("WHAT", what))
    patience = 3 if what == "hang" else 60
    arguments = ("errors.yaml", "quick.yaml", "--allow-code", "--timeout", patience)
    done = cli("run", *arguments, "-q", code=1)
    why = f"mine.py:swing(what={what} steps=10): no reference at t = 1: {REASONS[what]}"
    complaint = f"newmark-study: errors: 2 of 2 cells measured no error: {why}\n"
    assert (done.stdout, done.stderr) == ("", complaint)
    empty = {quantity: [("", "")] * 2 for quantity in ("u", "v", "lambda")}
    assert measured(cli.folder) == (empty, {"ok"})
    record = json.loads((cli.folder / "results/errors.json").read_text())
    assert [cell["lacks"] for cell in record["cells"]] == [[why]] * 2
    dry = cli("run", *arguments, "--dry-run").stdout.splitlines()
    assert sum(line.endswith(f"{REASONS[what]}; a run tries again") for line in dry) == 2
    assert dry[-1] == "0 of 6 cells to run"


def test_references_that_come_at_last(cli):
    """A cell that lacks its reference is kept until there is one, and then computed."""
    cli.write("mine.py", SWING)
    cli.write("errors.yaml", ERRORS.replace("WHAT", "wait"))
    run = ("run", "errors.yaml", "--allow-code")
    complaint = cli(*run, code=1).stderr
    done = cli(*run, code=1)
    assert done.stdout == "errors: 2 ok (2 cached) -> results/errors.csv\n"
    assert done.stderr == complaint
    assert "2 of 2 cells measured no error: " in complaint
    cli.write("ready", "")
    done = cli(*run)
    assert (done.stdout, done.stderr) == ("errors: 2 ok -> results/errors.csv\n", "")
    errors, statuses = measured(cli.folder)
    assert statuses == {"ok"}
    assert all(1e-4 < float(value) < 1 for pairs in errors.values() for value in sum(pairs, ()))
    # What is whole is not given up for what is not.
    (cli.folder / "ready").unlink()
    for file in (cli.folder / "results/references").iterdir():
        file.unlink()
    cli(*run, "--force", code=1)
    assert cli(*run).stdout == "errors: 2 ok (2 cached) -> results/errors.csv\n"
    assert measured(cli.folder) == (errors, {"ok"})


CAPPED = QUICK + "iteration_cap: 1\nmeasure: correction\n"


def test_what_is_accepted_is_not_part_of_a_cell(cli):
    """Studies that share cells compute them once, whatever each accepts, however it spells them."""
    accepting = "accept: not_converged\n"
    more = {"one": "", "two": accepting, "three": "linear_solver: dense-lu\n"}
    for name, text in more.items():
        cli.write(f"{name}.yaml", CAPPED.replace("quick", name) + text)
    done = cli("run", "one.yaml", "two.yaml", "three.yaml", "-v", code=1)
    assert done.stderr.startswith("4 cells, ")
    assert [line.split(": ", 1)[1] for line in done.stderr.splitlines()[5:]] == [
        f"{name}: 4 of 4 cells ended with status not_converged, at h = 0.1, 0.01; a smaller h may "
        "help"
        for name in ("one", "three")
    ]
    assert len(list((cli.folder / "results/cells").iterdir())) == 4
    one, two, three = (
        [line.split(b",", 1)[1] for line in csv(cli.folder / "results", name).splitlines()]
        for name in more
    )
    assert one == two == three
    cli.write("one.yaml", CAPPED.replace("quick", "one") + accepting)
    assert cli("run", "one.yaml").stdout == "one: 4 not_converged (4 cached) -> results/one.csv\n"


def test_workers_end_with_their_run(cli):
    """Processes of a run that is killed end with it, even one that holds the interpreter's lock."""
    write_swings(cli, "hang")
    cli.write("mine.py", SWING.replace("time.sleep(3600)", "sum(range(10**15))"))
    run = cli.start("run", "swings.yaml", "--allow-code", start_new_session=True)

    def members():
        """Processes of the run's session."""
        found = subprocess.run(
            ["ps", "-s", str(run.pid), "-o", "pid="], capture_output=True, text=True
        )
        return found.stdout.split()

    wait_until((cli.folder / "hangs").exists)
    assert len(members()) > 2
    run.kill()
    run.communicate()
    wait_until(lambda: not members())


def test_a_terminal_shows_progress(cli, quick):
    """Where the cells run, and a display up to the end; nothing when all is kept, or with -q."""

    def shown(*arguments, **environment):
        return on_a_terminal(cli, "run", "quick.yaml", *arguments, stream="stderr", **environment)

    first = shown("--jobs", "1", "-v")
    assert "\x1b[3" in first, "coloured"
    lines = re.split(r"[\r\n]+", re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", first))
    assert "4 cells, 1 at a time" in lines
    assert sum(": ok, " in line for line in lines) == 4
    for counts in ("0% 0 done, 0 failed, 4 left", "100% 4 done, 0 failed, 0 left"):
        assert any(counts in line for line in lines)
    assert shown() == shown("--force", "-q") == ""
    for environment, codes in (({"NO_COLOR": "1"}, r"\x1b\[[0-9;]*m"), ({"TERM": "dumb"}, r"\x1b")):
        plain = shown("--force", **environment)
        assert "100% 4 done" in plain
        assert not re.search(codes, plain)


(cell, *_) = config.load_shipped("pendulum-u").cells()
numbers = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.lists(st.tuples(st.sampled_from("uva"), numbers, numbers), max_size=4),
    st.sampled_from(STATUSES[:-1]),
    st.one_of(st.none(), st.integers(0, 10**9)),
    st.lists(st.text(st.characters(codec="utf-8")), max_size=2).map(tuple),
    st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=3),
)
def test_outcomes_are_kept_to_the_bit(tmp_path_factory, found, status, met, lacks, kept):
    """What is read back makes the same CSV and trajectories."""
    outcome = Outcome(
        measurements=[
            Measurement(u, "correction", "primary", Statistics(x, y, x, y, 3)) for u, x, y in found
        ],
        not_converged=2,
        newton_iterations=math.pi,
        status=status,
        met=met,
        lacks=lacks,
        trajectory={
            "step": np.arange(len(kept)),
            "t": np.arange(len(kept)) / 3,
            "u[a, =b]": np.array(kept),
            "energy": np.array(kept) / 7,
        },
    )
    kept = store.Store(tmp_path_factory.mktemp("store"))
    kept.prepare()
    kept.keep(cell, Done(outcome, 0.1))
    back = kept.find(cell)
    assert back.outcome.lacks == lacks
    for text in (
        lambda one: csv_files.csv_text(csv_files.COLUMNS, csv_files.rows("s", [cell], [one])),
        lambda one: trajectories.csv(trajectories.table("s", [cell], [one])),
    ):
        assert text(back.outcome) == text(outcome)


def test_a_release_lets_nothing_be_computed_again(monkeypatch):
    """The key of a kept cell follows code and libraries, not the number of the version."""

    def core():
        store.core.cache_clear()
        store.versions.cache_clear()
        return store.core()

    before = core()
    monkeypatch.setattr(newmark_cli, "__version__", "99.0")
    released = core(), store.versions()["newmark-study"]
    monkeypatch.setattr(store, "version", lambda name: "99.0")
    others = core()
    monkeypatch.undo()
    assert released == (before, "99.0")
    assert others != before == core()
