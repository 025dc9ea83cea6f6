"""Output of `check`: slopes next to predictions."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from newmark_cli.newmark.integrator import TRAPEZOIDAL_NAME
from newmark_cli.report.judging.fits import format_fit, format_order
from newmark_cli.report.judging.slopes import Slope, in_figure_order
from newmark_cli.report.judging.text import format_orders, gathered
from newmark_cli.report.judging.verdicts import (
    ALTERNATES,
    FAILING,
    NOT_CONVERGING,
    PASS,
    SHOWN,
    UNDECIDED,
    joined,
)
from newmark_cli.report.reading.words import quantity
from newmark_cli.study.axis import TRAPEZOIDAL

#: Undecided series that are named one by one where one thing is to be said of all.
_MOST_ALIKE = 3


def in_paper(slopes: Iterable[Slope]) -> list[Slope]:
    """Slopes of figures with a tolerance of their own, as the paper's, in their order."""
    return [slope for slope in in_figure_order(slopes) if slope.in_paper]


def chosen(slopes: Sequence[Slope], everything: bool) -> list[Slope]:
    """Slopes to print: those of the paper's figures, then what is not as predicted, or all."""
    first = in_paper(slopes)
    rest = [s for s in slopes if everything or s.missed]
    return first + [slope for slope in rest if slope not in first]


def slope_rows(slopes: Iterable[Slope]) -> list[tuple[str, ...]]:
    """Rows of the table of slopes, headings first."""
    rows: list[tuple[str, ...]] = [
        ("figure", "config", "quantity", "variant", "predicted", "fitted", "tolerance", "verdict")
    ]
    for slope in slopes:
        tolerance = "" if math.isnan(slope.tolerance) else f"{slope.tolerance:g}"
        predicted, fitted = format_order(slope.expected), format_fit(slope.fit)
        rows.append((
            " ".join(slope.figures), _where(slope), quantity(slope), _variant(slope),
            predicted, fitted, tolerance, slope.verdict,
        ))  # fmt: skip
    return rows


def slope_lines(slopes: Iterable[Slope]) -> list[tuple[str, ...]]:
    """Rows of the same table for a terminal, headings first.

    The tolerance stands behind the predicted order.  A row of one entry names the figure
    and study, or the study, problem, form and integrator, of the rows below it.
    """
    rows = (
        (
            f"figure{'s' * (len(slope.figures) > 1)} {', '.join(slope.figures)}, {slope.study}"
            if slope.figures else _where(slope),
            quantity(slope), _variant(slope), format_prediction(slope), format_fit(slope.fit),
            format_verdict(slope),
        )
        for slope in slopes
    )  # fmt: skip
    return gathered(("quantity", "variant", "predicted", "fitted", "verdict"), rows)


def _where(slope: Slope) -> str:
    if slope.figures:
        return slope.study
    return f"{slope.study} {slope.problem} {slope.form} {format_integrator(slope.integrator)}"


#: What stands in columns of its own, or is said by the quantity.
_SAID = (
    "study", "problem", "form", "integrator", "preconditioning", "quantity", "measure", "row_block",
)  # fmt: skip


def _variant(slope: Slope) -> str:
    return ", ".join([slope.preconditioning, *slope.key.besides(*_SAID)])


def counting(slopes: Sequence[Slope]) -> list[Slope]:
    """Series that count: corrections in physical units follow from scaled ones."""
    scaled = {slope.study for slope in slopes if slope.measure == "correction"}
    return [
        slope
        for slope in slopes
        if not slope.accepted
        and (slope.fails or slope.measure != "physical_correction" or slope.study not in scaled)
    ]


def summary(slopes: Sequence[Slope], expected: str = "") -> str:
    """How many slopes are as predicted, what became of the others, and what claims come to."""
    counted = Counter(slope.verdict for slope in counting(slopes))
    decided = sum(counted[word] for word in (PASS, *FAILING))
    parts = [f"{counted[PASS]} of {decided} slopes as predicted"]
    parts += [f"{counted[word]} {word}" for word in (NOT_CONVERGING, UNDECIDED) if counted[word]]
    text = ", ".join([*parts, expected] if expected else parts)
    if not (counted[PASS] or expected) and not any(slope.fails for slope in slopes):
        text += ": nothing could be judged"
    return text


def remarks(slopes: Iterable[Slope]) -> list[str]:
    """A line for each series that is not as predicted: its local orders, and why."""
    alike: dict[tuple[str, str, str], list[Slope]] = {}
    for slope in slopes:
        # Or it is shown and has an order, but not down to the smallest step size, or is wrong.
        shown = slope.verdict == SHOWN and slope.reason and slope.fitted.any()
        loses = shown and slope.h[slope.fitted].min() > slope.h.min()
        loses = loses or (slope.verdict == SHOWN and ALTERNATES in slope.reason)
        if slope.missed or (loses and not slope.accepted):
            orders = format_orders(slope)
            why = joined(f"local orders {orders}" if orders else "", slope.reason)
            key = slope.verdict, slope.study, why
            alike.setdefault(key, []).append(slope)
    lines = []
    for (verdict, study, why), same in alike.items():
        named = [f"{_where(slope)} {_variant(slope)}, {quantity(slope)}" for slope in same]
        if verdict == UNDECIDED and len(named) > _MOST_ALIKE:
            named = [f"{study}, {len(named)} series alike"]
        lines += [": ".join(filter(None, (verdict, where, why))) for where in named]
    return lines


def format_integrator(label: str) -> str:
    """An integrator by its label, the trapezoidal rule in a word."""
    return TRAPEZOIDAL_NAME if label == TRAPEZOIDAL else label


def format_prediction(slope: Slope) -> str:
    """Predicted order ± tolerance; nothing where theory says nothing."""
    order = format_order(slope.expected)
    return f"{order} ± {slope.tolerance:g}" if order else ""


def format_verdict(slope: Slope) -> str:
    """The verdict, and whether the study is about it."""
    return f"{slope.verdict} (accepted)" if slope.accepted else slope.verdict
