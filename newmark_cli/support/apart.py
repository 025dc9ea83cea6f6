"""Separate processes for user code.

A Python problem may change whatever its process holds: functions of NumPy, the working
directory, the environment; it may end the process, or not come back.  So a process that
runs it does nothing else, and runs one problem only.

A process is a fork of a server, which has imported the package and never runs user
code: it starts in milliseconds, and knows nothing of what ran before it.  The
standard library's fork server could not be used in the workers of dask, would import the
program's main module into every process, and listens on a socket with a name.  Windows
cannot fork: there problems in Python are refused.
"""

import atexit
import contextlib
import gc
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
from collections.abc import Callable, Hashable, Iterator
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

from newmark_cli.support import interrupts
from newmark_cli.support.errors import ExecutorError, InputError, described
from newmark_cli.support.processors import usable

#: What ends a process at once.
_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
#: What loads a problem.  The first process needs no more, and should not wait.
_FIRST = "newmark_cli.problems.python_problem"
#: What runs one, and would otherwise be imported by each process for itself.
_IMPORTED = tuple(
    f"newmark_cli.{name}"
    for name in (
        "problems.reference", "study.compute", "study.motion",
        "newmark.compiled_march", "newmark.scipy_march", "running.runner",
    )
)  # fmt: skip

_START = (
    "import sys; sys.path[:] = {path!r}; from newmark_cli.support import apart; apart._serve({fd})"
)


class ApartError(Exception):
    """A call did not come back; the text says how its process ended."""


class TookLonger(ApartError):
    """A call did not come back in time."""


def inside() -> bool:
    """Whether this process is one of those: what runs here is user code.

    Signals are left to the process that has asked for it, so that a `KeyboardInterrupt`
    is the code's own.
    """
    return _inside


_inside = False


class Process:
    """A process of its own that takes one call after the other."""

    def __init__(self) -> None:
        """Start it.

        Raises:
            ExecutorError: When no process can be started.
        """
        self._connection, self._ended, self._pid = _forked()
        self._given_up = False

    def call(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], timeout: float | None = None
    ) -> Any:
        """Result of a function that the process calls.

        Args:
            function: A function of a module.
            arguments: What pickle can carry.
            timeout: Most wall time (s); the process is ended then.

        Raises:
            ApartError: When there is no answer; the process is of no more use.
            InputError: What the function raised.
        """
        try:
            return self._answer(pickle.dumps((_folder(), sys.path, function, arguments)), timeout)
        except InputError:
            raise
        except BaseException:
            self.end()
            raise

    def _answer(self, asked: bytes, timeout: float | None) -> Any:
        with contextlib.suppress(OSError):  # it has ended; the code says how
            self._connection.send_bytes(asked)
        if not wait([self._connection, self._ended], timeout):
            raise TookLonger(f"took longer than {timeout:g} s")
        try:
            # The process may have ended behind its answer.
            given = self._connection.recv_bytes() if self._connection.poll() else b""
        except (EOFError, OSError):
            given = b""
        if not given:
            raise ApartError(f"its process ended with code {self._code()}")
        try:
            well, found = pickle.loads(given)
        except Exception as error:
            raise ApartError(
                f"returned something that cannot be read: {described(error)}"
            ) from None
        if well:
            return found
        raise found if isinstance(found, InputError) else ApartError(str(found))

    def _code(self) -> int:
        try:
            return int(self._ended.recv())
        except (EOFError, OSError):  # the server has ended
            return -_KILL

    @property
    def alive(self) -> bool:
        """Whether it can be called."""
        return not (self._given_up or self._ended.poll())

    def end(self) -> None:
        """End the process at once, whatever it does; from any thread."""
        if self.alive:
            self._given_up = True
            with contextlib.suppress(OSError):
                os.kill(self._pid, _KILL)


def call(
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    timeout: float | None = None,
    owner: Hashable = None,
) -> Any:
    """Result of a function in a process of its own; see `Process.call` and `process`."""
    with process(owner) as one:
        return one.call(function, arguments, timeout)


@contextlib.contextmanager
def process(owner: Hashable = None) -> Iterator[Process]:
    """A process of its own.

    Args:
        owner: The process is kept for the next call of the same owner, for what takes
            long to compile; without one it ends with the context.
    """
    one = _taken(owner) or Process()
    try:
        yield one
    except InputError:
        _put_back(owner, one)
        raise
    except BaseException:
        one.end()
        raise
    _put_back(owner, one)


def end(owner: Hashable) -> None:
    """End a process that is kept for the next call of an owner, who makes none."""
    one = _taken(owner)
    if one is not None:
        one.end()


#: Processes that wait for a call, each with its owner.
_waiting: list[tuple[Hashable, Process]] = []
_guard = threading.RLock()


def _taken(owner: Hashable) -> Process | None:
    with _guard:
        for place, (theirs, one) in enumerate(_waiting):
            if owner is not None and theirs == owner and one.alive:
                del _waiting[place]
                return one
    return None


def _put_back(owner: Hashable, one: Process) -> None:
    if owner is None or not one.alive:
        one.end()
        return
    with _guard:
        _waiting.append((owner, one))
        while len(_waiting) > usable():
            _waiting.pop(0)[1].end()


def stop() -> None:
    """End the server with all its processes; the next call starts it anew."""
    global _server
    with _guard:
        _waiting.clear()
        if _server is not None:
            _server.close()
            _server = None


@atexit.register
def _stop_at_exit() -> None:
    # Python warns of a socket that its end closes.  Not if a thread is just asking: it may hang.
    if _guard.acquire(blocking=False):
        try:
            stop()
        finally:
            _guard.release()


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return None


# -- the server, seen from the process that asks for others -------------------------------


class _Server:
    """The process that is forked."""

    def __init__(self) -> None:
        self.asked_by = os.getpid()
        self._control, theirs = socket.socketpair()
        start = _START.format(path=sys.path, fd=theirs.fileno())
        with theirs, _signals_blocked():
            # Not to be waited for: it ends with this process.
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", start],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
            )
        self._process.returncode = 0  # no warning that it is still running

    def fork(self) -> tuple[Connection, Connection, int]:
        """Of a new process: for its calls, for the code that it ends with, and its number."""
        ours, theirs = Pipe()
        ended, ends = Pipe(duplex=False)
        with theirs, ends:
            socket.send_fds(self._control, [b"1"], [theirs.fileno(), ends.fileno()])
        return ours, ended, ours.recv()

    def close(self) -> None:
        """Ask for no more."""
        self._control.close()


_server: _Server | None = None


def _forked() -> tuple[Connection, Connection, int]:
    if not hasattr(os, "fork"):
        raise ExecutorError(
            "problems in Python run in processes that are forked, which this system cannot; "
            "use Linux or macOS, or Linux within Windows (WSL)"
        )
    with _guard:
        for server in (_server, None):
            if server is None or server.asked_by != os.getpid():
                server = _started()
            with contextlib.suppress(EOFError, OSError):  # it has ended
                return server.fork()
    raise ExecutorError("no process can be started for user code")


def _started() -> _Server:
    global _server
    stop()
    _server = _Server()
    return _server


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Who starts here leaves signals to this process, from its first moment."""
    main = threading.current_thread() is threading.main_thread()
    with interrupts.postponed() if main else contextlib.nullcontext():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, interrupts.NAMES)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


# -- the server and its forks -------------------------------------------------------------


def _serve(descriptor: int) -> None:
    """Fork for everyone who asks, and tell how each has ended; ends with who has started it."""
    importlib.import_module(_FIRST)
    control = socket.socket(fileno=descriptor)
    woken, wakes = os.pipe()
    for end in (woken, wakes):
        os.set_blocking(end, False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    running: dict[int, Connection[Any, Any]] = {}
    ready_for_cells = False
    while True:
        ready, _, _ = select.select([control.fileno(), woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
            for pid, code in _ended():
                with running.pop(pid) as ends, contextlib.suppress(OSError):
                    ends.send(code)
        if control.fileno() in ready:
            _, given, _, _ = socket.recv_fds(control, 1, 2)
            if not given:
                break
            connection, ends = Connection(given[0]), Connection(given[1])
            pid = _fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                os.close(woken)
                os.close(wakes)
                control.close()
                for each in (ends, *running.values()):
                    each.close()
                _work(connection)
            connection.close()
            running[pid] = ends
            if not ready_for_cells:
                _import_rest()
                ready_for_cells = True
    for pid in running:
        os.kill(pid, _KILL)


def _import_rest() -> None:
    """What the cells need, while the first process loads a problem."""
    for name in _IMPORTED:
        importlib.import_module(name)
    importlib.import_module(_FIRST).warm()
    gc.collect()
    gc.freeze()  # a collection in a fork would copy every page


def _fork() -> int:
    with warnings.catch_warnings():
        # Of threads, of which a BLAS may have some; none of them runs Python.
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def _ended() -> Iterator[tuple[int, int]]:
    """Children that have ended since the last time, and their codes."""
    with contextlib.suppress(ChildProcessError):
        while True:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            yield pid, os.waitstatus_to_exitcode(status)


def _work(connection: Connection) -> None:
    """Be a process of its own: answer calls until nobody asks."""
    global _inside, _server
    _inside, _server = True, None
    _leave_signals_to_parent()
    _end_with_parent()
    exit_now = os._exit  # whatever becomes of the name
    try:
        connection.send(os.getpid())
        while True:
            folder, path, function, arguments = connection.recv()
            connection.send_bytes(_answered(folder, path, function, arguments))
    except (EOFError, OSError):
        exit_now(0)
    finally:
        exit_now(1)


def _answered(
    folder: str | None, path: list[str], function: Callable[..., Any], arguments: tuple[Any, ...]
) -> bytes:
    found: tuple[bool, Any]
    try:
        if folder is not None:
            os.chdir(folder)
        sys.path[:] = path
        found = True, function(*arguments)
        answer = pickle.dumps(found)
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


def _end_with_parent() -> None:
    """Let this process end when the server has; nobody else waits for its work."""
    threading.Thread(target=_end_with, args=[os.getppid()], daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)
