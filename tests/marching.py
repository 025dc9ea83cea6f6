"""What tests of marches share: steps, states along a run, what "the same step" means."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from newmark_cli.newmark import kernel, march_data
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import BDF1, BDF2, HHT, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import counting, recording
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme

EPS = np.finfo(float).eps
#: Step sizes at which Newton converges well and rounding does not yet drown a.
STEP = {
    "pendulum": 1e-2,
    "andrews": 1e-5,
    "damped": 1e-2,
    "double-pendulum": 1e-2,
    "four-bar": 1e-3,
    "slider-crank": 1e-3,
    "shaken-pendulum": 1e-3,
    "heavy-top": 1e-4,
    "bricard": 1e-3,
    "governor": 1e-4,
    "spatial-slider-crank": 1e-3,
}
INTEGRATORS = [
    Newmark(), Newmark(0.3025, 0.6), GeneralizedAlpha(0.9), GeneralizedAlpha(0.0), HHT(0.1),
    BDF1(), BDF2(),
]  # fmt: skip


#: The last that was needed: it holds nothing of a state, and making it takes longer than a step.
_engine = None


def compiled(subject, scheme):
    """The engine whose every part is compiled, if the problem is."""
    global _engine
    if _engine is None or _engine.problem is not subject or _engine.scheme is not scheme:
        _engine = Engine(subject, scheme)
    return _engine


def in_python(subject, scheme, system=None, **options):
    """An engine that calls the problem's functions and a linear system, dense or given, in Python.

    Residuals aside, what it adds up is assembled by other code than the kernel's.
    """
    system = system or DenseSystem(subject, scheme)
    given = {"system_at": lambda step: system, **options}
    return Engine(replace(subject, compiled=False), scheme, **given)


def in_system(subject, scheme, system):
    """The same for one linear system, with the problem's own functions."""
    return Engine(subject, scheme, system_at=lambda step: system)


#: Ways to march.
ENGINES = compiled, in_python


def march(engine, subject, scheme, state, first, steps):
    """Norms and iterations of steps that are all taken; ``engine`` is a function above."""
    counts = counting(steps, len(scheme.recorded))
    assert engine(subject, scheme).march(state, first, counts) == (march_data.COMPLETED, steps)
    return counts.norms, counts.iterations


def interpreted_march(subject, scheme, state, first, counts, record=None):
    """The kernel's march as Python runs it, and all that it calls but the problem's functions."""
    engine = Engine(subject, scheme)
    kept = recording(state, np.empty(0)) if record is None else record
    given = engine.arguments(state, first, counts, kept)
    functions, (of_problem, of_step), (static, dense), extra, python, _, schedule, sizes, *_ = given
    tables = of_problem._replace(ints=subject.ints), of_step
    room = kernel._allocate(*tables, dense, extra, state, schedule, sizes, counts.norms.shape[1])
    with pytest.MonkeyPatch.context() as patch:
        for name, function in list(vars(kernel).items()):
            if hasattr(function, "py_func"):
                patch.setattr(kernel, name, function.py_func)
        solve = functions[2] if extra is None else None
        return kernel._march(
            subject.function, subject.derivatives, solve, *tables, static, dense, extra,
            python.calls, *given[5:], room,
        )  # fmt: skip


class Interpreted:
    """In place of the engine of a march."""

    static = None

    def __init__(self, subject, scheme):
        self.march = partial(interpreted_march, subject, scheme)


def start(subject, integrator=None, h=1e-2):
    """The consistent initial state."""
    return initial_state(subject, scheme_of("u-lambda", "none", h, integrator))


def states(subject, integrator, h, count):
    """States along a run of the (u, λ) form, 25 steps apart."""
    scheme = scheme_of("u-lambda", "optimal", h, integrator)
    state = initial_state(subject, scheme)
    for k in range(count):
        yield 25 * k, state.copy()
        march(compiled, subject, scheme, state, 25 * k, 25)


def assert_same_step(subject, scheme, first, second):
    """Equal up to rounding of u, and what each update relation makes of it."""
    h, symbols = scheme.h, scheme.integrator.symbols(scheme.h)
    beta, gamma = symbols["beta"], symbols["gamma"]
    unit = 30 * EPS * np.linalg.norm(first.fields[0])
    smallest = np.linalg.svd(
        subject.evaluate(0, *first.fields[:2], first.multipliers).G, compute_uv=False
    )[-1]
    to_multiplier = np.linalg.norm(subject.M, 2) / (beta * h**2) / smallest
    for name, one, other, weight in (
        ("u", first.fields[0], second.fields[0], 1),
        ("v", first.fields[1], second.fields[1], gamma / (beta * h)),
        ("a", first.fields[2], second.fields[2], 1 / (beta * h**2)),
        ("lambda", first.multipliers, second.multipliers, to_multiplier),
    ):
        assert np.linalg.norm(one - other) <= unit * weight, name


def scheme_of(form, variant, h, integrator=None, **changes):
    """The trapezoidal rule, or another; changes are further fields of the scheme."""
    form = FORMS[form]
    return Scheme(integrator or Newmark(), form, named_scaling(variant, form), h, **changes)


def in_motion(subject, seed=3):
    """A state in general position."""
    random = np.random.default_rng(seed)
    state = start(subject)
    state.fields[0] += 0.05 * np.abs(subject.u0).max() * random.normal(size=subject.n)
    state.fields[1] += random.normal(size=subject.n)
    state.multipliers[:] += random.normal(size=subject.m)
    return state
