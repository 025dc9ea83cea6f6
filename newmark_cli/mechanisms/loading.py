"""Mechanism files, planar or spatial."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from newmark_cli import documents
from newmark_cli.documents import Document
from newmark_cli.problems.problem import Problem

#: Keys that only spatial mechanisms have.
_SPATIAL = ("joints", "rates", "redundant", "torsion_springs", "torsion_dampers")


def load(path: Path, name: str, spelled: str | None = None) -> Problem:
    """Problem from a mechanism file, which carries what the file said as its source.

    Args:
        path: YAML file.
        name: Name of the problem.
        spelled: How errors name the file.

    Raises:
        DocumentError: For mistakes in the file, each with file, line and key.
    """
    document = documents.read(path, spelled)
    return replace(built(name, document), sources={path.name: document.content})


def built(name: str, document: Document) -> Problem:
    """Problem from a mechanism file that was read; raises DocumentError as `load` does."""
    if isinstance(document.data, dict):
        given = document.data.get("dimensions", 2)
        if isinstance(given, bool) or given not in (2, 3):
            raise document.error(("dimensions",), f"must be 2 or 3, given {given!r:.40}")
    # Either room is large, and one of them is enough.
    if is_spatial(document.data):
        from newmark_cli.mechanisms import spatial

        return spatial.built(name, document)
    from newmark_cli.mechanisms import planar

    if isinstance(document.data, dict) and "dimensions" not in document.data:
        message = "only spatial mechanisms have it; is 'dimensions: 3' missing?"
        for key in _SPATIAL:
            if key in document.data:
                raise document.error((key,), message)
        bodies = document.data.get("bodies")
        for key, body in bodies.items() if isinstance(bodies, dict) else ():
            if isinstance(body, dict) and "position" in body:
                raise document.error(("bodies", key, "position"), message)
    return planar.built(name, document)


def made(name: str, data: dict[str, Any]) -> Problem:
    """Problem from data that are known to be those of a mechanism."""
    if is_spatial(data):
        from newmark_cli.mechanisms import spatial
        from newmark_cli.mechanisms.spatial_model import SpatialMechanism

        return spatial.build(name, SpatialMechanism.model_validate(data))
    from newmark_cli.mechanisms import planar
    from newmark_cli.mechanisms.models import Mechanism

    return planar.build(name, Mechanism.model_validate(data))


def is_spatial(data: Any) -> bool:
    """Whether the data of a mechanism are of a spatial one."""
    return isinstance(data, dict) and data.get("dimensions", 2) == 3
