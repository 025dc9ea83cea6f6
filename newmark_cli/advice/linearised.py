"""The subject of advice: a problem at states of its motion, or matrices at one state."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.library.finding import problem as problem_of
from newmark_cli.library.marching import march
from newmark_cli.newmark.balance import has_full_rank, is_regular, saddle_point
from newmark_cli.newmark.floor import Floor, floor, unpredicted
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.jacobian import Jacobian
from newmark_cli.newmark.march import March, initial_state
from newmark_cli.newmark.march_data import State
from newmark_cli.newmark.noise import multiplier_noise, violations
from newmark_cli.newmark.scheme import COMPENSATED, Scheme
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.linear import linear_problem
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support import matrices
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError, InputError

#: Names of the matrices and vectors that a file or a dict may have.
NAMES = ("M", "G", "X", "Y", "u", "v", "a", "lambda")
#: The vectors among them; single numbers where n or m is 1.
_VECTORS = ("u", "v", "a", "lambda")
#: Most unknowns n + m whose condition numbers are computed.
MOST_UNKNOWNS = 1_500
#: Most unknowns n + m for which a motion is marched to look at more states than the start.
_MOST_MARCHED = 300
#: Stretches of the motion between states, and steps in each.
_STATES, _STEPS_BETWEEN = 15, 40
#: Times its own size that a problem moves while it is looked at: most have then passed the
#: positions that are worst for rounding.
_MOTIONS = 3
#: Steps that are taken anew at each state, for a floor and for one that is only compared.
_SAMPLES, _ROUGHLY = 8, 2
#: Factor on them where there is one state; stride over states for what is only compared.
_ALONE = 4
_DAMPED = "generalized-alpha rho=0.9"
#: Times (s) after the start at which forces are looked at that come later.
_LATER = (0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
#: What takes longer to move by its size (s) is at rest: its accelerations are rounding.
_AT_REST = 1e6


@dataclass(frozen=True, eq=False)
class Subject:
    """What advice is about: a problem at states of its motion, or matrices at one state.

    Attributes:
        problem: The problem; of matrices the linear one that has them.
        states: The same with other starts: the states.
        where: Which states these are, in words.
        notes: What was assumed.
        known: Accelerations and multipliers at the states; computed where empty.
        has_state: Whether a state is known.
        of_matrices: Whether matrices are all that is known: neither whether Φ is quadratic, nor
            the rate of G, which other formulations than index 3 need.
    """

    problem: Problem
    states: Sequence[Problem]
    where: str
    notes: Sequence[str]
    known: Sequence[tuple[Array, Array]] = ()
    has_state: bool = True
    of_matrices: bool = False

    @cached_property
    def accelerations(self) -> Sequence[tuple[Array, Array]]:
        """A (n,) and λ (m,) at the states."""
        return self.known or [Index1(at).accelerations(at.t0, at.u0, at.v0) for at in self.states]

    @property
    def multipliers(self) -> float | None:
        """Root mean square of ‖λ‖ over the states; None without one."""
        if not self.has_state:
            return None
        return math.sqrt(np.mean([np.sum(x**2) for _, x in self.accelerations]))

    @cached_property
    def typical(self) -> int:
        """State where ‖λ‖ is nearest to its root mean square."""
        sizes = [np.linalg.norm(x) for _, x in self.accelerations]
        return int(np.argmin(np.abs(np.array(sizes) - (self.multipliers or 0.0))))

    def jacobian(self, scheme: Scheme, place: int = 0) -> Array:
        """J, unscaled, at one of the states."""
        at, (a, multipliers) = self.states[place], self.accelerations[place]
        system = Jacobian(at, scheme)
        values = at.values(at.t0, at.u0, at.v0, multipliers)
        tangents = None
        if system.constraining:
            tangents = system.constraining.tangents_at(at.t0, at.u0, at.v0, a)
        return system.dense(system.entries(values, tangents))

    def unknowns(self, scheme: Scheme, place: int) -> Array:
        """One of the states as the unknowns that a form keeps; η is 0."""
        at, (a, multipliers) = self.states[place], self.accelerations[place]
        known = {**dict(zip(FIELDS, (at.u0, at.v0, a), strict=True)), "lambda": multipliers}
        parts = zip(
            scheme.form.solved, scheme.form.sizes(self.problem.n, self.problem.m), strict=True
        )
        return np.concatenate([known.get(name, np.zeros(size)) for name, size in parts])

    def multiplier_noise(self, scheme: Scheme) -> float:
        """Rms over the states of the noise of ‖λ‖ in one step of the (u, λ) form."""
        noise = []
        for place, at in enumerate(self.states):
            violated = violations(at, scheme, at.t0, at.u0, at.v0)
            noise.append(multiplier_noise(self.jacobian(scheme, place), scheme, violated))
        return math.sqrt(np.mean(np.square(noise)))

    def floors(self, scheme: Scheme, roughly: bool = False) -> list[Floor]:
        """Floors at the states, none without one; from fewer draws at some if `roughly`."""
        if unpredicted(scheme) or not self.has_state:
            return []
        samples = (_ROUGHLY if roughly else _SAMPLES) * (1 if len(self.states) > 1 else _ALONE)
        return [
            floor(March(at, scheme, state=self._start(at, scheme)), samples)
            for at in self.states[:: _ALONE if roughly else 1]
        ]

    def _start(self, at: Problem, scheme: Scheme) -> State:
        """The state in which a march of the scheme would begin."""
        if not self.known:
            return initial_state(at, scheme)
        ((a, multipliers),) = self.known
        n, m = self.problem.n, self.problem.m
        fields, none = np.array([at.u0, at.v0, a, a]), np.zeros(m)
        past = scheme.relations.start @ fields[:3]
        unknown = (np.zeros(1 + m), np.zeros(1 + n))
        parts = (fields, past, multipliers, np.zeros((2, n)), none, none, none, *unknown)
        return State(*(part.astype(scheme.dtype) for part in parts))


def require_fit(about: Subject, formulation: Formulation, evaluation: str) -> None:
    """Refuse what nothing can be said of.

    Raises:
        ArgumentError: For a formulation that matrices do not tell enough of, and for
            compensated evaluation of constraints that are not quadratic.
    """
    if about.of_matrices and formulation.method != INDEX_3:
        raise ArgumentError(
            f"formulation {formulation.label}: needs the rate of G, which matrices do not tell; "
            "allowed: index-3"
        )
    if evaluation == COMPENSATED and not (about.of_matrices or about.problem.quadratic):
        raise ArgumentError(
            f"{about.problem.name}: compensated evaluation needs constraints that are at most "
            "quadratic in u and do not depend on time"
        )


def subject_of(source: Any, t_end: float | None = None) -> Subject:
    """Find the subject of advice: of what `problem` takes, a path of matrices, or a mapping.

    A problem's motion is looked at until t_end (s); if omitted, a few times as long as it takes
    to move by about its own size.
    """
    if isinstance(source, Mapping) and {"M", "G"} & source.keys():
        return of_matrices(source, "matrices")
    if isinstance(source, str | Path) and is_path_of_matrices(Path(source)):
        return of_matrices(matrices.read(Path(source), NAMES), str(source))
    return _of_problem(problem_of(source), t_end)


def is_path_of_matrices(path: Path) -> bool:
    """Whether a path is that of matrices rather than of a problem."""
    return path.suffix.lower() in (".npz", ".mtx") or path.is_dir()


def of_matrices(values: Mapping[str, Any], where: str) -> Subject:
    """Matrices of the equations of motion by their `NAMES`; errors begin with where they are."""
    arrays = _sound(values, where)
    missing = [name for name in _VECTORS if name not in arrays]
    if missing and len(missing) < len(_VECTORS):
        raise matrices.MatrixError(
            f"{where}: of the state {', '.join(missing)} is missing; give all of u, v, a, lambda "
            "or none"
        )
    notes = [
        f"{name} is not given and taken to be 0: {what} is not part of this advice"
        for name, what in (("X", "stiffness"), ("Y", "damping"))
        if name not in arrays
    ]
    if missing:
        notes.append("no state u, v, a, lambda is given: no floors and no tolerances")
    shapes = _shapes(*arrays["G"].shape)
    mass, gradient, x, y, u, v, a, multipliers = (
        arrays[name] if name in arrays else np.zeros(shapes[name]) for name in NAMES
    )
    problem = linear_problem(where, (mass, x, y, gradient), (u, v, a, multipliers))
    at = "without a state" if missing else "at the state given"
    return Subject(
        problem, [problem], at, notes, [(a, multipliers)], has_state=not missing, of_matrices=True
    )


def _shapes(n: int, m: int) -> dict[str, tuple[int, ...]]:
    """Shapes of what may be omitted, and of G."""
    square, vector = (n, n), (n,)
    return {
        "G": (n, m), "X": square, "Y": square, "u": vector, "v": vector, "a": vector, "lambda": (m,)
    }  # fmt: skip


def _sound(values: Mapping[str, Any], where: str) -> dict[str, Array]:
    """The matrices and vectors in their shapes."""
    arrays = {
        name: matrices.array_of(
            values[name], f"{where}: {name}", (0, 1, 2) if name in _VECTORS else (1, 2)
        )
        for name in NAMES
        if name in values
    }
    for name in ("M", "G"):
        if name not in arrays:
            raise matrices.MatrixError(f"{where}: {name} is missing; needed: M, G")
    mass, gradient = arrays["M"], arrays["G"]
    if mass.ndim != 2 or mass.shape[0] != mass.shape[1]:
        shape = " by ".join(map(str, mass.shape))
        raise matrices.MatrixError(f"{where}: M must be square, given {shape}")
    n = len(mass)
    if gradient.ndim == 1:  # a single constraint
        gradient = arrays["G"] = gradient[:, None]
    if gradient.shape[0] != n == gradient.shape[1]:
        raise matrices.MatrixError(
            f"{where}: G must have a row for each of the {n} coordinates, given "
            f"{gradient.shape[0]} by {n}; give its transpose"
        )
    arrays |= {name: array.reshape(-1) for name, array in arrays.items() if name in _VECTORS}
    matrices.require_shapes(arrays, _shapes(n, gradient.shape[1]), where)
    _require_usable(mass, gradient, where)
    return arrays


def _require_usable(mass: Array, gradient: Array, where: str) -> None:
    n, m = gradient.shape
    if n + m > MOST_UNKNOWNS:
        raise matrices.MatrixError(f"{where}: n + m = {n + m}; at most {MOST_UNKNOWNS}")
    if m == 0 or n == 0:
        raise matrices.MatrixError(f"{where}: G must have a row and a column at least")
    if m > n or not has_full_rank(gradient):
        raise matrices.MatrixError(
            f"{where}: G has rank below {m}: constraints are redundant; leave out those that "
            "follow from others"
        )
    if not is_regular(saddle_point(mass, gradient)):
        raise matrices.MatrixError(
            f"{where}: [M −G; Gᵀ 0] is singular: M leaves a motion that the constraints allow "
            "without inertia"
        )


def _of_problem(problem: Problem, t_end: float | None) -> Subject:
    if problem.n + problem.m > MOST_UNKNOWNS:
        raise ArgumentError(
            f"{problem.name}: n + m = {problem.n + problem.m}; advice is for at most "
            f"{MOST_UNKNOWNS} unknowns"
        )
    try:
        Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    except np.linalg.LinAlgError:
        raise ProblemError(
            f"{problem.name}: [M −G; Gᵀ 0] is singular at the start: constraints are redundant, or "
            "M leaves a motion without inertia"
        ) from None
    at_start = partial(Subject, problem, [problem], "at the start")
    if problem.n + problem.m > _MOST_MARCHED:
        return at_start([])
    length = _MOTIONS * _time_of_a_motion(problem) if t_end is None else t_end
    if not math.isfinite(length):
        return at_start(
            ["it is at rest, and nothing moves it: rounding is less there than in a motion"]
        )
    steps = _STATES * _STEPS_BETWEEN
    with suppress(InputError):
        motion = march(
            problem, h=length / steps, steps=steps, every=_STEPS_BETWEEN, integrator=_DAMPED,
            keep=("u", "v"),
        )  # fmt: skip
        if motion.status == "ok":
            states = [
                replace(problem, t0=float(t), u0=u, v0=v)
                for t, u, v in zip(motion.t, motion.u, motion.v, strict=True)
            ]
            where = f"at {len(states)} states of its motion to t = {motion.t[-1]:.3g} s"
            return Subject(problem, states, where, [])
    return at_start(
        [f"the motion to t = {length:.3g} s could not be marched: advice is for the start"]
    )


def _time_of_a_motion(problem: Problem) -> float:
    """Time in which the start's velocities and accelerations cover the mechanism's size (s).

    Or the accelerations of forces that come later: what begins at rest may have a motor.
    """
    size, speed = np.linalg.norm(problem.u0), np.linalg.norm(problem.v0)
    index_1 = Index1(problem)
    with np.errstate(divide="ignore"):
        times = [float(size / speed)]
        for later in _LATER:
            a, _ = index_1.accelerations(problem.t0 + later, problem.u0, problem.v0)
            times.append(max(later, float(np.sqrt(2 * size / np.linalg.norm(a)))))
    time = min(times)
    return time if time < _AT_REST else math.inf
