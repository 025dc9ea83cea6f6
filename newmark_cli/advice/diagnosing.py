"""Somebody's tests of convergence, next to what rounding lets Newton's iteration reach."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import Subject
from newmark_cli.library import arguments
from newmark_cli.newmark.floor import Floor
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.noise import ROUNDING
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.support.errors import ArgumentError

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
_SYMBOLS = {"lambda": "λ", "eta": "η"}


@dataclass(frozen=True)
class Tests:
    """Tests of convergence that somebody's code makes.

    Attributes:
        tolerances: Unknown, or `ALL`, → tolerance on the 2-norm of its correction.
        tested: One of `TESTED`.
        residual: Tolerance on the residual's 2-norm; None without one.
        residual_tested: One of `RESIDUAL_TESTED`.
    """

    tolerances: Mapping[str, float]
    tested: str
    residual: float | None
    residual_tested: str

    @classmethod
    def of(
        cls,
        tolerance: Any,
        tested: str,
        residual: Any,
        residual_tested: str,
        unknowns: Sequence[str],
    ) -> "Tests":
        """The same from arguments of `advise`.

        Raises:
            ArgumentError: When they cannot be used.
        """
        by_unknown = tolerance if isinstance(tolerance, Mapping) else {ALL: tolerance}
        allowed = (*unknowns, ALL)
        tolerances = {
            arguments.one_of("name in tolerance", name, allowed): arguments.positive(
                f"tolerance of {name}" if name != ALL else "tolerance", value
            )
            for name, value in by_unknown.items()
            if value is not None
        }
        arguments.one_of("tested", tested, TESTED)
        arguments.one_of("residual_tested", residual_tested, RESIDUAL_TESTED)
        if residual is not None:
            residual = arguments.positive("residual_tolerance", residual)
        return cls(tolerances, tested, residual, residual_tested)


def largest(floors: Sequence[Floor], unknown: str, kind: str, scheme: Scheme) -> float:
    """Largest floor, scaled or physical, of an unknown or of `ALL`; NaN if a state has none."""
    names = scheme.form.solved if unknown == ALL else (unknown,)
    at_states: list[Mapping[str, float]] = [getattr(floor, kind) for floor in floors]
    return float(np.max([math.hypot(*(of[name] for name in names)) for of in at_states]))


def diagnosed(
    tests: Tests,
    about: Subject,
    schemes: Mapping[float, Scheme],
    floors: Mapping[float, Sequence[Floor]],
) -> Iterator[str]:
    """Say what is wrong, or right, with each of the tests, in a sentence.

    Raises:
        ArgumentError: When there is no state that floors could be predicted at.
    """
    if (tests.tolerances or tests.residual is not None) and not all(floors.values()):
        raise ArgumentError(
            f"{about.name}: a tolerance can be judged only where a state u, v, a, lambda is given"
        )
    for unknown, tolerance in tests.tolerances.items():
        yield _of_correction(unknown, tolerance, tests.tested, schemes, floors)
    if tests.residual is not None:
        yield _of_residual(tests.residual, tests.residual_tested, about, schemes)


def _of_correction(
    unknown: str,
    tolerance: float,
    tested: str,
    schemes: Mapping[float, Scheme],
    floors: Mapping[float, Sequence[Floor]],
) -> str:
    name = "all unknowns" if unknown == ALL else _SYMBOLS.get(unknown, unknown)
    reached = {h: largest(of, unknown, tested, schemes[h]) for h, of in floors.items()}
    test = f"tolerance {tolerance:g} on the {tested} correction of {name}"
    reached = {h: size for h, size in reached.items() if not math.isnan(size)}
    if not reached:
        return f"{test}: cannot be judged: no floor is predicted at these step sizes"
    verdict = _verdict(test, tolerance, reached)
    if _is_met(tolerance, reached):
        return verdict
    least = min(reached)
    scheme, of_all = schemes[least], floors[least]
    worst = unknown
    if unknown == ALL:
        worst = max(scheme.form.solved, key=lambda one: largest(of_all, one, tested, scheme))
    factor = scheme.scaling.right.get(worst)
    symbol = _SYMBOLS.get(worst, worst)
    if factor is None or factor.order() >= 0:
        return (
            f"{verdict}. {symbol} is not scaled under {scheme.scaling.name}: scale the unknowns, "
            "and test those that the solver sees"
        )
    if tested == "scaled":
        return f"{verdict}. Set {_enough(reached):.2g} or more"
    return (
        f"{verdict}. {symbol} is tested after unscaling: test {factor**-1} · {symbol} instead, "
        f"whose last correction is {largest(of_all, worst, 'scaled', scheme):.2g} at h = {least:g}"
    )


def _of_residual(
    tolerance: float, tested: str, about: Subject, schemes: Mapping[float, Scheme]
) -> str:
    before, after = ({h: of[k] for h, of in _residuals(about, schemes).items()} for k in (0, 1))
    reached = before if tested == "before" else after
    test = f"tolerance {tolerance:g} on the residual, tested {tested} scaling"
    verdict = _verdict(test, tolerance, reached, "the residual that rounding leaves")
    if _is_met(tolerance, reached):
        return verdict
    scheme, least = schemes[min(schemes)], min(schemes)
    if scheme.scaling.left["D"].order() <= 0:
        return f"{verdict}. Row D is not scaled: multiply it by its left factor before the test"
    if tested == "after":
        return f"{verdict}. Set {_enough(reached):.2g} or more"
    return (
        f"{verdict}. The terms of row D grow as h falls: test D_L b instead, which rounding leaves "
        f"at {after[least]:.2g} at h = {least:g}"
    )


def _residuals(about: Subject, schemes: Mapping[float, Scheme]) -> dict[float, tuple[float, float]]:
    """Step size → rms of the residual's norm that rounding leaves, before and after scaling.

    Each term of a row is rounded twice: by itself, and against what the past adds to it.
    """
    left_over = {}
    for h, scheme in schemes.items():
        terms = about.jacobian(scheme, about.typical) * about.unknowns(scheme, about.typical)
        sizes = ROUNDING * np.finfo(scheme.dtype).eps * np.sqrt(2 * np.sum(terms**2, axis=1))
        left, _ = scaling_factors(scheme, about.n, about.m)
        left_over[h] = float(np.linalg.norm(sizes)), float(np.linalg.norm(left * sizes))
    return left_over


def _enough(reached: Mapping[float, float]) -> float:
    """Tolerance that is met at every step size, from the predicted rms of what is tested."""
    return SPREAD * MARGIN * max(reached.values())


def _is_met(tolerance: float, reached: Mapping[float, float]) -> bool:
    return tolerance >= _enough(reached)


def _verdict(
    test: str,
    tolerance: float,
    reached: Mapping[float, float],
    what: str = "Newton's last correction",
) -> str:
    if _is_met(tolerance, reached):
        h, size = max(reached.items(), key=lambda item: item[1])
        return f"{test}: can be met; {what} is {size:.2g} at h = {h:g}"
    close = {h: size for h, size in reached.items() if tolerance < SPREAD * MARGIN * size}
    missed = {h: size for h, size in close.items() if tolerance < SPREAD * size}
    h = min(missed or close)
    steps = ", ".join(f"{step:g}" for step in missed or close)
    verdict = "cannot be met" if missed else "is too close to rounding to be met at every step"
    return f"{test}: {verdict} at h = {steps}: {what} is {close[h]:.2g} at h = {h:g}"


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
