"""Numba's compiled code on disk, where damage is noticed.

Numba unpickles what it finds in its cache, and runs the machine code in it: a file that
was cut off ends a command, and a flipped bit changes results.  Here every file carries a
digest of what it holds.  What is damaged is compiled again and replaced, as is what another
user has put into a folder that several may write to; where nothing can be kept, code is
compiled in every process.
"""

import contextlib
import hashlib
import os
import pickle
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache

_DIGEST = hashlib.sha256().digest_size
#: Users whose files are taken: they may change this program, or run as anybody.
_TRUSTED = {0, os.stat(__file__).st_uid, getattr(os, "geteuid", int)()}
#: Folders that were warned of.
_warned: set[str] = set()


def cached_njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` with ``cache=True``, but for the above.

    Args:
        options: Those of `numba.njit`.
    """

    def decorated(function: Any) -> Any:
        dispatcher = njit(**options)(function)
        if hasattr(dispatcher, "enable_caching"):  # NUMBA_DISABLE_JIT leaves Python
            dispatcher._cache = _cache_of(function)
        return dispatcher

    return decorated


def kept_bytes(function: Any, name: str, make: Callable[[], bytes]) -> bytes:
    """Bytes that stand in the folder of a function's compiled code; made where they do not.

    Args:
        function: Whose folder it is.
        name: File, by itself enough to tell what it holds.
        make: Makes them.
    """
    path = _place(function, name)
    if path is None:
        return make()
    with contextlib.suppress(OSError), contextlib.suppress(_Damaged):
        return _opened(path)
    made = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(_sealed(made))
        os.replace(file.name, path)
    except OSError as error:
        _warn(str(path.parent), f"{path.parent}: {error.strerror}")
    return made


def are_kept(function: Any, name: str) -> bool:
    """Whether `kept_bytes` has a file."""
    path = _place(function, name)
    return path is not None and path.exists()


def _place(function: Any, name: str) -> Path | None:
    """Where a file stands beside a function's compiled code; None where nothing can."""
    try:
        return Path(_Cache(function).cache_path) / name
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
    found = function.overloads[signature]
    # What numba links a callee from; of what was read from disk it shows no text.
    return found.fndesc.llvm_func_name, found.library._get_module_for_linking().as_bitcode()


class _Damaged(Exception):
    """A file does not hold what was written, or somebody else has written it."""


def _sealed(data: bytes) -> bytes:
    """The data behind their digest."""
    return hashlib.sha256(data).digest() + data


def _opened(path: Path) -> bytes:
    """Content that was sealed in a file; raises _Damaged if it is something else."""
    with path.open("rb") as file:
        owner, content = os.fstat(file.fileno()).st_uid, file.read()
    digest, data = content[:_DIGEST], content[_DIGEST:]
    if owner not in _TRUSTED or hashlib.sha256(data).digest() != digest:
        raise _Damaged(str(path))
    return data


class _Files(IndexDataCacheFile):
    """The files of one function."""

    def load(self, key: Any) -> Any:
        """The cached code; None if there is none, or if it is damaged."""
        try:
            return super().load(key)
        except OSError:
            return None
        except Exception:  # a pickle of another class can raise anything
            self.discard()
            return None

    def save(self, key: Any, data: Any) -> None:
        """Keep, in place of what is damaged."""
        try:
            super().save(key, data)
        except (_Damaged, OSError):
            self.discard()
            super().save(key, data)

    def discard(self) -> None:
        """Forget everything: the next to save begins anew."""
        with contextlib.suppress(OSError):
            os.unlink(self._index_path)

    def _load_index(self) -> Any:
        with contextlib.suppress(FileNotFoundError):
            version, stamp, overloads = self._checked(self._index_path)
            if (version, stamp) == (self._version, self._source_stamp):
                return overloads
        return {}

    def _save_index(self, overloads: Any) -> None:
        with self._open_for_write(self._index_path) as file:
            file.write(self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        return self._checked(self._data_path(name))

    def _dump(self, value: Any) -> bytes:
        return _sealed(super()._dump(value))

    def _checked(self, path: str) -> Any:
        return pickle.loads(_opened(Path(path)))


class _Cache(FunctionCache):
    """The cache of one function."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file: Any = _Files(
            cache_path=self._cache_path,
            # Numba itself could not read these files.
            filename_base=f"{self._impl.filename_base}.checked",
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def _load_overload(self, signature: Any, context: Any) -> Any:
        try:
            return super()._load_overload(signature, context)
        except (MemoryError, OSError):
            raise
        except Exception:  # from another version of what numba builds on
            self._cache_file.discard()
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep compiled code; where it cannot be kept, say so once."""
        try:
            super().save_overload(signature, data)
        except OSError as error:
            _warn(self._cache_path, f"{self._cache_path}: {error.strerror}")


def _cache_of(function: Any) -> Any:
    try:
        return _Cache(function)
    except RuntimeError:  # no locator
        _warn("", "no folder can be written; set NUMBA_CACHE_DIR to one")
        return NullCache()


def _warn(folder: str, why: str) -> None:
    if folder not in _warned:
        _warned.add(folder)
        warnings.warn(f"compiled code cannot be kept: {why}", stacklevel=2)
