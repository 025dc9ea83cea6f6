"""Mechanism files, planar or spatial."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from newmark_cli import documents
from newmark_cli.documents import Document
from newmark_cli.problems.problem import Problem, Push

#: Keys that only spatial mechanisms have.
_SPATIAL = ("joints", "rates", "redundant")
#: Keys of which a mechanism has at least one, and a study has none.
_OF_MECHANISMS = ("points", "bodies", "dimensions")


def load(path: Path, name: str, spelled: str | None = None, allow_code: bool = False) -> Problem:
    """Problem from a mechanism file, which carries what the file said as its source.

    Args:
        path: YAML file.
        name: Name of the problem.
        spelled: How errors name the file.
        allow_code: Whether its forces in Python may be loaded.

    Raises:
        DocumentError: For mistakes in the file, each with file, line and key.
        ProblemError: When forces in Python cannot be used.
    """
    document = documents.read(path, spelled)

    def code(problem: Problem, pushes: Sequence[Push]) -> Problem:
        from newmark_cli.problems import python_forces

        return python_forces.pushed(problem, pushes, path.parent, os.path.dirname(document.name))

    found = built(name, document, code if allow_code else None)
    return replace(found, sources={path.name: document.content, **found.sources})


def has_code(data: Any) -> bool:
    """Whether the data of a mechanism name forces in Python."""
    return isinstance(data, dict) and bool(data.get("python_forces"))


def built(name: str, document: Document, code: Any = None) -> Problem:
    """Problem from a mechanism file that was read; raises DocumentError as `load` does.

    Args:
        name: Name of the problem.
        document: The file.
        code: Adds forces in Python, see `planar.built`; refused if omitted.
    """
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
    return planar.built(name, document, code)


def made(name: str, data: dict[str, Any]) -> Problem:
    """Problem from data that are known to be those of a mechanism."""
    if is_spatial(data):
        from newmark_cli.mechanisms import spatial
        from newmark_cli.mechanisms.spatial_model import SpatialMechanism

        return spatial.build(name, SpatialMechanism.model_validate(data))
    from newmark_cli.mechanisms import planar
    from newmark_cli.mechanisms.models import Mechanism

    return planar.build(name, Mechanism.model_validate(data))


def is_mechanism(data: Any) -> bool:
    """Whether the data of a file are those of a mechanism rather than of a study."""
    return isinstance(data, dict) and not data.keys().isdisjoint(_OF_MECHANISMS)


def assembled(problem: Problem) -> list[str]:
    """A line on how far assembling has moved what a file guesses; none if it guesses nothing.

    Args:
        problem: A mechanism; of a spatial one the origins of bodies are looked at.
    """
    mechanism = getattr(problem.drawing, "mechanism", problem.drawing)
    if mechanism is None or not mechanism.assemble:
        return []
    if len(problem.axes) == 3:
        guesses = {name: body.position for name, body in mechanism.bodies.items()}
        size = 12  # an origin and three directors
    else:
        guesses = {name: mechanism.points[name].at for name in problem.points}
        size = 2
    found = problem.u0.reshape(-1, size)[: len(guesses)]
    moved = {
        name: math.dist(place[: len(guess)], guess)
        for (name, guess), place in zip(guesses.items(), found, strict=True)
    }
    farthest = max(moved, key=lambda name: moved[name])
    if moved[farthest] < 1e-12:
        return ["  assembled: everything is where the file has it"]
    return [f"  assembled: {farthest}, the farthest, is {moved[farthest]:.3g} m from its guess"]


def is_spatial(data: Any) -> bool:
    """Whether the data of a mechanism are of a spatial one."""
    return isinstance(data, dict) and data.get("dimensions", 2) == 3
