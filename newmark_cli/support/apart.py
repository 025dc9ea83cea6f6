"""Separate processes for user code.

A problem in Python comes with ``--allow-code`` and may then do what its user may (SECURITY.md);
a process keeps the run from its crashes, exits and endless loops.  A process is of one reading
of one problem and takes its calls one after the other, so that no other problem's numbers can
change.  Where a process cannot go on, the next call starts another.
"""

import atexit
import contextlib
import math
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any

from newmark_cli.support import interrupts
from newmark_cli.support.errors import InputError, described
from newmark_cli.support.processors import usable

_context: Any = multiprocessing.get_context("spawn")
#: What a process says before it calls a function: what took time until then was not user code.
_BEGUN = b"begun"
#: How often a call looks whether it should stop, and how long a lost process may take to end (s).
_LOOK, _PATIENCE = 0.1, 1.0


class ApartError(Exception):
    """A call did not come back; the text says how its process ended."""


class TookLonger(ApartError):
    """A call did not come back in time."""


class Stopped(Exception):
    """Nobody waits for the result any more: the run has ended."""


def inside() -> bool:
    """Whether this process is one of those: what runs here is user code.

    Signals are left to the process that has asked for it, so that a `KeyboardInterrupt`
    is the code's own.
    """
    return _inside


_inside = False
#: Processes that wait for a call, each with its owner.
_waiting: list[tuple[Hashable, "_Process"]] = []
_guard = threading.RLock()


def call(
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    timeout: float | None = None,
    owner: Hashable = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Any:
    """Result of a function that a separate process calls.

    Args:
        function: A function of a module of the package.
        arguments: Its arguments, such as pickle can carry.
        timeout: Most wall time (s); the process is ended then.
        owner: The process is kept for the next call of the same owner; without one it ends
            with the call.
        stopped: Whether to give up, asked now and then.

    Raises:
        ApartError: When there is no answer.
        Stopped: When it has given up.
        InputError: What the function raised.
    """
    with _guard:
        kept = next((pair for pair in _waiting if pair[0] == owner), None)
        if kept is not None:
            _waiting.remove(kept)
    process = kept[1] if kept is not None and kept[1].alive else _Process()
    try:
        succeeded, result = process.call(pickle.dumps((function, arguments)), timeout, stopped)
    except BaseException:
        process.end()
        raise
    if owner is None:
        process.end()
    else:
        with _guard:
            _waiting.append((owner, process))
            while len(_waiting) > usable():
                _waiting.pop(0)[1].end()
    if succeeded:
        return result
    raise result if isinstance(result, InputError) else ApartError(result)


@atexit.register  # before `multiprocessing` waits for what it has started
def _end_all() -> None:
    while _waiting:
        _waiting.pop()[1].end()


class _Process:
    """A separate process that takes one call after another."""

    def __init__(self) -> None:
        self._connection, theirs = _context.Pipe()
        with theirs, _guard, interrupts.held(), _bare() as environment:
            self._process = _context.Process(target=_work, args=(theirs, environment))
            self._process.start()

    @property
    def alive(self) -> bool:
        """Whether it can be called."""
        return bool(self._process.is_alive())

    def call(
        self, request: bytes, timeout: float | None, stopped: Callable[[], bool]
    ) -> tuple[bool, Any]:
        """Whether a call succeeds, and its result or error."""
        until, answer = math.inf, _BEGUN
        try:
            self._connection.send_bytes(request)
            while answer == _BEGUN:
                while not wait([self._connection, self._process.sentinel], _LOOK):
                    if stopped():
                        raise Stopped
                    if time.monotonic() > until:
                        raise TookLonger(f"took longer than {timeout:g} s")
                if not self._connection.poll():  # what the code has started may hold it open
                    raise EOFError
                answer = self._connection.recv_bytes()
                until = time.monotonic() + (math.inf if timeout is None else timeout)
        except (EOFError, OSError):
            self._process.join(_PATIENCE)
            code = -signal.SIGKILL if self.alive else self._process.exitcode
            raise ApartError(f"its process ended with code {code}") from None
        try:
            succeeded, result = pickle.loads(answer)
        except Exception as error:  # of a class in the user's code
            text = f"returned something that cannot be read: {described(error)}"
            raise ApartError(text) from None
        return succeeded, result

    def end(self) -> None:
        """End the process at once, whatever it does."""
        self._process.kill()
        self._process.join()
        self._connection.close()


@contextlib.contextmanager
def _bare() -> Iterator[dict[str, str]]:
    """Processes that start here import neither the caller's program nor from its folder.

    Yields:
        The environment that they should have.
    """
    main, environment = vars(sys.modules["__main__"]), dict(os.environ)
    hidden: dict[str, Any] = {n: main[n] for n in ("__spec__", "__file__") if n in main}
    main.update(dict.fromkeys(hidden))
    os.environ["PYTHONSAFEPATH"] = "1"
    # Workers of dask are daemons, which may otherwise start none.
    multiprocessing.current_process().daemon = False
    try:
        yield environment
    finally:
        main.update(hidden)
        del os.environ["PYTHONSAFEPATH"]
        if safe := environment.get("PYTHONSAFEPATH"):
            os.environ["PYTHONSAFEPATH"] = safe


# -- in the process -----------------------------------------------------------------------


def _work(connection: Connection, environment: dict[str, str]) -> None:
    """Answer calls until the caller hangs up."""
    global _inside
    _inside = True
    os.environ.pop("PYTHONSAFEPATH", None)
    os.environ.update(environment)
    _leave_signals_to_parent()
    _end_with_parent()
    exit_now = os._exit  # whatever becomes of the name
    try:
        while True:
            request = connection.recv_bytes()
            try:
                function, arguments = pickle.loads(request)
                connection.send_bytes(_BEGUN)
                answer = pickle.dumps((True, function(*arguments)))
            except InputError as error:
                # Dask teaches pickle to take these along; they may be of what cannot be pickled.
                error.__cause__ = error.__context__ = error.__traceback__ = None
                answer = pickle.dumps((False, error))
            except BaseException as error:
                answer = pickle.dumps((False, described(error)))
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(Exception):
                    stream.flush()
            connection.send_bytes(answer)
    except (EOFError, OSError):
        exit_now(0)
    finally:
        exit_now(1)


def _leave_signals_to_parent() -> None:
    """Outlive what ends a command: a terminal or a batch system signals all its processes."""
    for number in interrupts.NAMES:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, interrupts.NAMES)


def _end_with_parent() -> None:
    """Have the system end this process with its parent, even in code that never returns."""
    parent = multiprocessing.parent_process()
    if parent is None or not hasattr(os, "O_ASYNC"):
        return
    import fcntl

    sentinel = parent.sentinel
    fcntl.fcntl(sentinel, fcntl.F_SETOWN, os.getpid())
    flags = fcntl.fcntl(sentinel, fcntl.F_GETFL)
    fcntl.fcntl(sentinel, fcntl.F_SETFL, flags | os.O_ASYNC)
    if wait([sentinel], 0):
        os._exit(0)
