"""Finished cells of a results folder: what need not be computed again.

A cell is kept in ``cells/<cell>-<problem>-<core>.json``, the digests of the cell as
it is resolved, of the content of its problem, and of the numerical core with the
libraries it computes with.  Studies that share a cell share its file.  File times
mean nothing.
"""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import newmark_cli
from newmark_cli import files
from newmark_cli.arrays import Array, IndexArray
from newmark_cli.errors import ResultsError
from newmark_cli.newmark.statistics import Measurement, Statistics
from newmark_cli.running import sealed
from newmark_cli.study import axes
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import STATUSES, Done, Outcome
from newmark_cli.study.provenance import version

#: Why a cell is to run of which nothing is kept.
NOT_RUN = "not run yet"
#: Libraries that the numbers come from.
_LIBRARIES = ("numpy", "scipy", "numba")
#: What reading a record may raise.
_UNREADABLE = (AttributeError, KeyError, OverflowError, TypeError, ValueError)
#: Digits of a digest in a file name.
_DIGITS = 16


@dataclass(frozen=True)
class _Key:
    cell: str
    problem: str
    core: str

    @property
    def file(self) -> str:
        return "-".join(part[:_DIGITS] for part in (self.cell, self.problem, self.core)) + ".json"


@dataclass(frozen=True)
class Kept:
    """A file of a finished cell.

    Attributes:
        labels: What the cell is, by the CSV's columns and more; see `Cell.labels`.
        core: Digest of the numerical core that has computed it; see `core`.
    """

    labels: Mapping[str, Any]
    core: str


def file_name(cell: Cell) -> str:
    """The file that keeps a cell, in the folder of the finished cells."""
    return _key(cell).file


def opened(file: Path) -> Kept | None:
    """Content of a file of a finished cell; None if it is damaged."""
    record = sealed.read(file)
    try:
        if record is None or _Key(**record["key"]).file != file.name:
            return None
        _outcome(record["outcome"])
        return Kept(dict(record["cell"]), record["key"]["core"])
    except _UNREADABLE:
        return None


class Store:
    """Finished cells below a results folder; threads may share this object."""

    def __init__(self, folder: Path) -> None:
        """Take a results folder; nothing is read or written yet."""
        self._results, self._folder = folder, folder / "cells"

    def prepare(self) -> None:
        """Make the folder.

        Raises:
            ResultsError: When it cannot be made.
        """
        files.make_folder(self._folder, self._results)

    def require_replaceable(self, cell: Cell) -> None:
        """Refuse a folder in the place of a cell before it is computed.

        Raises:
            ResultsError: There is one.
        """
        files.require_replaceable(self._folder / _key(cell).file)

    def find(self, cell: Cell, failed: bool = False) -> Done | None:
        """The kept cell; None when it is not there or damaged.

        Args:
            cell: The cell.
            failed: Whether it may have failed.
        """
        record = self._read(_key(cell))
        if record is None:
            return None
        try:
            timed = record.get("march_seconds")
            kept = Done(
                _outcome(record["outcome"]),
                _number(record["seconds"]),
                None if timed is None else _number(timed),
            )
        except _UNREADABLE:
            return None
        return kept if failed or kept.outcome.status != "failed" else None

    def keep(self, cell: Cell, done: Done) -> None:
        """Keep a cell that has ended, atomically; never in place of a better one.

        Raises:
            ResultsError: When it cannot be written.
        """
        key = _key(cell)
        before = self.find(cell)
        if before is not None and _worth(done.outcome) < _worth(before.outcome):
            return
        record = {
            "cell": axes.computed(cell),
            "key": asdict(key),
            "versions": versions(),
            "seconds": done.seconds,
            "march_seconds": done.march_seconds,
            "outcome": _record(done.outcome),
        }
        sealed.write(self._folder / key.file, record, self._results)

    def why(self, cell: Cell) -> str:
        """Why a cell that `find` does not find is to be run."""
        key = _key(cell)
        record = self._read(key)
        if record is not None:
            outcome = record.get("outcome")
            reason = outcome.get("reason") if isinstance(outcome, dict) else None
            return f"failed before: {reason}" if reason else "cached result is damaged"
        if os.path.lexists(self._folder / key.file):
            return "cached result is damaged"
        others = [
            other
            for file in self._of_cell(key)
            if (other := sealed.read(file)) and isinstance(other.get("key"), dict)
        ]
        same_problem = [other for other in others if other["key"].get("problem") == key.problem]
        if same_problem:
            told = same_problem[-1].get("versions")
            before, now = told if isinstance(told, dict) else {}, versions()
            changed = [
                f"{name} {before.get(name, 'not recorded')} -> {now[name]}"
                for name in unlike(before, now)
            ]
            return ", ".join(changed) or "the numerical core has changed"
        if others:
            return "the problem has changed"
        return NOT_RUN

    def take(self, folder: Path) -> int:
        """Copy the cells of another results folder; returns how many were taken.

        What has failed or is damaged is replaced by what is better.

        Raises:
            ResultsError: When there are none, or they cannot be written.
        """
        found = sorted((folder / "cells").glob("*.json"))
        if not found:
            raise ResultsError(f"{folder}: holds no finished cells")
        new = 0
        for file in found:
            theirs, ours = sealed.read(file), sealed.read(self._folder / file.name)
            if theirs is not None and _worth_of(theirs) > _worth_of(ours):
                sealed.write(self._folder / file.name, theirs, self._results)
                new += 1
        return new

    def _of_cell(self, key: _Key) -> list[Path]:
        return sorted(self._folder.glob(f"{key.cell[:_DIGITS]}-*.json"))

    def _read(self, key: _Key) -> dict[str, Any] | None:
        record = sealed.read(self._folder / key.file)
        # File names hold the first digits alone.
        return record if record is not None and record.get("key") == asdict(key) else None


def _worth_of(record: Mapping[str, Any] | None) -> int:
    """Nothing, or what cannot be read, is worth least."""
    try:
        return 0 if record is None else _worth(_outcome(record["outcome"]))
    except _UNREADABLE:
        return 0


def _worth(outcome: Outcome) -> int:
    """Least if it failed, most if it lacks nothing."""
    if outcome.status == "failed":
        return 1
    return 2 if outcome.lacks else 3


def _key(cell: Cell) -> _Key:
    described = json.dumps(axes.computed(cell), sort_keys=True)
    return _Key(hashlib.sha256(described.encode()).hexdigest(), cell.problem.load().content, core())


@cache
def core() -> str:
    """Digest of the code that the numbers come from, its libraries, and what they compute for.

    Everything below `newmark_cli.newmark`, `newmark_cli.problems` and
    `newmark_cli.mechanisms`, and the march of a cell.
    """
    package = Path(newmark_cli.__file__).parent
    files = [
        *(
            file
            for room in ("newmark", "problems", "mechanisms")
            for file in sorted((package / room).rglob("*.py"))
        ),
        package / "algebra.py",
        *(
            package / "study" / f"{name}.py"
            for name in ("axes", "compute", "measures", "redundancy")
        ),
    ]
    # The package's own version says nothing that its code does not.
    libraries = {name: found for name, found in versions().items() if name != "newmark-study"}
    digest = hashlib.sha256(json.dumps(libraries, sort_keys=True).encode())
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


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


def _record(outcome: Outcome) -> dict[str, Any]:
    return {
        "measurements": [asdict(found) for found in outcome.measurements],
        "not_converged": outcome.not_converged,
        "newton_iterations": outcome.newton_iterations,
        "status": outcome.status,
        "reason": outcome.reason,
        "met": outcome.met,
        "history": [[step, multipliers.tolist()] for step, multipliers in outcome.history],
        "lacks": list(outcome.lacks),
        "pivoted": outcome.pivoted,
        "operations": outcome.operations,
        "drift": [[step, values.tolist()] for step, values in outcome.drift],
        "trajectory": {name: values.tolist() for name, values in outcome.trajectory.items()},
    }


def _outcome(record: dict[str, Any]) -> Outcome:
    """Read back; KeyError, TypeError or ValueError where it is not as written."""
    if record["status"] not in STATUSES:
        raise ValueError("unknown status")
    met, operations = record["met"], record.get("operations")
    return Outcome(
        measurements=[_measurement(found) for found in record["measurements"]],
        not_converged=_count(record["not_converged"]),
        newton_iterations=_number(record["newton_iterations"]),
        status=_text(record["status"]),
        reason=_text(record["reason"]),
        met=None if met is None else _count(met),
        history=[(_count(step), _vector(values)) for step, values in record["history"]],
        lacks=tuple(_text(reason) for reason in record.get("lacks", ())),
        drift=[(_count(step), _vector(values)) for step, values in record.get("drift", ())],
        trajectory=_columns(record.get("trajectory", {})),
        pivoted=_count(record.get("pivoted", 0)),
        operations=None if operations is None else _count(operations),
    )


def _measurement(found: Mapping[str, Any]) -> Measurement:
    given = found["statistics"]
    each = {name: _number(given[name]) for name in given if name != "zeros"}
    texts = {name: _text(found[name]) for name in found if name != "statistics"}
    return Measurement(**texts, statistics=Statistics(**each, zeros=_count(given["zeros"])))


def _text(given: object) -> str:
    if not isinstance(given, str):
        raise TypeError("not a text")
    return given


def _count(given: object) -> int:
    if not isinstance(given, int) or isinstance(given, bool) or not 0 <= given < 1 << 63:
        raise TypeError("not a count")
    return given


def _number(given: object) -> float:
    if not isinstance(given, float | int) or isinstance(given, bool):
        raise TypeError("not a number")
    return float(given)


def _columns(given: Mapping[str, object]) -> dict[str, Array | IndexArray]:
    found: dict[str, Array | IndexArray] = {name: _vector(of) for name, of in given.items()}
    if len({len(values) for values in found.values()}) > 1:
        raise ValueError("columns of different lengths")
    if "step" in found:
        found["step"] = found["step"].astype(np.int64)
    return found


def _vector(given: object) -> Array:
    array = np.array(given)
    if array.ndim != 1 or not (array.size == 0 or array.dtype.kind in "fi"):
        raise TypeError("not a vector")
    return array.astype(float)
