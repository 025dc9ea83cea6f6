"""Trajectories: what a march passed, as arrays, and the states that it can go on from."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.gaps import GapWatch
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.kept import ENERGY, KEPT, OUTPUT
from newmark_cli.newmark.march import March, Stretch
from newmark_cli.newmark.march_data import COMPLETED, DIVERGED, ENDINGS, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.twins import spread
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray, Mask
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

#: Row of `State.fields`: a trajectory's a is the true acceleration v', not the
#: integrator's auxiliary one.
_ROWS = {"u": 0, "v": 1, "a": 3}

#: Status of a march that ends because a row that was dropped is needed.
REDUNDANT = "redundant"

_MESSAGES = {
    "ok": "the march reached its end",
    "not_converged": "the march reached its end, but Newton's iteration did not converge "
    "in some steps",
    "stopped": "the march was stopped by its caller",
    "singular": "the Jacobian is singular in the next step",
    "diverged": "Newton's iteration left the range of floating point in the next step",
    "stagnated": "the Krylov solver did not reach its tolerance in the next step",
    "interrupted": "the march was interrupted by an exception",
    REDUNDANT: "a row that was released as redundant opens",
}


@dataclass(frozen=True)
class _Carried:
    """All that a march needs to continue from a step to the same bits."""

    state: State  #: a copy of the march's state
    t0: float  #: time of the start from which steps count (s); where their sizes vary, now
    done: int  #: steps since then
    steps: int  #: steps of the march
    #: of the last step: its integrator has past vectors in the state, its formulation and
    #: projection decide what of Φ and Φ' is left
    scheme: Scheme
    before: float  #: size of the step before the last (s)


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """A march after one of its steps, to look at and to go on from.

    `march` hands it to callbacks, a march that is stepped yields it, and
    ``trajectory.state`` is the last one; ``march(..., state=step)`` goes on from there.
    The arrays are copies.

    Attributes:
        t: Time (s).
        u: (n,) coordinates (m for mechanisms).
        v: (n,) velocities (m/s).
        a: (n,) accelerations v' (m/s²), which the dynamics and their multipliers give;
            not the auxiliary acceleration of generalized-α and HHT.
        multipliers: (m,) λ; see "Multipliers" in docs/python.md for sign and units.
        iterations: Newton corrections computed in the step; 0 at the start.
        converged: Whether Newton's iteration converged, or met its tolerance.
        norms: Unknown (``"u"``, ``"lambda"`` and so on) → 2-norm of the last decreasing
            correction, in the scaled unknowns that the solver sees (eq. 50); 0 at the start.
        carried: What the march goes on with; not public.

    Examples:
        >>> import newmark_cli as newmark
        >>> for step in newmark.march("pendulum", h=1e-2, t_end=3.0, steps=True):
        ...     if step.u[1] < -0.5:
        ...         break
        >>> round(step.t, 2), step.converged, sorted(step.norms)
        (1.03, True, ['lambda', 'u'])
    """

    t: float
    u: Array
    v: Array
    a: Array
    multipliers: Array
    iterations: int
    converged: bool
    norms: Mapping[str, float]
    carried: _Carried = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"Step(t={self.t:g}, n={len(self.u)}, m={len(self.multipliers)}, "
            f"iterations={self.iterations}, converged={self.converged})"
        )


def step_of(march: March, stretch: Stretch | None = None) -> Step:
    """Where a march stands."""
    here, scheme, varies = march.seen, march.scheme, march.grid.varies
    iterations, norms = 0, [0.0] * len(scheme.recorded)
    if stretch and len(stretch.iterations):
        iterations, norms = int(stretch.iterations[-1]), stretch.norms[-1].tolist()
    carried = _Carried(
        march.state.copy(),
        march.t if varies else march.problem.t0,
        0 if varies else march.done,
        march.earlier + march.done,
        scheme,
        march.grid.size(march.done - 1),
    )
    return Step(
        t=march.t,
        u=here.fields[_ROWS["u"]],
        v=here.fields[_ROWS["v"]],
        a=here.fields[_ROWS["a"]],
        multipliers=here.multipliers,
        iterations=abs(iterations),
        converged=iterations >= 0,
        norms=dict(zip(scheme.recorded, norms, strict=True)),
        carried=carried,
    )


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A motion as a march took it, at the k steps that were kept.

    No number in it is NaN or infinite: where a march fails, the trajectory ends with its
    last whole step, and `status` and `message` say why.

    Attributes:
        t: (k,) times (s).
        numbers: (k,) numbers of the steps that were kept, counted from the start, or from
            that of the march that this one went on with.
        iterations: (k,) Newton corrections computed in each kept step; 0 at the start.
        converged: (k,) whether Newton's iteration converged in it.
        status: ``"ok"``; ``"not_converged"``, in some steps, see `not_converged`;
            ``"stopped"`` by the caller; ``"interrupted"`` by an exception; or why there
            is no next step: ``"singular"``, ``"diverged"``, ``"stagnated"``; or
            ``"redundant"``, where a row that was released as redundant opens.
        steps: Steps taken by this march.
        not_converged: How many of them ended before Newton's iteration converged.
        newton_iterations: Corrections computed by all of them.
        h: Step size (s); where it varies that of which the sizes are multiples.
        state: The last step, to look at and to go on from: ``march(..., state=…)``.
        problem: What was marched, with the start that it was marched from.
        arrays: ``"u"``, ``"v"``, ``"a"``, ``"lambda"`` → array, of those that were kept.
        reason: What there is to say of the status besides; may be empty.
        twins: Marches from starts one unit in the last place away, as many as were asked for.

    Examples:
        >>> import newmark_cli as newmark
        >>> swing = newmark.march("pendulum", h=1e-2, t_end=3.0)
        >>> swing.status, swing.t.shape, swing.u.shape, swing.multipliers.shape
        ('ok', (301,), (301, 2), (301, 1))
        >>> swing.constraint_names
        ('bars.rod',)
        >>> bool(abs(swing.energy - swing.energy[0]).max() < 1e-3)
        True
        >>> list(swing.to_frame().columns)[:3]
        ['t', 'u[P.x]', 'u[P.y]']
    """

    t: Array
    numbers: IndexArray
    iterations: IndexArray
    converged: Mask
    status: str
    steps: int
    not_converged: int
    newton_iterations: int
    h: float
    state: Step
    problem: Problem = field(repr=False)
    arrays: Mapping[str, Array] = field(repr=False)
    reason: str = field(default="", repr=False)
    twins: Sequence["Trajectory"] = field(default=(), repr=False)

    def __repr__(self) -> str:
        return (
            f"Trajectory({self.problem.name}, status={self.status!r}, steps={self.steps}, "
            f"h={self.h:g}, kept={len(self.t)})"
        )

    @property
    def success(self) -> bool:
        """Whether the march reached its end, or its caller's, and every step converged."""
        return self.status in ("ok", "stopped") and not self.not_converged

    @property
    def message(self) -> str:
        """The status in a sentence."""
        where = f" (t = {self.state.t:g}, {self.steps} steps taken)"
        return _MESSAGES[self.status] + where + (f": {self.reason}" if self.reason else "")

    def _array(self, name: str) -> Array:
        if name not in self.arrays:
            kept = ", ".join(self.arrays) or "none"
            raise ArgumentError(f"{name} was not kept; kept: {kept}; see 'keep' of march")
        return self.arrays[name]

    @property
    def u(self) -> Array:
        """(k, n) coordinates (m); raises ArgumentError where they were not kept."""
        return self._array("u")

    @property
    def v(self) -> Array:
        """(k, n) velocities (m/s); raises ArgumentError where they were not kept."""
        return self._array("v")

    @property
    def a(self) -> Array:
        """(k, n) accelerations v' (m/s²), which M v' = f + G λ gives.

        Not the auxiliary acceleration that generalized-α and HHT carry along.  Raises
        ArgumentError where they were not kept.
        """
        return self._array("a")

    @property
    def multipliers(self) -> Array:
        """(k, m) λ; raises ArgumentError where they were not kept."""
        return self._array("lambda")

    @cached_property
    def rounding(self) -> Mapping[str, Array]:
        """What rounding alone changes in what was kept: of ``"u"``, ``"lambda"`` and so on.

        The standard deviation over the march and its `twins`, of the shape of the array;
        infinite where a twin ended before.  Empty without twins.
        """
        if not self.twins:
            return {}
        return {
            name: spread([trajectory.arrays[name] for trajectory in (self, *self.twins)])
            for name in self.arrays
        }

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """(n,) names of the columns of u, v and a."""
        return self.problem.coordinate_names

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """(m,) names of the columns of λ."""
        return self.problem.constraint_names

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the moving points of a mechanism; none of another problem."""
        return self.problem.points

    @cached_property
    def energy(self) -> Array | None:
        """(k,) total energy (J), up to a constant; None where none is conserved.

        Raises ArgumentError where u or v were not kept.
        """
        if self.problem.potential is None:
            return None
        states = zip(self.t.tolist(), self.u, self.v, strict=True)
        energies = [self.problem.energies(t, u, v) or (0.0, 0.0) for t, u, v in states]
        return np.asarray(np.array(energies).sum(axis=1))

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of angular velocities, reactions, and of what the file asks for as ``outputs``."""
        return self.problem.outputs.names if self.problem.outputs else ()

    @property
    def not_unique(self) -> tuple[str, ...]:
        """Outputs that depend on which redundant constraints were dropped; see docs/spatial.md."""
        return self.problem.outputs.not_unique if self.problem.outputs else ()

    @cached_property
    def outputs(self) -> Array:
        """(k, outputs) what `output_names` name.

        Raises ArgumentError where u, v or λ were not kept.
        """
        if self.problem.outputs is None:
            return np.empty((len(self.t), 0))
        states = zip(self.t.tolist(), self.u, self.v, self.multipliers, strict=True)
        rows = [self.problem.outputs.values(self.problem, *state) for state in states]
        return np.array(rows).reshape(len(self.t), -1)

    def output(self, name: str) -> Array:
        """(k,) one output of a mechanism, such as a reaction.

        Args:
            name: One of `output_names`.

        Raises:
            ArgumentError: If there is no such output, or u, v or λ were not kept.

        Examples:
            How fast the heavy top spins about the vertical axis of its disc:

            >>> import newmark_cli as newmark
            >>> top = newmark.march("heavy-top", h=1e-4, t_end=1e-3)
            >>> top.output("top.omega.y").round(3)[:2].tolist()
            [150.0, 150.0]
        """
        return self.outputs[:, _place(name, "output", self.output_names)]

    def coordinate(self, name: str, field: str = "u") -> Array:
        """(k,) one coordinate.

        Args:
            name: One of `coordinate_names`.
            field: ``"u"``, ``"v"`` or ``"a"``.

        Raises:
            ArgumentError: If there is no such coordinate, or it was not kept.

        Examples:
            >>> import newmark_cli as newmark
            >>> swing = newmark.march("pendulum", h=1e-2, t_end=1.0)
            >>> f"{swing.coordinate('P.x')[0]:.6f}"
            '1.000000'
        """
        return self._field(field)[:, _place(name, "coordinate", self.coordinate_names)]

    def point(self, name: str, field: str = "u") -> Array:
        """(k, 2) one point of a mechanism, (k, 3) of a spatial one; see `coordinate`.

        Args:
            name: One of `point_names`, or of the file's fixed points and ``body_points``.
            field: ``"u"``, ``"v"`` or ``"a"``.

        Raises:
            ArgumentError: If there is no such point, or the field was not kept.

        Examples:
            The tip of the four-bar's coupler, to which a spring goes:

            >>> import newmark_cli as newmark
            >>> bars = newmark.march("four-bar", h=1e-3, t_end=1e-2)
            >>> bars.point("D").shape
            (11, 2)
        """
        known, places = self.point_names, self.problem.places
        if name in places and name not in known:
            return places[name].at(self._field(field), field)
        place, width = _place(name, "point", (*known, *places)), len(self.problem.axes)
        return self._field(field)[:, width * place : width * place + width]

    def constraint(self, name: str) -> Array:
        """(k,) multiplier of one constraint.

        Args:
            name: One of `constraint_names`.

        Raises:
            ArgumentError: If there is no such constraint, or λ was not kept.

        Examples:
            A pendulum that was released from the horizontal: λ = 3 y, here with y = −1.

            >>> import newmark_cli as newmark
            >>> swing = newmark.march("pendulum", h=1e-3, at=[1.854])
            >>> swing.constraint("bars.rod").round(3).tolist()
            [-3.0]
        """
        return self.multipliers[:, _place(name, "constraint", self.constraint_names)]

    def _field(self, name: str) -> Array:
        if name not in FIELDS:
            raise ArgumentError(f"unknown field {name!r}{nearest(name, FIELDS)}")
        return self._array(name)

    def to_frame(self) -> "pd.DataFrame":
        """The kept steps as a table, a row for each.

        Returns:
            Columns ``t``, ``u[A.x]`` …, ``v[A.x]`` …, ``a[A.x]`` …, ``lambda[bars.link]`` …
            and, where there is one and u and v were kept, ``energy``; where there are any
            and u, v, λ were kept, ``output[A.force.x]`` ….
        """
        import pandas as pd

        return pd.DataFrame(self.columns((*KEPT, ENERGY, OUTPUT)))

    def columns(self, keep: Collection[str]) -> dict[str, Array]:
        """Column → (k,) values, of what was kept; not public.

        Args:
            keep: Which of `KEPT`, `ENERGY` and `OUTPUT` have columns.
        """
        columns: dict[str, Array] = {"t": self.t}
        for key, values in self.arrays.items():
            names = self.constraint_names if key == "lambda" else self.coordinate_names
            if key in keep:
                columns.update(zip((f"{key}[{name}]" for name in names), values.T, strict=True))
        if ENERGY in keep and {"u", "v"} <= self.arrays.keys() and self.energy is not None:
            columns[ENERGY] = self.energy
        if OUTPUT in keep and self.output_names and {"u", "v", "lambda"} <= self.arrays.keys():
            named = zip(self.output_names, self.outputs.T, strict=True)
            columns.update((f"{OUTPUT}[{name}]", values) for name, values in named)
        return columns


def _place(name: str, kind: str, names: Sequence[str]) -> int:
    if name not in names:
        raise ArgumentError(f"unknown {kind} {name!r}{nearest(name, names)}")
    return names.index(name)


class _Rows:
    """An array that grows by rows, doubling when it is full, up to ``most`` rows."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, most: int | None) -> None:
        self._values = np.empty((min(most or 64, 64), *shape), dtype)
        self._most = most

    def write(self, begin: int, values: Any) -> None:
        """Set the rows from ``begin`` on."""
        end = begin + len(values)
        if end > len(self._values):
            twice = 2 * len(self._values)
            room = max(end, min(twice, self._most or twice))
            self._values.resize((room, *self._values.shape[1:]), refcheck=False)
        self._values[begin:end] = values

    def first(self, count: int) -> Any:
        """A copy of the first rows, which takes no more room than it needs."""
        return self._values[:count].copy()


class Recorder:
    """Keeps steps of a march, whoever marches: a cell, a drawing, the library.

    Attributes:
        march: The march.
        finite: Whether all that was seen is.
        reason: Why the march is to end where it stands; empty as long as it may go on.
        here: The last good step that the march halted at.
    """

    def __init__(
        self,
        march: March,
        keep: Sequence[str] = KEPT,
        most: int | None = None,
        watch: GapWatch | None = None,
    ) -> None:
        """Keep nothing yet of `KEPT`; where the march stands is the start of the record.

        ``most`` is about how many steps it will keep, if that is known.
        """
        n, m = march.problem.n, march.problem.m
        self.march = march
        self.finite, self.reason = True, ""
        self._watch = watch
        self._begin = march.earlier + march.done
        self._not_converged, self._corrections = 0, 0
        # Counted once they are written, in case of an interrupt.
        self._kept, self._last = 0, -1
        self._rows = {name: _Rows((), np.int64, most) for name in ("number", "count")}
        self._names = [name for name in KEPT if name in keep]
        for name in self._names:
            self._rows[name] = _Rows((m if name == "lambda" else n,), float, most)
        self.here = step_of(march)

    def stops(self, halt: int) -> frozenset[int]:
        """Steps on the way to another at which it wants to see the march."""
        return self._watch.until(self.march.done, halt) if self._watch else frozenset()

    @property
    def over(self) -> bool:
        """Whether the march has ended early."""
        return self.march.ending != COMPLETED or not self.finite or bool(self.reason)

    def keep_here(self) -> None:
        """Keep that step, unless it was kept already."""
        step = self.here
        if self._last < step.carried.steps:
            count = step.iterations if step.converged else -step.iterations
            fields = {"u": step.u, "v": step.v, "a": step.a, "lambda": step.multipliers}
            rows = {name: fields[name][None] for name in self._names}
            self._kept, self._last = self._written(
                rows | {"number": np.array([step.carried.steps]), "count": np.array([count])}
            )

    def took(self, stretch: Stretch) -> None:
        """Take up what a stretch of the march recorded."""
        fields, multipliers = stretch.record.fields, stretch.record.multipliers
        good = np.isfinite(fields).all(axis=(1, 2)) & np.isfinite(multipliers).all(axis=1)
        kept, last = self._kept, self._last
        if self.finite and len(good):
            looks = stretch.looks[good]
            first = self.march.done - len(stretch.iterations)
            rows = {
                name: (multipliers if name == "lambda" else fields[:, _ROWS[name]])[good]
                for name in self._names
            }
            counts = stretch.iterations[looks - first - 1]
            kept, last = self._written(
                rows | {"number": self.march.earlier + looks, "count": counts}
            )
        state = self.march.state
        finite = self.finite and bool(good.all())
        finite = finite and all(bool(np.isfinite(array).all()) for array in state[:3])
        taken = len(stretch.iterations) > 0
        here = step_of(self.march, stretch) if finite and taken else self.here
        not_converged = self._not_converged + int(np.count_nonzero(stretch.iterations < 0))
        corrections = self._corrections + int(np.abs(stretch.iterations).sum())
        # In one statement, lest an interrupt part rows, the last good step and the counts.
        self._kept, self._last, self.finite, self.here, self._not_converged, self._corrections = (
            kept, last, finite, here, not_converged, corrections
        )  # fmt: skip
        if self._watch and finite and self.march.ending == COMPLETED:
            self._watch.sees(self.march)
            self.reason = self._watch.reason

    def _written(self, rows: Mapping[str, Any]) -> tuple[int, int]:
        """Write rows; returns the new number of rows and the last step that is kept."""
        for name, values in rows.items():
            self._rows[name].write(self._kept, values)
        steps = rows["number"]
        return self._kept + len(steps), int(steps[-1]) if len(steps) else self._last

    def trajectory(self, status: str = "") -> Trajectory:
        """Rows kept so far."""
        ending = self.march.ending if self.finite else DIVERGED
        if ending != COMPLETED:
            status = ENDINGS[ending]
        elif self.reason:
            status = REDUNDANT
        arrays = {name: rows.first(self._kept) for name, rows in self._rows.items()}
        numbers, counts = arrays.pop("number"), arrays.pop("count")
        return Trajectory(
            t=self.march.grid.times(numbers - self.march.earlier),
            numbers=numbers,
            iterations=np.abs(counts),
            converged=counts >= 0,
            status=status or ("not_converged" if self._not_converged else "ok"),
            steps=self.here.carried.steps - self._begin,
            not_converged=self._not_converged,
            newton_iterations=self._corrections,
            h=self.march.grid.h,
            state=self.here,
            problem=self.march.problem,
            arrays=arrays,
            reason=self.reason if status == REDUNDANT else "",
        )
