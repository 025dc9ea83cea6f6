"""Every cure on one footing: what it changes, read from the definition of Figure 16.

A cure is the values of a few axes by which it differs from index 3, unscaled, with the
trapezoidal rule.  The cures stand in three groups of seven, which are the panels of the figure.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import GeneralizedAlpha
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.report.reading.curves import TRAPEZOIDAL, Curve
from newmark_cli.study import shipped
from newmark_cli.study.drawing import definitions

#: Studies that the table reads.
TABLED = STUDY, TOLERANCE_STUDY, KRYLOV_STUDY = "cures", "cures-tolerance", "cures-krylov"
FORM = "a-lambda"
DAMPED = GeneralizedAlpha(0.9).label


@dataclass(frozen=True)
class Cure:
    """Something that somebody may do about small steps.

    Attributes:
        name: In legends and tables.
        axes: Axis → value, where it differs from the usual one.
    """

    name: str
    axes: Mapping[str, str] = field(default_factory=dict)

    def curve(self, study: str, problem: str, quantity: str, measure: str, **axes: str) -> Curve:
        """A series of it.

        Args:
            study, problem, quantity, measure: As in the CSV.
            axes: Values over those of the cure.
        """
        named = {"form": FORM, "preconditioning": "none", "integrator": TRAPEZOIDAL}
        every = {**named, **self.axes, **axes}
        return Curve(self.name, study, problem, quantity, measure, **every)

    @property
    def on(self) -> "Cure":
        """The part of it that remains in the matrix of Newton's iteration."""
        of_matrix = ("preconditioning", "formulation")
        return Cure(self.name, {k: v for k, v in self.axes.items() if k in of_matrix})

    @property
    def needs(self) -> str:
        """Inputs that a problem or a user must supply besides those of index 3."""
        formulation = Formulation.parse(self.axes.get("formulation", "index-3"))
        projection = Projection.parse(self.axes.get("projection", "none"))
        found = []
        if self.axes.get("evaluation") == COMPENSATED:
            found.append("quadratic Φ(u)")
        found += {1: ["A"], 2: ["A, κ, Q"]}.get(formulation.kind.derivatives, [])
        if formulation.parameter is not None:
            found.append({"rate": "α", "rate_h": "αh", "factor": "k"}[formulation.parameter[0]])
        if projection.level or self.axes.get("multipliers") == "recovered":
            found.append("κ")
        if self.axes.get("start") == "corrected":
            found.append("κ_t, ∂κ/∂u")
        return "; ".join(found) or "–"


@cache
def of_problem(problem: str) -> dict[str, Mapping[str, Cure]]:
    """Group → name → cure, of those that a problem admits.

    A rate of Baumgarte's must suit its step sizes, and compensated evaluation is not for all.

    Args:
        problem: One of the study's.
    """
    (figure,) = (
        each for each in definitions(shipped.configs()[STUDY]) or () if each.figure == "16"
    )
    found: dict[str, dict[str, Cure]] = {}
    for line in figure.curves:
        if problem in line.choice.get("problem", (problem,)):
            changed = {a: v[0] for a, v in line.choice.items() if a != "problem"}
            found.setdefault(line.panel, {})[line.label] = Cure(line.label, changed)
    return {group: MappingProxyType(members) for group, members in found.items()}


#: The cures of Andrews' mechanism by group.
GROUPS = MappingProxyType(
    {group: tuple(members.values()) for group, members in of_problem("andrews").items()}
)
CURES = tuple(cure for group in GROUPS.values() for cure in group)


def for_problem(cure: Cure, problem: str) -> Cure:
    """The cure of this name as the study has it for a problem; itself where it has none."""
    every = {name: one for group in of_problem(problem).values() for name, one in group.items()}
    return every.get(cure.name, cure)
