"""newmark-study itself, in (a, λ), with the integrators and step sizes of the other codes.

Twins start one unit in the last place away: what lies between them is rounding.
"""

from functools import partial

from common import STEPS, Result, Run, main

import newmark_cli as newmark

DAMPED, TRAPEZOIDAL = "generalized-alpha rho=0.9", "newmark"
SERIES = {  # label → integrator, formulation, evaluation
    "newmark-study, generalized-α 0.9, index 3": (DAMPED, "index-3", "direct"),
    "newmark-study, trapezoidal, index 3": (TRAPEZOIDAL, "index-3", "direct"),
    "newmark-study, trapezoidal, index 2": (TRAPEZOIDAL, "index-2", "direct"),
    "newmark-study, generalized-α 0.9, index 3, compensated": (DAMPED, "index-3", "compensated"),
}
TWINS = 3
CHEAP = tuple(SERIES)[:2]  # they march a million steps in a second


def march(problem, t_end, h, label, integrator, formulation, evaluation):
    found = newmark.march(
        problem, h=h, t_end=t_end, form="a-lambda", integrator=integrator,
        formulation=formulation, evaluation=evaluation, every=0, twins=TWINS,
    )  # fmt: skip
    each = {label: found} | {f"{label}, twin {k}": one for k, one in enumerate(found.twins, 1)}
    return {name: result(one, round(t_end / h)) for name, one in each.items()}


def result(found, steps):
    message = "" if found.status == "ok" else found.status
    return Result(found.u[-1], found.v[-1], found.multipliers[-1], None, steps, message)


def runs(name, problem, t_end):
    for label, how in SERIES.items():
        march(problem, 2 * STEPS[name][-1], STEPS[name][-1], label, *how)  # compiled before runs
        for h in STEPS[name]:
            if label not in CHEAP and t_end / h > 1e6:
                continue
            yield Run(label, "h", h, partial(march, problem, t_end, h, label, *how))


if __name__ == "__main__":
    main(runs)
