"""The console script in forks of a process that has imported what its commands import.

A command takes a second to start, most of it imports; the suite runs hundreds.  Every
command still has a process of its own, from the script's first line to its exit code.
What Python and libraries read from the environment as they start is that of the one
process: the seed of hashes, Numba's folder of compiled code.
"""

import gc
import importlib
import json
import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path

#: The console script of the environment that runs the tests.
SCRIPT = Path(sys.executable).with_name("newmark-study")

#: What many commands import, with what these import in turn.
MODULES = (
    "newmark.compiled_march",
    "study.compute",
    "study.collection",
    "running.runner",
    "library.advising",
    "library.jacobians",
    "report.check",
    "report.plot",
)

#: Seconds after which a command is ended.
LIMIT = 200


class Warm:
    """The process that is forked."""

    def __init__(self):
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def run(self, arguments, folder):
        """Run the script in a folder; what it did, like `subprocess.run` with text."""
        out, err = folder.with_suffix(".out"), folder.with_suffix(".err")
        asked = [[str(SCRIPT), *arguments], str(folder), dict(os.environ), str(out), str(err)]
        print(json.dumps(asked), file=self._process.stdin, flush=True)
        code = int(self._process.stdout.readline())
        return subprocess.CompletedProcess(arguments, code, out.read_text(), err.read_text())

    def close(self):
        """End the process."""
        self._process.communicate()


def serve():
    """Fork for every line of the standard input, and print the exit code."""
    # What all commands set before they import anything: a fork wants no threads of BLAS.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    for module in MODULES:
        importlib.import_module(f"newmark_cli.{module}")
    from newmark_cli.mechanisms.registry import problem

    problem("pendulum")  # has Numba load its registries
    gc.freeze()  # a collection in a fork would copy every page
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            become(*json.loads(line))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def become(command, folder, environment, out, err):
    """Be the process of a command: its arguments, folder, environment, and streams."""
    signal.alarm(LIMIT)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    create = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    for stream, path, how in ((0, os.devnull, os.O_RDONLY), (1, out, create), (2, err, create)):
        opened = os.open(path, how)
        os.dup2(opened, stream)
        os.close(opened)
    sys.argv = command
    paths = environment.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[0:1] = [str(SCRIPT.parent), *filter(None, paths)]
    runpy.run_path(command[0], run_name="__main__")
    sys.exit()


if __name__ == "__main__":
    serve()
