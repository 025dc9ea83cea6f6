"""Where a march begins: at the start of a problem, or at a step of another march."""

import math
from dataclasses import replace

import numpy as np

from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.formulation import RECOVERED, Formulation, Projection
from newmark_cli.newmark.linear.choice import Krylov
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.newmark.trajectory import Step
from newmark_cli.problems.algebra import product
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import warn

#: Step sizes that differ by less, relative to their size, are the same.
_SAME_H = 1e-12
#: Units of rounding that a state may miss constraints by: 1.4 are the most where they are
#: enforced, 30 the least where they are not and h is 1e-4 of the time of the march.
_ROUNDING = 10.0
#: Part of the rounding of u that velocities have in compensated evaluation, at most.
_COMPENSATED = 1e-3
#: In place of zero.
_TINY = np.finfo(float).tiny


def begun(
    problem: Problem,
    scheme: Scheme,
    linear_solver: str,
    krylov: Krylov | None,
    state: Step | None,
    grid: TimeGrid | None,
) -> March:
    """The march at its start, or at the step that it goes on from."""
    try:
        if state is None:
            march = March(problem, scheme, linear_solver, krylov, grid=grid)
        else:
            march = _continued(problem, state, (scheme, linear_solver, krylov), grid)
    except np.linalg.LinAlgError as error:
        raise ProblemError(
            f"{problem.name}: accelerations at the start are not determined: {error}"
        ) from None
    require_finite(march)
    return march


def require_finite(march: March) -> None:
    """Refuse a start from which no march can go on."""
    if not all(np.all(np.isfinite(array)) for array in march.state):
        raise ProblemError(f"{march.problem.name}: the start leads to numbers that are not finite")


def _continued(
    problem: Problem, state: Step, how: tuple[Scheme, str, Krylov | None], grid: TimeGrid | None
) -> March:
    scheme, (carried, kept) = how[0], (state.carried, state.carried.state)
    _warn_of_loss(problem, scheme, state)
    if _enforced(carried.scheme) != _enforced(scheme):
        # The residuals of the constraints were not carried along.
        system = Index1(problem)
        phi = problem.constraint_values(state.t, state.u)
        psi, unknown = system.rate(state.t, state.u, state.v), np.zeros_like(kept.rates)
        kept = kept._replace(phi=phi, psi=psi, rates=unknown)
    if grid is None and _same_steps(state, scheme):
        return March(replace(problem, t0=carried.t0), *how, state=kept, done=carried.done)
    before: tuple[float, float] | None = (carried.scheme.h, carried.before)
    if carried.scheme.integrator != scheme.integrator:
        fields = kept.fields[[0, 1, 3, 3]].astype(float)
        kept = kept._replace(
            fields=fields,
            past=product(scheme.relations.start, fields[:3]),
            rates=np.zeros_like(kept.rates),
            offsets=np.zeros_like(kept.offsets),
        )
        before = None
    grid = TimeGrid(state.t, scheme.h, None if grid is None else grid.sizes, before)
    march = March(replace(problem, t0=state.t), *how, state=kept, grid=grid)
    march.earlier = carried.steps
    return march


def _same_steps(state: Step, scheme: Scheme) -> bool:
    """Whether a state was made with this integrator and, but for rounding, this h."""
    made = state.carried.scheme
    same_h = math.isclose(made.h, scheme.h, rel_tol=_SAME_H)
    return same_h and made.integrator == scheme.integrator


def _enforced(scheme: Scheme) -> tuple[Formulation, Projection]:
    return scheme.formulation, scheme.projection


def _warn_of_loss(problem: Problem, scheme: Scheme, state: Step) -> None:
    """Warn where multipliers lose their order after a state marched with other settings."""
    if not _loses(problem, scheme, state):
        return
    both = (state.carried.scheme, scheme)
    settings = (
        ("h =", *(repr(of.h) for of in both)),
        ("integrator", *(of.integrator.label for of in both)),
        ("formulation and projection", *(", ".join(x.label for x in _enforced(of)) for of in both)),
    )
    differences = "; ".join(f"{key} {old}, here {new}" for key, old, new in settings if old != new)
    way_out = "take projection='velocity', or formulation='index-2' in both marches"
    if scheme.projection.level:
        way_out = "leave multipliers='auto'"
    warn(
        f"state: made with {differences}: λ loses its order of accuracy, because the state does "
        f"not meet the constraints as steps of this march leave them; {way_out}"
    )


def _loses(problem: Problem, scheme: Scheme, state: Step) -> bool:
    """Whether multipliers lose their order behind a state.

    Index 3 leaves Gᵀv + Φ_t = c h², c being the integrator's, and takes what it starts from
    for the same: from another h, unless that is scaled, λ is off by O(h), and without damping
    by O(1) for good.
    Likewise rows that ask for Φ, or for its rate, put right in one step what others have let
    drift.  Nothing is lost by rows that let them drift on, or where velocities are projected
    and λ is recovered from them.
    """
    made, projects = state.carried.scheme, scheme.projection.level
    previous, projected = made.formulation, made.projection.level
    # A penalty enforces what index 3 does.
    alike = _enforced(made) == _enforced(scheme) or (
        {previous.method, scheme.formulation.method} <= {INDEX_3, "augmented-lagrangian"}
        and not (projected or projects)
    )
    same = made.integrator == scheme.integrator
    if alike and same and (scheme.across or _same_steps(state, scheme)):
        return False
    rows, recovered = scheme.formulation.kind.rows, scheme.reported == RECOVERED
    drifts = rows in (("Ca",), ("B",)) and not scheme.formulation.scheduled
    if recovered if projects else drifts:
        return False
    asks_position, asks_rate = bool(projects) or rows != ("Cv",), not recovered
    keeps_position, keeps_rate = _keeps(previous, projected)
    of_position, of_rate = _misfits(problem, state)
    return (
        (asks_position and not keeps_position and of_position > _ROUNDING)
        or (asks_rate and not keeps_rate and of_rate > _ROUNDING)
        or bool(projects and np.any(state.carried.state.impulse))
    )


def _keeps(formulation: Formulation, projected: int) -> tuple[bool, bool]:
    """Whether a march leaves its states on Φ = 0, and on Φ' = 0."""
    kind = formulation.kind
    return projected == 2 or "C" in kind.rows or kind.penalised, projected > 0 or "Cv" in kind.rows


def _misfits(problem: Problem, state: Step) -> tuple[float, float]:
    """What a state misses of Φ = 0 and of Gᵀv + Φ_t = 0, in units of what rounding leaves.

    Rounding leaves distances of eps |u|, and velocities of eps |v| and, but in compensated
    evaluation, eps |u|/h.
    """
    kept, t = state.carried.state, state.t
    u, v = kept.fields[:2].astype(float)
    values = problem.values(t, u, v, np.zeros(problem.m)).g
    lengths = np.sqrt(np.bincount(problem.pattern.g_columns, values**2, minlength=problem.m))
    eps = np.finfo(kept.fields.dtype).eps
    of_u, of_v = eps * np.abs(u).max(), eps * np.abs(v).max()
    of_v += of_u / state.carried.scheme.h * (_COMPENSATED if np.any(kept.lows) else 1.0)

    def worst(missed: Array, unit: float) -> float:
        with np.errstate(over="ignore"):
            return float(np.max(np.abs(missed) / np.maximum(lengths * unit, _TINY), initial=0.0))

    phi = problem.constraint_values(t, u)
    return worst(phi, of_u), worst(Index1(problem).rate(t, u, v), of_v)
