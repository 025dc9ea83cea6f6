"""Forms: which of u, v, a are unknowns, beside λ, and which rows are solved.

A form keeps some fields and eliminates the others through the update relations
V and K; the relations used up leave the system.  So a form is two tuples; its
weights W = ∂(u, v, a)/∂(kept) follow from the relations (Sections 3.2 and 3.4
of the paper work this out for two of them).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from newmark_cli.newmark.integrator import FIELDS, Relations
from newmark_cli.support.arrays import Array

#: The formulation of the paper, which goes without saying.
INDEX_3 = "index-3"
#: Rows of constraints: Φ, its rate, its second derivative, and Baumgarte's sum of the three.
CONSTRAINT_ROWS = ("C", "Cv", "Ca", "B")
ROWS = ("D", "V", "K", *CONSTRAINT_ROWS)
#: Unknowns that are no fields: η where a formulation has them.
MULTIPLIERS = ("lambda", "eta")


@dataclass(frozen=True)
class Form:
    """Kept unknowns and rows."""

    name: str  #: spelling in configs and CSVs
    kept: tuple[str, ...]  #: kept fields among u, v, a, in this order
    rows: tuple[str, ...]  #: solved rows in the order of `ROWS`; D always is
    in_paper: bool = True  #: whether Tables 1 and 2 have a column for it
    multipliers: tuple[str, ...] = ("lambda",)  #: λ, and η where the formulation has them
    formulation: str = INDEX_3  #: label of the formulation that the rows of constraints are of

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Unknowns of Newton's iteration, the multipliers last."""
        return (*self.kept, *self.multipliers)

    @property
    def constraint_rows(self) -> tuple[str, ...]:
        """Rows of constraints."""
        return tuple(r for r in self.rows if r in CONSTRAINT_ROWS)

    @property
    def solved(self) -> tuple[str, ...]:
        """Unknowns that the linear solver sees: without rows of constraints, no λ."""
        return self.unknowns if self.constraint_rows else self.kept

    @property
    def eliminated(self) -> tuple[str, ...]:
        """Fields recovered from the kept ones."""
        return tuple(f for f in FIELDS if f not in self.kept)

    def sizes(self, n: int, m: int) -> list[int]:
        """Sizes of the blocks of the solved unknowns, and alike of the rows."""
        return [n] * len(self.kept) + [m] * len(self.constraint_rows)

    @property
    def described(self) -> str:
        """Its name, and the formulation where that does not go without saying."""
        return self.name if self.formulation == INDEX_3 else f"{self.name}, {self.formulation}"


FORMS: Mapping[str, Form] = MappingProxyType(
    {
        form.name: form
        for form in (
            Form("u-v-a-lambda", ("u", "v", "a"), ("D", "V", "K", "C")),
            Form("u-v-lambda", ("u", "v"), ("D", "K", "C")),
            Form("u-lambda", ("u",), ("D", "C")),
            Form("v-lambda", ("v",), ("D", "C")),
            Form("a-lambda", ("a",), ("D", "C")),
            Form("u-a-lambda", ("u", "a"), ("D", "K", "C"), in_paper=False),
            Form("v-a-lambda", ("v", "a"), ("D", "V", "C"), in_paper=False),
        )
    }
)


@dataclass(frozen=True)
class Elimination:
    """Update relations of a form at one step size.

    (u, v, a) = weights · kept + eta · Pη + past · (past vectors).  A kept row of V, K
    reads rows · kept + rows_eta · Pη + rows_past · (past vectors) = 0.  η stands in K as
    −Pη; without a formulation that has it, its columns go unused.
    """

    weights: Array  #: (3, p) W = ∂(u, v, a)/∂(kept)
    past: Array  #: (3, P)
    rows: Array  #: (r, p) kept update relations
    rows_past: Array  #: (r, P)
    eta: Array  #: (3,) coefficients of Pη
    rows_eta: Array  #: (r,) the same in the kept relations


def eliminate(form: Form, relations: Relations) -> Elimination:
    """Solve the update relations that a form does not keep for its eliminated fields."""
    # V and K: a field less from_a · a is known, from what is kept, the past vectors and Pη.
    p, none = len(form.kept), np.zeros(len(form.kept))
    u, v, a = range(3)
    relation = {
        "V": (v, relations.v_from_a, np.concatenate([none, relations.v_past, [0.0]])),
        "K": (u, relations.u_from_a, np.concatenate([none, relations.u_past, [1.0]])),
    }
    fields = np.zeros((3, p + len(relations.v_past) + 1))
    fields[[FIELDS.index(field) for field in form.kept], range(p)] = 1.0
    gone = {FIELDS.index(field) for field in form.eliminated}
    used = [relation[row] for row in relation if row not in form.rows]
    extra = [relation[row] for row in relation if row in form.rows]
    if a in gone:
        field, from_a, known = next(entry for entry in used if entry[0] not in gone)
        fields[a] = (fields[field] - known) / from_a
    for field, from_a, known in used:
        if field in gone:
            fields[field] = known + from_a * fields[a]
    rows = np.array(
        [fields[field] - from_a * fields[a] - known for field, from_a, known in extra]
    ).reshape(-1, fields.shape[1])
    return Elimination(
        fields[:, :p].copy(), fields[:, p:-1].copy(), rows[:, :p].copy(), rows[:, p:-1].copy(),
        fields[:, -1].copy(), rows[:, -1].copy(),
    )  # fmt: skip
