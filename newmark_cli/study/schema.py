"""JSON Schemas of study configs and mechanism files, for editors: keys and types.

What ties keys together, and everything that is computed, is for `validate` to say.
"""

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType

from pydantic.json_schema import GenerateJsonSchema

from newmark_cli.mechanisms.models import Mechanism
from newmark_cli.mechanisms.spatial_model import SpatialMechanism
from newmark_cli.study.axis import ALIASES
from newmark_cli.study.config import MOST_CASES, Study
from newmark_cli.support.json_schema import JsonSchema


def config_schema() -> JsonSchema:
    """Of study configs: keys of a case stand at the top, in a list of cases, or in both."""
    written = Study.model_json_schema()
    case = written["$defs"]["Case"]
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
    return _titled(written, "Study config of newmark-study")


SCHEMAS: Mapping[str, Callable[[], JsonSchema]] = MappingProxyType(
    {
        "config": config_schema,
        "mechanism": lambda: _titled(
            Mechanism.model_json_schema(), "Mechanism file of newmark-study"
        ),
        "spatial": lambda: _titled(
            SpatialMechanism.model_json_schema(), "Spatial mechanism file of newmark-study"
        ),
    }
)


def text(kind: str) -> str:
    """One of `SCHEMAS` as `newmark-study list --schema` prints it."""
    return json.dumps(SCHEMAS[kind](), ensure_ascii=False)


def _titled(written: JsonSchema, title: str) -> JsonSchema:
    """What pydantic wrote, with its dialect and another title."""
    return {"$schema": GenerateJsonSchema.schema_dialect, **written, "title": title}
