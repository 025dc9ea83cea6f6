"""Matrices that another code has written: an .npz file, or Matrix Market files in a folder.

Nothing is ever unpickled, and nothing large is read, or unpacked, before its size is known.
"""

import io
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.support import files
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError, one_line

#: Largest file that is read, and most bytes that the matrices of one may take (bytes).
MOST_BYTES = 256 << 20
#: Most rows or columns of a matrix.
MOST_ROWS = 4_000
#: Largest entry: of larger ones products and sums of squares overflow.
_LARGEST = 1e60


class MatrixError(InputError):
    """Matrices cannot be used; the text names the file, the matrix, and what is allowed."""


def read(
    path: Path, names: Collection[str], dimensions: tuple[int, ...] = (0, 1, 2)
) -> dict[str, Array]:
    """Matrices of these names from an .npz file, a folder of .mtx files, or one .mtx file.

    Args:
        path: The file or folder.  A single .mtx file holds the first of the names.
        names: What to look for; anything else there is not looked at.
        dimensions: How many dimensions an array may have.

    Returns:
        Name → matrix, (rows, columns), or vector, (size,): those that are there.

    Raises:
        MatrixError: The file cannot be read, is too large, is neither, or has what is not
            a matrix of finite real numbers.
    """
    suffix = "folder" if path.is_dir() else path.suffix.lower()
    if suffix not in ("folder", ".npz", ".mtx"):
        raise MatrixError(f"{path}: must be an .npz file, an .mtx file or a folder of .mtx files")
    if suffix == ".npz":
        found = {n: (f"{path}: {n}", array) for n, array in _archive(path, names).items()}
        none = f"the file has none of {', '.join(names)}"
    elif suffix == ".mtx":
        found = {next(iter(names)): (str(path), _market(path))}
    else:
        files_of = {name: path / f"{name}.mtx" for name in names}
        found = {n: (str(file), _market(file)) for n, file in files_of.items() if file.exists()}
        none = f"the folder has none of {', '.join(f'{name}.mtx' for name in names)}"
    if not found:
        raise MatrixError(f"{path}: {none}")
    return {name: array_of(array, where, dimensions) for name, (where, array) in found.items()}


def text_of(path: Path, name: str) -> str | None:
    """Text, such as the names of blocks, that an .npz file holds under a name; None if it does not.

    Raises:
        MatrixError: As `read`.
    """
    array = _archive(path, (name,)).get(name) if path.suffix.lower() == ".npz" else None
    if array is None:
        return None
    if array.dtype.kind != "U" or array.size != 1:
        raise MatrixError(f"{path}: {name} must be one text, such as 'u=8,lambda=7'")
    return str(array.reshape(())[()])


def _content(path: Path) -> io.BytesIO:
    try:
        return io.BytesIO(files.read(path, MOST_BYTES, given=True))
    except OSError as error:
        raise MatrixError(f"{one_line(str(path))}: cannot be read: {error.strerror}") from None


def _archive(path: Path, names: Collection[str]) -> dict[str, np.ndarray[Any, Any]]:
    """Name → array of an .npz file, without unpickling or unpacking beyond the limit."""
    content, arrays = _content(path), {}
    at, what = str(path), "not an .npz file"
    try:
        with np.load(content, allow_pickle=False) as archive:
            sizes = {info.filename: info.file_size for info in archive.zip.infolist()}
            wanted = [name for name in names if name in archive.files]
            size = sum(sizes.get(f"{name}.npy", 0) for name in wanted)
            for name in wanted if size <= MOST_BYTES else ():
                at, what = f"{path}: {name}", "not an array"
                arrays[name] = np.asarray(archive[name])
    except Exception as error:  # zip, zlib and NumPy have many for what is damaged
        why = one_line(str(error)) or type(error).__name__
        raise MatrixError(f"{at}: {what}, or cut off: {why}") from None
    if size > MOST_BYTES:
        raise MatrixError(f"{path}: unpacks to {size} bytes, at most {MOST_BYTES}")
    return arrays


def _market(path: Path) -> Array:
    """A Matrix Market file as a dense matrix; a single column as a vector."""
    from scipy.io import mminfo, mmread

    content = _content(path)
    try:
        rows, columns, entries, layout, _, _ = mminfo(content)
        _require_size((rows, columns), str(path))
        # Every entry takes two bytes at least.
        if entries > (rows * columns if layout == "array" else content.getbuffer().nbytes):
            raise ValueError("more entries than it has room for")
        content.seek(0)
        with warnings.catch_warnings():
            # SciPy will return another class; both become dense.
            warnings.simplefilter("ignore", DeprecationWarning)
            matrix = mmread(content)
    except MatrixError:
        raise
    except (ValueError, TypeError, OverflowError, EOFError, IndexError, OSError) as error:
        raise MatrixError(
            f"{path} is cut off, or not a Matrix Market file: {one_line(str(error))}"
        ) from None
    dense = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    return np.asarray(dense[:, 0] if columns == 1 else dense)


def array_of(value: Any, where: str, dimensions: tuple[int, ...] = (1, 2)) -> Array:
    """Real numbers of usable size, from whatever is an array of some dimensions, dense or sparse.

    Raises:
        MatrixError: For anything else, and for more rows or columns than `MOST_ROWS`.
    """
    if callable(getattr(value, "toarray", None)):
        value = value.toarray()
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty(0, object)
    if array.dtype.kind == "c":
        raise MatrixError(f"{where} is complex; must be real")
    if array.dtype.kind not in "iufb":
        raise MatrixError(f"{where} must be a matrix or a vector of numbers")
    if array.ndim not in dimensions:
        raise MatrixError(
            f"{where} must be a matrix or a vector, given an array of {array.ndim} dimensions"
        )
    _require_size(array.shape, where)
    numbers = array.astype(float)
    if not np.all(usable := np.abs(numbers) <= _LARGEST):
        place = tuple(int(index) for index in np.argwhere(~usable)[0])
        shown = ", ".join(str(index + 1) for index in place)
        allowed = f"at most {_LARGEST:g}" if np.isfinite(numbers[place]) else "finite"
        raise MatrixError(f"{where} has {numbers[place]} at ({shown}); must be {allowed}")
    return numbers


def _require_size(shape: tuple[int, ...], where: str) -> None:
    if max(shape, default=1) > MOST_ROWS or min(shape, default=1) < 0:
        raise MatrixError(f"{where} is {_by(shape)}; at most {MOST_ROWS} rows and columns")


def _by(shape: tuple[int, ...]) -> str:
    return " by ".join(map(str, shape)) or "a single number"


def require_shapes(
    arrays: Mapping[str, Array], wanted: Mapping[str, tuple[int, ...]], where: str
) -> None:
    """Refuse arrays of other shapes; raises `MatrixError` for the first that does not fit."""
    for name, shape in wanted.items():
        if name in arrays and arrays[name].shape != shape:
            actual = _by(arrays[name].shape)
            raise MatrixError(f"{where}: {name} must be {_by(shape)}, given {actual}")
