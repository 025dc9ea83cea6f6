"""Floors of Newton's corrections for notebooks: predicted from single steps."""

from typing import Any

import numpy as np

from newmark_cli.advice.linearised import require_fit, subject_of
from newmark_cli.library import arguments
from newmark_cli.library.scalings import integrator_or_newmark, scheme_of
from newmark_cli.newmark.floor import Floor, unpredicted
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.scheme import DIRECT
from newmark_cli.support.errors import ArgumentError


@arguments.scaling_by_either_name
def floor(
    subject: Any,
    *,
    h: float,
    form: str = "u-lambda",
    beta: float | None = None,
    gamma: float | None = None,
    integrator: Any = None,
    formulation: Any = INDEX_3,
    evaluation: str = DIRECT,
    precision: str = "float64",
    scaling: Any = "optimal",
    t_end: float | None = None,
) -> Floor:
    """How small Newton's corrections can become: their expected rms, from rounding only.

    Args:
        subject: What `problem` takes, or matrices at one state, as `advise` takes them.
        h: Step size (s).
        form: Name of a form, such as ``"v-lambda"``.
        beta: Parameter of Newmark's scheme; 1/4 when omitted.
        gamma: Parameter of Newmark's scheme; 1/2 when omitted.
        integrator: An integrator in place of β and γ, as `march` takes it.
        formulation: As of `march`.
        evaluation: As of `march`.
        precision: As of `march`.
        scaling: As of `march`.
        t_end: Time until which a problem's motion is looked at (s); a time in which it moves
            by about its own size when omitted.

    Returns:
        For each unknown the rms of the 2-norm of its last correction over a few states,
        scaled and physical, and the share of corrections that are exactly zero; NaN where a
        step does not converge.  See docs/theory.md.

    Raises:
        ArgumentError: For an argument of the wrong type, size or name, and for a scheme
            of which no floor is predicted.
        ProblemError, DocumentError, NewmarkError: When the subject cannot be used.
        IntegratorError, FormulationError, ScalingError: For parameters that give no scheme.

    Examples:
        >>> import newmark_cli as newmark
        >>> found = newmark.floor("andrews", h=1e-5)
        >>> found.physical["u"] < 1e-17, 3e-7 < found.physical["lambda"] < 1e-6
        (True, True)
    """
    step = arguments.step_size(h)
    method = integrator_or_newmark(beta, gamma, integrator)
    scheme = scheme_of(
        form, method, formulation, scaling, step, evaluation=evaluation, precision=precision
    )
    chosen = scheme.formulation
    if reason := unpredicted(scheme):
        raise ArgumentError(f"formulation {chosen.label}: {reason}")
    about = subject_of(subject, None if t_end is None else arguments.positive("t_end", t_end))
    require_fit(about, chosen, evaluation)
    floors = about.floors(scheme)
    if not floors:
        raise ArgumentError(f"{about.problem.name}: a floor needs a state: u, v, a, lambda")
    means = {
        kind: {
            unknown: float(np.sqrt(np.mean([getattr(at, kind)[unknown] ** 2 for at in floors])))
            for unknown in floors[0].scaled
        }
        for kind in ("scaled", "physical")
    }
    zeros = {name: float(np.mean([at.zeros[name] for at in floors])) for name in floors[0].zeros}
    return Floor(means["scaled"], means["physical"], zeros)
