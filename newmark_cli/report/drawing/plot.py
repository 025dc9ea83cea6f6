"""From the results folder to figures: which are meant, which can be drawn, and their files."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

from newmark_cli.report.drawing import automatic
from newmark_cli.report.drawing.panels import Sheet
from newmark_cli.report.drawing.sheets import COSTS, Results, require, sheet
from newmark_cli.report.reading import records
from newmark_cli.report.reading.choosing import Choice
from newmark_cli.report.reading.figures import FIGURES, TABLED, Figure, of_study
from newmark_cli.study import entries
from newmark_cli.study.showable import WORK_PRECISION
from newmark_cli.support.errors import InputError, ResultsError
from newmark_cli.support.spelling import nearest

Kept = TypeVar("Kept")

#: Most figures that are named where not all are drawn.
NAMED = 8


#: Whatever there is, but few of the figures that a study arranges itself.
ANY = Choice()


@dataclass(frozen=True)
class Chosen:
    """Figures to draw, and what there is to say of them."""

    results: Results
    choice: Choice
    figures: list[Figure] = field(default_factory=list)  #: in their order
    notes: list[str] = field(default_factory=list)  #: lines for the terminal

    @cached_property
    def studies(self) -> list[str]:
        """Studies that there are results of."""
        return list(dict.fromkeys(slope.study for slope in self.results.slopes))

    def named(self, name: str) -> list[Figure]:
        """Figures that a name stands for: a figure, a study, or one figure of a study."""
        # By number or word: those of the studies that are there, else the shipped ones.
        own = [figure for figure in _own(self.studies, self.results) if figure.name == name]
        if figures := own or [figure for figure in FIGURES.values() if figure.name == name]:
            if name in self.studies and all(figure.study != name for figure in figures):
                self.notes.append(f"{name!r} is a figure and a study: the figure is drawn")
            return list(filter(self._is_whole, figures))
        if name in self.studies:
            return self.of_study(name)
        every = Chosen(self.results, Choice(everything=True))
        ours = (study for study in self.studies if name.startswith(f"{study}-"))
        several = (figure for study in ours for figure in every.of_study(study))
        if same := [figure for figure in several if stem(figure) == name]:
            return same
        raise self._unknown(name)

    def every(self) -> list[Figure]:
        """All figures that the results suffice for."""
        shipped = {slope.study for slope in self.results.slopes if slope.shipped}
        there = list(filter(self._suffices_for, FIGURES.values()))
        figures = list(filter(self._is_whole, there))
        for study in self.studies:
            # Only when they are asked for: the paper makes tables of them.
            is_tabled = study in TABLED and not self.choice
            if study not in shipped or not (of_studies([study]) or is_tabled):
                figures += self.of_study(study)
        lacking = [figure for figure in FIGURES.values() if figure not in there]
        with_figures = {*TABLED, *(figure.study for figure in FIGURES.values())}
        if lacking and not self.choice and (not figures or with_figures & shipped):
            numbers = ", ".join(figure.name for figure in lacking)
            self.notes.append(
                f"not drawn: figure{'s' if len(lacking) > 1 else ''} {numbers}; run 'newmark-study "
                f"run {' '.join(dict.fromkeys(figure.study for figure in lacking))}' first"
            )
        return figures

    def of_study(self, study: str) -> list[Figure]:
        """The project's figures of a study, else those of its config, else those it arranges.

        Where those that a config defines do not show what is chosen, others do.
        """
        own = _own([study], self.results)
        figures = [figure for figure in own if self._is_whole(figure)]
        if figures and figures[0] in FIGURES.values():
            return figures
        defined = _recorded(study, self.results, entries.figures) or None
        keep = self.choice.keeps, self.choice.kinds
        figures += automatic.figures(study, self.results, defined, *keep)
        if not figures and defined:
            figures = automatic.figures(study, self.results, None, *keep)
        return self._few(study, figures) if defined is None else figures

    def _few(self, study: str, figures: list[Figure]) -> list[Figure]:
        """One for each measure and quantity of those that a study arranges, unless asked for."""
        few: dict[tuple[str, str], Figure] = {}
        for figure in figures:
            first = figure.curves[0]
            if figure.kind != "work" and first.measure not in automatic.LAST:
                few.setdefault((first.measure, first.quantity), figure)
        rest = [stem(figure) for figure in figures if figure not in few.values()]
        if self.choice or self.choice.everything or not few or not rest:
            return figures
        more = f" and {len(rest) - NAMED} more" if len(rest) > NAMED else ""
        self.notes.append(
            f"{study}: not drawn: {', '.join(rest[:NAMED])}{more}; name one, choose with "
            "--measure, --form, …, or draw all with --all"
        )
        return list(few.values())

    def _is_whole(self, figure: Figure) -> bool:
        """Whether a figure of the project shows only chosen series."""
        takes = (self.choice.takes(curve.key) for curve in figure.curves)
        return not self.choice or (bool(figure.curves) and all(takes))

    def _suffices_for(self, figure: Figure) -> bool:
        """Whether the results are enough for a figure of the project."""
        if figure.curves and any(
            slope.study == figure.study and not slope.shipped for slope in self.results.slopes
        ):
            return False
        try:
            require(figure, self.results)
        except ResultsError:
            return False
        return True

    def _unknown(self, name: str) -> InputError:
        shipped = dict.fromkeys((*(figure.study for figure in FIGURES.values()), *TABLED))
        if name in shipped:
            path = self.results.folder / f"{name}.csv"
            return ResultsError(f"{path}: no results; run 'newmark-study run {name}' first")
        if name == "19":
            return InputError("19 is a table, made by 'newmark-study tables cures'")
        known = dict.fromkeys((*FIGURES, *self.studies))
        return InputError(f"unknown figure or study {name!r}{nearest(name, known)}")


def chosen(names: Sequence[str], results: Results, choice: Choice = ANY) -> Chosen:
    """Figures that are meant by names, or all that the results are enough for.

    A name of a figure and a study is the figure's; named mechanisms need no series.
    """
    choice.require(results.slopes)
    found = Chosen(results, choice)
    for figure in (
        [f for name in dict.fromkeys(names) for f in found.named(name)] if names else found.every()
    ):
        if not any(figure is other for other in found.figures):
            found.figures.append(figure)
    if choice and not found.figures:
        why = f" ({COSTS[results.cost].lacking})" if WORK_PRECISION in choice.kinds else ""
        raise InputError(f"nothing to draw: no figure has all that the options choose{why}")
    if names and not found.figures:
        raise InputError(f"nothing to draw of {', '.join(names)}: no series has two step sizes")
    return found


def needs_results(names: Sequence[str], folder: Path) -> bool:
    """Whether figures are made from series; mechanisms are drawn without any."""
    if not names or any(name not in FIGURES or FIGURES[name].curves for name in names):
        return True
    studies = [file.stem for file in folder.glob("*.csv")]
    own = (figure for figure in _own(studies, Results(folder, ())) if figure.name in names)
    return any(figure is not FIGURES.get(figure.name) for figure in own)


def _own(studies: Iterable[str], results: Results) -> Iterator[Figure]:
    """Figures with a number or word of studies."""
    for study in studies:
        yield from _recorded(study, results, partial(of_study, study))


def _recorded(study: str, results: Results, read: Callable[[Any], Kept]) -> Kept:
    """Figures in the recorded config of a study, as they are read there."""
    path = results.folder / f"{study}.csv"
    return records.told(path, read, results.record(study).get("config"))


def of_studies(studies: Collection[str]) -> list[Figure]:
    """The project's figures of studies, in the order of the figures."""
    return [figure for figure in FIGURES.values() if figure.study in studies]


def stem(figure: Figure) -> str:
    """Name of a figure's files, without their ending."""
    return f"figure-{figure.name}" if figure.numbered else figure.name


def plot(
    figures: Iterable[Figure],
    results: Results,
    formats: Sequence[str] = ("png",),
    size: tuple[float, float | None] | None = None,
    style_file: Path | None = None,
) -> list[Path]:
    """Draw figures into ``figures`` below the results folder, all of them or none.

    Args:
        formats: Of png, svg and pdf.
        size: Width and height of each (inch); as suits it when omitted, or None.
        style_file: Style file of matplotlib, over the project's style.
    """
    sheets: dict[str, Sheet] = {}
    for figure in figures:
        sheets[automatic.free(stem(figure), sheets)] = sheet(figure, results)

    from newmark_cli.report.drawing import draw, style

    contents: dict[str, bytes] = {}
    with style.of_file(style_file) as settings:
        for name, plain in sheets.items():
            drawing = draw.drawn(plain, size, settings)
            # its own settings again: some, such as savefig.dpi, count when a file is written
            own = {**style.checked(plain.settings), **settings}
            for kind in formats:
                contents[f"{name}.{kind}"] = style.rendered(drawing, kind, own)
    return style.save(contents, results.folder)
