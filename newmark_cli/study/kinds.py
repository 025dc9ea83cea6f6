"""Kinds of values of a study config: numbers, names, lines, and one or several of them."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Strict,
    ValidationError,
    ValidationInfo,
    WrapValidator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.study import axes
from newmark_cli.study.axes import STUDY_NAME
from newmark_cli.study.axis import Axis
from newmark_cli.study.measures import MEASURES
from newmark_cli.support import documents
from newmark_cli.support.documents import WHOLE, Number
from newmark_cli.support.json_schema import JsonSchema, Shown, also

_RESERVED = ("slopes",)
MOST_STEPS = 20_000_000
# More is a slip of the finger, and would keep `validate` busy.
_MOST_ITEMS = 1_000
# From the beginning to the end of the text: $ would allow a line end behind it.
_LINE = r"^[^\x00-\x1f\x7f]{1,200}(?![\s\S])"


def _one_or_more(
    value: Any, validate: Callable[[Any], tuple[Any, ...]], info: ValidationInfo
) -> tuple[Any, ...]:
    """A value or a list of values, each once."""
    items = value if isinstance(value, list) else [value]
    if len(items) > _MOST_ITEMS:
        raise ValueError(f"at most {_MOST_ITEMS} values, given {len(items)}")
    try:
        values = validate(items)
    except ValidationError:
        # Not before: the name of a file may have a comma in it.
        documents.require_brackets(value, info)
        raise
    seen = set()
    for item in values:
        # A scaling of one's own has no hash.
        if repr(item) in seen:
            name = getattr(item, "label", getattr(item, "name", item))
            raise ValueError(f"given twice: {name}")
        seen.add(repr(item))
    return values


def _written_once_or_more(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
    several = handler(schema) | {"maxItems": _MOST_ITEMS, "uniqueItems": True}
    return {"anyOf": [several["items"], several]}


Item = TypeVar("Item")
OneOrMore = Annotated[
    tuple[Item, ...], Field(min_length=1), WrapValidator(_one_or_more), Shown(_written_once_or_more)
]


@dataclass(frozen=True, eq=False)
class Known:
    """One of some names, or what legends make of it as a value of an axis."""

    kind: str
    allowed: Collection[str]
    axis: Axis | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        return {"type": "string", "enum": list(self.allowed)}

    def _check(self, name: str) -> str:
        name = self.axis.read(name) if self.axis else name
        if name not in self.allowed:
            raise unknown(self.kind, name, self.allowed)
        return name


#: Key of a config → the names that are its values.
NAMES: Mapping[str, Collection[str]] = {
    **{axis.name: axis.names for axis in axes.cell_axes()},
    "problem": (*PROBLEMS, *FAMILIES),
    "measure": MEASURES,
}


def unknown(kind: str, value: Any, allowed: Iterable[str]) -> PydanticCustomError:
    """Error of a name that is not allowed; says which keys it is a value of."""
    keys = [key for key, names in NAMES.items() if isinstance(value, str) and value in names]
    remark = f", which is a value of the key {' or '.join(keys)}" if keys else ""
    return documents.unknown_name(kind, value, allowed, remark)


def _name(text: str) -> str:
    if not STUDY_NAME.fullmatch(text):
        raise ValueError("must be a name of letters, digits, '.', '_' and '-'")
    if text in _RESERVED:
        raise ValueError("is the name of a file that 'check' writes; take another name")
    return text


Positive = Annotated[Number, Field(gt=0)]
Count = Annotated[int, Strict(), Field(ge=1, le=10_000), WHOLE]
StepCount = Annotated[int, Strict(), Field(ge=0, le=MOST_STEPS), WHOLE]
Name = Annotated[str, AfterValidator(_name)]
Factor = str | Annotated[int, Strict()] | Number


def _one_line(text: str) -> str:
    if not re.search(_LINE, text):
        raise ValueError("must be one line of 1 to 200 letters")
    return text


#: A line of text, and a word or a number that names something.
OneLine = Annotated[str, Strict(), AfterValidator(_one_line)]
Word = Annotated[
    str,
    BeforeValidator(lambda v: str(v) if isinstance(v, int) and not isinstance(v, bool) else v),
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"),
    also(type=["string", "integer"]),
]


def dividing(t_end: float, steps: int) -> str:
    """A step size that comes to the end in so many steps, in as few digits as that takes."""
    texts = (f"{t_end / steps:.{digits}g}" for digits in range(2, 18))
    return next(text for text in texts if abs(t_end / float(text) - steps) < 1e-7)


def fitting_end(t_end: float, h: float, sizes: Sequence[float]) -> str:
    """The nearest end to which all step sizes go a whole number of times, in words."""
    near = max(round(t_end / h), 1)
    counts = range(max(near - 1000, 1), near + 1000)
    for count in sorted(counts, key=lambda count: abs(count * h - t_end)):
        shares = [count * h / size for size in sizes]
        if all(abs(share - round(share)) <= 1e-6 for share in shares):
            return f", or t_end = {count * h:.12g} fits"
    return ""
