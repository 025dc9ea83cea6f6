"""Python files of the user's, with the modules beside them that they import.

What runs is what the files say now.  Python's own import would take bytecode, which
goes by file times, and would hand the modules of one problem to another whose own
have the same names.
"""

import ast
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import (
    SOURCE_SUFFIXES,
    FileFinder,
    ModuleSpec,
    PathFinder,
    SourceFileLoader,
)
from pathlib import Path
from types import CodeType, ModuleType

#: One file's imports at a time: another's modules may have the same names.
_importing = threading.RLock()


def run(path: Path, source: bytes, name: str) -> ModuleType:
    """A module from the source of a file; raises whatever its code raises.

    Args:
        path: The file.
        source: What it says.
        name: Name of the module, which no other has.
    """
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses look their module up
    exec(compile(source, path, "exec"), module.__dict__)
    return module


class _AsWritten(SourceFileLoader):
    """Takes the source alone, and leaves no bytecode in the user's folder."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code


class _Beside:
    """Finds the modules of a folder, for `sys.meta_path`.

    Attributes:
        found: Names of those that were asked for.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self.found: set[str] = set()

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        parent = name.rpartition(".")[0]
        if parent and parent not in self.found:
            return None
        for folder in path or [self._folder]:
            spec = FileFinder(folder, (_AsWritten, SOURCE_SUFFIXES)).find_spec(name)
            if spec is None:
                continue
            # A mere folder gives way to a module of the same name, wherever that is.
            if spec.loader is None and PathFinder.find_spec(name, path) is not None:
                continue
            self.found.add(name)
            return spec
        return None


@contextmanager
def imports_from(folder: Path) -> Iterator[None]:
    """Modules of a folder can be imported, before those of the path, in this context.

    Who has imported one keeps it; after the context the name is free again.
    """
    with _importing:
        beside = _Beside(folder.resolve())
        sys.meta_path.insert(0, beside)
        try:
            yield
        finally:
            sys.meta_path.remove(beside)
            for name in beside.found:
                sys.modules.pop(name, None)


def imported_from_beside(path: Path, source: bytes) -> Sequence[Path]:
    """Files in a file's folder whose modules it imports, and those that they import."""
    found, left = dict.fromkeys([path]), [source]
    while left:
        try:
            tree = ast.parse(left.pop())
        except (SyntaxError, ValueError):  # none that is imported, or loading had failed
            continue
        for node in ast.walk(tree):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module]
            for name in names:
                root = path.parent / name.partition(".")[0]
                for file in (root.with_suffix(".py"), *sorted(root.rglob("*.py"))):
                    if file not in found and file.is_file():
                        found[file] = None
                        left.append(file.read_bytes())
    return sorted(found.keys() - {path})
