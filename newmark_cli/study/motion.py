"""Motions of problems: for drawings, and what verdicts must know of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.errors import InputError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import GeneralizedAlpha, Integrator
from newmark_cli.newmark.invariants import misfits
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED, State
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.trajectory import Recorder, Trajectory
from newmark_cli.problems import singular
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.multipliers import weights
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import Reference
from newmark_cli.study.measures import errors

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
    """Positions at evenly spread times, the first and the last included.

    Attributes:
        positions: (n,) each.
        h: Step size (s).
        error: How far the positions are from those at twice the step size: the largest
            over the frames, relative to the largest coordinate.
        invariant: Largest relative error of Φ, Φ' and of the energy, if one is conserved.
    """

    positions: Sequence[Array]
    h: float
    error: float
    invariant: float

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

    Args:
        problem: The problem.
        t_end: End (s), counted from the problem's start; positive.
        frames: How many positions, at least 2.
        h: Step size (s); when omitted it is halved until nothing visible changes.
        integrator: Integrator of the family.

    Raises:
        InputError: When the march does not get to the end.
    """
    if h is not None:
        if not t_end / h <= _MOST_STEPS:
            raise InputError(f"more than {_MOST_STEPS} steps to t = {t_end:g} with h = {h:g}")
        return _judged(
            problem, t_end, frames, max(round(t_end / h), frames - 1), integrator, halvings=0
        )
    return _judged(problem, t_end, frames, max(_STEPS, frames - 1), integrator, _HALVINGS)


def _judged(
    problem: Problem, t_end: float, frames: int, steps: int, integrator: Integrator, halvings: int
) -> Motion:
    """The motion with so many steps, compared with half as many; finer while that shows."""
    coarse: Motion | None = None
    try:
        coarse = _marched(problem, t_end, frames, max(steps // 2, frames - 1), integrator)
    except InputError:
        if not halvings:
            raise
    for attempt in range(halvings + 1):
        last = attempt == halvings
        try:
            fine = _marched(problem, t_end, frames, steps << attempt, integrator)
        except InputError:
            if last:
                raise
            continue
        error = math.inf
        if coarse is not None:
            size = max(float(np.abs(u).max()) for u in fine.positions) or 1.0
            pairs = zip(coarse.positions, fine.positions, strict=True)
            error = max(float(np.abs(a - b).max()) for a, b in pairs) / size
        coarse = Motion(fine.positions, fine.h, error, fine.invariant)
        if last or not coarse.doubt:
            break
    assert coarse is not None
    return coarse


def _marched(
    problem: Problem, t_end: float, frames: int, steps: int, integrator: Integrator
) -> Motion:
    h = t_end / steps
    try:
        with np.errstate(all="ignore"):
            return _marched_with(problem, h, frames, steps, integrator)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        why = error.args[-1] if error.args else type(error).__name__
        raise InputError(f"no march to t = {t_end:g} with h = {h:g}: {why}") from None


def _marched_with(
    problem: Problem, h: float, frames: int, steps: int, integrator: Integrator
) -> Motion:
    march = March(problem, _scheme(integrator, h))
    recorder = Recorder(march, most=frames)
    recorder.keep_here()
    for stretch in march.recorded(steps, _spread(steps, frames)):
        recorder.took(stretch)
        failed = march.ending != COMPLETED or not recorder.finite
        if failed or np.any(stretch.iterations < 0):
            raise InputError(
                f"the march fails before t = {march.t - problem.t0:g} with h = {h:g}: Newton's "
                "iteration does not converge; try a smaller --h, or the motion ends there"
            )
    found, worst = recorder.trajectory(), 0.0
    states = zip(found.t.tolist(), found.u, found.v, strict=True)
    for state in islice(states, 1, None):
        kept = misfits(problem, *state).values()
        worst = max(worst, *(each.error / each.size if each.error else 0.0 for each in kept))
    return Motion([*found.u], h, math.inf, worst)


def _scheme(integrator: Integrator, h: float) -> Scheme:
    form = FORMS["u-lambda"]
    return Scheme(integrator, form, named_scaling("optimal", form), h)


def _spread(steps: int, looks: int) -> list[int]:
    """Steps after the start at which to look, evenly spread, the last among them."""
    spread = np.unique(np.round(np.linspace(0, steps, looks)).astype(int))
    return [step for step in spread.tolist() if step > 0]


@dataclass(frozen=True)
class Facts:
    """Facts of a motion that a verdict needs.

    Attributes:
        singular: Times (s since the start) near which the constraints lose rank.
        still: Whether nothing moves.
        amplification: See `amplification`; empty where it was not asked for, or is not known.
    """

    singular: tuple[float, ...] = ()
    still: bool = False
    amplification: Mapping[str, float] = field(default_factory=dict)


#: Steps of the march that looks for singular positions, and samples of it.
_LOOK_STEPS, _LOOKS = 20_000, 400
#: Speed below which nothing moves, relative to coordinates that turn once in the run.
_STILL = 1e-12


#: States at which the amplification of rounding is sampled, and how often at each.
_AMPLIFIED, _DRAWN = 5, 16
#: Constraints up to which that takes little time.
_QUICK = 600
_SEED = 20061012


def amplification(
    problem: Problem, states: Sequence[tuple[float, Array, Array]]
) -> dict[str, float]:
    """How large rounding of u is in λ and in reactions.

    Rounded coordinates make constraint k miss 0 by ε Σ_i |G_ik u_i|, with a sign of its own.
    To undo that in one step takes (GᵀM⁻¹G)⁻¹ times that over h² of multipliers.

    Args:
        problem: The problem.
        states: Time (s), u and v (n,) of each.

    Returns:
        Quantity → that change over ε, relative as errors of the quantity are, times h² (s²): the
        median over the states of its rms over signs drawn at random.

    Raises:
        numpy.linalg.LinAlgError: When the multipliers of a state are not determined.
    """
    system, random = Index1(problem), np.random.default_rng(_SEED)
    found: list[dict[str, float]] = []
    none = np.empty(0)
    for t, u, v in states:
        multipliers = system.accelerations(t, u, v)[1]
        largest, changed = float(np.abs(multipliers).max(initial=0.0)), system.changes(t, u)
        if not 0 < largest < math.inf:
            continue
        scales = weights(problem, t, u).scales(multipliers)
        here = Reference(t, u, v, multipliers, scales, "converged", 0.0, 0.0, 0.0)
        values = problem.values(t, u, v, np.zeros(problem.m))
        terms = np.abs(values.g * u[problem.pattern.g_rows])
        missed = np.bincount(problem.pattern.g_columns, terms, problem.m)
        squares: dict[str, float] = {}
        for _ in range(_DRAWN):
            pushed = changed(missed * random.choice([-1.0, 1.0], problem.m))[1]
            # Both are to be of one size, as errors are differences.
            scale = largest / (float(np.abs(pushed).max()) or 1.0)
            seen = State(np.array([u, v]), none, multipliers + scale * pushed, *[none] * 4)
            for each in errors(here, seen, problem, t):
                part = (each.statistics.last / scale) ** 2 / _DRAWN
                squares[each.quantity] = squares.get(each.quantity, 0.0) + part
        found.append({name: math.sqrt(square) for name, square in squares.items()})
    names = [name for name in found[0] if name not in ("u", "v", "omega")] if found else []
    medians = {name: float(np.median([each[name] for each in found])) for name in names}
    return {name: float(f"{value:.3g}") for name, value in medians.items() if 0 < value < math.inf}


def facts(problem: Problem, t_end: float, h: float, amplified: bool = False) -> Facts:
    """Singular positions that a motion passes, and whether it moves at all.

    Looks along a damped march; of motions that it does not get through, of large
    problems and of plain Python, which would take too long, it says nothing.

    Args:
        problem: The problem.
        t_end: End (s), counted from the problem's start; positive.
        h: Smallest step size of the study (s).
        amplified: Whether `amplification` is asked for: along the motion, of large problems
            at its start.
    """
    if not problem.compiled or problem.n + problem.m > singular.LARGEST:
        at_start = [(problem.t0, problem.u0, problem.v0)]
        asked = amplified and problem.compiled and problem.m <= _QUICK
        return Facts(amplification=_if_regular(problem, at_start) if asked else {})
    steps = max(min(round(t_end / h), _LOOK_STEPS), 1)
    try:
        march = March(problem, _scheme(DAMPED, t_end / steps))
        recorder = Recorder(march, keep=("u", "v"), most=_LOOKS)
        for stretch in march.recorded(steps, _spread(steps, _LOOKS)):
            recorder.took(stretch)
        seen = recorder.trajectory()
        gradients = [
            singular.gradient(problem, t, u) for t, u in zip(seen.t.tolist(), seen.u, strict=True)
        ]
        times = seen.t - problem.t0
        fastest = float(np.abs(seen.v).max(initial=0.0))
        found = singular.crossings(times, np.array(gradients)) if len(times) > 2 else []
    except Exception:  # of the user's code too; the cells have told what goes wrong
        return Facts()
    size = float(np.abs(problem.u0).max()) or 1.0
    return Facts(
        tuple(float(f"{crossing.t:.4g}") for crossing in found),
        still=len(times) > 0 and fastest * t_end < _STILL * size,
        amplification=_if_regular(problem, _few(seen)) if amplified else {},
    )


def _few(seen: Trajectory) -> list[tuple[float, Array, Array]]:
    """Some states of a motion, evenly spread, its end among them; none where it fails at once."""
    if not len(seen.t):
        return []
    places = np.unique(np.linspace(0, len(seen.t) - 1, _AMPLIFIED).round().astype(int))
    return [(float(seen.t[k]), seen.u[k], seen.v[k]) for k in places.tolist()]


def _if_regular(problem: Problem, states: Sequence[tuple[float, Array, Array]]) -> dict[str, float]:
    try:
        return amplification(problem, states)
    except np.linalg.LinAlgError:
        return {}
