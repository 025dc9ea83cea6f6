"""A mechanism as its file has it: which numbers it has, and the problem with others in place."""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

import numpy as np

from newmark_cli.codes.truth import Force
from newmark_cli.mechanisms import loading, tables_beside
from newmark_cli.mechanisms.models import Table
from newmark_cli.problems.problem import Problem
from newmark_cli.support import documents
from newmark_cli.support.documents import Document

#: Keys of a mechanism file under which numbers are geometry: Φ tells of them.
_GEOMETRY = {"at", "velocity", "fixed", "length", "through", "direction", "position", "axes",
             "axis", "dimensions", "angular_velocity", "rates", "sliders", "joints", "body_points",
             "bars", "motions", "title"}  # fmt: skip
#: Of these, places of what springs and loads act on, which constraints may not tell of.
_PLACES = (("points", "fixed"), ("body_points", "at"))
#: Vectors that change as a whole, and by component where there are several.
_WHOLE = ("gravity",)
#: Parts of a file whose loads may have several numbers.
LOADS = (("forces", "force"), ("torques", "torque"))
#: What has the size of a load that is a law of time, or components of one.
SIZES = ("value", "rate", "acceleration", "amplitude", "powers", "sines", "table", "values")
#: What is left of a number that is left out: of some, files have positive ones only.
LEFT_OUT = 1e-9
#: How tables may be interpolated.
_INTERPOLATION = Table.model_fields["interpolation"]

Path = tuple[Any, ...]


@dataclass(frozen=True)
class FileNumbers:
    """A mechanism as its file has it, and how a problem is made of such a document."""

    document: Mapping[str, Any]
    make: Callable[[Mapping[str, Any]], Problem]
    #: Forces in Python, which stay as they are; None where there are none.
    push: Force | None = None

    @cached_property
    def mechanism(self) -> Problem:
        """The problem as the document has it, without forces in Python."""
        return self.make(self.document)

    def numbers(self) -> Iterator[Path]:
        """Paths of the numbers that are no geometry."""
        yield from _numbers(self.document, ())

    def places(self) -> Iterator[Path]:
        """Paths of the places of points."""
        for part, key in _PLACES:
            for name, point in (self.document.get(part) or {}).items():
                yield from ((part, name, key, i) for i in range(len(point.get(key) or ())))

    def motions(self) -> Iterator[Path]:
        """Paths of the numbers of driven coordinates."""
        yield from _numbers(self.document.get("motions") or {}, ("motions",))

    def loads(self) -> Iterator[Path]:
        """Paths of forces and torques of several numbers."""
        for part, key in LOADS:
            for name, load in (self.document.get(part) or {}).items():
                if len([*_sizes(load.get(key))]) > 1:
                    yield part, name, key

    def at(self, path: Path) -> Any:
        """The value at a path."""
        value: Any = self.document
        for key in path:
            value = value[key]
        return value

    def changed(self, paths: Sequence[Path], change: Callable[[Any], Any]) -> Problem:
        """The problem with other values at some paths."""
        document = copy.deepcopy(dict(self.document))
        for *way, last in paths:
            there: Any = document
            for key in way:
                there = there[key]
            there[last] = change(there.get(last) if isinstance(there, dict) else there[last])
        return self.make(document)


def file_of(problem: Problem, given: Any = None) -> FileNumbers | None:
    """The file that a problem was made of, with its tables; None where there is none.

    Args:
        problem: The problem.
        given: What described it: a mapping, if there is no file.
    """
    texts = [text for name, text in problem.sources.items() if name.endswith((".yaml", ".yml"))]
    if isinstance(given, Mapping):
        described = Document.of("mechanism", dict(given))
    elif len(texts) == 1:
        described = documents.parse(texts[0].decode(), problem.name)
    else:
        return None
    if not loading.is_mechanism(described.data):
        return None
    document = tables_beside.filled(described, problem.sources).data
    coded = loading.has_code(document)
    if coded:
        document = {key: part for key, part in document.items() if key != "python_forces"}

    def make(other: Mapping[str, Any]) -> Problem:
        return loading.built(problem.name, Document.of("mechanism", other))

    return FileNumbers(document, make, difference(problem, make(document)) if coded else None)


def _sizes(value: Any) -> Iterator[float]:
    """The numbers of a load that have its size, but for 0."""
    if isinstance(value, Mapping):
        value = [item for key, item in value.items() if key in SIZES]
    if isinstance(value, list | tuple):
        for item in value:
            yield from _sizes(item)
    elif isinstance(value, int | float) and value:
        yield value


def _numbers(value: Any, path: Path) -> Iterator[Path]:
    items: Any = ()
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    for key, item in items:
        if key in _GEOMETRY:
            continue
        if key in _WHOLE or (key == "inertia" and isinstance(item, list | tuple | Mapping)):
            yield (*path, key)
        if key in _WHOLE and sum(map(bool, item)) < 2:
            continue
        if isinstance(item, int | float) and not isinstance(item, bool):
            if item or path[-1:] == ("centre",):
                yield (*path, key)
        else:
            yield from _numbers(item, (*path, key))


def joined(path: Path) -> str:
    """Name of a number: its keys, with dots."""
    return ".".join(map(str, path))


def interpolations(table: Mapping[str, Any]) -> tuple[str, list[str]]:
    """How a table is interpolated, and how else it might be."""
    given = table.get("interpolation", _INTERPOLATION.default)
    return given, sorted({*get_args(_INTERPOLATION.annotation)} - {given})


def difference(problem: Problem, less: Problem) -> Force:
    """The force of what a problem has more than another."""
    return lambda t, u, v: np.asarray(
        problem.free_values(t, u, v).force - less.free_values(t, u, v).force
    )
