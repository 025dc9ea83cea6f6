"""The key `expect` of a study config: its models, and whether the study has such series.

A record is read by the same models; there and in shipped configs values are spelled as in CSVs.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain, product
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

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Projection, reported
from newmark_cli.newmark.linear.choice import AUTO, DENSE, SPARSE, STATIC
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
from newmark_cli.study.measures import MEASURES, RECORDS
from newmark_cli.support.documents import (
    Document,
    KeyPath,
    Mistakes,
    Number,
    RuledModel,
    StrictModel,
    misfit,
)
from newmark_cli.support.json_schema import JsonSchema, Shown, also
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    from newmark_cli.study.config import Case, Study

_MOST = 1_000
_Choice = Mapping[str, Sequence[str]]
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
    if listed is None:
        return ()
    try:
        return entries.validate_python(listed, context=LABELLED)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{key}: not as written by a run: {where}: {first['msg']}") from None


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
            getattr(key, axis) in values for axis, values in choice_of(self).items()
        )

    def divisor(self, key: SeriesKey) -> SeriesKey:
        """The series that the values of a series are divided by."""
        differs = {axis: value for axis, (value,) in choice_of(self.over).items()}
        return SeriesKey.of(key.named() | differs)

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
    assert axis.config is not None
    annotation = axis.config(keys)
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
            if isinstance(value, str):  # as in the CSV; compared with the study's later
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


# -- the study's cases ------------------------------------------------------------------------


def resolved(document: Document, study: "Study") -> "Study":
    """The study with the values of its expectations as its CSV will have them.

    Refuses expectations of which no cell can give a series.
    """
    if study.expect is None:
        return study
    offered = [_Offered(case) for case in study.cases]
    mistakes = Mistakes()
    expectations = []
    for i, expectation in enumerate(study.expect):
        with mistakes.gathered():
            expectations.append(_resolved(document, ("expect", i), expectation, offered))
    mistakes.refuse()
    return study.model_copy(update={"expect": tuple(expectations)})


class _Offered:
    """The series that a case can give."""

    def __init__(self, case: "Case") -> None:
        self.h = case.h
        self.measures = [MEASURES[name] for name in case.measure]
        self.records = [record.name for measure in self.measures for record in measure.records]
        values = axes.values(case)
        self._forms, self._formulations = values["form"], values["formulation"]
        #: Axis → how an expectation may spell a value → as the CSV may have it.
        self.spellings: dict[str, dict[str, list[str]]] = {}
        for axis in _AXES:
            spellings = self.spellings[axis.name] = {}
            for value in values[axis.name]:
                labels = _labels(axis, value, values["projection"])
                # One's own scalings go by their names, too.
                name = value.name if axis.name == "preconditioning" else _label(axis, value)
                for text in dict.fromkeys((*labels, name)):
                    spellings.setdefault(text, []).extend(labels if text == name else [text])

    def rows(self, measure: str, choice: _Choice) -> set[tuple[str, str]] | None:
        """Quantity and row block of its rows of a measure; None where that is not known."""
        forms = [form for form in self._forms if form in choice.get("form", [form])]
        formulations = [
            f for f in self._formulations if f.label in choice.get("formulation", [f.label])
        ]
        names_of_rows = set()
        for candidate in self.measures:
            if measure in (record.name for record in candidate.records):
                if candidate.rows is None:
                    return None
                for form, formulation in product(forms, formulations):
                    names = candidate.rows(formulation.applied(FORMS[form]))
                    names_of_rows |= {(name[1], name[3]) for name in names if name[0] == measure}
        return names_of_rows

    def gives(self, wanted: Any, choice: _Choice) -> bool:
        """Whether one of its series is what is expected something of."""
        rows = self.rows(wanted.measure, choice)
        return (
            _has(self.h, wanted.h)
            and all({*labels} & {*self.spellings[axis]} for axis, labels in choice.items())
            and (rows is None or any(_is_about(wanted, *row) for row in rows))
        )


def _labels(axis: Axis, value: Any, projections: Iterable[Projection]) -> list[str]:
    """A value of a case as the CSV may have it: `auto` depends on other axes."""
    if axis.name == "linear_solver" and value == AUTO:
        return [DENSE, SPARSE, STATIC]
    if axis.name == "multipliers":
        return [*dict.fromkeys(reported(value, projection) for projection in projections)]
    return [_label(axis, value)]


def _has(sizes: Sequence[float], h: float | None) -> bool:
    return h is None or any(math.isclose(size, h, rel_tol=1e-9) for size in sizes)


def _is_about(wanted: Any, quantity: str, row_block: str) -> bool:
    return quantity in (wanted.quantity or [quantity]) and row_block in (
        wanted.row_block or [row_block]
    )


def _names_of_rows(offered: Sequence[_Offered], measure: str) -> dict[str, list[str]]:
    """Quantities and row blocks that rows of a measure may have; empty where nobody knows."""
    rows = [case.rows(measure, {}) for case in offered]
    if None in rows or not any(rows):
        return {}
    every = {row for of_case in rows for row in of_case or ()}
    keys = ("quantity", "row_block")
    return {key: sorted({row[k] for row in every} - {""}) for k, key in enumerate(keys)}


def _resolved(document: Document, path: KeyPath, wanted: Any, offered: Sequence[_Offered]) -> Any:
    mistakes = Mistakes()

    def require(key: str, values: Iterable[Any], known: Iterable[str]) -> None:
        names = dict.fromkeys(known)
        for value in values:
            if value not in names:
                text = f"{value!r} is not among the study's{nearest(value, names)}"
                mistakes.note(document.error((*path, key), text))

    def chosen_of(entry: Any, prefix: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
        """Axis → values as spelled in an expectation or its divisor."""
        for axis in _AXES:
            if (values := getattr(entry, axis.name)) is not None:
                known = (text for case in offered for text in case.spellings[axis.name])
                require(prefix + axis.name, values, known)
                yield axis.name, values

    require("measure", [wanted.measure], (name for case in offered for name in case.records))
    choice: dict[str, tuple[str, ...]] = {}
    for name, values in chosen_of(wanted):
        labels = (case.spellings[name].get(text, []) for case in offered for text in values)
        choice[name] = tuple(dict.fromkeys(chain.from_iterable(labels)))
    for key, there in _names_of_rows(offered, wanted.measure).items():
        require(key, getattr(wanted, key) or (), there)
    if not any(_has(case.h, wanted.h) for case in offered):
        require("h", [f"{wanted.h:g}"], (f"{h:g}" for case in offered for h in case.h))
    over = wanted.over
    if over is not None:
        over = over.model_copy(update=dict(chosen_of(over, "over.")))
    mistakes.refuse()
    if not any(case.gives(wanted, choice) for case in offered):
        raise document.error(path, "no series of the study has all of this")
    return wanted.model_copy(update={**choice, "over": over})
