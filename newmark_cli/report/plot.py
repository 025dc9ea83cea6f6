"""From the results folder to figures."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from newmark_cli.errors import InputError
from newmark_cli.report.figures import (
    FIGURES,
    Figure,
    HistoryFigure,
    MechanismFigure,
    SeriesFigure,
)
from newmark_cli.report.history import History, read_histories
from newmark_cli.report.slopes import Slope
from newmark_cli.spelling import nearest
from newmark_cli.study.results import ResultsError, history_path

if TYPE_CHECKING:
    from newmark_cli.report.style import Drawing


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


def of_studies(studies: Iterable[str]) -> list[str]:
    """Figures that studies are enough for."""
    enough = set(studies)
    return [
        name
        for name, figure in FIGURES.items()
        if isinstance(figure, MechanismFigure) or figure.study in enough
    ]


def series(figure: SeriesFigure, slopes: Sequence[Slope], folder: Path) -> list[Slope]:
    """Series of a figure, in the order of its curves.

    Raises:
        ResultsError: When the results lack one.
    """
    found = {slope.key: slope for slope in slopes}
    missing = [curve.label for curve in figure.curves if curve.key not in found]
    if missing:
        raise _lacks(folder / f"{figure.study}.csv", figure, missing)
    return [found[curve.key] for curve in figure.curves]


def histories(figure: HistoryFigure, folder: Path) -> list[History]:
    """Time series of a figure, in the order of its curves.

    Raises:
        ResultsError: When the results lack one.
    """
    found = read_histories(folder, figure.study, figure.curves, figure.h)
    given = [history for history in found if history is not None]
    if len(given) < len(found):
        missing = [c.label for c, there in zip(figure.curves, found, strict=True) if not there]
        raise _lacks(history_path(folder, figure.study), figure, missing)
    return given


def _lacks(
    path: Path, figure: SeriesFigure | HistoryFigure, missing: Iterable[str]
) -> ResultsError:
    return ResultsError(
        f"{path}: figure {figure.name} needs {', '.join(dict.fromkeys(missing))}; "
        f"run 'newmark-study run {figure.study}' again"
    )


def needs_results(wanted: Iterable[str]) -> bool:
    """Whether a figure reads a study; a mechanism's reads the problem alone."""
    return any(not isinstance(FIGURES[name], MechanismFigure) for name in wanted)


def without_data(wanted: Iterable[str], slopes: Sequence[Slope], folder: Path) -> list[str]:
    """Figures that the results are not enough for."""
    lacking = []
    for name in wanted:
        figure = FIGURES[name]
        try:
            if isinstance(figure, HistoryFigure):
                histories(figure, folder)
            elif not isinstance(figure, MechanismFigure):
                series(figure, slopes, folder)
        except ResultsError:
            lacking.append(name)
    return lacking


def how_to_get(lacking: Sequence[str]) -> str:
    """What to run for figures, in one line."""
    needed = (FIGURES[name] for name in lacking)
    studies = dict.fromkeys(f.study for f in needed if not isinstance(f, MechanismFigure))
    figures = f"figure{'s' if len(lacking) > 1 else ''} {', '.join(lacking)}"
    return f"not drawn: {figures}; run 'newmark-study run {' '.join(studies)}' first"


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
    drawings = {name: drawing(FIGURES[name], slopes, folder) for name in wanted}

    from newmark_cli.report import style

    return [
        file
        for name, drawn in drawings.items()
        for file in style.save(drawn, folder / "figures" / f"figure-{name}")
    ]


def drawing(figure: Figure, slopes: Sequence[Slope], folder: Path) -> "Drawing":
    """Draw one figure.

    Args:
        figure: Which.
        slopes: Slopes of the results in the folder.
        folder: Results folder, for time series.

    Raises:
        ResultsError: When results are missing or cannot be used.
    """
    from newmark_cli.mechanisms.registry import problem
    from newmark_cli.report import draw, draw_mechanism

    if isinstance(figure, MechanismFigure):
        subject = problem(figure.problem)
        return draw_mechanism.mechanism_figure(figure.title, subject, subject.u0)
    if isinstance(figure, HistoryFigure):
        return draw.history_figure(figure, histories(figure, folder))
    return draw.figure_of(figure, series(figure, slopes, folder))
