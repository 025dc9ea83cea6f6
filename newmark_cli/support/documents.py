"""YAML documents with line numbers, checked by pydantic, with one-line errors.

Numbers follow YAML 1.2 and common sense: ``1e-4`` is a number, whatever YAML
1.1 says.  Only plain scalars become numbers; what is quoted stays text.
"""

import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Self, TypeVar

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

from newmark_cli.support import files
from newmark_cli.support.errors import InputError, one_line
from newmark_cli.support.spelling import closest, nearest

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL = {".nan": float("nan"), "nan": float("nan"), ".inf": float("inf"), "inf": float("inf")}
_SWITCHES = {True: "on", False: "off"}
_CONSTANTS = {"true": True, "false": False, "null": None, "~": None, "": None}
# Anything larger is not a config, and would keep `validate` busy.
_MOST_VALUES = 100_000
_MOST_BYTES = 4_000_000
_DEEPEST = 30
#: Parser in C where PyYAML was built with it: ten times as fast.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TOO_DEEP = f"nested too deeply, at most {_DEEPEST} levels"

#: What errors name in place of a file.
GIVEN = "command line"
#: Mistakes of one document that are reported one by one; of the rest only their number.
MOST_REPORTED = 50

#: What pydantic says of Python, said of a document.
_WORDED: Mapping[str, str | Callable[[re.Match[str]], str]] = {
    "^Input should be a valid tuple": "must be a list",
    "^Input should be a valid dictionary": "must be a mapping of names to values",
    "^Input should be a valid string": "must be text",
    "^Input should be a valid number": "must be a number",
    "^Input should be a valid integer": "must be a whole number",
    "^Input should be": "must be",
    r"^\w+ should have (.*) after validation, not (\d+)$": r"must have \1, given \2",
    # 1e30 in a word, not in 31 digits.
    r"(?<=equal to )-?[\d.]+$": lambda number: f"{float(number[0]):.16g}",
}


# No text, no truth value: what is quoted stays text, here and in every editor.
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Truth = Annotated[bool, Strict()]
#: Last in the ``Annotated`` of a strict int: 1e4 is a whole number, as for JSON Schema.
WHOLE = BeforeValidator(lambda v: int(v) if isinstance(v, float) and v.is_integer() else v)

KeyPath = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


class Mistake(NamedTuple):
    """A mistake in a document."""

    line: int  #: counted from 1; 0 for the file as a whole
    path: KeyPath
    text: str  #: one line that names file, line, key and what is allowed


class DocumentError(InputError):
    """A document cannot be used; the text names file, line, key and what is allowed.

    Attributes:
        mistakes: Every mistake that was found, at most 50, in the order of
            their lines; the text of the error is that of the first.
        more: Number of mistakes beyond those.
        stopped: Whether there may be more than that.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.problem({"points": {"P": {"at": (1, 0), "weight": 2}}})
        Traceback (most recent call last):
        ...
        newmark_cli.support.documents.DocumentError: mechanism: points.P.weight: unknown key; ...
    """

    def __init__(
        self,
        text: str,
        mistakes: Sequence[Mistake] | None = None,
        more: int = 0,
        stopped: bool = False,
    ) -> None:
        super().__init__(text)
        self.mistakes = (Mistake(0, (), text),) if mistakes is None else tuple(mistakes)
        self.more, self.stopped = more, stopped


class Mistakes:
    """Gathers the mistakes of one document, so that checking goes on after the first."""

    def __init__(self) -> None:
        self._mistakes: dict[Mistake, None] = {}
        self._more, self._stopped = 0, False

    @property
    def full(self) -> bool:
        """Whether what comes now is only counted."""
        return len(self._mistakes) >= MOST_REPORTED

    def note(self, error: DocumentError) -> None:
        """Take up the mistakes of an error, each once."""
        self._mistakes.update(dict.fromkeys(error.mistakes))
        self._more += error.more

    def stop(self) -> None:
        """Parts of the document are not looked at any more."""
        self._stopped = True

    @contextmanager
    def gathered(self) -> Iterator[None]:
        """Take up a `DocumentError` of the block, which ends there."""
        try:
            yield
        except DocumentError as error:
            self.note(error)

    def refuse(self, more: int = 0) -> None:
        """Raise what was gathered, and the number of ``more`` mistakes, as one `DocumentError`."""
        if not self._mistakes:
            return
        mistakes = sorted(self._mistakes, key=lambda mistake: mistake.line)
        more += self._more + len(mistakes[MOST_REPORTED:])
        raise DocumentError(mistakes[0].text, mistakes[:MOST_REPORTED], more, self._stopped)


@dataclass(frozen=True)
class Document:
    """A parsed YAML file."""

    name: str  #: file as the user named it
    data: Any  #: mappings, lists and scalars
    lines: Mapping[KeyPath, int]  #: path of keys and indices → line, counted from 1
    given: frozenset[str] = frozenset()  #: keys at the top that the command line has set

    @classmethod
    def of(cls, name: str, data: Any) -> "Document":
        """A document of data that Python gives: errors name keys, and no lines.

        Raises:
            DocumentError: When they are nested too deeply.
        """
        lines: dict[KeyPath, int] = {}

        def plain(value: Any, path: KeyPath) -> Any:
            if len(path) > _DEEPEST:
                raise DocumentError(f"{name}: {_TOO_DEEP}")
            lines[path] = 0
            if callable(getattr(value, "tolist", None)):
                value = value.tolist()
            if isinstance(value, Mapping):
                # YAML 1.1, as PyYAML reads it, takes the keys on and off for true and false.
                keys = {key: _SWITCHES[key] if isinstance(key, bool) else key for key in value}
                return {keys[key]: plain(item, (*path, keys[key])) for key, item in value.items()}
            if isinstance(value, list | tuple):
                return [plain(item, (*path, i)) for i, item in enumerate(value)]
            return value

        return cls(name, plain(data, ()), lines)

    def renamed(self, names: Mapping[str, str], leaves: frozenset[str]) -> "Document":
        """The same with keys by their usual names.

        Args:
            names: Other name of a key → its usual one.
            leaves: Keys below which no key is of the document's own making.

        Raises:
            DocumentError: When a mapping has both names of a key.
        """
        known: Mapping[Any, Any] = names

        def walk(value: Any, path: KeyPath) -> Any:
            if isinstance(value, list):
                return [walk(item, (*path, i)) for i, item in enumerate(value)]
            if not isinstance(value, dict) or not leaves.isdisjoint(path):
                return value
            for name, usual in names.items():
                if name in value and usual in value:
                    raise self.error((*path, name), f"is the same as {usual}; give one of them")
            return {known.get(key, key): walk(item, (*path, key)) for key, item in value.items()}

        data = walk(self.data, ())
        usual = {tuple(known.get(k, k) for k in path): n for path, n in self.lines.items()}
        return replace(self, data=data, lines={**usual, **self.lines})

    def error(self, path: KeyPath, message: str) -> DocumentError:
        """Error at the line of ``path``, or of what encloses it."""
        line, key = self.line(path), _spell(path)
        where = f"{self.name}, line {line}" if line else self.name
        where = GIVEN if path[:1] and path[0] in self.given else where
        text = f"{where}: {key + ': ' if key else ''}{message}"
        return DocumentError(text, [Mistake(line, path, text)])

    def refuse(self, mistakes: Iterable[tuple[KeyPath, str]]) -> None:
        """Raise messages at their paths as one `DocumentError`; do nothing if there are none."""
        gathered = Mistakes()
        for path, message in mistakes:
            gathered.note(self.error(path, message))
        gathered.refuse()

    def line(self, path: KeyPath) -> int:
        """Line of ``path``, or of what encloses it."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)


#: In place of a value whose mistake is reported already; `validate` says no more of it.
REPORTED = object()


class _Unknown(str):
    """Stands for the value of an unknown key, so that other keys are still checked: its message."""


class StrictModel(BaseModel):
    """Frozen model that refuses unknown keys with the nearest valid name."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        allowed = cls.keys()
        if isinstance(data, dict):
            unknown = [key for key in data if key not in allowed]
            if unknown:
                # What was meant by a misspelled key is not missing.
                meant = (closest(key, allowed) for key in unknown[:MOST_REPORTED])
                data = dict.fromkeys(filter(None, meant), REPORTED) | data
                # Messages take longer to make than keys to find, and nobody reads a thousand.
                data |= dict.fromkeys(unknown, _Unknown())
                data |= {key: _Unknown(cls.unknown_key(key)) for key in unknown[:MOST_REPORTED]}
        elif not isinstance(data, cls):
            fields = cls.model_fields.items()
            required = (field.alias or name for name, field in fields if field.is_required())
            names = ", ".join(list(dict.fromkeys((*required, *allowed)))[:3])
            raise PydanticCustomError("mapping", f"must be a mapping of keys such as {names}")
        return data

    @classmethod
    @cache
    def keys(cls) -> tuple[str, ...]:
        """Keys as a document spells them."""
        return tuple(field.alias or name for name, field in cls.model_fields.items())

    @classmethod
    def missing_key(cls, key: str) -> str:
        """Message for a key at the top that must be given."""
        return "missing"

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """Message for a key that is not allowed here."""
        return f"unknown key{nearest(key, cls.keys())}"


def unknown_name(
    kind: str, value: object, allowed: Iterable[str], said: str = ""
) -> PydanticCustomError:
    """Error for a validator: a name that is not among those allowed, and what is said of it."""
    return PydanticCustomError(
        "unknown_name",
        "unknown {kind} {given}{said}{nearest}",
        {"kind": kind, "given": _short(value), "said": said, "nearest": nearest(value, allowed)},
    )


def misfit(key: str | None, message: str) -> PydanticCustomError:
    """Error for a model's validator that belongs to the line of one key, or of none."""
    context = {"message": message} | ({"key": key} if key else {})
    return PydanticCustomError("own", "{message}", context)


def refused(error: InputError) -> PydanticCustomError:
    """An error of a lower layer for a validator: its text says everything."""
    others = [mistake.text for mistake in getattr(error, "mistakes", ())[1:]]
    return PydanticCustomError("own", "{message}", {"message": str(error), "others": others})


def require_brackets(value: Any, info: ValidationInfo) -> None:
    """Refuse text with commas where a validator expects a list.

    Raises:
        PydanticCustomError: Says how to write the list.
    """
    if isinstance(value, str) and "," in value:
        message = f"write a list in brackets: {info.field_name}: [{_cut(value)}]"
        raise PydanticCustomError("own", "{message}", {"message": message})


def reported() -> PydanticCustomError:
    """Error for a validator where the mistake is reported already."""
    return PydanticCustomError("reported", "reported already")


def together(misfits: Iterable[PydanticCustomError]) -> None:
    """Raise each `misfit` of a model for its validator, the first of each key.

    Raises:
        PydanticCustomError: Stands for all of them.
    """
    first: dict[Any, PydanticCustomError] = {}
    for error in misfits:
        first.setdefault((error.context or {}).get("key"), error)
    if first:
        error, *also = first.values()
        raise PydanticCustomError("own", "{message}", {**(error.context or {}), "also": also})


class TiedModel(StrictModel):
    """Strict model whose keys are tied together by rules, each broken one a `misfit`."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        together(self._misfits())
        return self

    def _misfits(self) -> Iterator[PydanticCustomError]:
        """Keys that do not fit each other."""
        yield from ()


class RuledModel(TiedModel):
    """Such a model that is made from tables."""

    if TYPE_CHECKING:  # which have fields that mypy does not see

        def __getattr__(self, name: str) -> Any: ...


@dataclass(frozen=True)
class File:
    """Content of a file, from which it can be read without the file."""

    name: str  #: file as the user named it
    content: bytes = field(repr=False)  #: what it said
    #: name → content of files that it names, of a kind of file that may name some
    beside: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)

    def document(self) -> Document:
        """The document in it.

        Raises:
            DocumentError: If it is not UTF-8 text, empty, not YAML, or repeats a key.
        """
        try:
            text = self.content.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise DocumentError(f"{self.name}, line 1: not a text file in UTF-8") from None
        return parse(text, self.name)


def fetch(path: Path, name: str | None = None) -> File:
    """A file's content; raises `DocumentError` if it is missing or cannot be read."""
    name = name or str(path)
    try:
        content = files.read(path, _MOST_BYTES, given=True)
    except OSError as error:
        raise DocumentError(f"{one_line(name)}: cannot be read: {error.strerror}") from None
    return File(name, content)


def read(path: Path, name: str | None = None) -> Document:
    """Parse one YAML file; see :func:`fetch` and `File.document`."""
    return fetch(path, name).document()


def parse(text: str, name: str) -> Document:
    """Parse YAML text; see :func:`read`."""
    try:
        node = yaml.compose(text, Loader=_LOADER)
    except RecursionError:
        raise DocumentError(f"{name}, line 1: {_TOO_DEEP}") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        why = error.problem or "no reason given"
        if "nesting depth" in why:
            raise DocumentError(f"{name}, line {line}: {_TOO_DEEP}") from None
        if isinstance(error, yaml.composer.ComposerError) and error.context:
            why = error.context.partition(";")[0]
        raise DocumentError(f"{name}, line {line}: not YAML: {one_line(why)}") from None
    except yaml.reader.ReaderError as error:
        line = text.encode().count(b"\n", 0, error.position) + 1
        raise DocumentError(f"{name}, line {line}: not text: {error.reason}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise DocumentError(f"{name}, line 1: not YAML: {type(error).__name__}") from None
    if node is None:
        raise DocumentError(f"{name}, line 1: the file is empty")
    reader = _Reader(name)
    return Document(name, reader.data(node, ()), reader.lines)


def validate(
    document: Document,
    model: type[Model],
    data: Any = None,
    locate: Callable[[KeyPath], KeyPath] = lambda path: path,
    context: Any = None,
) -> Model:
    """Check a document against a model.

    Args:
        data: What to check in place of the document's data.
        locate: Path in ``data`` → path in the document, where they differ.

    Raises:
        DocumentError: For every mistake, one for each key.
    """
    try:
        return model.model_validate(document.data if data is None else data, context=context)
    except ValidationError as error:
        details = error.errors(include_url=False)
    # Branches of a union complain about the same key; the first speaks for all of them.
    placed: dict[KeyPath, Mapping[str, Any]] = {}
    above = {detail["loc"][:k] for detail in details for k in range(len(detail["loc"]))}
    for detail in chain.from_iterable(map(_apart, details)):
        # A list is too short for pydantic when its items are wrong.
        follows = detail["type"] == "too_short" and detail["loc"] in above
        if not (follows or detail["input"] is REPORTED or detail["type"] == "reported"):
            placed.setdefault(_place(document, detail, locate), detail)
    mistakes = Mistakes()
    # Messages take longer to make than places to find, and nobody reads a thousand.
    for path in sorted(placed, key=document.line)[:MOST_REPORTED]:
        detail = placed[path]
        messages = _messages(detail)
        at_the_top = detail["type"] == "missing" and len(detail["loc"]) == 1
        if at_the_top and issubclass(model, StrictModel):
            messages = iter((model.missing_key(str(path[-1])),))
        for message in messages:
            mistakes.note(document.error(path, message))
    mistakes.refuse(more=max(0, len(placed) - MOST_REPORTED))
    raise DocumentError("reported already", [])


class _Reader:
    """Turns YAML nodes into data, notes the line of each, and stops at no config.

    Aliases stand for the nodes that they refer to: limits hold for what they expand to, too.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self._values = self._characters = 0

    def data(self, node: yaml.Node, path: KeyPath) -> Any:
        """Data of a node."""
        self.lines.setdefault(path, _line(node))
        self._count(node)
        if len(path) > _DEEPEST:
            raise self._error(node, _TOO_DEEP)
        if isinstance(node, yaml.ScalarNode):
            return node.value if node.style else plain(node.value)
        if isinstance(node, yaml.SequenceNode):
            return [self.data(item, (*path, i)) for i, item in enumerate(node.value)]
        mapping: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self._error(key, "a key must be plain text")
            self._count(key)
            place = (*path, key.value)
            if key.value in mapping:
                first = f"first given in line {self.lines[place]}"
                raise self._error(key, f"duplicate key {_short(key.value)}, {first}")
            self.lines[place] = _line(key)
            mapping[key.value] = self.data(value, place)
        return mapping

    def _count(self, node: yaml.Node) -> None:
        self._values += 1
        self._characters += len(node.value) if isinstance(node, yaml.ScalarNode) else 0
        if self._values > _MOST_VALUES:
            raise self._error(node, f"more than {_MOST_VALUES} values")
        if self._characters > _MOST_BYTES:
            message = f"more than {_MOST_BYTES} characters with what aliases stand for"
            raise self._error(node, message)

    def _error(self, node: yaml.Node, message: str) -> DocumentError:
        return DocumentError(f"{self.name}, line {_line(node)}: {one_line(message)}")


def _line(place: Any) -> int:
    return int(place.start_mark.line) + 1


def plain(text: str) -> Any:
    """What plain text of a document means: a number, a constant, or text."""
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _INTEGER.fullmatch(text) and len(text) < 20:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    sign, bare = (-1.0, text[1:]) if text.startswith("-") else (1.0, text.removeprefix("+"))
    return sign * _SPECIAL[bare.lower()] if bare.lower() in _SPECIAL else text


def _apart(detail: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """A pydantic error, and those that `together` attached to it."""
    yield detail
    for error in detail.get("ctx", {}).get("also", ()):
        yield {**detail, "msg": error.message(), "ctx": error.context}


def _place(
    document: Document, detail: Mapping[str, Any], locate: Callable[[KeyPath], KeyPath]
) -> KeyPath:
    """Path in the document of one pydantic error."""
    # Pydantic adds names of union branches to a path; keep what the file has.
    path: KeyPath = ()
    for part in detail["loc"]:
        if locate((*path, part)) in document.lines:
            path = (*path, part)
    context = detail.get("ctx", {})
    if detail["type"] == "missing":
        return locate((*path, detail["loc"][-1]))
    return locate((*path, str(context["key"])) if "key" in context else path)


def _messages(detail: Mapping[str, Any]) -> Iterator[str]:
    """Messages for one pydantic error."""
    value, context = detail["input"], detail.get("ctx", {})
    message = detail["msg"].removeprefix("Value error, ")
    # Names that a literal may be, as pydantic lists them.
    allowed = re.findall("'([^']*)'", str(context.get("expected", "")))
    for theirs, ours in _WORDED.items():
        message = re.sub(theirs, ours, message)
    if detail["type"] == "missing":
        message = "missing"
    elif detail["type"] == "literal_error" and closest(value, allowed):
        message = f"unknown name {_short(value)}{nearest(value, allowed)}"
    elif isinstance(value, _Unknown):
        message = str(value)
    elif detail["type"] in ("float_type", "int_type") and isinstance(value, str):
        quoted = " without quotes" if not isinstance(plain(value), str) else ""
        message += f"{quoted}, given {_short(value)}"
    elif (
        "key" not in context
        and detail["type"] not in ("unknown_name", "own")  # whose text says what was given
        and not isinstance(value, dict | list)
    ):
        message += f", given {_short(value)}"
    yield from map(one_line, (message, *context.get("others", ())))


def _short(value: object) -> str:
    # `reprlib` looks at no more of a list or mapping than it shows.
    return _cut(repr(value[:60]) if isinstance(value, str) else reprlib.repr(value))


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def _spell(path: KeyPath) -> str:
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return one_line(text)[:120]
