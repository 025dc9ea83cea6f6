"""What validators of models check, said to editors by JSON Schema."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import GetJsonSchemaHandler
from pydantic_core import CoreSchema

JsonSchema = dict[str, Any]


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
