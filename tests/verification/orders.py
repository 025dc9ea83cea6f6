"""Predicted against measured orders on many random systems.

Every block of J, J⁻¹ and of the scaled matrices, the residual's perturbation,
the corrections and the condition numbers, for all forms and variants, at
h = 1e-20 and 1e-22 in 240 digits; and the same for every formulation in exact arithmetic.

    python tests/verification/orders.py --systems 2000 --formulated 100 --seed 0
"""

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import exact_orders
from high_precision import Array, Factors, Measured, System, measure_all, mpf

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.orders import FormOrders, derive_scaling, form_orders
from newmark_cli.newmark.scaling import VARIANTS, Scaling, named_scaling

#: Share of the systems without damping, and, independently, without X.
ABSENT = 0.2
_SHOWN = 20


def random_system(rng: random.Random) -> System:
    """A system in whole numbers and in general position."""
    while True:
        n = rng.randint(2, 6)
        m = rng.randint(1, n - 1)

        def matrix(columns: int, present: bool = True, n: int = n) -> list[list[int]]:
            span = 3 if present else 0
            return [[rng.randint(-span, span) for _ in range(columns)] for _ in range(n)]

        root = np.array(matrix(n))
        damped, stiff = rng.random() >= ABSENT, rng.random() >= ABSENT
        system = System.of(
            M=(root @ root.T + np.eye(n, dtype=int)).tolist(),
            X=matrix(n, stiff),
            Y=matrix(n, damped),
            G=matrix(m),
            beta=rng.randint(4, 16) / 16,
            gamma=rng.randint(8, 16) / 16,
        )
        if system.in_general_position():
            return system


def factors(scaling: Scaling, form: str, system: System) -> Factors:
    def numbers(values: Mapping[str, mpf]) -> tuple[Sequence[mpf], Sequence[mpf]]:
        return (
            [mpf(scaling.left[row](values)) for row in FORMS[form].rows],
            [mpf(scaling.right[unknown](values)) for unknown in FORMS[form].unknowns],
        )

    return Factors.of(numbers, system)


def pairs(
    form: str, orders: FormOrders, measured: Measured, system: System
) -> Iterator[tuple[str, Array, Array]]:
    """What is compared: label, predicted, measured."""
    yield f"{form}: W", orders.weights, measured.weights
    yield f"{form}: J", orders.jacobian, measured.jacobian
    yield f"{form}: inverse", orders.inverse, measured.inverse
    yield f"{form}: residual", orders.residual, measured.residual
    physical = np.array(list(orders.physical_corrections().values()))
    yield f"{form}: physical corrections", physical, measured.physical_corrections()
    for variant in VARIANTS:
        scaling = named_scaling(variant, FORMS[form])
        numbers = factors(scaling, form, system)
        label = f"{form}, {variant}"
        expected = orders.scaled(scaling)
        found = measured.scaled(numbers)
        yield f"{label}: J", expected[0], found[0]
        yield f"{label}: inverse", expected[1], found[1]
        corrections = np.array(list(orders.corrections(scaling).values()))
        yield f"{label}: corrections", corrections, measured.corrections(numbers)
        condition = np.array([orders.condition(scaling)])
        yield f"{label}: condition", condition, np.array([measured.condition(numbers)])


def formulated_pairs(rng: random.Random) -> Iterator[tuple[str, Array, Array]]:
    """What is compared of every formulation and form on one random system."""
    damped, stiff = rng.random() >= ABSENT, rng.random() >= ABSENT
    # With P = M⁻¹G single blocks are smaller: tests/test_formulation_orders.py has those.
    system = exact_orders.random_system(rng, damped, stiff, by_mass=False)
    for formulation in exact_orders.CONSTRAINTS:
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
                yield (
                    f"{label}: residual",
                    orders.residual,
                    np.array([residual[row] for row in form.rows]),
                )
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", type=int, default=2000, help="number of random systems")
    parser.add_argument(
        "--formulated", type=int, default=100, help="number of those for formulations"
    )
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()

    rng = random.Random(arguments.seed)
    start = time.perf_counter()
    compared = compared_formulated = wrong = 0
    kinds: Counter[str] = Counter()
    for index in range(arguments.systems):
        system = random_system(rng)
        kinds[
            f"X {'present' if system.stiff else '0'}, Y {'present' if system.damped else '0'}"
        ] += 1
        for form, measured in measure_all(system).items():
            orders = form_orders(FORMS[form], damped=system.damped, stiff=system.stiff)
            for label, expected, found in pairs(form, orders, measured, system):
                # A slope that is not whole is left as it is and differs.
                differ = int(np.sum(expected != found))
                compared += expected.size
                wrong += differ
                if differ and wrong <= _SHOWN:
                    print(f"system {index}, {label}:\npredicted\n{expected}\nmeasured\n{found}")
    for index in range(arguments.formulated):
        for label, expected, found in formulated_pairs(rng):
            differ = int(np.sum(expected != found))
            compared_formulated += expected.size
            wrong += differ
            if differ and wrong <= _SHOWN:
                print(f"system {index}, {label}:\npredicted\n{expected}\nmeasured\n{found}")
    print(f"systems        {arguments.systems} (seed {arguments.seed})")
    for kind, count in sorted(kinds.items(), reverse=True):
        print(f"  {kind:<22} {count}")
    print(f"comparisons    {compared}")
    print(f"of formulations on {arguments.formulated} systems  {compared_formulated}")
    print(f"disagreements  {wrong}")
    print(f"time           {time.perf_counter() - start:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
