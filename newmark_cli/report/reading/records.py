"""Reading provenance back: the records next to CSVs, for people, and their checksums."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import newmark_cli
from newmark_cli.report.reading.words import counted
from newmark_cli.study import axes, csv_files
from newmark_cli.study import shipped as shipped_configs
from newmark_cli.study.csv_rows import listed, mapping
from newmark_cli.study.provenance import checksum, merged
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError, visible

Kept = TypeVar("Kept")

#: What a record does not say.
UNKNOWN = "not recorded"


def read(path: Path) -> dict[str, Any]:
    """Provenance of one CSV, and of the run that wrote it where that is known."""
    content, of_run = csv_files.read_records(path)
    try:
        run = _parsed(csv_files.run_path(path), of_run)
    except ResultsError:
        run = {}
    return merged(_parsed(path, content), run)


def _parsed(path: Path, content: bytes | OSError) -> dict[str, Any]:
    file = path.with_suffix(".json")
    if isinstance(content, FileNotFoundError):
        raise ResultsError(f"{file}: no record of {path.name}")
    if isinstance(content, OSError):
        raise ResultsError(f"{file}: cannot be read: {content.strerror}")
    try:
        record = files.parse_json(content)
    except ValueError as error:
        raise ResultsError(f"{file}: not JSON: {error}") from None
    if not isinstance(record, dict) or record.get("study") != path.stem:
        raise ResultsError(f"{file}: not the record of {path.name}")
    return record


def known(path: Path) -> dict[str, Any]:
    """Provenance of one CSV; empty where there is none that can be read."""
    try:
        return read(path)
    except ResultsError:
        return {}


def configured(path: Path, key: str, read: Callable[[Any], Kept]) -> Kept:
    """What a key of the config in a record says, or that of the shipped study it is of.

    Raises:
        ResultsError: When it is not as a run has written it.
    """
    return told(path, read, shipped_configs.config_of(path.stem, known(path), key))


def told(path: Path, read: Callable[[Any], Kept], config: Any) -> Kept:
    """What a reader of configs makes of one, whose mistakes are those of the record of a CSV."""
    try:
        return read(config)
    except ValueError as error:
        raise ResultsError(f"{path.with_suffix('.json')}: {error}") from None


def environment(record: Mapping[str, Any]) -> dict[str, str]:
    """Versions that results were computed with, by name, as far as the record has them."""
    source, blas, machine = (mapping(record, key) for key in ("source", "blas", "platform"))
    threads = {name: count for name, count in mapping(blas, "threads").items() if count}
    commit = source.get("commit")
    facts = {
        **{str(name): value for name, value in mapping(record, "versions").items()},
        **problem_files(record),
        "commit": f"{commit}{' (modified)' if source.get('modified') else ''}" if commit else "",
        "BLAS of numpy": blas.get("numpy"),
        "BLAS of scipy": blas.get("scipy"),
        "BLAS kernel": blas.get("kernel"),
        "BLAS threads": ", ".join(f"{name}={count}" for name, count in threads.items()),
        "processor": machine.get("processor"),
        "processors": machine.get("processors"),
        "machine": machine.get("machine"),
        "system": machine.get("system"),
    }
    return {name: str(value) for name, value in facts.items() if value not in (None, "")}


def facts(record: Mapping[str, Any]) -> dict[str, str]:
    """Entries of a record about a run, by name, its environment included."""
    cells = cells_of(record)
    times = (number(cell, "wall_seconds") for cell in cells)
    seconds = [time for time in times if not math.isnan(time)]
    return {
        "finished": str(record.get("finished", UNKNOWN)),
        "cells": counted(str(cell.get("status")) for cell in cells) or "0",
        "wall time": (
            f"{sum(seconds):.3g} s of all cells together, {max(seconds, default=0):.3g} s of the "
            f"slowest, {record['jobs']} side by side"
            if "jobs" in record
            else UNKNOWN
        ),
        "config SHA-256": str(record.get("config_sha256", UNKNOWN)),
        **{f"{name} SHA-256": digest for name, digest in checksums(record).items()},
        **environment(record),
    }


def cell_rows(record: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table of cells, headings first; columns in which all agree are left out."""
    columns = {axis.name: axis.title for axis in axes.cell_axes() if axis.cell and axis.series}
    cells = cells_of(record)
    varying = {
        key: name
        for key, name in columns.items()
        if key == "problem" or len({str(cell.get(key, "")) for cell in cells}) > 1
    }
    numbers = {
        "operations": "operations", "march_seconds": "march (s)", "wall_seconds": "wall time (s)",
    }  # fmt: skip
    shown = {key: name for key, name in numbers.items() if any(key in cell for cell in cells)}
    rows: list[tuple[str, ...]] = [(*varying.values(), "h", "steps", "status", *shown.values())]
    for cell in cells:
        names = [str(cell.get(key, "")) for key in varying]
        status = " – ".join(str(cell[key]) for key in ("status", "reason") if key in cell)
        values = (number(cell, key) for key in shown)
        texts = ("" if math.isnan(value) else f"{value:.3g}" for value in values)
        rows.append((*names, _number(cell.get("h")), str(cell.get("steps", "")), status, *texts))
    return rows


def description(record: Mapping[str, Any]) -> str:
    """The config's description of the study in one line; empty if there is none."""
    return str(mapping(record, "config").get("description") or "")


def config_text(record: Mapping[str, Any]) -> str:
    """The resolved config as YAML."""
    import yaml

    return yaml.safe_dump(
        record.get("config", {}), sort_keys=False, default_flow_style=None, allow_unicode=True,
        width=100,
    )  # fmt: skip


def checksums(record: Mapping[str, Any]) -> dict[str, str]:
    """File, relative to the results folder → SHA-256, as recorded."""
    return {str(name): str(digest) for name, digest in mapping(record, "sha256").items()}


def number(cell: Mapping[str, Any], key: str) -> float:
    """A number of a cell; NaN where it is not recorded."""
    value = cell.get(key)
    return float(value) if isinstance(value, int | float) else math.nan


def as_text(record: Mapping[str, Any]) -> str:
    """Title and facts in two columns."""
    recorded = facts(record)
    width = max(map(len, recorded))
    title = ": ".join(filter(None, (str(record["study"]), description(record))))
    lines = (f"  {name:<{width}}  {text}" for name, text in recorded.items())
    return "\n".join(map(visible, (title, *lines)))


def agreement(folder: Path, studies: Sequence[str], shipped: Path) -> str:
    """How many studies have the numbers that were shipped, in words; their checksums are JSON."""
    expected = files.parse_json(files.read(shipped))
    unlike = [
        name for name in studies if checksums(known(folder / f"{name}.csv")) != expected.get(name)
    ]
    text = (
        f"{len(studies) - len(unlike)} of {len(studies)} studies: the numbers shipped with "
        f"{newmark_cli.__version__}, bit for bit"
    )
    return f"{text}; not {', '.join(unlike)}" if unlike else text


class Changed(NamedTuple):
    """A file of a results folder that is not what was written."""

    path: Path
    finding: str  #: what was found, in words


def changed(folder: Path, names: Iterable[str]) -> list[Changed]:
    """Files of studies that differ from the checksums in their records.

    A CSV without a record may be anything; ``slopes.csv`` and the tables follow from the others.
    """
    return [entry for name in sorted(names) for entry in _changed(folder, name)]


def _changed(folder: Path, study: str) -> Iterator[Changed]:
    path = folder / f"{study}.csv"
    contents = csv_files.read(path, series=True)
    file, series = path.with_suffix(".json"), csv_files.series_paths(path)
    try:
        recorded = checksums(_parsed(path, contents[file]))
    except ResultsError:
        return
    for csv in (path, *series):
        content, name = contents[csv], csv.relative_to(folder).as_posix()
        there = csv is path or not isinstance(content, FileNotFoundError)
        finding = _finding(content, recorded.get(name), file.name)
        if finding and (there or name in recorded):
            yield Changed(csv, finding)
    for name in recorded:
        if folder / name not in (path, *series):
            yield Changed(file, f"names {name!r}, which is not a file of this study")


def _finding(content: bytes | OSError, recorded: str | None, described: str) -> str:
    if recorded is None:
        return f"not in {described}"
    if isinstance(content, FileNotFoundError):
        return "missing"
    if isinstance(content, OSError):
        return f"cannot be read: {content.strerror}"
    return "" if checksum(content) == recorded else "differs from its record"


def problem_files(record: Mapping[str, Any]) -> dict[str, str]:
    """File of a problem of the user's → SHA-256 of what it said, as recorded."""
    sums = mapping(record, "problem_files")
    return {
        f"{file if file == label else f'{file} of {label}'} SHA-256": str(digest)
        for label in sums
        for file, digest in mapping(sums, label).items()
    }


def cells_of(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Cells of a run, as its record has them."""
    return [cell for cell in listed(record, "cells") if isinstance(cell, dict)]


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value or "")
