"""Tables in files beside a mechanism file: read with it, and put where it names them."""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

from newmark_cli.support import documents
from newmark_cli.support.documents import Document, DocumentError, File, KeyPath

#: Columns of a file → keys of the table that they stand for.
_OF_TIME = {"t": "times", "value": "values"}
_OF_LENGTH = {"length": "lengths", "force": "values"}


def fetch(path: Path, name: str | None = None) -> File:
    """A mechanism file, and the tables that it names, from the folder in which it is.

    Raises:
        DocumentError: If one of them is missing or cannot be read.
    """
    file = documents.fetch(path, name)
    try:
        document = file.document()
    except DocumentError:
        return file  # told once it is read
    beside = {}
    for key_path, table in _naming(document.data, ()):
        named = str(table["file"])
        try:
            beside[named] = documents.fetch(path.parent / named, named).content
        except DocumentError as error:
            raise document.error((*key_path, "file"), str(error)) from None
    return replace(file, beside=tuple(beside.items()))


def filled(document: Document, beside: Mapping[str, bytes]) -> Document:
    """The document with the values of its files in the tables that name them.

    Raises:
        DocumentError: For a mistake in a file, with its line, at the key that names it.
    """
    if not any(_naming(document.data, ())):
        return document
    data = deepcopy(document.data)
    for path, table in [*_naming(data, ())]:
        table |= _of_file(document, path, table, beside)
        del table["file"]
    return replace(document, data=data)


def _naming(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    """Path and keys of every table with a file."""
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
        if path[-1:] == ("table",) and isinstance(value.get("file"), str):
            yield path, value
    elif isinstance(value, list):
        items = enumerate(value)
    for key, item in items:
        yield from _naming(item, (*path, key))


def _of_file(
    document: Document, path: KeyPath, table: dict[str, Any], beside: Mapping[str, bytes]
) -> dict[str, Any]:
    """Columns of the file of a table, by their keys."""
    columns, named = _OF_LENGTH if path[:1] == ("springs",) else _OF_TIME, table["file"]
    where = (*path, "file")
    for key in columns.values():
        if key in table:
            raise document.error((*path, key), "stands in the file; leave it out")
    if named not in beside:
        raise document.error(where, "only in a mechanism file, beside which the table stands")
    try:
        values = _columns(beside[named].decode("utf-8-sig"), list(columns))
    except UnicodeDecodeError:
        raise document.error(where, f"{named}: not a text file in UTF-8") from None
    except ValueError as error:
        raise document.error(where, f"{named}, {error}") from None
    return dict(zip(columns.values(), values, strict=True))


def _columns(text: str, names: Sequence[str]) -> tuple[list[float], list[float]]:
    """Two columns of a CSV by their names; raises ValueError with a line."""
    lines = csv.reader(io.StringIO(text), skipinitialspace=True)
    head = [name.strip() for name in next(lines, [])]
    if missing := [name for name in names if name not in head]:
        wanted = ",".join(names)
        raise ValueError(f"line 1: no column {missing[0]!r}; the first line must be {wanted}")
    places = [head.index(name) for name in names]
    first: list[float] = []
    second: list[float] = []
    for row in lines:
        if not row:
            continue
        for name, place, of in zip(names, places, (first, second), strict=True):
            word = row[place] if place < len(row) else ""
            try:
                number = float(word)
            except ValueError:
                number = math.nan
            if not math.isfinite(number):
                raise ValueError(f"line {lines.line_num}: {name}: must be a number, given {word!r}")
            of.append(number)
        if len(first) > 1 and first[-1] <= first[-2]:
            raise ValueError(
                f"line {lines.line_num}: {names[0]}: must increase: {first[-1]:g} follows "
                f"{first[-2]:g}"
            )
    return first, second
