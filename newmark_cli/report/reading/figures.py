"""Figures as data: a study, a kind, and panels with named series.

The shipped configs define those of the paper and past it, with a number; any config may define
others.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

from newmark_cli.study import entries, shipped
from newmark_cli.study.axes import SeriesKey, means, value_text
from newmark_cli.study.entries import CurveConfig, FigureConfig


class Curve:
    """One series, and its name in a legend; every axis is an attribute, as in the CSV.

    Attributes:
        label: Name in a legend and in claims.
        named: Axes that were named besides study, problem, quantity and measure.
        key: What finds the series.
    """

    def __init__(
        self, label: str, study: str, problem: str, quantity: str, measure: str, **axes: str
    ) -> None:
        """Take a label and axes; the (u, λ) form without scaling unless they say otherwise."""
        usual = {"form": "u-lambda", "preconditioning": "none"}
        where = {"study": study, "problem": problem, "quantity": quantity, "measure": measure}
        self.label, self.named = label, frozenset(axes)
        self.key = SeriesKey.of(usual | where | axes)

    def __getattr__(self, name: str) -> str:
        if name == "key":
            raise AttributeError(name)
        return str(getattr(self.key, name))


@dataclass(frozen=True)
class Part:
    """A panel: its series in the order of the legend, and what tells it from others."""

    #: Values of the axes that tell panels apart, and the group of its series.
    titles: tuple[str, ...]
    curves: tuple[Curve, ...]  #: its series
    group: str = ""  #: what its series have in common that those of other panels have not

    @property
    def title(self) -> str:
        """Its titles in one line."""
        return ", ".join(filter(None, self.titles))


@dataclass(frozen=True)
class Figure:
    """What a figure shows."""

    name: str  #: number, or a word; names its files
    title: str  #: what it shows
    study: str  #: study whose results it reads
    parts: tuple[Part, ...]  #: its panels
    columns: int = 1  #: panels side by side
    kind: str = "orders"  #: one of `newmark_cli.study.showable.KINDS`
    problem: str = ""  #: the mechanism, of a picture of one
    note: str = ""  #: what stands above the legend
    h: float | None = None  #: step size of values over time (s)
    #: Largest |fitted − predicted slope| of its series; None for that of their measure.
    tolerance: float | None = None
    in_paper: bool = False  #: whether `check` lists its series first, as the claims of the paper
    numbered: bool = False  #: whether a config gives it a number or word, by which `plot` knows it
    #: Label of a series → what a config says of its look.
    looks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    style: Mapping[str, Any] = field(default_factory=dict)  #: settings of matplotlib

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        return tuple(curve for part in self.parts for curve in part.curves)


def label_of(definition: FigureConfig, axis: str, value: str) -> str:
    """A value of an axis as a definition names it, or as people write it."""
    labels = (text for word, text in (definition.labels or {}).items() if means(axis, word, value))
    return next(labels, value_text(axis, value))


def curve_of(definition: FigureConfig, axes: Iterable[str], where: Mapping[str, str]) -> Curve:
    """A series that a definition shows, named by axes."""
    labels = [label_of(definition, axis, where[axis]) for axis in axes if where.get(axis)]
    return Curve(", ".join(labels), **where)


def looks_of(definition: FigureConfig, curves: Iterable[Curve]) -> dict[str, Mapping[str, str]]:
    """Label of a series → the colour and the marker that a definition gives it."""
    colors = {
        curve.label: {"color": color}
        for curve in curves
        for word, color in (definition.colors or {}).items()
        if word == curve.label
        or any(means(axis, word, value) for axis, value in curve.key.named().items() if value)
    }
    return colors | {line.label: line.look for line in definition.curves or () if line.look}


def side_by_side(panels: int) -> int:
    """How many of so many panels stand side by side."""
    return {1: 1, 2: 1, 4: 2}.get(panels, 3)


def figure_of(
    definition: FigureConfig, name: str, title: str, study: str, parts: tuple[Part, ...], **own: Any
) -> Figure:
    """A figure of these panels that looks as a definition says."""
    return Figure(
        name,
        title,
        study,
        parts,
        kind=definition.drawn_as,
        note=definition.note or "",
        h=definition.h,
        looks=looks_of(definition, (curve for part in parts for curve in part.curves)),
        style=definition.style or {},
        **own,
    )


def explicit(study: str, definition: FigureConfig) -> Figure:
    """The figure of a definition that names all its series."""
    kind = definition.drawn_as
    measure = "error" if kind == "work" else next(iter(definition.kinds), "")
    parts = tuple(_parts(definition, {"study": study, "measure": measure}))
    return figure_of(
        definition,
        definition.figure,
        definition.heading or "",
        study,
        parts,
        columns=definition.columns or side_by_side(len(parts)),
        problem=definition.choice.get("problem", ("",))[0],
        tolerance=definition.within,
        in_paper=definition.within is not None and definition.figure.isdigit(),
        numbered=True,
    )


def _parts(definition: FigureConfig, of_all: Mapping[str, str]) -> Iterator[Part]:
    """Panels: one for each combination of panel axes and group of series."""
    lines = definition.curves or ((CurveConfig.model_construct(),) if definition.series else ())
    groups = dict.fromkeys(line.panel or "" for line in lines)
    # Where groups share no label, each has a legend of its own.
    labels = {(line.panel, line.label) for line in lines}
    apart = len(labels) == len({line.label for line in lines})
    axes = definition.panels or ()
    for *values, group in product(*(definition.choice[axis] for axis in axes), groups):
        at = dict(zip(axes, values, strict=True))
        ours = (line for line in lines if (line.panel or "") == group)
        curves = tuple(c for line in ours for c in _curves(definition, line, at, of_all))
        titles = (*(label_of(definition, *of_axis) for of_axis in at.items()), group)
        if curves:
            yield Part(tuple(filter(None, titles)), curves, group if apart else "")


def _curves(
    definition: FigureConfig, line: CurveConfig, at: Mapping[str, str], of_all: Mapping[str, str]
) -> Iterator[Curve]:
    """Series of a line in the panel at these values of axes."""
    choice = {**definition.choice, **line.choice}
    if all(value in choice[axis] for axis, value in at.items()):
        choice |= {axis: (value,) for axis, value in at.items()}
        for values in product(*choice.values()):
            where = {**of_all, **dict(zip(choice, values, strict=True))}
            curve = curve_of(definition, definition.series or (), where)
            curve.label = line.label or curve.label
            yield curve


def _shipped() -> dict[str, Figure]:
    figures = [
        explicit(study, definition)
        for study, data in shipped.configs().items()
        for definition in entries.figures(data)
        if definition.figure
    ]
    figures.sort(key=lambda figure: place(figure.name))
    return {figure.name: figure for figure in figures}


def place(name: str) -> tuple[float, str]:
    """What figures are sorted by: numbers by their size, a word behind those of the paper."""
    return float(name) if name.isdecimal() else 9.5, name


#: The figures of the shipped studies by name.
FIGURES: dict[str, Figure] = _shipped()


def of_study(study: str, config: Any) -> list[Figure]:
    """Figures with a number or word: of a shipped study its own, else those of a recorded config.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    if shipped.is_shipped(study, config):
        return [figure for figure in FIGURES.values() if figure.study == study]
    return [explicit(study, defined) for defined in entries.figures(config) if defined.figure]


#: Shipped studies that are made into tables: figures of them are drawn when asked for.
TABLED = ("all-forms", "integrators")
