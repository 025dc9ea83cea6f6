"""References of a results folder: known, stored, or computed once and stored.

A converged reference is kept in ``references/<problem>-<t>-<content>.json``, where
the content is a digest of everything that its numbers depend on: a changed
mechanism has another file.  Where the digest of the file's text, its last key, does not
match, the reference is computed again.
"""

import contextlib
import hashlib
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.codes.given_references import ReferenceFile, of_testset
from newmark_cli.mechanisms.known import KNOWN
from newmark_cli.mechanisms.spec import ProblemSpec, Shipped, with_problem
from newmark_cli.problems import reference
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import NoReference, Reference
from newmark_cli.support import files

#: Computes the solution of a problem at a time.
Solve = Callable[[ProblemSpec, float], Reference]


class References:
    """References that share a results folder.

    What could not be computed is remembered as long as the object lives, and not on
    disk: the next run, which may have more time, tries again.
    """

    def __init__(self, folder: Path, solve: Solve, anew: bool = False) -> None:
        """Take a results folder; nothing is read or written yet.

        Args:
            folder: Results folder.
            solve: Computes what is not stored.
            anew: Whether what is stored is computed again.
        """
        self._results, self._folder = folder, folder / "references"
        self._solve, self._anew = solve, anew
        self._solved: dict[str, Reference | NoReference] = {}
        self._computing: dict[str, threading.Lock] = {}

    def of(self, spec: ProblemSpec, t: float, given: ReferenceFile | None = None) -> Reference:
        """The solution of a problem at a time; computed, or tried, at most once, in any thread.

        Args:
            spec: The problem.
            t: Time since the problem's start (s).
            given: File to read it from instead.

        Raises:
            NoReference: The motion cannot be computed up to that time.
            ResultsError: The reference cannot be written.
        """
        if given is not None:
            return with_problem(spec, _given, given, t)
        if isinstance(spec, Shipped) and spec.name in KNOWN:
            known = KNOWN[spec.name](t)
            if known is not None:
                return known
        problem = spec.load()
        if (tabulated := of_testset(problem, t)) is not None:
            return tabulated
        content = digest(problem, t)
        with self._computing.setdefault(content, threading.Lock()):
            if content not in self._solved:
                try:
                    self._solved[content] = self._stored(spec, problem, t, content)
                except NoReference as error:
                    self._solved[content] = error
        solved = self._solved[content]
        if isinstance(solved, NoReference):
            raise NoReference(str(solved))
        return solved

    def sought(self, spec: ProblemSpec, t: float, given: ReferenceFile | None) -> None:
        """Compute what `of` is going to be asked for."""
        with contextlib.suppress(NoReference):
            self.of(spec, t, given)

    def _stored(self, spec: ProblemSpec, problem: Problem, t: float, content: str) -> Reference:
        """The reference from its file, which is written if none fits."""
        safe = re.sub(r"[^A-Za-z0-9._=-]+", "-", spec.label).strip("-.")[:80]
        path = self._folder / f"{safe}-{float(t)!r}-{content[:12]}.json"
        solution = None if self._anew else _read(path, t, content)
        if solution is None:
            solution = self._solve(spec, t)
            files.make_folder(self._folder, self._results)
            files.write_sealed(path, _record(spec.label, solution, content), self._results)
        return solution


def _given(problem: Problem, file: ReferenceFile, t: float) -> Reference:
    return file.solution(problem, t)


def digest(problem: Problem, t: float) -> str:
    """Hexadecimal digest of what a converged reference depends on.

    The content of the problem, the time and the version of the method.
    """
    text = f"{reference.VERSION} {problem.content} {float(t)!r}"
    return hashlib.sha256(text.encode()).hexdigest()


def _record(label: str, solution: Reference, content: str) -> dict[str, Any]:
    return {
        "problem": label,
        "t": solution.t,
        "source": solution.source,
        "content": content,
        "u": solution.u.tolist(),
        "v": solution.v.tolist(),
        "lambda": solution.multipliers.tolist(),
        "lambda_scale": solution.scales.tolist(),
        "estimated_error": {
            "u": solution.u_error,
            "v": solution.v_error,
            "lambda": solution.multipliers_error,
        },
    }


def _read(path: Path, t: float, content: str) -> Reference | None:
    """The reference in a file; None if it is missing, damaged or of something else."""
    record = files.read_sealed(path)
    if record.get("content") != content:
        return None
    estimated = record["estimated_error"]
    return Reference(
        t=t,
        u=np.array(record["u"], float),
        v=np.array(record["v"], float),
        multipliers=np.array(record["lambda"], float),
        scales=np.array(record["lambda_scale"], float),
        source=record["source"],
        u_error=estimated["u"],
        v_error=estimated["v"],
        multipliers_error=estimated["lambda"],
    )
