"""Time per step of every formulation and projection over that of index 3.

Andrews' mechanism, dense kernel, generalized-α with ρ∞ = 0.9, optimal scaling, h = 1e-5, from
the same start.  All are marched in turn in one process, so that other users of the machine
slow all alike; ratios are medians over the rounds.  Prints a Markdown table.

    python benchmarks/formulations.py
"""

import argparse
import time

import numpy as np

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT, Scheme

SUBJECT = problem("andrews")
H = 1e-5
REFERENCE = ("index-3", "none", "a-lambda", DIRECT)
FORMULATIONS = (
    "index-3",
    "index-2",
    "index-1",
    "baumgarte rate=1000",
    "baumgarte rate_h=1",
    "ggl",
    "augmented-lagrangian factor=10",
)
#: Forms in the table.
SHOWN = ("a-lambda", "u-lambda", "u-v-a-lambda")
CASES = [
    *((label, "none", form, DIRECT) for label in FORMULATIONS for form in SHOWN),
    ("index-3", "velocity", "a-lambda", DIRECT),
    ("index-3", "velocity accelerations", "a-lambda", DIRECT),
    ("index-3", "position-velocity accelerations", "a-lambda", DIRECT),
    *((label, "none", "a-lambda", COMPENSATED) for label in FORMULATIONS),
]


def scheme(case: tuple[str, str, str, str]) -> Scheme:
    """The scheme of one case."""
    label, projection, form, evaluation = case
    formulation = Formulation.parse(label)
    applied = formulation.applied(FORMS[form])
    return Scheme(
        GeneralizedAlpha(0.9),
        applied,
        named_scaling("optimal", applied),
        H,
        evaluation=evaluation,
        formulation=formulation,
        projection=Projection.parse(projection),
    )


def timed(how: Scheme, steps: int) -> tuple[float, float]:
    """Seconds a step, and corrections a step."""
    march = March(SUBJECT, how)
    begun = time.perf_counter()
    stretch = march.advance(steps)
    return (time.perf_counter() - begun) / steps, float(np.abs(stretch.iterations).mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    schemes = {case: scheme(case) for case in CASES}
    for how in schemes.values():
        timed(how, 2)
    ratios: dict[tuple[str, str, str, str], list[float]] = {case: [] for case in CASES}
    corrections = {}
    for _ in range(options.rounds):
        for case, how in schemes.items():
            # Next to its own reference, so that both see the same machine.
            reference, _ = timed(schemes[REFERENCE], options.steps)
            seconds, corrections[case] = timed(how, options.steps)
            ratios[case].append(seconds / reference)
    base = corrections[REFERENCE]
    heads = ("formulation", "projection", "form", "evaluation", "corrections a step")
    print(f"| {' | '.join((*heads, 'time a step', 'time a correction'))} |\n" + "|---" * 7 + "|")
    for case in CASES:
        ratio = float(np.median(ratios[case]))
        each = ratio * base / corrections[case]
        cells = (*case, f"{corrections[case]:.1f}", f"{ratio:.2f}", f"{each:.2f}")
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
