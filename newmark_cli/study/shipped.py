"""The shipped configs as plain data: what their studies draw, tabulate and expect.

Plain values, without pydantic: those who read results need them.  Values are spelled as in
CSVs, and numbers as YAML 1.1 has them.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml


def folder() -> Path:
    """Folder of the shipped configs: in the wheel, or at the top of a checkout."""
    package = Path(__file__).parents[1]
    in_wheel = package / "configs"
    return in_wheel if in_wheel.is_dir() else package.parent / "configs"


def names() -> tuple[str, ...]:
    """Names of the shipped configs."""
    return tuple(sorted(file.stem for file in folder().glob("*.yaml")))


@cache
def configs() -> Mapping[str, Mapping[str, Any]]:
    """Name of a shipped study → its config as the file has it."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return {
        name: yaml.load((folder() / f"{name}.yaml").read_text("utf-8"), loader) for name in names()
    }


def config_of(study: str, record: Mapping[str, Any], key: str) -> Any:
    """The config in a study's record; the shipped one where that lacks a key."""
    own = record.get("config")
    if isinstance(own, Mapping) and own.get(key) is not None:
        return own
    return configs().get(study, own)
