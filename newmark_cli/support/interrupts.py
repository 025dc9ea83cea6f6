"""Ctrl-C, SIGTERM and SIGHUP end a command at once, with one line and an exit code.

Nothing is lost by that: files are replaced whole, finished cells are on disk, the system
releases locks, and processes that work for a command notice its end.  So a signal is answered
like any other way to be killed, and nothing has to be unwound.  Only what is `postponed` is
completed first.  A signal that was ignored when the process started, as under ``nohup``, stays
ignored, and a process that calls the command line from Python keeps its own handlers.

Importing this module takes next to no time: the console script catches signals before it
imports anything else.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from types import FrameType

#: What the signals are called; the exit code is 128 plus the signal's number.
NAMES = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
if hasattr(signal, "SIGHUP"):  # not on Windows
    NAMES[signal.SIGHUP] = "hung up"


class Line:
    """The line of an interrupt: what stands around it, for whoever is interrupted to set."""

    before = ""  #: what gives a terminal back
    after: Callable[[], str] = str  #: makes what is added then


class _State:
    postponed = 0
    raises = 0
    arrived: int | None = None


def catch() -> None:
    """Answer signals from now on; only in the main thread."""
    for number in NAMES:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _answer)


def ignore() -> None:
    """The command has ended: what arrives now changes neither output nor code."""
    for number in NAMES:
        if signal.getsignal(number) is _answer:
            signal.signal(number, signal.SIG_IGN)


@contextlib.contextmanager
def postponed() -> Iterator[None]:
    """Signals wait until the end of this context: what is begun in it is completed."""
    _State.postponed += 1
    try:
        yield
    finally:
        _State.postponed -= 1
        if _State.arrived is not None and not _State.postponed:
            _answer(_State.arrived)


@contextlib.contextmanager
def held(names: Iterable[int] = tuple(NAMES)) -> Iterator[None]:
    """Signals wait; threads and processes that start here leave those named to this thread."""
    main = threading.current_thread() is threading.main_thread()
    with postponed() if main else contextlib.nullcontext():
        if not hasattr(signal, "pthread_sigmask"):  # Windows: no such signals
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, names)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def deferred() -> Iterator[Callable[..., None]]:
    """Ctrl-C waits until the end of this context, whoever answers it; only in the main thread.

    Yields:
        Calls a function with arguments, in which Ctrl-C does not wait.
    """
    answer = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(answer):
        yield lambda function, *arguments: function(*arguments)
        return
    waiting: list[FrameType | None] = []
    within = False

    def arrive(number: int, frame: FrameType | None) -> None:
        if within:
            answer(number, frame)
        else:
            waiting.append(frame)

    def call(function: Callable[..., None], *arguments: object) -> None:
        nonlocal within
        within = True
        try:
            if waiting:
                answer(signal.SIGINT, waiting.pop())
            function(*arguments)
        finally:
            within = False

    signal.signal(signal.SIGINT, arrive)
    try:
        yield call
    finally:
        signal.signal(signal.SIGINT, answer)
        if waiting:
            answer(signal.SIGINT, waiting[0])


@contextlib.contextmanager
def raising() -> Iterator[None]:
    """The first signal raises `KeyboardInterrupt`, which ends the process after this context.

    For libraries that must close what they have opened.
    """
    _State.raises += 1
    try:
        yield
    except KeyboardInterrupt:
        if _State.arrived is not None:
            _end(_State.arrived)
        raise
    finally:
        _State.raises -= 1


def _answer(number: int, frame: FrameType | None = None) -> None:
    again = _State.arrived is not None and frame is not None
    _State.arrived = number
    if _State.postponed:
        return
    if _State.raises and not again:
        raise KeyboardInterrupt
    _end(number)


def _end(number: int) -> None:
    text = f"{Line.before}newmark-study: {NAMES[signal.Signals(number)]}{Line.after()}\n"
    with contextlib.suppress(Exception):  # it may be closed, or just being written to
        sys.stdout.flush()
    with contextlib.suppress(OSError):
        os.write(2, text.encode())
    os._exit(128 + number)
