"""Finished cells of a results folder: what need not be computed again.

A cell is kept in ``cells/<cell>-<problem>-<core>.json``, the digests of the cell as
it is resolved, of the content of its problem, and of the numerical core with the
libraries it computes with.  Studies that share a cell share its file.  File times
mean nothing.  A file ends with a digest of its text; where that does not match, the
cell is computed again.
"""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import newmark_cli
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Done
from newmark_cli.study.provenance import version
from newmark_cli.support import files, sources

if TYPE_CHECKING:
    from pydantic import TypeAdapter

#: Libraries that the numbers come from.
_LIBRARIES = ("numpy", "scipy", "numba")
#: Modules of ``study`` that the numbers of a cell come from.
_OF_CELLS = ("axes", "axis", "compute", "measures", "observers", "replay")
#: Digits of a digest in a file name.
_DIGITS = 16


def file_name(cell: Cell) -> str:
    """The file that keeps a cell, in the folder of the finished cells."""
    return _file_of(_key(cell))


def _file_of(key: Mapping[str, str]) -> str:
    return "-".join(part[:_DIGITS] for part in key.values()) + ".json"


class Store:
    """Finished cells below a results folder; threads may share this object."""

    def __init__(self, folder: Path) -> None:
        """Take a results folder; nothing is read or written yet."""
        self._results, self._folder = folder, folder / "cells"

    def prepare(self) -> None:
        """Make the folder; raises `ResultsError` when it cannot be made."""
        files.make_folder(self._folder, self._results)

    def find(self, cell: Cell) -> Done | None:
        """The kept cell; None if it is not there or cannot be used."""
        done = self._read(cell)
        return done if done and done.outcome.status != "failed" else None

    def keep(self, cell: Cell, done: Done) -> None:
        """Keep a cell that has ended, but for one that failed or lacks more than what is kept."""
        key, before, ended = _key(cell), self.find(cell), done.outcome
        if before and (ended.status == "failed" or (ended.lacks and not before.outcome.lacks)):
            return
        record = {
            "cell": cell.computed,
            "key": key,
            "versions": versions(),
            **_adapter().dump_python(done),
        }
        files.write_sealed(self._folder / _file_of(key), record, self._results)

    def why(self, cell: Cell) -> str:
        """Why a cell that `find` does not find is to be run."""
        if done := self._read(cell):
            return f"failed before: {done.outcome.reason}"
        key = _key(cell)
        if os.path.lexists(self._folder / _file_of(key)):
            return "cached result is damaged"
        others = [
            other
            for file in sorted(self._folder.glob(f"{key['cell'][:_DIGITS]}-*.json"))
            if isinstance((other := files.read_mapping(file)).get("key"), dict)
        ]
        same_problem = [other for other in others if other["key"].get("problem") == key["problem"]]
        if same_problem:
            recorded = same_problem[-1].get("versions")
            before, now = recorded if isinstance(recorded, dict) else {}, versions()
            changed = [
                f"{name} {before.get(name, 'not recorded')} -> {now[name]}"
                for name in unlike(before, now)
            ]
            return ", ".join(changed) or "the numerical core has changed"
        if others:
            return "the problem has changed"
        return "not run yet"

    def _read(self, cell: Cell) -> Done | None:
        """What is kept of a cell, failed or not; None where the file cannot be used."""
        key = _key(cell)
        record = files.read_sealed(self._folder / _file_of(key))
        if record.get("key") != key:  # file names hold only the first digits
            return None
        try:
            return _adapter().validate_python(record)
        except ValueError:
            return None


@cache
def _adapter() -> "TypeAdapter[Done]":
    """Reads and writes the record of a finished cell."""
    from pydantic import TypeAdapter

    return TypeAdapter(Done)


def _key(cell: Cell) -> dict[str, str]:
    described = json.dumps(cell.computed, sort_keys=True)
    digest = hashlib.sha256(described.encode()).hexdigest()
    content = cell.problem.load().content
    if not isinstance(cell.code, str):
        content = hashlib.sha256(f"{content} {cell.code.content}".encode()).hexdigest()
    return {"cell": digest, "problem": content, "core": core()}


@cache
def core() -> str:
    """Digest of the code that the numbers come from, its libraries, and what they compute for.

    Everything below `newmark_cli.newmark`, `newmark_cli.problems`, `newmark_cli.mechanisms` and
    `newmark_cli.codes`, and the march of a cell.
    """
    package = Path(newmark_cli.__file__).parent
    files = [
        *(
            file
            for room in ("newmark", "problems", "mechanisms", "codes")
            for file in sorted((package / room).rglob("*.py"))
        ),
        *(package / "study" / f"{name}.py" for name in _OF_CELLS),
    ]
    # The package's own version says nothing that its code does not.
    libraries = {name: v for name, v in versions().items() if name != "newmark-study"}
    text = json.dumps(libraries, sort_keys=True) + sources.digest(files)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def versions() -> dict[str, str]:
    """Versions of what the numbers come from, and what they compute for, by name."""
    return {
        "newmark-study": newmark_cli.__version__,
        "machine": platform.machine(),
        **{name: version(name) for name in _LIBRARIES},
    }


def unlike(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Names of what has different `versions`."""
    return [name for name in other if one.get(name) != other[name]]
