"""Problems in Python: any M v' = f(u, v, t) + G(u, t) λ, 0 = Φ(u, t).

A config names a file and a factory in it,

    problem: {python: "car_axis.py:car_axis", args: {rigidity: 1.0}}

and the factory returns a `Definition`, or anything with its attributes.  Code runs
only with ``--allow-code``.  So do forces in Python on points of a mechanism.
"""

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numba.extending import is_jitted

from newmark_cli.problems import differences, index_1, starting, user_code
from newmark_cli.problems.agreement import Agreement
from newmark_cli.problems.problem import Pattern, Problem, ProblemError, Push
from newmark_cli.support import errors, files
from newmark_cli.support.arrays import Array
from newmark_cli.support.cached_code import cached_njit

_CONSISTENCY = 1e-9
#: Largest Python file that is read (bytes).
_MOST_BYTES = 10_000_000
#: Of an array that is expected; of a vector of any length a text that says so.
_Shape = tuple[int, ...] | str


@dataclass(frozen=True)
class Definition:
    """A problem with n coordinates and m constraints.

    The march calls functions that numba compiled (``@numba.njit``) without Python, which is
    much faster than plain ones.  Arrays are float64; lists and tuples of numbers serve
    as well, and are converted wherever they are returned.  Given derivatives and the energy are
    compared with differences at the start and next to it, see `agreement`.

    Attributes:
        mass_matrix: (n, n) M, constant, symmetric, positive on all motions that the
            constraints allow; elsewhere it may be singular.
        u0, v0: (n,) initial coordinates and velocities; they fit the constraints.
        force: (u, v, t) → (n,) f.
        constraints: (u, t) → (m,) Φ.
        gradient: (u, t) → (n, m) G = Φ_uᵀ.
        stiffness: (u, v, λ, t) → (n, n) X = −∂(f + Gλ)/∂u; by differences if None.
        damping: (u, v, t) → (n, n) Y = −∂f/∂v; by differences if None.
        constraint_rate: (u, t) → (m,) Φ_t, so that Φ' = Gᵀ v + Φ_t.
        curvature: (u, v, t) → (m,) κ = vᵀ Φ_uu v + 2 Φ_tu v + Φ_tt, so that
            Φ'' = Gᵀ u'' + κ.
        rate_gradient: (u, v, t) → (n, m) gradient of Φ' with respect to u:
            d/ds G(u + s v, t + s) at s = 0.
        acceleration_gradient: (u, v, w, t) → (n, m) gradient of Φ'' with respect to u at
            the acceleration w: d/ds G(u + s w, t) + d²/ds² G(u + s v, t + s) at s = 0.
            If one of these four is None, it follows from G where ``quadratic`` is set, and
            from differences elsewhere.
        t0: Initial time (s).
        quadratic: Whether Φ is at most quadratic in u and does not depend on t, as
            compensated evaluation needs it; checked.
        energy: (u, v, t) → total energy ½ vᵀM v + V, or another energy that the motion
            conserves; None if there is none.
        coordinate_names: n names, all different; None for ``1`` … ``n``.
        constraint_names: m names, all different; None for ``1`` … ``m``.

    Examples:
        A double pendulum of unit masses and lengths:

        >>> import numpy as np
        >>> import newmark_cli as newmark
        >>> double = newmark.Definition(
        ...     mass_matrix=np.eye(4),
        ...     u0=[1.0, 0.0, 2.0, 0.0],
        ...     v0=np.zeros(4),
        ...     force=lambda u, v, t: np.array([0.0, -9.81, 0.0, -9.81]),
        ...     constraints=lambda u, t: np.array(
        ...         [u[0]**2 + u[1]**2 - 1, (u[2] - u[0])**2 + (u[3] - u[1])**2 - 1]) / 2,
        ...     gradient=lambda u, t: np.array(
        ...         [[u[0], u[0] - u[2]], [u[1], u[1] - u[3]], [0, u[2] - u[0]], [0, u[3] - u[1]]]),
        ...     constraint_names=["upper", "lower"],
        ... )
        >>> newmark.march(double, h=1e-2, t_end=0.1).constraint("upper").shape
        (11,)
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
    coordinate_names: Sequence[str] | None = None
    constraint_names: Sequence[str] | None = None
    constraint_rate: Callable[..., Array] | None = None
    curvature: Callable[..., Array] | None = None
    rate_gradient: Callable[..., Array] | None = None
    acceleration_gradient: Callable[..., Array] | None = None


#: Functions of a definition: their arguments, of u, v, λ, w and t, and the axes of their values.
_SIGNATURES = {
    "constraints": ("ut", "m"),
    "force": ("uvt", "n"),
    "gradient": ("ut", "nm"),
    "stiffness": ("uvλt", "nn"),
    "damping": ("uvt", "nn"),
    "constraint_rate": ("ut", "m"),
    "curvature": ("uvt", "m"),
    "rate_gradient": ("uvt", "nm"),
    "acceleration_gradient": ("uvwt", "nm"),
    "energy": ("uvt", ""),
}
_FUNCTIONS = ("force", "constraints", "gradient")
_TANGENTS = ("stiffness", "damping")


def load(
    path: Path, factory: str, arguments: Mapping[str, Any], name: str, shown: str = ""
) -> Problem:
    """Run a factory, a function in a Python file, and take its problem.

    Modules of the file's folder can be imported, at its top or in the factory.  ``shown`` is the
    path in errors, when it is another.

    Raises:
        ProblemError: When the file or the factory fails, or what it returns cannot
            be used: a wrong shape, a derivative that disagrees with differences, an
            inconsistent start.
    """
    file = shown or str(path)
    with _ran(path, file, "problem", factory) as (function, source, imported):
        with _reported(file, f"{factory} failed: "):
            definition = function(**arguments)
        beside = imported()
    with _reported(file):
        problem = from_definition(definition, name, f"{_begin(function) or file}: {factory}")
    called = f"{factory}({', '.join(f'{key}={value!r}' for key, value in arguments.items())})"
    digest = hashlib.sha256(repr((called, source, beside)).encode())
    return replace(problem, code=digest.hexdigest(), sources={path.name: source, **beside})


@contextmanager
def _ran(
    path: Path, file: str, kind: str, name: str
) -> Iterator[tuple[Callable[..., Any], bytes, Callable[[], dict[str, bytes]]]]:
    """A function of a file, its source, and what returns those of the modules beside it."""
    try:
        source = files.read(path, _MOST_BYTES, given=True)
    except OSError as error:
        raise ProblemError(f"{file}: cannot be read: {error.strerror}") from None
    module_name = f"newmark_{kind}_{hashlib.sha256(bytes(path.resolve()) + source).hexdigest()}"
    with user_code.imports_from(path.parent, os.path.dirname(file)) as imported:
        with _reported(file):
            function = getattr(user_code.run(path, source, module_name), name, None)
        if not callable(function):
            raise ProblemError(f"{file}: has no function {name!r}")
        yield function, source, imported


@contextmanager
def _reported(file: str, what: str = "") -> Iterator[None]:
    """Errors of the user's code, an exit included, by the line that they come from."""
    try:
        yield
    except ProblemError:
        raise
    except BaseException as error:
        if user_code.is_interrupt(error):
            raise
        where = ": ".join(user_code.raised_at(error) or [file])
        raise ProblemError(f"{where}: {what}{errors.described(error)[:300]}") from None


def _begin(function: Any) -> str:
    """Where the code begins behind a function, a method, or a compiled or partial function."""
    for attribute in ("py_func", "func", "__func__"):
        function = getattr(function, attribute, function)
    code = getattr(function, "__code__", None)
    return "" if code is None else user_code.line(code.co_filename, code.co_firstlineno)


def from_definition(definition: Any, name: str, source: str = "problem") -> Problem:
    """Problem from a `Definition` or anything with its attributes; errors name its source."""
    needed = ("mass_matrix", "u0", "v0", *_FUNCTIONS)
    if missing := ", ".join(key for key in needed if not hasattr(definition, key)):
        raise ProblemError(f"{source} returned {_described(definition)}, which lacks {missing}")

    def where(key: str) -> str:
        return _begin(getattr(definition, key, None)) or source

    def array(key: str, shape: _Shape) -> Array:
        of = f"{source}: {key} must be"
        value = _array(
            getattr(definition, key, 0.0),
            shape,
            lambda given, wanted: f"{of} {wanted}, given {given}",
        )
        return _finite(value, f"{of} finite").copy(order="C")

    u0 = array("u0", "(n,)")
    n = len(u0)
    v0, mass_matrix, t0 = array("v0", (n,)), array("mass_matrix", (n, n)), float(array("t0", ()))

    used, sizes = dict[str, Callable[..., Any]](), {"n": n}
    # An acceleration that changes u by its own size within a second.
    at: dict[str, Any] = {"u": u0, "v": v0, "w": np.full(n, np.abs(u0).max(initial=0) or 1.0)}
    at["t"] = t0
    for key, (arguments, axes) in _SIGNATURES.items():
        function = getattr(definition, key, None)
        if function is None and key not in _FUNCTIONS:
            continue
        if not callable(function):
            given = _described(function)
            raise ProblemError(f"{source}: {key} must be a function, given {given}")
        shape = tuple(sizes[axis] for axis in axes) if key != "constraints" else "(m,)"
        value, used[key] = _called(function, [at[x] for x in arguments], key, where(key), shape)
        if key == "constraints":
            sizes["m"] = m = len(value)
            at["λ"] = np.linspace(1.0, 2.0, m)
        elif key == "gradient":
            _require_regular(mass_matrix, value, source, where(key))
    functions = {key: used[key] for key in _FUNCTIONS}
    rows = {key: used[key] for key in differences.ROWS if key in used}
    compiled = all(is_jitted(f) for key, f in used.items() if key != "energy")
    compile_ = njit if compiled else differences.as_it_is
    quadratic = bool(getattr(definition, "quadratic", False))
    places, of_g = (
        [index.ravel().astype(np.int64) for index in np.indices(shape)]
        for shape in ((n, n), (n, m))
    )
    exact = quadratic or len(rows) == len(differences.ROWS)
    problem = Problem(
        name=name,
        u0=u0,
        v0=v0,
        t0=t0,
        constraints=m,
        function=_evaluate(used, compile_),
        derivatives=differences.constraint_rows(functions, rows, compile_, quadratic),
        ints=np.zeros((1, 1), np.int64),
        reals=np.ones((1, 1)),
        pattern=Pattern(*places, *places, *places, *of_g),
        mass_values=np.ascontiguousarray(mass_matrix).ravel(),
        compiled=compiled,
        known_tangents=None if all(key in used for key in _TANGENTS) else (0, 0),
        quadratic=quadratic,
        potential=_potential(used.get("energy"), mass_matrix),
        coordinates_given=_names(definition, "coordinate_names", n, source),
        constraints_given=[(own,) for own in _names(definition, "constraint_names", m, source)],
        rows_given="exact" if exact else "differences",
    )
    restated = {key: f for key, f in used.items() if key not in _FUNCTIONS}
    Agreement(problem, functions, restated, lambda key: f"{where(key)}: {key}").require()
    _require_quadratic(problem, functions, where("constraints"))
    if found := starting.missed(problem, u0, v0):
        raise ProblemError(f"{source}: {found[0]} violates the constraints: {found[1]}")
    return problem


def _require_regular(mass: Array, gradient: Array, source: str, where: str) -> None:
    """M and G that determine accelerations at the start."""
    of_mass = f"{source}: mass_matrix"
    if not np.allclose(mass, mass.T):
        raise ProblemError(f"{of_mass} must be symmetric")
    inertia = np.linalg.eigvalsh(mass)
    if inertia[-1] <= 0 or inertia[0] < -1e-13 * inertia[-1]:
        raise ProblemError(f"{of_mass} must be positive: it has a negative eigenvalue, or is 0")
    m = gradient.shape[1]
    if m == 0 or np.linalg.matrix_rank(gradient) < m:
        raise ProblemError(
            f"{where}: gradient has a rank below {m} at the start: constraints are redundant"
        )
    if inertia[0] <= 1e-13 * inertia[-1] and index_1.weightless(mass, gradient).size:
        raise ProblemError(
            f"{of_mass} is singular on motions that the constraints allow: at the start the "
            "accelerations are not determined"
        )


def _names(definition: Any, key: str, count: int, source: str) -> tuple[str, ...]:
    """Names that a definition gives; none where it gives none."""
    given = getattr(definition, key, None)
    if given is None:
        return ()
    names = [] if isinstance(given, str) or not isinstance(given, Iterable) else [*given]
    good = {x for x in names if isinstance(x, str) and x.strip() and x.isprintable()}
    if not len(names) == len(good) == count:
        shown = errors.one_line(repr(names or given))[:300]
        raise ProblemError(
            f"{source}: {key} must be a list of {count} texts, all different, given {shown}"
        )
    return tuple(names)


def _evaluate(functions: Mapping[str, Any], compile_: differences.Compiler) -> Callable[..., None]:
    """The function that engines call, in terms of the user's; X and Y by differences if None."""
    force_of, phi_of, gradient_of = (functions[key] for key in _FUNCTIONS)
    of_u, of_v = (key not in functions for key in _TANGENTS)
    copy = differences.copying(compile_)
    give_x = differences.giving(functions.get("stiffness"), "uvwt", compile_)
    give_y = differences.giving(functions.get("damping"), "uvt", compile_)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        wanted = len(x_values) > 0
        us, vs, step, pace, forces, gradients = differences.states_of_tangents(
            u, v, multipliers, of_u and wanted, of_v and wanted
        )
        for k in range(us.shape[0]):
            copy(force_of(us[k], vs[k], t), forces[k])
        for k in range(gradients.shape[0]):
            copy(gradient_of(us[k], t), gradients[k])
        copy(phi_of(u, t), phi)
        differences.add_reactions(forces, gradients, multipliers)
        differences.copy(forces[0], force)
        differences.copy(gradients[0], g_values)
        if wanted:
            differences.take_tangents(forces, of_u, of_v, step, pace, x_values, y_values)
            give_x(u, v, multipliers, t, x_values)
            give_y(u, v, multipliers, t, y_values)

    return compile_(evaluate)


def _potential(
    energy: Callable[..., float] | None, mass_matrix: Array
) -> Callable[..., float] | None:
    """The user's energy less the kinetic energy; None without one."""
    if energy is None:
        return None

    def potential(t, u, v, ints, reals):  # type: ignore[no-untyped-def]
        return float(energy(u, v, t)) - 0.5 * float(v @ mass_matrix @ v)

    return potential


def _require_quadratic(problem: Problem, functions: Mapping[str, Any], where: str) -> None:
    """Φ(u + Δ) − Φ(u) = G(u + Δ/2)ᵀ Δ for three changes, and no time in Φ, if declared so."""
    u, t = problem.u0, problem.t0
    for seed in range(3 if problem.quadratic else 0):
        random = np.random.default_rng(seed)
        change = random.normal(size=problem.n) * np.abs(u).max()
        # Not a whole number of seconds, in which a law of time may repeat itself.
        elapsed = random.uniform(0.1, 1.0)
        expected = np.asarray(functions["gradient"](u + change / 2, t)).T @ change
        begin, end, later = (
            np.asarray(functions["constraints"](*at))
            for at in ((u, t), (u + change, t), (u + change, t + elapsed))
        )
        least = _CONSISTENCY * sum(float(np.abs(x).max()) for x in (expected, begin, end))
        for misfit, what in ((end - begin - expected, "are not"), (later - end, "depend on t")):
            if np.abs(misfit).max() > least:
                raise ProblemError(f"{where}: constraints are declared quadratic, but {what}")


def _called(
    function: Any, arguments: Sequence[Any], key: str, where: str, shape: _Shape
) -> tuple[Array, Callable[..., Any]]:
    """Result of a function at the start, and the function that returns it as an array.

    A function that returns arrays is itself that function: converting costs time in every
    Newton iteration.
    """
    with _reported(where, f"{key} failed: "):
        result = function(*arguments)
    of = f"{where}: {key}"
    value = _array(result, shape, lambda given, wanted: f"{of} returned {given}, expected {wanted}")
    _finite(value, f"{of} is not finite at the start")
    if isinstance(result, np.ndarray) or shape == ():
        return value, function
    return value, _converting(function)


def _converting(function: Callable[..., Any]) -> Callable[..., Array]:
    """The function, with its result as an array; compiled if it is."""
    if is_jitted(function):

        @njit
        def converted(*arguments):  # type: ignore[no-untyped-def]
            return np.array(function(*arguments), np.float64)

        return converted  # type: ignore[no-any-return]
    return lambda *arguments: _numbers(function(*arguments))


def _array(value: Any, shape: _Shape, complaint: Callable[[str, str], str]) -> Array:
    """The user's value as an array of floats; a complaint takes what it is, and what it must be."""
    described = _described(value)
    try:
        array = _numbers(value)
        if array.ndim == 1 if isinstance(shape, str) else array.shape == shape:
            return array
        described = f"{described} of shape {array.shape}" if array.ndim else described
    except (TypeError, ValueError):
        pass
    wanted = "a number" if shape == () else f"an array of shape {shape}"
    raise ProblemError(complaint(described, wanted))


def _numbers(value: Any) -> Array:
    """A new or the same array of floats; TypeError or ValueError if these are not numbers."""
    array = np.asarray(value)
    # Text that reads as a number, and complex numbers, would be converted silently.
    if array.dtype.kind not in "biufO":
        raise TypeError("not numbers")
    if array.dtype.kind == "O" and any(isinstance(item, str | None) for item in array.flat):
        raise TypeError("not numbers")
    return np.asarray(array, float)


def _finite(array: Array, complaint: str) -> Array:
    """The array; an error names its first component that is not finite."""
    for place in np.argwhere(~np.isfinite(array)).tolist():
        where = ", ".join(str(i + 1) for i in place)
        what = f"component {where} is" if where else "it is"
        raise ProblemError(f"{complaint}: {what} {float(array[tuple(place)])}")
    return array


def _described(value: Any) -> str:
    """A returned or given value, in few words."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, str | bool | int | float | complex):
        return repr(value)[:60]
    name = "array" if isinstance(value, np.ndarray) else type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


# -- forces on mechanisms ----------------------------------------------------------------


def pushed(problem: Problem, pushes: Sequence[Push], folder: Path, shown_folder: str) -> Problem:
    """The mechanism with forces in Python, whose files are looked for in a folder.

    A function of the user's, compiled by numba or not,

        def drag(positions, velocities, t):
            return -0.3 * velocities

    is handed the places (m) and velocities (m/s) of k points, (k, 2) each, and the time (s), and
    returns the forces on them (N), (k, 2).  Its tangents are found by differences.

    Raises:
        ProblemError: When a file or a function fails, or does not return k forces.
    """
    code, sources = "", dict[str, bytes]()
    for push in pushes:
        file, _, name = push.python.rpartition(":")
        path, shown = folder / file, os.path.join(shown_folder, file)
        with _ran(path, shown, "forces", name) as (function, source, imported):
            contents = {path.name: source, **imported()}
        own = list(push.coordinates)
        start = _places(problem.u0[own], push.weights, push.offsets)
        speed = _places(problem.v0[own], push.weights, 0 * push.offsets)
        where = _begin(function) or shown
        _, function = _called(function, (start, speed, problem.t0), name, where, start.shape)
        named = {os.path.normpath(os.path.join(file, "..", key)): x for key, x in contents.items()}
        code += repr((push.python, named))
        sources |= named
        problem = _with(problem, push, function)
    return replace(problem, code=hashlib.sha256(code.encode()).hexdigest(), sources=sources)


def _with(problem: Problem, push: Push, function: Callable[..., Any]) -> Problem:
    """The problem with one force more, whose tangents stand behind those that it has."""
    compiled = problem.compiled and is_jitted(function)
    compile_ = njit if compiled else differences.as_it_is
    own, weights = np.array(push.coordinates, np.int64), np.ascontiguousarray(push.weights)
    offsets, at_rest = push.offsets, 0 * push.offsets
    pattern, before, copy = problem.pattern, problem.function, differences.copying(compile_)
    first_x, first_y = len(pattern.x_rows), len(pattern.y_rows)

    def evaluate(  # type: ignore[no-untyped-def]
        t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values
    ):
        before(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values)
        wanted = len(x_values) > first_x
        step, pace = differences.steps_of_tangents(u, v)
        us, vs = differences.states_around(u[own], v[own], wanted, wanted, step, pace)
        forces, loads = np.zeros(us.shape), np.empty((len(offsets) // 2, 2))
        for k in range(us.shape[0]):
            places = _places(us[k], weights, offsets)
            copy(function(places, _places(vs[k], weights, at_rest), t), loads)
            _add(loads, weights, forces[k])
        force[own] += forces[0]
        differences.take_tangents(
            forces, wanted, wanted, step, pace, x_values[first_x:], y_values[first_y:]
        )

    rows, columns = (own[index.ravel()] for index in np.indices((len(own), len(own))))
    return replace(
        problem,
        function=compile_(evaluate),
        pattern=pattern._replace(
            x_rows=np.concatenate([pattern.x_rows, rows]),
            x_columns=np.concatenate([pattern.x_columns, columns]),
            y_rows=np.concatenate([pattern.y_rows, rows]),
            y_columns=np.concatenate([pattern.y_columns, columns]),
        ),
        compiled=compiled,
        known_tangents=problem.known_tangents or (first_x, first_y),
        single=False,
        potential=None,
    )


@cached_njit(nogil=True, error_model="numpy")
def _places(q, weights, offsets):  # type: ignore[no-untyped-def]
    """(k, 2) places of the points at coordinates q, or with no offsets their velocities."""
    places = offsets.copy()
    for i in range(weights.shape[0]):
        for j in range(q.shape[0]):
            places[i] += weights[i, j] * q[j]
    return places.reshape(-1, 2)


@cached_njit(nogil=True, error_model="numpy")
def _add(loads, weights, forces):  # type: ignore[no-untyped-def]
    """Generalised forces (c,) of loads (k, 2)."""
    for j in range(forces.shape[0]):
        for i in range(loads.shape[0]):
            forces[j] += weights[2 * i, j] * loads[i, 0] + weights[2 * i + 1, j] * loads[i, 1]
