"""JSON files that notice damage: each carries a digest of what it holds."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from newmark_cli import files

_SEAL = "sha256"


def write(path: Path, record: Mapping[str, Any], within: Path | None = None) -> None:
    """Write a record, atomically, into a folder of a results folder; both exist.

    Raises:
        ResultsError: When it cannot be written.
    """
    files.write_json(path, {**record, _SEAL: _digest(record)}, within)


def read(path: Path) -> dict[str, Any] | None:
    """A record as it was written; None when there is none, or it is not."""
    try:
        record = files.read_json(path)
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.pop(_SEAL, None) != _digest(record):
        return None
    return record


def _digest(record: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
