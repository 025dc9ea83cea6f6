"""Which cure cures what: every cell predicted and measured; Figure 19.

Predictions are those of the series; measured values come from the CSVs of the studies, and
the cost from the operations in their records.  Nothing here is a number that somebody typed
in, but for the bounds beyond which a value counts as good or bad.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.linear.choice import GMRES
from newmark_cli.report.drawing import cures
from newmark_cli.report.drawing.cures import (
    CURES,
    DAMPED,
    GROUPS,
    KRYLOV_STUDY,
    STUDY,
    TOLERANCE_STUDY,
    Cure,
)
from newmark_cli.report.drawing.panels import Legend, Panel, Sheet
from newmark_cli.report.drawing.work import costs
from newmark_cli.report.judging.fits import format_order
from newmark_cli.report.judging.text import latex_text, markdown
from newmark_cli.report.judging.verdicts import MISS, PASS
from newmark_cli.report.reading.curves import Curve
from newmark_cli.study import results
from newmark_cli.study.axes import SeriesKey
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError

if TYPE_CHECKING:
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.reading.figures import Figure

#: Where orders are read, and where the alternation starts with the motion.
PROBLEM, MOVING = "andrews", "slider-crank"

#: What a cell comes to: cured, partly, not.
GOOD, HALF, BAD, NONE = "+", "○", "–", ""

#: |fitted − predicted| that contradicts an order, of however few points.
_FAR = 0.5

#: How to read the table.
NOTE = "In each cell + cured, ○ partly, – not; predicted order in h → measured. ! not as predicted."

COLUMNS = ("group", "cure", "symptom", "mark", "predicted", "measured", "agrees")


@dataclass(frozen=True)
class Cell:
    """One cell of the table.

    Attributes:
        mark: `GOOD`, `HALF`, `BAD`, or nothing where there is no such question.
        predicted: Order in h, or words; empty where theory says nothing.
        measured: What was measured, as text.
        agrees: Whether it is as predicted.
    """

    mark: str = NONE
    predicted: str = ""
    measured: str = "n/a"
    agrees: bool = True

    @property
    def text(self) -> str:
        """The cell in a line."""
        arrow = f"{self.predicted} → {self.measured}" if self.predicted else self.measured
        return " ".join(filter(None, (self.mark, arrow, "" if self.agrees else "!")))


@dataclass(frozen=True)
class Symptom:
    """A column of the table.

    Attributes:
        name: In headings.
        about: What it is, for the notes below.
        cell: The cell of a cure, from what the results have.
    """

    name: str
    about: str
    cell: "Callable[[Evidence, Cure], Cell]"


class Evidence:
    """Series of the studies, found by cure.

    Attributes:
        results: What they come from.
    """

    def __init__(self, found: "Results") -> None:
        """Take results that have the studies."""
        self.results = found
        self._by_key: Mapping[SeriesKey, Slope] = found.by_key

    def series(self, curve: Curve) -> "Slope | None":
        """The series of a curve; None where the results lack it."""
        return self._by_key.get(curve.key)

    @cached_property
    def operations(self) -> Mapping[SeriesKey, Any]:
        """Those of the cells of Andrews' mechanism."""
        ours = [
            slope
            for slope in self.results.slopes
            if (slope.study, slope.problem, slope.measure) == (STUDY, PROBLEM, "error")
        ]
        return costs(self.results, ours)

    def per_step(self, cure: Cure) -> Any:
        """(points,) operations per step at the three smallest step sizes, or None."""
        slope = self.series(cure.curve(STUDY, PROBLEM, "u", "error"))
        if slope is None:
            return None
        chosen = np.argsort(slope.h)[:3]
        return (self.operations[slope.key] / slope.steps)[chosen]


def _damped(cure: Cure) -> Cure:
    """The cure with dissipation, where corrections are not fed by an alternation."""
    return Cure(cure.name, {**cure.axes, "integrator": DAMPED})


def _smallest(slope: "Slope") -> float:
    return float(slope.values[np.argmin(slope.h)])


def _number(value: float) -> str:
    return f"{value:.1g}".replace("e-0", "e-").replace("e+0", "e")


def _order(slope: "Slope") -> str:
    return format_order(slope.expected)


def _fitted(slope: "Slope") -> str:
    return f"{slope.fit.slope:.1f}".replace("-0.0", "0.0").replace("-", "−")


def _agrees(slope: "Slope") -> bool:
    """Whether a fit is near its order, however few its points are."""
    far = abs(slope.fit.slope - slope.expected) > _FAR
    return slope.verdict != MISS and not (far and np.isfinite(slope.expected))


def _tolerance(found: Evidence, cure: Cure) -> Cell:
    keyed = Cure(cure.name, {k: v for k, v in cure.axes.items() if k != "start"})
    slope = found.series(
        _damped(keyed).curve(TOLERANCE_STUDY, PROBLEM, "newton", "tolerance", stop="absolute 1e-08")
        if "multipliers" not in cure.axes or "projection" in cure.axes
        else _damped(cure.on).curve(
            TOLERANCE_STUDY, PROBLEM, "newton", "tolerance", stop="absolute 1e-08"
        )
    )
    if slope is None:
        return Cell()
    share = _smallest(slope)
    orders = [
        series.expected
        for unknown in ("a", "lambda", "eta")
        for one in (_damped(keyed), keyed)
        if (series := found.series(one.curve(STUDY, PROBLEM, unknown, "correction")))
    ]
    known = [order for order in orders if np.isfinite(order)]
    least = min(known, default=np.nan)
    mark = GOOD if share == 1 else BAD if share < 0.5 else HALF
    return Cell(mark, format_order(least), f"{100 * share:.0f} %", not (least >= 0 and share < 1))


def _condition(found: Evidence, cure: Cure) -> Cell:
    slope = found.series(cure.curve(STUDY, PROBLEM, "jacobian", "condition"))
    if slope is None:
        return Cell()
    mark = GOOD if slope.fit.slope > -0.25 else HALF if slope.fit.slope > -1.5 else BAD
    return Cell(mark, _order(slope), _fitted(slope), _agrees(slope))


def _krylov(found: Evidence, cure: Cure) -> Cell:
    slope = found.series(
        cure.on.curve(
            KRYLOV_STUDY, "random-chain(links=200)", "jacobian", "krylov_iterations",
            linear_solver=GMRES,
        )
    )  # fmt: skip
    if slope is None:
        return Cell()
    order = np.argsort(-slope.h)
    counts = [
        f"{'>' if slope.statuses[i] == 'stagnated' else ''}{slope.values[i]:.0f}"
        for i in (order[0], order[-1])
    ]
    condition = found.series(cure.on.curve(STUDY, PROBLEM, "jacobian", "condition"))
    predicted = ""
    if condition is not None and np.isfinite(condition.expected):
        predicted = "same" if condition.expected >= 0 else "grow"
    low, high = slope.values[order[0]], slope.values[order[-1]]
    stagnated = "stagnated" in slope.statuses
    mark = BAD if stagnated else GOOD if high < 1.3 * low else HALF
    return Cell(mark, predicted, " … ".join(counts), not (predicted == "same" and mark == BAD))


def _error(problem: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        ours = cures.for_problem(cure, problem)
        slope = found.series(ours.curve(STUDY, problem, "lambda", "error"))
        if slope is None:
            return Cell()
        value = _smallest(slope)
        # A corrected start ends at larger steps than the others.
        falling = slope.verdict == PASS and value == np.min(slope.values)
        mark = GOOD if value < 1e-5 or falling else HALF if value < 1e-2 else BAD
        return Cell(mark, _order(slope), _number(value), slope.verdict != MISS)

    return cell


def _floor(evaluation: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        if "start" in cure.axes:
            return Cell()
        if cure.axes.get("multipliers") == "recovered":
            # Nothing that is left of Newton's λ is reported.
            ours = Cure(cure.name, {**cure.axes, "evaluation": evaluation, "integrator": DAMPED})
            slope = found.series(ours.curve(STUDY, PROBLEM, "multiplier", "invariant"))
            return Cell() if slope is None else Cell(GOOD, "0", _number(_smallest(slope)))
        ours = Cure(cure.name, {**cure.axes, "evaluation": evaluation})
        for one in (_damped(ours), ours):
            slope = found.series(one.curve(STUDY, PROBLEM, "lambda", "physical_correction"))
            if slope is not None:
                fitted = slope.fit.slope
                mark = GOOD if fitted > -0.3 else HALF if fitted > -1.5 else BAD
                return Cell(mark, _order(slope), _fitted(slope), _agrees(slope))
        return Cell()

    return cell


def _drift(quantity: str) -> "Callable[[Evidence, Cure], Cell]":
    def cell(found: Evidence, cure: Cure) -> Cell:
        slope = found.series(cure.curve(STUDY, PROBLEM, quantity, "invariant"))
        if slope is None:
            return Cell()
        value = float(np.max(slope.values))
        if value < 1e-11:
            return Cell(GOOD, _order(slope) or "eps", _number(value), slope.verdict != MISS)
        at_end = _smallest(slope)
        # Rounding may leave no two step sizes to fit.
        fitted = _fitted(slope) if np.isfinite(slope.fit.slope) else ""
        measured = ", ".join(filter(None, (fitted, _number(at_end))))
        mark = HALF if slope.fit.slope > 1.5 else BAD
        return Cell(mark, _order(slope), measured, slope.verdict != MISS)

    return cell


def _cost(found: Evidence, cure: Cure) -> Cell:
    ours, plain = found.per_step(cure), found.per_step(CURES[0])
    if ours is None or plain is None or not np.isfinite(ours / plain).any():
        return Cell()
    ratio = float(np.nanmedian(ours / plain))
    mark = GOOD if ratio <= 1.3 else HALF if ratio <= 2 else BAD
    return Cell(mark, "", f"{ratio:.1f}")


SYMPTOMS = (
    Symptom(
        "tolerance",
        "least order of the scaled corrections → steps that meet 1e-8 at the smallest h of "
        f"{TOLERANCE_STUDY}",
        _tolerance,
    ),
    Symptom("C", "condition number: order", _condition),
    Symptom(
        "GMRES", f"iterations at the largest and the smallest h of {KRYLOV_STUDY}", _krylov
    ),
    Symptom(
        "λ, from rest", f"order of the error of λ, {PROBLEM} → error at the smallest h",
        _error(PROBLEM),
    ),
    Symptom("λ, in motion", f"the same, {MOVING}", _error(MOVING)),
    Symptom(
        "λ floor", "order of the last correction of λ in physical units; of recovered λ the "
        "misfit to u and v", _floor("direct"),
    ),
    Symptom("compensated", "the same in compensated evaluation", _floor("compensated")),
    Symptom("drift Φ", "order, and largest relative misfit at the smallest h", _drift("position")),
    Symptom("drift Gᵀv", "the same of the constraints' rate", _drift("velocity")),
    Symptom(
        "cost", "multiplications and additions per step over those of index 3, median of the three "
        "smallest h", _cost,
    ),
    Symptom("needs", "what a problem or you must supply", lambda found, cure: Cell(
        NONE, "", cure.needs)),
)  # fmt: skip


def build(found: "Results") -> dict[tuple[str, str], Cell]:
    """Cells by cure and symptom.

    Raises:
        ResultsError: When the results have no series of the study.
    """
    if all(slope.study != STUDY for slope in found.slopes):
        raise ResultsError(f"no results of {STUDY}; run 'newmark-study run {STUDY}' first")
    evidence = Evidence(found)
    return {
        (cure.name, symptom.name): symptom.cell(evidence, cure)
        for cure in CURES
        for symptom in SYMPTOMS
    }


def grids(cells: Mapping[tuple[str, str], Cell]) -> list[tuple[str, list[tuple[str, ...]]]]:
    """A table for each group: its title, and rows with headings first."""
    return [
        (
            f"Cures: {group}",
            [
                ("cure", *(symptom.name for symptom in SYMPTOMS)),
                *(
                    (cure.name, *(cells[cure.name, symptom.name].text for symptom in SYMPTOMS))
                    for cure in members
                ),
            ],
        )
        for group, members in GROUPS.items()
    ]


def notes() -> list[str]:
    """How to read the table: a line for each column."""
    return [NOTE, *(f"{symptom.name}: {symptom.about}" for symptom in SYMPTOMS)]


def write(folder: Path, cells: Mapping[tuple[str, str], Cell]) -> list[Path]:
    """Write the table as Markdown, LaTeX and CSV below ``tables``; returns the files."""
    files.make_folder(folder / "tables", folder, parents=True)
    stem = folder / "tables" / "cures"
    texts = {
        stem.with_suffix(".md"): as_markdown(cells),
        stem.with_suffix(".tex"): as_latex(cells),
        stem.with_suffix(".csv"): results.csv_text(COLUMNS, _rows(cells)),
    }
    for file, text in texts.items():
        files.write(file, text, folder)
    return list(texts)


def _rows(cells: Mapping[tuple[str, str], Cell]) -> Iterator[dict[str, Any]]:
    for group, members in GROUPS.items():
        for cure in members:
            for symptom in SYMPTOMS:
                cell = cells[cure.name, symptom.name]
                yield {
                    "group": group, "cure": cure.name, "symptom": symptom.name,
                    "mark": {GOOD: "yes", HALF: "partly", BAD: "no"}.get(cell.mark, ""),
                    "predicted": cell.predicted, "measured": cell.measured,
                    "agrees": "yes" if cell.agrees else "no",
                }  # fmt: skip


def as_markdown(cells: Mapping[tuple[str, str], Cell]) -> str:
    """The table of each group, and how to read it."""
    parts = []
    for title, rows in grids(cells):
        lines = ["| " + " | ".join(map(markdown, row)) + " |" for row in rows]
        parts += [f"### {markdown(title)}", "", lines[0], "|" + " --- |" * len(rows[0])]
        parts += [*lines[1:], ""]
    return "\n".join([*parts, *(f"- {markdown(line)}" for line in notes()), ""])


def as_latex(cells: Mapping[tuple[str, str], Cell]) -> str:
    """The table of each group as a journal takes it, as wide as the page."""
    parts = ["% needs \\usepackage{booktabs,graphicx}; glyphs of Unicode: lualatex or xelatex"]
    for group, (_, rows) in zip(GROUPS, grids(cells), strict=True):
        lines = [" & ".join(map(latex_text, row)) + r" \\" for row in rows]
        parts += [
            r"\begin{table}",
            rf"  \caption{{Cures, {latex_text(group)}. {latex_text(NOTE)}}}",
            rf"  \label{{tab:cures-{group.replace(' ', '-')}}}",
            r"  \resizebox{\textwidth}{!}{%",
            rf"  \begin{{tabular}}{{@{{}}{'l' * len(rows[0])}@{{}}}}",
            r"    \toprule",
            f"    {lines[0]}",
            r"    \midrule",
            *(f"    {line}" for line in lines[1:]),
            r"    \bottomrule",
            r"  \end{tabular}}",
            r"\end{table}",
            "",
        ]
    return "\n".join(parts)


# -- as a figure ----------------------------------------------------------------------------

_SHADES = {GOOD: "#CDE9DF", HALF: "#FBE8C4", BAD: "#F6D3C4", NONE: "#FFFFFF"}
#: Inches: height of a line, width of the first column and of the others.
_ROW, _FIRST = 0.155, 1.28
_WIDTHS = {
    "tolerance": 0.66, "C": 0.56, "GMRES": 0.86, "λ, in motion": 0.6, "compensated": 0.6,
    "drift Φ": 0.76, "drift Gᵀv": 0.76, "cost": 0.3, "needs": 1.0,
}  # fmt: skip
_OTHER = 0.56


@dataclass(frozen=True)
class TableScene:
    """The table, drawn cell by cell, in inches.

    Attributes:
        cells: By cure and symptom.
    """

    cells: Mapping[tuple[str, str], Cell]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height (inch)."""
        lines = len(CURES) + len(GROUPS) + 1
        return _FIRST + sum(_width(symptom) for symptom in SYMPTOMS), lines * _ROW

    def draw(self, axes: Any) -> None:
        """Shaded cells under headings, a heading for each group."""
        width, height = self.size
        axes.set_axis_off()
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        y = 0.0
        self._line(axes, y, ["", *(symptom.name for symptom in SYMPTOMS)], bold=True)
        for group, members in GROUPS.items():
            y += _ROW
            axes.text(0.03, y + 0.5 * _ROW, group, va="center", fontsize=6, style="italic")
            for cure in members:
                y += _ROW
                found = [self.cells[cure.name, symptom.name] for symptom in SYMPTOMS]
                shades = ["#FFFFFF", *(_SHADES[cell.mark] for cell in found)]
                self._line(axes, y, [cure.name, *(cell.text for cell in found)], shades)

    def _line(
        self,
        axes: Any,
        y: float,
        texts: Sequence[str],
        shades: Sequence[str] = (),
        bold: bool = False,
    ) -> None:
        x = 0.0
        widths = [_FIRST, *(_width(symptom) for symptom in SYMPTOMS)]
        for place, (text, width) in enumerate(zip(texts, widths, strict=True)):
            if shades:
                axes.fill(
                    [x, x + width, x + width, x], [y, y, y + _ROW, y + _ROW],
                    facecolor=shades[place], edgecolor="white", linewidth=0.8,
                )  # fmt: skip
            written = axes.text(
                x + 0.03, y + 0.5 * _ROW, text.replace("n/a", "·"), va="center",
                fontsize=5.4 if place else 6, weight="bold" if bold else "normal",
            )  # fmt: skip
            written.set_in_layout(False)  # inside the axes, and hundreds to measure
            x += width

    def handles(self) -> Sequence[Any]:
        """None: the marks are in the cells."""
        return ()


def _width(symptom: Symptom) -> float:
    return _WIDTHS.get(symptom.name, _OTHER)


def sheet(figure: "Figure", found: "Results") -> Sheet:
    """The table as one panel.

    Args:
        figure: The figure.
        found: What the table is made from.
    """
    scene = TableScene(build(found))
    width, height = scene.size
    return Sheet(
        figure.title,
        (Panel((), x_scale="linear", y_scale="linear", scene=scene),),
        legend=Legend(),
        panel_size=(width + 0.3, height + 0.35),
        grid=False,
    )
