"""JSON Schemas of study configs and mechanism files, for editors: keys and types.

What ties keys together, and everything that is computed, is for `validate` to say.
"""

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from newmark_cli.mechanisms.models import Mechanism
from newmark_cli.mechanisms.spatial_model import SpatialMechanism
from newmark_cli.study.axes import ALIASES
from newmark_cli.study.config import MOST_CASES, Study
from newmark_cli.support.json_schema import Generator, JsonSchema, with_definitions

_WIDTH = 100


def config_schema() -> JsonSchema:
    """Of study configs: keys of a case stand at the top, in a list of cases, or in both."""
    written = Study.model_json_schema(schema_generator=Generator)
    definitions = written["$defs"]
    case = definitions["Case"]
    for key, value in case["properties"].items():
        one, several, *_ = value.get("anyOf", ({}, {}))
        if several.get("items") == one and "$ref" not in one:
            definitions[key] = one
            value["anyOf"][0] = several["items"] = {"$ref": f"#/$defs/{key}"}
    for name, usual in ALIASES.items():
        case["properties"][name] = case["properties"][usual]
    needed = [key for key in case.pop("required") if key not in ALIASES.values()]
    for key in case["properties"]:
        written["properties"][key] = {"$ref": f"#/$defs/Case/properties/{key}"}
    written["properties"]["cases"] = {
        "description": "grids of one study; keys at the top hold for each that does not set them",
        "type": "array",
        "items": {"$ref": "#/$defs/Case"},
        "minItems": 1,
        "maxItems": MOST_CASES,
    }
    written["required"] = ["study"]
    written["anyOf"] = [{"required": ["cases"]}, {"required": needed}]
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
    """JSON in which what fits on a line stays on one line."""
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
