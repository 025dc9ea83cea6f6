"""Reading and writing files of which nobody knows where they come from.

A results folder may be somebody else's, with links that lead out of it, pipes that never
end, or JSON that is none.  Only regular files of bounded size are read, no link in a results
folder is followed, and a file is replaced whole or stays as it was.

Files that belong together, such as a CSV and its record, are replaced together: their new
contents are written under temporary names, a journal says which name each is to have, and
then they are renamed.  Who reads while the journal is there takes the temporary files, so
that readers see all of the old contents or all of the new, whenever a writer is killed.
"""

import contextlib
import errno
import glob
import json
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from newmark_cli import interrupts
from newmark_cli.errors import ResultsError


def _flags(*names: str) -> int:
    """Flags of `os.open`, without those that the platform lacks."""
    flags = 0
    for name in names:
        flags |= getattr(os, name, 0)
    return flags


#: Flags of every file that is opened here: bytes, and for this process only.
_ALWAYS = _flags("O_CLOEXEC", "O_NOINHERIT", "O_BINARY", "O_NOCTTY")
#: A pipe that nobody writes to must not keep a reader waiting.
_NO_WAIT = _flags("O_NONBLOCK")
#: Windows lacks it, where who may make links is an administrator or a developer.
_NO_LINK = _flags("O_NOFOLLOW")

#: Largest file of results that is read (bytes).
MOST = 1 << 30
#: Levels of lists and mappings in JSON.
_DEEPEST = 64
#: A file under its temporary name: that of the target, and what `tempfile` adds.
_TEMPORARY = re.compile(r"\.(.+)\.[a-z0-9_]{8}")
_JOURNAL = ".replacing-"
#: Seconds that a reader waits for a writer to pause.
_PATIENCE = 5.0


def read(path: Path, most: int = MOST, links: bool = False) -> bytes:
    """Content of a regular file.

    Args:
        path: The file.
        most: Largest size (bytes).
        links: Whether the file may be a symbolic link.

    Raises:
        OSError: The file is missing, cannot be read, is too large or is none; ``strerror``
            says so in words.
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
        OSError: It cannot be opened, or is a link, or not a regular file of its own.
    """
    descriptor = _open(path, os.O_RDWR | os.O_CREAT | _NO_WAIT)
    status = os.fstat(descriptor)
    if stat.S_ISREG(status.st_mode) and status.st_nlink < 2:
        return descriptor
    os.close(descriptor)
    what = "it has another name too" if stat.S_ISREG(status.st_mode) else "it is not a regular file"
    raise OSError(errno.EINVAL, what, str(path))


def _open(path: Path, flags: int, links: bool = False) -> int:
    """`os.open`, which follows a symbolic link only if it may."""
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
    """JSON of bounded depth, whose text can be written again.

    Raises:
        ValueError: It is none; says why.
    """
    try:
        value = json.loads(content.decode("utf-8"))
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except UnicodeDecodeError:
        raise ValueError("not text in UTF-8") from None
    level = [value]
    for _ in range(_DEEPEST):
        if not level:
            break
        level = [
            child
            for node in level
            if isinstance(node, list | dict)
            for child in (node if isinstance(node, list) else node.values())
            if isinstance(child, list | dict)
        ]
    else:
        raise ValueError("nested too deeply")
    if b"\\u" in content:
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise ValueError("a text with half a character") from None
    return value


def read_json(path: Path, most: int = MOST) -> Any:
    """`read` and `parse_json`; raises what they raise."""
    return parse_json(read(path, most))


def write(path: Path, content: str | bytes, within: Path | None = None) -> None:
    """Write a file of a results folder: whole, or as it was before.

    A link that stands in its place is replaced, not followed, as is a pipe or a socket.

    Args:
        path: The file; its folder exists.
        content: Text or bytes.
        within: Results folder, below which no folder may be a link; the file's own folder
            if omitted.

    Raises:
        ResultsError: The file cannot be written.
    """
    with _told(path, "cannot be written"):
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


def write_output(path: Path, content: str | bytes) -> None:
    """Write a file that the user has named.

    A link is followed, a device or a pipe is written to, and a file that exists keeps its
    mode.  A regular file is whole, or as it was before.

    Raises:
        ResultsError: The file cannot be written.
    """
    with _told(path, "cannot be written"):
        target = Path(os.path.realpath(path))
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISREG(mode := target.stat().st_mode) and not stat.S_ISDIR(mode):
                with open(_open(path, os.O_WRONLY, links=True), "wb") as file:
                    file.write(_bytes(content))
                return
        target.parent.mkdir(parents=True, exist_ok=True)
        write(target, content)


def write_new(path: Path, content: str | bytes) -> None:
    """Write a file that is not there yet, into a folder that nobody else writes to.

    Raises:
        ResultsError: The file is there, or cannot be written.
    """
    with _told(path, "cannot be written"):
        descriptor = _open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
        with open(descriptor, "wb") as file:
            file.write(_bytes(content))


@contextlib.contextmanager
def new_folder(
    target: Path, last: str, is_ours: Callable[[Path], bool], force: bool = False
) -> Iterator[Path]:
    """A folder to be filled, which takes the place of another when the context ends well.

    Until then it stands next to the other under a temporary name; after an exception it is
    removed, and the other is as it was.  What a process that was killed has left of such a
    folder goes when another takes its place.

    Args:
        target: The folder: not there, empty, or of entries that may be replaced.
        last: Its entry that says that it is whole.
        is_ours: Whether an entry of ``target`` may be replaced.
        force: Whether ``target`` may have other entries, too, which stay as they are.

    Yields:
        The folder to be filled.

    Raises:
        ResultsError: The target is no folder, has other entries, or cannot be written.
    """
    place = Path(os.path.abspath(target))
    with _told(target, "cannot be written"):
        place.parent.mkdir(parents=True, exist_ok=True)
        _not_ours(place, is_ours, force)
        folder = Path(tempfile.mkdtemp(dir=place.parent, prefix=f".{place.name}."))
    held = _held(folder)
    try:
        with _told(target, "cannot be written"):
            os.chmod(folder, 0o777 & ~_umask())
        yield folder
        with interrupts.postponed(), _told(target, "cannot be replaced"):
            if _not_ours(place, is_ours, force):
                _merge(folder, place, last, is_ours)
            else:
                _swap(folder, place)
            _remove_left(place, is_ours)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if held is not None:
            os.close(held)


def _not_ours(target: Path, is_ours: Callable[[Path], bool], force: bool) -> list[Path]:
    """Entries of a folder that may not be replaced; OSError unless they are to stay."""
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return []
    if not stat.S_ISDIR(mode):
        what = "it is a symbolic link" if stat.S_ISLNK(mode) else "it is not a folder"
        raise OSError(errno.ENOTDIR, what, str(target))
    theirs = sorted(entry for entry in target.iterdir() if not is_ours(entry))
    if theirs and not force:
        raise OSError(
            errno.ENOTEMPTY,
            f"{theirs[0].name!r} in it is not of an export; name another folder, or give "
            "--force to leave what is there and add to it",
        )
    return theirs


def _held(folder: Path) -> int | None:
    """Descriptor that tells others that a folder is in use; None where it is, or none can tell."""
    try:
        descriptor = _open(folder, os.O_RDONLY | _flags("O_DIRECTORY"))
    except OSError:  # Windows opens no folders
        return None
    try:
        lock(descriptor)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove_left(target: Path, is_ours: Callable[[Path], bool]) -> None:
    """Remove what processes that were killed have left next to a folder."""
    for folder in sorted(target.parent.glob(f".{glob.escape(target.name)}.*")):
        match = _TEMPORARY.fullmatch(folder.name)
        if not (match and match[1] == target.name) or (held := _held(folder)) is None:
            continue
        with contextlib.suppress(OSError):
            if all(map(is_ours, folder.iterdir())):
                shutil.rmtree(folder)
        os.close(held)


def _swap(folder: Path, target: Path) -> None:
    """A folder in the place of another, if there is one, which is removed."""
    if not target.is_dir():
        os.rename(folder, target)
        return
    before = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    if os.name == "nt":  # where an empty folder is not replaced
        before.rmdir()
    os.rename(target, before)
    try:
        os.rename(folder, target)
    except BaseException:
        os.rename(before, target)
        raise
    shutil.rmtree(before, ignore_errors=True)


def _merge(folder: Path, target: Path, last: str, is_ours: Callable[[Path], bool]) -> None:
    """Entries of a folder in place of those of another that may be replaced."""
    entries = sorted(folder.iterdir(), key=lambda entry: (entry.name == last, entry.name))
    for entry in entries:
        place = target / entry.name
        if os.path.lexists(place) and not is_ours(place):
            raise OSError(errno.EEXIST, f"{entry.name!r} in it is not of an export", str(place))
    ours = [entry for entry in target.iterdir() if is_ours(entry)]
    for entry in sorted(ours, key=lambda entry: (entry.name != last, entry.name)):
        if entry.is_dir():
            shutil.rmtree(entry)
        else:
            entry.unlink()
    for entry in entries:
        os.rename(entry, target / entry.name)


def require_replaceable(path: Path) -> None:
    """Refuse a folder in the place of a file of the results.

    Raises:
        ResultsError: There is one.
    """
    with _told(path, "cannot be written"):
        if path.is_dir() and not path.is_symlink():
            raise IsADirectoryError(errno.EISDIR, "it is a folder; remove it")


def make_folder(folder: Path, within: Path, parents: bool = False) -> None:
    """Make a folder in a results folder.

    Args:
        folder: The folder.
        within: The results folder.
        parents: Whether the results folder may have to be made too: one that was there
            when a run began, and is not any more, was taken away by somebody.

    Raises:
        ResultsError: It cannot be made, or is a link.
    """
    with _told(folder, "cannot be made"):
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
        OSError: Between the two stands what is no folder.
    """
    for part in (folder, *folder.parents):
        if part == within:
            return
        if not stat.S_ISDIR(part.lstat().st_mode):
            what = "a symbolic link" if part.is_symlink() else "not a folder"
            raise OSError(errno.ENOTDIR, f"{part} is {what}", str(part))


def replace_together(
    folder: Path, name: str, contents: Mapping[Path, str | bytes | None], within: Path
) -> None:
    """Replace files that belong together; see the module.

    Args:
        folder: Holds the journal.
        name: Of the journal.
        contents: File → what it is to hold; None for one that is to go.
        within: Results folder.

    Raises:
        ResultsError: They cannot be written; all are as they were, unless the disk
            failed between two renames.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            if content is not None:
                with _told(path, "cannot be written"):
                    require_within(path.parent, within)
                    temporaries[path] = _temporary(path, content)
        journal = {path.relative_to(folder).as_posix(): "" for path in contents}
        for path, temporary in temporaries.items():
            journal[path.relative_to(folder).as_posix()] = temporary.name
        write_json(folder / f"{_JOURNAL}{name}", journal)
    except BaseException:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
        raise
    _finish(folder, name, journal)


def settle(folder: Path) -> None:
    """Finish what writers that were killed had begun to replace; who calls holds the folder.

    Raises:
        ResultsError: A file cannot be renamed.
    """
    for file in sorted(folder.glob(f"{_JOURNAL}*")):
        name = file.name.removeprefix(_JOURNAL)
        _finish(folder, name, _journal(folder, name))


def read_together(paths: Sequence[Path], folder: Path, name: str) -> dict[Path, bytes | OSError]:
    """Contents of files that are replaced together, all old or all new.

    Args:
        paths: The files.
        folder: Holds the journal.
        name: Of the journal.

    Returns:
        File → content, or why it cannot be read.
    """
    until = time.monotonic() + _PATIENCE
    while True:
        before = _identities(paths, folder, name)
        journal = _journal(folder, name)
        found: dict[Path, bytes | OSError] = {}
        for path in paths:
            temporary = journal.get(path.relative_to(folder).as_posix())
            try:
                require_within(path.parent, folder)
                if temporary == "":
                    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
                there = temporary is not None and (path.parent / temporary).exists()
                found[path] = read(path.parent / str(temporary) if there else path)
            except OSError as error:
                found[path] = error
        # A writer that was at work between the two may have shown old and new.
        if before == _identities(paths, folder, name) or time.monotonic() > until:
            return found
        time.sleep(0.001)


def temporaries(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files below a folder that have a temporary name and no journal; each with its target."""
    kept = {
        temporary
        for file in folder.glob(f"{_JOURNAL}*")
        for temporary in _journal(folder, file.name.removeprefix(_JOURNAL)).values()
    }
    for file in sorted(folder.rglob(".*")):
        match = _TEMPORARY.fullmatch(file.name)
        regular = match and not file.is_symlink() and file.is_file()
        if match and regular and file.name not in kept:
            yield file, match[1]


def _finish(folder: Path, name: str, journal: Mapping[str, str]) -> None:
    for target, temporary in journal.items():
        path = folder / target
        with _told(path, "cannot be written"):
            require_within(path.parent, folder)
            if not temporary:
                path.unlink(missing_ok=True)
                continue
            with contextlib.suppress(FileNotFoundError):  # has been renamed already
                os.replace(path.parent / temporary, path)
    file = folder / f"{_JOURNAL}{name}"
    with _told(file, "cannot be removed"):
        file.unlink(missing_ok=True)


def _journal(folder: Path, name: str) -> dict[str, str]:
    """Target, relative to the folder, → name of its temporary file; empty without a journal.

    What a journal may rename is a file of the same folder, to the name that it begins with.
    """
    try:
        found = read_json(folder / f"{_JOURNAL}{name}", 1 << 20)
    except (OSError, ValueError):
        return {}
    journal = {}
    for target, temporary in found.items() if isinstance(found, dict) else ():
        path = Path(target)
        match = _TEMPORARY.fullmatch(temporary) if isinstance(temporary, str) else None
        ours = match is not None and match[1] == path.name and "/" not in temporary
        below = not path.is_absolute() and ".." not in path.parts
        if path.stem == name and below and (ours or temporary == ""):
            journal[path.as_posix()] = temporary
    return journal


def _identities(paths: Sequence[Path], folder: Path, name: str) -> list[tuple[int, ...] | None]:
    found: list[tuple[int, ...] | None] = []
    for path in (folder / f"{_JOURNAL}{name}", *paths):
        try:
            status = path.lstat()
        except OSError:
            found.append(None)
        else:
            found.append((status.st_ino, status.st_mtime_ns, status.st_size))
    return found


def _temporary(path: Path, content: str | bytes) -> Path:
    """A file next to another, with new content and the mode of the other."""
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
    """Mode of a regular file, or the one that a new file gets; OSError for a folder."""
    with contextlib.suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            return stat.S_IMODE(mode) & 0o777
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, "it is a folder", str(path))
    return 0o666 & ~_umask()


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextlib.contextmanager
def _told(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except ResultsError:
        raise
    except OSError as error:
        raise ResultsError(f"{path}: {what}: {error.strerror or error}") from None
