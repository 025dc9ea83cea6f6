"""Cells on the workers of a dask scheduler, or of one started for this run."""

import logging
import os
import signal
import sys
import tempfile
import uuid
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import Any

from newmark_cli.mechanisms import registry
from newmark_cli.mechanisms.spec import is_code, portable
from newmark_cli.running.executors import Execution, Task, failed, perform, perform_apart
from newmark_cli.running.store import core, unlike, versions
from newmark_cli.study.cell import Done
from newmark_cli.support import interrupts
from newmark_cli.support.errors import ExecutorError, InputError, one_line

#: Configuration of the workers that are started here, over dask's own.
_OWN = {
    # dask gives up a worker that is not back this long after it died; one that dies
    # again and again may be away at that moment.
    "distributed.deploy.lost-worker-timeout": "1000 weeks",
    # Without it, cells wait forever if no worker starts.
    "distributed.scheduler.no-workers-timeout": "60s",
    # dask listens for HTTP even without a dashboard; this answers no request.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


@contextmanager
def cluster(
    tasks: Mapping[int, Task],
    address: str | None,
    jobs: int,
    timeout: float | None,
    on_steps: Callable[[int], None],
    on_wait: Callable[[str], None],
) -> Iterator[Execution]:
    """Workers of a dask scheduler.

    If a worker dies, the scheduler gives its cells to another.  Problems are sent by
    content; user code runs in separate processes of the workers, as in
    `newmark_cli.running.executors.local`.
    How long a scheduler may take to answer, and how often a cell may end its worker, is
    in dask's configuration
    (``distributed.comm.timeouts.connect``, ``distributed.scheduler.allowed-failures``).

    Args:
        tasks: In the order in which they start.
        address: Of the scheduler; without one, worker processes are started here, which
            listen on loopback only and require the credentials of this run.
        jobs: How many of them are started.
        timeout: Most wall time of a cell (s).
        on_steps: Called with the number of steps done, a cell at a time.
        on_wait: Called with what the run waits for, when it does.

    Raises:
        InputError: If dask is not installed, or the address is invalid.
        ExecutorError: If the scheduler cannot be reached, is lost, has no workers for
            longer than it is configured to wait, or one has another numerical core.
    """
    with interrupts.raising(), ExitStack() as stack:
        environment = stack.enter_context(_only_own_imports())
        try:
            with _interrupts_held():  # what imports on the way may swallow them
                import dask
                import distributed

                security = distributed.Security.temporary() if address is None else None
        except ImportError:
            raise InputError(
                "--executor dask needs an extra: pip install 'newmark-study[distributed]'"
            ) from None
        # What dask logs is in a cell's status, or ends the run with one line.
        stack.callback(logging.disable, logging.root.manager.disable)
        logging.disable(logging.CRITICAL)
        where: Any = address
        if address is None:
            try:
                # In a folder of theirs, others could replace what is on `sys.path`.
                scratch = tempfile.TemporaryDirectory(
                    prefix="newmark-study-",
                    dir=dask.config.get("temporary-directory"),
                    ignore_cleanup_errors=True,
                )
                own = _OWN | {"temporary-directory": stack.enter_context(scratch)}
                stack.enter_context(dask.config.set(own))
                # A cluster that is half started cannot be closed.
                with _interrupts_held():
                    where = stack.enter_context(
                        distributed.LocalCluster(
                            n_workers=jobs,
                            threads_per_worker=1,
                            host="127.0.0.1",
                            # Other users of this machine can reach loopback, and a
                            # scheduler runs whatever it is sent.
                            protocol="tls://",
                            security=security,
                            dashboard_address=None,
                            # The usual port may be taken.
                            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                            silence_logs=logging.CRITICAL,
                            env=environment,
                        )
                    )
            except (OSError, RuntimeError, TimeoutError) as error:
                raise ExecutorError(f"no dask workers on this machine: {error}") from None
        try:
            client = stack.enter_context(distributed.Client(where))
        except ValueError as error:
            raise InputError(f"--scheduler {address}: {error}") from None
        except Exception as error:  # depends on what listens there
            reason = one_line(f"{error}" or type(error).__name__)
            raise ExecutorError(f"no dask scheduler at {address}: {reason}") from None
        if address is not None and not client.nthreads():
            on_wait(f"waiting for workers: the dask scheduler at {address} has none")
        run = uuid.uuid4().hex
        here = core(), versions(), registry.digest()

        def submit(name: int, attempt: str, priority: int) -> Any:
            task = tasks[name]
            carried = task.of(portable(task.cell.problem))
            key = f"newmark-{run}-{attempt}-{name}"
            return client.submit(
                _perform, carried, timeout, here, key=key, priority=priority, pure=False
            )

        yield _as_done(submit, tasks, address, on_steps)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C and hangups; processes started here leave them to this thread."""
    hangup = {number for number in interrupts.NAMES if number.name == "SIGHUP"}
    with interrupts.held(hangup):
        # Started on the way, the tracker of semaphores would allow Ctrl-C.
        resource_tracker.ensure_running()
        with interrupts.held({signal.SIGINT}):
            yield


@contextmanager
def _only_own_imports() -> Iterator[dict[str, str]]:
    """Processes that multiprocessing starts do not import from the current folder.

    Other changes that dask makes to the environment and `sys.path` are undone at the end.

    Yields:
        Variables that workers restore once they have started.
    """
    environment, path = dict(os.environ), sys.path[:]
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield {"PYTHONSAFEPATH": environment.get("PYTHONSAFEPATH", "")}
    finally:
        sys.path[:] = path
        for name in os.environ.keys() - environment:
            del os.environ[name]
        os.environ.update(environment)


def _perform(task: Task, timeout: float | None, wanted: tuple[str, Mapping[str, str], str]) -> Done:
    """Run a cell on a worker, which must have the same code as the process that submits it."""
    there = versions()
    if (core(), there, registry.digest()) != wanted:
        import distributed

        same = "numerical core" if core() != wanted[0] else "set of shipped mechanisms"
        others = [
            f"{name} {there[name]}, here {wanted[1][name]}" for name in unlike(there, wanted[1])
        ]
        raise ExecutorError(
            f"the dask worker at {distributed.get_worker().address} computes with another "
            f"{'; '.join(others) or f'{same} of the same version'}"
        )
    if is_code(task.cell.problem):
        return perform_apart(task, timeout)
    return perform(task, timeout)


def _as_done(
    submit: Callable[[int, str, int], Any],
    tasks: Mapping[int, Task],
    address: str | None,
    on_steps: Callable[[int], None],
) -> Execution:
    import distributed

    futures = [submit(name, "first", -rank) for rank, name in enumerate(tasks)]
    names = {future.key: name for future, name in zip(futures, tasks, strict=True)}
    waiting = distributed.as_completed(futures)
    futures.clear()  # released one by one as they are read
    suspects = []
    for future in waiting:
        name = names[future.key]
        done = _result(future, address)
        if done is None:
            suspects.append(name)
            continue
        on_steps(tasks[name].cell.weight)
        yield name, done
    # dask blames every cell that waited on a worker that died: try each by itself.
    for name in suspects:
        done = _result(submit(name, "alone", 0), address)
        on_steps(tasks[name].cell.weight)
        yield name, done or Done(failed("ended its workers, whichever it ran on"), 0.0)


def _result(future: Any, address: str | None) -> Done | None:
    """Outcome of a cell; None if its workers have died."""
    import distributed
    from distributed.scheduler import NoWorkerError

    where = f" at {address}" if address else ""
    try:
        done: Done = future.result()
    except distributed.KilledWorker:
        return None
    except (ExecutorError, InputError):
        raise
    except NoWorkerError:
        raise ExecutorError(f"the dask scheduler{where} has no workers") from None
    except (CancelledError, OSError, TimeoutError):
        raise ExecutorError(f"the dask scheduler{where} is lost") from None
    except Exception as error:
        return Done(failed(f"{type(error).__name__}: {error}"), 0.0)
    finally:
        future.release()
    return done
