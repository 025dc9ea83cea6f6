"""Labels of integrators, as CSVs have them and as people write them."""

import re

from newmark_cli.newmark import own_integrator
from newmark_cli.newmark.integrator import (
    INTEGRATORS,
    TRAPEZOIDAL_NAME,
    Integrator,
    IntegratorError,
    Newmark,
    parameters,
)
from newmark_cli.support.spelling import nearest

#: Letters and words of legends, such as generalized-α (ρ∞ = 0.9), as labels have them.
_IN_LABELS = {"ρ∞": "rho", "α": "alpha", "β": "beta", "γ": "gamma", "−": "-", " = ": "=",
            "(": "", ")": "", ",": ""}  # fmt: skip


def plain_label(text: str) -> str:
    """A label from what tables and legends print of it; other text stays as it is."""
    try:
        return parse(text).label
    except IntegratorError:
        return text


def parse(label: str) -> Integrator:
    """Read a `label`, or what tables and legends print of it.

    Raises:
        IntegratorError: If the label is not valid.
    """
    if label == TRAPEZOIDAL_NAME:
        return Newmark()
    name, *rest = re.split(r" (?=\()", label, maxsplit=1)
    if ".py:" in name:
        return own_integrator.read(label)
    plain = " ".join([name.casefold(), *rest])
    for theirs, ours in _IN_LABELS.items():
        plain = plain.replace(theirs, ours)
    method, *arguments = plain.split(" ")
    if method not in INTEGRATORS:
        raise IntegratorError(f"unknown integrator {label!r}{nearest(method, INTEGRATORS)}")
    pairs = [part.partition("=") for part in arguments]
    try:
        values = [float(value) for _, _, value in pairs]
    except ValueError:
        raise IntegratorError(f"integrator {label!r}: parameters must be numbers") from None
    if tuple(name for name, _, _ in pairs) != parameters(method):
        names = ", ".join(parameters(method)) or "none"
        raise IntegratorError(f"integrator {label!r}: its parameters are {names}")
    return INTEGRATORS[method](*values)
