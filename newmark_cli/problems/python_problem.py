"""Problems in Python: any M v' = f(u, v, t) + G(u, t) λ, 0 = Φ(u, t).

A config names a file and a factory in it,

    problem: {python: "car_axis.py:car_axis", args: {rigidity: 1.0}}

and the factory returns a `Definition`, or anything with its attributes.  Code runs
only with ``--allow-code``.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

from newmark_cli.arrays import Array
from newmark_cli.problems import user_code
from newmark_cli.problems.problem import Pattern, Problem, ProblemError

#: Largest relative difference of a given tangent from its finite differences.
_TANGENT_TOLERANCE = 1e-5
_CONSISTENCY = 1e-9
#: Steps (s) of differences in time.  The longest is short enough for motions of some
#: hundred radians a second, the shortest for some thousand.  No power of two stands
#: between them, lest all be periods of one motion.
_LONGEST_STEP, _STEP_RATIO, _STEPS = 1e-2, 1.9, 7


@dataclass(frozen=True)
class Definition:
    """A problem with n coordinates and m constraints.

    Functions that numba compiled (``@numba.njit``) run through the kernel, plain
    ones through the SciPy march.  All arrays are float64.

    Attributes:
        mass_matrix: (n, n) M, constant, symmetric positive definite.
        u0, v0: (n,) initial coordinates and velocities; they fit the constraints.
        force: (u, v, t) → (n,) f.
        constraints: (u, t) → (m,) Φ.
        gradient: (u, t) → (n, m) G = Φ_uᵀ.
        stiffness: (u, v, λ, t) → (n, n) X = −∂(f + Gλ)/∂u; by differences if None.
        damping: (u, v, t) → (n, n) Y = −∂f/∂v; by differences if None.
        t0: Initial time (s).
        quadratic: Whether Φ is at most quadratic in u and does not depend on t, as
            compensated evaluation needs it; checked.
        energy: (u, v, t) → total energy ½ vᵀM v + V, or another energy that the motion
            conserves; None if there is none.
    """

    mass_matrix: Array
    u0: Array
    v0: Array
    force: Callable[..., Array]
    constraints: Callable[..., Array]
    gradient: Callable[..., Array]
    stiffness: Callable[..., Array] | None = None
    damping: Callable[..., Array] | None = None
    t0: float = 0.0
    quadratic: bool = False
    energy: Callable[..., float] | None = None


_FUNCTIONS = ("force", "constraints", "gradient")
_TANGENTS = ("stiffness", "damping")


def load(
    path: Path, factory: str, arguments: Mapping[str, Any], name: str, spelled: str = ""
) -> Problem:
    """Run a factory and take its problem.

    Args:
        path: Python file; modules of its folder can be imported, at its top or in the
            factory.
        factory: Function in it.
        arguments: Keyword arguments of the factory.
        name: Name of the problem.
        spelled: How errors name the file; the path if empty.

    Raises:
        ProblemError: When the file or the factory fails, or what it returns cannot
            be used: a wrong shape, a tangent that disagrees with differences, an
            inconsistent start.
    """
    file = spelled or str(path)
    try:
        source = path.read_bytes()
    except OSError as error:
        raise ProblemError(f"{file}: cannot be read: {error.strerror}") from None
    module_name = f"newmark_problem_{hashlib.sha256(bytes(path.resolve()) + source).hexdigest()}"
    with user_code.imports_from(path.parent, os.path.dirname(file)) as imported:
        with _reported(path, file):
            module = user_code.run(path, source, module_name, file)
        if not callable(getattr(module, factory, None)):
            raise ProblemError(f"{file}: has no function {factory!r}")
        with _reported(path, file, f"{factory} failed: "):
            given = getattr(module, factory)(**arguments)
        beside = dict(sorted(imported.items()))
    with _reported(path, file):
        problem = from_definition(given, name, f"{file}: {factory}")
    called = f"{factory}({', '.join(f'{key}={value!r}' for key, value in arguments.items())})"
    digest = hashlib.sha256(repr((called, source, beside)).encode())
    return replace(problem, code=digest.hexdigest(), sources={path.name: source, **beside})


@contextmanager
def _reported(path: Path, file: str, what: str = "") -> Iterator[None]:
    """Errors of the user's code, an exit included, by the line that they come from."""
    try:
        yield
    except (ProblemError, KeyboardInterrupt):
        raise
    except BaseException as error:
        where = _line(error, path)
        raise ProblemError(f"{file}{where}: {what}{_describe(error)}") from None


def from_definition(given: Any, name: str, where: str = "problem") -> Problem:
    """Problem from a `Definition` or anything with its attributes.

    Args:
        given: The definition.
        name: Name of the problem.
        where: How errors name it.

    Raises:
        ProblemError: See `load`.
    """
    missing = [key for key in ("mass_matrix", "u0", "v0", *_FUNCTIONS) if not hasattr(given, key)]
    if missing:
        raise ProblemError(f"{where} returned what lacks {', '.join(missing)}")
    u0, v0 = _array(given.u0, "u0", where, 1), _array(given.v0, "v0", where, 1)
    n = len(u0)
    mass_matrix = _array(given.mass_matrix, "mass_matrix", where, 2)
    _require_shape(v0, (n,), "v0", where)
    _require_shape(mass_matrix, (n, n), "mass_matrix", where)
    if not np.allclose(mass_matrix, mass_matrix.T) or np.linalg.eigvalsh(mass_matrix)[0] <= 0:
        raise ProblemError(f"{where}: mass_matrix is not symmetric and positive definite")
    t0 = float(_array(getattr(given, "t0", 0.0), "t0", where, 0))
    functions = {key: getattr(given, key) for key in _FUNCTIONS}
    tangents = {key: getattr(given, key, None) for key in _TANGENTS}
    phi = _called(functions["constraints"], (u0, t0), "constraints", where, None)
    if phi.ndim != 1:
        raise ProblemError(f"{where}: constraints has shape {phi.shape}, expected (m,)")
    m = len(phi)
    force = _called(functions["force"], (u0, v0, t0), "force", where, (n,))
    gradient = _called(functions["gradient"], (u0, t0), "gradient", where, (n, m))
    if m == 0 or np.linalg.matrix_rank(gradient) < m:
        raise ProblemError(f"{where}: gradient has rank below {m}: constraints are redundant")

    _require_gradient(functions, u0, t0, gradient, where)
    energy = getattr(given, "energy", None)
    if energy is not None:
        _called(energy, (u0, v0, t0), "energy", where, ())
    chosen = [f for f in (*functions.values(), *tangents.values()) if f is not None]
    compiled = all(isinstance(f, Dispatcher) for f in chosen)
    compile_ = njit if compiled else _as_it_is
    by_differences = {
        "stiffness": _stiffness_by_differences(functions, compile_),
        "damping": _damping_by_differences(functions, compile_),
    }
    multipliers = np.linspace(1.0, 2.0, m)
    for key, call in (("stiffness", (u0, v0, multipliers, t0)), ("damping", (u0, v0, t0))):
        if tangents[key] is not None:
            found = _called(tangents[key], call, key, where, (n, n))
            expected = by_differences[key](*call)
            # Differences of a force are as good as its rounding over their step.
            reach = float(np.abs(u0 if key == "stiffness" else v0).max())
            load = float(np.abs(force).max() + np.abs(gradient @ multipliers).max())
            noise = 1e-9 * load / max(reach, 1e-3)
            allowed = noise + _TANGENT_TOLERANCE * float(np.abs(expected).max())
            worst = np.unravel_index(np.argmax(np.abs(found - expected)), found.shape)
            if abs(found[worst] - expected[worst]) > allowed:
                i, j = (int(index) + 1 for index in worst)
                raise ProblemError(
                    f"{where}: {key} disagrees with differences in row {i}, column {j}: given "
                    f"{found[worst]:.9g}, differences say {expected[worst]:.9g}"
                )

    rows, columns = (index.ravel().astype(np.int64) for index in np.indices((n, n)))
    g_rows, g_columns = (index.ravel().astype(np.int64) for index in np.indices((n, m)))
    problem = Problem(
        name=name,
        u0=u0,
        v0=v0,
        t0=t0,
        constraints=m,
        function=_evaluate(
            functions,
            {key: tangents[key] or by_differences[key] for key in _TANGENTS},
            compile_,
        ),
        derivatives=_derivatives(functions),
        ints=np.zeros((1, 1), np.int64),
        reals=np.zeros((1, 1)),
        pattern=Pattern(rows, columns, rows, columns, rows, columns, g_rows, g_columns),
        mass_values=np.ascontiguousarray(mass_matrix).ravel(),
        compiled=compiled,
        quadratic=bool(getattr(given, "quadratic", False)),
        potential=None if energy is None else _potential(energy, mass_matrix),
    )
    if problem.quadratic:
        _require_quadratic(problem, functions, where)
    _require_consistent(problem, gradient, where)
    return problem


def _as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


def _evaluate(
    functions: Mapping[str, Any], tangents: Mapping[str, Any], compile_: Any
) -> Callable[..., None]:
    """The function that engines call, in terms of the user's."""
    force_of, phi_of, gradient_of = (functions[key] for key in _FUNCTIONS)
    x_of, y_of = (tangents[key] for key in _TANGENTS)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        gradient = gradient_of(u, t)
        given = force_of(u, v, t)
        values = phi_of(u, t)
        stiffness, damping = x_of(u, v, multipliers, t), y_of(u, v, t)
        n, m = u.shape[0], multipliers.shape[0]
        for k in range(m):
            phi[k] = values[k]
        for i in range(n):
            force[i] = given[i]
            for k in range(m):
                g_values[i * m + k] = gradient[i, k]
                force[i] += gradient[i, k] * multipliers[k]
            for j in range(n):
                x_values[i * n + j] = stiffness[i, j]
                y_values[i * n + j] = damping[i, j]

    return compile_(evaluate)  # type: ignore[no-any-return]


def _potential(energy: Callable[..., float], mass_matrix: Array) -> Callable[..., float]:
    """What the kinetic energy lacks to the user's."""

    def potential(t, u, v, ints, reals):  # type: ignore[no-untyped-def]
        return float(energy(u, v, t)) - 0.5 * float(v @ mass_matrix @ v)

    return potential


def _stiffness_by_differences(functions: Mapping[str, Any], compile_: Any) -> Callable[..., Array]:
    """X by central differences of fourth order."""
    force_of, gradient_of = functions["force"], functions["gradient"]

    def stiffness(u, v, multipliers, t):  # type: ignore[no-untyped-def]
        n, m = u.shape[0], multipliers.shape[0]
        matrix = np.zeros((n, n))
        for j in range(n):
            step = 1e-3 * max(abs(u[j]), np.max(np.abs(u)), 1e-8)
            moved = u.copy()
            for shift, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
                moved[j] = u[j] + shift * step
                force, gradient = force_of(moved, v, t), gradient_of(moved, t)
                for i in range(n):
                    value = force[i]
                    for k in range(m):
                        value += gradient[i, k] * multipliers[k]
                    matrix[i, j] -= weight * value / (12 * step)
        return matrix

    return compile_(stiffness)  # type: ignore[no-any-return]


def _damping_by_differences(functions: Mapping[str, Any], compile_: Any) -> Callable[..., Array]:
    """Y by central differences of fourth order."""
    force_of = functions["force"]

    def damping(u, v, t):  # type: ignore[no-untyped-def]
        n = u.shape[0]
        matrix = np.zeros((n, n))
        for j in range(n):
            step = 1e-3 * max(abs(v[j]), np.max(np.abs(v)), 1e-3)
            moved = v.copy()
            for shift, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
                moved[j] = v[j] + shift * step
                force = force_of(u, moved, t)
                for i in range(n):
                    matrix[i, j] -= weight * force[i] / (12 * step)
        return matrix

    return compile_(damping)  # type: ignore[no-any-return]


def _derivatives(functions: Mapping[str, Any]) -> Callable[..., None]:
    """∂Φ/∂t and the curvature by differences that find their own step."""
    phi_of, gradient_of = functions["constraints"], functions["gradient"]

    def derivatives(  # type: ignore[no-untyped-def]
        t, u, v, ints, reals, rate, curvature
    ):
        # Steps that move no coordinate by more than 3 % of its size.
        speed = np.max(np.abs(v))
        longest = 3e-2 * (np.max(np.abs(u)) or 1.0) / speed if speed > 0 else 1.0
        steps = min(_LONGEST_STEP, longest) * _STEP_RATIO ** -np.arange(_STEPS)

        phi, drift, turn = np.empty((3, 2, _STEPS, len(rate)))
        for k, h in enumerate(steps.tolist()):
            for i, shift in enumerate((h, -h)):
                then = t + shift
                phi[i, k] = phi_of(u, then)
                drift[i, k] = v @ gradient_of(u, then)
                turn[i, k] = v @ gradient_of(u + shift * v, then)
        size = steps[:, None]
        rate[:] = _extrapolated((phi[0] - phi[1]) / (2 * size), _STEP_RATIO)
        # Φ'' = (Gᵀ v)' along the motion + (Φ_t)': first differences of G, which lose
        # less than second ones of Φ; those remain for a Φ that depends on time.
        here = phi_of(u, t)
        second = (phi[0] - here + (phi[1] - here)) / size**2
        second += (drift[0] - drift[1] + (turn[0] - turn[1])) / (2 * size)
        curvature[:] = _extrapolated(second, _STEP_RATIO)

    return derivatives


@njit(cache=True)
def _extrapolated(differences, ratio):  # type: ignore[no-untyped-def]
    """Limit of central differences for steps that shrink by a ratio, each column its own.

    Romberg's tableau; of its entries the one that differs least from its neighbours
    (Ridders, Advances in Engineering Software 4, 1982), so that neither truncation
    nor rounding need be known.

    Args:
        differences: (steps, m) central differences, longest step first.
        ratio: Of a step to the next.

    Returns:
        (m,) limits.
    """
    steps, columns = differences.shape
    limits = differences[0].copy()
    for column in range(columns):
        above = np.empty(steps)
        least = np.inf
        for i in range(steps):
            entry = differences[i, column]
            factor = 1.0
            for j in range(i):
                factor *= ratio * ratio
                better = entry + (entry - above[j]) / (factor - 1)
                error = max(abs(better - entry), abs(better - above[j]))
                if error < least:
                    least, limits[column] = error, better
                above[j], entry = entry, better
            above[i] = entry
    return limits


def _require_gradient(
    functions: Mapping[str, Any], u: Array, t: float, gradient: Array, where: str
) -> None:
    size = max(float(np.abs(gradient).max()), 1e-300)
    step = 1e-3 * float(np.abs(u).max() or 1.0)
    for i in range(len(u)):
        change = np.zeros_like(u)
        change[i] = step
        phi = [functions["constraints"](u + k * change, t) for k in (-2, -1, 1, 2)]
        expected = np.array([1, -8, 8, -1]) @ np.array(phi) / (12 * step)
        wrong = np.abs(gradient[i] - expected) > _TANGENT_TOLERANCE * size
        if np.any(wrong):
            k = int(np.argmax(wrong))
            raise ProblemError(
                f"{where}: gradient disagrees with differences in row {i + 1}, column {k + 1}: "
                f"given {gradient[i, k]:.9g}, differences say {expected[k]:.9g}"
            )


def _require_quadratic(problem: Problem, functions: Mapping[str, Any], where: str) -> None:
    """Φ(u + Δ) − Φ(u) = G(u + Δ/2)ᵀ Δ for three changes, and no time in Φ."""
    u, t = problem.u0, problem.t0
    for seed in range(3):
        random = np.random.default_rng(seed)
        change = random.normal(size=problem.n) * np.abs(u).max()
        # Not a whole number of seconds, in which a law of time may repeat itself.
        elapsed = random.uniform(0.1, 1.0)
        expected = np.asarray(functions["gradient"](u + change / 2, t)).T @ change
        begin, end, later = (
            np.asarray(functions["constraints"](*at))
            for at in ((u, t), (u + change, t), (u + change, t + elapsed))
        )
        size = float(np.abs(expected).max() + np.abs(begin).max() + np.abs(end).max())
        if np.abs(end - begin - expected).max() > _CONSISTENCY * size:
            raise ProblemError(f"{where}: constraints are declared quadratic, but are not")
        if np.abs(later - end).max() > _CONSISTENCY * size:
            raise ProblemError(f"{where}: constraints are declared quadratic, but depend on t")


def _require_consistent(problem: Problem, gradient: Array, where: str) -> None:
    phi = problem.constraint_values(problem.t0, problem.u0)
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, problem.v0)
    misfit = gradient.T @ problem.v0 + rate
    size = float(np.abs(gradient).max())
    if np.abs(phi).max() > _CONSISTENCY * size * max(np.abs(problem.u0).max(), 1e-300):
        raise ProblemError(f"{where}: u0 misses the constraints by {np.abs(phi).max():.3g}")
    speed = max(float(np.abs(problem.v0).max()), float(np.abs(rate).max()) / size, 1e-300)
    if np.abs(misfit).max() > _CONSISTENCY * size * speed:
        raise ProblemError(f"{where}: v0 misses the constraints by {np.abs(misfit).max():.3g}")


def _called(
    function: Any, arguments: tuple[Any, ...], key: str, where: str, shape: tuple[int, ...] | None
) -> Array:
    try:
        value = np.asarray(function(*arguments), float)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # an exit included
        raise ProblemError(f"{where}: {key} failed: {_describe(error)}") from None
    if shape is not None:
        _require_shape(value, shape, key, where)
    if not np.all(np.isfinite(value)):
        raise ProblemError(f"{where}: {key} is not finite at the start")
    return value


def _array(given: Any, key: str, where: str, dimensions: int) -> Array:
    try:
        array = np.array(given, float, order="C")
    except (TypeError, ValueError) as error:
        raise ProblemError(f"{where}: {key} is no array of numbers: {error}") from None
    if array.ndim != dimensions or not np.all(np.isfinite(array)):
        kind = f"array of {dimensions} dimension(s)" if dimensions else "number"
        raise ProblemError(f"{where}: {key} must be a finite {kind}")
    return array


def _require_shape(array: Array, shape: tuple[int, ...], key: str, where: str) -> None:
    if array.shape != shape:
        raise ProblemError(f"{where}: {key} has shape {array.shape}, expected {shape}")


def _describe(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def _line(error: BaseException, path: Path) -> str:
    """Line of the user's file that an error came from, and that of a module beside it."""
    places = []
    frame = error.__traceback__
    while frame is not None:
        places.append((frame.tb_frame.f_code.co_filename, frame.tb_lineno))
        frame = frame.tb_next
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        places.append((error.filename, error.lineno))
    own = [i for i, (file, _) in enumerate(places) if file == str(path)]
    if not own:
        return ""
    folder = str(path.parent.absolute()) + os.sep
    beside = [(file, line) for file, line in places[own[-1] + 1 :] if file.startswith(folder)]
    where = f", line {places[own[-1]][1]}"
    return where + "".join(f": {file[len(folder) :]}, line {line}" for file, line in beside[-1:])
