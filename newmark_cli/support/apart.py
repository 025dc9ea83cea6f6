"""Separate processes for user code.

A Python problem may change whatever its process holds: functions of NumPy, the working
directory, the environment; it may end the process, or not come back.  So a process that
runs it does nothing else, and runs one problem only.

A process is a fork of a server, which has imported the package and never runs user code:
it starts in milliseconds, and knows nothing of what ran before.  Between the two stands a
watcher, another fork, which reports how the process ended, and ends it when the connection
closes: when a call takes too long, or whoever asked is gone, however it went.

The fork server of the standard library does not serve: its socket has a name, which may be
too long and outlives a kill; it imports the program's main module; workers of dask may not
use it.  Windows cannot fork: there problems in Python are refused.
"""

import atexit
import contextlib
import functools
import importlib
import os
import pickle
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Hashable
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

from newmark_cli.support import interrupts
from newmark_cli.support.errors import ExecutorError, InputError, described
from newmark_cli.support.processors import usable

#: What loads a problem; the first process needs no more, and should not wait.
_FIRST = "newmark_cli.problems.python_problem"
#: What runs one, imported before the second process.
_REST = "newmark_cli.running.preloaded"
_START = """
import sys
sys.path[:] = {path!r}
from newmark_cli.support import apart
apart._serve({descriptor})
"""
#: How often a call looks whether it should stop (s).
_LOOK = 0.1


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
        timeout: Most wall time (s); the process is ended then.
        owner: The process is kept for the next call of the same owner, for what takes
            long to compile; without one it ends with the call.
        stopped: Whether to give up, asked now and then.

    Raises:
        ApartError: When there is no answer.
        Stopped: When it has given up.
        ExecutorError: When no process can be started.
        InputError: What the function raised.
    """
    process = _taken(owner) or _Process()
    try:
        answer = process.call(pickle.dumps((function, arguments)), timeout, stopped)
    except BaseException:
        process.end()
        raise
    _put_back(owner, process)
    succeeded, result = answer
    if succeeded:
        return result
    raise result if isinstance(result, InputError) else ApartError(str(result))


def end(owner: Hashable) -> None:
    """End a process that is kept for the next call of an owner, who makes none."""
    process = _taken(owner)
    if process is not None:
        process.end()


def _taken(owner: Hashable) -> "_Process | None":
    with _guard:
        for place, (theirs, process) in enumerate(_waiting):
            if owner is not None and theirs == owner:
                del _waiting[place]
                return process if process.alive else None
    return None


def _put_back(owner: Hashable, process: "_Process") -> None:
    if owner is None:
        process.end()
        return
    with _guard:
        _waiting.append((owner, process))
        while len(_waiting) > usable():
            _waiting.pop(0)[1].end()


class _Process:
    """A separate process that takes one call after another."""

    def __init__(self) -> None:
        if not hasattr(os, "fork"):
            raise ExecutorError(
                "problems in Python run in processes that are forked, which this system cannot; "
                "use Linux or macOS, or Linux within Windows (WSL)"
            )
        self._connection, theirs = Pipe()
        self._ended, ends = Pipe(duplex=False)
        with theirs, ends, _guard:
            try:
                _server(os.getpid()).send(theirs, ends)
            except OSError:  # it was killed
                _server.cache_clear()
                _server(os.getpid()).send(theirs, ends)
        # What a call may take does not count the start.
        if self._connection in wait([self._connection, self._ended]):
            self._connection.recv_bytes()

    @property
    def alive(self) -> bool:
        """Whether it can be called."""
        return not self._ended.poll()

    def call(
        self, request: bytes, timeout: float | None, stopped: Callable[[], bool]
    ) -> tuple[bool, Any]:
        """Whether a call succeeds, and its result or error."""
        with contextlib.suppress(OSError):  # it has ended; the code says how
            self._connection.send_bytes(pickle.dumps((_folder(), sys.path, request)))
        until = None if timeout is None else time.monotonic() + timeout
        while not wait([self._connection, self._ended], _LOOK):
            if stopped():
                raise Stopped
            if until is not None and time.monotonic() > until:
                raise TookLonger(f"took longer than {timeout:g} s")
        try:
            # The process may have ended after its answer.
            answer = self._connection.recv_bytes() if self._connection.poll() else b""
        except (EOFError, OSError):
            answer = b""
        if not answer:
            raise ApartError(f"its process ended with code {self._code()}")
        try:
            succeeded, result = pickle.loads(answer)
        except Exception as error:
            raise ApartError(
                f"returned something that cannot be read: {described(error)}"
            ) from None
        return bool(succeeded), result

    def _code(self) -> int:
        try:
            return int(self._ended.recv())
        except (EOFError, OSError):
            return -signal.SIGKILL

    def end(self) -> None:
        """End the process at once, whatever it does."""
        # A fork of this process may hold the connection, too.
        ours = socket.socket(fileno=os.dup(self._connection.fileno()))
        with ours, contextlib.suppress(OSError):
            ours.shutdown(socket.SHUT_RDWR)
        self._connection.close()
        self._ended.close()


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return None


class _Server:
    """The fork server, as seen from the process that uses it."""

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair()
        atexit.register(self._control.close)
        start = _START.format(path=sys.path, descriptor=theirs.fileno())
        with theirs, interrupts.held():
            started = subprocess.Popen(
                [sys.executable, "-P", "-c", start],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
            )
        started.returncode = 0  # not to be waited for: it ends with this process

    def send(self, connection: Connection, ends: Connection) -> None:
        """Have a process forked that answers a connection, and told what code it ends with."""
        socket.send_fds(self._control, [b"1"], [connection.fileno(), ends.fileno()])


@functools.cache
def _server(pid: int) -> _Server:
    """The server of this process; a fork gets its own."""
    return _Server()


# -- the server and its forks -------------------------------------------------------------


def _serve(descriptor: int) -> None:
    """Fork on request, until the requesting process ends."""
    importlib.import_module(_FIRST)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those who wait
    with socket.socket(fileno=descriptor) as control:
        while descriptors := socket.recv_fds(control, 1, 2)[1]:
            if _fork() == 0:
                control.close()
                _watch(*map(Connection, descriptors))
            for fd in descriptors:
                os.close(fd)
            importlib.import_module(_REST)


def _fork() -> int:
    with warnings.catch_warnings():
        # Of threads, of which a BLAS may have some; none of them runs Python.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _watch(connection: Connection, ends: Connection) -> None:
    """Fork a worker, kill it when its caller hangs up, and report its exit code."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = _fork()
    if pid == 0:
        ends.close()
        _work(connection)
    threading.Thread(target=_kill_at_hangup, args=(connection, pid), daemon=True).start()
    _, status = os.waitpid(pid, 0)
    with contextlib.suppress(OSError):
        ends.send(os.waitstatus_to_exitcode(status))
    os._exit(0)


def _kill_at_hangup(connection: Connection, pid: int) -> None:
    hangup = select.poll()
    hangup.register(connection.fileno(), 0)
    hangup.poll()
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _work(connection: Connection) -> None:
    """Answer calls until the caller hangs up."""
    global _inside
    _inside = True
    _server.cache_clear()
    _leave_signals_to_parent()
    exit_now = os._exit  # whatever becomes of the name
    try:
        connection.send_bytes(b"ready")
        while True:
            folder, sys.path[:], request = pickle.loads(connection.recv_bytes())
            connection.send_bytes(_answered(folder, request))
    except (EOFError, OSError):
        exit_now(0)
    finally:
        exit_now(1)


def _answered(folder: str | None, request: bytes) -> bytes:
    try:
        if folder is not None:
            os.chdir(folder)
        function, arguments = pickle.loads(request)
        answer = pickle.dumps((True, function(*arguments)))
    except InputError as error:
        # Dask teaches pickle to take these along, and they may be of what cannot be pickled.
        error.__cause__ = error.__context__ = error.__traceback__ = None
        answer = pickle.dumps((False, error))
    except BaseException as error:
        answer = pickle.dumps((False, described(error)))
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    return answer


def _leave_signals_to_parent() -> None:
    """Outlive what ends a command: a terminal or a batch system signals all its processes.

    Processes that the called code starts do not inherit this.
    """
    for number in interrupts.NAMES:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, interrupts.NAMES)
