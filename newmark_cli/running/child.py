"""Calls in a process of their own, which end in time whatever the called code does.

For what must not take its caller along and where `multiprocessing` may not start
processes: in the workers of dask.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from newmark_cli import interrupts
from newmark_cli.errors import InputError


class ChildError(Exception):
    """The process did not come back; the text says how it ended."""


def call(function: Callable[..., Any], arguments: tuple[Any, ...], timeout: float | None) -> Any:
    """What a function returns when it is called in a new process.

    Args:
        function: A function of a module.
        arguments: What pickle can carry.
        timeout: Most wall time (s), with the start of the process.

    Raises:
        ChildError: When there is no answer.
        InputError: What the function raised.
    """
    try:
        child = subprocess.run(
            [sys.executable, "-m", __name__],
            input=pickle.dumps((function, arguments)),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=timeout,
        )
    except subprocess.TimeoutExpired:
        raise ChildError(f"took longer than {timeout:g} s") from None
    if child.returncode != 0 or not child.stdout:
        raise ChildError(f"its process ended with code {child.returncode}")
    found = pickle.loads(child.stdout)
    if isinstance(found, InputError):
        raise found
    return found


def leave_signals_to_parent() -> None:
    """Outlive what ends a command: a terminal or a batch system signals all its processes.

    Processes that the called code starts do not inherit this.
    """
    for number in interrupts.NAMES:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, interrupts.NAMES)


def end_with_parent() -> None:
    """Let this process end when its parent has; nobody else waits for its work."""
    threading.Thread(target=_end_with, args=[os.getppid()], daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


def _main() -> None:
    # What the called code prints must not run into what it returns.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        leave_signals_to_parent()
        end_with_parent()
        function, arguments = pickle.load(sys.stdin.buffer)
        found: Any
        try:
            found = function(*arguments)
        except InputError as error:
            found = error
        pickle.dump(found, output)


if __name__ == "__main__":
    _main()
