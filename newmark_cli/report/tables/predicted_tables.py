"""What theory predicts, as tables: orders of every formulation in every form, and factors.

Orders of the corrections, of the condition number, and the factors of the optimal scaling.
Nothing is measured here; `check` compares a study with the same orders.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from operator import itemgetter

from newmark_cli.newmark.forms import FORMS, MULTIPLIERS, ROWS, Form
from newmark_cli.newmark.formulation import formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import BY_SENSITIVITY, TABLE_2, VARIANTS, named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.reading.words import power
from newmark_cli.report.tables.table import MISSING, Report, Table, pivoted
from newmark_cli.study.axes import value_text
from newmark_cli.study.measures import symbol

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
