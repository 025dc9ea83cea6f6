"""Unexpected errors: one line, a traceback in a file, and an exit code of their own."""

import contextlib
import logging
import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from datetime import datetime
from typing import Any

from newmark_cli import __version__
from newmark_cli.support.errors import described, one_line

#: Exit code of an error of the program itself, as in sysexits.h; 1 means a failed check.
CODE = 70

#: Set to anything but 0, tracebacks and warnings are printed as Python prints them.
_DEBUG = "NEWMARK_STUDY_DEBUG"
_LONGEST = 300


def report(error: BaseException) -> int:
    """Report an error in one line, keep its traceback, and return the exit code."""
    when = datetime.now().astimezone().isoformat(timespec="seconds")
    text = (
        f"newmark-study {__version__}, Python {sys.version.split()[0]} on {sys.platform}, {when}\n"
        f"{sys.argv[1:]!r}\n\n" + "".join(traceback.format_exception(error))
    )
    if debugging():
        _print(text)
    line = f"internal error: {described(error)[:_LONGEST]}; please report this"
    try:
        # A new file that only the user can read.
        descriptor, name = tempfile.mkstemp(".txt", "newmark-study-traceback-")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
        _print(f"newmark-study: {line}, with the traceback in {name}")
    except OSError:
        _print(f"newmark-study: {line}; the traceback could not be kept, {_DEBUG}=1 prints it")
    return CODE


def debugging() -> bool:
    """Whether tracebacks are to be printed."""
    return os.environ.get(_DEBUG, "0") not in ("", "0")


@contextlib.contextmanager
def watching() -> Iterator[None]:
    """Print warnings, each once, and log messages that nobody handles, as single lines."""
    if debugging():
        yield
        return

    class Line(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            warned(f"{record.name.partition('.')[0]}: {record.getMessage()}")

    seen: set[str] = set()
    shown, last = warnings.showwarning, logging.lastResort

    def warned(message: object, *rest: Any, **more: Any) -> None:
        text = one_line(str(message))[:_LONGEST]
        if text not in seen:
            seen.add(text)
            _print(f"newmark-study: warning: {text}")

    warnings.showwarning = warned
    logging.lastResort = Line(logging.WARNING)
    try:
        yield
    finally:
        warnings.showwarning, logging.lastResort = shown, last


def _print(text: str) -> None:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        print(text, file=sys.stderr, flush=True)
