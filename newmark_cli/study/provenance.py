"""The records of a CSV: config, cells, checksums; and of its run: code, machine, wall times."""

import hashlib
import importlib
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import newmark_cli
from newmark_cli.study import axes, checkout, csv_files, csv_rows, shipped
from newmark_cli.study.axes import Cell, cell_axes
from newmark_cli.study.axis import label
from newmark_cli.study.cell import Done, Outcome
from newmark_cli.study.checkout import Source
from newmark_cli.support.processors import usable

if TYPE_CHECKING:
    from newmark_cli.study.config import Study

_PACKAGES = (
    "numpy", "scipy", "numba", "llvmlite", "pandas", "matplotlib", "pydantic", "PyYAML", "click",
)  # fmt: skip

#: Version of an installed package; its metadata take as long to parse as a small cell to run.
version = cache(metadata.version)

#: Variables that say how many threads a BLAS takes; `newmark_cli.cli.main` sets them.
THREAD_VARIABLES = tuple(f"{library}_NUM_THREADS" for library in ("OPENBLAS", "MKL", "OMP"))


def record(
    study: "Study",
    cells: Sequence[Cell],
    outcomes: Sequence[Outcome],
    rows: int,
    checksums: Mapping[str, str],
) -> dict[str, Any]:
    """Provenance of results as far as it is the same wherever and whenever they are computed."""
    config = resolved(study)
    return {
        "study": study.study,
        "config": config,
        "config_sha256": config_checksum(config),
        "rows": rows,
        "sha256": dict(checksums),
        "cells": [
            _known(
                **{name: labels[name] for name in axes.present(labels, [labels])},
                steps=cell.steps,
                status=outcome.status,
                reason=outcome.reason,
                lacks=list(outcome.lacks),
                pivoted_steps=outcome.pivoted or None,
                operations=outcome.operations,
            )
            for cell, outcome in zip(cells, outcomes, strict=True)
            for labels in (axes.labels(cell),)
        ],
    }


def resolved(study: "Study") -> dict[str, Any]:
    """The config of a study with all that it leaves out, as records have it."""
    config = study.model_dump(mode="json", by_alias=True, exclude_none=True)
    for case, recorded in zip(study.cases, config["cases"], strict=True):
        # As in CSVs, so that a new axis changes no record that has nothing of it.
        for axis in cell_axes():
            if axis.rare and [label(of) for of in axis.values(case)] == [axis.usual]:
                del recorded[axis.name]
    return config


def config_checksum(config: Mapping[str, Any]) -> str:
    """SHA-256 of a config as records have it, whatever the order of its keys."""
    return checksum(json.dumps(config, sort_keys=True, separators=(",", ":")))


def run(
    study: "Study", ended: Sequence[Done], jobs: int, checksums: Mapping[str, str], folder: Path
) -> dict[str, Any]:
    """Provenance of one run of a study: when, by what, where, and how long it took.

    Code and machine are those that write the CSV.  A cell that was kept from an
    earlier run has the same numerical core and libraries, but may have been computed
    at another commit or on another machine.
    """
    file, lines = study.expected_at
    return {
        "study": study.study,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "newmark-study": newmark_cli.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in _PACKAGES},
        },
        "source": source(),
        "blas": blas(),
        "platform": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "processor": processor(),
            "processors": usable(),
        },
        "jobs": jobs,
        **_known(
            config_file=_origin(study, folder),
            expect={"file": file, "lines": list(lines)} if lines else None,
        ),
        "sha256": dict(checksums),
        "cells": [
            _known(
                wall_seconds=round(done.seconds, 4),
                march_seconds=done.march_seconds and float(f"{done.march_seconds:.4g}"),
            )
            for done in ended
        ],
    }


def _known(**facts: Any) -> dict[str, Any]:
    """Facts, without those that there are none of."""
    return {name: fact for name, fact in facts.items() if fact not in (None, "", [])}


def _origin(study: "Study", folder: Path) -> str:
    """The file of a study from its results folder, so that both may move; see `Study.origin`."""
    if os.sep not in study.origin:
        return study.origin
    path = Path(os.path.relpath(study.origin, folder.resolve())).as_posix()
    return path.encode("utf-8", "replace").decode()


def other_origin(study: "Study", folder: Path) -> str:
    """The config whose results a study would overwrite, in words; empty where it is its own.

    A file that was edited is the same config, and so is a copy with the same content.  Where
    the recorded file is gone, nobody knows of another one.
    """
    record, run = (
        csv_rows.parsed(content)
        for content in csv_files.read_records(folder / f"{study.study}.csv")
    )
    if not record or record.get("config_sha256") == config_checksum(resolved(study)):
        return ""
    recorded = merged(record, run).get("config_file")
    if not isinstance(recorded, str):
        is_shipped = shipped.is_shipped(study.study, record.get("config"))
        recorded = study.study if is_shipped else ""
    if recorded in ("", study.origin):
        return ""
    if recorded == study.study:
        return "the shipped study"
    file = os.path.normpath(folder.resolve() / recorded)
    return "" if file == study.origin or not os.path.isfile(file) else os.path.relpath(file)


def merged(record: Mapping[str, Any], run: Mapping[str, Any]) -> dict[str, Any]:
    """A record with that of its run; by itself where the run was another.

    Records of older versions have both in one.
    """
    of_run, of_results = csv_rows.listed(run, "cells"), csv_rows.listed(record, "cells")
    same = 0 < len(of_run) == len(of_results) and run.get("sha256") == record.get("sha256")
    if not (same and all(isinstance(cell, dict) for cell in (*of_run, *of_results))):
        return dict(record)
    cells = [{**result, **of_cell} for result, of_cell in zip(of_results, of_run, strict=True)]
    return {**run, **record, "cells": cells}


def checksum(content: str | bytes) -> str:
    """SHA-256 of a file's content, text in UTF-8, as hexadecimal digits."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


@cache
def source() -> Source:
    """Commit that the package runs from.

    Of the checkout that holds the package, with ``modified`` where its code or its
    shipped configs differ from the commit; else what was stamped into the package when
    it was built; else what the installer noted (PEP 610); None where nobody knows.
    """
    package = Path(newmark_cli.__file__).parent
    known = checkout.asked(package) or checkout.stamped(package)
    return known or Source(commit=_installed_commit(), modified=None)


def _installed_commit() -> str | None:
    try:
        noted = distribution("newmark-study").read_text("direct_url.json")
        return str(json.loads(noted)["vcs_info"]["commit_id"]) if noted else None
    except (PackageNotFoundError, ValueError, KeyError, TypeError):
        return None


def blas() -> dict[str, Any]:
    """BLAS that numpy and scipy were built with, what runs, and the threads that it may take.

    A variable that is not set leaves the number to the BLAS: None.
    """
    return {
        "numpy": _blas_of(np.show_config(mode="dicts")),
        "scipy": _blas_of(importlib.import_module("scipy").show_config(mode="dicts")),
        "loaded": _listed(
            " ".join(filter(None, (library["internal_api"], library["version"])))
            for library in _loaded()
        ),
        "kernel": blas_kernel(),
        "threads": {name: os.environ.get(name) for name in THREAD_VARIABLES},
    }


def blas_kernel() -> str:
    """Type of processor that the loaded libraries compute for, which decides their last digits.

    They choose it as they are loaded, by the processor or by variables such as
    ``OPENBLAS_CORETYPE``; "unknown" where they do not tell.
    """
    return _listed(library.get("architecture") or "unknown" for library in _loaded())


def _listed(facts: Iterable[str]) -> str:
    return ", ".join(sorted(set(facts))) or "unknown"


@cache
def _loaded() -> list[dict[str, Any]]:
    """Facts about each BLAS in this process."""
    importlib.import_module("scipy.linalg")  # brings its own
    from threadpoolctl import threadpool_info

    return [library for library in threadpool_info() if library["user_api"] == "blas"]


def _blas_of(build: Any) -> str | None:
    library = build.get("Build Dependencies", {}).get("blas", {})
    return " ".join(filter(None, (library.get("name"), library.get("version")))) or None


def processor() -> str:
    """Model of the processor, or what the platform calls it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(models), "") or platform.processor() or platform.machine()
