"""Predicted orders of every formulation in every form, as tables.

Orders of the corrections, of the condition number, and the factors of the optimal scaling.
Nothing is measured here; `check` compares a study with the same orders.
"""

from collections.abc import Mapping
from pathlib import Path

from newmark_cli.newmark.forms import FORMS, MULTIPLIERS, ROWS
from newmark_cli.newmark.formulation import formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import BESIDE_TABLE_2, VARIANTS, named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.tables.paper_tables import (
    GREEK,
    latex_factor,
    latex_row,
    latex_table,
    markdown_table,
)
from newmark_cli.study import results
from newmark_cli.support import files

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
_SYMBOLS = {"lambda": "λ", "eta": "η"}

COLUMNS = ("table", "formulation", "form", "evaluation", "entry", "predicted", "bound")

#: A title, a note, and rows with headings first.
Grid = tuple[str, str, list[tuple[str, ...]]]


def grids() -> list[Grid]:
    """The tables as text."""
    return [*map(_corrections, (DIRECT, COMPENSATED)), _conditions(), _factors()]


def _corrections(evaluation: str) -> Grid:
    names = (*FIELDS, *MULTIPLIERS)
    rows = [("formulation", "form", *(f"Δ{_SYMBOLS.get(name, name)}" for name in names))]
    bounds = False
    for label, title in TITLES.items():
        for form in FORMS:
            orders = form_orders(formulated(form, label), compensated=evaluation == COMPENSATED)
            physical = orders.physical_corrections()
            bounds = bounds or bool(orders.bounded)
            cells = (
                ("≥ " if name in orders.bounded else "") + format_order(physical[name])
                if name in physical
                else "–"
                for name in names
            )
            rows.append((title, _heading(form), *cells))
    note = "In physical units, the same under every scaling; of eliminated fields too."
    if bounds:
        note += " ≥: a lower bound, because differences in rows V and K are often exact."
    return f"Orders of the last decreasing corrections, {evaluation} evaluation", note, rows


def _conditions() -> Grid:
    rows: list[tuple[str, ...]] = [("formulation", "form", *_SHOWN)]
    for label, title in TITLES.items():
        for name in FORMS:
            form = formulated(name, label)
            orders = form_orders(form)
            found = (orders.condition(named_scaling(variant, form)) for variant in _SHOWN)
            rows.append((title, _heading(name), *map(format_order, found)))
    note = "Of the linear system, which has no λ in augmented-lagrangian."
    return "Orders of the condition number C", note, rows


def _factors() -> Grid:
    """The factors that other formulations add to Table 2."""
    left, right = BESIDE_TABLE_2["left"], BESIDE_TABLE_2["right"]
    entries = [f"D_L {row}" for row in ROWS if row in left]
    entries += [f"D_R {_SYMBOLS[name]}" for name in right]
    values = [left[row] for row in ROWS if row in left] + list(right.values())
    rows = [("", *entries), ("factor", *values)]
    note = "In every form; rows D, V, K and C, and u, v, a and λ keep the factors of Table 2."
    return "Factors of the rows and unknowns that formulations add", note, rows


def _heading(form: str) -> str:
    return "(" + ", ".join(_SYMBOLS.get(u, u) for u in FORMS[form].unknowns) + ")"


def write(folder: Path) -> list[Path]:
    """Write the tables as Markdown, LaTeX and CSV below ``tables``; returns the files."""
    files.make_folder(folder / "tables", folder, parents=True)
    shown = grids()
    texts = {
        ".md": "\n".join(markdown_table(title, rows, note) for title, note, rows in shown),
        ".tex": "\n".join(["% needs \\usepackage{booktabs}", *map(_latex, shown)]),
        ".csv": results.csv_text(COLUMNS, _csv_rows()),
    }
    written = []
    for suffix, text in texts.items():
        file = (folder / "tables" / "formulations").with_suffix(suffix)
        files.write(file, text, folder)
        written.append(file)
    return written


def _csv_rows() -> list[dict[str, object]]:
    found = []
    for label in TITLES:
        for name in FORMS:
            form = formulated(name, label)
            same: dict[str, object] = {"formulation": label, "form": name}
            for evaluation in (DIRECT, COMPENSATED):
                orders = form_orders(form, compensated=evaluation == COMPENSATED)
                found += [
                    same
                    | {
                        "table": "corrections",
                        "evaluation": evaluation,
                        "entry": unknown,
                        "predicted": int(order),
                        "bound": "yes" if unknown in orders.bounded else "no",
                    }
                    for unknown, order in orders.physical_corrections().items()
                ]
            orders = form_orders(form)
            found += [
                same
                | {
                    "table": "condition",
                    "evaluation": "",
                    "entry": variant,
                    "predicted": int(orders.condition(named_scaling(variant, form))),
                    "bound": "no",
                }
                for variant in _SHOWN
            ]
    return found


def _latex(grid: Grid) -> str:
    """A table as a journal takes it."""
    title, note, rows = grid
    headings, *entries = rows
    kinds = ("Factors", "condition", DIRECT, COMPENSATED)
    label = "formulations-" + next(kind.lower() for kind in kinds if kind in title)
    if title.startswith("Factors"):
        cells = [[_latex_text(row[0]), *map(latex_factor, row[1:])] for row in entries]
    else:
        cells = [[_latex_text(row[0]), _latex_form(row[1]), *map(_latex_order, row[2:])]
                 for row in entries]  # fmt: skip
    titles = [*map(_latex_heading, headings)]
    columns = "ll" + "r" * (len(headings) - 2) if len(headings) > 5 else "l" * len(headings)
    caption = f"{_latex_words(title)}. {_latex_words(note)}"
    return latex_table(caption, label, columns, [latex_row(titles)], cells)


def _latex_words(text: str) -> str:
    for plain, latex in (("λ", r"$\lambda$"), ("≥", r"$\ge$"), ("number C", "number $C$")):
        text = text.replace(plain, latex)
    return text


def _latex_text(text: str) -> str:
    return text.replace("_", r"\_")


def _latex_form(heading: str) -> str:
    for symbol, name in (("λ", "lambda"), ("η", "eta")):
        heading = heading.replace(symbol, GREEK[name])
    return f"${heading}$"


def _latex_order(text: str) -> str:
    if text == "–":
        return "--"
    order = text.removeprefix("≥ ").replace("−", "-")
    return f"$\\ge {order}$" if text.startswith("≥") else f"${order}$"


def _latex_heading(text: str) -> str:
    symbol, _, rest = text.partition(" ")
    if symbol.startswith("Δ"):
        name = symbol.replace("Δ", r"\Delta ").replace("λ", GREEK["lambda"])
        return f"${name.replace('η', GREEK['eta'])}$"
    if symbol in ("D_L", "D_R"):
        return f"$D_{{{symbol[2]},{rest.replace('η', GREEK['eta'])}}}$"
    return _latex_text(text)
