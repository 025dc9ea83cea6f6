"""Somebody's tests of convergence, next to what rounding lets Newton's iteration reach."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import Subject
from newmark_cli.library import arguments
from newmark_cli.newmark.floor import Floor
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.noise import ROUNDING
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.study.measures import symbol

#: In place of an unknown: the norm of all of them.
ALL = "all"
#: On which unknowns a correction is tested, and when a residual is, relative to scaling.
TESTED, RESIDUAL_TESTED = ("scaled", "physical"), ("before", "after")
#: The smallest tolerance over the predicted rms of what is tested: some steps come to rest
#: with a correction of up to six times that, and three times the smallest tolerance is to
#: be met by all.
SPREAD = 2.0
#: What to set over the smallest tolerance.
MARGIN = 3.0


def tolerances_of(tolerance: Any, unknowns: Sequence[str]) -> dict[str, float]:
    """Unknown, or `ALL`, → tolerance on its correction, from an argument of `advise`."""
    by_unknown = tolerance if isinstance(tolerance, Mapping) else {ALL: tolerance}
    return {
        arguments.one_of("name in tolerance", name, (*unknowns, ALL)): arguments.positive(
            f"tolerance of {name}" if name != ALL else "tolerance", value
        )
        for name, value in by_unknown.items()
        if value is not None
    }


def largest(floors: Sequence[Floor], unknown: str, kind: str, scheme: Scheme) -> float:
    """Largest floor, scaled or physical, of an unknown or of `ALL`; NaN if a state has none."""
    names = scheme.form.solved if unknown == ALL else (unknown,)
    at_states: list[Mapping[str, float]] = [getattr(floor, kind) for floor in floors]
    return float(np.max([math.hypot(*(of[name] for name in names)) for of in at_states]))


def of_correction(
    unknown: str,
    tolerance: float,
    tested: str,
    schemes: Mapping[float, Scheme],
    floors: Mapping[float, Sequence[Floor]],
) -> str:
    """Say whether a tolerance on a correction can be met at each step size, and what to do."""
    name = "all unknowns" if unknown == ALL else symbol(unknown)
    test = f"tolerance {tolerance:g} on the {tested} correction of {name}"
    sizes = {h: largest(of, unknown, tested, schemes[h]) for h, of in floors.items()}
    reached = {h: size for h, size in sizes.items() if not math.isnan(size)}
    if not reached:
        return f"{test}: cannot be judged: no floor is predicted at these step sizes"
    least = min(reached)
    scheme, of_all = schemes[least], floors[least]
    worst = unknown
    if unknown == ALL:
        worst = max(scheme.form.solved, key=lambda one: largest(of_all, one, tested, scheme))
    factor, cure = scheme.scaling.right.get(worst), ""
    if factor is None or factor.order() >= 0:
        cure = (
            f"{symbol(worst)} is not scaled under {scheme.scaling.name}: scale the unknowns, and "
            "test those that the solver sees"
        )
    elif tested == "physical":
        cure = (
            f"{symbol(worst)} is tested after unscaling: test {factor**-1} · {symbol(worst)} "
            "instead, whose last correction is "
            f"{largest(of_all, worst, 'scaled', scheme):.2g} at h = {least:g}"
        )
    return _judged(test, tolerance, reached, "Newton's last correction", cure)


def of_residual(
    tolerance: float, tested: str, about: Subject, schemes: Mapping[float, Scheme]
) -> str:
    """The same of a tolerance on the residual."""
    reached, least, cure = {}, min(schemes), ""
    for h, scheme in schemes.items():
        # Each term of a row is rounded twice: by itself, and against what the past adds to it.
        terms = about.jacobian(scheme, about.typical) * about.unknowns(scheme, about.typical)
        sizes = ROUNDING * np.finfo(scheme.dtype).eps * np.sqrt(2 * np.sum(terms**2, axis=1))
        left, _ = scaling_factors(scheme, about.problem.n, about.problem.m)
        after = float(np.linalg.norm(left * sizes))
        reached[h] = after if tested == "after" else float(np.linalg.norm(sizes))
        if h != least:
            continue
        if scheme.scaling.left["D"].order() <= 0:
            cure = "Row D is not scaled: multiply it by its left factor before the test"
        elif tested == "before":
            cure = (
                "The terms of row D grow as h falls: test D_L b instead, which rounding leaves at "
                f"{after:.2g} at h = {h:g}"
            )
    test = f"tolerance {tolerance:g} on the residual, tested {tested} scaling"
    return _judged(test, tolerance, reached, "the residual that rounding leaves", cure)


def _judged(
    test: str, tolerance: float, reached: Mapping[float, float], what: str, cure: str
) -> str:
    """Whether a tolerance is met at every step size, from the predicted rms of what is tested."""
    close = {h: size for h, size in reached.items() if tolerance < SPREAD * MARGIN * size}
    if not close:
        h, size = max(reached.items(), key=lambda item: item[1])
        return f"{test}: can be met; {what} is {size:.2g} at h = {h:g}"
    missed = {h: size for h, size in close.items() if tolerance < SPREAD * size}
    h = min(missed or close)
    steps = ", ".join(f"{step:g}" for step in missed or close)
    verdict = "cannot be met" if missed else "is too close to rounding to be met at every step"
    cure = cure or f"Set {SPREAD * MARGIN * max(reached.values()):.2g} or more"
    return f"{test}: {verdict} at h = {steps}: {what} is {close[h]:.2g} at h = {h:g}. {cure}"


def one_sided(scheme: Scheme, order: float, condition: Mapping[str, float]) -> Iterable[str]:
    """Say what a scaling other than the optimal one leaves undone: order and size of C."""
    name = scheme.scaling.name
    if order >= 0 or name == "optimal":
        return
    sides = {
        "none": "nothing is scaled",
        "left": "only the equations are scaled: scale the unknowns, too",
        "right": "only the unknowns are scaled: scale the equations, too",
    }
    why = sides.get(name, f"the scaling {name} is not balanced")
    yield (
        f"{why}. C still grows like h^{order:g}: it is {condition[name]:.3g} at h = {scheme.h:g}, "
        f"and {condition['optimal']:.3g} with both sides of Table 2"
    )
