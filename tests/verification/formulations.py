"""Errors of multipliers of every formulation and projection, down to h = 1e-7.

Andrews' mechanism at t = 0.03 against the solution of the index-1 system, and a pendulum
thrown with v₀ ≠ 0 against its angle.  Prints a table, says what must hold and whether it
does, and exits with 1 where it does not.  Takes a few minutes.

    python tests/verification/formulations.py
"""

import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import CORRECTED, Formulation, Projection
from newmark_cli.newmark.integrator import GeneralizedAlpha, Integrator, Newmark
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, Scheme
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import relative_error, solution

TRAPEZOIDAL, DAMPED = Newmark(), GeneralizedAlpha(0.9)
STEPS = (1e-4, 1e-5, 1e-6, 1e-7)
END = 0.03
THROWN = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1, 0], mass: 1, velocity: [0, 1]}
bars:
  rod: {from: O, to: P, length: 1}
gravity: [0, -1]
"""


class Claims:
    """What must hold."""

    def __init__(self) -> None:
        self.missed: list[str] = []

    def check(self, what: str, holds: bool) -> None:
        """Print one claim and remember it where it does not hold."""
        print(f"  {'holds ' if holds else 'MISSED'} {what}", flush=True)
        if not holds:
            self.missed.append(what)


def scheme(
    label: str, form: str, h: float, integrator: Integrator, projection: str = "none", **options
) -> Scheme:
    """A scheme, optimally scaled."""
    formulation = Formulation.parse(label)
    applied = formulation.applied(FORMS[form])
    return Scheme(
        integrator,
        applied,
        named_scaling("optimal", applied),
        h,
        formulation=formulation,
        projection=Projection.parse(projection),
        **options,
    )


@cache
def andrews() -> Problem:
    """Andrews' mechanism."""
    return problem("andrews")


@cache
def reference() -> np.ndarray:
    """λ of Andrews' mechanism at the end."""
    return solution(andrews(), END).multipliers


def errors(*arguments, hs=STEPS, **options) -> list[float]:
    """Relative errors of λ at the end, one for each step size."""
    label, form, integrator, *rest = arguments
    found = []
    begun = time.perf_counter()
    for h in hs:
        march = March(andrews(), scheme(label, form, h, integrator, *rest, **options))
        for _ in march.stretches(round(END / h)):
            pass
        found.append(relative_error(march.multipliers, reference()))
    extras = " ".join(map(str, (*rest, *options.values())))
    shown = "  ".join(f"{error:.1e}" for error in found)
    print(
        f"{label:20} {form:10} {integrator.label[:26]:27} {extras:24} {shown}"
        f"   {time.perf_counter() - begun:4.0f} s",
        flush=True,
    )
    return found


def on_andrews(claims: Claims) -> None:
    """Errors of λ on Andrews' mechanism."""
    print("Andrews, t = 0.03, relative error of λ at h = 1e-4, 1e-5, 1e-6, 1e-7")
    for integrator in (TRAPEZOIDAL, DAMPED):
        for label in ("ggl", "index-2", "index-1"):
            found = errors(label, "a-lambda", integrator)
            mean = float(np.log10(found[0] / found[2]) / 2)
            claims.check(
                f"{label}, {integrator.label}: order 2 ± 0.15 ({mean:.2f})", abs(mean - 2) <= 0.15
            )
            claims.check(
                f"{label}, {integrator.label}: below 5e-9 at 1e-7 ({found[3]:.1e})",
                found[3] < 5e-9,
            )
        for label in ("baumgarte rate_h=1", "baumgarte rate=1000", "augmented-lagrangian"):
            errors(label, "a-lambda", integrator, hs=STEPS[:3])
    newton = errors("index-3", "u-lambda", DAMPED)
    recovered = errors("index-3", "u-lambda", DAMPED, reported="recovered")
    claims.check(f"Newton's λ above 1e-6 at 1e-7 ({newton[3]:.1e})", newton[3] > 1e-6)
    claims.check(f"recovered λ below 1e-8 at 1e-7 ({recovered[3]:.1e})", recovered[3] < 1e-8)

    plain = errors("index-3", "a-lambda", TRAPEZOIDAL, hs=STEPS[:3])
    projected = errors(
        "index-3", "a-lambda", TRAPEZOIDAL, "velocity", hs=STEPS[:3], reported="recovered"
    )
    claims.check(f"trapezoidal λ above 10 at 1e-6 ({plain[2]:.1e})", plain[2] > 10)
    claims.check(
        f"projected, recovered λ below 1e-6 at 1e-6 ({projected[2]:.1e})", projected[2] < 1e-6
    )
    for projection in ("velocity", "velocity accelerations", "position-velocity accelerations"):
        for integrator in (TRAPEZOIDAL, DAMPED):
            found = errors(
                "index-3", "a-lambda", integrator, projection, hs=STEPS[:3], reported="recovered"
            )
            mean = float(np.log10(found[0] / found[2]) / 2)
            claims.check(
                f"{projection}, {integrator.label}: recovered λ of order 2 ± 0.15 ({mean:.2f})",
                abs(mean - 2) <= 0.15,
            )


@cache
def thrown() -> Problem:
    """The pendulum thrown from the horizontal."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "thrown.yaml"
        path.write_text(THROWN)
        return loading.load(path, "thrown")


@cache
def angle(t: float) -> float:
    """λ = y − |v|² of the thrown pendulum, from its angle."""
    found = solve_ivp(
        lambda _, y: [y[1], -np.cos(y[0])], (0, t), [0.0, 1.0], "DOP853", rtol=3e-14, atol=1e-15
    )
    y, rate = np.sin(found.y[0, -1]), found.y[1, -1]
    return float(y - rate**2)


def on_the_thrown_pendulum(claims: Claims) -> None:
    """A motion with Gᵀu‴₀ = 3: the trapezoidal rule's λ is off by 3 (t/3) / (GᵀM⁻¹G)."""
    print("Thrown pendulum, trapezoidal: |error of λ| and the prediction t Gᵀu‴₀/3 = t")
    for t in (0.1, 0.2, 0.5):
        found = []
        for h in (1e-2, 1e-3):
            march = March(thrown(), scheme("index-3", "u-lambda", h, TRAPEZOIDAL))
            march.advance(round(t / h))
            found.append(abs(march.multipliers[0] - angle(t)))
        print(f"  t = {t}: h = 1e-2: {found[0]:.4f}, h = 1e-3: {found[1]:.4f}")
        claims.check(
            f"within 20 % of {t} at h = 1e-2 and 1e-3",
            all(abs(error - t) <= 0.2 * t for error in found),
        )
    steps = (4e-3, 2e-3, 1e-3, 5e-4)
    found = []
    for h in steps:
        how = scheme("index-3", "u-lambda", h, TRAPEZOIDAL, start=CORRECTED, evaluation=COMPENSATED)
        march = March(thrown(), how)
        march.advance(round(1 / h))
        found.append(abs(march.multipliers[0] - angle(1.0)))
    print("  corrected start, compensated, t = 1:", "  ".join(f"{e:.1e}" for e in found))
    mean = float(np.log(found[0] / found[-1]) / np.log(steps[0] / steps[-1]))
    claims.check(f"corrected start, compensated: order 2 ± 0.15 ({mean:.2f})", abs(mean - 2) < 0.15)


def main() -> None:
    """Print all, exit with 1 when something does not hold."""
    claims = Claims()
    on_the_thrown_pendulum(claims)
    on_andrews(claims)
    print(f"{len(claims.missed)} claims missed")
    sys.exit(1 if claims.missed else 0)


if __name__ == "__main__":
    main()
