"""Numba's compiled code on disk, and machine code beside it.

Numba's own cache keeps it in ``__pycache__`` or in a folder of the user's.  Where nothing can
be kept, as on a full disk, code is compiled in every process, with a warning.
"""

import contextlib
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, NullCache

from newmark_cli.support import compiling

#: Folders that were warned of.
_warned: set[str] = set()


class _Cache(FunctionCache):
    """The cache of one function, on a disk that may be full."""

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Compiled code that is kept; None where it is to be compiled now."""
        code = super().load_overload(signature, context)
        if code is None:
            compiling.begins()
        return code

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep compiled code; where it cannot be kept, say so once."""
        try:
            super().save_overload(signature, data)
        except OSError as error:
            _warn(self._cache_path, f"{self._cache_path}: {error.strerror}")


def cached_njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` with ``cache=True``, which goes on where nothing can be kept."""

    def decorated(function: Any) -> Any:
        dispatcher = njit(**options)(function)
        if hasattr(dispatcher, "enable_caching"):  # NUMBA_DISABLE_JIT leaves Python
            dispatcher._cache = _cache_of(function)
        return dispatcher

    return decorated


def part_njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` of what becomes a part of compiled callers, and is kept with them.

    It has no entries for Python and C, which would take about as long to compile.
    """
    without: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    decorator: Callable[[Any], Any] = njit(**options, **without)
    return decorator


def _cache_of(function: Any) -> Any:
    try:
        return _Cache(function)
    except RuntimeError:  # no locator
        _warn("", "no folder can be written; set NUMBA_CACHE_DIR to one")
        return NullCache()


def kept_bytes(function: Any, name: str, make: Callable[[], bytes]) -> bytes:
    """Bytes beside a function's compiled code, in a file whose name says all; made if not there."""
    path = _place(function, name)
    if path is None:
        return make()
    with contextlib.suppress(OSError):
        return path.read_bytes()
    compiling.begins()
    content = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(file.name, path)
    except OSError as error:
        _warn(str(path.parent), f"{path.parent}: {error.strerror}")
    return content


def are_kept(function: Any, name: str) -> bool:
    """Whether `kept_bytes` has a file."""
    path = _place(function, name)
    return path is not None and path.exists()


def _place(function: Any, name: str) -> Path | None:
    """Path of a file beside a function's compiled code; None if nothing can be kept."""
    try:
        return Path(FunctionCache(function).cache_path) / f"{name}.o"
    except RuntimeError:  # no locator
        return None


def bitcode(function: Any, signature: tuple[Any, ...]) -> tuple[str, bytes]:
    """A compiled function as LLVM's bitcode, to be linked into other code.

    Args:
        function: What `cached_njit` returned.
        signature: Numba types of its arguments.

    Returns:
        Its name in the code, and the code.
    """
    function.compile(signature)
    compiled = function.overloads[signature]
    # What numba links a callee from; of what was read from disk it shows no text.
    return compiled.fndesc.llvm_func_name, compiled.library._get_module_for_linking().as_bitcode()


def _warn(folder: str, why: str) -> None:
    if folder not in _warned:
        _warned.add(folder)
        warnings.warn(f"compiled code cannot be kept: {why}", stacklevel=2)
