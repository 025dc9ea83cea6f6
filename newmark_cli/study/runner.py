"""Running studies: cells side by side on threads, results in the config's order."""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.problems.reference import NoReference
from newmark_cli.study import cell as cells_module
from newmark_cli.study import provenance, results
from newmark_cli.study.cell import Cell, Outcome
from newmark_cli.study.config import Study
from newmark_cli.study.references import References


@dataclass(frozen=True)
class StudyRun:
    """How one study went.

    Attributes:
        study: Its name.
        path: Its CSV.
        statuses: Status of each cell.
        failures: Statuses that are neither ok nor accepted by the study.
    """

    study: str
    path: Path
    statuses: tuple[str, ...]
    failures: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether every cell is, or is what the study is about."""
        return not self.failures


class _Stopped(Exception):
    """The run was interrupted; raised inside a cell between two stretches."""


def run_studies(
    studies: Sequence[Study],
    folder: Path,
    jobs: int,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> list[StudyRun]:
    """Run studies and write a CSV and its provenance for each.

    The cells of all studies share the threads; the kernel releases the GIL.
    Long cells start first.  A study is written when its last cell is done.

    Args:
        studies: With distinct names.
        folder: Results folder.
        jobs: Threads.
        on_steps: Told, from any thread, how many steps were done.

    Raises:
        InputError: Two studies have one name, or the folder cannot be written.
    """
    names = [study.study for study in studies]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f"two studies are named {name!r}; each needs a CSV of its own")
    files = [f"{name}{suffix}" for name in names for suffix in (".csv", ".json")]
    results.require_writable(folder, files)

    references = References(folder)
    stopped = threading.Event()

    def checked(steps: int) -> None:
        on_steps(steps)
        if stopped.is_set():
            raise _Stopped

    def timed(cell: Cell) -> tuple[Outcome, float]:
        if stopped.is_set():
            raise _Stopped
        start = time.perf_counter()
        outcome = _guarded(cell, references, checked)
        return outcome, time.perf_counter() - start

    grid = [(s, c, cell) for s, study in enumerate(studies) for c, cell in enumerate(study.cells())]
    done: list[dict[int, tuple[Outcome, float]]] = [{} for _ in studies]
    expected = [sum(1 for s, _, _ in grid if s == i) for i in range(len(studies))]
    runs: dict[int, StudyRun] = {}
    start = time.perf_counter()
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        by_length = sorted(grid, key=lambda entry: -_cost(entry[2]))
        futures = {pool.submit(timed, cell): (s, c) for s, c, cell in by_length}
        try:
            for future in as_completed(futures):
                s, c = futures[future]
                done[s][c] = future.result()
                if len(done[s]) == expected[s]:
                    found = [done[s][i] for i in range(expected[s])]
                    total = time.perf_counter() - start
                    runs[s] = _write(studies[s], folder, found, total, jobs)
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [runs[s] for s in range(len(studies))]


def total_weight(studies: Sequence[Study]) -> int:
    """Steps of all cells together."""
    return sum(cell.weight for study in studies for cell in study.cells())


def _cost(cell: Cell) -> int:
    # The elimination dominates: unknowns cubed.
    return cell.weight * len(FORMS[cell.form].unknowns) ** 3


def _guarded(cell: Cell, references: References, on_steps: Callable[[int], None]) -> Outcome:
    """Run a cell; what goes wrong inside becomes its status."""
    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            reference = None
            if "error" in cell.measure:
                reference = references.of(cell.problem, cell.t_end, lambda: on_steps(0))
            return cells_module.run(cell, reference, on_steps)
    except NoReference as error:
        return Outcome([], 0, np.nan, "failed", str(error))
    except (_Stopped, InputError):
        raise
    except np.linalg.LinAlgError as error:
        return Outcome([], 0, np.nan, "singular", str(error))
    except Exception as error:
        return Outcome([], 0, np.nan, "failed", f"{type(error).__name__}: {error}")


def _write(
    study: Study,
    folder: Path,
    found: Sequence[tuple[Outcome, float]],
    total: float,
    jobs: int,
) -> StudyRun:
    cells = study.cells()
    outcomes = [outcome for outcome, _ in found]
    seconds = [taken for _, taken in found]
    path = folder / f"{study.study}.csv"
    table = results.rows(study.study, cells, outcomes)
    record = provenance.record(study, cells, outcomes, seconds, total, jobs, len(table))
    history = results.history_text(study.study, cells, outcomes)
    if history:
        results.write_atomically(results.history_path(folder, study.study), history)
    results.write_atomically(path, results.csv_text(results.COLUMNS, table))
    results.write_json(path.with_suffix(".json"), record)
    statuses = tuple(outcome.status for outcome in outcomes)
    failures = tuple(
        status
        for cell, status in zip(cells, statuses, strict=True)
        if status not in ("ok", *cell.accept)
    )
    return StudyRun(study.study, path, statuses, failures)
