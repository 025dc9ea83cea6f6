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


class _State:
    postponed = 0
    raises = 0
    arrived: int | None = None
    note: Callable[[], str] = str
    before_end: list[Callable[[], object]] = []  # there is one state


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


def note(text: Callable[[], str]) -> None:
    """Add to the line of an interrupt what the function returns then."""
    _State.note = text


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


class Waiting:
    """Ctrl-C that waits, except in functions that are called here."""

    def __init__(self, answer: Callable[[int, FrameType | None], object] = lambda *_: None) -> None:
        self._answer, self._within = answer, False
        self._arrived: list[FrameType | None] = []

    def arrive(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal: now or later."""
        if self._within:
            self._within = False
            self._answer(number, frame)
        else:
            self._arrived.append(frame)

    def answer(self) -> None:
        """Answer what has arrived."""
        if self._arrived:
            frame = self._arrived[0]
            self._arrived.clear()
            self._answer(signal.SIGINT, frame)

    def call(self, function: Callable[..., None], *arguments: object) -> None:
        """Call a function in which Ctrl-C does not wait."""
        self.answer()
        self._within = True
        try:
            function(*arguments)
        finally:
            self._within = False


@contextlib.contextmanager
def deferred() -> Iterator[Waiting]:
    """Ctrl-C waits until the end of this context, whoever answers it; only in the main thread."""
    answer = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(answer):
        yield Waiting()
        return
    waiting = Waiting(answer)
    signal.signal(signal.SIGINT, waiting.arrive)
    try:
        yield waiting
    finally:
        signal.signal(signal.SIGINT, answer)
        waiting.answer()


@contextlib.contextmanager
def before_end(action: Callable[[], object]) -> Iterator[None]:
    """Call a function before a signal ends the process in this context."""
    _State.before_end.append(action)
    try:
        yield
    finally:
        _State.before_end.remove(action)


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
    for action in _State.before_end:
        with contextlib.suppress(Exception):
            action()
    text = f"newmark-study: {NAMES[signal.Signals(number)]}{_State.note()}\n"
    with contextlib.suppress(Exception):  # it may be closed, or just being written to
        sys.stdout.flush()
    with contextlib.suppress(OSError):
        os.write(2, text.encode())
    os._exit(128 + number)
