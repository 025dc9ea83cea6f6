"""Marches for notebooks: `march` and `steps`, from arguments to steps that are taken."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from itertools import count
from typing import Any, Literal, TypedDict, Unpack, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from newmark_cli.library import arguments, continuing
from newmark_cli.library.finding import problem as problem_of
from newmark_cli.library.scalings import read, scheme_of
from newmark_cli.library.stepping import MOST_BYTES, Steps, room, taken
from newmark_cli.newmark.formulation import reported
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.kept import KEPT, first_outside
from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.newmark.steps import CONSTANT, StepSequence, TimeGrid, steps_until
from newmark_cli.newmark.trajectory import Step, Trajectory
from newmark_cli.newmark.twins import twins as twins_of
from newmark_cli.problems import starting
from newmark_cli.problems.problem import Problem, is_beyond
from newmark_cli.study import fitting
from newmark_cli.study.axes import Cell
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError, warn

#: More steps than a float can count must be a typo.
_MOST_STEPS = 2**53
#: Part of a step by which t_end may miss its end.
_SAME_STEP = 1e-9
#: Part of accelerations at the start that rounding may change unmentioned.
_NOISY = 1e-2
#: Options that a scheme is made of.
_OF_SCHEME = (
    "form", "integrator", "formulation", "scaling", "evaluation", "precision", "iteration_cap",
    "stop", "projection", "start", "auxiliary",
)  # fmt: skip


class Method(TypedDict, total=False):
    """Arguments of `march` that orders depend on, by their types."""

    integrator: Any
    formulation: Any
    projection: Any
    multipliers: str
    start: str
    evaluation: str


class Options(Method, total=False):
    """Further arguments of `march`, by their types."""

    form: str
    scaling: Any
    precision: str
    h_sequence: Any
    auxiliary: str
    linear_solver: str
    krylov: Mapping[str, float] | Krylov | None
    stop: Mapping[str, float] | Tolerance | None
    iteration_cap: int
    every: int | None
    at: ArrayLike | None
    keep: Sequence[str]
    u0: ArrayLike | Mapping[str, Any] | None
    v0: ArrayLike | Mapping[str, Any] | None
    project: bool
    state: Step | None
    callback: Callable[[Step], object] | None
    twins: int


#: What they are when they are omitted: what a cell of a study has, where it has any.
_USUAL: Mapping[str, Any] = {
    "form": "u-lambda", "integrator": Newmark(), "scaling": "optimal", "keep": KEPT,
    "project": False, **dict.fromkeys(("every", "at", "u0", "v0", "state", "callback")),
    **{of.name: of.default for of in fields(Cell)
       if of.name in Options.__annotations__ and of.default is not MISSING},
}  # fmt: skip


@overload
def march(
    problem: Any,
    *,
    h: ArrayLike,
    t_end: float | None = None,
    steps: Literal[True],
    **options: Unpack[Options],
) -> Steps: ...


@overload
def march(
    problem: Any,
    *,
    h: ArrayLike,
    t_end: float | None = None,
    steps: int | None = None,
    **options: Unpack[Options],
) -> Trajectory: ...


@arguments.scaling_by_either_name
def march(
    problem: Any,
    *,
    h: ArrayLike,
    t_end: float | None = None,
    steps: int | None = None,
    **options: Unpack[Options],
) -> Trajectory | Steps:
    """March a problem, M v' = f + G λ, u' = v, 0 = Φ, with steps of prescribed size.

    It is the march of the command line, to the bit.  A march that fails does not raise:
    the trajectory ends with its last whole step, and its ``status`` says why.

    Args:
        problem: A `Problem`, or whatever `problem` takes.
        h: Step size (s), or the sizes of all steps, an array (steps,); ``t_end`` and ``steps``
            may then be left out, and must not be beyond them.
        t_end: End (s), counted from the problem's ``t0``, which is 0 for mechanisms: whole
            steps up to it are taken.
        steps: In place of ``t_end`` the number of steps; ``True``: return an iterator
            over the steps, without end if there is neither a ``t_end`` nor an array h.
        form: Unknowns that are kept: one of ``u-lambda``, which is taken when omitted,
            ``v-lambda``, ``a-lambda``, ``u-v-lambda``, ``u-v-a-lambda``, ``u-a-lambda``,
            ``v-a-lambda``.
        integrator: ``"trapezoidal"`` when omitted; text such as ``"newmark beta=0.3025
            gamma=0.6"`` or ``"generalized-alpha rho=0.9"``, a dict as in a config, or an object
            of `newmark_cli.newmark.integrator`.
        scaling: ``"optimal"`` (Table 2) when omitted; ``"none"``, ``"left"``, ``"right"``,
            ``"optimal-printed"``, ``"partial"``, or a dict with ``name``, ``left`` and
            ``right`` as in a config; ``preconditioning`` is the same argument.
        evaluation: ``"direct"``, as the paper writes the residuals, when omitted, or
            ``"compensated"``.
        precision: ``"float64"`` when omitted, or ``"float32"``, the arithmetic of the march;
            what is returned is float64.
        formulation: Which constraint rows are solved: ``"index-3"``, the constraints
            themselves, when omitted; ``"index-2"``, ``"index-1"``, ``"baumgarte"``, ``"ggl"``,
            ``"augmented-lagrangian"``; with a parameter text such as
            ``"baumgarte rate=100"``, or a dict as in a config, ``{"method": "baumgarte",
            "rate_h": 1}``.
        projection: After each step: ``"none"`` when omitted; ``"velocity"`` onto Gᵀv + Φ_t = 0, or
            ``"position-velocity"``; a dict ``{"method": "velocity", "accelerations": True}``
            replaces v' too.
        multipliers: Which λ is reported: ``"newton"``, ``"recovered"`` from u and v by the
            index-1 system, ``"total"``, λ + μ/h of a velocity projection; ``"auto"``:
            recovered after a projection, else newton.
        start: ``"consistent"``, or ``"corrected"``: velocities from which λ of the
            trapezoidal rule does not alternate.
        h_sequence: How the step size varies, in multiples of ``h``: ``"constant"``, or a dict
            as in a config, ``{"change": 0.5, "at": 0.5}`` once at a time (s),
            ``{"alternate": [1, 0.5], "every": 5}`` in turn, ``{"random": [0.5, 2], "seed": 1}``.
        auxiliary: What the integrator carries over where the step size changes, by q:
            ``"rescale"`` scales what the auxiliary acceleration of generalized-α differs by from
            v' with q, ``"keep"`` keeps it, ``"restart"`` starts anew from u, v, v'.
            ``"rescale-velocity"``, when omitted, also scales the velocity across the constraints,
            with q² in most integrators: the only one with which λ of index 3 keeps its order.
        linear_solver: ``"auto"``, ``"dense-lu"``, ``"sparse-lu"``, ``"static-lu"``,
            ``"gmres"``.
        krylov: ``{"tolerance": 1e-8, "limit": 600}`` of GMRES.
        stop: ``{"absolute": 1e-8}`` or ``{"relative": 1e-8}``: size of the scaled
            correction at which Newton's iteration stops; ``{"test": "residual", "relative":
            1e-8}`` of the residual, against the step's first; ``{"lambda": {"relative":
            1e-4}}`` by field.  Where rounding stops it, eq. 50, when omitted.
        iteration_cap: Most Newton corrections in a step; 50 when omitted.
        every: Keep the start, every so many steps, and the last; 1 when omitted, 0 keeps
            only the last.  A kept step takes 8 (3 n + m + 2) bytes; more than 1 GB is
            refused.
        at: Keep the steps nearest to these times (s) instead, in any order; ``t`` of the
            trajectory tells which they are.  Without ``t_end`` the march ends at the last.
        keep: Which of ``"u"``, ``"v"``, ``"a"``, ``"lambda"``, all when omitted; ``()`` keeps
            only the ``state`` at the end.
        u0: Coordinates of a start of your own, (n,) (m; angles: rad), or a dict of points,
            ``{"P": (1.0, 0.0)}``, and coordinates, ``{"P.x": 1.0}``; what is not given is
            the problem's.
        v0: Velocities of the start (m/s; of angles: rad/s), given likewise.
        project: Replace a start that misses the constraints by the nearest that meets
            them: first the coordinates, then the velocities, in the norm of M.
        state: Go on from a `Step` in place of the start.  With the same integrator and
            ``h`` the march goes on to the same bits.  At another ``h`` it goes on as
            ``auxiliary`` says; another integrator starts anew from u, v, a, λ.  **λ loses its
            order** behind another integrator, and behind another ``h`` unless ``auxiliary`` is
            ``"rescale-velocity"``, with a `NewmarkWarning`, unless velocities are on the
            constraints: with ``projection="velocity"``, or with ``formulation="index-2"`` or
            ``"ggl"`` in both marches.
        callback: Called with the `Step` after every step that is kept.  It stops the
            march by raising StopIteration; any other exception travels on, and has the
            `Trajectory` so far as its attribute ``trajectory``, as KeyboardInterrupt has.
        twins: How many more marches, from starts one unit in the last place away, tell what
            rounding alone changes: ``twins`` and ``rounding`` of the trajectory.  Not with
            ``steps=True``, ``callback`` or ``state``.

    Returns:
        The trajectory; an iterator with ``steps=True``.

    Raises:
        ArgumentError: For an argument of the wrong type, shape, size or name, and a start
            that misses the constraints.
        ProblemError, DocumentError: When the problem, or a dict, cannot be used.
        IntegratorError, ScalingError, FormulationError: For parameters that give no usable
            scheme.

    Examples:
        >>> import newmark_cli as newmark
        >>> swing = newmark.march("andrews", h=1e-4, t_end=0.03, every=100)
        >>> swing.t.round(3).tolist()
        [0.0, 0.01, 0.02, 0.03]
        >>> swing.constraint("bodies.K1").shape
        (4,)

        Go on from where it ended, with less in memory:

        >>> later = newmark.march("andrews", h=1e-4, t_end=0.04, state=swing.state, every=0)
        >>> later.t.round(3).tolist(), later.u.shape
        ([0.04], (1, 8))
    """
    given = _read(options)
    state, keep, at, callback = (given[name] for name in ("state", "keep", "at", "callback"))
    solver = given["linear_solver"], given["krylov"]
    all_sizes = arguments.step_sizes(h)
    sizes, h = (all_sizes if np.ndim(h) else None), float(all_sizes[0])
    sequence = given["h_sequence"]
    if sizes is not None and sequence != CONSTANT:
        raise ArgumentError("h_sequence: not with an array h, which says all sizes")
    scheme = scheme_of(
        h=h, reported=reported(given["multipliers"], given["projection"]),
        **{name: given[name] for name in _OF_SCHEME},
    )  # fmt: skip
    original = problem_of(problem)
    _require_fit(original, scheme, given)
    subject = _started(original, given["u0"], given["v0"], given["project"], state)
    begins = subject.t0 if state is None else state.t
    if sequence != CONSTANT:
        sizes = h * sequence.factors(_count(h, sequence, t_end, steps, original.t0 - begins), h)
    grid = None if sizes is None else TimeGrid(begins, h, sizes)
    stepped = steps is True
    asked = None if stepped else steps
    if sizes is not None and t_end is None and asked is None and at is None:
        asked = len(sizes)
    begun = continuing.begun(subject, scheme, *solver, state, grid)
    _require_callback(callback, at, stepped)
    last = _last(begun, original.t0, t_end, asked, at, stepped)
    _require_reachable(original, begun.grid, sizes, last)
    if sizes is not None:
        _warn_of_short_steps(begun, float(sizes[:last].min()))
    looks, ends = _looks(begun, last, given["every"], at, keep, stepped)
    if not given["twins"]:
        return taken(begun, last, looks, keep, callback, stepped, ends)
    if stepped or callback is not None or state is not None:
        raise ArgumentError("twins: not with steps=True, callback or state")
    marched = []
    for other in (*twins_of(subject, scheme, given["twins"], *solver, grid), begun):
        continuing.require_finite(other)
        marched.append(cast(Trajectory, taken(other, last, looks, keep, None, False, ends)))
    return replace(marched[-1], twins=marched[:-1])


def steps(
    problem: Any, *, h: ArrayLike, t_end: float | None = None, **options: Unpack[Options]
) -> Steps:
    """A march that is stepped: the same as `march` with ``steps=True``.

    Args:
        problem: As of `march`.
        h: As of `march`.
        t_end: As of `march`; without it the march has no end, or that of an array h.
        **options: Further arguments of `march`.

    Returns:
        An iterator over the steps that are kept.

    Raises:
        NewmarkError: As `march`.

    Examples:
        >>> import newmark_cli as newmark
        >>> for step in newmark.steps("pendulum", h=1e-2, t_end=0.03):
        ...     print(f"{step.t:g} s: {step.u[1]:.6f}", step.converged)
        0.01 s: -0.000050 True
        0.02 s: -0.000200 True
        0.03 s: -0.000450 True
    """
    stepping: Steps = march(problem, h=h, t_end=t_end, steps=True, **options)
    return stepping


def _read(options: Mapping[str, Any]) -> dict[str, Any]:
    """All further arguments of `march`, read."""
    for name in options.keys() - _USUAL.keys():
        raise TypeError(f"march() got an unexpected keyword argument {name!r}")
    return {name: read(name, value) for name, value in {**_USUAL, **options}.items()}


def _require_fit(problem: Problem, scheme: Scheme, at: Mapping[str, Any]) -> None:
    """Refuse a scheme that the problem is not fit for, by the arguments of `march`."""
    for key, why in (*fitting.of_each_other(at), *fitting.of_problem(problem, problem, at)):
        raise ArgumentError(f"{key}: {why}")
    try:
        with np.errstate(all="ignore"):
            factors = np.concatenate([scheme.left, scheme.right]).astype(scheme.dtype)
    except ArithmeticError:
        factors = np.zeros(1)
    if not np.all(np.isfinite(factors) & (factors > 0)):
        raise ArgumentError(f"h is too large or too small, given {scheme.h:g}")


def _started(problem: Problem, u0: Any, v0: Any, project: bool, state: Step | None) -> Problem:
    """The problem with the start that was asked for."""
    if state is not None:
        if not isinstance(state, Step):
            raise ArgumentError(
                "state must be a Step, such as trajectory.state, given " + arguments.shown(state)
            )
        if u0 is not None or v0 is not None or project:
            raise ArgumentError("state is a start: give neither u0, v0 nor project")
        if (len(state.u), len(state.multipliers)) != (problem.n, problem.m):
            raise ArgumentError(
                f"state has {len(state.u)} coordinates and {len(state.multipliers)} "
                f"multipliers, {problem.name} {problem.n} and {problem.m}"
            )
        return problem
    if u0 is None and v0 is None and not project:
        return problem
    return starting.started(
        problem,
        problem.u0 if u0 is None else arguments.coordinates("u0", u0, problem, problem.u0),
        problem.v0 if v0 is None else arguments.coordinates("v0", v0, problem, problem.v0),
        project,
    )


def _require_callback(callback: Any, at: Any, stepped: bool) -> None:
    if stepped and (callback is not None or at is not None):
        raise ArgumentError(
            "steps=True: the loop is the callback, and sees every step; give "
            "neither callback nor at"
        )
    if callback is not None and not callable(callback):
        raise ArgumentError(f"callback must be a function, given {arguments.shown(callback)}")


def _require_reachable(
    problem: Problem, grid: TimeGrid, sizes: Array | None, last: int | None
) -> None:
    """Refuse a last step that the sizes of steps, or tables of the problem, do not reach."""
    if last is not None and last > _MOST_STEPS:
        raise ArgumentError(f"{last:.3g} steps are more than there can be, at most {_MOST_STEPS:g}")
    if sizes is not None and last is not None and last > len(sizes):
        raise ArgumentError(f"h has the sizes of {len(sizes)} steps, {last} are asked for")
    end = grid.t(last or 0)
    if is_beyond(problem.until, end):
        raise ArgumentError(
            f"t_end: must be at most {problem.until:g} s, where a table of {problem.name} ends, "
            f"given {end:g} s"
        )


def _count(h: float, sequence: StepSequence, t_end: Any, steps: Any, since: float) -> int:
    """Steps of a sequence; ``since`` is the time of t_end = 0 from its beginning (s)."""
    if t_end is not None:
        end = arguments.positive("t_end", t_end, " of seconds") + since
        return max(steps_until(end, h, sequence), 1) if end > 0 else 1
    if steps is None or steps is True:
        raise ArgumentError("h_sequence: give t_end or the number of steps")
    return arguments.count("steps", steps)


def _warn_of_short_steps(march: March, shortest: float) -> None:
    """Warn of λ and v' of steps that are so short beside others that they are rounding."""
    u, v, _, a = march.here.fields
    eps, compensated = np.finfo(march.scheme.dtype).eps, march.scheme.compensated
    of_u = eps * float(shortest * np.abs(v).max() if compensated else np.abs(u).max())
    of_a = of_u / march.scheme.integrator.relations(shortest).u_from_a
    if march.schemes.wide and of_a > _NOISY * float(np.abs(a).max()):
        warn(
            f"h: rounding alone changes accelerations of a step of {shortest:g} s by some "
            f"{of_a:.0e}, and λ of that step accordingly; u, v and longer steps do not suffer"
        )


def _last(
    march: March, origin: float, t_end: Any, steps: Any, at: Any, stepped: bool
) -> int | None:
    """Step at which the march ends; None for one without end. ``t_end`` counts from the origin."""
    if t_end is not None and steps is not None:
        raise ArgumentError("t_end or steps: give one of them, not both")
    if t_end is not None:
        return _until(march, origin, arguments.positive("t_end", t_end, " of seconds"))
    if steps is not None:
        return march.done + arguments.count("steps", steps)
    if at is not None:
        times = arguments.vector("at", at)
        if len(times) == 0:
            raise ArgumentError("at must name a time, given none")
        return max(march.done, march.grid.reaching(float(times.max())))
    if stepped:
        return None
    raise ArgumentError("t_end or steps: give one of them")


def _until(march: March, origin: float, t_end: float) -> int:
    """Step at which a march has come to a time since the origin."""
    grid = march.grid
    elapsed = grid.t0 - origin
    last = grid.until(t_end - elapsed) if t_end > elapsed else 0
    if grid.sizes is not None and last == len(grid.sizes):
        # Whole steps up to t_end, as many as there would be if sizes went on like the last.
        missing = origin + t_end - grid.t(last)
        if missing >= grid.size(last) * (1 - _SAME_STEP):
            raise ArgumentError(
                f"t_end: h has the sizes of {last} steps, which end {missing:g} s before it, "
                f"given {t_end:g}"
            )
    if last <= march.done:
        why = (
            f"shorter than the step h = {grid.size(1):g}"
            if march.t == origin
            else f"the march is already at t = {march.t:g}"
        )
        raise ArgumentError(f"t_end: {why}, given {t_end:g}")
    return last


def _looks(
    march: March, last: int | None, every: Any, at: Any, keep: Sequence[str], stepped: bool
) -> tuple[Sequence[int] | Iterator[int], tuple[bool, bool]]:
    """Steps to keep after the first, and whether the first and the last are kept."""
    if at is not None:
        assert last is not None
        if every is not None:
            raise ArgumentError("give either every or at, not both")
        times, end = arguments.vector("at", at), march.grid.t(last)
        if (time := first_outside(times.tolist(), march.t, end, march.grid.h)) is not None:
            raise ArgumentError(f"at: {time:g} s is outside the march, {march.t:g} to {end:g} s")
        nearest = march.grid.nearest(times, march.done, last).tolist()
        _require_room(march, len(nearest), keep, "give fewer times")
        first = bool(nearest) and nearest[0] == march.done
        return nearest[first:], (first, False)
    every = int(bool(keep) or stepped) if every is None else arguments.count("every", every)
    if stepped and every == 0:
        raise ArgumentError("every must be at least 1 with steps=True, given 0")
    if last is None:
        return count(march.done + every, every), (True, False)
    looks = range(march.done + every, last, every) if every else range(0)
    kept = len(looks) + 2
    parts = -(-8 * kept * (3 * march.problem.n + march.problem.m + 2) // MOST_BYTES)
    _require_room(march, kept, keep, f"keep every k-th: every={max(every, 1) * (parts + 1)}")
    return looks, (every > 0, True)


def _require_room(march: March, kept: int, keep: Sequence[str], way_out: str) -> None:
    if kept > (most := room(march, keep)):
        raise ArgumentError(
            f"{kept} steps to keep take more than {MOST_BYTES:g} bytes of memory, at most {most}; "
            f"{way_out}"
        )
