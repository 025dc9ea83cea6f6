"""Taking away what a results folder need not keep: cells, and litter of runs that were killed.

A kept cell stays when it is needed:

- by a CSV of the folder that was made from it, as its record says;
- by a study that has begun and is not finished, whose cells stand in ``.unfinished-<study>``;
- by a config that is given, which takes the place of its study's record.

Cells of another numerical core are of no use to this one, but they stay as long as a CSV
that was made from them: when its study has run again, its record names the new ones.
A damaged cell never stays; it would be computed again.
"""

import contextlib
import errno
import os
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from newmark_cli.running import store
from newmark_cli.running.lock import locked
from newmark_cli.study.provenance import merged
from newmark_cli.study.reading import NOT_STUDIES
from newmark_cli.study.results import run_path
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    from newmark_cli.study.config import Study

_UNFINISHED = ".unfinished-"
_CELL = re.compile(r"[0-9a-f]{16}-[0-9a-f]{16}-[0-9a-f]{16}\.json")
#: Names of the files whose temporary ones stay when a writer is killed.
_WRITTEN = re.compile(
    r"probe|\.unfinished-.+|.+\.(?:csv|gif|html|json|md|mp4|parquet|pdf|png|svg|tex)"
)
#: Seconds after which nobody writes a temporary file any more.
_LONG_AGO = 3600.0


@dataclass(frozen=True)
class Removed:
    """Files that are removed for one reason."""

    kind: str  #: what they are, with {s} for the s of several
    files: tuple[Path, ...]
    size: int  #: bytes


@dataclass(frozen=True)
class Pruned:
    """How a results folder was pruned."""

    removed: tuple[Removed, ...]  #: without reasons that hold for nothing
    stay: int  #: cells that stay
    size: int  #: their bytes
    outdated: int  #: how many of them are of another numerical core
    unfinished: tuple[str, ...]  #: studies that have begun and are not finished


def begun(folder: Path, study: "Study") -> None:
    """Note the cells of a study that no CSV names yet."""
    cells = [store.file_name(cell) for cell in study.cells()]
    files.write(folder / f"{_UNFINISHED}{study.study}", files.json_text({"cells": cells}))


def finished(folder: Path, study: "Study") -> None:
    """The record of the study's CSV names its cells from now on."""
    (folder / f"{_UNFINISHED}{study.study}").unlink(missing_ok=True)


def prune(folder: Path, studies: Sequence["Study"] = (), dry_run: bool = False) -> Pruned:
    """Remove what is not needed, see the module; studies need what their configs say now."""
    if not folder.is_dir():
        raise ResultsError(f"{folder}: no such folder")
    if dry_run:
        return _plan(folder, studies)
    with locked(folder, "prune"):
        pruned = _plan(folder, studies)
        for removed in pruned.removed:
            for file in removed.files:
                try:
                    files.require_within(file.parent, folder)
                    file.unlink(missing_ok=True)
                except OSError as error:
                    raise ResultsError(f"{file}: cannot be removed: {error.strerror}") from None
        return pruned


def sweep(folder: Path) -> None:
    """Remove what killed runs left in a results folder, which is held."""
    for file in _temporaries(folder):
        with contextlib.suppress(OSError):  # it does no harm
            file.unlink(missing_ok=True)


def _plan(folder: Path, studies: Sequence["Study"]) -> Pruned:
    names = {study.study for study in studies}
    unfinished = _unfinished(folder, names)
    needed = {store.file_name(cell) for study in studies for cell in study.cells()}
    needed.update(*unfinished.values())
    needed.update(_recorded(folder, names))
    damaged, foreign, needless, stay, outdated = [], [], [], [], 0
    for file in sorted((folder / "cells").glob("*.json")):
        if not _CELL.fullmatch(file.name):
            continue
        if file.exists() and not os.access(file, os.R_OK):
            raise ResultsError(f"{file}: cannot be read: {os.strerror(errno.EACCES)}")
        core = store.core_of(file)
        if core is None:
            damaged.append(file)
        elif file.name in needed:
            stay.append(file)
            outdated += core != store.core()
        elif core != store.core():
            foreign.append(file)
        else:
            needless.append(file)
    by_kind = {
        "cell{s} that no study needs": needless,
        "cell{s} of another numerical core": foreign,
        "damaged cell{s}": damaged,
        "temporary file{s}": list(_temporaries(folder)),
    }
    removed = (Removed(kind, tuple(f), _size(f)) for kind, f in by_kind.items() if f)
    return Pruned(tuple(removed), len(stay), _size(stay), outdated, tuple(unfinished))


def _unfinished(folder: Path, but: Iterable[str]) -> dict[str, set[str]]:
    """Unfinished studies → their cells."""
    cells_of = {}
    for file in sorted(folder.glob(f"{_UNFINISHED}*")):
        name = file.name.removeprefix(_UNFINISHED)
        if name not in but:
            cells = _json(file, f"the cells of {name!r}").get("cells")
            cells_of[name] = set(map(str, cells)) if isinstance(cells, list) else set()
    return cells_of


def _recorded(folder: Path, but: Iterable[str]) -> Iterator[str]:
    """Files of all cells behind the folder's CSVs, by their records."""
    csvs = {file.stem for file in folder.glob("*.csv") if file.name not in NOT_STUDIES}
    others = {file.stem for file in folder.glob("*.json")}
    for name in sorted((csvs | others) - set(but)):
        file = folder / f"{name}.json"
        of_csv = name in csvs
        record = _json(file, f"the cells of {name}.csv") if of_csv else files.read_mapping(file)
        if of_csv or record.get("study") == name:
            run = files.read_mapping(run_path(file.with_suffix(".csv")))
            cells = merged(record, run).get("cells")
            if not isinstance(cells, list) or not all(isinstance(cell, dict) for cell in cells):
                raise ResultsError(f"{file}: does not say what {name}.csv was made from")
            # A record that travelled without that of its run is of cells elsewhere.
            yield from (str(cell["kept_as"]) for cell in cells if "kept_as" in cell)


def _json(file: Path, what: str) -> dict[str, Any]:
    record = files.read_mapping(file)
    if not record:
        raise ResultsError(
            f"{file}: missing or damaged, so that {what} are not known; name the study's config"
        )
    return record


def _temporaries(folder: Path) -> Iterator[Path]:
    """Abandoned temporary files."""
    for file, target in files.temporaries(folder):
        with contextlib.suppress(OSError):  # it has its name now
            if _WRITTEN.fullmatch(target) and time.time() - file.stat().st_mtime > _LONG_AGO:
                yield file


def _size(files: Iterable[Path]) -> int:
    return sum(file.lstat().st_size for file in files)
