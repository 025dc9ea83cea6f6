"""Predicted against exact orders on random systems and on the shipped problems.

Every block of J and J⁻¹, the residual's perturbation, the corrections and the condition
numbers, for all forms and variants: of every formulation on random systems, and of index 3
on the shipped problems at their start.

    python tests/verification/orders.py --systems 100 --seed 0
"""

import argparse
import random
import sys
import time
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import exact_orders
from exact_orders import Number
from marching import start

from newmark_cli.mechanisms.registry import SHIPPED, problem
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.scaling import VARIANTS, named_scaling

#: Share of the systems without damping, and, independently, without X.
ABSENT = 0.2
_SHOWN = 20

Pairs = Iterator[tuple[str, np.ndarray, np.ndarray]]


def pairs(
    system: exact_orders.System, formulation: str, damped: bool, stiff: bool, rng: random.Random
) -> Pairs:
    """What is compared of every form: label, predicted, measured."""
    for name in FORMS:
        form = Formulation.parse(formulation).applied(FORMS[name])
        measured = exact_orders.Measured(system, name, formulation)
        label = f"{formulation}, {name}"
        for compensated in (False, True):
            orders = form_orders(form, damped, stiff, compensated)
            found = measured.corrections(rng, compensated)
            physical = orders.physical_corrections()
            expected = np.array([physical[unknown] for unknown in found])
            yield f"{label}: corrections", expected, np.array(list(found.values()))
            residual = measured.residual(compensated)
            sizes = np.array([residual[row] for row in form.rows])
            yield f"{label}: residual", orders.residual, sizes
        yield f"{label}: J", orders.jacobian, measured.jacobian
        yield f"{label}: inverse", orders.inverse, measured.inverse
        for variant in VARIANTS:
            scaling = named_scaling(variant, form)
            sides = (
                {block: factor.order() for block, factor in side.items()}
                for side in (scaling.left, scaling.right)
            )
            condition = np.array([orders.condition(scaling)])
            yield f"{label}, {variant}", condition, np.array([measured.condition(*sides)])
        derived = measured.condition(*derive_scaling(orders))
        yield f"{label}, derived", np.zeros(1), np.array([derived])


def random_pairs(rng: random.Random) -> Pairs:
    """What is compared of every formulation on one random system."""
    damped, stiff = rng.random() >= ABSENT, rng.random() >= ABSENT
    # With P = M⁻¹G single blocks are smaller: tests/newmark/test_formulation_orders.py has those.
    system = exact_orders.random_system(rng, damped, stiff, by_mass=False)
    for formulation in exact_orders.CONSTRAINTS:
        yield from pairs(system, formulation, damped, stiff, rng)


def shipped_pairs(name: str, rng: random.Random) -> Pairs:
    """What is compared of a shipped problem at its start; its numbers are fractions."""
    subject = problem(name)
    state = start(subject)
    terms = subject.evaluate(subject.t0, state.fields[0], state.fields[1], state.multipliers)

    def exact(matrix: np.ndarray) -> np.ndarray:
        fractions = [[Fraction(float(x)) for x in row] for row in matrix]
        return np.array(
            [[Number.of(x.numerator) / Number.of(x.denominator) for x in r] for r in fractions]
        )

    other = exact_orders.random_system(rng)
    X, Y, G = exact(terms.X), exact(terms.Y), exact(terms.G)
    system = exact_orders.System(
        M=exact(subject.M), X=X, Y=Y, G=G, P=G, A=G.T, Q=G.T,
        beta=other.beta, gamma=other.gamma, c=other.c,
    )  # fmt: skip
    damped, stiff = bool(np.any(terms.Y)), bool(np.any(terms.X))
    yield from pairs(system, "index-3", damped, stiff, rng)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", type=int, default=100, help="number of random systems")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    begin = time.perf_counter()
    small = [name for name in SHIPPED if problem(name).n + problem(name).m <= 30]
    compared = wrong = 0
    for subject in (*range(arguments.systems), *small):
        found = random_pairs(rng) if isinstance(subject, int) else shipped_pairs(subject, rng)
        for label, expected, measured in found:
            differ = int(np.sum(expected != measured))
            compared += expected.size
            wrong += differ
            if differ and wrong <= _SHOWN:
                print(f"system {subject}, {label}:\npredicted\n{expected}\nmeasured\n{measured}")
    print(f"systems        {arguments.systems} (seed {arguments.seed}), {', '.join(small)}")
    print(f"comparisons    {compared}")
    print(f"disagreements  {wrong}")
    print(f"time           {time.perf_counter() - begin:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
