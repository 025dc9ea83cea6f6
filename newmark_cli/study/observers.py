"""Observers: what each measure sees of a march, and the rows that it makes of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from newmark_cli.newmark import perturbation
from newmark_cli.newmark.floor import floor, unpredicted
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.invariants import Misfit, misfits
from newmark_cli.newmark.invariants import invariants as sampled_invariants
from newmark_cli.newmark.kept import DRIFT, ENERGY, OUTPUT, Kept
from newmark_cli.newmark.march import March, Stretch
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.statistics import Measurement, standard_error, statistics
from newmark_cli.newmark.steps import Change
from newmark_cli.newmark.trajectory import Recorder, Trajectory
from newmark_cli.newmark.twins import beside
from newmark_cli.problems import reference as references
from newmark_cli.problems.multipliers import relative, weights, weights_at_start
from newmark_cli.problems.problem import Outputs, Problem
from newmark_cli.problems.reference import Reference
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import DRIFTS, OVER_MOTION
from newmark_cli.study.measures import FLOOR_OF, OF_OUTPUTS, OF_TRAJECTORIES, kind_of
from newmark_cli.support.arrays import Array, IndexArray

#: Steps of a window at which errors over it are looked for at most, unless h changes in it, and
#: those behind its start or a change of h that are all among them.
MOST_LOOKS, AFTER = 200, 40
#: Quantity → (samples, k) by how much components of it are off at each sample, with their
#: signs, in the unit of the row, whose statistics are those of the largest of each sample.
Deviations = Mapping[str, Array]


def _of_largest(measure: str, deviations: Deviations) -> list[Measurement]:
    return [
        Measurement(quantity, measure, "primary", statistics(np.abs(off).max(axis=1)))
        for quantity, off in deviations.items()
    ]


class Observer:
    """Watches the march of a cell; this one sees nothing.

    Args:
        cell: The cell.
        march: Its march, or that of a twin.
        reference: The solution at the end, of a measure that needs it.
    """

    stops: frozenset[int] = frozenset()  #: steps after which it wants to see the march
    #: steps whose states the march is to record for it on the way, ascending. Only one measure may
    #: have any: each takes all that a stretch has recorded.
    looks: Sequence[int] = ()
    reason: str = ""  #: why the march is to end where it stands; empty as long as it may go on

    def __init__(self, cell: Cell, march: March, reference: Reference | None) -> None:
        self.cell, self.march, self.problem, self.reference = cell, march, march.problem, reference
        self.prepare()

    def prepare(self) -> None:
        """The march stands at its start."""

    def took(self, stretch: Stretch) -> None:
        """The march took these steps."""

    def sees(self, march: March) -> None:
        """The march stands at one of the stops, or at its start if it takes no steps."""

    def measured(self) -> list[Measurement]:
        """Rows of the CSV, once the march is over."""
        return []

    @property
    def deviations(self) -> Deviations:
        """What its rows are about, of a measure that twins march for."""
        return {}

    def unresolved(self, quantity: str) -> float:
        """By how much what a quantity deviates from may be off itself."""
        return 0.0

    @property
    def trajectory(self) -> Mapping[str, Array | IndexArray]:
        """Column of the file of trajectories → (k,) values at the steps that were kept."""
        return {}


def sample_steps(steps: int, samples: int) -> IndexArray:
    """Up to ``samples`` evenly spread steps, counted from 1, the last among them."""
    return np.unique(np.round(np.linspace(0, steps, min(steps, samples) + 1)[1:]).astype(np.int64))


class _Sampler(Observer):
    """Sees the march at evenly spread steps."""

    def prepare(self) -> None:
        self.stops = frozenset(sample_steps(self.cell.steps, self.cell.samples).tolist())
        self.samples: list[Any] = []

    def sees(self, march: March) -> None:
        self.samples.append(self.sample(march))

    def sample(self, march: March) -> Any:
        """What it notes of the march where it stands."""
        raise NotImplementedError


class _Corrections(Observer):
    """The last decreasing corrections of each step."""

    def prepare(self) -> None:
        self._norms = [np.zeros((0, len(self.march.scheme.recorded)))]
        self._iterations = [np.zeros(0, np.int64)]

    def took(self, stretch: Stretch) -> None:
        self._norms.append(stretch.norms)
        self._iterations.append(stretch.iterations)

    def measured(self) -> list[Measurement]:
        norms, iterations = np.concatenate(self._norms), np.concatenate(self._iterations)
        return corrections(self.march.schemes.base, norms, iterations, self._physical(norms))

    def _physical(self, norms: Array) -> Mapping[str, Array]:
        """`physical_norms`, by the scheme of each step."""
        schemes, grid = self.march.schemes, self.march.grid
        if not grid.varies:
            return physical_norms(schemes.base, norms)
        kinds, which = np.unique(grid.kinds(np.arange(1, len(norms) + 1)), return_inverse=True)
        physical: dict[str, Array] = {}
        for number, kind in enumerate(kinds.tolist()):
            of_kind = physical_norms(schemes.of_kind(kind), norms[which == number])
            for name, values in of_kind.items():
                physical.setdefault(name, np.empty(len(norms)))[which == number] = values
        return physical


def physical_norms(scheme: Scheme, norms: Array) -> dict[str, Array]:
    """Norms of corrections in physical units: D_R times the scaled ones.

    An eliminated field's follows from the weights of the form, one kept field each.  Norms are
    (steps, k), of the blocks that `Scheme.recorded` names.
    """
    form = scheme.form
    right = dict(zip(form.unknowns, scheme.right, strict=True))
    physical = {
        name: right.get(name, 1.0) * of_block
        for name, of_block in zip(scheme.recorded, norms.T, strict=True)
    }
    for eliminated in set(form.eliminated) - set(physical):
        weights = np.abs(scheme.elimination.weights[FIELDS.index(eliminated)])
        source = int(np.argmax(weights))
        physical[eliminated] = weights[source] * physical[form.kept[source]]
    return physical


def corrections(
    scheme: Scheme,
    norms: Array,
    iterations: IndexArray,
    physical: Mapping[str, Array] | None = None,
) -> list[Measurement]:
    """Measurements of the recorded Newton corrections.

    Norms are (steps, k), of the blocks that `Scheme.recorded` names, with their `physical_norms`
    where the scheme is not that of all steps; steps with a negative count of iterations (steps,)
    did not converge and are left out.
    """
    physical = physical_norms(scheme, norms) if physical is None else physical
    form, counted = scheme.form, iterations > 0
    scaled = dict(zip(scheme.recorded, norms.T, strict=True))
    rows = [("correction", unknown, scaled[unknown]) for unknown in form.unknowns]
    physical_rows = (*FIELDS, *form.multipliers)
    rows += [("physical_correction", quantity, physical[quantity]) for quantity in physical_rows]
    measurements = []
    for measure, quantity, values in rows:
        kept = values[counted]
        of_steps = replace(statistics(kept), rounding=standard_error(kept))
        role = "recovered" if quantity in form.eliminated else "primary"
        measurements.append(Measurement(quantity, measure, role, of_steps))
    return measurements


class _Iterations(_Corrections):
    """Newton's iterations in each step."""

    def measured(self) -> list[Measurement]:
        counts = np.abs(np.concatenate(self._iterations)) * 1.0
        return [Measurement("newton", "tolerance", "primary", statistics(counts))]


class _Conditions(_Sampler):
    """Condition numbers of the scaled Jacobian."""

    def sample(self, march: March) -> float:
        return march.system.balanced(march.t, march.here).condition()

    def measured(self) -> list[Measurement]:
        values = statistics(np.array(self.samples))
        return [Measurement("jacobian", "condition", "primary", values)]


class _Sensitivities(_Sampler):
    """Sensitivities at a state, and at one beside it: rounding alone tells these apart."""

    def sample(self, march: March) -> tuple[dict[tuple[str, str], float], ...]:
        here = march.here
        return tuple(
            perturbation.sensitivities(march.problem, march.scheme, march.t, state, march.system)
            for state in (here, beside(here))
        )

    def measured(self) -> list[Measurement]:
        measurements = []
        for row, unknown in self.samples[0][0] if self.samples else ():
            values, others = np.array(
                [[of_state[row, unknown] for of_state in sample] for sample in self.samples]
            ).T
            rounding = float(np.median(np.abs(values - others)))
            of_row = replace(statistics(values), rounding=rounding)
            measurements.append(Measurement(unknown, "sensitivity", "primary", of_row, row))
        return measurements


class _Errors(Observer):
    """Errors of the final state."""

    def prepare(self) -> None:
        self.stops = frozenset((self.cell.steps,))
        self._seen: list[tuple[float, Array, Array, Array]] = []

    def sees(self, march: March) -> None:
        state = march.seen
        u, v = np.asarray(state.fields[:2], float)
        self._seen.append((march.t, u, v, state.multipliers))

    @cached_property
    def deviations(self) -> Deviations:
        if not self._seen or self.reference is None:
            return _no_errors(self.problem)
        t, u, v, multipliers = (np.array(of) for of in zip(*self._seen, strict=True))
        here = parts(self.problem, t, u, v, multipliers)
        return self.errors(t, here, self.reference) or _no_errors(self.problem)

    def errors(self, t: Array, here: Mapping[str, Array], reference: Reference) -> Deviations:
        """Those of the states that it has seen, as `parts` has them."""
        return errors(self.problem, t, here, reference)

    def unresolved(self, quantity: str) -> float:
        return error_of(self.reference, quantity)

    def measured(self) -> list[Measurement]:
        return _of_largest("error", self.deviations) if self._seen else []


def error_of(reference: Any, quantity: str) -> float:
    """The error of a reference itself in a quantity; 0 without one."""
    part = OF_OUTPUTS.get(quantity, quantity)
    name = {"lambda": "multipliers"}.get(part, part)
    return float(getattr(reference, f"{name}_error", 0.0))


def _off_outputs(
    outputs: Outputs, here: Array, there: Array, u: Array
) -> Iterator[tuple[str, Array]]:
    """Kind of output → by how much those of that kind are off, relative to the largest of them.

    Args:
        outputs: Their names, and the length that moments refer to.
        here, there: (…, k) outputs of a march, and those of the motion.
        u: (n,) coordinates of the motion.
    """
    names = [kind_of(name) for name in outputs.names]
    groups = {kind: np.array(names) == kind for kind in OF_OUTPUTS if kind in names}
    for kind, of in groups.items():
        size = float(np.abs(there[..., of]).max())
        if kind == "moment":
            # Moments about axes that turn freely are rounding of those of forces.
            lever = outputs.length(u)
            size = max(lever * float(np.abs(there[..., groups["force"]]).max()), size)
        yield kind, relative(here[..., of] - there[..., of], size)


def parts(problem: Problem, t: Array, u: Array, v: Array, multipliers: Array) -> dict[str, Array]:
    """u, v, lambda and, of a problem that has any, output → (k, …) at (k,) times and states."""
    named = {"u": u, "v": v, "lambda": multipliers}
    if problem.outputs is not None:
        states = zip(t, u, v, multipliers, strict=True)
        named["output"] = np.array([problem.outputs.values(problem, *state) for state in states])
    return named


def errors(
    problem: Problem, t: Array, here: Mapping[str, Array], reference: Reference
) -> Deviations:
    """Errors of a final state, component by component, relative to the largest component.

    Errors of λ are relative to `newmark_cli.problems.reference.Reference.scales`.

    Args:
        problem: What was marched.
        t: (1,) time of the state (s).
        here: Part → (1, …) values of the state; what is missing has no errors.
        reference: The motion at that time.
    """
    motion = reference.u[None], reference.v[None], reference.multipliers[None]
    return _relative_errors(problem, here, parts(problem, t, *motion), reference.scales)


def motion_errors(problem: Problem, t: Array, here: Mapping[str, Array]) -> Deviations:
    """Errors at some times, component by component, relative to the largest over these times.

    Args:
        problem: What was marched.
        t: (k,) times (s), ascending.
        here: Part → (k, …) values at these times; what is missing has no errors.
    """
    if not len(t):
        return {}
    try:
        motion = references.along(problem, t - problem.t0)
    except references.NoReference:
        return {}
    there = parts(problem, t, *motion)
    scales = np.abs(there["lambda"]).max(axis=0)
    if problem.m:
        scales = weights(problem, float(t[-1]), there["u"][-1]).scales(scales)
    return _relative_errors(problem, here, there, scales)


def _relative_errors(
    problem: Problem, here: Mapping[str, Array], there: Mapping[str, Array], scales: Array
) -> Deviations:
    """Errors of parts of a march, those of λ relative to the scales."""
    sizes: dict[str, Any] = {name: float(np.abs(there[name]).max()) for name in ("u", "v")}
    if problem.m:
        sizes["lambda"] = scales
    off = {
        name: relative(here[name] - there[name], size)
        for name, size in sizes.items()
        if name in here
    }
    if problem.outputs is not None and "output" in here:
        off |= _off_outputs(problem.outputs, here["output"], there["output"], there["u"][-1])
    return off


def _no_errors(problem: Problem) -> dict[str, Array]:
    """Quantity that has errors → none of it, as `Deviations`."""
    kinds = {kind_of(name) for name in problem.outputs.names} if problem.outputs else set()
    names = ("u", "v", "lambda", *(kind for kind in OF_OUTPUTS if kind in kinds))
    return {name: np.zeros((0, 1)) for name in names}


def looked_at(first: int, last: int, changes: Sequence[int] = ()) -> IndexArray:
    """Steps of a window at which errors are looked for: all of them, or the most telling.

    What the start of the window or a change of h leaves dies out after a number of steps, however
    short they are: the first `AFTER` of them are among those of a long window.
    """
    every = np.arange(first, last + 1)
    if len(every) <= MOST_LOOKS:
        return every
    spread = np.round(np.linspace(first, last, MOST_LOOKS - AFTER * (1 + len(changes))))
    behind = [begin + np.arange(AFTER) for begin in (first, *changes)]
    steps = np.unique(np.concatenate([spread.astype(np.int64), *behind]))
    return steps[(steps >= first) & (steps <= last)]


class _MotionErrors(_Errors):
    """Errors over the motion, or a part of it."""

    def prepare(self) -> None:
        super().prepare()
        cell, t0, grid = self.cell, self.problem.t0, self.march.grid
        assert cell.error is not None
        since, until = cell.error.since, cell.error.until
        first = grid.reaching(t0 + since) + 1
        last = cell.steps if until is None else min(grid.reaching(t0 + until), cell.steps)
        change = cell.h_sequence.at if isinstance(cell.h_sequence, Change) else -1.0
        changes = [grid.reaching(t0 + change) + 1] if change >= since else []
        self.stops = frozenset(looked_at(first, last, changes).tolist())

    def errors(self, t: Array, here: Mapping[str, Array], reference: Reference) -> Deviations:
        return motion_errors(self.problem, t, here)

    def measured(self) -> list[Measurement]:
        assert self.cell.error is not None
        return _of_largest(self.cell.error.record, self.deviations)


class _Invariants(_Sampler):
    """Errors of what an exact motion keeps."""

    def sample(self, march: March) -> dict[str, Misfit]:
        return sampled_invariants(march.problem, march.t, march.seen)

    @property
    def deviations(self) -> Deviations:
        return invariants(self.problem, self.samples)

    def measured(self) -> list[Measurement]:
        return _of_largest("invariant", self.deviations)


def invariants(problem: Problem, samples: Sequence[Mapping[str, Misfit]]) -> Deviations:
    """`newmark_cli.newmark.invariants` at the sampled states.

    Each error is divided by the largest size among the samples; 0 where all vanish.
    """
    relative_errors = {}
    for name in samples[0] if samples else ():
        errors, sizes = (
            np.array(values) for values in zip(*(s[name] for s in samples), strict=True)
        )
        largest = sizes.max(axis=0)
        if name == "multiplier":
            largest = weights_at_start(problem).scales(largest)
        relative_errors[name] = relative(errors, largest)
    return relative_errors


class _KrylovSolves(Observer):
    """Iterations and residuals of a Krylov solver, over all solves."""

    def measured(self) -> list[Measurement]:
        solver: Any = self.march.system
        values = {"krylov_iterations": solver.iterations, "krylov_residual": solver.residuals}
        return [
            Measurement("jacobian", measure, "primary", statistics(np.array(of_solves, float)))
            for measure, of_solves in values.items()
        ]


class _Trajectories(Observer):
    """States of the steps that are kept."""

    def prepare(self) -> None:
        kept = self._kept = self.cell.trajectory or Kept()
        steps = kept.looks(self.march.grid, self.cell.steps)
        wanted = {*kept.keep, *(("u", "v") if {ENERGY, DRIFT} & {*kept.keep} else ())}
        if OUTPUT in kept.keep and self.problem.outputs is not None:
            wanted |= {"u", "v", "lambda"}
        self._recorder = Recorder(self.march, [*wanted], len(steps) + 1)
        if steps and steps[0] == 0:
            self._recorder.keep_here()
            steps = steps[1:]
        self.looks = steps

    def took(self, stretch: Stretch) -> None:
        self._recorder.took(stretch)

    @cached_property
    def _over_time(self) -> tuple[dict[str, Array | IndexArray], list[Measurement]]:
        if not self._kept.at:
            self._recorder.keep_here()
        return over_time(self.problem, self._kept, self._recorder.trajectory())

    @property
    def trajectory(self) -> Mapping[str, Array | IndexArray]:
        return self._over_time[0]

    def measured(self) -> list[Measurement]:
        return self._over_time[1]


def over_time(
    problem: Problem, kept: Kept, recorded: Trajectory
) -> tuple[dict[str, Array | IndexArray], list[Measurement]]:
    """Columns of the file of trajectories, and the rows of the CSV: the largest of each quantity.

    Args:
        problem: What was marched.
        kept: What is kept of each step.
        recorded: The steps that are kept.
    """
    drifts: dict[str, Array] = {}
    if DRIFT in kept.keep:
        states = zip(recorded.t.tolist(), recorded.u, recorded.v, strict=True)
        missed = [misfits(problem, *state) for state in states]
        drifts = {name: np.array([of[name].error for of in missed]) for name in DRIFTS}
    # The start is no step; where it is all that was kept, it has to do.
    after = slice(1, None) if len(recorded.t) > 1 and recorded.numbers[0] == 0 else slice(None)
    sizes = {name: recorded.arrays[name] for name in recorded.arrays if name in kept.keep}
    if ENERGY in kept.keep and recorded.energy is not None:
        sizes[ENERGY] = recorded.energy[:, None]
    if OUTPUT in kept.keep and recorded.output_names:
        sizes[OUTPUT] = recorded.outputs
    sizes |= {name: values[:, None] for name, values in drifts.items()}
    largest = {
        name: np.abs(values[after]).max(axis=1, initial=0.0) for name, values in sizes.items()
    }
    if "lambda" in sizes:
        largest["lambda"] = weights_at_start(problem).largest(sizes["lambda"][after])
    columns = {"step": recorded.numbers} | recorded.columns(kept.keep)
    columns |= {f"{DRIFT}[{name}]": values for name, values in drifts.items()}
    return columns, [
        Measurement(name, "trajectory", "primary", statistics(largest[name]))
        for name in OF_TRAJECTORIES
        if name in largest
    ]


class _Floors(_Sampler):
    """Expected sizes of the last corrections, from steps off by rounding."""

    def prepare(self) -> None:
        super().prepare()
        self._converged = True
        if unpredicted(self.march.scheme):
            self.stops = frozenset()

    def took(self, stretch: Stretch) -> None:
        if len(stretch.iterations):
            self._converged = bool(stretch.iterations[-1] > 0)

    def sees(self, march: March) -> None:
        # The state after a step that did not converge is no state of the motion.
        if self._converged:
            found = floor(march)
            if not np.isnan(list(found.scaled.values())).any():
                self.samples.append((found.scaled, found.physical))

    def measured(self) -> list[Measurement]:
        return [
            Measurement(unknown, name, "primary", statistics(np.array(values)))
            for k, name in enumerate(FLOOR_OF.values())
            for unknown in self.march.scheme.form.unknowns
            for values in ([at[k][unknown] for at in self.samples],)
        ]


#: Measure → its observer.
OBSERVERS: Mapping[str, type[Observer]] = MappingProxyType(
    {
        "correction": _Corrections,
        "condition": _Conditions,
        "sensitivity": _Sensitivities,
        "error": _Errors,
        "invariant": _Invariants,
        "krylov": _KrylovSolves,
        "tolerance": _Iterations,
        "trajectory": _Trajectories,
        "floor": _Floors,
        OVER_MOTION: _MotionErrors,
    }
)
