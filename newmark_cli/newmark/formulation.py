"""Formulations: which constraint rows stand in the system, and what else enforces them.

A row of constraints is a sum of Φ, its rate and its second derivative,

    s₀ Φ + s₁ (Gᵀv + Φ_t) + s₂ (Gᵀv' + κ),        κ = Φ'' at u'' = 0,

all at the end of the step, v' being the true acceleration.  A formulation is a short
list of such rows, with or without the multipliers η that let K keep a second one (Gear,
Leimkuhler & Gupta 1985), or no row at all and a penalty in D.  It is applied to a form,
which keeps and eliminates fields as before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from newmark_cli.newmark.forms import FORMS, INDEX_3, Form
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import InputError
from newmark_cli.support.spelling import nearest


class FormulationError(InputError):
    """A formulation or its parameter cannot be used; says which and why.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.march("pendulum", h=1e-3, t_end=0.1, formulation="index-4")
        Traceback (most recent call last):
        ...
        newmark_cli.newmark.formulation.FormulationError: formulation: unknown formulation ...
    """


@dataclass(frozen=True)
class Method:
    """A formulation without its parameter."""

    description: str  #: one line
    rows: tuple[str, ...]  #: rows of constraints in the system
    stabilised: bool = False  #: whether K carries Gη
    penalised: bool = False  #: whether D carries a penalty, and λ is updated instead of solved for
    #: name → what it means, its unit and default; a formulation takes one
    parameters: Mapping[str, str] = field(default_factory=dict)
    derivatives: int = 0  #: highest derivative of Φ in time whose tangents it needs


#: Formulations by name.
METHODS: Mapping[str, Method] = MappingProxyType(
    {
        INDEX_3: Method("the constraints themselves, as in the paper", ("C",)),
        "index-2": Method("their first derivative in their place", ("Cv",), derivatives=1),
        "index-1": Method("their second derivative in their place", ("Ca",), derivatives=2),
        "baumgarte": Method(
            "second derivative + 2α · first + α² · the constraints (Baumgarte 1972)",
            ("B",),
            parameters={
                "rate": "α (1/s), the same at every h; 1000 when none is given",
                "rate_h": "α h, so that α grows as h falls",
            },
            derivatives=2,
        ),
        "ggl": Method(
            "the constraints and their first derivative, with multipliers η in row K "
            "(Gear, Leimkuhler and Gupta 1985)",
            ("C", "Cv"),
            stabilised=True,
            derivatives=1,
        ),
        "augmented-lagrangian": Method(
            "no constraint rows: a penalty in row D, and λ updated in every iteration",
            (),
            penalised=True,
            parameters={
                "factor": "penalty over the inertia that the constraints move, "
                "p = factor · (∂v'/∂u)/σ, σ the least eigenvalue of GᵀM⁻¹G at the start; "
                "10 when none is given",
                "penalty": "p itself (N/m³ for a bar), the same at every h",
            },
        ),
    }
)
#: Parameter that a method has when none is given.
DEFAULTS = {"baumgarte": ("rate", 1e3), "augmented-lagrangian": ("factor", 10.0)}


@dataclass(frozen=True)
class Formulation:
    """A formulation with its parameter."""

    method: str = INDEX_3  #: one of `METHODS`
    parameter: tuple[str, float] | None = None  #: its name and value; the default when omitted

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise FormulationError(
                f"unknown formulation {self.method!r}{nearest(self.method, METHODS)}"
            )
        if self.parameter is None:
            object.__setattr__(self, "parameter", DEFAULTS.get(self.method))
            return
        name, value = self.parameter
        allowed = METHODS[self.method].parameters
        if name not in allowed:
            having = f"; it has {' or '.join(allowed)}" if allowed else "; it has none"
            raise FormulationError(f"formulation {self.method} has no {name!r}{having}")
        if not (np.isfinite(value) and value > 0):
            raise FormulationError(f"{self.method}: {name} = {value:g}: must be positive")

    @property
    def kind(self) -> Method:
        """Its kind, without the parameter."""
        return METHODS[self.method]

    @property
    def label(self) -> str:
        """How the CSV names it; `parse` reads it back."""
        if self.parameter is None:
            return self.method
        name, value = self.parameter
        return f"{self.method} {name}={float(value)!r}"

    @classmethod
    def parse(cls, label: str) -> "Formulation":
        """Read a `label`; a method alone has its default parameter."""
        method, _, argument = label.partition(" ")
        if not argument:
            return cls(method)
        name, _, text = argument.partition("=")
        try:
            value = float(text)
        except ValueError:
            raise FormulationError(f"formulation {label!r}: {name} must be a number") from None
        return cls(method, (name, value))

    @property
    def scheduled(self) -> bool:
        """Whether the rows depend on h: Baumgarte's with a rate of c/h."""
        return self.parameter is not None and self.parameter[0] == "rate_h"

    def applied(self, form: Form) -> Form:
        """A form with the rows and multipliers of this formulation."""
        if self.method == INDEX_3:
            return form
        multipliers = ("lambda", "eta") if self.kind.stabilised else ("lambda",)
        rows = tuple(row for row in form.rows if row != "C") + self.kind.rows
        return replace(
            form, rows=rows, multipliers=multipliers, formulation=self.label, in_paper=False
        )

    def weights(self, h: float) -> Array:
        """(rows, 3) s₀, s₁, s₂ of each row of constraints at step size h (s)."""
        rate = 0.0
        if self.method == "baumgarte":
            assert self.parameter is not None
            rate = self.parameter[1] / (h if self.scheduled else 1.0)
        of_row = {
            "C": (1.0, 0.0, 0.0),
            "Cv": (0.0, 1.0, 0.0),
            "Ca": (0.0, 0.0, 1.0),
            "B": (rate**2, 2 * rate, 1.0),
        }
        return np.array([of_row[row] for row in self.kind.rows]).reshape(-1, 3)


def formulated(form: str, label: str) -> Form:
    """A form in a formulation, by their names in a CSV."""
    return Formulation.parse(label).applied(FORMS[form])


#: Corrections after a step.
PROJECTIONS: Mapping[str, str] = MappingProxyType(
    {
        "none": "no projection",
        "velocity": "after each step velocities to Gᵀv + Φ_t = 0, nearest in the norm of M",
        "position-velocity": "after each step positions to Φ = 0, then velocities",
    }
)
NEWTON, RECOVERED, TOTAL = "newton", "recovered", "total"
#: Which multipliers a march reports.
REPORTED: Mapping[str, str] = MappingProxyType(
    {
        NEWTON: "λ that Newton's iteration ends with",
        RECOVERED: "λ that u and v imply, by the index-1 system",
        TOTAL: "λ + μ/h, μ the multiplier of the velocity projection; 3μ/2h with BDF2",
    }
)
CONSISTENT, CORRECTED = "consistent", "corrected"
#: From which velocities a march starts.
STARTS: Mapping[str, str] = MappingProxyType(
    {
        CONSISTENT: "from the problem's own, which meet the constraints' rate",
        CORRECTED: "from v0 + δv, Gᵀδv = −h²/12 Gᵀu‴, which leaves the trapezoidal rule "
        "no alternating error of λ",
    }
)


@dataclass(frozen=True)
class Projection:
    """What is projected after a step."""

    method: str = "none"  #: one of `PROJECTIONS`
    #: whether v' is replaced by that of the index-1 system too, and a changed by as much: a
    #: approximates v' at a shifted time in generalized-α, and would lose order 2 were it set to v'
    accelerations: bool = False

    def __post_init__(self) -> None:
        if self.method not in PROJECTIONS:
            raise FormulationError(
                f"unknown projection {self.method!r}{nearest(self.method, PROJECTIONS)}"
            )
        if self.accelerations and self.method == "none":
            raise FormulationError("projection none: accelerations need velocities projected")

    @property
    def label(self) -> str:
        """How the CSV names it; `parse` reads it back."""
        return self.method + (" accelerations" if self.accelerations else "")

    @classmethod
    def parse(cls, label: str) -> "Projection":
        """Read a `label`."""
        method, _, rest = label.partition(" ")
        if rest not in ("", "accelerations"):
            raise FormulationError(f"unknown projection {label!r}")
        return cls(method, bool(rest))

    @property
    def level(self) -> int:
        """0: nothing, 1: velocities, 2: positions and velocities."""
        return tuple(PROJECTIONS).index(self.method)


#: What goes without saying.
CONSTRAINTS, UNPROJECTED = Formulation(), Projection()


def is_formulated(formulation: Formulation, projection: Projection) -> bool:
    """Whether anything but index 3, as the paper has it, is marched."""
    return formulation != CONSTRAINTS or projection.level > 0


#: The reported multipliers that a projection decides.
AUTO = "auto"


def reported(multipliers: str, projection: Projection) -> str:
    """One of `REPORTED` from one of them or `AUTO`: recovered after a projection."""
    if multipliers != AUTO:
        return multipliers
    return RECOVERED if projection.level else NEWTON
