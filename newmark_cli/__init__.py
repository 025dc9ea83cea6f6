"""Newmark/Newton studies of index-3 multibody DAEs at small step sizes.

The Python library: ``import newmark_cli as newmark``, see docs/python.md.  The names in
``__all__`` are public; everything else may change without notice.  The names are imported
when they are first used, because NumPy, SciPy and the compiler take their time.
"""

from __future__ import annotations

__version__ = "0.2.0"

# That of `typing`, which the console script would have to import before it answers signals.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from newmark_cli.advice.advising import Advice, advise
    from newmark_cli.advice.floors import floor
    from newmark_cli.advice.jacobians import JacobianAdvice, advise_jacobian
    from newmark_cli.library.finding import dae, problem
    from newmark_cli.library.judging import Judged, judge
    from newmark_cli.library.marching import march, steps
    from newmark_cli.library.scalings import Factors, scaling
    from newmark_cli.library.stepping import Steps
    from newmark_cli.library.studies import plot, run, slopes, trajectories
    from newmark_cli.library.systems import linear_systems
    from newmark_cli.newmark.floor import Floor
    from newmark_cli.newmark.formulation import FormulationError
    from newmark_cli.newmark.integrator import IntegratorError
    from newmark_cli.newmark.newton_systems import NewtonSystem
    from newmark_cli.newmark.scaling import ScalingError
    from newmark_cli.newmark.trajectory import Step, Trajectory
    from newmark_cli.problems.problem import Problem, ProblemError
    from newmark_cli.problems.python_problem import Definition
    from newmark_cli.problems.residual_form import Dae
    from newmark_cli.support.documents import DocumentError
    from newmark_cli.support.errors import ArgumentError, InputError, NewmarkError, NewmarkWarning

#: Public name → module that it comes from.
_HOMES = {
    "Advice": "advice.advising",
    "ArgumentError": "support.errors",
    "Dae": "problems.residual_form",
    "Definition": "problems.python_problem",
    "DocumentError": "support.documents",
    "Factors": "library.scalings",
    "Floor": "newmark.floor",
    "FormulationError": "newmark.formulation",
    "InputError": "support.errors",
    "IntegratorError": "newmark.integrator",
    "JacobianAdvice": "advice.jacobians",
    "Judged": "library.judging",
    "NewmarkError": "support.errors",
    "NewmarkWarning": "support.errors",
    "NewtonSystem": "newmark.newton_systems",
    "Problem": "problems.problem",
    "ProblemError": "problems.problem",
    "ScalingError": "newmark.scaling",
    "Step": "newmark.trajectory",
    "Steps": "library.stepping",
    "Trajectory": "newmark.trajectory",
    "advise": "advice.advising",
    "advise_jacobian": "advice.jacobians",
    "dae": "library.finding",
    "floor": "advice.floors",
    "judge": "library.judging",
    "linear_systems": "library.systems",
    "march": "library.marching",
    "plot": "library.studies",
    "problem": "library.finding",
    "run": "library.studies",
    "scaling": "library.scalings",
    "slopes": "library.studies",
    "steps": "library.marching",
    "trajectories": "library.studies",
}

__all__ = [
    "Advice",
    "ArgumentError",
    "Dae",
    "Definition",
    "DocumentError",
    "Factors",
    "Floor",
    "FormulationError",
    "InputError",
    "IntegratorError",
    "JacobianAdvice",
    "Judged",
    "NewmarkError",
    "NewmarkWarning",
    "NewtonSystem",
    "Problem",
    "ProblemError",
    "ScalingError",
    "Step",
    "Steps",
    "Trajectory",
    "__version__",
    "advise",
    "advise_jacobian",
    "dae",
    "floor",
    "judge",
    "linear_systems",
    "march",
    "plot",
    "problem",
    "run",
    "scaling",
    "slopes",
    "steps",
    "trajectories",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        from newmark_cli.support.retired import RETIRED

        gone = f"; it is gone: {RETIRED[name][1]}" if name in RETIRED else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{gone}")
    from importlib import import_module

    found = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
