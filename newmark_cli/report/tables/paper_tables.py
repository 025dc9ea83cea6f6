"""Tables 1 and 2 of the paper: every entry predicted next to measured.

Measured values come from the slopes of the study `all-forms`:

- Table 1: physical corrections and condition numbers without preconditioning.
- Table 2: a left factor's power of h is the order in which the unknowns, scaled by
  the right factors, react to a perturbation of that row; a right factor's is the
  order in which that unknown reacts to perturbations of the rows scaled by the
  left factors.  With just that power more the reaction would be O(1).
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from newmark_cli.mechanisms import registry
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.monomial import Monomial
from newmark_cli.newmark.orders import derive_scaling, form_orders
from newmark_cli.newmark.scaling import TABLE_2
from newmark_cli.report.judging.fits import Fit, fit_parts, format_fit, format_order, power_law
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.text import latex_text, markdown
from newmark_cli.report.judging.verdicts import MISS, PASS
from newmark_cli.study import results
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError

#: Study that the tables read.
STUDY = "all-forms"

#: Rows of the system of index 3, which the paper is about.
ROWS = ("D", "V", "K", "C")

#: Largest |measured − predicted| of a factor's power; the sensitivities are not noisy.
_FACTOR_TOLERANCE = 0.05

COLUMNS = (
    "table", "entry", "form", "problem", "factor", "predicted", "measured", "stderr",
    "eliminated", "verdict",
)  # fmt: skip

_ENTRY = {"lambda": "λ", "jacobian": "C"}
#: Side and block of each factor in Table 2.
_FACTORS = (
    *(("left", row) for row in ROWS),
    *(("right", unknown) for unknown in (*FIELDS, "lambda")),
)


@dataclass(frozen=True)
class Entry:
    """One entry of a table, for one problem.

    Attributes:
        table: 1 or 2.
        entry: Row of the table: "Δu" … "C" of Table 1, "D_L D" … "D_R λ" of Table 2.
        form: Column of the table.
        problem: Where it was measured.
        factor: Table 2's factor; empty in Table 1.
        predicted: Order in h.
        fit: Fitted order.
        eliminated: Whether the field is recovered rather than an unknown.
        verdict: pass, miss or incomplete.
    """

    table: int
    entry: str
    form: str
    problem: str
    factor: str
    predicted: float
    fit: Fit
    eliminated: bool
    verdict: str


def build(slopes: Iterable[Slope]) -> list[Entry]:
    """Entries of both tables from the slopes of `all-forms`.

    Raises:
        ResultsError: When the study lacks a series.
    """
    ours = [slope for slope in slopes if slope.study == STUDY]
    problems = list(dict.fromkeys(slope.problem for slope in ours))
    if not problems:
        raise ResultsError(f"no results of {STUDY}; run 'newmark-study run {STUDY}' first")
    entries = [e for problem in problems for e in _table_1(ours, problem)]
    return entries + [e for problem in problems for e in _table_2(ours, problem)]


def missed(entries: Iterable[Entry]) -> list[Entry]:
    """Entries that are not as predicted."""
    return [entry for entry in entries if entry.verdict != PASS]


def _table_1(slopes: Sequence[Slope], problem: str) -> Iterable[Entry]:
    for quantity in (*FIELDS, "lambda", "jacobian"):
        measure = "condition" if quantity == "jacobian" else "physical_correction"
        for form in FORMS:
            slope = _one(slopes, problem, form, "none", quantity, measure)
            yield Entry(
                table=1,
                entry="C" if measure == "condition" else f"Δ{_ENTRY.get(quantity, quantity)}",
                form=form,
                problem=problem,
                factor="",
                predicted=slope.expected,
                fit=slope.fit,
                eliminated=slope.role == "recovered",
                verdict=slope.verdict,
            )


def _table_2(slopes: Sequence[Slope], problem: str) -> Iterable[Entry]:
    derived = {name: derive_scaling(form_orders(form)) for name, form in FORMS.items()}
    sensitivities: dict[tuple[str, str], list[Slope]] = {}
    for slope in slopes:
        if (slope.problem, slope.measure) == (problem, "sensitivity"):
            sensitivities.setdefault((slope.form, slope.preconditioning), []).append(slope)
    for side, blocks in (("left", ROWS), ("right", (*FIELDS, "lambda"))):
        other = "right" if side == "left" else "left"
        for block in blocks:
            for name in FORMS:
                powers = derived[name][0 if side == "left" else 1]
                if block not in powers:
                    continue
                reactions = [
                    slope
                    for slope in sensitivities.get((name, other), [])
                    if block == (slope.row_block if side == "left" else slope.quantity)
                ]
                if not reactions:
                    raise ResultsError(
                        f"{STUDY}: no sensitivities of {problem}, {name}, {other}; "
                        f"run 'newmark-study run {STUDY}' again"
                    )
                strongest = np.max([slope.values for slope in reactions], axis=0)
                fit = power_law(reactions[0].h, strongest)
                factor = TABLE_2[name][side][block]
                agrees = Monomial.parse(factor).order() == powers[block]
                within = agrees and abs(fit.slope - powers[block]) <= _FACTOR_TOLERANCE
                yield Entry(
                    table=2,
                    entry=f"D_{side[0].upper()} {_ENTRY.get(block, block)}",
                    form=name,
                    problem=problem,
                    factor=factor,
                    predicted=powers[block],
                    fit=fit,
                    eliminated=False,
                    verdict=PASS if within else MISS,
                )


def _one(
    slopes: Sequence[Slope], problem: str, form: str, variant: str, quantity: str, measure: str
) -> Slope:
    for slope in slopes:
        if (slope.problem, slope.form, slope.preconditioning, slope.quantity, slope.measure) == (
            problem, form, variant, quantity, measure,
        ):  # fmt: skip
            return slope
    raise ResultsError(
        f"{STUDY}: no {measure} of {problem}, {form}, {variant}, {quantity}; "
        f"run 'newmark-study run {STUDY}' again"
    )


def grids(entries: Sequence[Entry]) -> list[tuple[str, list[tuple[str, ...]]]]:
    """The tables as grids of text: a title, and rows with headings first.

    A form is a row, an entry of the paper's tables a column, so that they fit a
    terminal.  An entry reads "predicted: measured ± standard error", with * where
    the field is eliminated and ! where it is not as predicted.
    """
    titles = {
        1: "Table 1: orders of corrections and condition number, no preconditioning",
        2: "Table 2: powers of h in the factors of the optimal scaling",
    }
    found = []
    for table, title in titles.items():
        for problem in dict.fromkeys(e.problem for e in entries):
            ours = [e for e in entries if (e.table, e.problem) == (table, problem)]
            cells = {(e.entry, e.form): e for e in ours}
            columns = list(dict.fromkeys(e.entry for e in ours))
            if not columns:
                continue
            rows: list[tuple[str, ...]] = [("form", *columns)]
            rows += [
                (_form_heading(form), *(_cell(cells.get((column, form))) for column in columns))
                for form in FORMS
            ]
            found.append((f"{title} ({problem})", rows))
    return found


def factors() -> tuple[str, list[tuple[str, ...]]]:
    """Table 2 as the code has it: the factors themselves."""
    rows: list[tuple[str, ...]] = [
        ("form", *(f"D_{side[0].upper()} {_ENTRY.get(block, block)}" for side, block in _FACTORS))
    ]
    rows += [
        (_form_heading(form), *(TABLE_2[form][side].get(block, "–") for side, block in _FACTORS))
        for form in FORMS
    ]
    return "Table 2: factors of the optimal scaling", rows


def _form_heading(form: str) -> str:
    return "(" + ", ".join(_ENTRY.get(u, u) for u in FORMS[form].unknowns) + ")"


def _cell(entry: Entry | None) -> str:
    if entry is None:
        return "–"
    mark = ("*" if entry.eliminated else "") + ("" if entry.verdict == PASS else " !")
    return f"{format_order(entry.predicted)}: {format_fit(entry.fit)}{mark}"


def write(folder: Path, entries: Sequence[Entry]) -> list[Path]:
    """Write both tables as Markdown, CSV and LaTeX below ``tables``; returns the files."""
    written = []
    files.make_folder(folder / "tables", folder, parents=True)
    for table in (1, 2):
        ours = [e for e in entries if e.table == table]
        shown = ([factors()] if table == 2 else []) + grids(ours)
        stem = folder / "tables" / f"table-{table}"
        for suffix, text in (
            (".md", "\n".join(markdown_table(title, rows, NOTE) for title, rows in shown)),
            (".tex", _latex(ours)),
            (".csv", results.csv_text(COLUMNS, map(_csv_row, ours))),
        ):
            file = stem.with_suffix(suffix)
            files.write(file, text, folder)
            written.append(file)
    return written


def _csv_row(entry: Entry) -> dict[str, object]:
    return vars(entry) | {
        "measured": entry.fit.slope,
        "stderr": entry.fit.stderr,
        "eliminated": "yes" if entry.eliminated else "no",
        "predicted": int(entry.predicted),
    }


def markdown_table(title: str, rows: Sequence[Sequence[str]], note: str) -> str:
    """A table with a heading and a note as Markdown, the first row its headings."""
    lines = ["| " + " | ".join(map(markdown, row)) + " |" for row in rows]
    rule = "|" + " --- |" * len(rows[0])
    return "\n".join([f"### {markdown(title)}", "", lines[0], rule, *lines[1:], "", note, ""])


#: How to read an entry.
NOTE = (
    "Predicted: fitted ± standard error, which is left out below 5e-7; * eliminated, "
    "! not as predicted."
)

#: Characters that LaTeX does not print as they are.
GREEK = {"lambda": r"\lambda", "eta": r"\eta", "beta": r"\beta", "gamma": r"\gamma"}
_SUBJECTS = {
    1: "orders in $h$ of the last decreasing Newton corrections and of the condition number $C$, "
    "without preconditioning",
    2: "powers of $h$ in the factors of the optimal scaling",
}
_LABELS = {1: "orders", 2: "powers"}


def _latex(entries: Sequence[Entry]) -> str:
    """One of the tables as a journal takes it; Table 2 begins with the factors themselves."""
    factors = [_latex_factors()] if any(entry.table == 2 for entry in entries) else []
    orders = [
        _latex_orders([entry for entry in entries if entry.problem == problem])
        for problem in dict.fromkeys(entry.problem for entry in entries)
    ]
    return "\n".join(["% needs \\usepackage{booktabs}", *factors, *orders])


def _latex_factors() -> str:
    lefts, rights = len(ROWS), len(_FACTORS) - len(ROWS)
    headings = [
        rf" & \multicolumn{{{lefts}}}{{c}}{{$D_L$}} & \multicolumn{{{rights}}}{{c}}{{$D_R$}} \\",
        rf"\cmidrule(lr){{2-{lefts + 1}}} \cmidrule(l){{{lefts + 2}-{lefts + rights + 1}}}",
        latex_row(["form", *(f"${GREEK.get(block, block)}$" for _, block in _FACTORS)]),
    ]
    rows = [
        [
            _latex_form(form),
            *(
                latex_factor(sides[side][block]) if block in sides[side] else "--"
                for side, block in _FACTORS
            ),
        ]
        for form, sides in TABLE_2.items()
    ]
    caption = "Factors of the optimal scaling."
    return latex_table(caption, "factors", "l" * (1 + len(_FACTORS)), headings, rows)


def _latex_orders(entries: Sequence[Entry]) -> str:
    """Predicted and fitted orders of one problem.

    Orders that all forms share head their column; others stand beside what was fitted.
    """
    cells = {(entry.entry, entry.form): entry for entry in entries}
    predicted: dict[str, set[float]] = {}
    for entry in entries:
        predicted.setdefault(entry.entry, set()).add(entry.predicted)
    columns, headings, shared = "l", ["form"], ["predicted"]
    for name, orders in predicted.items():
        width = 1 if len(orders) == 1 else 2
        columns += "r" * width
        headings.append(rf"\multicolumn{{{width}}}{{c}}{{${_latex_entry(name)}$}}")
        shared += [f"${min(orders):g}$"] if width == 1 else ["", ""]
    rows = []
    for form in FORMS:
        row = [_latex_form(form)]
        for name, orders in predicted.items():
            cell = cells.get((name, form))
            if len(orders) > 1:
                row.append(f"${cell.predicted:g}$" if cell else "--")
            row.append(_latex_fit(cell) if cell else "--")
        rows.append(row)
    table, problem = entries[0].table, entries[0].problem
    caption = (
        f"{latex_text(_title(problem))}: {_SUBJECTS[table]}; predicted, and fitted "
        r"$\pm$ standard error, which is left out where it is below $5\cdot 10^{-7}$."
    )
    if any(entry.eliminated for entry in entries):
        caption += " The form eliminates the fields that are marked $^*$."
    if missed(entries):
        caption += r" Fits that are marked $^\dagger$ are not as predicted."
    label = f"{_LABELS[table]}-{re.sub('[^A-Za-z0-9]+', '-', problem).strip('-')}"
    return latex_table(caption, label, columns, [latex_row(headings), latex_row(shared)], rows)


def latex_table(
    caption: str, label: str, columns: str, headings: Sequence[str], rows: Sequence[Sequence[str]]
) -> str:
    """A table in the style of booktabs; rows are entries in LaTeX, headings whole lines."""
    return "\n".join(
        [
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{caption}}}",
            rf"  \label{{tab:{label}}}",
            r"  \smallskip",
            r"  \footnotesize",
            r"  \setlength{\tabcolsep}{4pt}",
            rf"  \begin{{tabular}}{{@{{}}{columns}@{{}}}}",
            r"    \toprule",
            *(f"    {line}" for line in headings),
            r"    \midrule",
            *(f"    {latex_row(row)}" for row in rows),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def latex_row(cells: Sequence[str]) -> str:
    """A line of a table."""
    return " & ".join(cells) + r" \\"


def _latex_form(form: str) -> str:
    return "$(" + ", ".join(GREEK.get(u, u) for u in FORMS[form].unknowns) + ")$"


def _latex_entry(name: str) -> str:
    """Name of an `Entry.entry` in math mode, "D_L D" as D_{L,D}."""
    name = name.replace("λ", r"\lambda")
    side, _, block = name.partition(" ")
    return f"D_{{{side[2:]},{block}}}" if block else name.replace("Δ", r"\Delta ")


def _latex_fit(entry: Entry) -> str:
    """A fit in math mode; marks take no width, so that digits stay aligned."""
    slope, error = fit_parts(entry.fit)
    marks = ("*" if entry.eliminated else "") + ("" if entry.verdict == PASS else r"\dagger")
    text = f"${slope} \\pm {error}$" if error else f"${slope}$" if slope != "n/a" else slope
    return text + (rf"\rlap{{$^{{{marks}}}$}}" if marks else "")


def latex_factor(text: str) -> str:
    """A factor of Table 2 in math mode: gamma/(beta*h) with Greek letters and exponents."""
    factor = Monomial.parse(text)

    def product(sign: int) -> list[str]:
        return [
            GREEK.get(symbol, symbol) + {1: "", 2: "^2"}.get(abs(power), f"^{{{abs(power)}}}")
            for symbol, power in factor.powers
            if power * sign > 0
        ]

    above, below = product(1), product(-1)
    if factor.coefficient != 1 or not above:
        above.insert(0, f"{factor.coefficient:g}")
    divisor = " ".join(below)
    if below:
        divisor = f"/({divisor})" if len(below) > 1 else f"/{divisor}"
    return f"${' '.join(above)}{divisor}$"


def _title(problem: str) -> str:
    """Title of a shipped problem; the label of any other."""
    return registry.about(problem).title if problem in registry.PROBLEMS else problem


def worst(entries: Sequence[Entry]) -> str:
    """How far the measured orders are from the predicted ones, a line for each kind."""
    kinds = {
        "corrections": [e for e in entries if e.table == 1 and e.entry != "C"],
        "condition numbers": [e for e in entries if e.table == 1 and e.entry == "C"],
        "factors": [e for e in entries if e.table == 2],
    }
    return "\n".join(
        f"{len(chosen)} {kind}: at most "
        f"{max(abs(e.fit.slope - e.predicted) for e in chosen):.2g} from the predicted order"
        for kind, chosen in kinds.items()
        if chosen
    )
