"""Python files of the user's, with the modules beside them that they import.

What runs is what the files say now: a library's caller may have imported such a module before
it was edited, and numba's machine code on disk goes by the time of one file.
"""

import importlib
import os
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from newmark_cli.support import apart, errors
from newmark_cli.support.errors import one_line

#: One file's imports at a time: another's modules may have the same names.
_importing = threading.RLock()
#: Folders of Python and of installed packages.
_INSTALLED = tuple({sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")})
#: File of the user's, as tracebacks name it → as errors show it.
_shown: dict[str, str] = {}
#: Most characters of an error that `described` returns.
_LONGEST = 300


def run(path: Path, source: bytes, name: str, shown: str = "") -> ModuleType:
    """A module from the source of a file; raises whatever its code raises.

    No other module has its name; ``shown`` is the path in errors, when it is another.
    """
    _shown[str(path)] = shown or str(path)
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses look their module up
    exec(compile(source, path, "exec"), module.__dict__)
    return module


def described(error: BaseException, otherwise: str = "") -> str:
    """An error in one line that begins with the line of the user's code it comes from.

    The innermost: ``mine.py, line 12: ZeroDivisionError: division by zero``.  ``otherwise`` begins
    the text where no line is known, as for a division by zero in compiled code.
    """
    where = f"{otherwise}: " if otherwise else ""
    frame = error.__traceback__
    while frame is not None:
        file = _shown.get(frame.tb_frame.f_code.co_filename)
        if file is not None:
            where = f"{file}, line {frame.tb_lineno}: "
        frame = frame.tb_next
    text = one_line(where + errors.described(error))
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def is_interrupt(error: BaseException) -> bool:
    """Whether the user wants an end, and not the code: signals go where no such code runs."""
    return isinstance(error, KeyboardInterrupt) and not apart.inside()


@contextmanager
def imports_from(folder: Path, shown: str = "") -> Iterator[Callable[[], dict[str, bytes]]]:
    """Modules of a folder can be imported in this context, after Python's and installed ones.

    Who has imported one keeps it; after the context the name stands for what it did before.
    Yields what returns path, relative to the folder, → source of each that was imported.
    """
    folder = folder.absolute()

    def imported() -> dict[str, bytes]:
        files = {module.__file__ for module in _modules_of(folder).values()}
        return {
            Path(os.path.relpath(file, folder)).as_posix(): Path(file).read_bytes()
            for file in sorted(filter(None, files))
        }

    with _importing, _no_cache(folder):
        before, path, keeps = _modules_of(folder), sys.path[:], sys.dont_write_bytecode
        for name in before:
            del sys.modules[name]
        own = [entry for entry in path if entry.startswith(_INSTALLED)]
        sys.path[:] = [*own, str(folder), *(entry for entry in path if entry not in own)]
        sys.dont_write_bytecode = True
        importlib.invalidate_caches()
        try:
            yield imported
        finally:
            sys.path[:], sys.dont_write_bytecode = path, keeps
            for name, module in _modules_of(folder).items():
                if module.__file__:
                    relative = os.path.relpath(module.__file__, folder)
                    _shown[module.__file__] = os.path.join(shown, relative)
                del sys.modules[name]
            sys.modules.update(before)


def _modules_of(folder: Path) -> dict[str, ModuleType]:
    """Modules that were imported from a folder and are not installed."""
    found, package = {}, __name__.partition(".")[0]
    for name, module in [*sys.modules.items()]:
        said = getattr(module, "__dict__", {})  # a lazy module would import what it is asked for
        if not said.get("__spec__") or name.partition(".")[0] == package:  # `run` was not an import
            continue
        places = [said["__file__"]] if said.get("__file__") else [*(said.get("__path__") or ())]
        if any(_is_in(place, folder) for place in places):
            found[name] = module
    return found


def _is_in(file: str, folder: Path) -> bool:
    return file.startswith(f"{folder}{os.sep}") and not file.startswith(_INSTALLED)


@contextmanager
def _no_cache(folder: Path) -> Iterator[None]:
    """No machine code of a folder's functions is kept.

    Numba's ``cache=True`` would bring back code of a module that has changed since.
    """
    owner: Any = importlib.import_module("numba.core.dispatcher").Dispatcher
    enable = owner.enable_caching

    def enable_elsewhere(dispatcher: Any) -> None:
        if not _is_in(os.path.abspath(dispatcher.py_func.__code__.co_filename), folder):
            enable(dispatcher)

    owner.enable_caching = enable_elsewhere
    try:
        yield
    finally:
        owner.enable_caching = enable
