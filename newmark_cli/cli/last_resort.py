"""Unexpected errors: one line, a traceback in a file, an exit code of their own.

Nothing here may fail: whatever goes wrong on the way is left out.
"""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from newmark_cli import __version__
from newmark_cli.errors import one_line

if TYPE_CHECKING:
    from pathlib import Path

#: Exit code of an error of the program itself, as in sysexits.h; 1 means a failed check.
CODE = 70

#: Set to anything but 0, tracebacks and warnings are printed as Python prints them.
_DEBUG = "NEWMARK_STUDY_DEBUG"
#: Tracebacks that stay in the user's folder.
_MOST_KEPT = 20
_NAME = "traceback-"
_LONGEST = 300


def told(error: BaseException) -> int:
    """Tell of an error in one line, keep its traceback, and return the exit code."""
    text = _safely(lambda: _text(error), "no traceback: there is no memory for it\n")
    if debugging():
        _safely(lambda: print(text, file=sys.stderr, end="", flush=True), None)
    _print(f"internal error: {_named(error)}; {_where(text)}")
    return CODE


def debugging() -> bool:
    """Whether tracebacks are to be printed."""
    return os.environ.get(_DEBUG, "0") not in ("", "0")


@contextlib.contextmanager
def watching() -> Iterator[None]:
    """Make single lines of what Python and libraries print of their own.

    Warnings, each once, log messages that nobody listens to, errors of threads, and those that
    Python cannot raise, as in finalizers.  Behind the end of a command they are nobody's loss.
    """
    if debugging():
        yield
        return
    import logging
    import threading
    import warnings

    class Line(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            message = _safely(record.getMessage, record.msg)
            warned(f"{record.name.partition('.')[0]}: {message}")

    over = False
    told: set[str] = set()
    shown, last, died = warnings.showwarning, logging.lastResort, threading.excepthook
    ignored: Any = sys.unraisablehook

    def warned(message: object, *rest: Any, **more: Any) -> None:
        text = one_line(_safely(lambda: str(message), type(message).__name__))
        if not over and text not in told:
            told.add(text)
            _print(f"warning: {text[:_LONGEST]}")

    def lost(what: Any) -> None:
        if what.exc_type and issubclass(what.exc_type, KeyboardInterrupt):
            ignored(what)
        elif not over:
            _print(f"warning: {_lost(what)}")

    def thread_lost(what: Any) -> None:
        if not over and not issubclass(what.exc_type, SystemExit):
            _print(f"warning: {_lost(what)}")

    warnings.showwarning = warned
    logging.lastResort = Line(logging.WARNING)
    threading.excepthook = thread_lost
    sys.unraisablehook = lost
    try:
        yield
    finally:
        over = True
        warnings.showwarning, logging.lastResort = shown, last
        threading.excepthook = died
        sys.unraisablehook = ignored


def silence() -> None:
    """The process ends: what finalizers and threads still say is nobody's loss."""
    if not debugging():
        import threading

        threading.excepthook = lambda lost: None
        sys.unraisablehook = lambda lost: None


def _where(text: str) -> str:
    kept = _safely(lambda: _keep(text), None)
    if kept is None:
        return f"please report this; the traceback could not be kept, {_DEBUG}=1 prints it"
    return f"please report this, with the traceback in {kept}"


def _named(error: BaseException) -> str:
    name = type(error).__name__
    text: str = _safely(lambda: one_line(f"{name}: {error}".rstrip(": ")), name)
    return text[:_LONGEST]


def _text(error: BaseException) -> str:
    import traceback
    from datetime import datetime

    when = datetime.now().astimezone().isoformat(timespec="seconds")
    return (
        f"newmark-study {__version__}, Python {sys.version.split()[0]} on {sys.platform}, {when}\n"
        f"{sys.argv[1:]!r}\n\n" + "".join(traceback.format_exception(error))
    )


def _keep(text: str) -> "Path | None":
    """Keep a traceback in a file that only the user can read; None where none can be made."""
    import tempfile
    from pathlib import Path

    for folder in map(Path, _folders()):
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            # A new file, of mode 0600, whose name nobody can have guessed.
            descriptor, name = tempfile.mkstemp(".txt", _NAME, folder)
            with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
        except OSError:
            continue
        if folder.name == "newmark-study":
            _thin(folder)
        return Path(name)
    return None


def _folders() -> Iterator[str]:
    """Where a traceback may be kept: with the user's states, else with temporary files."""
    import tempfile

    state = os.environ.get("XDG_STATE_HOME", "")
    if not os.path.isabs(state):
        state = os.path.expanduser("~/.local/state")
    if os.path.isabs(state):  # the user has a home
        yield f"{state}/newmark-study"
    with contextlib.suppress(OSError):
        yield tempfile.gettempdir()


def _thin(folder: "Path") -> None:
    """Remove the oldest tracebacks where something fails again and again."""
    with contextlib.suppress(OSError):
        found = sorted(folder.glob(f"{_NAME}*.txt"), key=lambda file: file.stat().st_mtime)
        for file in found[:-_MOST_KEPT]:
            file.unlink()


def _lost(lost: Any) -> str:
    error = lost.exc_value or lost.exc_type()
    text = _safely(lambda: _text(error), "")
    return f"internal error: {_named(error)}; {_where(text)}"


def _safely(value: Any, otherwise: Any) -> Any:
    try:
        return value()
    except Exception:  # no memory, or a text that cannot be made
        return otherwise


def _print(line: str) -> None:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        print(f"newmark-study: {line}", file=sys.stderr, flush=True)
