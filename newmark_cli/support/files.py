"""Reading and writing files of a results folder, which may come from someone else.

Only regular files of bounded size are read, no link within a results folder is followed, and
a file is replaced whole or stays as it was.  Files that belong together, such as a CSV and its
record, are all written under temporary names before the first of them gets its own: a full disk
leaves all of them as they were.  If a run is killed between two names, the checksums in the
record show it, and the next run writes them again.
"""

import contextlib
import errno
import hashlib
import json
import os
import re
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

from newmark_cli.support.errors import InputError, ResultsError

#: Not to wait for a pipe that nobody writes to, and not to follow a link; Windows lacks both.
_NO_WAIT, _NO_LINK = (getattr(os, name, 0) for name in ("O_NONBLOCK", "O_NOFOLLOW"))
#: Largest file of results that is read (bytes).
MOST = 1 << 30
#: What comes before the digest of a sealed file.
_SEAL = ', "sha256": "'
#: What a shell hands over, such as the pipe of ``<(command)``.
_HANDED_OVER = re.compile(r"/dev/stdin|/(dev|proc/self)/fd/\d+")


def read(path: Path, most: int = MOST, given: bool = False) -> bytes:
    """Content of a regular file.

    Args:
        path: The file.
        most: Most bytes that it may have.
        given: Whether the user has named it: it may be a link, or what a shell hands over.

    Raises:
        OSError: The file is missing, cannot be read, is too large, or is not a regular
            file; ``strerror`` says so in words.
    """
    handed_over = given and _HANDED_OVER.fullmatch(str(path))
    try:
        file = path.open("rb") if handed_over else _opened(path, "rb", links=given)
    except ValueError:  # a NUL, or half a surrogate pair
        raise OSError(errno.EINVAL, "it is not a file name", str(path)) from None
    with file:
        status = os.fstat(file.fileno())
        if not (handed_over or stat.S_ISREG(status.st_mode)):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        if status.st_size <= most and len(content := file.read(most + 1)) <= most:
            return content
    raise OSError(errno.EFBIG, f"it is larger than {most} bytes", str(path))


def opened_own(path: Path) -> IO[bytes]:
    """A file that is read and written in place, made if it is not there.

    Raises:
        OSError: It cannot be opened, is a link, is not a regular file, or has another name.
    """
    file = _opened(path, "a+b")
    status = os.fstat(file.fileno())
    if stat.S_ISREG(status.st_mode) and status.st_nlink == 1:
        return file
    file.close()
    raise OSError(errno.EINVAL, "it is not a regular file, or has another name, too", str(path))


def _opened(path: Path, mode: str, links: bool = False) -> IO[bytes]:
    """`open` that waits for no pipe and follows a symbolic link only if allowed."""
    if path.is_symlink() and not links:
        raise OSError(errno.ELOOP, "it is a symbolic link", str(path))
    flags = _NO_WAIT | (0 if links else _NO_LINK)
    return open(path, mode, opener=lambda name, others: os.open(name, others | flags, 0o666))


def parse_json(content: bytes) -> Any:
    """A JSON document.

    Raises:
        ValueError: It is not JSON; says why.
    """
    try:
        return json.loads(content.decode("utf-8"), parse_int=_whole)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except UnicodeDecodeError:
        raise ValueError("not text in UTF-8") from None


def _whole(text: str) -> int:
    """A whole number that a float can hold, too: nothing that is measured is larger."""
    if len(text) > 300:
        raise ValueError(f"a number of {len(text)} digits")
    return int(text)


def read_mapping(path: Path) -> dict[str, Any]:
    """A JSON object; empty if the file is missing or holds something else."""
    try:
        value = parse_json(read(path))
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def json_text(value: Any) -> str:
    """JSON for people to read."""
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def write_sealed(path: Path, value: Mapping[str, Any], within: Path) -> None:
    """`write` JSON, with a digest of its text as the last key."""
    text = json.dumps(value, ensure_ascii=False).removesuffix("}")
    write(path, text + _seal(text.encode()), within)


def read_sealed(path: Path) -> dict[str, Any]:
    """What `write_sealed` was given; empty if it is not there, to the bit."""
    with contextlib.suppress(OSError):
        text, key, _ = (content := read(path)).rpartition(_SEAL.encode())
        if key and content == text + _seal(text).encode():
            value: dict[str, Any] = parse_json(text + b"}")
            return value
    return {}


def _seal(text: bytes) -> str:
    return f'{_SEAL}{hashlib.sha256(text).hexdigest()}"}}\n'


def write(path: Path, content: str | bytes, within: Path | None = None) -> None:
    """Write a file of a results folder: whole, or as it was before.

    A link that stands in its place is replaced, not followed, as is a pipe or a socket.

    Args:
        within: Results folder, below which no folder may be a link; the file's own folder
            if omitted.

    Raises:
        ResultsError: The file cannot be written.
    """
    replace_together({path: content}, within or path.parent)


def write_output(path: Path, content: str | bytes) -> None:
    """Write a file that the user has named.

    A link is followed, a device or a pipe is written to, and a file that exists keeps its
    mode.  A regular file is whole, or as it was before; its folder must be there.

    Raises:
        ResultsError: The file cannot be written.
    """
    with _as_results_error(path, "cannot be written"):
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file() and not target.is_dir():
            path.write_bytes(_bytes(content))
            return
        if not target.parent.exists():
            raise FileNotFoundError(errno.ENOENT, f"there is no folder {target.parent}")
        write(target, content)


def require_replaceable(path: Path) -> None:
    """Refuse a folder in the place of a file of the results.

    Raises:
        ResultsError: There is one.
    """
    if path.is_dir() and not path.is_symlink():
        raise ResultsError(f"{path}: cannot be written: it is a folder; remove it")


def make_folder(folder: Path, within: Path, parents: bool = False) -> None:
    """Make a folder in a results folder, and that too if ``parents``; not so during a run.

    Raises:
        ResultsError: It cannot be made, or is a link.
    """
    with _as_results_error(folder, "cannot be made"):
        if parents:
            within.mkdir(parents=True, exist_ok=True)
        require_within(folder.parent, within)
        with contextlib.suppress(FileExistsError):
            folder.mkdir()
        require_within(folder, within)


def require_within(folder: Path, within: Path) -> None:
    """Refuse a folder that a link leads to.

    Args:
        folder: A folder in ``within``, or that itself.
        within: Results folder, which may be a link.

    Raises:
        OSError: There is a link, or anything but a folder, between the two.
    """
    for part in (folder, *folder.parents):
        if part == within:
            return
        if not stat.S_ISDIR(part.lstat().st_mode):
            what = "a symbolic link" if part.is_symlink() else "not a folder"
            raise OSError(errno.ENOTDIR, f"{part} is {what}", str(part))


def replace_together(contents: Mapping[Path, str | bytes | None], within: Path) -> None:
    """Replace files that belong together, or remove those of None; see the module.

    Raises:
        ResultsError: They cannot be written.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            with _as_results_error(path, "cannot be written"):
                require_within(path.parent, within)
                if content is not None:
                    require_replaceable(path)
                    temporaries[path] = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
                    _fill(temporaries[path], _bytes(content), like=path)
        for path in contents:
            with _as_results_error(path, "cannot be written"):
                if path in temporaries:
                    os.replace(temporaries[path], path)
                else:
                    path.unlink(missing_ok=True)
    except BaseException:
        for temporary in temporaries.values():
            with contextlib.suppress(OSError):  # it may never have been there
                temporary.unlink()
        raise


def _fill(path: Path, content: bytes, like: Path) -> None:
    """Write a new file that has the mode of another, if that is a regular one."""
    with path.open("xb") as file:
        with contextlib.suppress(FileNotFoundError):
            if stat.S_ISREG(mode := like.lstat().st_mode):
                path.chmod(mode & 0o777)
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


@contextlib.contextmanager
def _as_results_error(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: {what}: {error.strerror or error}") from None


def require_parquet(what: str) -> None:
    """Refuse Parquet where the package for it is not installed.

    Args:
        what: What needs it, in words.

    Raises:
        InputError: Says how to install it.
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise InputError(
            f"{what} needs pyarrow; install it with: pip install 'newmark-study[parquet]'"
        ) from None
