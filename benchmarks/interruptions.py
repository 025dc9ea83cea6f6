"""A study killed at random moments and resumed each time, against one that is not.

    python benchmarks/interruptions.py [KILLS]

Prints how often cells ran.  Exits with 1 when the CSVs differ, or when a cell ran
again that was not in flight when its run was killed.
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

CONFIG = """\
study: killed
problem: pendulum
form: [u-lambda, v-lambda, a-lambda, u-v-lambda]
preconditioning: [none, left, right, optimal]
h: [1e-2, 3e-3, 1e-3, 3e-4, 1e-4]
t_end: 6.0
"""
CELLS = 80
JOBS = 2


def run(folder):
    """One run, in this process; notes each cell that starts and each that is kept."""
    from newmark_cli.cli import main
    from newmark_cli.study import executors, store

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


def wait_for_a_cell(folder, process):
    """Until the run has started computing, or has ended: most of its time is imports."""
    log = folder / "log"
    before = log.stat().st_size if log.exists() else 0
    while process.poll() is None and (not log.exists() or log.stat().st_size == before):
        time.sleep(0.005)


def main():
    """Kill, resume, compare."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    random.seed(20061012)
    with tempfile.TemporaryDirectory() as name:
        whole, broken = Path(name) / "whole", Path(name) / "broken"
        begin = time.perf_counter()
        assert started(whole).wait() == 0
        length = time.perf_counter() - begin
        print(f"uninterrupted: {length:.1f} s")
        done = 0
        while done < kills:
            process = started(broken)
            wait_for_a_cell(broken, process)
            time.sleep(random.uniform(0, 0.5))
            if process.poll() is not None:
                # Complete: what is kept is thrown away but for a few, and on it goes.
                files = sorted((broken / "results/cells").glob("*.json"))
                for file in random.sample(files, len(files) * 3 // 4):
                    file.unlink()
                    with (broken / "log").open("a") as log:
                        log.write(f"dropped {file.name}\n")
                continue
            process.send_signal(signal.SIGKILL)
            process.wait()
            done += 1
        assert started(broken).wait() == 0
        csv = "results/killed.csv"
        same = (whole / csv).read_bytes() == (broken / csv).read_bytes()
        lines = (broken / "log").read_text().splitlines()
        drops = sum(line.startswith("dropped ") for line in lines)
        counts = {
            word: collections.Counter(
                line.removeprefix(word + " ") for line in lines if line.startswith(word + " ")
            )
            for word in ("start", "kept")
        }
        starts, kept = sum(counts["start"].values()), sum(counts["kept"].values())
        again = sum(count > 1 for count in counts["start"].values())
        # Killed between keeping and noting, a cell is kept that the log does not have.
        print(f"killed {kills} times; {CELLS} cells, {drops} kept results thrown away on purpose")
        print(f"{starts} cells started, {kept} kept; {starts - kept} were in flight when killed")
        print(f"{again} cells ran more than once")
        extra = kept - CELLS - drops
        print(f"{max(extra, 0)} cells were kept more than once without need")
        print(f"CSV byte-identical to the uninterrupted one: {same}")
        in_flight = starts - kept <= JOBS * kills
        return 0 if same and in_flight and extra <= 0 else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run(Path(sys.argv[2]))
    else:
        sys.exit(main())
