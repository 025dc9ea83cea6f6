"""Entries of the keys `figures`, `tables` and `expect` of a study config: one model each.

By these models a config is read, written into a record and read back; there and in shipped
configs values are spelled as in CSVs.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    create_model,
)
from pydantic_core import CoreSchema, PydanticCustomError

from newmark_cli.newmark.forms import ROWS
from newmark_cli.study import axes, keys, showable
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.axis import ALIASES, Axis, label
from newmark_cli.study.cell import STATUSES
from newmark_cli.study.kinds import Known, Name, OneLine, OneOrMore, Positive, Word
from newmark_cli.study.measures import RECORDED, RECORDS
from newmark_cli.support.documents import WHOLE, Number, RuledModel, misfit
from newmark_cli.support.json_schema import JsonSchema, Shown, also
from newmark_cli.support.retired import RETIRED
from newmark_cli.support.spelling import nearest

#: Axes of a case that tell its series apart.
_AXES = tuple(axis for axis in axes.cell_axes() if axis.cell and axis.series)

#: Context of a validation in which values of axes are labels, as in CSVs.
LABELLED = object()

#: Reads an alias of an axis as the axis.
_ALIAS = BeforeValidator(lambda axis: ALIASES.get(axis, axis) if isinstance(axis, str) else axis)
_Compared = OneOrMore[Annotated[str, _ALIAS, Known("axis", showable.COMPARABLE)]]
_Tabulated = OneOrMore[Annotated[str, _ALIAS, Known("axis", showable.TABULATED)]]
_TableValues = OneOrMore[Annotated[str, Known("value", showable.VALUES)]]
_Quantities = OneOrMore[Annotated[str, Known("quantity", showable.quantities(showable.SHOWABLE))]]
_Showable = Annotated[str, Known("measure", showable.SHOWABLE)]
Recorded = Annotated[str, Known("measure", RECORDED)]
_RowBlocks = OneOrMore[Annotated[str, Known("row block", ROWS)]]


# -- choosing series ----------------------------------------------------------------------------


class _Chooses(RuledModel):
    """An entry that chooses series by their axes."""

    @property
    def choice(self) -> dict[str, tuple[str, ...]]:
        """Axis → values, spelled as in CSVs, of the axes that it says anything of."""
        chosen = {name: getattr(self, name, None) for name in (*showable.COMPARABLE, "initial")}
        return {
            name: (values,) if isinstance(values, str) else values
            for name, values in chosen.items()
            if values is not None
        }


def unknown(
    measure: str, wanted: Sequence[str] | None, quantities: Collection[str]
) -> Iterator[PydanticCustomError]:
    """Misfits of quantities that a measure does not have."""
    for quantity in wanted or ():
        if quantity not in quantities:
            near = nearest(quantity, quantities)
            yield misfit("quantity", f"{measure} has no {quantity!r}{near}")


def optional(kind: Any, about: str) -> tuple[Any, Any]:
    """Key that may be left out."""
    return kind | None, Field(None, description=about)


def chosen(axis: Axis) -> tuple[Any, Any]:
    """Key of an expectation that an axis has: values as a case spells them, or as the CSV does."""
    item = keys.value_of(axis)

    def read(value: Any, parse: Callable[[Any], Any], info: ValidationInfo) -> str:
        if info.context is LABELLED:
            if not isinstance(value, str):
                raise ValueError(f"not a label: {value!r}")
            return axis.same(value)
        try:
            given = axis.value(parse(value))
        except ValidationError:
            # A file by its label, a scaling of one's own by its name, a test as the CSV has it.
            if axis.name in ("problem", "preconditioning", "stop") and isinstance(value, str):
                return axis.same(value)
            raise
        # As the CSV has it, where it does not depend on other axes.
        return axis.same(str(axis.usual if given is None else label(given)))

    def written(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
        of_item = handler(schema)
        return of_item if "enum" in of_item else {"anyOf": [of_item, {"type": "string"}]}

    values = OneOrMore[
        Annotated[item, WrapValidator(read), PlainSerializer(str), Shown(written)]  # type: ignore[valid-type]
    ]
    about = f"{axis.title} of the series, as in a case or as in the CSV; any when omitted"
    return optional(values, about)


def _series_keys() -> dict[str, Any]:
    """Keys that choose rows by an axis."""
    return {
        "quantity": optional(_Quantities, "quantities; default: all"),
        **{axis.name: chosen(axis) for axis in _AXES if axis.name not in ("problem", "form")},
        "row_block": optional(_RowBlocks, "perturbed rows of sensitivities; default: all"),
        "problem": optional(
            OneOrMore[Annotated[str, Strict()]], "problems to show, as in the CSV; default: all"
        ),
        "form": optional(keys.annotation(axes.named("form")), "forms to show; default: all"),
    }


# -- expect --------------------------------------------------------------------------------------

_MOST = 1_000
#: Keys of which an expectation has one at least.
_ASSERTS = ("slope", "at_most", "at_least", "spread", "status")
_NO_TOLERANCE = [name for name, record in RECORDS.items() if record.tolerance != record.tolerance]


class _Expects(_Chooses):
    """What an expectation is about, and the rules that tie its keys together."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        at_most = math.inf if self.at_most is None else self.at_most
        return self.at_least or 0.0, at_most

    @property
    def described(self) -> str:
        """The series that it is about, in words."""
        parts = (f"{axis} {' or '.join(values)}" for axis, values in self.choice.items())
        return ", ".join([f"measure {self.measure}", *parts])

    def matches(self, key: SeriesKey) -> bool:
        """Whether it is about a series."""
        return axes.is_among(key, {**self.choice, "measure": (self.measure,)})

    def divisor(self, key: SeriesKey) -> SeriesKey:
        """The series that the values of a series are divided by."""
        differs = {axis: value for axis, (value,) in self.over.choice.items()}
        measure = self.over.measure or self.measure
        return SeriesKey.of(key.named() | differs | {"measure": measure})

    def _misfits(self) -> Iterator[PydanticCustomError]:
        yield from unknown(self.measure, self.quantity, RECORDS[self.measure].quantities)
        low, high = self.at_least, self.at_most
        if all(getattr(self, key) is None for key in _ASSERTS):
            yield misfit("slope", f"missing: give {', '.join(_ASSERTS[:-1])} or {_ASSERTS[-1]}")
        if self.slope is None and self.within is not None:
            yield misfit("within", "is the tolerance of a slope, and no slope is given")
        if self.slope is not None and self.within is None and self.measure in _NO_TOLERANCE:
            yield misfit("within", f"missing: {self.measure} has no tolerance of its own")
        if self.h is not None and low is None and high is None:
            yield misfit("h", "is where at_most or at_least hold; a slope is over all step sizes")
        if self.over is not None and low is None and high is None:
            yield misfit("over", "is what at_most or at_least divide by, and neither is given")
        if self.over is not None and self.slope is not None:
            yield misfit("over", "divides values, and slope is of the values themselves")
        if low is not None and high is not None and low > high:
            yield misfit("at_least", f"must not exceed at_most = {high:g}, given {low:g}")


def _one(chosen: tuple[Any, Any]) -> tuple[Any, Any]:
    """The same key with one value."""
    annotation, _ = chosen
    about = "value of the divisor, as in a case or as in the CSV; as in the numerator if omitted"
    exactly_one = AfterValidator(_alone)
    return Annotated[annotation, exactly_one, also(maxItems=1)], Field(None, description=about)


def _alone(values: tuple[Any, ...] | None) -> tuple[Any, ...] | None:
    if values is not None and len(values) > 1:
        raise ValueError("must be one value: a series is divided by one other")
    return values


if TYPE_CHECKING:
    ExpectConfig = _Expects
else:
    OverConfig = create_model(
        "OverConfig",
        __base__=_Chooses,
        __doc__="What the values of a series are divided by: where the divisor differs from it.",
        measure=optional(Recorded, "kind of rows; that of the numerator if omitted"),
        quantity=_one(optional(_Quantities, "")),
        **{axis.name: _one(chosen(axis)) for axis in _AXES},
        h=optional(Positive, "step size of the divisor (s)"),
    )
    ExpectConfig = create_model(
        "ExpectConfig",
        __base__=_Expects,
        __doc__="A slope or a level that series of the study must have.",
        measure=(Recorded, Field(description="kind of rows, as the CSV's column `measure`")),
        quantity=optional(_Quantities, "quantities; any when omitted"),
        **{axis.name: chosen(axis) for axis in _AXES},
        row_block=optional(_RowBlocks, "perturbed rows of sensitivities; any when omitted"),
        slope=optional(Number, "order of the values in h"),
        within=optional(
            Positive, "largest |fitted − slope|; the tolerance of the measure when omitted"
        ),
        at_most=optional(Annotated[Number, Field(ge=0)], "largest value"),
        at_least=optional(Positive, "smallest value"),
        h=optional(Positive, "step size of at_most and at_least (s); every one if omitted"),
        over=optional(
            OverConfig, "what the values are divided by: at_most and at_least bound the quotients"
        ),
        spread=optional(Positive, "largest (max − min)/min of the values over the step sizes"),
        status=optional(Literal[STATUSES], "how the cell at the smallest step size ends"),
        figure=optional(Word, "figure that shows it: `check` lists it as a claim of that"),
        label=optional(OneLine, "how `check` names the series; made from its axes if omitted"),
    )

Expectations = Annotated[tuple[ExpectConfig, ...], Field(min_length=1, max_length=_MOST)]


# -- figures -------------------------------------------------------------------------------------

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


class _Curve(_Chooses):
    """One entry of `curves`."""

    @property
    def look(self) -> Mapping[str, str]:
        """Its colour and marker, where they are given."""
        given = {"color": self.color, "marker": self.marker}
        return {key: value for key, value in given.items() if value}


class _Draws(_Chooses):
    """What a figure shows, and the rules that tie its keys together."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of rows, or `showable.WORK_PRECISION`; a figure for each."""
        return showable.kinds(self.measure) if self.measure else ()

    @property
    def drawn_as(self) -> str:
        """One of `showable.KINDS`."""
        usual = "work" if self.measure == showable.WORK_PRECISION else "orders"
        return str(self.kind or usual)

    @property
    def heading(self) -> str | None:
        """Its title; empty for none, None for one that is made from what it shows."""
        return "" if self.title == "none" else self.title

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.measure is not None:
            yield from unknown(self.measure, self.quantity, showable.quantities((self.measure,)))
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


if TYPE_CHECKING:
    CurveConfig = _Curve
    FigureConfig = _Draws
else:
    CurveConfig = create_model(
        "CurveConfig",
        __base__=_Curve,
        __doc__="Series of a figure: the axes in which they differ from what the figure shows.",
        label=optional(OneLine, "name in the legend; made from the axes in series if omitted"),
        panel=optional(OneLine, "title of the panel that it stands in"),
        color=optional(OneLine, "colour, as matplotlib writes it"),
        marker=optional(OneLine, "marker, as matplotlib writes it"),
        **_series_keys(),
    )
    FigureConfig = create_model(
        "FigureConfig",
        __base__=_Draws,
        __doc__="A figure of the study: the rows that it shows, and how it arranges them.",
        measure=optional(_Showable, "what it shows; only drawings of mechanisms do without"),
        kind=optional(
            Literal[showable.KINDS],
            "how: against the step size (orders) or the work, over time (history, drift), "
            "or a drawing of the problem (mechanism); default: orders, or work for work-precision",
        ),
        series=optional(
            _Compared, "axes that tell the series of a panel apart; default: the most varied"
        ),
        panels=optional(_Compared, "axes that tell panels apart; default: what else varies"),
        **_series_keys(),
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


# -- tables --------------------------------------------------------------------------------------


class _Heads(_Chooses):
    """An entry that chooses series by their measure, too."""

    @property
    def choice(self) -> dict[str, tuple[str, ...]]:
        """Axis → values, spelled as in CSVs, of the axes that it says anything of."""
        kinds = [kind for name in self.measure or () for kind in showable.kinds(name)]
        return super().choice | ({"measure": tuple(kinds)} if kinds else {})


class _Tabulates(_Heads):
    """Rules that tie the keys of a table together."""

    @property
    def across(self) -> bool:
        """Whether series stand in columns; otherwise each has a row, and its values are columns."""
        return bool(self.columns or self.headings)

    @property
    def shown(self) -> tuple[str, ...]:
        """What it says of a series, of `showable.VALUES`."""
        return self.values or ("predicted", "fitted")

    def _misfits(self) -> Iterator[PydanticCustomError]:
        for axis in self.columns or ():
            if axis in (self.rows or ()):
                yield misfit("columns", f"{axis} already tells the rows apart")
        if self.columns is not None and self.headings is not None:
            yield misfit("headings", "are columns one by one; leave out columns")
        if self.across and not self.rows:
            yield misfit("rows", "missing: the axes that tell rows apart")


def _measured_series() -> dict[str, Any]:
    """Keys that choose series."""
    return {
        "measure": optional(OneOrMore[Recorded], "kinds of rows of the CSV; default: all"),
        "initial": optional(Literal["start"], "start: what was measured at the initial state"),
        **_series_keys(),
    }


if TYPE_CHECKING:
    TableConfig = _Tabulates
else:
    HeadingConfig = create_model(
        "HeadingConfig",
        __base__=_Heads,
        __doc__="A column of a table: the strongest of the series that it chooses.",
        label=(OneLine, Field(description="what stands above it")),
        **_measured_series(),
    )
    TableConfig = create_model(
        "TableConfig",
        __base__=_Tabulates,
        __doc__="A table of fitted orders, one for each combination of what else varies.",
        rows=optional(_Tabulated, "axes that tell rows apart; default, of a list: what varies"),
        columns=optional(
            _Tabulated,
            "axes that tell columns apart; without them and headings each series has a "
            "row, and its values are the columns",
        ),
        headings=optional(
            Annotated[tuple[HeadingConfig, ...], Field(min_length=1, max_length=40)],
            "the columns one by one",
        ),
        values=optional(_TableValues, "what it says of each series; default: predicted and fitted"),
        title=optional(OneLine, "what it shows"),
        table=optional(Word, "number or word of its files"),
        **_measured_series(),
    )

Tables = Annotated[tuple[TableConfig, ...], Field(min_length=1, max_length=40)]


def table(**named: Iterable[str]) -> TableConfig:
    """A table of these axes and values; empty ones are left out."""
    return TableConfig.model_validate({key: [*of] for key, of in named.items() if of})


# -- records -------------------------------------------------------------------------------------

_ENTRIES: Mapping[str, TypeAdapter[Any]] = {
    "figures": TypeAdapter(Figures),
    "tables": TypeAdapter(Tables),
    "expect": TypeAdapter(Expectations),
}


def recorded(config: Any, key: str) -> tuple[Any, ...]:
    """Entries of a record's or a shipped config's; none where it has no such key.

    Raises:
        ValueError: When they are not as a run has written them.
    """
    listed = config.get(key) if isinstance(config, Mapping) else None
    if isinstance(listed, list):  # of an older version, which may have measured what this does not
        listed = [entry for entry in listed if not _is_of_the_past(entry)]
    if not listed:
        return ()
    try:
        entries: tuple[Any, ...] = _ENTRIES[key].validate_python(listed, context=LABELLED)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{key}: not as written by a run: {where}: {first['msg']}") from None
    return entries


def _is_of_the_past(entry: Any) -> bool:
    """Whether an entry is about what this version does not have."""
    about = entry if isinstance(entry, Mapping) else {}
    values = (about.get(key) for key in ("measure", "status", "linear_solver", "problem"))
    return any(isinstance(value, str) and value in RETIRED for value in values)


#: Entries of each key of a record or a shipped config; see `recorded`.
figures: Callable[[Any], tuple[FigureConfig, ...]] = partial(recorded, key="figures")
tables: Callable[[Any], tuple[TableConfig, ...]] = partial(recorded, key="tables")
expectations: Callable[[Any], tuple[ExpectConfig, ...]] = partial(recorded, key="expect")
