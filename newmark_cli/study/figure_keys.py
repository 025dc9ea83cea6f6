"""The key `figures` of a study config: its models."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, Strict, create_model
from pydantic_core import PydanticCustomError

from newmark_cli.study import axes, drawing
from newmark_cli.study.expecting import chosen, unknown
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
from newmark_cli.support.documents import WHOLE, RuledModel, StrictModel, misfit

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


class _Rules(RuledModel):
    """Rules that tie the keys of a figure together."""

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
        "quantity": (Quantities | None, Field(None, description="quantities; default: all")),
        **{axis.name: chosen(axis) for axis in _AXES},
        "row_block": (
            RowBlocks | None,
            Field(None, description="perturbed rows of sensitivities; default: all"),
        ),
        "problem": (
            OneOrMore[Annotated[str, Strict()]] | None,
            Field(None, description="problems to show, as in the CSV; default: all"),
        ),
        "form": (Forms | None, Field(None, description="forms to show; default: all")),
    }


if TYPE_CHECKING:
    FigureConfig = _Rules
else:
    CurveConfig = create_model(
        "CurveConfig",
        __base__=StrictModel,
        __doc__="Series of a figure: the axes in which they differ from what the figure shows.",
        label=(
            OneLine | None,
            Field(None, description="name in the legend; made from the axes in series if omitted"),
        ),
        panel=(OneLine | None, Field(None, description="title of the panel that it stands in")),
        color=(OneLine | None, Field(None, description="colour, as matplotlib writes it")),
        marker=(OneLine | None, Field(None, description="marker, as matplotlib writes it")),
        **series_keys(),
    )
    FigureConfig = create_model(
        "FigureConfig",
        __base__=_Rules,
        __doc__="A figure of the study: the rows that it shows, and how it arranges them.",
        measure=(
            Showable | None,
            Field(None, description="what it shows; only drawings of mechanisms do without"),
        ),
        kind=(
            Literal[drawing.KINDS] | None,
            Field(
                None,
                description="how: against the step size (orders) or the work, over time (history, "
                "drift), or a drawing of the problem (mechanism); default: orders, or work for "
                "work-precision",
            ),
        ),
        series=(
            Compared | None,
            Field(None, description="axes that tell the series of a panel apart; default: the "
                  "most varied"),
        ),
        panels=(
            Compared | None,
            Field(None, description="axes that tell panels apart; default: what else varies"),
        ),
        **series_keys(),
        initial=(
            Literal["start"] | None,
            Field(None, description="start: what was measured at the initial state"),
        ),
        title=(
            OneLine | Literal[""] | None,
            Field(None, description="title; made from what it shows when omitted; none for none"),
        ),
        name=(
            Name | None, Field(None, description="name of its files, behind that of the study")
        ),
        figure=(
            Word | None,
            Field(None, description="number or word by which `plot` knows it; its files are "
                  "figure-<n>, and it names all its series"),
        ),
        curves=(
            Annotated[tuple[CurveConfig, ...], Field(min_length=1, max_length=_MOST_CURVES)] | None,
            Field(None, description="its series one by one, in the order of the legend"),
        ),
        labels=(
            Texts | None,
            Field(None, description="names of values in legends and titles of panels, such as "
                  "{none: no scaling}"),
        ),
        colors=(
            Texts | None,
            Field(None, description="colours of series, by a value of theirs or by their label"),
        ),
        style=(
            Style | None,
            Field(None, description="settings of matplotlib for this figure; axes.prop_cycle has "
                  "lists: {color: [k, r]}"),
        ),
        note=(OneLine | None, Field(None, description="what stands above the legend")),
        columns=(
            Annotated[int, Strict(), Field(ge=1, le=8), WHOLE] | None,
            Field(None, description="panels side by side; default: as suits their number"),
        ),
        h=(
            Positive | None,
            Field(None, description="step size of values over time (s); default: the smallest"),
        ),
        within=(
            Positive | None,
            Field(None, description="largest |fitted − predicted slope| of its series, which "
                  "`check` then prints; default: the tolerance of their measure"),
        ),
    )  # fmt: skip

Figures = Annotated[tuple[FigureConfig, ...], Field(min_length=1, max_length=_MOST_FIGURES)]
