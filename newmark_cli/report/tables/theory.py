"""What theory predicts: orders of one form, laid out as the paper does, and tables of all.

Nothing is measured here; `check` compares a study with the same orders.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np

from newmark_cli.newmark.forms import FORMS, INDEX_3, MULTIPLIERS, ROWS, Form
from newmark_cli.newmark.formulation import formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.scaling import (
    BY_SENSITIVITY,
    TABLE_2,
    VARIANTS,
    Preconditioning,
    named_scaling,
)
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.reading.words import power
from newmark_cli.report.tables.table import MISSING, Report, Table, pivoted
from newmark_cli.study.axes import value_text
from newmark_cli.study.measures import symbol
from newmark_cli.support.arrays import Array


def predict(
    form: str,
    preconditioning: Preconditioning,
    evaluation: str = DIRECT,
    formulation: str = INDEX_3,
) -> dict[str, Any]:
    """All orders of a form under a scaling; a structural zero has order None."""
    described = formulated(form, formulation)
    orders = form_orders(described, compensated=evaluation == COMPENSATED)
    scaling = preconditioning.scaling(described)
    jacobian, inverse = orders.scaled(scaling)
    rows, unknowns = described.rows, described.solved
    residual = orders.residual + [scaling.left[row].order() for row in rows]
    physical = orders.physical_corrections()
    return {
        "form": form,
        "preconditioning": preconditioning.label,
        "evaluation": evaluation,
        "formulation": described.formulation,
        "left": {row: scaling.left[row].order() for row in rows},
        "right": {unknown: scaling.right[unknown].order() for unknown in described.unknowns},
        "jacobian": _blocks(rows, unknowns, jacobian),
        "inverse": _blocks(unknowns, rows, inverse),
        "residual": {row: int(order) for row, order in zip(rows, residual, strict=True)},
        "correction": {u: int(order) for u, order in orders.corrections(scaling).items()},
        "physical_correction": {
            field: {
                "order": int(physical[field]),
                "role": "recovered" if field in described.eliminated else "primary",
            }
            for field in (*FIELDS, *described.multipliers)
        },
        "bounds": list(orders.bounded),
        "condition": int(orders.condition(scaling)),
    }


def derive(form: str, formulation: str = INDEX_3) -> dict[str, Any]:
    """The least powers of h that balance a form, beside those of Table 2."""
    described = formulated(form, formulation)
    orders = form_orders(described)
    left, right = derive_scaling(orders)
    table = named_scaling("optimal", described)
    return {
        "form": form,
        "formulation": described.formulation,
        "left": left,
        "right": right,
        "table_2": {
            "left": {row: factor.order() for row, factor in table.left.items()},
            "right": {unknown: table.right[unknown].order() for unknown in described.solved},
        },
        "in_paper": described.in_paper,
    }


def as_text(orders: Mapping[str, Any]) -> str:
    """Orders of one form and scaling for a terminal."""
    rows, unknowns = list(orders["jacobian"]), list(orders["inverse"])
    title = (
        f"({', '.join(map(symbol, orders['right']))}) form, "
        + _formulation(orders)
        + f"preconditioning {orders['preconditioning']}"
        + (f", {orders['evaluation']} evaluation" if orders["evaluation"] != DIRECT else "")
    )
    left, right = (_factors(orders[side]) for side in ("left", "right"))
    residual, correction = orders["residual"], orders["correction"]
    physical = ", ".join(
        f"Δ{symbol(field)}{'*' if entry['role'] == 'recovered' else ''} {_big_o(entry['order'])}"
        for field, entry in orders["physical_correction"].items()
    )
    lines = [
        title,
        "=" * len(title),
        f"factors       left: {left};  right: {right}",
        "",
        *_matrix("J̄", rows, unknowns, orders["jacobian"]),
        "",
        *_matrix("J̄⁻¹", unknowns, rows, orders["inverse"]),
        "",
        "perturbation of the residual  "
        + ", ".join(f"Δb̄_{row} {_big_o(residual[row])}" for row in rows),
        "corrections, scaled           "
        + ", ".join(f"Δ{symbol(u)}̄ {_big_o(order)}" for u, order in correction.items()),
        f"corrections, physical         {physical}",
        f"condition number              C {_big_o(orders['condition'])}",
    ]
    if any(e["role"] == "recovered" for e in orders["physical_correction"].values()):
        lines.append("(* eliminated, recovered from the kept fields)")
    if orders["bounds"]:
        names = ", ".join(f"Δ{symbol(unknown)}" for unknown in orders["bounds"])
        lines.append(
            f"({names}: a lower bound of the order; differences in rows V and K are often exact)"
        )
    if "lambda" not in orders["inverse"]:
        lines.append("(λ is not an unknown of the linear system: each iteration updates it by −pΦ)")
    return "\n".join(lines)


def derived_as_text(derived: Mapping[str, Any]) -> str:
    """A derived scaling for a terminal, one line a side."""
    kind = _formulation(derived).removesuffix(", ")
    lines = [f"({', '.join(map(symbol, derived['right']))}) form" + (f", {kind}" if kind else "")]
    for side in ("left", "right"):
        powers = _factors(derived[side])
        same = derived[side] == derived["table_2"][side]
        table = "Table 2" if derived["in_paper"] else "this project's factors"
        agrees = f"the powers of {table}" if same else f"NOT the powers of {table}"
        lines.append(f"  {side:<6} {powers:<32} {agrees}")
    return "\n".join(lines)


def _formulation(orders: Mapping[str, Any]) -> str:
    """Formulation as part of a title; index 3 goes without saying."""
    return "" if orders["formulation"] == INDEX_3 else f"{orders['formulation']}, "


def _blocks(
    rows: Sequence[str], columns: Sequence[str], orders: Array
) -> dict[str, dict[str, int | None]]:
    return {
        row: {
            column: int(orders[i, j]) if np.isfinite(orders[i, j]) else None
            for j, column in enumerate(columns)
        }
        for i, row in enumerate(rows)
    }


def _matrix(
    name: str,
    rows: Sequence[str],
    columns: Sequence[str],
    blocks: Mapping[str, Mapping[str, int | None]],
) -> list[str]:
    lines = [f"{name:<13} " + "".join(f"{symbol(column):<9}" for column in columns).rstrip()]
    for row in rows:
        entries = "".join(f"{_big_o(blocks[row][column]):<9}" for column in columns)
        lines.append(f"{symbol(row):>13} {entries}".rstrip())
    return lines


def _factors(orders: Mapping[str, int]) -> str:
    return ", ".join(f"{symbol(name)} {power('h', str(order))}" for name, order in orders.items())


def _big_o(order: int | None) -> str:
    return "0" if order is None else f"O({power('h', str(order))})"


# -- tables of every formulation in every form, and factors of the optimal scaling ----------------

#: Label of a formulation → how tables name it; a parameter's value does not matter.
TITLES: Mapping[str, str] = {
    "index-3": "index-3",
    "index-2": "index-2",
    "index-1": "index-1",
    "baumgarte rate=1000.0": "baumgarte, rate",
    "baumgarte rate_h=1.0": "baumgarte, rate_h",
    "ggl": "ggl",
    "augmented-lagrangian factor=10.0": "augmented-lagrangian, factor",
}
#: Variants whose condition numbers are shown.
_SHOWN = tuple(name for name in VARIANTS if name != "optimal-printed")

LEGEND = (
    ("", "Corrections are in physical units, the same under every scaling; of eliminated fields "
     "too. ≥: a lower bound, because differences in rows V and K are often exact."),
    ("", "C is that of the linear system, which has no λ in augmented-lagrangian."),
    ("", "Rows D, V, K and C, and u, v, a and λ keep the factors of Table 2 in every formulation."),
)  # fmt: skip


def formulations() -> Report:
    """The tables of all formulations."""
    rows = {"formulation": TITLES.__getitem__, "form": form_name}
    titles: dict[str, Callable[[Form], Iterator[tuple[str, str]]]] = {
        "Orders of the last decreasing corrections, direct evaluation": partial(
            _corrections, evaluation=DIRECT
        ),
        "Orders of the last decreasing corrections, compensated evaluation": partial(
            _corrections, evaluation=COMPENSATED
        ),
        "Orders of the condition number C": _conditions,
    }
    tables = []
    for title, orders_of in titles.items():
        entries = [
            {"formulation": label, "form": name, "column": column, "order": order}
            for label in TITLES
            for name in FORMS
            for column, order in orders_of(formulated(name, label))
        ]
        tables.append(pivoted(title, entries, rows, "column", itemgetter("order")))
    sides = (("left", ROWS), ("right", MULTIPLIERS))
    of_index_3 = TABLE_2["u-v-a-lambda"]
    blocks = [
        (side, block) for side, names in sides for block in names if block not in of_index_3[side]
    ]
    factors = Table(
        "Factors of the rows and unknowns that formulations add",
        ("", *(block_name(*block) for block in blocks)),
        (("factor", *(factor_text(BY_SENSITIVITY[side][block]) for side, block in blocks)),),
    )
    return Report("formulations", (*tables, factors), LEGEND)


def _corrections(form: Form, evaluation: str) -> Iterator[tuple[str, str]]:
    orders = form_orders(form, compensated=evaluation == COMPENSATED)
    for unknown, order in orders.physical_corrections().items():
        bound = "≥ " if unknown in orders.bounded else ""
        yield f"Δ{symbol(unknown)}", bound + format_order(order)


def _conditions(form: Form) -> Iterator[tuple[str, str]]:
    orders = form_orders(form)
    for variant in _SHOWN:
        yield variant, format_order(orders.condition(named_scaling(variant, form)))


def factors() -> Table:
    """Table 2 as the code has it: the factors themselves."""
    sides = (("left", "DVKC"), ("right", (*FIELDS, "lambda")))
    blocks = [(side, block) for side, names in sides for block in names]
    rows = tuple(
        (form_name(form), *(factor_text(TABLE_2[form][side].get(block)) for side, block in blocks))
        for form in FORMS
    )
    headings = ("form", *(block_name(*block) for block in blocks))
    return Table("Table 2: factors of the optimal scaling", headings, rows, False)


def form_name(form: str) -> str:
    """A form as headings have it."""
    return value_text("form", form).removesuffix(" form")


def block_name(side: str, block: str) -> str:
    """A factor of a row or an unknown, such as D_L V."""
    return f"D_{side[0].upper()} {symbol(block)}"


def factor_text(factor: str | None) -> str:
    """A factor as people write it: γ/(βh²) for gamma/(beta*h^2)."""
    if factor is None:
        return MISSING
    text = str(Monomial.parse(factor)).replace("*", "")
    text = text.replace("beta", "β").replace("gamma", "γ")
    return re.sub(r"\^(\d+)", lambda match: power("", match[1]), text)
