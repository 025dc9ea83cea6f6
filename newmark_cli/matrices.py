"""Matrices that another code has written: an .npz file, or Matrix Market files in a folder.

Nothing is ever unpickled, and nothing large is read, or unpacked, before its size is known.
"""

import io
import warnings
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from newmark_cli import files
from newmark_cli.arrays import Array
from newmark_cli.errors import InputError, one_line

#: Largest file that is read, and most bytes that the matrices of one may take (bytes).
MOST_BYTES = 256 << 20
#: Most rows or columns of a matrix.
MOST_ROWS = 4_000
_MOST_MEMBERS = 200
_FORMAT = np.lib.format


class MatrixError(InputError):
    """Matrices cannot be used; the text names the file, the matrix, and what is allowed."""


def read(path: Path, names: Collection[str], many: bool = False) -> dict[str, Array]:
    """Matrices of these names from an .npz file, a folder of .mtx files, or one .mtx file.

    Args:
        path: The file or folder.  A single .mtx file holds the first of the names.
        names: What to look for; anything else there is not looked at.
        many: Whether an .npz may have arrays of three dimensions.

    Returns:
        Name → matrix, (rows, columns), or vector, (size,): those that are there.

    Raises:
        MatrixError: The file cannot be read, is too large, is neither, or has what is not
            a matrix of finite real numbers.
    """
    if path.is_dir():
        found = {name: file for name in names if (file := path / f"{name}.mtx").exists()}
        if not found:
            raise MatrixError(f"{path}: the folder has none of {_listed(names, '.mtx')}")
        return {name: _market(file, str(file)) for name, file in found.items()}
    if path.suffix.lower() == ".mtx":
        return {next(iter(names)): _market(path, str(path))}
    if path.suffix.lower() == ".npz":
        return _archive(path, names, 3 if many else 2)
    raise MatrixError(f"{path}: must be an .npz file, an .mtx file or a folder of .mtx files")


def text_of(path: Path, name: str) -> str | None:
    """Text, such as the names of blocks, that an .npz file holds under a name; None if it does not.

    Raises:
        MatrixError: As `read`.
    """
    if path.suffix.lower() != ".npz":
        return None
    content = _members(path, (name,)).get(name)
    if content is None:
        return None
    shape, dtype, _, rest = _header(content, f"{path}: {name}")
    if dtype.kind != "U" or shape not in ((), (1,)) or len(rest) != dtype.itemsize:
        raise MatrixError(f"{path}: {name} must be one text, such as 'u=8,lambda=7'")
    return str(np.frombuffer(rest, dtype)[0])


def _listed(names: Collection[str], ending: str = "") -> str:
    return ", ".join(f"{name}{ending}" for name in names)


def _content(path: Path) -> bytes:
    try:
        return files.read_given(path, MOST_BYTES)
    except OSError as error:
        raise MatrixError(f"{one_line(str(path))}: cannot be read: {error.strerror}") from None


def _archive(path: Path, names: Collection[str], most_dimensions: int) -> dict[str, Array]:
    members = _members(path, names)
    if not members:
        raise MatrixError(f"{path}: the file has none of {_listed(names)}")
    found = {}
    for name, content in members.items():
        where = f"{path}: {name}"
        shape, dtype, fortran, rest = _header(content, where)
        _require_real(dtype.kind, where)
        _require_size(shape, where, most_dimensions)
        count = int(np.prod(shape, dtype=np.int64))
        if count * dtype.itemsize != len(rest):
            raise MatrixError(f"{where} is cut off: its size is not that of its shape {shape}")
        array = np.frombuffer(rest, dtype, count).reshape(shape, order="F" if fortran else "C")
        found[name] = _checked(array, where)
    return found


def _members(path: Path, names: Collection[str]) -> dict[str, bytes]:
    """Name → content of the .npy files of these names, whose sizes the directory tells."""
    content = _content(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            infos = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            wanted = [(name, infos[name]) for name in names if name in infos]
            if len(infos) > _MOST_MEMBERS:
                raise MatrixError(f"{path}: more than {_MOST_MEMBERS} arrays")
            if (size := sum(info.file_size for _, info in wanted)) > MOST_BYTES:
                raise MatrixError(f"{path}: unpacks to {size} bytes, at most {MOST_BYTES}")
            # What a member has beyond the size that the directory tells is not unpacked.
            return {name: archive.read(info) for name, info in wanted}
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError) as error:
        raise MatrixError(
            f"{path}: not an .npz file, or cut off: {one_line(str(error)) or 'no reason given'}"
        ) from None
    except (OSError, ValueError, OverflowError) as error:
        raise MatrixError(f"{path}: not an .npz file: {one_line(str(error))}") from None


def _header(
    content: bytes, where: str
) -> tuple[tuple[int, ...], np.dtype[np.generic], bool, memoryview]:
    """Shape, type and order of an .npy file, and its numbers as bytes; nothing is unpickled."""
    file = io.BytesIO(content)
    try:
        version = _FORMAT.read_magic(file)
        read_header = {
            (1, 0): _FORMAT.read_array_header_1_0,
            (2, 0): _FORMAT.read_array_header_2_0,
        }[version]
        shape, fortran, dtype = read_header(file)
    except KeyError:
        raise MatrixError(f"{where} is in a version of .npy that is not known") from None
    except Exception as error:
        # Whatever the header holds, NumPy reads it as a literal.
        raise MatrixError(f"{where} is not an array: {one_line(str(error))}") from None
    if dtype.hasobject:
        raise MatrixError(f"{where} is a pickle of Python objects, which is not read")
    return shape, dtype, fortran, memoryview(content)[file.tell() :]


def _market(path: Path, where: str) -> Array:
    """A Matrix Market file as a dense matrix; a single column as a vector."""
    from scipy.io import mminfo, mmread

    content = _content(path)
    try:
        rows, columns, entries, layout, field, _ = mminfo(io.BytesIO(content))
        _require_real("c" if field == "complex" else "f", where)
        _require_size((rows, columns), where)
        # Every entry takes two bytes at least.
        if entries > (rows * columns if layout == "array" else len(content)):
            raise MatrixError(f"{where} is cut off, or not a Matrix Market file")
        with warnings.catch_warnings():
            # SciPy will return another class; both become dense.
            warnings.simplefilter("ignore", DeprecationWarning)
            matrix = mmread(io.BytesIO(content))
        dense = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    except MatrixError:
        raise
    except (ValueError, TypeError, OverflowError, EOFError, IndexError, OSError) as error:
        raise MatrixError(
            f"{where} is cut off, or not a Matrix Market file: {one_line(str(error))}"
        ) from None
    return _checked(np.asarray(dense[:, 0] if columns == 1 else dense), where)


def _require_real(kind: str, where: str) -> None:
    if kind == "c":
        raise MatrixError(f"{where} is complex; must be real")
    if kind not in "fiub":
        raise MatrixError(f"{where} must be numbers, given an array of type {kind!r}")


def _require_size(shape: tuple[int, ...], where: str, most_dimensions: int = 2) -> None:
    if len(shape) > most_dimensions:
        raise MatrixError(f"{where} must be a matrix, given an array of {len(shape)} dimensions")
    if max(shape, default=1) > MOST_ROWS or min(shape, default=1) < 0:
        raise MatrixError(f"{where} is {_by(shape)}; at most {MOST_ROWS} rows and columns")


def _checked(array: Array, where: str) -> Array:
    numbers = np.array(array, dtype=float)
    wrong = np.argwhere(~np.isfinite(numbers))
    if len(wrong):
        place = ", ".join(str(index + 1) for index in wrong[0])
        raise MatrixError(f"{where} has {numbers[tuple(wrong[0])]} at ({place}); must be finite")
    return numbers


def _by(shape: tuple[int, ...]) -> str:
    return " by ".join(map(str, shape)) or "a single number"


def require_shapes(
    found: Mapping[str, Array], wanted: Mapping[str, tuple[int, ...]], where: str
) -> None:
    """Refuse arrays of other shapes.

    Args:
        found: Name → array.
        wanted: Name → its shape.
        where: What errors begin with.

    Raises:
        MatrixError: For the first that does not fit.
    """
    for name, shape in wanted.items():
        if name in found and found[name].shape != shape:
            given = _by(found[name].shape)
            raise MatrixError(f"{where}: {name} must be {_by(shape)}, given {given}")
