"""Interrupts: Ctrl-C, SIGTERM and SIGHUP end a command in order, with a line and a code.

The first signal raises `Interrupt` in the main thread, so that everything open is closed
on the way out.  Python swallows exceptions in some places, such as finalizers and
callbacks from C: an interrupt that was lost there is raised again.  Whoever sends a second
signal while the command is closing does not want to wait, and it ends at once.

A signal that was ignored when the process started, as under ``nohup``, stays ignored.
Windows has no timer that raises again what was lost: there a second Ctrl-C is needed.
"""

import contextlib
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import CodeType, FrameType, FunctionType
from typing import Any, TypeVar

from newmark_cli import console

#: What the signals are called; the exit code is 128 plus the signal's number.
NAMES = {signal.Signals(number): name for number, name in console.NAMES.items()}

#: Whether there are timers.
_TIMED = hasattr(signal, "setitimer")
#: Seconds between two looks whether an interrupt was lost.
_AGAIN = 0.1
#: Seconds within which a second signal counts as the first: `timeout` sends two.
_ONE = 1.0


class Interrupt(KeyboardInterrupt):
    """A signal has asked the process to end."""


class _State:
    """Signals that have arrived, and how the process stands."""

    def __init__(self) -> None:
        self.before: dict[int, Any] = {}
        self.hook = sys.unraisablehook
        self.first: int | None = None
        self.since = 0.0
        self.postponed = 0
        self.settled = False
        self.threads_left = False
        self.note: Callable[[], str] = str


_state = _State()
#: Code of functions that no interrupt ends.
_unbroken: set[CodeType] = set()
_Function = TypeVar("_Function", bound=Callable[..., Any])


def catch() -> None:
    """Answer signals from now on; outside the main thread this does nothing."""
    global _state
    _state = _State()
    defaults = (signal.SIG_DFL, signal.default_int_handler, console.answer)
    with contextlib.suppress(ValueError):  # not in the main thread
        for number in NAMES:
            if signal.getsignal(number) in defaults:
                _state.before[number] = signal.signal(number, _arrived)
        sys.unraisablehook = _unraisable


def release() -> None:
    """Leave signals to whom they belonged before `catch`."""
    sys.unraisablehook = _state.hook
    for number, handler in _state.before.items():
        signal.signal(number, handler)


def note(told: Callable[[], str]) -> None:
    """Text that the message of an interrupt ends with."""
    _state.note = told


def received() -> bool:
    """Whether a signal has arrived."""
    return _state.first is not None


def settle() -> None:
    """The command has come to its end: what arrives from now on changes nothing."""
    _state.settled = True
    if _state.first is not None and _TIMED:
        signal.setitimer(signal.ITIMER_REAL, 0)


def answer() -> int:
    """Say that the process was interrupted; its exit code."""
    settle()
    with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
        print(_line(), file=sys.stderr, flush=True)
    return _code()


def leave_threads() -> None:
    """There are threads that nobody waits for when the process ends; see `end`."""
    _state.threads_left = True


def end(code: int) -> None:
    """End the process here if threads would keep it from its end; return if there are none."""
    if _state.threads_left:
        gc.collect()  # semaphores of processes that have ended
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)


@contextlib.contextmanager
def postponed() -> Iterator[None]:
    """Interrupts wait until the end of this context: what is begun in it is completed."""
    _state.postponed += 1
    try:
        yield
    finally:
        _state.postponed -= 1
        _raise(sys._getframe())


@contextlib.contextmanager
def after() -> Iterator[None]:
    """Signals are handled at the end of this context, whoever handles them.

    For calls of C that go on when a handler raises an exception in what they call, and lose it.
    Outside the main thread, where no handler runs, this does nothing.
    """
    arrived: list[tuple[int, FrameType | None]] = []
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {n: found for n in NAMES if callable(found := signal.getsignal(n))}
    for number in handlers:
        signal.signal(number, lambda *given: arrived.append(given))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in arrived:
            handlers[number](number, frame)


def unbroken(function: _Function) -> _Function:
    """A function that no interrupt ends: one that arrives comes again when it has returned."""
    assert isinstance(function, FunctionType)
    _unbroken.add(function.__code__)
    return function


def _arrived(number: int, frame: FrameType | None) -> None:
    if _state.first is None:
        _state.first, _state.since = number, time.monotonic()
        if _TIMED and not _state.settled:
            signal.signal(signal.SIGALRM, _look_again)
            signal.setitimer(signal.ITIMER_REAL, _AGAIN, _AGAIN)
    elif time.monotonic() - _state.since > _ONE:
        _leave()
    _raise(frame)


def _leave() -> None:
    """End the process at once; its children notice."""
    text = "" if _state.settled else f"{_line()}\n"
    if os.isatty(2) and os.environ.get("TERM") != "dumb":
        text = f"\x1b[?25h{text}"  # a progress display hides the cursor
    with contextlib.suppress(OSError):
        os.write(2, text.encode())
    os._exit(_code())


def _look_again(number: int, frame: FrameType | None) -> None:
    _raise(frame)


def _raise(frame: FrameType | None) -> None:
    if _state.first is None or _state.settled or _state.postponed:
        return
    if not _under_way() and not _once(frame):
        raise Interrupt


def _once(frame: FrameType | None) -> bool:
    """Whether something is being done that must be done once.

    Memory that is not Python's is taken or given back, or a function runs that is `unbroken`.
    """
    while frame is not None:
        if frame.f_code in _unbroken:
            return True
        if str(frame.f_globals.get("__name__")).startswith("llvmlite.binding"):
            return True
        frame = frame.f_back
    return False


def _under_way() -> bool:
    """Whether an interrupt is being handled: something is closing because of it."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, Interrupt):
        error = error.__context__
    return error is not None


def _unraisable(lost: Any) -> None:
    """Say nothing of an interrupt that was lost; it comes again."""
    if not (lost.exc_type and issubclass(lost.exc_type, Interrupt)):
        _state.hook(lost)


def _line() -> str:
    assert _state.first is not None
    return f"newmark-study: {NAMES[signal.Signals(_state.first)]}{_state.note()}"


def _code() -> int:
    assert _state.first is not None
    return 128 + _state.first
