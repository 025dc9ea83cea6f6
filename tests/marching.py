"""What tests of marches share: steps, states along a run, what "the same step" means."""

from dataclasses import replace

import numpy as np

from newmark_cli.newmark import march_data
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import BDF1, BDF2, HHT, Alpha, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.newmark.march import March, initial_state
from newmark_cli.newmark.march_data import counting
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
FORMULATIONS = [
    "index-3",
    "index-2",
    "index-1",
    "baumgarte rate=20",
    "baumgarte rate_h=1",
    "ggl",
    "augmented-lagrangian factor=10",
    "augmented-lagrangian penalty=50",
]
PROJECTIONS = [
    "none",
    "velocity",
    "velocity accelerations",
    "position-velocity",
    "position-velocity accelerations",
]
INTEGRATORS = [
    Newmark(), Newmark(0.3025, 0.6), GeneralizedAlpha(0.9), GeneralizedAlpha(0.0), HHT(0.1),
    Alpha(0.3025, 0.6, -0.1, 0.0), BDF1(), BDF2(),
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


def start(subject, integrator=None, h=1e-2):
    """The consistent initial state."""
    return initial_state(subject, scheme_of("u-lambda", "none", h, integrator))


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


def formulated(
    formulation, form="a-lambda", h=1e-2, integrator=None, scaling="optimal", projection="none",
    **options,
):  # fmt: skip
    """A scheme whose parts are given by their labels; generalized-α with ρ∞ = 0.9, or another."""
    of = Formulation.parse(formulation)
    form = of.applied(FORMS[form])
    return Scheme(
        integrator or GeneralizedAlpha(0.9), form, named_scaling(scaling, form), h,
        formulation=of, projection=Projection.parse(projection), **options,
    )  # fmt: skip


def scheme_of(form, variant, h, integrator=None, **options):
    """Index 3 by the trapezoidal rule, or another."""
    return formulated("index-3", form, h, integrator or Newmark(), variant, **options)


def march_of(subject, scheme, engine="kernel", **options):
    """A march: compiled, or by a dense or a sparse system in Python."""
    found = March(subject, scheme, "sparse-lu" if engine == "sparse" else "dense-lu", **options)
    if engine == "dense":
        found._engine = in_python(
            subject, scheme, found.system, constraining=found.system.constraining
        )
    return found


def in_motion(subject, seed=3):
    """A state in general position."""
    random = np.random.default_rng(seed)
    state = start(subject)
    state.fields[0] += 0.05 * np.abs(subject.u0).max() * random.normal(size=subject.n)
    state.fields[1] += random.normal(size=subject.n)
    state.multipliers[:] += random.normal(size=subject.m)
    return state
