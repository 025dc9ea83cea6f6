"""A study ended by signals at random moments and resumed each time, against one that is not.

    python tests/verification/interruptions.py [COUNT] [--signal KILL|TERM|INT|mixed] [--one]
    python tests/verification/interruptions.py COUNT --early SECONDS

Signals go to all processes of a run, as a terminal or a batch system sends them; with
``--one`` only to the one that was started.  Cells run on threads and, in plain Python, in
processes.  After TERM and INT, which ``mixed`` alternates at random, the exit code and
the line on stderr must be right: how many cells are cached is counted.  Exits with 1 when
they are not, when anything else is on stderr (such as of semaphores), when the CSVs
differ, or when a cell ran again that was not in flight when a run was ended.

With ``--early`` a run is ended once each time, at a random moment of its first SECONDS: by
one line and the right code, unless Python or the script's own first lines had not come to
the package yet.
"""

import argparse
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
study: ended
t_end: 12.0
preconditioning: [none, left, right, optimal]
cases:
  - problem: pendulum
    form: [u-lambda, v-lambda, a-lambda, u-v-lambda]
    h: [1.0e-4, 1.1e-4, 1.2e-4, 1.3e-4, 1.4e-4, 1.5e-4, 1.6e-4, 1.7e-4, 1.8e-4, 1.9e-4,
        2.0e-4, 2.1e-4, 2.2e-4, 2.3e-4]
  - problem: {python: "plain.py:pendulum"}
    form: [u-lambda, v-lambda, a-lambda, u-v-lambda]
    h: 5e-2
"""
PLAIN = """\
import numpy as np
from newmark_cli.problems.python_problem import Definition


def pendulum():
    return Definition(
        mass_matrix=np.eye(2),
        u0=np.array([1.0, 0.0]),
        v0=np.zeros(2),
        force=lambda u, v, t: np.array([0.0, -1.0]),
        constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
        gradient=lambda u, t: u[:, None],
    )
"""
CELLS = 240
JOBS = 2
#: Cells that a run keeps before it is ended, at most; half as many on average.
MOST_KEPT = 3
#: How a run ends: exit code and word; nothing is said after SIGKILL.
ENDINGS = {
    signal.SIGTERM: (143, "terminated"),
    signal.SIGINT: (130, "interrupted"),
    signal.SIGKILL: (-9, ""),
}
SIGNALS = {
    "KILL": [signal.SIGKILL],
    "TERM": [signal.SIGTERM],
    "INT": [signal.SIGINT],
    "mixed": [signal.SIGTERM, signal.SIGINT],
}


def run(folder):
    """One run, in this process; notes each cell that starts and each that is kept."""
    from newmark_cli.cli import main
    from newmark_cli.mechanisms.spec import is_code
    from newmark_cli.running import executors, store

    log = os.open(folder / "log", os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def noted(word, cell):
        name = f"{cell.problem.label} {cell.form} {cell.preconditioning.label} {cell.h!r}"
        os.write(log, f"{word} {name}\n".encode())

    compute, keep = executors.compute, store.Store.keep

    def starting(cell, *rest):
        noted("start", cell)
        return compute(cell, *rest)

    def keeping(self, cell, done):
        if is_code(cell.problem):
            noted("start", cell)  # its process has no log
        keep(self, cell, done)
        noted("kept", cell)

    executors.compute, store.Store.keep = starting, keeping
    results = str(folder / "results")
    sys.argv[1:] = [
        "run", str(folder / "ended.yaml"), "--results", results, "--jobs", str(JOBS), "-q",
        "--allow-code",
    ]  # fmt: skip
    os.write(log, b"main\n")
    main()


def started(folder):
    """The same in a process of its own, and a group of its own."""
    folder.mkdir(exist_ok=True)
    (folder / "ended.yaml").write_text(CONFIG)
    (folder / "plain.py").write_text(PLAIN)
    with (folder / "stderr").open("w") as errors:
        return subprocess.Popen(
            [sys.executable, __file__, "--run", str(folder)],
            start_new_session=True,
            stderr=errors,
        )


def wait_for(folder, process, before, count):
    """Until the command has begun and has kept so many cells, or has ended."""
    log, new = folder / "log", ""
    while process.poll() is None and not ("main" in new and new.count("kept ") >= count):
        time.sleep(0.005)
        new = log.read_text()[before:] if log.exists() else ""


def wrong(process, folder, ending, new):
    """What is not as it should be of a run that was ended; its part of the log is given."""
    code, word = ENDINGS[ending]
    kept = len(list((folder / "results/cells").glob("*.json")))
    lines = (folder / "stderr").read_text().splitlines()
    told = f"; {kept} of {CELLS} cells are cached, run the same command again to continue"
    allowed = [[f"newmark-study: {word}{told}"]] if word else [[]]
    if word and "start " not in new:
        allowed.append([f"newmark-study: {word}"])  # before it knew what there is to do
    if process.returncode == code and lines in allowed:
        return []
    return [f"exit code {process.returncode} in place of {code}, on stderr: {lines}"]


def counted(log):
    """How often each cell started, and in how many of the runs that ended it was in flight.

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
        elif word == "ended":
            in_flight.update(running)
            running.clear()
    return starts, in_flight


def ended_early(count, seconds):
    """Signals while a command starts; exits as `main` does."""
    script = Path(sys.executable).with_name("newmark-study")
    answered, before, faults = 0, 0, []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(count):
            command = [script, "run", "pendulum-u", "--results", f"{folder}/{i}", "-q"]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            time.sleep(random.uniform(0, seconds))
            ending = random.choice(SIGNALS["mixed"])
            process.send_signal(ending)
            told = b"".join(process.communicate()).decode()
            code, word = ENDINGS[ending]
            lines = told.splitlines()
            if (process.returncode, told) == (0, "") or process.returncode == -ending:
                before += 1  # or behind the end
            elif "Traceback" in told and "newmark_cli/cli" not in told:
                before += 1  # in Python's own start
            elif process.returncode == code and len(lines) == 1 and word in told:
                answered += 1
            else:
                faults.append(f"exit code {process.returncode}: {lines}")
    print(*faults, sep="\n", end="\n" if faults else "")
    print(f"{count} signals: {answered} answered, {before} out of reach, {len(faults)} faults")
    return 1 if faults or not answered else 0


def main():
    """End, resume, compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--signal", choices=SIGNALS, default="KILL")
    parser.add_argument("--one", action="store_true", help="signal one process, not its group")
    parser.add_argument("--early", type=float, metavar="SECONDS", help="signal while it starts")
    given = parser.parse_args()
    random.seed(20061012)
    if given.early:
        return ended_early(given.count, given.early)
    faults, used = [], collections.Counter()
    with tempfile.TemporaryDirectory() as name:
        whole, broken = Path(name) / "whole", Path(name) / "broken"
        begin = time.perf_counter()
        assert started(whole).wait() == 0
        print(f"{CELLS} cells, uninterrupted: {time.perf_counter() - begin:.1f} s", flush=True)
        log = broken / "log"
        for done in range(given.count):
            before = log.stat().st_size if log.exists() else 0
            process = started(broken)
            if random.random() < 0.3:  # while it reads what is kept, and starts threads
                wait_for(broken, process, before, 0)
                time.sleep(0.02 + random.expovariate(2))
            else:
                wait_for(broken, process, before, random.randrange(MOST_KEPT + 1))
                time.sleep(random.uniform(0.02, 0.12))
            if process.poll() is not None:
                print(f"the study was complete after {done} signals: too short for {given.count}")
                return 1
            ending = random.choice(SIGNALS[given.signal])
            (os.kill if given.one else os.killpg)(process.pid, ending)
            process.wait()
            used[ending.name] += 1
            new = wrong(process, broken, ending, log.read_text()[before:])
            faults += new
            print(*new, sep="\n", end="\n" if new else "", flush=True)
            with log.open("a") as file:
                file.write("ended\n")
        kept = len(list((broken / "results/cells").glob("*.json")))
        spelled = ", ".join(f"{count} {name}" for name, count in sorted(used.items()))
        print(f"ended {given.count} times ({spelled}), {kept} cells kept until then", flush=True)
        assert kept >= min(given.count, CELLS) // 2, "hardly anything was resumed"
        assert started(broken).wait() == 0
        csv = "results/ended.csv"
        same = (whole / csv).read_bytes() == (broken / csv).read_bytes()
        starts, in_flight = counted(log)
    again = {cell: count - 1 for cell, count in starts.items() if count > 1}
    needless = {cell for cell, more in again.items() if more > in_flight[cell]}
    if given.signal != "KILL":
        print(f"{given.count - len(faults)} of them with the right code and nothing but one line")
    print(f"{len(again)} cells ran more than once, {sum(again.values())} times more in all")
    print(f"{len(needless)} of them without having been in flight when a run was ended")
    print(f"CSV byte-identical to the uninterrupted one: {same}")
    return 0 if same and len(starts) == CELLS and not needless and not faults else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run(Path(sys.argv[2]))
    else:
        sys.exit(main())
