"""From the results folder to figures, and the table of claims."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from newmark_cli.errors import InputError
from newmark_cli.report.figures import FIGURES, MechanismFigure, OrderFigure
from newmark_cli.report.slopes import PASS, Slope, collect, format_fit, format_order
from newmark_cli.study.results import ResultsError


def numbers(given: Iterable[str]) -> list[int]:
    """Figures asked for; all when none is named.

    Raises:
        InputError: For a figure that does not exist.
    """
    wanted = []
    for text in given:
        if not text.isdecimal() or int(text) not in FIGURES:
            allowed = ", ".join(map(str, FIGURES))
            raise InputError(f"unknown figure {text!r}; allowed: {allowed}")
        wanted.append(int(text))
    return wanted or list(FIGURES)


def series(figure: OrderFigure, slopes: Sequence[Slope], folder: Path) -> list[Slope]:
    """Series of a figure, in the order of its legend.

    Raises:
        ResultsError: When the results lack one.
    """
    by_variant = {s.preconditioning: s for s in slopes if figure.number in s.figures}
    missing = [variant for variant in figure.variants if variant not in by_variant]
    if missing:
        raise ResultsError(
            f"{folder / figure.study}.csv: figure {figure.number} needs {', '.join(missing)}; "
            f"run 'newmark-study run {figure.study}' again"
        )
    return [by_variant[variant] for variant in figure.variants]


def plot(folder: Path, wanted: Sequence[int]) -> list[Path]:
    """Draw figures into ``figures`` below the results folder.

    Nothing is written unless all of them can be drawn.

    Args:
        folder: Results folder with the CSVs.
        wanted: Numbers of figures.

    Returns:
        The files.

    Raises:
        ResultsError: When results are missing or cannot be used.
    """
    entries = [FIGURES[number] for number in wanted]
    studies = dict.fromkeys(e.study for e in entries if isinstance(e, OrderFigure))
    slopes = collect(folder, studies)
    data = {e.number: series(e, slopes, folder) for e in entries if isinstance(e, OrderFigure)}

    from newmark_cli.problems.registry import problem
    from newmark_cli.report import draw

    files = []
    for entry in entries:
        if isinstance(entry, MechanismFigure):
            drawing = draw.mechanism_figure(entry, problem(entry.problem).drawing)
        else:
            drawing = draw.order_figure(entry, data[entry.number])
        files += draw.save(drawing, folder / "figures" / f"figure-{entry.number}")
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


def claims(slopes: Sequence[Slope]) -> list[tuple[str, ...]]:
    """Rows of the table of claims, headings first."""
    rows: list[tuple[str, ...]] = [_HEADINGS]
    for slope in slopes:
        symbol = {"lambda": "λ", "jacobian": "C"}.get(slope.quantity, slope.quantity)
        unit = " (physical)" if slope.measure == "physical_correction" else ""
        where = slope.study if slope.figures else f"{slope.study} {slope.problem} {slope.form}"
        rows.append(
            (
                " ".join(map(str, slope.figures)),
                where,
                f"{symbol}{unit}" if slope.measure == "condition" else f"Δ{symbol}{unit}",
                slope.preconditioning,
                format_order(slope.expected),
                format_fit(slope.fit),
                f"{slope.tolerance:g}",
                slope.verdict,
            )
        )
    return rows


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
