"""Python files of the user's, with the modules beside them that they import.

What runs is what the files say now.  Python's own import would take bytecode, and
numba machine code, which both go by file times; and Python would hand the modules of
one problem to another whose own have the same names.
"""

import importlib
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.machinery import (
    SOURCE_SUFFIXES,
    FileFinder,
    ModuleSpec,
    PathFinder,
    SourceFileLoader,
)
from pathlib import Path, PurePath
from types import CodeType, ModuleType
from typing import Any

from newmark_cli.support import apart, errors
from newmark_cli.support.errors import one_line

#: One file's imports at a time: another's modules may have the same names.
_importing = threading.RLock()
#: Folders of installed packages.
_INSTALLED = frozenset(("site-packages", "dist-packages"))
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


class _AsWritten(SourceFileLoader):
    """Takes only the source, and leaves no bytecode in the user's folder."""

    def __init__(self, name: str, path: str, note: Callable[[str, bytes], None]) -> None:
        super().__init__(name, path)
        self._note = note

    def get_code(self, fullname: str) -> CodeType:
        source = self.get_data(self.path)
        self._note(self.path, source)
        code: CodeType = self.source_to_code(source, self.path)
        return code


class _Beside:
    """Finds the modules of a folder, for `sys.meta_path`.

    Attributes:
        imported: Names of those that were imported.
        sources: Path, relative to the folder, → what was run, of each.
    """

    def __init__(self, folder: Path, shown: PurePath) -> None:
        self._folder, self._shown = str(folder), shown
        self.imported: set[str] = set()
        self.sources: dict[str, bytes] = {}

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        parent = name.rpartition(".")[0]
        foreign = parent not in self.imported if parent else _is_another(name)
        if foreign:
            return None
        for folder in path or [self._folder]:
            loader = partial(_AsWritten, note=self._note)
            finder = FileFinder(folder, (loader, SOURCE_SUFFIXES))  # type: ignore[arg-type]
            spec = finder.find_spec(name)
            if spec is None:
                continue
            # A mere folder gives way to a module of the same name, wherever that is.
            if spec.loader is None and _is_module(PathFinder.find_spec(name, path)):
                continue
            self.imported.add(name)
            return spec
        return None

    def _note(self, path: str, source: bytes) -> None:
        relative = Path(os.path.relpath(path, self._folder)).as_posix()
        self.sources[relative] = source
        _shown[path] = str(self._shown / relative)


def _is_another(name: str) -> bool:
    """Python's own modules and installed ones go first: others rely on them."""
    if name in sys.stdlib_module_names or name == __name__.partition(".")[0]:
        return True
    installed = [path for path in sys.path if _INSTALLED.intersection(Path(path).parts)]
    return _is_module(PathFinder.find_spec(name, installed))


def _is_module(spec: ModuleSpec | None) -> bool:
    return spec is not None and spec.loader is not None


@contextmanager
def imports_from(folder: Path, shown: str = "") -> Iterator[Mapping[str, bytes]]:
    """Modules of a folder can be imported in this context.

    Who has imported one keeps it; after the context the name stands for what it did before.
    Yields path, relative to the folder, → source of each that was imported until then.
    """
    folder = folder.absolute()
    beside = _Beside(folder, PurePath(shown))
    with _importing, _no_cache(folder):
        # A notebook may have imported what a module said before it was edited.
        before = {name: sys.modules.pop(name) for name in _named_like_those_of(folder)}
        sys.meta_path.insert(0, beside)
        try:
            yield beside.sources
        finally:
            sys.meta_path.remove(beside)
            for name in beside.imported:
                sys.modules.pop(name, None)
            sys.modules.update(before)


def _named_like_those_of(folder: Path) -> list[str]:
    """Modules that were imported, and whose names are those of modules of a folder."""
    try:
        tops = {entry.removesuffix(".py") for entry in os.listdir(folder)} - {"__main__"}
    except OSError:  # what is asked of it says so
        return []
    tops = {name for name in tops if name in sys.modules and not _is_another(name)}
    return [name for name in sys.modules if name.partition(".")[0] in tops]


@contextmanager
def _no_cache(folder: Path) -> Iterator[None]:
    """No machine code of a folder's functions is kept.

    Numba's ``cache=True`` would bring back code of a module that has changed since.
    """
    owner: Any = importlib.import_module("numba.core.dispatcher").Dispatcher
    enable = owner.enable_caching

    def enable_elsewhere(dispatcher: Any) -> None:
        file = Path(dispatcher.py_func.__code__.co_filename).absolute()
        if not file.is_relative_to(folder) or _INSTALLED.intersection(file.parts):
            enable(dispatcher)

    owner.enable_caching = enable_elsewhere
    try:
        yield
    finally:
        owner.enable_caching = enable
