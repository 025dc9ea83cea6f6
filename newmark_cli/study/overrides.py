"""Keys of a study that the command line sets: ``h=[1e-3,1e-4] form=v-lambda``.

A study that is changed like this is another study, with a name and a CSV of its own.  Its figures,
tables and expectations are those of the study as its file has it, and are left out.
"""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from newmark_cli.study.axis import ALIASES
from newmark_cli.study.shipped import STUDY_KEYS
from newmark_cli.support import documents
from newmark_cli.support.documents import GIVEN, Document, DocumentError

_SETTING = re.compile(r"([A-Za-z_]\w*)=(.*)", re.DOTALL)
#: Letters of a study's name, beyond which a digest stands for the rest.
_LONGEST = 80


def parsed(arguments: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Names of configs, and key → value as text, from the arguments of a command.

    Raises:
        DocumentError: When a key is given twice or without a value.
    """
    configs, settings = list[str](), dict[str, str]()
    for argument in arguments:
        match = None if os.path.exists(argument) else _SETTING.fullmatch(argument)
        if match is None:
            configs.append(argument)
            continue
        key = ALIASES.get(match[1], match[1])
        if key in settings:
            raise DocumentError(f"{GIVEN}: {key}: given twice")
        if not match[2].strip():
            raise DocumentError(f"{GIVEN}: {key}: needs a value, such as h=1e-3")
        if key in STUDY_KEYS[1:]:
            text = "can be set in the study's file only; here its name, and keys of its cases"
            raise DocumentError(f"{GIVEN}: {key}: {text}")
        settings[key] = match[2]
    return configs, settings


def changed(document: Document, settings: Mapping[str, str]) -> Document:
    """A study with other values of some keys, which hold for all of its cases.

    Raises:
        DocumentError: When a value is not YAML, or the study would keep its name.
    """
    document = document.renamed(ALIASES, frozenset(("problem",)))
    if not settings or not isinstance(document.data, dict) or "study" not in document.data:
        return document  # what it lacks is told later
    values = {key: documents.parse(text, f"{GIVEN}: {key}") for key, text in settings.items()}
    lines = {(key, *path): 0 for key, of in values.items() for path in of.lines}
    gone = {*settings, *({"t_end", "steps"} if {"t_end", "steps"} & settings.keys() else ())}

    def kept(data: Any) -> Any:
        return {k: v for k, v in data.items() if k not in gone} if isinstance(data, dict) else data

    data = {k: v for k, v in kept(document.data).items() if k not in STUDY_KEYS[2:-1]}
    if isinstance(data.get("cases"), list):
        data["cases"] = [kept(case) for case in data["cases"]]
    own = document.data["study"]
    data |= {"study": _name(own, settings)} | {key: of.data for key, of in values.items()}
    if isinstance(problem := data.get("problem"), str) and "problem" in settings:
        # A file is looked for here, not beside the study.
        data["problem"] = os.path.abspath(problem) if os.path.isfile(problem) else problem
    changed = replace(
        document, data=data, lines={**document.lines, **lines}, given=frozenset(settings)
    )
    if data["study"] == own:
        raise changed.error(("study",), f"must be another name than that of the file, {own!r}")
    return changed


def _name(study: Any, settings: Mapping[str, str]) -> str:
    text = "-".join((str(study), *(f"{key}-{value}" for key, value in settings.items())))
    # A sign is kept, brackets and quotes are not.
    name = re.sub(r"[^\w.-]", "-", re.sub(r"[]\[{}'\"\s]", "", text), flags=re.ASCII)
    if len(name) <= _LONGEST:
        return name
    return f"{name[: _LONGEST - 9]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
