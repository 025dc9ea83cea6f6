"""Running studies: what is kept is not computed again, the rest side by side."""

import contextlib
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from newmark_cli.codes.given_references import ReferenceFile
from newmark_cli.mechanisms.spec import (
    Code,
    MechanismFile,
    ProblemSpec,
    beside,
    is_code,
    with_problem,
)
from newmark_cli.newmark.linear.choice import DENSE, DENSE_UP_TO
from newmark_cli.problems import reference
from newmark_cli.problems.reference import NoReference, Reference
from newmark_cli.running import executors
from newmark_cli.running.executors import Execution, Places, Task
from newmark_cli.running.lock import locked
from newmark_cli.running.references import References
from newmark_cli.running.store import Store, file_name
from newmark_cli.study import csv_files, motion, provenance, trajectories
from newmark_cli.study.axes import Cell, present
from newmark_cli.study.cell import Done, Outcome
from newmark_cli.study.config import Study
from newmark_cli.support import apart, files, interrupts
from newmark_cli.support.errors import InputError


@dataclass(frozen=True)
class Options:
    """How studies are run."""

    jobs: int  #: most threads, and most processes
    force: bool = False  #: whether kept cells and references are computed again
    fail_fast: bool = False  #: whether the first cell that does not end well ends the run
    timeout: float | None = None  #: most wall time of a cell (s)
    executor: str = "local"  #: ``local`` or ``dask``
    scheduler: str | None = None  #: address of a dask scheduler
    parquet: bool = False  #: whether trajectories are written as Parquet, not as CSV
    timed: bool = False  #: whether the march of each cell that is computed is timed by itself
    replace: bool = False  #: whether a study may overwrite the results of another of its name


@dataclass(frozen=True)
class Planned:
    """A cell of a study before it runs."""

    study: int  #: which of the studies, counted from 0
    cell: Cell  #: the cell
    done: Done | None  #: what is kept of it, if anything
    why: str = ""  #: why it is to run, if it is


@dataclass(frozen=True)
class StudyRun:
    """How one study went."""

    study: str  #: its name
    path: Path | None  #: its CSV; None where cells were skipped
    statuses: tuple[str, ...]  #: status of each cell; ``skipped`` where it has not run
    #: A line for each distinct way in which cells did not end well, or lack what they were to
    #: measure, except with a status that the study accepts.
    complaints: tuple[str, ...]
    kept: int  #: cells that had been computed before


class Watcher:
    """Follows what happens while studies run; this one does nothing."""

    def planned(self, plan: Sequence[Planned]) -> None:
        """Cells to compute, and cells that are cached."""

    def steps(self, steps: int) -> None:
        """So many steps were done; from any thread."""

    def announced(self, line: str) -> None:
        """Where the cells run, or what the run waits for."""

    def finished(self, cell: Cell, done: Done) -> None:
        """A cell has ended."""


def plan(studies: Sequence[Study], folder: Path, force: bool = False) -> list[Planned]:
    """Every cell of studies, with what is kept of it, or why it is to run."""
    _require_distinct(studies)
    store = Store(folder)
    planned = []
    for s, study in enumerate(studies):
        for cell in study.cells():
            kept = store.find(cell)
            why = store.why(cell) if kept is None else "forced" if force else ""
            planned.append(Planned(s, cell, None if why else kept, why))
    return planned


def _require_distinct(studies: Sequence[Study]) -> None:
    names = [study.study for study in studies]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise InputError(f"two studies are named {name!r}; each needs its own CSV")


def _require_own(studies: Sequence[Study], folder: Path) -> None:
    """Refuse to overwrite the results of another config."""
    for study in studies:
        if other := provenance.other_origin(study, folder):
            raise InputError(
                f"{folder / study.study}.csv: has the results of {other}, another config with "
                f"'study: {study.study}'; rename one, give another --results, or run with --replace"
            )


def run_studies(
    studies: Sequence[Study], folder: Path, options: Options, watcher: Watcher | None = None
) -> list[StudyRun]:
    """Run studies and write a CSV and its provenance for each.

    Finished cells are kept at once, so that whatever ends the run, only those in
    flight are lost.  A study is written when its last cell is done, its cells in the
    config's order.

    Raises:
        InputError: Two studies have one name, the results of another config have it, or
            the folder cannot be written or is in use.
        ExecutorError: The executor is lost; what was finished is kept.
    """
    watcher = watcher or Watcher()
    if options.parquet:
        files.require_parquet("--trajectories parquet")
    with _held(studies, folder):
        if not options.replace:
            _require_own(studies, folder)
        store = Store(folder)
        places = Places()
        solve = partial(_solution, timeout=options.timeout, places=places)
        references = References(folder, solve, options.force)
        planned = [
            _looked_after(entry, references, store)
            for entry in plan(studies, folder, options.force)
        ]
        watcher.planned(planned)
        open_runs = _OpenRuns(studies, folder, options, planned)
        for i, entry in enumerate(planned):
            if entry.done is not None:
                open_runs.took(i, entry.done)
        if options.fail_fast and open_runs.complains(range(len(planned))):
            return open_runs.close()
        sharing = _shared(planned)
        cells = {i: planned[i].cell for i in sharing}
        missing: dict[int, str] = {}
        tasks = {
            i: Task(cells[i], timed=options.timed)
            for i in sorted(cells, key=lambda i: -_cost(cells[i]))
        }
        referred = partial(_referred, tasks, references, missing)
        wanted = [partial(references.sought, *of) for of in _wanted(cells.values())]
        with _execution(tasks, wanted, referred, options, watcher, places) as finished:
            for i, result in finished:
                done = _without_reference(result, missing[i]) if i in missing else result
                with interrupts.postponed():  # a cell that is kept is counted as kept
                    store.keep(planned[i].cell, done)
                    watcher.finished(planned[i].cell, done)
                    for place in sharing[i]:
                        open_runs.took(place, done)
                if options.fail_fast and open_runs.complains(sharing[i]):
                    break
        return open_runs.close()


def _shared(planned: Sequence[Planned]) -> dict[int, list[int]]:
    """Place of a cell to compute → all places with the same cell."""
    sharing: dict[str, list[int]] = {}
    for i, entry in enumerate(planned):
        if entry.done is None:
            sharing.setdefault(file_name(entry.cell), []).append(i)
    return {places[0]: places for places in sharing.values()}


def _wanted(cells: Iterable[Cell]) -> list[tuple[ProblemSpec, float, ReferenceFile | None]]:
    """Each reference that cells take their errors from, once."""
    wanted = (
        (cell.problem, cell.reached, cell.reference) for cell in cells if "error" in cell.measure
    )
    return list(dict.fromkeys(wanted))


def _referred(
    tasks: Mapping[int, Task], references: References, missing: dict[int, str], name: int
) -> Task:
    """A task with the solution that its errors are taken from, or why there is none."""
    task = tasks[name]
    if "error" not in task.cell.measure:
        return task
    try:
        solution = references.of(task.cell.problem, task.cell.reached, task.cell.reference)
    except NoReference as error:
        missing[name] = str(error)
        return task
    return replace(task, reference=solution)


@contextlib.contextmanager
def _held(studies: Sequence[Study], folder: Path) -> Iterator[None]:
    """Lock a results folder, and require that everything in it can be written."""
    _require_distinct(studies)
    names = [study.study for study in studies]
    files = [f"{name}{suffix}" for name in names for suffix in (".csv", ".json")]
    csv_files.require_writable(folder, files)
    for name in ("cells", "references", csv_files.RUNS, *csv_files.SERIES_FOLDERS):
        part = folder / name
        if part.exists():
            csv_files.require_writable(part, ())
    with locked(folder, f"run {' '.join(names)}"):
        Store(folder).prepare()
        yield


def _solution(spec: ProblemSpec, t: float, timeout: float | None, places: Places) -> Reference:
    """A reference within the time limit; user code runs in a process."""
    where = f"{spec.label}: no reference at t = {t:g}"
    start = time.perf_counter()

    def watch() -> None:
        if places.stopped():
            raise apart.Stopped
        if timeout is not None and time.perf_counter() - start > timeout:
            raise NoReference(f"{where}: took longer than {timeout:g} s")

    def here() -> Reference:
        return reference.solution(spec.load(), t, watch)

    def there() -> Reference:
        how: dict[str, Any] = {"timeout": timeout, "stopped": places.stopped}
        try:
            return beside(spec, reference.solution, t, **how)
        except apart.ApartError as error:
            raise NoReference(f"{where}: {error}") from None

    return there() if is_code(spec) else places.call(here, there)


def _looked_after(planned: Planned, references: References, store: Store) -> Planned:
    """Schedule a kept cell again once its missing reference can be computed."""
    if planned.done is None or not planned.done.outcome.lacks:
        return planned
    try:
        references.of(planned.cell.problem, planned.cell.reached, planned.cell.reference)
    except NoReference as error:
        done = _without_reference(planned.done, str(error))
        if done.outcome.lacks != planned.done.outcome.lacks:
            store.keep(planned.cell, done)
        return replace(planned, done=done)
    return replace(planned, done=None, why="its reference can be computed now")


def _without_reference(done: Done, reason: str) -> Done:
    """Note why the errors of a cell are empty, if it got far enough to measure them."""
    if not any(row.measure == "error" for row in done.outcome.measurements):
        return done
    return replace(done, outcome=replace(done.outcome, lacks=(reason,)))


@contextlib.contextmanager
def _execution(
    tasks: Mapping[int, Task],
    wanted: Sequence[Callable[[], None]],
    referred: Callable[[int], Task],
    options: Options,
    watcher: Watcher,
    places: Places,
) -> Iterator[Execution]:
    if not tasks:
        yield iter(())
        return
    cells = "1 cell" if len(tasks) == 1 else f"{len(tasks)} cells"
    if options.executor == "dask":
        from newmark_cli.running.cluster import cluster

        tasks = {name: referred(name) for name in tasks}
        watcher.announced(f"{cells} on the workers of {options.scheduler or 'this machine'}")
        where, limits = options.scheduler, (options.jobs, options.timeout)
        with cluster(tasks, where, *limits, watcher.steps, watcher.announced) as running:
            yield running
    else:
        own = sum(is_code(task.cell.problem) for task in tasks.values())
        at_a_time = min(options.jobs, own) + min(options.jobs, len(tasks) - own)
        watcher.announced(f"{cells}, {at_a_time} at a time")
        how = options.jobs, options.timeout, watcher.steps, places
        with executors.local(tasks, wanted, referred, *how) as running:
            yield running


class _OpenRuns:
    """Studies in progress; each is written when it is complete."""

    def __init__(
        self, studies: Sequence[Study], folder: Path, options: Options, planned: Sequence[Planned]
    ) -> None:
        self._studies, self._folder, self._options = studies, folder, options
        self._planned = planned
        self._places = [
            [i for i, entry in enumerate(planned) if entry.study == s] for s in range(len(studies))
        ]
        self._done: dict[int, Done] = {}
        self._paths: dict[int, Path] = {}

    def took(self, place: int, done: Done) -> None:
        """A cell is there."""
        self._done[place] = done
        study = self._planned[place].study
        ended = [self._done[i] for i in self._places[study] if i in self._done]
        if len(ended) == len(self._places[study]):
            self._paths[study] = _write(self._studies[study], self._folder, ended, self._options)

    def complains(self, places: Iterable[int]) -> bool:
        """Whether one of these cells, if it is there, did not end well."""
        there = (i for i in places if i in self._done)
        return any(_complaints(self._planned[i].cell, self._done[i].outcome) for i in there)

    def close(self) -> list[StudyRun]:
        """How the studies went."""
        return [self._run(s) for s in range(len(self._studies))]

    def _run(self, study: int) -> StudyRun:
        places = self._places[study]
        ended = [(self._planned[i].cell, self._done.get(i)) for i in places]
        complaints = Counter(
            text for cell, done in ended if done for text in _complaints(cell, done.outcome)
        )
        return StudyRun(
            self._studies[study].study,
            self._paths.get(study),
            tuple(done.outcome.status if done else "skipped" for _, done in ended),
            tuple(
                f"{count} of {len(places)} cells {how}{_sizes(ended) if how == _COARSE else ''}"
                for how, count in complaints.items()
            ),
            sum(self._planned[i].done is not None for i in places),
        )


#: A complaint about cells whose step size may be too large.
_COARSE = "ended with status not_converged"


def _sizes(ended: Iterable[tuple[Cell, Done | None]]) -> str:
    """Step sizes at which Newton's iteration converged and did not, and what that advises."""
    statuses: dict[float, set[str]] = {}
    for cell, done in ended:
        if done:
            statuses.setdefault(cell.h, set()).add(done.outcome.status)
    missed = [h for h in sorted(statuses, reverse=True) if "not_converged" in statuses[h]]
    met = [h for h in sorted(statuses, reverse=True) if statuses[h] == {"ok"}]
    texts = [", ".join(f"{h:g}" for h in sizes) for sizes in (missed, met)]
    text = f", at h = {texts[0]}" + (f"; all converged at h = {texts[1]}" if met else "")
    if met and max(met) < min(missed):
        return f"{text}: a smaller h helps"
    return f"{text}; a smaller h may help" if min(missed) == min(statuses) else text


def _complaints(cell: Cell, outcome: Outcome) -> list[str]:
    """How a cell did not end well, in phrases whose subject is cells."""
    complaints = []
    if outcome.status not in ("ok", *cell.accept):
        how = "failed" if outcome.status == "failed" else f"ended with status {outcome.status}"
        complaints.append(f"{how}: {outcome.reason}" if outcome.reason else how)
    return complaints + [f"measured no error: {reason}" for reason in outcome.lacks]


def _cost(cell: Cell) -> int:
    # The longest start first.  Dense elimination takes unknowns cubed; the others grow
    # with the unknowns, and are as fast where `AUTO` goes over to them.
    problem = cell.problem.load()
    unknowns = sum(cell.formulated.sizes(problem.n, problem.m))
    per_unknown = unknowns if cell.solver == DENSE else DENSE_UP_TO
    return cell.weight * unknowns * per_unknown**2


def _write(study: Study, folder: Path, ended: Sequence[Done], options: Options) -> Path:
    cells = study.cells()
    outcomes = [done.outcome for done in ended]
    path = folder / f"{study.study}.csv"
    table = csv_files.rows(study.study, cells, outcomes)
    columns = present(csv_files.COLUMNS, table)
    texts: dict[Path, str | bytes] = {path: csv_files.csv_text(columns, table)}
    kept = trajectories.table(study.study, cells, outcomes)
    if kept is not None:
        file = csv_files.trajectory_path(folder, study.study, parquet=options.parquet)
        texts[file] = trajectories.parquet(kept) if options.parquet else trajectories.csv(kept)
    checksums = {
        file.relative_to(folder).as_posix(): provenance.checksum(text)
        for file, text in texts.items()
    }
    record = provenance.record(study, cells, outcomes, len(table), checksums)
    run = provenance.run(study, ended, options.jobs, checksums, folder)
    known = _of_problems(cells, options.timeout)
    record |= {key: facts for key, facts in known.items() if facts}
    with interrupts.postponed():
        csv_files.replace(folder, study.study, texts, record, run)
    return path


def _of_problems(cells: Sequence[Cell], timeout: float | None) -> dict[str, dict[str, Any]]:
    """Facts of problems for verdicts, figures and readers, by kind and problem."""
    longest: dict[ProblemSpec, tuple[float, float]] = {}
    for cell in cells:
        if cell.steps > 0:
            t_end, h = longest.get(cell.problem, (0.0, math.inf))
            longest[cell.problem] = max(t_end, cell.reached), min(h, cell.h)
    facts = {spec.label: _facts(spec, *of, timeout) for spec, of in longest.items()}
    known: dict[str, dict[str, Any]] = {
        "motions": {
            label: {"singular": list(of_motion.singular), "still": of_motion.still}
            | ({"driven": True} if of_motion.driven else {})
            for label, of_motion in facts.items()
            if of_motion != motion.Facts()
        },
        "problem_files": {},
        "titles": {},
        "not_unique": {},
    }
    for spec in dict.fromkeys(cell.problem for cell in cells):
        problem = spec.load()
        if isinstance(spec, MechanismFile | Code):
            sources = sorted(problem.sources.items())
            known["problem_files"][spec.label] = {
                name: provenance.checksum(text) for name, text in sources
            }
        if isinstance(spec, MechanismFile) and (title := spec.file.document().data.get("title")):
            known["titles"][spec.label] = title
        if problem.outputs is not None and problem.outputs.not_unique:
            known["not_unique"][spec.label] = {
                "outputs": list(problem.outputs.not_unique),
                "released": list(problem.released),
            }
    return known


def _facts(spec: ProblemSpec, t_end: float, h: float, timeout: float | None) -> motion.Facts:
    try:
        return with_problem(spec, motion.facts, t_end, h, timeout=timeout)
    except apart.ApartError:  # the status of the cells says why
        return motion.Facts()
