"""One run at a time per results folder."""

import contextlib
import json
import os
import platform
import warnings
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import IO

from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError


@contextlib.contextmanager
def locked(folder: Path, what: str) -> Iterator[None]:
    """Hold a results folder for a run; the system lets go of it when the process ends.

    Args:
        folder: Results folder; it exists.
        what: The run, for whoever is refused.

    Raises:
        ResultsError: When another run holds it; names that run.

    Warns:
        UserWarning: When its file system has no locks: the run goes on.
    """
    import portalocker  # only what locks waits for its import

    path = folder / ".lock"
    try:
        file = files.opened_own(path)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror}") from None
    alone = portalocker.LockFlags.EXCLUSIVE | portalocker.LockFlags.NON_BLOCKING
    with file:
        try:
            portalocker.lock(file, alone)
        except portalocker.AlreadyLocked:
            raise ResultsError(f"{folder}: in use by {_holder(file)}") from None
        except portalocker.LockException as error:
            # Every file is replaced as a whole: two runs would only do the same work twice.
            why = getattr(error.__cause__, "strerror", None) or error
            warnings.warn(
                f"{folder}: cannot be locked ({why}); let no other run use it meanwhile",
                stacklevel=2,
            )
        started = datetime.now().astimezone().isoformat(timespec="seconds")
        holder = {"what": what, "process": os.getpid(), "host": platform.node(), "started": started}
        # On a full disk the lock holds all the same, and whoever is refused learns less; as on
        # Windows, where nobody reads what another process has locked.
        with contextlib.suppress(OSError):
            file.truncate(0)
            os.write(file.fileno(), json.dumps(holder).encode())
        yield


def _holder(file: IO[bytes]) -> str:
    try:
        file.seek(0)
        holder = json.loads(file.read(10_000))
        return (
            f"'{holder['what']}', process {holder['process']} on {holder['host']} "
            f"since {holder['started']}"
        )
    except (ValueError, KeyError, TypeError, OSError, RecursionError):
        return "another run"
