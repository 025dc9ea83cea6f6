"""Scalings of equations and unknowns: Table 2 of the paper, and a user's own.

The solver sees (D_L J D_R) q̄ = −D_L b and q = D_R q̄ (eqs. 9, 10).  D_L has one
factor a row block, D_R one a field, each a monomial in β, γ and h.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

from newmark_cli.newmark.forms import FORMS, MULTIPLIERS, ROWS, Form
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.monomial import Monomial, MonomialError
from newmark_cli.support.errors import InputError
from newmark_cli.support.spelling import nearest

ONE = Monomial()

#: Form → D_L and D_R of Table 2, in the orders of its rows and unknowns.
#: The last two are this project's, by the rule of `sensitivity`.
#: The V row is β h/γ where the scan of the paper prints 1: see `PRINTED`.
_COLUMNS = {
    "u-v-a-lambda": (
        "beta*h^2 beta*h/gamma 1 1", "1 gamma/(beta*h) 1/(beta*h^2) 1/(beta*h^2)",
    ),
    "u-v-lambda": ("beta*h^2 1 1", "1 gamma/(beta*h) 1/(beta*h^2)"),
    "u-lambda": ("beta*h^2 1", "1 1/(beta*h^2)"),
    "v-lambda": ("gamma*h^2 1", "1/(gamma*h) 1/(beta*h^2)"),
    "a-lambda": ("beta*h^2 1", "1/(beta*h^2) 1/(beta*h^2)"),
    "u-a-lambda": ("beta*h^2 1 1", "1 1/(beta*h^2) 1/(beta*h^2)"),
    "v-a-lambda": ("beta*h^2 beta*h/gamma 1", "gamma/(beta*h) 1/(beta*h^2) 1/(beta*h^2)"),
}  # fmt: skip
#: Table 2: form → side → row or unknown → factor.
TABLE_2: Mapping[str, Mapping[str, Mapping[str, str]]] = MappingProxyType(
    {
        name: {
            "left": dict(zip(FORMS[name].rows, left.split(), strict=True)),
            "right": dict(zip(FORMS[name].unknowns, right.split(), strict=True)),
        }
        for name, (left, right) in _COLUMNS.items()
    }
)

#: Side → row or unknown of any form and formulation → factor by the rule of `sensitivity`.
BY_SENSITIVITY: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "left": {
            "D": "beta*h^2", "V": "beta*h/gamma", "K": "1",
            "C": "1", "Cv": "beta*h/gamma", "Ca": "beta*h^2", "B": "beta*h^2",
        },
        "right": {
            "u": "1", "v": "gamma/(beta*h)", "a": "1/(beta*h^2)", "lambda": "1/(beta*h^2)",
            "eta": "1",
        },
    }
)  # fmt: skip

#: Entries of Table 2 as the scan prints them, where they differ from `TABLE_2`.
PRINTED: Mapping[str, str] = MappingProxyType({"V": "1"})


@dataclass(frozen=True)
class Variant:
    """A named scaling by the factors of Table 2."""

    sides: tuple[str, ...]  #: sides that it uses
    description: str  #: one line
    #: row block → factor that it uses in place of that of `TABLE_2`
    replaced: Mapping[str, str] = field(default_factory=dict)
    #: side → its factors, the same for every form, in place of `TABLE_2`
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


#: Named variants, in the order of the paper's legends.
VARIANTS: Mapping[str, Variant] = MappingProxyType(
    {
        "none": Variant((), "no scaling"),
        "left": Variant(("left",), "scales the equations only, by D_L of Table 2"),
        "right": Variant(("right",), "scales the unknowns only, by D_R of Table 2"),
        "optimal": Variant(
            ("left", "right"), "scales equations and unknowns, by D_L and D_R of Table 2"
        ),
        "optimal-printed": Variant(
            ("left", "right"),
            "optimal with factor 1 for row V, as the paper prints it, in place of βh/γ; "
            "differs in u-v-a-lambda and v-a-lambda",
            PRINTED,
        ),
        "partial": Variant(
            ("left", "right"),
            "scales row D by h and λ by 1/h only: half of the cure",
            factors={"left": {"D": "h"}, "right": {"lambda": "1/h"}},
        ),
    }
)
#: The four variants of the paper.
PAPER_VARIANTS = ("none", "left", "right", "optimal")


class ScalingError(InputError):
    """A scaling does not fit the form or is not made of positive monomials.

    Examples:
        >>> import newmark_cli as newmark
        >>> own = {"name": "own", "left": {"V": "h"}}
        >>> newmark.scaling("u-lambda", h=1e-3, preconditioning=own)
        Traceback (most recent call last):
        ...
        newmark_cli.newmark.scaling.ScalingError: left: form u-lambda has no 'V'; it has D, C
    """


@dataclass(frozen=True)
class Scaling:
    """Factors of the row blocks and of the unknowns of one form."""

    name: str  #: a variant's name, or the user's
    left: Mapping[str, Monomial]  #: row block → factor
    right: Mapping[str, Monomial]  #: unknown → factor


@dataclass(frozen=True)
class Preconditioning:
    """A scaling before it is applied to a form: a named variant, or factors of one's own."""

    name: str  #: one of `VARIANTS`, or a name of one's own
    left: tuple[tuple[str, str], ...] = ()  #: (row block, factor) pairs of a scaling of one's own
    right: tuple[tuple[str, str], ...] = ()  #: (unknown, factor) pairs
    own: bool = False  #: whether the factors are given here rather than by Table 2

    def __post_init__(self) -> None:
        # Two spellings of one factor, or of their order, are one scaling.
        for side, blocks in (("left", ROWS), ("right", (*FIELDS, *MULTIPLIERS))):
            object.__setattr__(self, side, _canonical_factors(getattr(self, side), blocks))

    @property
    def label(self) -> str:
        """Text that says everything, so that a CSV alone tells what was run."""
        if not self.own:
            return self.name
        sides = [
            f"{side} " + " ".join(f"{block}={factor}" for block, factor in factors)
            for side, factors in (("left", self.left), ("right", self.right))
            if factors
        ]
        return f"{self.name}[{'; '.join(sides)}]"

    @classmethod
    def parse(cls, label: str) -> "Preconditioning":
        """Read a `label`."""
        if label in VARIANTS:
            return cls(label)
        match = _LABEL.fullmatch(label)
        if match is None:
            raise ScalingError(f"unknown preconditioning {label!r}{nearest(label, VARIANTS)}")
        sides: dict[str, tuple[tuple[str, str], ...]] = {"left": (), "right": ()}
        for part in filter(None, match["sides"].split("; ")):
            side, *factors = part.split(" ")
            pairs = [tuple(factor.partition("=")[::2]) for factor in factors]
            if side not in sides or not all(block and factor for block, factor in pairs):
                raise ScalingError(f"preconditioning {label!r} cannot be read")
            sides[side] = tuple((block, factor) for block, factor in pairs)
        return cls(match["name"], sides["left"], sides["right"], own=True)

    def scaling(self, form: Form) -> Scaling:
        """Factors for a form."""
        if self.own:
            return own_scaling(self.name, form, dict(self.left), dict(self.right))
        return named_scaling(self.name, form)


def _canonical_factors(
    pairs: tuple[tuple[str, str], ...], blocks: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    """Factors in one spelling and order; unreadable ones stay for `own_scaling` to refuse."""

    def normalised(factor: str) -> str:
        try:
            return str(Monomial.parse(factor))
        except MonomialError:
            return factor

    place = {block: k for k, block in enumerate(blocks)}
    factors = [(block, normalised(factor)) for block, factor in pairs]
    return tuple(sorted(factors, key=lambda pair: place.get(pair[0], len(place))))


def canonical(label: str) -> str:
    """The one spelling of a label of `Preconditioning`; what is none stays as it is."""
    try:
        return Preconditioning.parse(label).label
    except ScalingError:
        return label


_LABEL = re.compile(r"(?P<name>[A-Za-z0-9._-]+)\[(?P<sides>[^\[\]]*)\]")


def named_scaling(variant: str, form: Form) -> Scaling:
    """Scaling of a form by a named variant."""
    chosen, of_form = VARIANTS[variant], TABLE_2[form.name]
    factors = chosen.factors or {
        side: {**BY_SENSITIVITY[side], **of_form[side], **chosen.replaced} for side in chosen.sides
    }
    return _tabled(variant, form, factors)


def _tabled(name: str, form: Form, factors: Mapping[str, Mapping[str, str]]) -> Scaling:
    """Scaling by what a table has for the blocks of a form."""
    left, right = (
        {block: factor for block, factor in factors.get(side, {}).items() if block in blocks}
        for side, blocks in (("left", form.rows), ("right", form.unknowns))
    )
    return own_scaling(name, form, left, right)


def own_scaling(
    name: str, form: Form, left: Mapping[str, str | float], right: Mapping[str, str | float]
) -> Scaling:
    """Scaling from factors given as text; blocks that are not named keep factor 1.

    Raises:
        ScalingError: Names side, block and reason.
    """

    def side(
        label: str, texts: Mapping[str, str | float], allowed: Iterable[str]
    ) -> dict[str, Monomial]:
        factors = dict.fromkeys(allowed, ONE)
        for block, text in texts.items():
            if block not in factors:
                raise ScalingError(
                    f"{label}: form {form.described} has no {block!r}; it has {', '.join(factors)}"
                )
            try:
                factors[block] = Monomial.parse(text)
            except MonomialError as error:
                raise ScalingError(f"{label} {block}: {error}") from None
        return factors

    return Scaling(name, side("left", left, form.rows), side("right", right, form.unknowns))


#: ∂a/∂u of the (u, λ) form, in the β of the integrator.
DISPLACEMENT_TO_A = Monomial.parse(BY_SENSITIVITY["right"]["a"])


@cache
def sensitivity(form: Form) -> Scaling:
    """Scaling by the sensitivity of each unknown to displacement.

    The rule behind Table 2, up to constants: unknowns are scaled by ∂v/∂u and
    ∂a/∂u of the two-field form (u, λ), rows by their inverses.  It balances the
    blocks of J̄ for every integrator of the family.
    """
    return _tabled("sensitivity", form, BY_SENSITIVITY)
