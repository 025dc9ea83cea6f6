"""Where cells run: threads, processes, or the workers of a dask scheduler.

An executor takes cells and gives back what each found as it finishes; it neither
keeps nor writes anything.  What goes wrong in a cell is a status of the cell; what
goes wrong with the executor ends the run.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess

import numpy as np

from newmark_cli import interrupts
from newmark_cli.errors import InputError
from newmark_cli.mechanisms.spec import ProblemSpec, pinned
from newmark_cli.problems import user_code
from newmark_cli.problems.reference import Reference
from newmark_cli.running.child import end_with_parent, leave_signals_to_parent
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Done, Outcome
from newmark_cli.study.compute import compute


@dataclass(frozen=True)
class Task:
    """A cell with what it needs beside itself.

    Attributes:
        cell: The cell.
        reference: Solution that its errors are taken from, if it measures any.
    """

    cell: Cell
    reference: Reference | None = None

    def of(self, problem: ProblemSpec) -> "Task":
        """The same task, with its problem in the shape that travels."""
        return replace(self, cell=replace(self.cell, problem=problem))


#: No exit code of a process.
_ENDED_WELL = 256

#: Seconds that an interrupt waits for threads.
_PATIENCE = 1.0

#: Gives each finished task by its name, in the order of finishing.
Execution = Iterator[tuple[int, Done]]


class _Stopped(Exception):
    """The run has ended; raised inside a cell between two stretches."""


class _Overtime(Exception):
    """The cell has taken longer than it may."""


def perform(
    task: Task,
    timeout: float | None = None,
    on_steps: Callable[[int], None] = lambda steps: None,
) -> Done:
    """Run one cell; what goes wrong inside becomes its status.

    Args:
        task: The cell.
        timeout: Most wall time (s), looked at between two stretches of the march.
        on_steps: Told how many steps were done, now and then.

    Raises:
        InputError: When the cell asks for what there is not.
    """
    start = time.perf_counter()

    def checked(steps: int) -> None:
        on_steps(steps)
        if timeout is not None and time.perf_counter() - start > timeout:
            raise _Overtime

    try:
        with np.errstate(all="ignore"):  # what is not finite becomes a status
            outcome = compute(task.cell, task.reference, checked)
    except (_Stopped, InputError, KeyboardInterrupt):
        raise
    except _Overtime:
        assert timeout is not None
        outcome = overtime(timeout)
    except np.linalg.LinAlgError as error:
        outcome = Outcome([], 0, np.nan, "singular", user_code.described(error))
    except BaseException as error:  # an exit of the user's code included
        problem = task.cell.problem
        outcome = failed(user_code.described(error, problem.label if problem.load().code else ""))
    return Done(outcome, time.perf_counter() - start)


def overtime(timeout: float) -> Outcome:
    """What becomes of a cell that takes longer than it may (s)."""
    return failed(f"took longer than {timeout:g} s")


def failed(reason: str) -> Outcome:
    """What becomes of a cell that does not end by itself."""
    return Outcome([], 0, np.nan, "failed", reason)


def wants_process(problem: ProblemSpec) -> bool:
    """Whether a problem holds the interpreter lock: one in plain Python does."""
    return not problem.load().compiled


@contextmanager
def local(
    tasks: Mapping[int, Task],
    jobs: int,
    timeout: float | None,
    on_steps: Callable[[int], None],
) -> Iterator[Execution]:
    """Threads for compiled problems, whose march releases the interpreter lock; processes else.

    Leaving the context ends what still runs: threads between two stretches, and
    processes at once.  An interrupt does not wait long for threads, one of which may be
    compiling: the process then ends without them.

    Args:
        tasks: In the order in which they start.
        jobs: Most threads, and most processes.
        timeout: Most wall time of a cell (s); a process is ended, whatever it does.
        on_steps: Told, from any thread, how many steps were done.
    """
    stopped = threading.Event()

    def checked(steps: int) -> None:
        on_steps(steps)
        if stopped.is_set():
            raise _Stopped

    def threaded(task: Task) -> Done:
        if stopped.is_set():
            raise _Stopped
        return perform(task, timeout, checked)

    apart = {
        name: task.of(pinned(task.cell.problem))
        for name, task in tasks.items()
        if wants_process(task.cell.problem)
    }
    threads, futures = ThreadPoolExecutor(max_workers=jobs), dict[Future[Done], int]()
    waits = True
    try:
        with _processes(jobs, len(apart)) as start:
            futures |= {start(task, timeout): name for name, task in apart.items()}
            futures |= {
                threads.submit(threaded, task): name
                for name, task in tasks.items()
                if name not in apart
            }
            yield _as_done(futures, tasks, apart, timeout, on_steps)
    except KeyboardInterrupt:
        waits = False
        raise
    finally:
        stopped.set()
        threads.shutdown(wait=waits, cancel_futures=True)
        until = time.monotonic() + _PATIENCE
        while any(future.running() for future, name in futures.items() if name not in apart):
            if time.monotonic() > until:
                interrupts.leave_threads()
                break
            time.sleep(0.01)


def _as_done(
    futures: Mapping[Future[Done], int],
    tasks: Mapping[int, Task],
    apart: Mapping[int, Task],
    timeout: float | None,
    on_steps: Callable[[int], None],
) -> Execution:
    from pebble import ProcessExpired

    for future in as_completed(futures):
        name = futures[future]
        try:
            done = future.result()
        except TimeoutError:
            assert timeout is not None
            done = Done(overtime(timeout), timeout)
        except ProcessExpired as error:
            code = 0 if error.exitcode == _ENDED_WELL else error.exitcode
            done = Done(failed(f"its process ended with code {code}"), 0.0)
        if name in apart:
            on_steps(tasks[name].cell.weight)
        yield name, done


class _Worker(SpawnProcess):
    """A process of the pool, which has died if it ends by itself.

    pebble takes code 0 for a good end, and waits for the cell ever after.
    """

    @property
    def exitcode(self) -> int | None:
        code = super().exitcode
        return _ENDED_WELL if code == 0 else code

    def terminate(self) -> None:
        """End the process, which leaves SIGTERM to the one that has started it."""
        self.kill()


class _Context(SpawnContext):
    """Forked, processes would inherit the locks of threads that do not run in them."""

    Process = _Worker


@contextmanager
def _processes(jobs: int, tasks: int) -> Iterator[Callable[[Task, float | None], "Future[Done]"]]:
    """A pool of processes, started with the first task."""
    from pebble import ProcessPool

    pool = ProcessPool(max(min(jobs, tasks), 1), initializer=_prepare, context=_Context())

    def start(task: Task, timeout: float | None) -> Future[Done]:
        with interrupts_held():
            return pool.schedule(perform, args=[task], timeout=timeout)

    try:
        yield start
        pool.close()
        pool.join()
    except BaseException:
        pool.stop()
        pool.join()
        raise


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Interrupts wait; threads and processes that start here leave Ctrl-C to this thread."""
    with interrupts.postponed():
        # The tracker of semaphores must outlive a hangup; started on the way, it would
        # undo what follows.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
        try:
            resource_tracker.ensure_running()
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare() -> None:
    """A process of the pool ends with the one that has started it, and not before."""
    leave_signals_to_parent()
    end_with_parent()
