"""Figures as data: a study, a kind, and panels with named series.

The shipped configs define those of the paper and past it, with a number; any config may define
others.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any

from newmark_cli.report.reading.curves import Curve
from newmark_cli.report.reading.words import means, value_text
from newmark_cli.study import shipped
from newmark_cli.study.drawing import WORK_PRECISION, Definition, Line, definitions


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
    kind: str = "orders"  #: one of `newmark_cli.study.drawing.KINDS`
    problem: str = ""  #: the mechanism, of a picture of one
    note: str = ""  #: what stands above the legend
    h: float | None = None  #: step size of values over time (s)
    #: Largest |fitted − predicted slope| of its series; None for that of their measure.
    tolerance: float | None = None
    in_paper: bool = False  #: whether its series are the claims of the paper
    numbered: bool = False  #: whether a config gives it a number or word, by which `plot` knows it
    #: Label of a series → what a config says of its look.
    looks: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    style: Mapping[str, Any] = field(default_factory=dict)  #: settings of matplotlib

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        return tuple(curve for part in self.parts for curve in part.curves)


def label_of(given: Definition, axis: str, value: str) -> str:
    """A value of an axis as a definition names it, or as people write it."""
    named = (text for word, text in given.labels.items() if means(axis, word, value))
    return next(named, value_text(axis, value))


def curve_of(given: Definition, names: Iterable[str], where: Mapping[str, str]) -> Curve:
    """A series that a definition shows, named by axes."""
    labels = [label_of(given, axis, where[axis]) for axis in names if where.get(axis)]
    return Curve(", ".join(labels), **where)


def looks_of(given: Definition, curves: Iterable[Curve]) -> dict[str, Mapping[str, str]]:
    """Label of a series → the colour and the marker that a definition gives it."""
    lines = {line.label: line.look for line in given.curves if line.look}
    colors = {
        curve.label: {"color": color}
        for curve in curves
        for word, color in given.colors.items()
        if word == curve.label
        or any(means(axis, word, value) for axis, value in curve.key.named().items() if value)
    }
    return colors | lines


def explicit(study: str, given: Definition) -> Figure:
    """The figure of a definition that names all its series."""
    kind = given.kind or ("work" if given.kinds == (WORK_PRECISION,) else "orders")
    measure = "error" if kind == "work" else given.kinds[0] if given.kinds else ""
    lines = given.curves or ((Line(),) if given.series else ())
    parts: dict[tuple[str, ...], list[Curve]] = {}
    several = given.panels or ()
    groups = dict.fromkeys(line.panel for line in lines)
    for at in product(*(given.choice[axis] for axis in several)):
        for group in groups:
            for line in lines:
                values = {**given.choice, **line.choice}
                there = all(v in values[a] for a, v in zip(several, at, strict=True))
                if line.panel != group or not there:
                    continue
                values |= {axis: (value,) for axis, value in zip(several, at, strict=True)}
                for named in product(*values.values()):
                    where = dict(zip(values, named, strict=True))
                    where = {"study": study, "measure": measure, **where}
                    curve = curve_of(given, given.series or (), where)
                    curve.label = line.label or curve.label
                    parts.setdefault((*at, group), []).append(curve)
    labels = {group: {line.label for line in lines if line.panel == group} for group in groups}
    apart = sum(map(len, labels.values())) == len(set().union(*labels.values()))
    titles = {
        key: tuple(
            filter(
                None, (*(label_of(given, *at) for at in zip(several, key, strict=False)), key[-1])
            )
        )
        for key in parts
    }
    columns = given.columns or {1: 1, 2: 1, 4: 2}.get(len(parts), 3)
    return Figure(
        given.figure,
        given.title or "",
        study,
        tuple(
            Part(titles[key], tuple(curves), key[-1] if apart else "")
            for key, curves in parts.items()
        ),
        columns,
        kind,
        given.choice.get("problem", ("",))[0],
        given.note,
        given.h,
        given.within,
        in_paper=given.within is not None and given.figure.isdigit(),
        numbered=True,
        looks=looks_of(given, (curve for curves in parts.values() for curve in curves)),
        style=given.style,
    )


def _shipped() -> dict[str, Figure]:
    found = [
        explicit(study, definition)
        for study, data in shipped.configs().items()
        for definition in definitions(data) or ()
        if definition.figure
    ]
    return {
        figure.name: figure
        for figure in sorted(found, key=lambda each: (_place(each.name), each.name))
    }


def _place(name: str) -> float:
    """Numbers by their size; a word behind those of the paper."""
    return float(name) if name.isdigit() else 9.5


#: The figures of the shipped studies by name.
FIGURES: dict[str, Figure] = _shipped()

#: Shipped studies that are made into tables: figures of them are drawn when asked for.
TABLED = ("all-forms", "integrators")
