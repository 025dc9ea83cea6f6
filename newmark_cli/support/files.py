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
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from newmark_cli.support.errors import ResultsError


def _flags(*names: str) -> int:
    """Flags of `os.open`, without those that the platform lacks."""
    flags = 0
    for name in names:
        flags |= getattr(os, name, 0)
    return flags


#: Flags of every file that is opened here: bytes, and for this process only.
_ALWAYS = _flags("O_CLOEXEC", "O_NOINHERIT", "O_BINARY", "O_NOCTTY")
#: A reader must not wait for a pipe that nobody writes to.
_NO_WAIT = _flags("O_NONBLOCK")
#: Windows lacks it; there only administrators and developers may make links.
_NO_LINK = _flags("O_NOFOLLOW")

#: Largest file of results that is read (bytes).
MOST = 1 << 30
#: What comes before the digest of a sealed file.
_SEAL = ',\n  "sha256": "'
#: A file under its temporary name: that of the target, and what `tempfile` adds.
_TEMPORARY = re.compile(r"\.(.+)\.[a-z0-9_]{8}")


def read(path: Path, most: int = MOST, links: bool = False) -> bytes:
    """Content of a regular file.

    Raises:
        OSError: The file is missing, cannot be read, is too large, or is not a regular
            file; ``strerror`` says so in words.
    """
    try:
        descriptor = _open(path, os.O_RDONLY | _NO_WAIT, links)
    except ValueError:  # a NUL, or half a surrogate pair
        raise OSError(errno.EINVAL, "it is not a file name", str(path)) from None
    if stat.S_ISDIR(os.fstat(descriptor).st_mode):  # which `open` refuses without a name
        os.close(descriptor)
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    with open(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        content = b"" if status.st_size > most else file.read(most + 1)
    if max(status.st_size, len(content)) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most} bytes", str(path))
    return content


def read_given(path: Path, most: int) -> bytes:
    """Content of a file that the user has named: a regular file, or what a shell hands over.

    Raises:
        OSError: As `read`.
    """
    if str(path) == "/dev/stdin" or re.fullmatch(r"/(dev|proc/self)/fd/\d+", str(path)):
        with path.open("rb") as file:  # the pipe of <(command)
            content = file.read(most + 1)
        if len(content) > most:
            raise OSError(errno.EFBIG, f"it is larger than {most} bytes", str(path))
        return content
    return read(path, most, links=True)


def descriptor_of_own(path: Path) -> int:
    """Descriptor of a file that is read and written in place, made if it is not there.

    Raises:
        OSError: It cannot be opened, is a link, is not a regular file, or has another name.
    """
    descriptor = _open(path, os.O_RDWR | os.O_CREAT | _NO_WAIT)
    status = os.fstat(descriptor)
    regular = stat.S_ISREG(status.st_mode)
    if not regular or status.st_nlink > 1:
        os.close(descriptor)
        what = "it has another name, too" if regular else "it is not a regular file"
        raise OSError(errno.EINVAL, what, str(path))
    return descriptor


def _open(path: Path, flags: int, links: bool = False) -> int:
    """`os.open` that follows a symbolic link only if allowed."""
    if not links and not _NO_LINK and path.is_symlink():
        raise OSError(errno.ELOOP, "it is a symbolic link", str(path))
    try:
        return os.open(path, flags | _ALWAYS | (0 if links else _NO_LINK), 0o666)
    except OSError as error:
        if not links and error.errno == errno.ELOOP and path.is_symlink():
            raise OSError(errno.ELOOP, "it is a symbolic link", str(path)) from None
        raise


def lock(descriptor: int, shared: bool = False) -> None:
    """Lock an open file, or fail at once; the system unlocks it when the process ends.

    Args:
        descriptor: Of the file.
        shared: Whether others may hold it together with this process.

    Raises:
        BlockingIOError: Another process holds it.
        OSError: It cannot be locked, as on some network file systems; ``strerror`` says why.
    """
    import portalocker  # only what locks waits for its import

    kind = portalocker.LockFlags.SHARED if shared else portalocker.LockFlags.EXCLUSIVE
    try:
        portalocker.lock(descriptor, kind | portalocker.LockFlags.NON_BLOCKING)
    except portalocker.AlreadyLocked:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN)) from None
    except portalocker.LockException as error:
        cause = error.__cause__
        number, why = errno.ENOLCK, str(error)
        if isinstance(cause, OSError):
            number, why = cause.errno or number, cause.strerror or why
        raise OSError(number, why) from None


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


def read_json(path: Path, most: int = MOST) -> Any:
    """`read` and `parse_json`; raises what they raise."""
    return parse_json(read(path, most))


def read_mapping(path: Path) -> dict[str, Any]:
    """A JSON object; empty if the file is missing or holds something else."""
    try:
        value = read_json(path)
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def write(path: Path, content: str | bytes, within: Path | None = None) -> None:
    """Write a file of a results folder: whole, or as it was before.

    A link that stands in its place is replaced, not followed, as is a pipe or a socket.

    Args:
        within: Results folder, below which no folder may be a link; the file's own folder
            if omitted.

    Raises:
        ResultsError: The file cannot be written.
    """
    with _as_results_error(path, "cannot be written"):
        require_within(path.parent, within or path.parent)
        temporary = _temporary(path, content)
        try:
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def write_json(path: Path, value: Any, within: Path | None = None) -> None:
    """Write JSON for people to read; see `write`."""
    write(path, json_text(value), within)


def json_text(value: Any) -> str:
    """JSON for people to read."""
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def write_sealed(path: Path, value: Mapping[str, Any], within: Path) -> None:
    """`write_json` of a mapping, with a digest of its text as the last key."""
    text = json_text(value).removesuffix("\n}\n")
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
    return f'{_SEAL}{hashlib.sha256(text).hexdigest()}"\n}}\n'


def write_output(path: Path, content: str | bytes) -> None:
    """Write a file that the user has named.

    A link is followed, a device or a pipe is written to, and a file that exists keeps its
    mode.  A regular file is whole, or as it was before; its folder must be there.

    Raises:
        ResultsError: The file cannot be written.
    """
    with _as_results_error(path, "cannot be written"):
        target = Path(os.path.realpath(path))
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISREG(mode := target.stat().st_mode) and not stat.S_ISDIR(mode):
                with open(_open(path, os.O_WRONLY, links=True), "wb") as file:
                    file.write(_bytes(content))
                return
        if not target.parent.exists():
            raise FileNotFoundError(errno.ENOENT, f"there is no folder {target.parent}")
        write(target, content)


def require_replaceable(path: Path) -> None:
    """Refuse a folder in the place of a file of the results.

    Raises:
        ResultsError: There is one.
    """
    with _as_results_error(path, "cannot be written"):
        if path.is_dir() and not path.is_symlink():
            raise IsADirectoryError(errno.EISDIR, "it is a folder; remove it")


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
                    temporaries[path] = _temporary(path, content)
        for path in contents:
            with _as_results_error(path, "cannot be written"):
                if path in temporaries:
                    os.replace(temporaries[path], path)
                else:
                    path.unlink(missing_ok=True)
    except BaseException:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
        raise


def temporaries(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files below a folder that have a temporary name, each with the name of its target."""
    for file in sorted(folder.rglob(".*")):
        match = _TEMPORARY.fullmatch(file.name)
        if match and not file.is_symlink() and file.is_file():
            yield file, match[1]


def _temporary(path: Path, content: str | bytes) -> Path:
    """A new temporary file next to another, with its mode."""
    mode = _mode(path)
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    temporary = Path(name)
    try:
        with open(descriptor, "wb") as file:
            file.write(_bytes(content))
            file.flush()
            os.fsync(descriptor)
            if hasattr(os, "fchmod"):  # Windows gets it with Python 3.13
                os.fchmod(descriptor, mode)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def _mode(path: Path) -> int:
    """Mode of a regular file, or that of a new file; OSError for a folder."""
    with contextlib.suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            return stat.S_IMODE(mode) & 0o777
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


@contextlib.contextmanager
def _as_results_error(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except ResultsError:
        raise
    except OSError as error:
        raise ResultsError(f"{path}: {what}: {error.strerror or error}") from None
