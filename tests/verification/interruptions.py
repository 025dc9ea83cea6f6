"""A study ended by signals at random moments and resumed each time, against one that is not.

    python tests/verification/interruptions.py [COUNT] [--signal KILL|TERM|INT]

Signals go to all processes of a run, as a terminal or a batch system sends them.  Cells run
on threads and, in plain Python, in processes.  Exits with 1 when a run ends with another code,
says anything but one line, or when the CSVs differ.
"""

import argparse
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
from newmark_cli import Definition


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
#: Exit codes, and lines on stderr.
ENDINGS = {"KILL": (-signal.SIGKILL, 0), "TERM": (143, 1), "INT": (130, 1)}


def started(home, results):
    """A run, in a group of its own."""
    script = Path(sys.executable).with_name("newmark-study")
    command = [script, "run", "ended.yaml", "--results", results, "--jobs", "2", "-q"]
    return subprocess.Popen(
        [*command, "--allow-code"], cwd=home, start_new_session=True,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def main():
    """End, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", nargs="?", type=int, default=100)
    parser.add_argument("--signal", choices=ENDINGS, default="KILL")
    given = parser.parse_args()
    code, lines = ENDINGS[given.signal]
    random.seed(20061012)
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        (home / "ended.yaml").write_text(CONFIG)
        (home / "plain.py").write_text(PLAIN)
        assert started(home, "whole").wait() == 0
        cells = home / "broken/cells"
        for done in range(given.count):
            kept = len(list(cells.glob("*.json")))
            run = started(home, "broken")
            more = random.randrange(4)  # none: perhaps while it still starts
            while run.poll() is None and len(list(cells.glob("*.json"))) < kept + more:
                time.sleep(0.005)
            time.sleep(random.uniform(0.02, 2.0 if more == 0 else 0.12))
            if run.poll() is not None:
                print(f"complete after {done} signals")
                break
            os.killpg(run.pid, getattr(signal, f"SIG{given.signal}"))
            _, said = run.communicate()
            # Before the first import of the package the ending is Python's own.
            early = more == 0 and run.returncode in (-signal.SIGTERM, -signal.SIGINT)
            if not early and (run.returncode != code or len(said.splitlines()) != lines):
                print(f"exit code {run.returncode}: {said}")
                faults += 1
        assert started(home, "broken").wait() == 0
        whole, broken = ((home / where / "ended.csv").read_bytes() for where in ("whole", "broken"))
    print(f"{faults} faults; CSV byte-identical to the uninterrupted one: {whole == broken}")
    return int(bool(faults) or whole != broken)


if __name__ == "__main__":
    sys.exit(main())
