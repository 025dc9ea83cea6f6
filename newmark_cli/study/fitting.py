"""What fits what: values of a cell, or of a march, that contradict its problem or each other.

Configs and the library ask here, and word nothing themselves.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import CORRECTED, TOTAL, is_formulated
from newmark_cli.newmark.integrator import is_trapezoidal
from newmark_cli.newmark.linear.choice import DENSE, STATIC, choose, not_static
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.problems.problem import Problem

#: Key, and why its value does not fit.
Misfit = tuple[str, str]


def of_each_other(at: Mapping[str, Any]) -> Iterator[Misfit]:
    """Values of integrator, projection, multipliers and start that do not fit each other."""
    if at["multipliers"] == TOTAL and not at["projection"].level:
        yield "multipliers", f"{TOTAL} needs a projection of velocities"
    if at["start"] == CORRECTED and not is_trapezoidal(at["integrator"]):
        yield (
            "start",
            f"{CORRECTED} is of the trapezoidal rule; {at['integrator'].label} needs no such "
            "correction, or another",
        )


def of_problem(counted: Any, sample: Problem, at: Mapping[str, Any]) -> Iterator[Misfit]:
    """Values of form, formulation, projection and so on that do not fit a problem.

    The sample is the problem, or a small one that is quadratic and single where it is.
    """
    if at["evaluation"] == COMPENSATED and not sample.quadratic:
        yield (
            "evaluation",
            f"compensated needs constraints that are quadratic in u and do not depend on time; "
            f"those of {counted.name} are not, or not declared so",
        )
    formulated = is_formulated(at["formulation"], at["projection"])
    if at["linear_solver"] == STATIC and (why := not_static(counted, formulated)):
        yield "linear_solver", why
        return
    if at["precision"] == "float64":
        return
    if not sample.single:
        yield "precision", f"{counted.name} is computed in float64 only"
    form = at["formulation"].applied(FORMS[at["form"]])
    if choose(at["linear_solver"], counted, form, formulated, at["precision"]) != DENSE:
        yield ("precision", f"{at['precision']} needs {DENSE}: {counted.name}, {form.described}")
