"""The key `expect` of a study config: its models.

A record is read by the same models; there and in shipped configs values are spelled as in CSVs.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    create_model,
)
from pydantic_core import CoreSchema, PydanticCustomError

from newmark_cli.study import axes, drawing, keys
from newmark_cli.study.axes import Axis, SeriesKey
from newmark_cli.study.cell import STATUSES
from newmark_cli.study.keys import (
    OneLine,
    OneOrMore,
    Positive,
    Quantities,
    Recorded,
    RowBlocks,
    Word,
)
from newmark_cli.study.measures import RECORDS
from newmark_cli.support.documents import (
    Number,
    RuledModel,
    StrictModel,
    misfit,
)
from newmark_cli.support.json_schema import JsonSchema, Shown, also
from newmark_cli.support.retired import RETIRED
from newmark_cli.support.spelling import nearest

_MOST = 1_000
#: Keys of which an expectation has one at least.
_ASSERTS = ("slope", "at_most", "at_least", "spread", "status")
#: Axes of a case that tell its series apart.
_AXES = tuple(axis for axis in axes.cell_axes() if axis.cell and axis.series)
_NO_TOLERANCE = [name for name, record in RECORDS.items() if record.tolerance != record.tolerance]


#: Context of a validation in which values of axes are labels, as in CSVs.
LABELLED = object()


def recorded(config: Any, key: str, entries: TypeAdapter[Any]) -> Any:
    """A list of a record's or a shipped config's, by its models; empty where there is none.

    Raises:
        ValueError: When it is not as a run has written it.
    """
    listed = config.get(key) if isinstance(config, Mapping) else None
    if isinstance(listed, list):  # of an older version, which may have measured what this does not
        listed = [entry for entry in listed if not _is_of_the_past(entry)]
    if not listed:
        return ()
    try:
        return entries.validate_python(listed, context=LABELLED)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{key}: not as written by a run: {where}: {first['msg']}") from None


def _is_of_the_past(entry: Any) -> bool:
    """Whether an entry is about what this version does not have."""
    if not isinstance(entry, Mapping):
        return False
    about = (entry.get(key) for key in ("measure", "status", "linear_solver", "problem"))
    return any(isinstance(value, str) and value in RETIRED for value in about)


def choice_of(entry: Any) -> dict[str, tuple[str, ...]]:
    """Axis → values of an entry that chooses series, spelled as in CSVs."""
    axis_names = (*drawing.COMPARABLE, "initial")
    chosen = {name: getattr(entry, name, None) for name in axis_names}
    return {
        name: (values,) if isinstance(values, str) else values
        for name, values in chosen.items()
        if values is not None
    }


class _Rules(RuledModel):
    """What an expectation is about, and the rules that tie its keys together."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value."""
        at_most = math.inf if self.at_most is None else self.at_most
        return self.at_least or 0.0, at_most

    @property
    def described(self) -> str:
        """The series that it is about, in words."""
        parts = (f"{axis} {' or '.join(values)}" for axis, values in choice_of(self).items())
        return ", ".join([f"measure {self.measure}", *parts])

    def matches(self, key: SeriesKey) -> bool:
        """Whether it is about a series."""
        return key.measure == self.measure and all(
            any(axes.means(axis, word, getattr(key, axis)) for word in words)
            for axis, words in choice_of(self).items()
        )

    def divisor(self, key: SeriesKey) -> SeriesKey:
        """The series that the values of a series are divided by."""
        differs = {axis: value for axis, (value,) in choice_of(self.over).items()}
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
    annotation = keys.annotation(axis)
    # Of `OneOrMore[Item]`, or of `Item | None`.
    inner = get_args(annotation)
    item = (
        get_args(inner[0])[0] if axis.many else next(part for part in inner if part is not NoneType)
    )

    def read(value: Any, parse: Callable[[Any], Any], info: ValidationInfo) -> str:
        if info.context is LABELLED:
            if not isinstance(value, str):
                raise ValueError(f"not a label: {value!r}")
            return axis.same(value)
        try:
            return _label(axis, axis.value(parse(value)))
        except ValidationError:
            # A file by its label, a scaling of one's own by its name, a test as the CSV has it.
            if axis.name in ("problem", "preconditioning", "stop") and isinstance(value, str):
                return axis.same(value)
            raise

    def written(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
        of_item = handler(schema)
        return of_item if "enum" in of_item else {"anyOf": [of_item, {"type": "string"}]}

    values = OneOrMore[
        Annotated[item, WrapValidator(read), PlainSerializer(str), Shown(written)]  # type: ignore[valid-type]
    ]
    about = f"{axis.title} of the series, as in a case or as in the CSV; any when omitted"
    return optional(values, about)


def _label(axis: Axis, value: Any) -> str:
    """A value of a cell as the CSV has it, where it does not depend on other axes."""
    return axis.same(str(axis.usual if value is None else getattr(value, "label", value)))


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
    ExpectConfig = _Rules
else:
    OverConfig = create_model(
        "OverConfig",
        __base__=StrictModel,
        __doc__="What the values of a series are divided by: where the divisor differs from it.",
        measure=optional(Recorded, "kind of rows; that of the numerator if omitted"),
        quantity=_one(optional(Quantities, "")),
        **{axis.name: _one(chosen(axis)) for axis in _AXES},
        h=optional(Positive, "step size of the divisor (s)"),
    )
    ExpectConfig = create_model(
        "ExpectConfig",
        __base__=_Rules,
        __doc__="A slope or a level that series of the study must have.",
        measure=(Recorded, Field(description="kind of rows, as the CSV's column `measure`")),
        quantity=optional(Quantities, "quantities; any when omitted"),
        **{axis.name: chosen(axis) for axis in _AXES},
        row_block=optional(RowBlocks, "perturbed rows of sensitivities; any when omitted"),
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
_EXPECTATIONS: TypeAdapter[tuple[ExpectConfig, ...]] = TypeAdapter(Expectations)


def expectations(config: Any) -> tuple[ExpectConfig, ...]:
    """Expectations of a record or a shipped config; see `recorded`."""
    found: tuple[ExpectConfig, ...] = recorded(config, "expect", _EXPECTATIONS)
    return found
