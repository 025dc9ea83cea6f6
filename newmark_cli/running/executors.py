"""Where cells run: this process, others beside it, or the workers of a dask scheduler.

An executor takes cells and yields the outcome of each as it finishes; it writes nothing.
An error in a cell is a status of the cell; an error of the executor ends the run.
"""

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from newmark_cli.mechanisms.spec import ProblemSpec, is_code, owner
from newmark_cli.problems import user_code
from newmark_cli.problems.reference import Reference
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Done, Outcome
from newmark_cli.study.compute import compute, march_seconds, prepare
from newmark_cli.study.replay import replayed
from newmark_cli.support import apart
from newmark_cli.support.errors import InputError


@dataclass(frozen=True)
class Task:
    """A cell with what it needs to run."""

    cell: Cell  #: the cell
    #: Solution that its errors are taken from, if it measures any.
    reference: Reference | None = None
    timed: bool = False  #: whether its march is timed by itself, too

    def of(self, problem: ProblemSpec) -> "Task":
        """The same task, with its problem in the shape that travels."""
        return replace(self, cell=replace(self.cell, problem=problem))


_Result = TypeVar("_Result")
#: Gives each finished task by its name, in the order of finishing.
Execution = Iterator[tuple[int, Done]]


#: How long a run is young (s): as long as two processes take to start.
_YOUNG = 5.0


class Places:
    """Where the work of a run is done: in threads while it is young, then in processes, too.

    Two threads of one process compute hardly faster than one where much is Python, as in
    references and in short cells; a process takes seconds to start.
    """

    def __init__(self) -> None:
        """The run begins."""
        self._begun, self._here = time.monotonic(), threading.Lock()
        self._stopped = threading.Event()

    def stop(self) -> None:
        """The run has ended: nobody waits for its work."""
        self._stopped.set()

    def stopped(self) -> bool:
        """Whether the run has ended."""
        return self._stopped.is_set()

    def call(self, here: Callable[[], _Result], beside: Callable[[], _Result]) -> _Result:
        """Result of what can be called in this process, or through one beside it."""
        if time.monotonic() - self._begun < _YOUNG:
            return here()
        if not self._here.acquire(blocking=False):
            return beside()
        try:
            return here()
        finally:
            self._here.release()


class _Overtime(Exception):
    """The cell exceeds its time limit."""


def perform(
    task: Task, timeout: float | None = None, on_steps: Callable[[int], None] = lambda steps: None
) -> Done:
    """Run one cell; what goes wrong inside becomes its status.

    Wall time (s) is looked at between two stretches of the march, when steps are told.
    """
    start = time.perf_counter()

    def checked(steps: int) -> None:
        on_steps(steps)
        if timeout is not None and time.perf_counter() - start > timeout:
            raise _Overtime

    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            if not isinstance(task.cell.code, str):
                outcome, seconds = replayed(task.cell, task.reference, checked)
                return Done(outcome, time.perf_counter() - start, seconds)
            prepare(task.cell)
            start = time.perf_counter()
            outcome = compute(task.cell, task.reference, checked)
            done = Done(outcome, time.perf_counter() - start)
            if task.timed:
                done = replace(done, march_seconds=march_seconds(task.cell, on_steps))
            return done
    except (apart.Stopped, InputError):
        raise
    except _Overtime:
        assert timeout is not None
        outcome = overtime(timeout)
    except np.linalg.LinAlgError as error:
        outcome = Outcome([], 0, np.nan, "singular", user_code.described(error))
    except BaseException as error:  # user code may also exit
        if user_code.is_interrupt(error):
            raise
        problem = task.cell.problem
        outcome = failed(user_code.described(error, problem.label if problem.load().code else ""))
    return Done(outcome, time.perf_counter() - start)


def overtime(timeout: float) -> Outcome:
    """Outcome of a cell that exceeds its time (s)."""
    return failed(f"took longer than {timeout:g} s")


def failed(reason: str) -> Outcome:
    """Outcome of a cell that fails."""
    return Outcome([], 0, np.nan, "failed", reason)


def perform_apart(
    task: Task, timeout: float | None, stopped: Callable[[], bool] = lambda: False
) -> Done:
    """Run one cell in a separate process, which is that of other problems only without code.

    Args:
        task: The cell, with its problem as it travels; what goes wrong inside, or with its
            process, becomes its status.
        timeout: Most wall time (s), after which its process is ended.
        stopped: Whether the run has ended.

    Raises:
        InputError: When the cell asks for something that does not exist.
    """
    start = time.perf_counter()
    # Of our own marches the time for compiling does not count, and they can end themselves.
    within, until = (None, timeout) if is_code(task.cell.problem) else (timeout, None)
    whose = owner(task.cell.problem)
    try:
        done: Done = apart.call(perform, (task, within), until, whose, stopped)
        return done
    except apart.TookLonger:
        assert timeout is not None
        return Done(overtime(timeout), timeout)
    except apart.ApartError as error:
        return Done(failed(str(error)), time.perf_counter() - start)


@contextmanager
def local(
    tasks: Mapping[int, Task],
    wanted: Sequence[Callable[[], None]],
    referred: Callable[[int], Task],
    jobs: int,
    timeout: float | None,
    on_steps: Callable[[int], None],
    places: Places,
) -> Iterator[Execution]:
    """This machine: user code in separate processes, everything else wherever there is a place.

    Leaving the context ends what still runs: threads between two stretches, and
    processes at once.

    Args:
        tasks: In the order in which they start.
        wanted: What starts before them: computes references that some of them need.
        referred: A task with its reference, by its name; waits until that is there.
        jobs: Most tasks of user code, and most others, at a time.
        timeout: Most wall time of a cell (s); a process is ended, whatever it does.
        on_steps: Called from any thread with the number of steps done.
        places: Those of the run.
    """

    def checked(steps: int) -> None:
        on_steps(steps)
        if places.stopped():
            raise apart.Stopped

    def beside(task: Task) -> Done:
        done = perform_apart(task, timeout, places.stopped)
        on_steps(task.cell.weight)
        return done

    def apart_from_others(name: int) -> Done:
        return beside(referred(name))

    def somewhere(name: int) -> Done:
        task = referred(name)
        if not isinstance(task.cell.code, str):  # it has a process of its own
            return perform(task, timeout, checked)
        return places.call(lambda: perform(task, timeout, checked), lambda: beside(task))

    code = {name: task for name, task in tasks.items() if is_code(task.cell.problem)}
    own = _together(code)
    threads = ThreadPoolExecutor(max_workers=jobs)
    waiting = ThreadPoolExecutor(max_workers=max(min(jobs, len(own)), 1))
    try:
        ahead = [threads.submit(piece) for piece in wanted]
        futures = {waiting.submit(apart_from_others, name): name for name in own}
        futures |= {threads.submit(somewhere, name): name for name in tasks if name not in own}
        yield _finished(futures, ahead)
    finally:
        places.stop()
        for pool in (waiting, threads):
            pool.shutdown(wait=False, cancel_futures=True)
        waiting.shutdown()
        threads.shutdown()


def _finished(futures: Mapping[Future[Done], int], ahead: Sequence[Future[None]]) -> Execution:
    every: list[Future[Any]] = [*ahead, *futures]
    for future in as_completed(every):
        result = future.result()
        if future in futures:
            yield futures[future], result


def _together(tasks: Mapping[int, Task]) -> dict[int, Task]:
    """Tasks reordered so that cells of one problem are adjacent: they share processes."""
    first: dict[Any, int] = {}
    for place, task in enumerate(tasks.values()):
        first.setdefault(task.cell.problem, place)
    return dict(sorted(tasks.items(), key=lambda item: first[item[1].cell.problem]))
