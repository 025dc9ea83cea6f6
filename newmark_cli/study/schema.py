"""JSON Schemas of study configs and mechanism files, for editors and validators.

What a single key may be comes from the models.  Here stands what ties the keys of a
config together: those at the top hold for every case that does not set them.
"""

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from newmark_cli.json_schema import Generator, JsonSchema, given, with_definitions
from newmark_cli.mechanisms.models import Mechanism
from newmark_cli.mechanisms.spatial_model import SpatialMechanism
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.linear.choice import AUTO, DENSE
from newmark_cli.study.config import MOST_CASES, Case, Study
from newmark_cli.study.measures import MEASURES, TRAJECTORY

_WIDTH = 100
#: Keys of which a case takes neither from the top when it sets one.
_TOGETHER = ("t_end", "steps")


@dataclass(frozen=True)
class _Condition:
    """Something about the value of a key.

    Attributes:
        key: The key.
        value: JSON Schema that the value fits if the condition holds.
        by_default: Whether it holds where the key is missing.
        name: Where it stands among the definitions, once it does.
    """

    key: str
    value: JsonSchema
    by_default: bool = False
    name: str = ""

    @property
    def alone(self) -> JsonSchema:
        """It holds for a mapping that inherits nothing."""
        if self.name:
            return {"$ref": f"#/$defs/{self.name}"}
        return self._here(required=not self.by_default)

    def inherited(self, from_above: bool) -> JsonSchema:
        """It holds for a case where it does or does not for what stands at the top."""
        if self.key not in _TOGETHER:
            return self._here(required=not from_above)
        sets_it: JsonSchema = {"anyOf": [{"required": [key]} for key in _TOGETHER]}
        return {"if": sets_it, "then": self._here(required=True), "else": from_above}

    def _here(self, required: bool) -> JsonSchema:
        here: JsonSchema = {"properties": {self.key: self.value}}
        return here | {"required": [self.key]} if required else here


def _default(key: str) -> tuple[Any, ...]:
    field = Case.model_fields[key]
    return () if field.is_required() else tuple(field.default)


def _any_of(key: str, names: Collection[str]) -> _Condition:
    """One of the names is given."""
    one = {"enum": list(names)}
    either = {"anyOf": [one, {"type": "array", "contains": one}]}
    return _Condition(key, either, any(name in names for name in _default(key)))


def _only(key: str, names: Collection[str]) -> _Condition:
    """Nothing but the names is given."""
    one = {"enum": list(names)}
    several = {"if": {"type": "array"}, "then": {"items": one}, "else": one}
    return _Condition(key, several, all(name in names for name in _default(key)))


def _own_factor(side: str, block: str) -> _Condition:
    """A scaling of one's own names this row block or unknown."""
    one = {
        "type": "object",
        "required": [side],
        "properties": {side: {"type": "object", "required": [block]}},
    }
    return _Condition("preconditioning", {"anyOf": [one, {"type": "array", "contains": one}]})


def _rules() -> Iterator[tuple[_Condition, _Condition]]:
    """(if, then) of two keys, as `Case` checks them."""
    measures = MEASURES.values()
    still = [measure.name for measure in measures if not measure.along_steps]
    not_null: JsonSchema = {"not": {"type": "null"}}
    yield _Condition("steps", {"const": 0}), _only("measure", still)
    to_tolerance = [measure.name for measure in measures if measure.stop is not False]
    yield _Condition("stop", not_null), _only("measure", to_tolerance)
    for measure in measures:
        if measure.stop:
            yield _any_of("measure", [measure.name]), _Condition("stop", not_null)
        if measure.solvers:
            yield _any_of("measure", [measure.name]), _only("linear_solver", measure.solvers)
    yield _any_of("precision", ["float32"]), _only("linear_solver", [AUTO, DENSE])
    for side, part in (("left", "rows"), ("right", "unknowns")):
        blocks = dict.fromkeys(block for form in FORMS.values() for block in getattr(form, part))
        for block in blocks:
            having = [name for name, form in FORMS.items() if block in getattr(form, part)]
            if len(having) < len(FORMS):
                yield _own_factor(side, block), _only("form", having)
    yield _Condition("trajectory", not_null), _any_of("measure", [TRAJECTORY.name])


_NO_CASES: JsonSchema = {"not": {"required": ["cases"]}}
_ONE_LENGTH: JsonSchema = {"oneOf": [given(key) for key in _TOGETHER]}
_ANY_LENGTH: JsonSchema = {"anyOf": [{"required": [key]} for key in _TOGETHER]}


def _of_cases(items: JsonSchema) -> JsonSchema:
    return {"properties": {"cases": {"items": items}}}


def _applied(premise: _Condition, conclusion: _Condition) -> Iterator[JsonSchema]:
    """A rule on a config without cases, and on cases that inherit from the top."""
    yield {"if": {"allOf": [_NO_CASES, premise.alone]}, "then": conclusion.alone}
    for above in (True, False):
        for other_above in (True, False):
            facts = [
                fact.alone if holds else {"not": fact.alone}
                for fact, holds in ((premise, above), (conclusion, other_above))
            ]
            yield {
                "if": {"allOf": [{"required": ["cases"]}, *facts]},
                "then": _of_cases(
                    {"if": premise.inherited(above), "then": conclusion.inherited(other_above)}
                ),
            }


def _named(
    rule: tuple[_Condition, _Condition], number: int, definitions: JsonSchema
) -> list[_Condition]:
    """The rule with its parts, which are used several times, among the definitions."""
    named = []
    for part, condition in zip(("if", "then"), rule, strict=True):
        name = f"{part}-{number}"
        definitions[f"{name}-value"] = condition.value
        condition = replace(condition, value={"$ref": f"#/$defs/{name}-value"})
        definitions[name] = condition.alone
        named.append(replace(condition, name=name))
    return named


def _referring(part: Any, definitions: JsonSchema) -> Any:
    """A schema with references in place of what is among the definitions."""
    for name, definition in definitions.items():
        if part == definition:
            return {"$ref": f"#/$defs/{name}"}
    if isinstance(part, list):
        return [_referring(item, definitions) for item in part]
    if isinstance(part, dict):
        return {key: _referring(value, definitions) for key, value in part.items()}
    return part


def config_schema() -> JsonSchema:
    """Of study configs."""
    written = Study.model_json_schema(schema_generator=Generator)
    definitions = written["$defs"]
    case = definitions["Case"]
    for key, value in case["properties"].items():
        one, several = value.get("anyOf", ({}, {}))
        if several.get("items") == one and "$ref" not in one:
            definitions[key] = one
            value["anyOf"][0] = several["items"] = {"$ref": f"#/$defs/{key}"}
    values = {key: definitions[key] for key in case["properties"] if key in definitions}
    definitions["ExpectConfig"] = _referring(definitions["ExpectConfig"], values)
    needed = case.pop("required")
    case |= {"if": _ANY_LENGTH, "then": _ONE_LENGTH}
    for key in case["properties"]:
        written["properties"][key] = {"$ref": f"#/$defs/Case/properties/{key}"}
    written["properties"]["cases"] = {
        "description": "grids of one study; keys at the top hold for each that does not set them",
        "type": "array",
        "items": {"$ref": "#/$defs/Case"},
        "minItems": 1,
        "maxItems": MOST_CASES,
        "uniqueItems": True,
    }
    rules = [_named(rule, number, definitions) for number, rule in enumerate(_rules(), start=1)]
    written["required"] = ["study"]
    written["allOf"] = [
        {"if": _NO_CASES, "then": {"required": needed, **_ONE_LENGTH}},
        *(
            {"if": {"not": {"required": [key]}}, "then": _of_cases({"required": [key]})}
            for key in needed
        ),
        {"if": {"not": _ONE_LENGTH}, "then": _of_cases(_ANY_LENGTH)},
        *(schema for rule in rules for schema in _applied(*rule)),
    ]
    return with_definitions(written, "Study config of newmark-study")


def mechanism_schema() -> JsonSchema:
    """Of planar mechanism files."""
    written = Mechanism.model_json_schema(schema_generator=Generator)
    return with_definitions(written, "Mechanism file of newmark-study")


def spatial_schema() -> JsonSchema:
    """Of spatial mechanism files."""
    written = SpatialMechanism.model_json_schema(schema_generator=Generator)
    return with_definitions(written, "Spatial mechanism file of newmark-study")


SCHEMAS: Mapping[str, Callable[[], JsonSchema]] = MappingProxyType(
    {"config": config_schema, "mechanism": mechanism_schema, "spatial": spatial_schema}
)


def text(kind: str) -> str:
    """One of `SCHEMAS` as `newmark-study schema` prints it."""
    return _laid_out(SCHEMAS[kind]())


def _laid_out(value: Any, indent: str = "", key: str = "") -> str:
    """JSON with what fits into a line on one line."""
    line = indent + key + json.dumps(value, ensure_ascii=False)
    if len(line) <= _WIDTH or not isinstance(value, dict | list):
        return line
    deeper = indent + "  "
    if isinstance(value, dict):
        parts = [
            _laid_out(part, deeper, f"{json.dumps(name, ensure_ascii=False)}: ")
            for name, part in value.items()
        ]
        return f"{indent}{key}{{\n" + ",\n".join(parts) + f"\n{indent}}}"
    parts = [_laid_out(part, deeper) for part in value]
    return f"{indent}{key}[\n" + ",\n".join(parts) + f"\n{indent}]"
