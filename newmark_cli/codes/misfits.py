"""What the rows of another code's run miss of the constraints, and of λ that u and v imply."""

import numpy as np

from newmark_cli.codes.reading import Run
from newmark_cli.newmark.invariants import Misfit, misfits
from newmark_cli.newmark.twins import last_places_off
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem


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
