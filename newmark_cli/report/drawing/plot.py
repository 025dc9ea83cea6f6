"""From the results folder to figures: which are meant, which can be drawn, and their files."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from newmark_cli.report.drawing import automatic
from newmark_cli.report.drawing.panels import Sheet
from newmark_cli.report.drawing.sheets import Results, require, sheet
from newmark_cli.report.drawing.work import COSTS
from newmark_cli.report.reading import records
from newmark_cli.report.reading.choosing import Choice
from newmark_cli.report.reading.figures import FIGURES, TABLED, Figure, of_study
from newmark_cli.study.drawing import WORK_PRECISION
from newmark_cli.study.figure_keys import FigureConfig, definitions
from newmark_cli.support.errors import InputError, ResultsError
from newmark_cli.support.spelling import nearest

#: Most figures that are named where not all are drawn.
NAMED = 8


@dataclass(frozen=True)
class Chosen:
    """Figures to draw, and what there is to say of them."""

    figures: list[Figure]  #: in their order
    notes: list[str]  #: lines for the terminal


#: Whatever there is.
ANY = Choice()


def chosen(names: Sequence[str], results: Results, choice: Choice = ANY) -> Chosen:
    """Figures that are meant by names, or all that the results are enough for.

    A name of a figure and a study is the figure's; named mechanisms need no series.
    """
    studies = list(dict.fromkeys(slope.study for slope in results.slopes))
    choice.require(results.slopes)
    notes: list[str] = []
    if names:
        numbered = _numbered(studies, results)
        figures = [
            figure
            for name in dict.fromkeys(names)
            for figure in _named(name, numbered, studies, results, choice, notes)
        ]
    else:
        figures = _every(studies, results, choice, notes)
    if choice and not figures:
        why = f" ({COSTS[results.cost].lacking})" if WORK_PRECISION in choice.kinds else ""
        raise InputError(f"nothing to draw: no figure has all that the options choose{why}")
    if names and not figures:
        raise InputError(f"nothing to draw of {', '.join(names)}: no series has two step sizes")
    return Chosen(list({id(figure): figure for figure in figures}.values()), notes)


def _named(
    name: str,
    numbered: Mapping[str, Sequence[Figure]],
    studies: Sequence[str],
    results: Results,
    choice: Choice,
    notes: list[str],
) -> list[Figure]:
    """Figures that a name stands for: a figure, a study, or one figure of a study."""
    if name in numbered:
        figures = numbered[name]
        if name in studies and all(figure.study != name for figure in figures):
            notes.append(f"{name!r} is a figure and a study: the figure is drawn")
        return [figure for figure in figures if _whole(figure, choice)]
    if name in studies:
        return _of_study(name, results, choice, notes)
    ours = (study for study in studies if name.startswith(f"{study}-"))
    every = Choice(everything=True)
    several = (figure for study in ours for figure in _of_study(study, results, every, []))
    if same := [figure for figure in several if stem(figure) == name]:
        return same
    raise _unknown(name, studies, results)


def _every(
    studies: Sequence[str], results: Results, choice: Choice, notes: list[str]
) -> list[Figure]:
    """All figures that the results suffice for."""
    there, lacking = enough(results)
    figures = [figure for figure in there if _whole(figure, choice)]
    shipped = {slope.study for slope in results.slopes if slope.shipped}
    for study in studies:
        # Only when they are asked for: the paper makes tables of them.
        is_tabled = study in TABLED and not choice
        if study not in shipped or not (of_studies([study]) or is_tabled):
            figures += _of_study(study, results, choice, notes)
    with_figures = {*TABLED, *(figure.study for figure in FIGURES.values())}
    if lacking and not choice and (not figures or with_figures & shipped):
        notes.append(how_to_get(lacking))
    return figures


def _unknown(name: str, studies: Sequence[str], results: Results) -> InputError:
    shipped = dict.fromkeys((*(figure.study for figure in FIGURES.values()), *TABLED))
    if name in shipped:
        path = results.folder / f"{name}.csv"
        return ResultsError(f"{path}: no results; run 'newmark-study run {name}' first")
    if name == "19":
        return InputError("19 is a table, made by 'newmark-study tables cures'")
    known = dict.fromkeys((*FIGURES, *studies))
    return InputError(f"unknown figure or study {name!r}{nearest(name, known)}")


def needs_results(names: Sequence[str], folder: Path) -> bool:
    """Whether figures are made from series; mechanisms are drawn without any."""
    if not names or any(name not in FIGURES or FIGURES[name].curves for name in names):
        return True
    studies = [file.stem for file in folder.glob("*.csv")]
    own = (figure for figure in _own(studies, folder) if figure.name in names)
    return any(figure is not FIGURES.get(figure.name) for figure in own)


def _whole(figure: Figure, choice: Choice) -> bool:
    """Whether a figure of the project shows only chosen series."""
    takes = (choice.takes(curve.key) for curve in figure.curves)
    return not choice or (bool(figure.curves) and all(takes))


def _of_study(study: str, results: Results, choice: Choice, notes: list[str]) -> list[Figure]:
    """The project's figures of a study, else those of its config, else those it arranges.

    Where those that a config defines do not show what is chosen, others do.
    """
    figures = [figure for figure in _own([study], results.folder) if _whole(figure, choice)]
    if figures and figures[0] in FIGURES.values():
        return figures
    defined = _defined(study, results)
    figures += automatic.figures(study, results, defined, choice.keeps, choice.kinds)
    if not figures and defined:
        figures = automatic.figures(study, results, None, choice.keeps, choice.kinds)
    if defined is None and not choice and not choice.everything:
        few: dict[tuple[str, str], Figure] = {}
        for figure in figures:
            first = figure.curves[0]
            if figure.kind == "orders" and first.measure not in automatic.LAST:
                few.setdefault((first.measure, first.quantity), figure)
        rest = [stem(figure) for figure in figures if figure not in few.values()]
        if few and rest:
            more = f" and {len(rest) - NAMED} more" if len(rest) > NAMED else ""
            notes.append(
                f"{study}: not drawn: {', '.join(rest[:NAMED])}{more}; name one, choose with "
                "--measure, --form, …, or draw all with --all"
            )
            figures = list(few.values())
    return figures


def _defined(study: str, results: Results) -> Sequence[FigureConfig] | None:
    """Figures in the recorded config of a study."""
    path = results.folder / f"{study}.csv"
    try:
        return definitions(records.known(path).get("config"))
    except ValueError as error:
        raise ResultsError(f"{path.with_suffix('.json')}: {error}") from None


def _own(studies: Iterable[str], folder: Path) -> Iterator[Figure]:
    """Figures with a number or word of studies in a folder."""
    for study in studies:
        path = folder / f"{study}.csv"
        try:
            yield from of_study(study, records.known(path).get("config"))
        except ValueError as error:
            raise ResultsError(f"{path.with_suffix('.json')}: {error}") from None


def _numbered(studies: Sequence[str], results: Results) -> dict[str, list[Figure]]:
    """Figures by number or word: those of the studies that are there, else the shipped ones."""
    named: dict[str, list[Figure]] = {}
    for figure in _own(studies, results.folder):
        named.setdefault(figure.name, []).append(figure)
    return {name: [figure] for name, figure in FIGURES.items()} | named


def of_studies(studies: Collection[str]) -> list[Figure]:
    """The project's figures of studies, in the order of the figures."""
    return [figure for figure in FIGURES.values() if figure.study in studies]


def enough(results: Results) -> tuple[list[Figure], list[Figure]]:
    """The project's figures that results are enough for, and the others."""
    namesakes = {slope.study for slope in results.slopes if not slope.shipped}
    there = []
    for figure in FIGURES.values():
        if not figure.curves or figure.study not in namesakes:
            with suppress(ResultsError):
                require(figure, results)
                there.append(figure)
    return there, [figure for figure in FIGURES.values() if figure not in there]


def how_to_get(lacking: Sequence[Figure]) -> str:
    """The studies to run for figures, in one line."""
    studies = dict.fromkeys(figure.study for figure in lacking)
    names = ", ".join(figure.name for figure in lacking)
    return (
        f"not drawn: figure{'s' if len(lacking) > 1 else ''} {names}; "
        f"run 'newmark-study run {' '.join(studies)}' first"
    )


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

    settings = style.read(style_file) if style_file else style.NONE
    contents: dict[str, bytes] = {}
    try:
        for name, plain in sheets.items():
            drawing = draw.drawn(plain, size, settings)
            for kind in formats:
                contents[f"{name}.{kind}"] = style.rendered(drawing, kind, settings)
    except (LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        if style_file is None:
            raise
        raise InputError(f"--style {style_file}: cannot be drawn with: {error}") from None
    return style.save(contents, results.folder)
