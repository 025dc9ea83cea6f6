"""Other codes as a study names them: programs, Python functions, and tables they have written.

Each is a frozen, hashable value with ``name``, the label of the column ``code``, and
``runs``, which gives what the code computes of one problem with one step size.  What it is made
of is part of the value, so that cells of a program that was compiled anew are computed anew.
"""

import hashlib
import os
import shutil
import signal
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from newmark_cli.codes.reading import Run, Runs, names_of, read
from newmark_cli.mechanisms.spec import ProblemSpec
from newmark_cli.problems import user_code
from newmark_cli.problems.problem import Problem
from newmark_cli.support import apart
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError, InputError, one_line

if TYPE_CHECKING:
    import pandas as pd

#: Seconds between two looks at a program that runs, and characters of what it says that are told.
_LOOK, _LONGEST = 0.05, 200


class CodeError(Exception):
    """Another code gave no run; the text says in one line how it ended."""


@dataclass(frozen=True)
class RunRequest:
    """One run that another code is asked for.

    Attributes:
        problem: What is to be solved.
        h: Step size (s).
        t_end: Time to come to (s), on the problem's clock.
        u0, v0: (n,) start.
        twin: 0, or the number of the twin that starts there.
        look: Called now and then while the code runs; may raise to end it.
    """

    problem: ProblemSpec
    h: float
    t_end: float
    u0: Array
    v0: Array
    twin: int = 0
    look: Callable[[], None] = lambda: None


@dataclass(frozen=True)
class OtherCode(ABC):
    """What tells another code from others, and what it is made of.

    Attributes:
        name: Label in CSVs and figures.
        columns: (column of this tool, expression in those of the code) pairs.
        content: Digest of its files.
    """

    name: str
    columns: tuple[tuple[str, str], ...]
    content: str

    @property
    def label(self) -> str:
        """The name, as CSVs have it."""
        return self.name

    @abstractmethod
    def run(self, wanted: RunRequest) -> Run | None:
        """The run, with the rows that the code gave; None of a twin that it cannot give.

        Raises:
            CodeError: When there is none.
        """

    def _read(self, source: Any, wanted: RunRequest) -> Run:
        """The one run of a table, which need not say its step size."""
        columns = {"h": repr(wanted.h), **dict(self.columns)}
        try:
            found = read(source, wanted.problem.load(), columns).runs
        except ArgumentError as error:
            raise CodeError(str(error).replace(f"{source}", "its table")) from None
        if len(found) > 1:
            raise CodeError(f"gave {len(found)} runs, where one with h = {wanted.h:g} was wanted")
        return found[0]


def digest(paths: Sequence[Path], *texts: str) -> str:
    """Digest of files that are there, and of texts."""
    summed = hashlib.sha256("\0".join(texts).encode())
    for path in paths:
        with suppress(OSError):
            summed.update(path.read_bytes())
    return summed.hexdigest()


# -- programs ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Program(OtherCode):
    """A command that prints a table.

    Attributes:
        command: Words; ``{h}``, ``{t0}``, ``{t_end}``, ``{steps}``, ``{u0}`` and ``{v0}`` stand
            for the numbers of a run, the last two separated by commas.
        folder: Where it runs.
    """

    command: tuple[str, ...]
    folder: Path

    def run(self, wanted: RunRequest) -> Run | None:
        """What it prints; see `OtherCode.run`."""
        if wanted.twin and not any("{u0}" in word for word in self.command):
            return None
        words = [_filled(word, wanted) for word in self.command]
        with tempfile.TemporaryDirectory(prefix="newmark-study-") as folder:
            output, said = Path(folder, f"{wanted.twin}.txt"), Path(folder, "stderr")
            with output.open("wb") as out, said.open("wb") as err:
                code = self._wait(words, out, err, wanted.look)
            if code != 0:
                last = said.read_text(errors="replace").strip().splitlines()[-1:]
                how = f"signal {-code}" if code < 0 else f"exit code {code}"
                raise CodeError(one_line(": ".join([f"ended with {how}", *last]))[:_LONGEST])
            return self._read(output, wanted)

    def _wait(self, words: Sequence[str], out: Any, err: Any, look: Callable[[], None]) -> int:
        """Exit code of the command, which ends with all that it has started."""
        try:
            process = subprocess.Popen(
                words, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise CodeError(f"cannot be run: {words[0]}: {error.strerror}") from None
        try:
            while True:
                with suppress(subprocess.TimeoutExpired):
                    return process.wait(_LOOK)
                look()
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _filled(word: str, wanted: RunRequest) -> str:
    """A word of a command with the numbers of a run, to the last digit."""
    steps = round((wanted.t_end - wanted.problem.load().t0) / wanted.h)
    numbers = {
        "h": repr(wanted.h),
        "t0": repr(float(wanted.problem.load().t0)),
        "t_end": repr(wanted.t_end),
        "steps": str(steps),
        "u0": ",".join(map(repr, wanted.u0.tolist())),
        "v0": ",".join(map(repr, wanted.v0.tolist())),
    }
    for name, text in numbers.items():
        word = word.replace(f"{{{name}}}", text)
    return word


def program_files(command: Sequence[str], folder: Path) -> list[Path]:
    """The program of a command and the files that its words name."""
    first = folder / command[0] if os.sep in command[0] else shutil.which(command[0])
    others = (folder / word for word in command[1:] if "{" not in word)
    return [Path(path) for path in (first, *others) if path and Path(path).is_file()]


# -- Python -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class PythonCode(OtherCode):
    """A function ``solve(problem, h, t_end, u0, v0)`` of a file.

    Attributes:
        path: The file.
        function: Its name.
        arguments: (name, value) pairs of further arguments.
    """

    path: Path
    function: str
    arguments: tuple[tuple[str, Any], ...] = ()

    def run(self, wanted: RunRequest) -> Run | None:
        """What the function returns, in a process of its own; see `OtherCode.run`."""
        arguments = self, wanted.problem, wanted.h, wanted.t_end, wanted.u0, wanted.v0

        def stopped() -> bool:
            wanted.look()
            return False

        try:
            if apart.inside():
                return self._read(solved(*arguments), wanted)
            # Each call runs the file anew; what it has imported is installed, and takes seconds.
            return self._read(apart.call(solved, arguments, None, self.path, stopped), wanted)
        except (apart.ApartError, InputError) as error:
            raise CodeError(str(error)) from None


def solved(
    code: PythonCode, spec: ProblemSpec, h: float, t_end: float, u0: Array, v0: Array
) -> "pd.DataFrame":
    """The table that a function of the user's returns; runs in a process of its own.

    Raises:
        InputError: What went wrong, in a line; classes of errors may be the user's.
    """

    def called(solve: Callable[..., Any]) -> "pd.DataFrame":
        problem = spec.load()
        start = u0.copy(), v0.copy()
        return _frame(solve(problem, h, t_end, *start, **dict(code.arguments)), problem)

    made = user_code.made_of(code.path, code.path.read_bytes(), code.function, called)
    return cast("pd.DataFrame", made)


def _frame(returned: Any, problem: Problem) -> "pd.DataFrame":
    """A table from what a function returns: named columns, or rows of t, u, v and λ."""
    import pandas as pd

    if isinstance(returned, Mapping | pd.DataFrame):
        return pd.DataFrame(returned)
    names = names_of(problem)
    parts = [f"{part}[{name}]" for part in ("u", "v", "lambda") for name in names[part]]
    rows = np.asarray(returned, float)
    if rows.ndim != 2 or rows.shape[1] not in (1 + 2 * problem.n, 1 + len(parts)):
        raise ArgumentError(
            "must return a mapping or DataFrame with named columns, or rows of t, u, v and λ, "
            f"{1 + len(parts)} numbers each, given shape {rows.shape}"
        )
    return pd.DataFrame(rows, columns=["t", *parts][: rows.shape[1]])


# -- tables -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class WrittenTable(OtherCode):
    """A table of runs that a code has written.

    Attributes:
        path: The file.
        series: Label of the series in it; empty where it has one.
    """

    path: Path
    series: str = ""

    def run(self, wanted: RunRequest) -> Run | None:
        """The run of that step size, or of that twin of it; see `OtherCode.run`."""
        if digest([self.path]) != self.content:
            raise CodeError(f"{self.path.name} has changed since the run began")
        try:
            runs = _table(self.path, self.content, wanted.problem, self.columns)
        except ArgumentError as error:
            raise CodeError(str(error)) from None
        of_series = [run for run in runs.runs if self.series in ("", run.series)]
        if len(labels := {run.series for run in of_series}) > 1:
            raise CodeError(f"has several series: give one of {', '.join(sorted(labels))}")
        of_size = [run for run in of_series if abs(run.size / wanted.h - 1) < 1e-9]
        if not of_size:
            has = ", ".join(f"{run.size:g}" for run in of_series if not run.twin)
            raise CodeError(f"{self.path.name} has no run with h = {wanted.h:g}; it has {has}")
        return next((run for run in of_size if run.twin == wanted.twin), None)


@lru_cache(maxsize=8)
def _table(
    path: Path, content: str, spec: ProblemSpec, columns: tuple[tuple[str, str], ...]
) -> Runs:
    """Runs of a file of this content, read once for all cells."""
    return read(path, spec.load(), dict(columns))
