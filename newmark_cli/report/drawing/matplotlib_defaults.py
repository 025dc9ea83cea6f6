"""Imports matplotlib without the user's settings; to be imported before it.

matplotlib reads a ``matplotlibrc`` of the current folder, or of the user's, as it is
imported: one that cannot be read would end the command, and a pipe of that name would
keep it for ever.  ``MPLBACKEND`` may name what is not installed.  No figure here depends
on either: see `newmark_cli.report.drawing.style`.
"""

import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_VARIABLES = ("MATPLOTLIBRC", "MPLBACKEND")


@contextmanager
def _without_settings() -> Iterator[None]:
    """The first ``matplotlibrc`` that is found is matplotlib's own."""
    spec = importlib.util.find_spec("matplotlib")
    before = {name: os.environ.pop(name) for name in _VARIABLES if name in os.environ}
    folder: int | str | None = None
    try:
        with suppress(OSError):  # by its name where folders cannot be opened
            folder = os.getcwd() if os.name == "nt" else os.open(".", os.O_RDONLY)
        if spec is not None and spec.origin is not None:
            with suppress(OSError):
                os.chdir(Path(spec.origin).parent / "mpl-data")
        yield
    finally:
        os.environ.update(before)
        if folder is not None:
            with suppress(OSError):
                os.chdir(folder)
        if isinstance(folder, int):
            os.close(folder)


if "matplotlib" not in sys.modules:
    with _without_settings():
        importlib.import_module("matplotlib")
