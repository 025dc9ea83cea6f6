"""From the results folder to figures, and the table of claims."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from newmark_cli.documents import nearest
from newmark_cli.errors import InputError
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure, SensitivityFigure
from newmark_cli.report.slopes import (
    PASS,
    Slope,
    format_fit,
    format_order,
    in_figure_order,
)
from newmark_cli.study.results import ResultsError


def names(given: Iterable[str]) -> list[str]:
    """Figures asked for; all when none is named.

    Raises:
        InputError: For a figure that does not exist.
    """
    given = list(given)
    for name in given:
        if name not in FIGURES:
            raise InputError(f"unknown figure {name!r}{nearest(name, FIGURES)}")
    return given or list(FIGURES)


def series(
    figure: OrderFigure | SensitivityFigure, slopes: Sequence[Slope], folder: Path
) -> list[Slope]:
    """Series of a figure, in the order of its legend.

    Raises:
        ResultsError: When the results lack one.
    """
    drawn = [slope for slope in slopes if figure.name in slope.figures]
    missing = [v for v in figure.variants if v not in {slope.preconditioning for slope in drawn}]
    if missing:
        raise ResultsError(
            f"{folder / figure.study}.csv: figure {figure.name} needs {', '.join(missing)}; "
            f"run 'newmark-study run {figure.study}' again"
        )
    return sorted(drawn, key=lambda slope: figure.variants.index(slope.preconditioning))


def needs_results(wanted: Iterable[str]) -> bool:
    """Whether a figure reads a study; a mechanism's reads the problem alone."""
    return any(not isinstance(FIGURES[name], MechanismFigure) for name in wanted)


def plot(folder: Path, wanted: Sequence[str], slopes: Sequence[Slope]) -> list[Path]:
    """Draw figures into ``figures`` below the results folder.

    Nothing is written unless all of them can be drawn.

    Args:
        folder: Results folder.
        wanted: Names of figures.
        slopes: Slopes of the results in the folder.

    Returns:
        The files.

    Raises:
        ResultsError: When results are missing or cannot be used.
    """
    entries = [FIGURES[name] for name in wanted]
    data = {
        e.name: series(e, slopes, folder) for e in entries if not isinstance(e, MechanismFigure)
    }

    from newmark_cli.problems.registry import problem
    from newmark_cli.report import draw, draw_mechanism, style

    files = []
    for entry in entries:
        if isinstance(entry, MechanismFigure):
            subject = problem(entry.problem)
            drawing = draw_mechanism.mechanism_figure(entry.title, subject, subject.u0)
        elif isinstance(entry, SensitivityFigure):
            drawing = draw.sensitivity_figure(entry, data[entry.name])
        else:
            drawing = draw.order_figure(entry, data[entry.name])
        files += style.save(drawing, folder / "figures" / f"figure-{entry.name}")
    return files


_HEADINGS = (
    "figure",
    "config",
    "quantity",
    "variant",
    "predicted",
    "fitted",
    "tolerance",
    "verdict",
)


def claimed(slopes: Sequence[Slope]) -> list[Slope]:
    """Slopes that the paper's figures show, in their order."""
    return [
        slope
        for slope in in_figure_order(slopes)
        if any(isinstance(FIGURES[name], OrderFigure) for name in slope.figures)
    ]


def claims(slopes: Sequence[Slope]) -> list[tuple[str, ...]]:
    """Rows of the table of claims, headings first."""
    rows: list[tuple[str, ...]] = [_HEADINGS]
    for slope in slopes:
        where = slope.study if slope.figures else f"{slope.study} {slope.problem} {slope.form}"
        rows.append(
            (
                " ".join(slope.figures),
                where,
                _quantity(slope),
                slope.preconditioning,
                format_order(slope.expected),
                format_fit(slope.fit),
                f"{slope.tolerance:g}",
                slope.verdict,
            )
        )
    return rows


def _quantity(slope: Slope) -> str:
    if not slope.measure:
        return "(failed)"
    symbol = {"lambda": "λ", "jacobian": "C"}.get(slope.quantity, slope.quantity)
    return {
        "correction": f"Δ{symbol}",
        "physical_correction": f"Δ{symbol} (physical)",
        "condition": symbol,
        "sensitivity": f"∂{symbol}/∂b_{slope.row_block}",
    }[slope.measure]


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Columns for a terminal."""
    widths = [max(len(row[c]) for row in rows) for c in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """The same as Markdown."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + " --- |" * len(rows[0]), *lines[1:]])


def summary(slopes: Sequence[Slope]) -> str:
    """How many slopes are as predicted."""
    passed = sum(slope.verdict == PASS for slope in slopes)
    return f"{passed} of {len(slopes)} slopes as predicted"
