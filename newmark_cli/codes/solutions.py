"""Solutions of a problem at the times of runs, and what the runs are off by."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from newmark_cli.codes.given_references import of_testset
from newmark_cli.codes.reading import SAME_TIME, Run
from newmark_cli.newmark.invariants import Misfit, misfits
from newmark_cli.newmark.statistics import Measurement
from newmark_cli.newmark.twins import last_places_off
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import Reference, solution
from newmark_cli.support.arrays import Array

#: Largest power of 1/h with which rounding of a quantity grows; 0 of others.
_GROWTH = {"lambda": 2.0, "multiplier": 2.0, "force": 2.0, "moment": 2.0,
           "v": 1.0, "velocity": 1.0, "omega": 1.0}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Solutions:
    """Solutions of a problem at the times of runs."""

    problem: Problem
    references: dict[float, Reference]
    #: Time since the start (s) → solution, where one is given; otherwise that of the test set, or
    #: computed.
    given: Callable[[float], Reference] | None = None

    def at(self, t: float) -> Reference:
        """The solution at a time (s).

        Raises:
            NoReference: When there is none.
        """
        for known, reference in self.references.items():
            if abs(known - t) <= SAME_TIME * max(1.0, abs(t)):
                return reference
        since = t - self.problem.t0
        found = self.given(since) if self.given else of_testset(self.problem, since)
        self.references[t] = found or solution(self.problem, since)
        return self.references[t]


@dataclass(frozen=True, eq=False)
class Measured:
    """One run with what it is off by.

    Attributes:
        run: The run.
        errors: Measure, quantity → its value and what rounding changes in it.
        ours: The same of a march of this tool's with the run's method and step size; empty
            where none was affordable.
    """

    run: Run
    errors: Mapping[tuple[str, str], Measurement]
    ours: Mapping[tuple[str, str], Measurement]


def roundings(measurements: Sequence[Measured], name: tuple[str, str]) -> Array:
    """(runs,) rounding of a quantity, of runs by descending sizes.

    Where none was measured it is that of the nearest larger step size, times a power of h.
    """
    rounding = np.array([m.errors[name].statistics.rounding for m in measurements])
    sizes = np.array([m.run.size for m in measurements])
    for place in np.flatnonzero(np.isnan(rounding)):
        known = np.flatnonzero(np.isfinite(rounding[:place]))
        if len(known):
            ratio = sizes[known[-1]] / sizes[place]
            rounding[place] = rounding[known[-1]] * ratio ** _GROWTH.get(name[1], 0.0)
    return rounding


def misfits_at(problem: Problem, run: Run, row: int, aside: int = 0) -> dict[str, Misfit]:
    """What a row of a run misses of the invariants that its columns tell of.

    λ is compared with that which u and v imply; u and v of a twin with other last places.
    """
    u, v, multipliers = (run.state.get(part, np.zeros((len(run.t), 0)))[row]
                         for part in ("u", "v", "lambda"))  # fmt: skip
    if not np.isfinite(u).all():
        return {}
    if aside:
        u, v = last_places_off(np.array([u, v]), aside - 1)
    with_v = bool(np.isfinite(v).all())
    missed = misfits(problem, float(run.t[row]), u, v if with_v else np.zeros(problem.n))
    if not with_v:
        return {"position": missed["position"]}
    if problem.m and np.isfinite(multipliers).all():
        try:
            with np.errstate(all="ignore"):
                _, implied = Index1(problem).accelerations(float(run.t[row]), u, v)
            missed["multiplier"] = Misfit(multipliers - implied, np.abs(implied))
        except np.linalg.LinAlgError:
            pass
    return missed
