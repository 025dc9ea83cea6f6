"""Python files of the user's, with the modules beside them that they import.

What runs is what the files say now: a library's caller may have imported such a module before
it was edited, and numba's machine code on disk goes by the time of one file.
"""

import importlib
import os
import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from newmark_cli.support import apart, errors
from newmark_cli.support.errors import InputError, one_line

#: One file's imports at a time: another's modules may have the same names.
_importing = threading.RLock()
#: Folders of Python, of installed packages, and of this one.
_INSTALLED = (
    *{sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")},
    str(Path(__file__).parents[1]),
)
#: Folder of the user's code → as errors show it.
_folders: dict[str, str] = {}
#: Most characters of an error that `described` returns.
_LONGEST = 300


def run(path: Path, source: bytes, name: str) -> ModuleType:
    """A module from the source of a file; raises whatever its code raises.

    No other module has its name.
    """
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses look their module up
    exec(compile(source, path.absolute(), "exec"), module.__dict__)
    return module


def made_of(
    path: Path, source: bytes, name: str, make: Callable[[Any], Any], file: str = "", kind: str = ""
) -> Any:
    """What a function makes of a name in a file of this source.

    Errors call the file by its name, or as ``file`` has it, and say what ``kind`` of name it lacks.

    Raises:
        InputError: What went wrong, in a line that begins with that of the user's code.
    """
    file = file or path.name
    try:
        with imports_from(path.parent, os.path.dirname(file)):
            given = getattr(run(path, source, path.stem), name, None)
            if given is None:
                raise InputError(f"{file} has no {kind}{name}")
            return make(given)
    except InputError:
        raise
    except BaseException as error:
        if is_interrupt(error):
            raise
        raise InputError(described(error, file)) from None


def line(file: str, number: int) -> str:
    """A line of a file of the user's, such as ``mine.py, line 12``; empty for one of another's."""
    for folder, shown in _folders.items():
        if _is_in(file, folder):
            return f"{os.path.join(shown, os.path.relpath(file, folder))}, line {number}"
    return ""


def raised_at(error: BaseException) -> list[str]:
    """The line of the user's file that an error comes from, and that of a module beside it."""
    frames = traceback.walk_tb(error.__traceback__)
    places = [(frame.f_code.co_filename, number) for frame, number in frames]
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        places.append((error.filename, error.lineno))
    own = [place for place in places if line(*place)]
    last = dict(own)
    files = dict.fromkeys(file for file, _ in (*own[:1], *own[-1:]))
    return [line(file, last[file]) for file in files]


def described(error: BaseException, otherwise: str = "") -> str:
    """An error in one line that begins with the line of the user's code it comes from.

    The innermost: ``mine.py, line 12: ZeroDivisionError: division by zero``.  ``otherwise`` begins
    the text where no line is known, as for a division by zero in compiled code.
    """
    where = (raised_at(error) or [otherwise])[-1]
    text = one_line((f"{where}: " if where else "") + errors.described(error))
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def is_interrupt(error: BaseException) -> bool:
    """Whether the user wants an end, and not the code: signals go where no such code runs."""
    return isinstance(error, KeyboardInterrupt) and not apart.inside()


@contextmanager
def imports_from(folder: Path, shown: str = "") -> Iterator[Callable[[], dict[str, bytes]]]:
    """Modules of a folder can be imported in this context, after Python's and installed ones.

    Who has imported one keeps it; after the context the name stands for what it did before.
    ``shown`` is the folder in errors.  Numba keeps no machine code: its ``cache=True`` would bring
    back that of a module which has changed since.

    Yields what returns path, relative to the folder, → source of each that was imported.
    """
    folder = folder.absolute()
    _folders[str(folder)] = shown

    def imported() -> dict[str, bytes]:
        files = {module.__file__ for module in _modules_of(folder).values()}
        return {
            Path(os.path.relpath(file, folder)).as_posix(): Path(file).read_bytes()
            for file in sorted(filter(None, files))
        }

    owner: Any = importlib.import_module("numba.core.dispatcher").Dispatcher
    with _importing:
        before, path, keeps = _modules_of(folder), sys.path[:], sys.dont_write_bytecode
        caching = owner.enable_caching
        for name in before:
            del sys.modules[name]
        own = [entry for entry in path if entry.startswith(_INSTALLED)]
        sys.path[:] = [*own, str(folder), *(entry for entry in path if entry not in own)]
        sys.dont_write_bytecode = True
        owner.enable_caching = lambda dispatcher: None
        importlib.invalidate_caches()
        try:
            yield imported
        finally:
            sys.path[:], sys.dont_write_bytecode = path, keeps
            owner.enable_caching = caching
            for name in _modules_of(folder):
                del sys.modules[name]
            sys.modules.update(before)


def _modules_of(folder: Path) -> dict[str, ModuleType]:
    """Modules that were imported from a folder and are not installed."""
    found = {}
    for name, module in [*sys.modules.items()]:
        said = getattr(module, "__dict__", {})  # a lazy module would import what it is asked for
        if not said.get("__spec__"):  # `run` was not an import
            continue
        places = [said["__file__"]] if said.get("__file__") else [*(said.get("__path__") or ())]
        if any(_is_in(place, str(folder)) for place in places):
            found[name] = module
    return found


def _is_in(file: str, folder: str) -> bool:
    return file.startswith(f"{folder}{os.sep}") and not file.startswith(_INSTALLED)
