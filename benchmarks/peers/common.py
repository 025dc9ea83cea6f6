"""The problems that every code solves, and the file that it writes of its runs.

A run is one step size or tolerance of one series.  Each takes place in a process of its own,
so that one that crashes or takes too long is a row of the file with a message, too.
"""

import argparse
import csv
import math
import os
import re
import resource
import signal
import tempfile
import time
from collections.abc import Callable, Iterable
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

import newmark_cli as newmark

HERE = Path(__file__).parent
SHIPPED = Path(newmark.__file__).parent / "mechanisms" / "shipped"
#: Problem → its file, and the time at which states are compared (s).
PROBLEMS = {
    "thrown-pendulum": (HERE / "thrown-pendulum.yaml", 0.5),
    "slider-crank": (SHIPPED / "slider-crank.yaml", 0.1),
    "andrews": (SHIPPED / "andrews.yaml", 0.03),
    "heavy-top": (SHIPPED / "heavy-top.yaml", 0.1),
}
#: Step sizes of codes with fixed steps (s); they divide the time.
STEPS = {
    "thrown-pendulum": (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7),
    "slider-crank": (1e-3, 2e-4, 1e-4, 1e-5, 1e-6, 1e-7),
    "andrews": (2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 1e-6),
    "heavy-top": (1e-3, 2e-4, 1e-4, 2e-5, 1e-5, 1e-6),
}
#: Of codes that choose their steps.
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
#: What a run may take of a processor's time (s); of the clock's, ten times as much.
LIMIT = 15.0


class Result(NamedTuple):
    """Where a run ended.

    Attributes:
        u, v: (n,) coordinates and velocities in the order of the problem; None if there are none.
        multipliers: (m,) λ, NaN where the code does not give it.
        iterations: Newton iterations; None where the code does not count them.
        calls: Steps, or calls of the residual.
        message: The code's own words where it failed.
    """

    u: Any = None
    v: Any = None
    multipliers: Any = None
    iterations: int | None = None
    calls: int | None = None
    message: str = ""


class Run(NamedTuple):
    """One run: label of the series, ``"h"`` or ``"tolerance"``, its value, and the work.

    The work returns a result, or series → result where it has several.
    """

    series: str
    axis: str
    value: float
    work: Callable[[], Any]


def spec(name):
    """The mechanism's file as data."""
    return yaml.safe_load(PROBLEMS[name][0].read_text(encoding="utf-8"))


def load(name):
    """The problem and the time of its end (s)."""
    path, t_end = PROBLEMS[name]
    return newmark.problem(str(path)), t_end


def main(runs: Callable[..., Iterable[Run]]):
    """Do the runs of a problem one after the other and write their file.

    Without any run there is no file.

    Args:
        runs: Name of the problem, problem, end (s) → its runs.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("problem", choices=PROBLEMS)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--limit", type=float, default=LIMIT)
    options = parser.parse_args()
    problem, t_end = load(options.problem)
    # What numba compiles here need not be compiled in every run.
    problem.evaluate(0.0, problem.u0, problem.v0, np.zeros(problem.m))
    problem.constraint_rows(0.0, problem.u0, problem.v0, problem.v0)
    options.out.unlink(missing_ok=True)
    for run in runs(options.problem, problem, t_end):
        begun = time.perf_counter()
        found = apart(run.work, options.limit)
        seconds = time.perf_counter() - begun
        each = found if isinstance(found, dict) else {run.series: found}
        with options.out.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            if file.tell() == 0:
                writer.writerow(columns(problem))
            for label, result in each.items():
                named = run._replace(series=label)
                writer.writerow(row(named, t_end, result, seconds / len(each), problem))
    if options.out.exists():
        leave_out_empty(options.out)


def leave_out_empty(path):
    """Leave out the columns that a code does not give."""
    with path.open(newline="", encoding="utf-8") as file:
        given = [column for column in zip(*csv.reader(file), strict=True) if any(column[1:])]
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(zip(*given, strict=True))


def columns(problem):
    """Header of the file: the names are those of `newmark_cli.march(...).to_frame()`."""
    return [
        "series", "h", "tolerance", "t",
        *(f"u[{name}]" for name in problem.coordinate_names),
        *(f"v[{name}]" for name in problem.coordinate_names),
        *(f"lambda[{name}]" for name in problem.constraint_names),
        "iterations", "seconds", "calls", "message",
    ]  # fmt: skip


def row(run, t_end, result, seconds, problem):
    """One row; numbers that there are not are empty."""
    sizes = (problem.n, problem.n, problem.m)
    numbers = [
        np.full(size, np.nan) if values is None else np.asarray(values, float)
        for values, size in zip(result[:3], sizes, strict=True)
    ]
    shown = ["" if np.isnan(x) else repr(float(x)) for x in np.concatenate(numbers)]
    at = {run.axis: repr(run.value)}
    counted = ["" if x is None else x for x in (result.iterations, result.calls)]
    message = " ".join(result.message.split())
    head = [run.series, at.get("h", ""), at.get("tolerance", ""), t_end]
    return [*head, *shown, counted[0], f"{seconds:.3g}", counted[1], message]


def apart(work: Callable[[], Any], limit: float) -> Any:
    """Work in a forked process; what it prints is the message of one that ends without result.

    Args:
        work: As of `Run`.
        limit: Processor time that it may take (s); ten times as much of the clock's.
    """
    with tempfile.TemporaryFile("w+", errors="replace") as printed:
        reader, writer = get_context("fork").Pipe(False)

        def child():
            os.dup2(printed.fileno(), 1)
            os.dup2(printed.fileno(), 2)
            used = sum(os.times()[:2])
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used + limit), -1))
            try:
                writer.send(work())
            except Exception as error:
                writer.send(Result(message=f"{type(error).__name__}: {error}"))

        process = get_context("fork").Process(target=child)
        process.start()
        writer.close()
        result = Result(message=f"no result within {limit:g} s")
        if reader.poll(10 * limit):
            try:
                result = reader.recv()
            except EOFError:
                process.join()
                code = process.exitcode
                how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
                if how != "SIGXCPU":
                    result = Result(message=f"ended by {how}")
        process.kill()
        process.join()
        if isinstance(result, Result) and result.message:
            printed.seek(0)
            # Where a warning's file is installed is this machine's own matter.
            text = re.sub(r"\S*/site-packages/", "", printed.read())
            words = [line for line in text.splitlines() if line.strip(" *=-")]
            result = result._replace(message=": ".join([result.message, *words[-2:]])[:300])
        return result
