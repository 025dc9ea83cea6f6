"""A study killed at random moments and resumed each time, against one that is not.

    python tests/verification/interruptions.py [KILLS]

Prints how many cells ran more than once.  Exits with 1 when the CSVs differ, or when a
cell ran again that was not in flight when a run was killed.
"""

import collections
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

#: Cells of about a tenth of a second, a quarter of a minute of them for two threads.
CONFIG = """\
study: killed
problem: pendulum
form: [u-lambda, v-lambda, a-lambda, u-v-lambda]
preconditioning: [none, left, right, optimal]
h: [1.0e-4, 1.1e-4, 1.2e-4, 1.3e-4, 1.4e-4, 1.5e-4, 1.6e-4, 1.7e-4, 1.8e-4, 1.9e-4,
    2.0e-4, 2.1e-4, 2.2e-4, 2.3e-4, 2.4e-4]
t_end: 12.0
"""
CELLS = 240
JOBS = 2
#: Cells that a run keeps before it is killed, at most; half as many on average.
MOST_KEPT = 3


def run(folder):
    """One run, in this process; notes each cell that starts and each that is kept."""
    from newmark_cli.cli import main
    from newmark_cli.running import executors, store

    log = os.open(folder / "log", os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def noted(word, cell):
        os.write(log, f"{word} {cell.form} {cell.preconditioning.label} {cell.h!r}\n".encode())

    perform, keep = executors.perform, store.Store.keep

    def starting(task, *rest):
        noted("start", task.cell)
        return perform(task, *rest)

    def keeping(self, cell, done):
        keep(self, cell, done)
        noted("kept", cell)

    executors.perform, store.Store.keep = starting, keeping
    results = str(folder / "results")
    main(["run", str(folder / "killed.yaml"), "--results", results, "--jobs", str(JOBS), "-q"])


def started(folder):
    """The same in a process of its own."""
    folder.mkdir(exist_ok=True)
    (folder / "killed.yaml").write_text(CONFIG)
    return subprocess.Popen([sys.executable, __file__, "--run", str(folder)])


def wait_for_cells(folder, process, count):
    """Until the run has started computing, and has kept so many cells, or has ended."""
    log = folder / "log"
    before = log.stat().st_size if log.exists() else 0
    new = ""
    while process.poll() is None and not (new and new.count("kept ") >= count):
        time.sleep(0.005)
        new = log.read_text()[before:] if log.exists() else ""


def counted(log):
    """How often each cell started, and in how many of the kills it was in flight.

    Killed between keeping and noting, a kept cell looks like one that was in flight.
    """
    starts, in_flight = collections.Counter(), collections.Counter()
    running = set()
    for line in log.read_text().splitlines():
        word, _, cell = line.partition(" ")
        if word == "start":
            starts[cell] += 1
            running.add(cell)
        elif word == "kept":
            running.remove(cell)
        else:
            in_flight.update(running)
            running.clear()
    return starts, in_flight


def main():
    """Kill, resume, compare."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    random.seed(20061012)
    with tempfile.TemporaryDirectory() as name:
        whole, broken = Path(name) / "whole", Path(name) / "broken"
        begin = time.perf_counter()
        assert started(whole).wait() == 0
        print(f"{CELLS} cells, uninterrupted: {time.perf_counter() - begin:.1f} s", flush=True)
        for done in range(kills):
            process = started(broken)
            wait_for_cells(broken, process, random.randrange(MOST_KEPT + 1))
            time.sleep(random.uniform(0, 0.1))
            if process.poll() is not None:
                print(f"the study was complete after {done} kills: too short for {kills}")
                return 1
            process.send_signal(signal.SIGKILL)
            process.wait()
            with (broken / "log").open("a") as log:
                log.write("killed\n")
        kept = len(list((broken / "results/cells").glob("*.json")))
        print(f"killed {kills} times, {kept} cells kept until then", flush=True)
        assert kept >= min(kills, CELLS) // 2, "hardly anything was resumed"
        assert started(broken).wait() == 0
        csv = "results/killed.csv"
        same = (whole / csv).read_bytes() == (broken / csv).read_bytes()
        starts, in_flight = counted(broken / "log")
    again = {cell: count - 1 for cell, count in starts.items() if count > 1}
    needless = {cell for cell, more in again.items() if more > in_flight[cell]}
    print(f"{len(again)} cells ran more than once, {sum(again.values())} times more in all")
    print(f"{len(needless)} of them without having been in flight when a run was killed")
    print(f"CSV byte-identical to the uninterrupted one: {same}")
    return 0 if same and len(starts) == CELLS and not needless else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run(Path(sys.argv[2]))
    else:
        sys.exit(main())
