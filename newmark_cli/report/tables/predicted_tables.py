"""What theory predicts, as tables: orders of every formulation in every form, and factors.

Orders of the corrections, of the condition number, and the factors of the optimal scaling.
Nothing is measured here; `check` compares a study with the same orders.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from newmark_cli.newmark.forms import FORMS, MULTIPLIERS, ROWS
from newmark_cli.newmark.formulation import formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import BESIDE_TABLE_2, TABLE_2, VARIANTS, named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.reading.words import value_text
from newmark_cli.report.tables.table import Record, Report, Table, pivoted
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

COLUMNS = ("table", "formulation", "form", "evaluation", "entry", "predicted", "bound")
LEGEND = (
    ("", "Corrections are in physical units, the same under every scaling; of eliminated fields "
     "too. ≥: a lower bound, because differences in rows V and K are often exact."),
    ("", "C is that of the linear system, which has no λ in augmented-lagrangian."),
    ("", "Rows D, V, K and C, and u, v, a and λ keep the factors of Table 2 in every formulation."),
)  # fmt: skip


def formulations() -> Report:
    """The tables of all formulations."""
    records = list(_records())
    titles = {
        ("corrections", DIRECT): "Orders of the last decreasing corrections, direct evaluation",
        ("corrections", COMPENSATED): (
            "Orders of the last decreasing corrections, compensated evaluation"
        ),
        ("condition", ""): "Orders of the condition number C",
    }
    rows = {"formulation": TITLES.__getitem__, "form": form_name}
    tables = [
        pivoted(
            title,
            (r for r in records if (r["table"], r["evaluation"]) == kind),
            rows,
            "heading",
            lambda r: ("≥ " if r["bound"] == "yes" else "") + format_order(r["predicted"]),
        )
        for kind, title in titles.items()
    ]
    sides = (("left", ROWS), ("right", MULTIPLIERS))
    blocks = [
        (side, block) for side, names in sides for block in names if block in BESIDE_TABLE_2[side]
    ]
    factors = Table(
        "Factors of the rows and unknowns that formulations add",
        ("", *(block_name(*block) for block in blocks)),
        (("factor", *(factor_text(BESIDE_TABLE_2[side][block]) for side, block in blocks)),),
    )
    return Report("formulations", (*tables, factors), LEGEND, records, COLUMNS)


def _records() -> Iterator[Record]:
    for label in TITLES:
        for name in FORMS:
            form = formulated(name, label)
            same = {"formulation": label, "form": name}
            for evaluation in (DIRECT, COMPENSATED):
                orders = form_orders(form, compensated=evaluation == COMPENSATED)
                of = same | {"table": "corrections", "evaluation": evaluation}
                for unknown, order in orders.physical_corrections().items():
                    bound = "yes" if unknown in orders.bounded else "no"
                    heading = f"Δ{symbol(unknown)}"
                    yield of | _entry(unknown, order) | {"bound": bound, "heading": heading}
            orders = form_orders(form)
            of = same | {"table": "condition", "evaluation": "", "bound": "no"}
            for variant in _SHOWN:
                order = orders.condition(named_scaling(variant, form))
                yield of | _entry(variant, order) | {"heading": variant}


def _entry(name: str, order: float) -> dict[str, Any]:
    return {"entry": name, "predicted": int(order)}


def factors() -> Table:
    """Table 2 as the code has it: the factors themselves."""
    sides = (("left", "DVKC"), ("right", (*FIELDS, "lambda")))
    blocks = [(side, block) for side, names in sides for block in names]
    rows = ((form_name(form), *_factors(form, blocks)) for form in FORMS)
    headings = ("form", *(block_name(*block) for block in blocks))
    return Table("Table 2: factors of the optimal scaling", headings, tuple(rows), False)


def _factors(form: str, blocks: Iterable[tuple[str, str]]) -> Iterator[str]:
    for side, block in blocks:
        factor = TABLE_2[form][side].get(block)
        yield factor_text(factor) if factor else "–"


def form_name(form: str) -> str:
    """A form as headings have it."""
    return value_text("form", form).removesuffix(" form")


def block_name(side: str, block: str) -> str:
    """A factor of a row or an unknown, such as D_L V."""
    return f"D_{side[0].upper()} {symbol(block)}"


def factor_text(factor: str) -> str:
    """A factor as people write it: γ/(βh²) for gamma/(beta*h^2)."""
    text = str(Monomial.parse(factor)).replace("*", "")
    text = text.replace("beta", "β").replace("gamma", "γ")
    powers = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    return re.sub(r"\^(\d+)", lambda match: match[1].translate(powers), text)
