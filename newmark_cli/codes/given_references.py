"""References from a table: a solution that is published, or that another code computed closely.

A row is the state at one time: ``t`` and all of ``u[…]`` and ``v[…]``, in any file that `judge`
reads.  λ that the table lacks is that which u and v imply by the index-1 system.  The relative
errors of u, v and λ stand in columns ``error[u]``, ``error[v]`` and ``error[lambda]``.  Without
one, the error is that of a column ``tolerance``; without that, half a unit in the last digit.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from newmark_cli.codes import table_files
from newmark_cli.codes.evidence import digits_of
from newmark_cli.codes.reading import SAME_TIME, TOLERANCE, columns_of, names_of, some
from newmark_cli.mechanisms import registry
from newmark_cli.newmark.invariants import misfits
from newmark_cli.problems import multipliers
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import NoReference, Reference
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError

#: Part of the state → column of its relative error.
ERRORS = {part: f"error[{part}]" for part in ("u", "v", "lambda")}
#: Part of its size by which u may miss constraints; digits explain less.
_WORST = 1e-3
#: Times that an error names; the least error, which is rounding.
_MOST_NAMED, _LEAST = 8, 4 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class ReferenceFile:
    """A file of references that a study names, with what it said when the study was read.

    Attributes:
        name: As the config has it.
        path: Where it is.
        label: Digest of its content, by which cells are told apart.
    """

    name: str
    path: Path
    label: str

    @classmethod
    def of(cls, name: str, path: Path) -> "ReferenceFile":
        """A file as it is now; raises OSError where it cannot be read."""
        return cls(name, path, _digest(path))

    def solution(self, problem: Problem, t: float) -> Reference:
        """The solution of a problem at a time since its start (s).

        Raises:
            NoReference: Where the file has none, cannot be used, or has changed.
        """
        try:
            if _digest(self.path) != self.label:
                raise NoReference(f"{self.name} has changed since the run began")
            return reference_at(self.path, problem)(t)
        except (ArgumentError, OSError) as error:
            raise NoReference(str(error)) from None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def of_testset(problem: Problem, since: float) -> Reference | None:
    """The reference that travels with a member of the test set.

    Args:
        problem: Any problem.
        since: Time since its start (s).

    Returns:
        The reference; None for other problems, and at times that the member's table lacks.
    """
    name = problem.name
    if name not in registry.TESTSET or problem.content != registry.problem(name).content:
        return None
    try:
        return _table_of(name)(since)
    except NoReference:
        return None


@cache
def _table_of(name: str) -> Callable[[float], Reference]:
    return reference_at(registry.TESTSET_FOLDER / f"{name}.csv", registry.problem(name))


def reference_at(path: Path, problem: Problem) -> Callable[[float], Reference]:
    """Solutions of a problem from a table, by time.

    Args:
        path: A file that `table_files.table` reads.
        problem: The problem.

    Returns:
        A function as `newmark_cli.problems.reference.solution` of the problem: from time since
        the start (s) to the reference.  It raises `NoReference` at a time that the table lacks;
        at the start it is the problem's.

    Raises:
        ArgumentError: When the table cannot be used; names the column or line.
    """
    frame, where = table_files.table(path, {})
    _, numbers = columns_of(frame, where, problem, {}, [], ERRORS.values())
    ours = {part: [f"{part}[{name}]" for name in names_of(problem)[part]] for part in ERRORS}
    needed = ("t", *ours["u"], *ours["v"])
    if lacking := [name for name in needed if name not in numbers]:
        raise ArgumentError(f"{where}: a reference needs all of t, u and v: lacks {some(lacking)}")
    for name in needed:
        if not (finite := np.isfinite(numbers[name])).all():
            at = table_files.line(frame, int(finite.argmin()))
            raise ArgumentError(f"{where}, {at}: no number for {name}")
    times = numbers["t"]
    if len(np.unique(times)) < len(times):
        raise ArgumentError(f"{where}: a time is there twice; a reference has one row for each")
    digits, _ = digits_of(np.concatenate([numbers[name] for name in ours["u"]]))
    usual = numbers.get(TOLERANCE, np.full(len(times), 5.0 * 10.0**-digits))
    errors = {}
    for part, name in ERRORS.items():
        errors[part] = numbers.get(name, usual)
        if not (allowed := (errors[part] >= 0) & (errors[part] < 1)).all():
            row = int(allowed.argmin())
            raise ArgumentError(
                f"{where}, {table_files.line(frame, row)}: "
                f"{name if name in numbers else TOLERANCE} must be at least 0 and below 1, "
                f"given {errors[part][row]:g}"
            )
    missing = np.full(len(times), np.nan)
    states = {part: [numbers.get(name, missing) for name in names] for part, names in ours.items()}

    def of(since: float) -> Reference:
        t = problem.t0 + since
        row = int(np.abs(times - t).argmin())
        if abs(times[row] - t) <= SAME_TIME * max(1.0, abs(t)):
            state = {part: np.array([x[row] for x in values]) for part, values in states.items()}
            missed = misfits(problem, t, state["u"], state["v"])["position"] if problem.m else None
            if missed is not None and missed.error > _WORST * missed.sizes[0]:
                raise ArgumentError(
                    f"{where}, {table_files.line(frame, row)}: u misses the constraints of "
                    f"{problem.name} by {missed.error:.1g}: it is of another problem or unit"
                )
            return _reference(problem, t, state, {part: errors[part][row] for part in errors})
        if abs(since) > SAME_TIME:
            listed = ", ".join(f"{time:g}" for time in times[:_MOST_NAMED])
            more = f" and {len(times) - _MOST_NAMED} more" if len(times) > _MOST_NAMED else ""
            raise NoReference(f"{where}: no reference at t = {t:.10g}; has t = {listed}{more}")
        start = {"u": problem.u0, "v": problem.v0, "lambda": np.full(problem.m, np.nan)}
        return _reference(problem, t, start, dict.fromkeys(errors, 0.0))

    return of


def _reference(
    problem: Problem, t: float, state: dict[str, Array], errors: dict[str, float]
) -> Reference:
    """A state and its relative errors as a reference, λ completed where it is NaN."""
    system, u, v = Index1(problem), state["u"], state["v"]
    given = np.isfinite(state["lambda"])
    try:
        implied = system.accelerations(t, u, v)[1]
        found = np.where(given, state["lambda"], implied)
        scales = multipliers.weights(problem, t, u).scales(found)
    except np.linalg.LinAlgError as error:
        raise NoReference(f"{problem.name}: no reference at t = {t:g}: {error}") from None
    unsure = errors["lambda"]
    if not given.all():
        # Errors of u and v with alternating signs, as those of λ that they imply depend on them.
        signs = (-1.0) ** np.arange(problem.n)
        for sign in (1, -1):
            off = [x + sign * signs * max(errors[part], _LEAST) * np.abs(x).max()
                   for part, x in (("u", u), ("v", v))]  # fmt: skip
            other = system.accelerations(t, *off)[1]
            unsure = max(unsure, multipliers.relative_error(other, implied, scales))
    return Reference(
        t=t - problem.t0, u=u, v=v, multipliers=found, scales=scales, source="published",
        u_error=max(errors["u"], _LEAST), v_error=max(errors["v"], _LEAST),
        multipliers_error=max(unsure, _LEAST),
    )  # fmt: skip
