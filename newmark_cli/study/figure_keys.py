"""The key `figures` of a study config: its models, by which records are read, too."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, Strict, TypeAdapter, create_model
from pydantic_core import PydanticCustomError

from newmark_cli.study import axes, drawing
from newmark_cli.study.expecting import choice_of, chosen, optional, recorded, unknown
from newmark_cli.study.keys import (
    Compared,
    Forms,
    Name,
    OneLine,
    OneOrMore,
    Positive,
    Quantities,
    RowBlocks,
    Showable,
    Word,
)
from newmark_cli.support.documents import WHOLE, RuledModel, misfit

_MOST_FIGURES, _MOST_CURVES = 100, 200
#: Values of an axis → a text for each.
Texts = dict[Annotated[str, Strict()], OneLine]
#: Values of settings of matplotlib; of a cycle, lists by property.
_Setting = Annotated[str, Strict()] | bool | float
Style = dict[
    Annotated[
        str, Field(pattern=r"^(axes|figure|font|grid|legend|lines|mathtext|savefig|[xy]tick)\.")
    ],
    _Setting | tuple[_Setting, ...] | dict[str, tuple[_Setting, ...]],
]
#: Axes of a case that tell its series apart, but for those that figures have one each of.
_AXES = tuple(
    axis
    for axis in axes.cell_axes()
    if axis.cell and axis.series and axis.name not in ("problem", "form")
)


class _Chooses(RuledModel):
    """An entry that chooses series."""

    @property
    def choice(self) -> dict[str, tuple[str, ...]]:
        """Axis → values, spelled as in CSVs; all where it says nothing."""
        return choice_of(self)


class _Curve(_Chooses):
    """One entry of `curves`."""

    @property
    def look(self) -> Mapping[str, str]:
        """Its colour and marker, where they are given."""
        given = {"color": self.color, "marker": self.marker}
        return {key: value for key, value in given.items() if value}


class _Rules(_Chooses):
    """What a figure shows, and the rules that tie its keys together."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of rows, or `drawing.WORK_PRECISION`; a figure for each."""
        return drawing.kinds(self.measure) if self.measure else ()

    @property
    def drawn_as(self) -> str:
        """One of `drawing.KINDS`."""
        usual = "work" if self.measure == drawing.WORK_PRECISION else "orders"
        return str(self.kind or usual)

    @property
    def heading(self) -> str | None:
        """Its title; empty for none, None for one that is made from what it shows."""
        return "" if self.title == "none" else self.title

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.measure is not None:
            yield from unknown(self.measure, self.quantity, drawing.quantities((self.measure,)))
        for axis in self.panels or ():
            if axis in (self.series or ()):
                yield misfit("panels", f"{axis} already tells the series apart")
        if self.measure is None and self.kind != "mechanism":
            yield misfit("measure", "missing: what the figure shows")
        if self.kind == "mechanism" and self.figure is None:
            yield misfit("figure", "missing: the number or word of a drawing of a mechanism")
        if self.curves is not None and self.figure is None:
            yield misfit("curves", "belong to a figure with a number or word; give figure, too")
        if self.figure is not None:
            yield from self._incomplete()

    def _incomplete(self) -> Iterator[PydanticCustomError]:
        """Of a figure that is known before there are results, all series are named."""
        if self.title is None:
            yield misfit("title", "missing: a figure with a number or word has one")
        if self.problem is None:
            yield misfit("problem", "missing: a figure with a number or word names its series")
        if self.kind == "mechanism":
            return
        if self.quantity is None:
            yield misfit("quantity", "missing: a figure with a number or word names its series")
        if self.curves is None and self.series is None:
            yield misfit("curves", "missing: give curves, or series with the values of its axes")
        apart = (*(self.panels or ()), *((self.series or ()) if self.curves is None else ()))
        for axis in apart:
            if getattr(self, axis) is None:
                yield misfit(axis, "missing: its values tell panels or series apart")


def series_keys() -> dict[str, Any]:
    """Keys that choose rows by an axis."""
    return {
        "quantity": optional(Quantities, "quantities; default: all"),
        **{axis.name: chosen(axis) for axis in _AXES},
        "row_block": optional(RowBlocks, "perturbed rows of sensitivities; default: all"),
        "problem": optional(
            OneOrMore[Annotated[str, Strict()]], "problems to show, as in the CSV; default: all"
        ),
        "form": optional(Forms, "forms to show; default: all"),
    }


if TYPE_CHECKING:
    CurveConfig = _Curve
    FigureConfig = _Rules
else:
    CurveConfig = create_model(
        "CurveConfig",
        __base__=_Curve,
        __doc__="Series of a figure: the axes in which they differ from what the figure shows.",
        label=optional(OneLine, "name in the legend; made from the axes in series if omitted"),
        panel=optional(OneLine, "title of the panel that it stands in"),
        color=optional(OneLine, "colour, as matplotlib writes it"),
        marker=optional(OneLine, "marker, as matplotlib writes it"),
        **series_keys(),
    )
    FigureConfig = create_model(
        "FigureConfig",
        __base__=_Rules,
        __doc__="A figure of the study: the rows that it shows, and how it arranges them.",
        measure=optional(Showable, "what it shows; only drawings of mechanisms do without"),
        kind=optional(
            Literal[drawing.KINDS],
            "how: against the step size (orders) or the work, over time (history, drift), "
            "or a drawing of the problem (mechanism); default: orders, or work for work-precision",
        ),
        series=optional(
            Compared, "axes that tell the series of a panel apart; default: the most varied"
        ),
        panels=optional(Compared, "axes that tell panels apart; default: what else varies"),
        **series_keys(),
        initial=optional(Literal["start"], "start: what was measured at the initial state"),
        title=optional(
            OneLine | Literal[""], "title; made from what it shows when omitted; none for none"
        ),
        name=optional(Name, "name of its files, behind that of the study"),
        figure=optional(
            Word,
            "number or word by which `plot` knows it; its files are figure-<n>, and it names "
            "all its series",
        ),
        curves=optional(
            Annotated[tuple[CurveConfig, ...], Field(min_length=1, max_length=_MOST_CURVES)],
            "its series one by one, in the order of the legend",
        ),
        labels=optional(
            Texts, "names of values in legends and titles of panels, such as {none: no scaling}"
        ),
        colors=optional(Texts, "colours of series, by a value of theirs or by their label"),
        style=optional(
            Style,
            "settings of matplotlib for this figure; axes.prop_cycle has lists: {color: [k, r]}",
        ),
        note=optional(OneLine, "what stands above the legend"),
        columns=optional(
            Annotated[int, Strict(), Field(ge=1, le=8), WHOLE],
            "panels side by side; default: as suits their number",
        ),
        h=optional(Positive, "step size of values over time (s); default: the smallest"),
        within=optional(
            Positive,
            "largest |fitted − predicted slope| of its series, which `check` then prints; default: "
            "the tolerance of their measure",
        ),
    )

Figures = Annotated[tuple[FigureConfig, ...], Field(min_length=1, max_length=_MOST_FIGURES)]
_FIGURES: TypeAdapter[tuple[FigureConfig, ...]] = TypeAdapter(Figures)


def definitions(config: Any) -> tuple[FigureConfig, ...] | None:
    """Figures of a record or a shipped config; None where it leaves them to the results.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    return recorded(config, "figures", _FIGURES) or None
