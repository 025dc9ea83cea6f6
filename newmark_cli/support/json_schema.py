"""JSON Schema of the models: what their validators check, said to editors.

Only keywords that drafts 7 and 2020-12 share are used, but for the place of
definitions: many editors know draft 7 alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import GetJsonSchemaHandler
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema, core_schema

JsonSchema = dict[str, Any]
_EXACT = 2**53


@dataclass(frozen=True)
class Shown:
    """In ``Annotated``: the JSON Schema of a type is what a function makes of it."""

    #: (pydantic's schema, what turns such schemas into JSON Schema) → JSON Schema.
    make: Callable[[CoreSchema, GetJsonSchemaHandler], JsonSchema]

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        return self.make(schema, handler)


def also(**keywords: Any) -> Shown:
    """The type's own schema with these keywords, ``not_`` for ``not``.

    For what a validator beside it checks.
    """
    added = {key.rstrip("_"): value for key, value in keywords.items()}
    return Shown(lambda schema, handler: handler(schema) | added)


class Generator(GenerateJsonSchema):
    """Pydantic's schemas without what tells a reader nothing."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """No titles that only repeat the key."""
        return False

    def tuple_schema(self, schema: core_schema.TupleSchema) -> JsonSchema:
        """Lists of one kind of item by ``items``, which draft 7 reads too."""
        written = super().tuple_schema(schema)
        kinds = written.get("prefixItems", [])
        if kinds and all(kind == kinds[0] for kind in kinds):
            del written["prefixItems"]
            written["items"] = kinds[0]
        return written

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchema:
        """Defaults as one would write them."""
        written = super().default_schema(schema)
        default = written.get("default")
        if isinstance(default, list) and len(default) == 1:
            (default,) = default
        if isinstance(default, dict):
            default = {key: value for key, value in default.items() if value is not None}
        if default in (None, "", [], {}):
            written.pop("default", None)
        else:
            written["default"] = default
        return written


def with_definitions(written: JsonSchema, title: str) -> JsonSchema:
    """What pydantic wrote with its dialect and a title; models in it become definitions."""
    definitions: JsonSchema = {}

    def moved(part: Any) -> Any:
        if isinstance(part, list):
            return [moved(item) for item in part]
        if isinstance(part, float) and part.is_integer() and abs(part) < _EXACT:
            # Which of 0 and 0.0 pydantic writes depends on its version.
            return int(part)
        if not isinstance(part, dict):
            return part
        schema = {
            key: {name: moved(item) for name, item in value.items()}
            if key in ("properties", "$defs")
            else moved(value)
            for key, value in part.items()
        }
        # Pydantic gives models their class's name as title.
        name = schema.pop("title", None)
        if not isinstance(name, str):
            return schema
        definitions[name] = schema
        return {"$ref": f"#/$defs/{name}"}

    for name, definition in written.pop("$defs").items():
        definition.pop("title", None)
        definitions[name] = moved(definition)
    written.pop("title")
    document = moved(written)
    return {
        "$schema": GenerateJsonSchema.schema_dialect,
        "title": title,
        **document,
        "$defs": dict(sorted(definitions.items())),
    }
