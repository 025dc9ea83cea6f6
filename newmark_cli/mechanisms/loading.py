"""Mechanism files, planar or spatial."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from newmark_cli.mechanisms import tables_beside
from newmark_cli.problems.problem import Problem
from newmark_cli.support import documents
from newmark_cli.support.documents import Document, DocumentError, File, KeyPath

if TYPE_CHECKING:
    from newmark_cli.mechanisms.builder import Builder

#: Keys that only spatial mechanisms have.
_SPATIAL = ("joints", "rates", "redundant")
#: Keys of which a mechanism has at least one, and a study has none.
OF_MECHANISMS = ("points", "bodies", "dimensions")
#: Keys that only studies have.
_OF_STUDIES = ("study", "cases", "problem", "h", "measure")


def load(path: Path, name: str, shown_as: str | None = None, allow_code: bool = False) -> Problem:
    """Problem from a mechanism file as it is now; errors name it as it is spelled."""
    return loaded(tables_beside.fetch(path, shown_as), name, path.parent if allow_code else None)


def loaded(file: File, name: str, folder: Path | None = None) -> Problem:
    """Problem from the content of a mechanism file, which is among its sources.

    Raises:
        DocumentError: For mistakes in the file, each with file, line and key.
        ProblemError: When forces in Python cannot be used.
    """
    problem = built(name, file.document(), folder, dict(file.beside))
    sources = {Path(file.name).name: file.content, **dict(file.beside), **problem.sources}
    return replace(problem, sources=sources)


def label(file: str | Path) -> str:
    """Name of the problem in a mechanism file: that of the file, without commas."""
    return Path(file).name.replace(",", "_")


def has_code(data: Any) -> bool:
    """Whether the data of a mechanism name forces in Python."""
    return isinstance(data, dict) and bool(data.get("python_forces"))


def built(
    name: str,
    document: Document,
    folder: Path | None = None,
    tables: Mapping[str, bytes] = MappingProxyType({}),
) -> Problem:
    """Problem from a mechanism file that was read; its code runs if its folder is given.

    Tables in files have their content from ``tables``, by name.

    Raises:
        DocumentError: For every mistake that can be found, each with file, line and
            key: of the file itself, or of a mechanism without a consistent start.
    """
    require_mechanism(document)
    document = tables_beside.filled(document, tables)
    kind = _builder(document.data)
    try:
        mechanism = documents.validate(document, kind.model)
    except DocumentError as error:
        mistakes = documents.Mistakes()
        mistakes.note(error)
        with mistakes.gathered():
            _check_rest(kind, name, document, error)
        mistakes.refuse()
        raise
    from newmark_cli.mechanisms import guess, start

    builder = kind(name, document, mechanism)
    for path, push in builder.pushes.items():
        if folder is None:
            message = f"{push.python.rpartition(':')[0]} is code, which runs only with --allow-code"
            raise document.error((*path, "python"), message)
    problem = start.consistent(builder)
    if builder.pushes and folder is not None:
        from newmark_cli.problems import python_problem

        pushes, shown = tuple(builder.pushes.values()), os.path.dirname(document.name)
        problem = python_problem.pushed(problem, pushes, folder, shown)
    return replace(problem, doubts=guess.doubts(problem, document))


def require_mechanism(document: Document) -> None:
    """Refuse a study, other dimensions, and what only mechanisms in space have in the plane."""
    data = document.data
    if not isinstance(data, dict):
        return
    if not is_mechanism(data) and not data.keys().isdisjoint(_OF_STUDIES):
        problem = data.get("problem")
        instead = f", {problem}," if isinstance(problem, str) else ""
        raise document.error((), f"is a study, not a mechanism; give its problem{instead} instead")
    dimensions = data.get("dimensions", 2)
    if isinstance(dimensions, bool) or dimensions not in (2, 3):
        raise document.error(("dimensions",), f"must be 2 or 3, given {dimensions!r:.40}")
    if "dimensions" not in data:
        bodies = data.get("bodies")
        bodies = bodies.items() if isinstance(bodies, dict) else ()
        paths: list[KeyPath] = [(key,) for key in _SPATIAL if key in data]
        paths += [
            ("bodies", key, "position")
            for key, body in bodies
            if isinstance(body, dict) and "position" in body
        ]
        if paths:
            message = "only spatial mechanisms have it; is 'dimensions: 3' missing?"
            raise document.error(paths[0], message)


def _check_rest(kind: "type[Builder]", name: str, document: Document, error: DocumentError) -> None:
    """What can be said of a file apart from mistakes that are known.

    Raises:
        DocumentError: For mistakes in the relations between parts that are well formed.
    """
    others_allowed = kind.model.model_fields.keys() - set(kind.parts)
    wrong: set[KeyPath] = {mistake.path[:2] for mistake in error.mistakes}
    parts = {path for path in wrong if path[:1] and path[0] in kind.parts}
    others = {path[0] for path in wrong - parts if path}
    if error.more or () in wrong or any(len(path) < 2 for path in parts) or others - others_allowed:
        return
    sound = {
        key: {name: part for name, part in value.items() if (key, name) not in parts}
        if key in kind.parts
        else value
        for key, value in document.data.items()
        if key not in others
    }
    if "bodies" in sound and not sound["bodies"]:
        return  # there are some, all of them with mistakes
    if "assemble" in others:
        sound["assemble"] = True  # nobody knows whether positions are meant to fit
    from newmark_cli.mechanisms.builder import ALIASES

    broken = [(ALIASES.get(str(key), str(key)), str(part)) for key, part in parts]
    kind(name, document, documents.validate(document, kind.model, sound), broken)


def _builder(data: Any) -> "type[Builder]":
    # Either room is large, and one of them is enough.
    if is_spatial(data):
        from newmark_cli.mechanisms import spatial

        return spatial.SpatialBuilder
    from newmark_cli.mechanisms import planar

    return planar.PlanarBuilder


def made(name: str, data: dict[str, Any]) -> Problem:
    """Problem from data that are known to be those of a mechanism, whose start is consistent."""
    kind = _builder(data)
    return kind(name, Document(name, {}, {}), kind.model.model_validate(data)).problem()


def is_mechanism(data: Any) -> bool:
    """Whether the data of a file are those of a mechanism rather than of a study."""
    return isinstance(data, dict) and not data.keys().isdisjoint(OF_MECHANISMS)


def is_spatial(data: Any) -> bool:
    """Whether the data of a mechanism are of a spatial one."""
    return isinstance(data, dict) and data.get("dimensions", 2) == 3
