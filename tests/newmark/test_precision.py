"""Single precision: the march computes in it, and nothing raises a term to double."""

import ast
import inspect
from types import SimpleNamespace

import mechanisms
import numpy as np
import pytest
from covering import covering
from hypothesis import given, settings
from hypothesis import strategies as st
from marching import compiled, formulated, march
from numba import njit

import newmark_cli as newmark
from newmark_cli.mechanisms import elements
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark import enforcing, kernel, newton
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import METHODS
from newmark_cli.newmark.integrator import BDF2
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import counting, recording
from newmark_cli.newmark.scheme import EVALUATIONS, PRECISIONS, Tolerance


@njit
def sine(x):
    return np.sin(x)


@njit
def cosine(x):
    return np.cos(x)


@pytest.fixture(scope="module")
def everything():
    """A mechanism with every element, driven."""
    return mechanisms.everything()


def evaluated(function, subject, dtype, t, *state):
    """Force, Φ, X, Y, G in a precision."""
    pattern = subject.pattern
    sizes = subject.n, subject.m, len(pattern.x_rows), len(pattern.y_rows), len(pattern.g_rows)
    results = [np.full(size, np.nan, dtype) for size in sizes]
    given = (x.astype(dtype) for x in state)
    function(dtype(t), *given, subject.ints, subject.reals.astype(dtype), *results)
    return results


@given(seed=st.integers(0, 2**32 - 1), t=st.floats(-2, 2))
@settings(max_examples=10)
def test_elements_compute_in_single_precision(everything, seed, t):
    """Compiled and interpreted they agree bit by bit: no constant raises a term to double.

    NumPy's own sine differs from that of compiled code by a unit of rounding, so the
    interpreter is handed the latter.
    """
    random = np.random.default_rng(seed)
    u = everything.u0 + 0.2 * random.normal(size=everything.n)
    state = u, random.normal(size=everything.n), random.normal(size=everything.m)
    compiled = evaluated(elements.evaluate, everything, np.float32, t, *state)
    with mechanisms.interpreted() as patch:
        given = {name: getattr(np, name) for name in ("sqrt", "int64", "uint32")}
        patch.setattr(elements, "np", SimpleNamespace(sin=sine, cos=cosine, **given))
        interpreted = evaluated(elements.evaluate, everything, np.float32, t, *state)
    double = evaluated(elements.evaluate, everything, np.float64, t, *state)
    for found, expected, exact in zip(compiled, interpreted, double, strict=True):
        assert found.dtype == expected.dtype == np.float32
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-3 * np.abs(exact).max())


def interpreted_march(subject, scheme, state, counts):
    """The kernel's march as Python runs it, and all that it calls but the problem's functions."""
    engine = Engine(subject, scheme)
    given = engine.arguments(state, 0, counts, recording(state, np.empty(0)))
    functions, plan, extra, python, *_ = given
    plan = plan._replace(problem=plan.problem._replace(ints=subject.ints))
    room = kernel.allocate(plan, extra, python.calls, state, counts.norms.shape[1])
    with pytest.MonkeyPatch.context() as patch:
        for module in (newton, enforcing, kernel):
            for name, function in list(vars(module).items()):
                if hasattr(function, "py_func"):
                    patch.setattr(module, name, function.py_func)
        solve = functions[2] if extra is None else None
        return kernel._march(
            subject.function, subject.derivatives, solve, plan, extra, *given[4:], room
        )


@pytest.mark.parametrize(
    "precision", ["float64", pytest.param("float32", marks=pytest.mark.release)]
)
def test_the_march_computes_in_its_precision(precision):
    """Compiled and interpreted it takes the same steps bit by bit."""
    subject = problem("four-bar")
    ways = METHODS, ["none", "velocity", "position-velocity accelerations"]
    if precision == "float32":  # with formulations it takes a minute to compile
        ways = ["index-3"], ["none"]
    formulations, projections = ways
    stops = [None, Tolerance(1e-5, 1e-4)]
    for case in covering(formulations, FORMS, EVALUATIONS, projections, stops):
        formulation, form, evaluation, projection, stop = case
        integrator = BDF2() if evaluation == "direct" else None
        scheme = formulated(
            formulation, form, 1e-3, integrator, projection=projection, evaluation=evaluation,
            precision=precision, stop=stop,
        )  # fmt: skip
        ours, reference = initial_state(subject, scheme), initial_state(subject, scheme)
        norms, iterations = march(compiled, subject, scheme, ours, 0, 2)
        expected = counting(*norms.shape)
        interpreted_march(subject, scheme, reference, expected)
        np.testing.assert_array_equal(norms, expected.norms, str(case))
        np.testing.assert_array_equal(iterations, expected.iterations, str(case))
        for one, other in zip(ours, reference, strict=True):
            assert one.dtype == np.dtype(precision)
            np.testing.assert_array_equal(one, other, str(case))


@pytest.mark.parametrize("form", ["u-lambda", "a-lambda", "u-v-a-lambda"])
def test_single_precision_takes_the_steps_of_double(form):
    """To its rounding, interpreted: to compile it takes half a minute."""
    subject, found = problem("four-bar"), {}
    for precision in PRECISIONS:
        scheme = formulated("index-3", form, 1e-3, evaluation="compensated", precision=precision)
        state, counts = initial_state(subject, scheme), counting(2, len(scheme.recorded))
        interpreted_march(subject, scheme, state, counts)
        assert {array.dtype for array in state} == {np.dtype(precision)}
        found[precision] = (*state.fields, state.multipliers), counts.iterations
    (double, corrections), (single, fewer) = (found[precision] for precision in PRECISIONS)
    for one, other in zip(single, double, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5 * np.abs(other).max())
    assert fewer.sum() < corrections.sum()


@pytest.mark.parametrize("formulation", METHODS)
def test_formulations_are_told_in_single_precision(formulation):
    """Every number of theirs and of the plan, but for times and what norms are compared with."""
    subject = problem("four-bar")
    scheme = formulated(
        formulation, projection="position-velocity accelerations", precision="float32"
    )
    state = initial_state(subject, scheme)
    counts, record = counting(2, len(scheme.recorded)), recording(state, np.empty(0))
    _, plan, extra, *_ = Engine(subject, scheme).arguments(state, 0, counts, record)
    numbers = {name: value for part in plan for name, value in part._asdict().items()}
    doubles = {name for name, value in numbers.items() if np.asarray(value).dtype == np.float64}
    assert doubles == {"settled_below", "limits", "times"}
    assert numbers["settled_below"] == np.sqrt(np.finfo(np.float32).eps)
    kinds = {name: np.asarray(value).dtype for name, value in extra._asdict().items()}
    assert {name for name, kind in kinds.items() if kind == np.float32} == {
        "rows", "eta", "rows_eta", "inertia", "penalty", "acting", "unit", "projector_values",
    }  # fmt: skip
    assert all(kind == np.float32 or kind.kind != "f" for kind in kinds.values())


def test_no_constant_of_the_march_is_in_double():
    """But for zeros, with which sums in double begin; others have the type of the numbers."""
    for module in (newton, enforcing, kernel):
        nodes = [*ast.walk(ast.parse(inspect.getsource(module)))]
        calls = [node for node in nodes if isinstance(node, ast.Call)]
        typed = [call.args for call in calls if ast.unparse(call.func).endswith(".dtype.type")]
        constants = [node for node in nodes if isinstance(node, ast.Constant) and node.value]
        found = [node for node in constants if isinstance(node.value, float)]
        assert all([node] in typed for node in found), module


@pytest.mark.release
def test_advice_has_tolerances_of_single_precision():
    """Those of double times the ratio of their roundings, or about."""
    found = newmark.advise("pendulum", h=1e-3, integrator="bdf2").tolerances
    scaled = {(one.unknown, one.precision): one.scaled for one in found}
    for unknown in ("u", "lambda", "all"):
        ratio = scaled[unknown, "float32"] / scaled[unknown, "float64"]
        assert 2**27 < ratio < 2**31
