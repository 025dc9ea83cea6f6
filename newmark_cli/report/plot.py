"""From the results folder to figures."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from newmark_cli.errors import InputError
from newmark_cli.report.figures import FIGURES
from newmark_cli.report.kinds import Figure, Results
from newmark_cli.spelling import nearest
from newmark_cli.study.results import ResultsError


def named(names: Iterable[str]) -> list[Figure]:
    """Figures by their names.

    Raises:
        InputError: For a figure that does not exist.
    """
    found = []
    for name in names:
        if name not in FIGURES:
            raise InputError(f"unknown figure {name!r}{nearest(name, FIGURES)}")
        found.append(FIGURES[name])
    return found


def of_studies(studies: Iterable[str]) -> list[Figure]:
    """Figures of studies, in the order of the figures."""
    given = set(studies)
    return [figure for figure in FIGURES.values() if figure.study in given]


def enough(results: Results) -> tuple[list[Figure], list[Figure]]:
    """Figures that results are enough for, and the others."""
    given, lacking = [], []
    for figure in FIGURES.values():
        try:
            figure.require(results)
        except ResultsError:
            lacking.append(figure)
        else:
            given.append(figure)
    return given, lacking


def how_to_get(lacking: Sequence[Figure]) -> str:
    """What to run for figures, in one line."""
    studies = dict.fromkeys(figure.study for figure in lacking)
    names = ", ".join(figure.name for figure in lacking)
    return (
        f"not drawn: figure{'s' if len(lacking) > 1 else ''} {names}; "
        f"run 'newmark-study run {' '.join(studies)}' first"
    )


def plot(figures: Iterable[Figure], results: Results) -> list[Path]:
    """Draw figures into ``figures`` below the results folder.

    Nothing is written unless all of them can be drawn.

    Args:
        figures: Which.
        results: What they are made from.

    Returns:
        The files.

    Raises:
        ResultsError: When results are missing or cannot be used.
    """
    sheets = {figure.name: figure.sheet(results) for figure in figures}

    from newmark_cli.report import draw, style

    drawings = {name: draw.drawn(sheet) for name, sheet in sheets.items()}
    return [
        file
        for name, drawing in drawings.items()
        for file in style.save(drawing, results.folder / "figures" / f"figure-{name}")
    ]
