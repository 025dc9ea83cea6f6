"""A cell in a process of its own, which ends in time whatever the cell does.

For workers that must not die with a cell and may not have children of
`multiprocessing`, as those of dask.
"""

import os
import pickle
import subprocess
import sys
import threading
import time

from newmark_cli.errors import InputError
from newmark_cli.study.cell import Done
from newmark_cli.study.executors import Task, failed, overtime, perform


def perform_apart(task: Task, timeout: float) -> Done:
    """`newmark_cli.study.executors.perform` in a new process.

    Args:
        task: The cell, portable.
        timeout: Most wall time (s), with the start of the process.

    Raises:
        InputError: When the cell asks for what there is not.
    """
    start = time.perf_counter()
    try:
        child = subprocess.run(
            [sys.executable, "-m", __name__],
            input=pickle.dumps(task),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=timeout,
        )
    except subprocess.TimeoutExpired:
        return Done(overtime(timeout), timeout)
    if child.returncode != 0:
        reason = f"its process ended with code {child.returncode}"
        return Done(failed(reason), time.perf_counter() - start)
    found = pickle.loads(child.stdout)
    if isinstance(found, InputError):
        raise found
    assert isinstance(found, Done)
    return found


def _main() -> None:
    # What the cell's code prints must not run into what it found.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        threading.Thread(target=_end_with, args=[os.getppid()], daemon=True).start()
        found: Done | InputError
        try:
            found = perform(pickle.load(sys.stdin.buffer))
        except InputError as error:
            found = error
        pickle.dump(found, output)


def _end_with(parent: int) -> None:
    """A worker that is killed leaves no process behind that nobody waits for."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


if __name__ == "__main__":
    _main()
