"""Motions of problems: for drawings, and what verdicts must know of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha, Integrator
from newmark_cli.newmark.invariants import misfits
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.trajectory import Recorder
from newmark_cli.problems import singular
from newmark_cli.problems.problem import Problem
from newmark_cli.study.observers import sample_steps
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError

#: The trapezoidal rule would leave an alternating error of the multipliers undamped.
DAMPED = GeneralizedAlpha(0.9)
#: Largest error of the positions that no drawing shows, relative to the coordinates.
VISIBLE = 1e-3
#: Steps of the first try, and how often they are halved when the user leaves them open.
_STEPS, _HALVINGS = 1000, 6
#: Most steps, as in a study.
_MOST_STEPS = 20_000_000


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions at evenly spread times, the first and the last included."""

    positions: Sequence[Array]  #: (n,) each
    h: float  #: step size (s)
    #: how far the positions are from those at twice the step size: the largest over the frames,
    #: relative to the largest coordinate
    error: float
    invariant: float  #: largest relative error of Φ, Φ' and of the energy, if one is conserved

    @property
    def doubt(self) -> str:
        """Why the drawing may mislead; empty where nothing speaks against it."""
        if self.error > VISIBLE:
            return f"positions change by {self.error:.1%} between steps of 2h and h = {self.h:g}"
        if self.invariant > VISIBLE:
            return f"constraints or energy are off by {self.invariant:.1%} at h = {self.h:g}"
        return ""


def motion(
    problem: Problem,
    t_end: float,
    frames: int = 2,
    h: float | None = None,
    integrator: Integrator = DAMPED,
) -> Motion:
    """Positions along the motion, in the (u, λ) form with optimal scaling.

    Compared with those at twice the step size; without one finer while a difference shows.
    """
    if h is not None and not t_end / h <= _MOST_STEPS:
        raise InputError(f"more than {_MOST_STEPS} steps to t = {t_end:g} with h = {h:g}")
    steps, halvings = (_STEPS, _HALVINGS) if h is None else (round(t_end / h), 0)
    steps = max(steps, frames - 1)
    tries = [max(steps // 2, frames - 1), *(steps << halving for halving in range(halvings + 1))]
    best: Motion | None = None
    for count in tries:
        try:
            fine = _marched(problem, t_end, frames, count, integrator)
        except InputError:
            if count == tries[-1] or not halvings:
                raise
            continue
        best = replace(fine, error=_apart(best, fine) if best else math.inf)
        if not best.doubt:
            break
    assert best is not None
    return best


def _apart(coarse: Motion, fine: Motion) -> float:
    """Largest difference of positions, relative to the largest coordinate."""
    size = max(float(np.abs(u).max()) for u in fine.positions) or 1.0
    pairs = zip(coarse.positions, fine.positions, strict=True)
    return max(float(np.abs(a - b).max()) for a, b in pairs) / size


def _marched(
    problem: Problem, t_end: float, frames: int, steps: int, integrator: Integrator
) -> Motion:
    h = t_end / steps
    try:
        with np.errstate(all="ignore"):
            march = March(problem, _scheme(integrator, h))
            recorder = Recorder(march, most=frames)
            recorder.keep_here()
            for stretch in march.stretches(steps, looks=sample_steps(steps, frames - 1).tolist()):
                recorder.took(stretch)
                failed = march.ending != COMPLETED or not recorder.finite
                if failed or np.any(stretch.iterations < 0):
                    raise InputError(
                        f"the march fails before t = {march.t - problem.t0:g} with h = {h:g}: "
                        "Newton's iteration does not converge; try a smaller --h, or the motion "
                        "ends there"
                    )
            trajectory, worst = recorder.trajectory(), 0.0
            states = zip(trajectory.t.tolist(), trajectory.u, trajectory.v, strict=True)
            for state in islice(states, 1, None):
                for misfit in misfits(problem, *state).values():
                    worst = max(
                        worst, misfit.error / float(misfit.sizes[0]) if misfit.error else 0.0
                    )
            return Motion([*trajectory.u], h, math.inf, worst)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        why = error.args[-1] if error.args else type(error).__name__
        raise InputError(f"no march to t = {t_end:g} with h = {h:g}: {why}") from None


def _scheme(integrator: Integrator, h: float) -> Scheme:
    form = FORMS["u-lambda"]
    return Scheme(integrator, form, named_scaling("optimal", form), h)


@dataclass(frozen=True)
class Facts:
    """Facts of a motion that a verdict needs."""

    #: times (s since the start) near which the constraints lose rank
    singular: tuple[float, ...] = ()
    still: bool = False  #: whether nothing moves
    driven: bool = False  #: whether the constraints alone determine the motion


#: Steps of the march that looks for singular positions, and samples of it.
_LOOK_STEPS, _LOOKS = 20_000, 400
#: Speed below which nothing moves, relative to coordinates that turn once in the run.
_STILL = 1e-9


@np.errstate(all="ignore")
def facts(problem: Problem, t_end: float, h: float) -> Facts:
    """Singular positions that a motion passes, whether it moves, and what determines it.

    Looks along a damped march; of motions that it does not get through, of large
    problems and of plain Python, which would take too long, it says only the last.
    """
    driven = problem.n == problem.m
    if not problem.compiled or problem.n + problem.m > singular.LARGEST:
        return Facts(driven=driven)
    steps = max(min(round(t_end / h), _LOOK_STEPS), 1)
    try:
        march = March(problem, _scheme(DAMPED, t_end / steps))
        recorder = Recorder(march, keep=("u", "v"), most=_LOOKS)
        for stretch in march.stretches(steps, looks=sample_steps(steps, _LOOKS - 1).tolist()):
            recorder.took(stretch)
        seen = recorder.trajectory()
        gradients = singular.gradients(problem, seen.t, seen.u)
        times = seen.t - problem.t0
        fastest = float(np.abs(seen.v).max(initial=0.0))
        crossings = singular.crossings(times, gradients) if len(times) > 2 else []
    except Exception:  # of the user's code too; the cells have told what goes wrong
        return Facts(driven=driven)
    size = float(np.abs(problem.u0).max()) or 1.0
    return Facts(
        tuple(float(f"{t:.4g}") for t in crossings),
        still=len(times) > 0 and fastest * t_end < _STILL * size,
        driven=driven,
    )
