"""JSON files that notice damage: each carries a digest of what it holds."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from newmark_cli.study import results

_SEAL = "sha256"


def write(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record, atomically, into a folder that exists.

    Raises:
        ResultsError: When it cannot be written.
    """
    results.write_json(path, {**record, _SEAL: _digest(record)}, make_folder=False)


def read(path: Path) -> dict[str, Any] | None:
    """A record as it was written; None when there is none, or it is not."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(record, dict) or record.pop(_SEAL, None) != _digest(record):
            return None
    except (OSError, ValueError, RecursionError):
        return None
    return record


def _digest(record: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
