"""Scalings for notebooks: the factors of Table 2 as text and as numbers."""

import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from newmark_cli.library import arguments
from newmark_cli.newmark import own_integrator
from newmark_cli.newmark.forms import FORMS, INDEX_3
from newmark_cli.newmark.formulation import REPORTED, Formulation, FormulationError, Projection
from newmark_cli.newmark.integrator import Integrator, Newmark
from newmark_cli.newmark.integrator_labels import parse
from newmark_cli.newmark.kept import KEPT
from newmark_cli.newmark.linear.choice import AUTO, Krylov
from newmark_cli.newmark.scaling import VARIANTS, Preconditioning
from newmark_cli.newmark.scheme import Scheme, Tolerance
from newmark_cli.newmark.steps import StepSequence
from newmark_cli.study import axes, keys
from newmark_cli.support.documents import DocumentError
from newmark_cli.support.errors import ArgumentError

_Reader = Callable[[str, Any], Any]

#: Largest β and γ, and the reciprocal of the smallest.
_FARTHEST = 1e12


@dataclass(frozen=True)
class Factors:
    """Factors of a form's equations and unknowns: (D_L J D_R) q̄ = −D_L b, eq. 9.

    Attributes:
        form: Name of the form.
        left_formulas: Row block (D, V, K, C … that the form has) → factor as text.
        right_formulas: Unknown (u, v, a, lambda, eta that the form has) → likewise.
        left, right: The same as numbers at the step size.
        formulation: Label of the formulation; others than index 3 have rows Cv, Ca or B,
            and unknown eta.

    Examples:
        >>> import newmark_cli as newmark
        >>> factors = newmark.scaling("u-lambda", h=1e-3)
        >>> factors.rows, factors.unknowns
        (('D', 'C'), ('u', 'lambda'))
        >>> factors.left_formulas["D"], factors.left["D"]
        ('beta*h^2', 2.5e-07)
    """

    form: str
    left_formulas: Mapping[str, str]
    right_formulas: Mapping[str, str]
    left: Mapping[str, float]
    right: Mapping[str, float]
    formulation: str = INDEX_3

    @property
    def rows(self) -> tuple[str, ...]:
        """Row blocks of the form."""
        return tuple(self.left)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Unknowns of the form."""
        return tuple(self.right)


@arguments.scaling_by_either_name
def scaling(
    form: str,
    *,
    h: float,
    beta: float | None = None,
    gamma: float | None = None,
    integrator: Any = None,
    scaling: Any = "optimal",
    formulation: Any = INDEX_3,
) -> Factors:
    """The scaling of a form: Table 2 of the paper, or one of your own, in numbers.

    Args:
        form: Name of a form, such as ``"v-lambda"``.
        h: Step size (s).
        beta: Parameter of Newmark's scheme; 1/4 when omitted.
        gamma: Parameter of Newmark's scheme; 1/2 when omitted.
        integrator: An integrator in place of β and γ, as `march` takes it; its β and γ are then
            those of ∂u/∂v' = β h² and ∂v/∂v' = γ h.
        scaling: As of `march`; ``preconditioning`` is the same argument.
        formulation: As of `march`: its rows and unknowns are scaled by the rule of Table 2.

    Returns:
        Factors of each row block and unknown, as text and as numbers.

    Raises:
        ArgumentError: For an unknown form or variant, or a step size that is not positive.
        IntegratorError: For β, γ that give no usable scheme.
        DocumentError, ScalingError: If a scaling of your own cannot be used.

    Examples:
        >>> import newmark_cli as newmark
        >>> factors = newmark.scaling("v-lambda", beta=0.3025, gamma=0.6, h=1e-2)
        >>> dict(factors.left_formulas), dict(factors.right_formulas)
        ({'D': 'gamma*h^2', 'C': '1'}, {'v': '1/(gamma*h)', 'lambda': '1/(beta*h^2)'})
        >>> round(factors.right["lambda"], 3)
        33057.851
        >>> newmark.scaling("a-lambda", h=1e-3, formulation="ggl").left_formulas["Cv"]
        'beta*h/gamma'
    """
    formulated = read("formulation", formulation).applied(FORMS[read("form", form)])
    h = arguments.positive("h", h, " of seconds")
    method = integrator_or_newmark(beta, gamma, integrator)
    chosen = read("scaling", scaling).scaling(formulated)
    symbols = method.symbols(h)
    try:
        left, right = (
            {block: factor(symbols) for block, factor in side.items()}
            for side in (chosen.left, chosen.right)
        )
    except ArithmeticError:
        raise ArgumentError(f"h is too large or too small, given {h:g}") from None
    return Factors(
        form,
        {block: str(factor) for block, factor in chosen.left.items()},
        {block: str(factor) for block, factor in chosen.right.items()},
        left,
        right,
        formulated.formulation,
    )


def integrator_or_newmark(beta: float | None, gamma: float | None, integrator: Any) -> Integrator:
    """An integrator as `march` takes it, or Newmark's with β and γ.

    Raises:
        ArgumentError: For β and γ of which factors of a scaling would overflow, too.
    """
    if integrator is None:
        method: Integrator = Newmark(
            0.25 if beta is None else arguments.number("beta", beta),
            0.5 if gamma is None else arguments.number("gamma", gamma),
        )
    elif beta is not None or gamma is not None:
        raise ArgumentError("give either an integrator or beta and gamma, not both")
    else:
        method = read("integrator", integrator)
    for name, value in method.symbols(1.0).items():
        if not 1 / _FARTHEST <= value <= _FARTHEST:
            raise ArgumentError(
                f"{name} must be between {1 / _FARTHEST:g} and {_FARTHEST:g} where factors are "
                f"computed, given {value:g}"
            )
    return method


def _named(allowed: Collection[str]) -> _Reader:
    return lambda name, value: arguments.one_of(name, value, allowed)


def _by_model(model: type[keys.Valued], core: Any) -> _Reader:
    """Reads what a config may give, by the model of its key; values of the core pass."""

    def read_by_model(name: str, value: Any) -> Any:
        if isinstance(value, core):
            return value
        try:
            return keys.read(name, value, model)
        except DocumentError as error:
            if isinstance(value, Mapping) or (isinstance(value, str) and name == "integrator"):
                raise
            kind = FormulationError if isinstance(value, str) else ArgumentError
            raise kind(str(error)) from None

    return read_by_model


_own_scaling = _by_model(keys.OwnScaling, Preconditioning)
_integrator_by_keys = _by_model(keys.IntegratorConfig, Integrator)


def _scaling(name: str, value: Any) -> Any:
    if isinstance(value, Preconditioning | Mapping):
        return _own_scaling(name, value)
    return Preconditioning(arguments.one_of(name, value, VARIANTS))


def _integrator(name: str, value: Any) -> Any:
    """An integrator, of a class of the caller's, too."""
    if hasattr(value, "relations") and not isinstance(value, Integrator):
        kind = value if isinstance(value, type) else type(value)
        file = Path(getattr(sys.modules.get(kind.__module__), "__file__", None) or "notebook.py")
        return own_integrator.of(f"{file.stem}.py:{kind.__name__}", value)
    own = of_label(value) if isinstance(value, str) else None
    return own or _integrator_by_keys(name, value)


def of_label(text: str) -> Integrator | None:
    """The integrator that results name by a label of a class; None for other text."""
    method, parts, _ = text.partition(" ")
    return parse(text) if parts and own_integrator.NAMED.fullmatch(method) else None


#: Arguments that are one of the names of an axis.
_NAMES = ("form", "evaluation", "precision", "start", "auxiliary", "linear_solver")
#: Argument of public functions → what reads it.
_READERS: Mapping[str, _Reader] = MappingProxyType(
    {
        **{name: _named(axes.named(name).names) for name in _NAMES},
        "multipliers": _named((AUTO, *REPORTED)),
        "iteration_cap": partial(arguments.count, least=1),
        "twins": arguments.count,
        "project": arguments.flag,
        "keep": partial(arguments.some_of, allowed=KEPT),
        "scaling": _scaling,
        "integrator": _integrator,
        "formulation": _by_model(keys.FormulationConfig, Formulation),
        "projection": _by_model(keys.ProjectionConfig, Projection),
        "stop": _by_model(keys.StopConfig, Tolerance | None),
        "krylov": _by_model(keys.KrylovConfig, Krylov | None),
        "h_sequence": _by_model(keys.SequenceConfig, StepSequence),
    }
)


def read(name: str, value: Any) -> Any:
    """An argument of `march` as the core takes it; raises `NewmarkError` for what it does not."""
    return _READERS[name](name, value) if name in _READERS else value


def scheme_of(
    form: Any, integrator: Any, formulation: Any, scaling: Any, h: float, **further: Any
) -> Scheme:
    """The scheme that arguments of `march` describe; further ones are attributes of its."""
    chosen = read("formulation", formulation)
    formulated = chosen.applied(FORMS[read("form", form)])
    attributes = {name: read(name, value) for name, value in further.items()}
    return Scheme(
        read("integrator", integrator),
        formulated,
        read("scaling", scaling).scaling(formulated),
        h,
        formulation=chosen,
        **attributes,
    )
