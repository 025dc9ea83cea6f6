"""Compiled code on disk: numba's, and machine code beside it.

It is kept where numba keeps it, in ``__pycache__`` or in a folder of the user's.  Numba would
unpickle and run whatever it finds there, and notices changes of a function's own file only.
So each file here begins with a digest of its content and of the sources that it was made from:
what is damaged or out of date is compiled again and replaced.  Where nothing can be kept, as on a
full disk, code is compiled in every process, with a warning.
"""

import contextlib
import hashlib
import inspect
import pickle
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core.caching import FunctionCache

from newmark_cli.support import compiling, files, sources
from newmark_cli.support.errors import ResultsError

#: Bytes of a digest.
_DIGEST = hashlib.sha256().digest_size

#: Seconds to wait for another process that compiles the same function.
_PATIENCE = 60

#: Folders that were warned of.
_warned: set[str] = set()


class _Cache(FunctionCache):
    """The cache of one function, a file for each signature and processor; a disk may be full."""

    def __init__(self, function: Any, options: Any) -> None:
        super().__init__(function)
        source = self._impl.locator.get_source_stamp()  # of a file that may change meanwhile
        core = sources.stamp(Path(inspect.getfile(function)))
        self._made_from = f"{numba.__version__} {source!r} {core} {sorted(options.items())}"
        # Numba's name has the number of a line, so that files of older versions would pile up.
        name = re.sub(r"-\d+(?=\.py)", "", self._impl.filename_base)
        self._stem = str(Path(self.cache_path) / name)
        self._cache_file: Any = self
        self._compiles = contextlib.ExitStack()  #: Holds what keeps others from compiling it.

    def load(self, key: tuple[Any, ...]) -> Any:
        """What `save` was given; None if there is none, or it is damaged or out of date.

        The caller then compiles it, and other processes wait for what it saves.
        """
        content = _read(*self._file(key))
        if content is None:
            compiling.begins()
            self._compiles.close()
            self._compiles.enter_context(_alone(self._file(key)[0]))
            content = _read(*self._file(key))
        if content is None:
            return None
        self._compiles.close()
        return pickle.loads(content)

    def save(self, key: tuple[Any, ...], data: Any) -> None:
        """Keep data; ResultsError if they cannot be written."""
        _write(*self._file(key), pickle.dumps(data))

    def _file(self, key: tuple[Any, ...]) -> tuple[Path, str]:
        """Path of a file, and what it is made from.

        A key is a signature, the processor, and digests of the function.
        """
        short = hashlib.sha256(repr(key[:2]).encode()).hexdigest()[:16]
        return Path(f"{self._stem}-{short}.nbc"), f"{self._made_from} {key}"

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep compiled code; where it cannot be kept, say so once."""
        with self._compiles, _or_warning(self._cache_path):
            super().save_overload(signature, data)


def cached_njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` with ``cache=True``, which goes on where nothing can be kept."""

    def decorated(function: Any) -> Any:
        dispatcher = njit(**options)(function)
        if hasattr(dispatcher, "enable_caching"):  # NUMBA_DISABLE_JIT leaves Python
            try:
                dispatcher._cache = _Cache(function, options)
            except RuntimeError:  # no locator; the dispatcher's own cache keeps nothing
                _warn("", "no folder can be written; set NUMBA_CACHE_DIR to one")
        return dispatcher

    return decorated


def part_njit(**options: Any) -> Callable[[Any], Any]:
    """`numba.njit` of what becomes a part of compiled callers, and is kept with them.

    It has no entries for Python and C, which would take about as long to compile.
    """
    without: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    decorator: Callable[[Any], Any] = njit(**options, **without)
    return decorator


def kept_bytes(
    function: Any, name: str, make: Callable[[], bytes] | None, made_from: str = ""
) -> bytes | None:
    """Bytes beside a function's compiled code; None if they are not there and not to be made.

    Args:
        name: Of the file, without its suffix.
        make: Makes them where they are not there; None to leave that.
        made_from: What else the bytes depend on; a file of something else is replaced.
    """
    try:
        path = Path(FunctionCache(function).cache_path) / f"{name}.o"
    except RuntimeError:  # no locator
        return make and make()
    content = _read(path, made_from)
    if content is None and make is not None:
        compiling.begins()
        content = make()
        with _or_warning(str(path.parent)):
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, made_from, content)
    return content


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Wait while another process makes a file; not for long, as it may have stopped."""
    import portalocker  # only what compiles waits for its import

    lock = path.with_suffix(".lock")
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError, portalocker.LockException):
            lock.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(portalocker.Lock(lock, timeout=_PATIENCE))
        yield
        lock.unlink(missing_ok=True)


def _read(path: Path, made_from: str) -> bytes | None:
    """What `_write` was given; None if there is none, or it is damaged or out of date."""
    try:
        whole = files.read(path)
    except OSError:
        return None
    content = whole[_DIGEST:]
    return content if whole[:_DIGEST] == _digest(path, made_from, content) else None


def _write(path: Path, made_from: str, content: bytes) -> None:
    files.write(path, _digest(path, made_from, content) + content)


def _digest(path: Path, made_from: str, content: bytes) -> bytes:
    return hashlib.sha256(f"{path.name} {made_from} ".encode() + content).digest()


@contextlib.contextmanager
def _or_warning(folder: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ResultsError) as error:
        _warn(folder, f"{folder}: {error.strerror}" if isinstance(error, OSError) else str(error))


def _warn(folder: str, why: str) -> None:
    if folder not in _warned:
        _warned.add(folder)
        warnings.warn(f"compiled code cannot be kept: {why}", stacklevel=2)
