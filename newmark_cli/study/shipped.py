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


#: Keys of a config that are not of its cases.
STUDY_KEYS = ("study", "description", "figures", "tables", "expect", "cases")


def is_shipped(study: str, own: Any) -> bool:
    """Whether results are of the shipped study of their name, and not of a namesake.

    They are where the config in their record has its cases, whatever a version has added to
    them.  A CSV that travels without one goes by its name.
    """
    theirs = configs().get(study)
    if theirs is None or not isinstance(own, Mapping) or "cases" not in own:
        return theirs is not None
    shared = {key: value for key, value in theirs.items() if key not in STUDY_KEYS}
    cases = [{**shared, **case} for case in theirs.get("cases", [{}])]
    return _same(cases, own.get("cases"))


def _same(given: Any, recorded: Any) -> bool:
    """Whether a value of a shipped config is the recorded one, which spells out what it leaves."""
    if isinstance(given, list) or isinstance(recorded, list):
        ours, theirs = (v if isinstance(v, list) else [v] for v in (given, recorded))
        return len(ours) == len(theirs) and all(map(_same, ours, theirs))
    if isinstance(given, Mapping):
        return isinstance(recorded, Mapping) and all(
            _same(value, recorded.get(key)) for key, value in given.items()
        )
    if isinstance(recorded, Mapping):
        recorded = recorded.get("method", recorded.get("name"))
    try:
        return float(given) == float(recorded)
    except (TypeError, ValueError):
        return bool(given == recorded)


def config_of(study: str, record: Mapping[str, Any], key: str) -> Any:
    """The config in a study's record; of a shipped study the shipped one where that lacks a key."""
    own = record.get("config")
    if isinstance(own, Mapping) and own.get(key) is not None:
        return own
    return configs()[study] if is_shipped(study, own) else own
