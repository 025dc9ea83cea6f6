"""YAML documents with line numbers, checked by pydantic, with one-line errors.

Numbers follow YAML 1.2 and common sense: ``1e-4`` is a number, whatever YAML
1.1 says.  Only plain scalars become numbers; what is quoted stays text.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from newmark_cli.errors import InputError

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = {".nan": float("nan"), "nan": float("nan"), ".inf": float("inf"), "inf": float("inf")}
_CONSTANTS = {"true": True, "false": False, "null": None, "~": None, "": None}
_MOST_NODES = 100_000
_MOST_BYTES = 4_000_000

#: Custom errors whose text already says what was given.
_SELF_EXPLAINING = frozenset({"unknown_key", "unknown_name", "own"})

KeyPath = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


class DocumentError(InputError):
    """A document cannot be used; the text names file, line, key and what is allowed."""


@dataclass(frozen=True)
class Document:
    """A parsed YAML file.

    Attributes:
        name: File as the user named it.
        data: Mappings, lists and scalars.
        lines: Path of keys and indices → line, counted from 1.
    """

    name: str
    data: Any
    lines: Mapping[KeyPath, int]

    def error(self, path: KeyPath, message: str) -> DocumentError:
        """Error at the line of ``path``, or of what encloses it."""
        spot = path
        while spot and spot not in self.lines:
            spot = spot[:-1]
        key = _spell(path)
        return DocumentError(
            f"{self.name}, line {self.lines.get(spot, 1)}: {key + ': ' if key else ''}{message}"
        )


class StrictModel(BaseModel):
    """Frozen model that refuses unknown keys with the nearest valid name."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False, populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            allowed = [field.alias or name for name, field in cls.model_fields.items()]
            for key in data:
                if key not in allowed:
                    raise PydanticCustomError(
                        "unknown_key", "unknown key{nearest}", {
                            "key": key, "nearest": nearest(key, allowed),
                        },
                    )  # fmt: skip
        elif not isinstance(data, cls):
            raise PydanticCustomError("mapping", "must be a mapping of keys to values")
        return data


def nearest(given: object, allowed: Iterable[str]) -> str:
    """Text that offers the nearest allowed name and lists all of them."""
    allowed = list(allowed)
    close = difflib.get_close_matches(str(given), allowed, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    return f"{hint} allowed: {', '.join(allowed)}"


def unknown_name(kind: str, given: object, allowed: Iterable[str]) -> PydanticCustomError:
    """Error for a validator: a name that is none of the allowed ones."""
    return PydanticCustomError(
        "unknown_name",
        "unknown {kind} {given}{nearest}",
        {"kind": kind, "given": _short(given), "nearest": nearest(given, allowed)},
    )


def misfit(key: str, message: str) -> PydanticCustomError:
    """Error for a model's validator that belongs to the line of one key."""
    return PydanticCustomError("own", "{message}", {"message": message, "key": key})


def refused(error: InputError) -> PydanticCustomError:
    """An error of a lower layer for a validator: its text says everything."""
    return PydanticCustomError("own", "{message}", {"message": str(error)})


def read(path: Path, name: str | None = None) -> Document:
    """Parse one YAML file.

    Args:
        path: The file.
        name: How errors name it; the path when omitted.

    Raises:
        DocumentError: When the file is missing, unreadable, not UTF-8 text,
            empty, not YAML, or repeats a key.
    """
    name = name or str(path)
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise DocumentError(f"{name}: cannot be read: {error.strerror}") from None
    if len(content) > _MOST_BYTES:
        raise DocumentError(f"{name}: larger than {_MOST_BYTES} bytes, not a config")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DocumentError(f"{name}, line 1: not a text file in UTF-8") from None
    return parse(text, name)


def parse(text: str, name: str) -> Document:
    """Parse YAML text; see :func:`read`."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise DocumentError(
            f"{name}, line {line}: not YAML: {_one_line(error.problem or 'no reason given')}"
        ) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise DocumentError(f"{name}, line {line}: not text: {error.reason}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise DocumentError(f"{name}, line 1: not YAML: {type(error).__name__}") from None
    if node is None:
        raise DocumentError(f"{name}, line 1: the file is empty")
    reader = _NodeReader(name)
    try:
        data = reader.value(node, ())
    except RecursionError:
        raise DocumentError(f"{name}, line 1: nested too deeply") from None
    return Document(name, data, reader.lines)


def validate(
    document: Document,
    model: type[Model],
    data: Any = None,
    locate: Callable[[KeyPath], KeyPath] = lambda path: path,
    context: Any = None,
) -> Model:
    """Check a document against a model.

    Args:
        document: The document.
        model: The pydantic model.
        data: What to check in place of the document's data.
        locate: Path in ``data`` → path in the document, where they differ.
        context: Handed to the validators.

    Raises:
        DocumentError: For the first mistake, by line.
    """
    try:
        return model.model_validate(document.data if data is None else data, context=context)
    except ValidationError as error:
        details = error.errors(include_url=False)
    mistakes = [_located(document, detail, locate) for detail in details]
    path, message = min(mistakes, key=lambda mistake: document.lines.get(mistake[0], 0))
    raise document.error(path, message)


class _NodeReader:
    """Turns composed nodes into data, noting the line of each."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self._nodes = 0

    def value(self, node: yaml.Node, path: KeyPath) -> Any:
        self._nodes += 1
        line = node.start_mark.line + 1
        self.lines.setdefault(path, line)
        if self._nodes > _MOST_NODES:
            raise DocumentError(f"{self.name}, line {line}: more than {_MOST_NODES} values")
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.value(item, (*path, i)) for i, item in enumerate(node.value)]
        assert isinstance(node, yaml.ScalarNode)
        return node.value if node.style is not None else _plain(node.value)

    def _mapping(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                raise DocumentError(f"{self.name}, line {line}: a key must be plain text")
            key = key_node.value
            if key in mapping:
                raise DocumentError(
                    f"{self.name}, line {line}: duplicate key {key!r}, first given in "
                    f"line {self.lines[(*path, key)]}"
                )
            self.lines[(*path, key)] = line
            mapping[key] = self.value(value_node, (*path, key))
        return mapping


def _plain(text: str) -> Any:
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _INTEGER.fullmatch(text) and len(text) < 20:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    sign, bare = (-1.0, text[1:]) if text.startswith("-") else (1.0, text.removeprefix("+"))
    return sign * _SPECIAL[bare.lower()] if bare.lower() in _SPECIAL else text


def _located(
    document: Document, detail: ErrorDetails, locate: Callable[[KeyPath], KeyPath]
) -> tuple[KeyPath, str]:
    """Path in the document and message of one pydantic error."""
    # Pydantic adds names of union branches to a path; keep what the file has.
    path: KeyPath = ()
    for part in detail["loc"]:
        if locate((*path, part)) in document.lines:
            path = (*path, part)
    context = detail.get("ctx", {})
    if detail["type"] == "missing":
        return locate((*path, detail["loc"][-1])), "missing"
    message = detail["msg"].removeprefix("Value error, ")
    if "key" in context:
        return locate((*path, str(context["key"]))), _one_line(message)
    if detail["type"] not in _SELF_EXPLAINING and not isinstance(detail["input"], dict | list):
        message += f", given {_short(detail['input'])}"
    return locate(path), _one_line(message)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _spell(path: KeyPath) -> str:
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return _one_line(text)[:120]
