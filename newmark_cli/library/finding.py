"""Problems for notebooks: by name, from a file, or made in Python."""

import uuid
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from newmark_cli.library.arguments import flag, one_of, shown
from newmark_cli.mechanisms import loading, registry
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import PythonFactory, Sized, name_and_arguments, with_ending
from newmark_cli.problems import python_problem
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.problems.python_problem import Definition
from newmark_cli.problems.residual_form import ROWS, Dae
from newmark_cli.support import documents
from newmark_cli.support.documents import Document
from newmark_cli.support.errors import ArgumentError, warn
from newmark_cli.support.spelling import nearest


def problem(given: Any, /, **arguments: Any) -> Problem:
    """A problem to march, from whatever describes it.

    Files are read anew at every call, so that a change shows.

    Args:
        given: One of

            - the name of a shipped problem, such as ``"andrews"``;
            - the name of a family, with its sizes as further arguments, or its label,
              ``"chain(links=20)"``;
            - the path of a mechanism file, ``"mine.yaml"`` or ``"mine"``, as text or
              `pathlib.Path`; where it names forces in Python, with ``allow_code=True``, and
              **their code runs**;
            - a Python file and a function in it that returns a `Definition`,
              ``"mine.py:factory"``, with its arguments as further ones.  **Its code runs.**
            - a `Definition`, or anything with its attributes;
            - a dict with the keys of a mechanism file;
            - a `Problem`, which is returned as it is.
        **arguments: Sizes of a family, or arguments of a factory.

    Returns:
        The problem: ``n`` coordinates, ``m`` constraints, ``u0`` and ``v0`` (n,),
        ``coordinate_names``, ``constraint_names``, and ``evaluate(t, u, v, λ)`` for the
        terms of M v' = f + G λ, 0 = Φ (eqs. 1).

    Raises:
        ArgumentError: When nothing of this kind is known.
        ProblemError: When a name is unknown, or a definition cannot be used.
        DocumentError: When a mechanism cannot be used; names the file and line, or the
            key of a dict.

    Examples:
        A shipped one, a family, and a mechanism without a file:

        >>> import newmark_cli as newmark
        >>> newmark.problem("andrews").m
        7
        >>> newmark.problem("chain", links=20).n
        40
        >>> swing = newmark.problem({
        ...     "points": {"O": {"fixed": (0, 0)}, "P": {"at": (1, 0), "mass": 2.0}},
        ...     "bars": {"rod": {"from": "O", "to": "P", "length": 1.0}},
        ...     "gravity": (0, -9.81),
        ... })
        >>> swing.coordinate_names, swing.constraint_names
        (('P.x', 'P.y'), ('bars.rod',))
    """
    if isinstance(given, str) and not arguments:  # a label, or a file without its ending
        given, arguments = name_and_arguments(given)
        given = given if given in PROBLEMS else with_ending(given)
    if isinstance(given, str) and given in FAMILIES:
        sizes = documents.validate(Document.of(given, arguments), FAMILIES[given].size)
        return Sized(given, tuple(sizes.model_dump().items())).load()
    if isinstance(given, str) and given.rpartition(":")[0].endswith(".py"):
        return _of_factory(given, arguments)
    if isinstance(given, str | Path) and Path(given).suffix in (".yaml", ".yml"):
        allowed = flag("allow_code", arguments.pop("allow_code", False))
        if not arguments:
            return _warned_of(loading.load(Path(given), loading.label(given), str(given), allowed))
    if arguments:
        raise ArgumentError(
            f"problem {shown(given)} takes no further arguments, given {', '.join(arguments)}"
        )
    if isinstance(given, Problem):
        return given
    if isinstance(given, str):
        if given not in PROBLEMS:
            names = (*PROBLEMS, *FAMILIES)
            raise ProblemError(f"unknown problem {given!r}{nearest(given, names)}")
        return registry.problem(given)
    if isinstance(given, Mapping):
        name = str(given.get("title") or "mechanism")
        return _warned_of(loading.built(name, Document.of("mechanism", given)))
    if isinstance(given, Definition) or hasattr(given, "mass_matrix"):
        defined = python_problem.from_definition(given, "definition", "definition")
        return replace(defined, code=uuid.uuid4().hex)  # its functions may be anything
    raise ArgumentError(
        f"a problem must be a name, a path, a dict, a Definition or a Problem, given {shown(given)}"
    )


def dae(subject: Any, equations: str = "ggl", *, integrals: bool = True) -> Dae:
    """The equations of a problem as F(t, y, y') = 0, for a code that solves general DAEs.

    Args:
        subject: What `problem` takes.
        equations: ``"index-3"``, ``"index-2"``, ``"index-1"`` or ``"ggl"``.
        integrals: Whether ∫λ and ∫η are unknowns in place of λ and η, which lowers the index.

    Returns:
        ``residual(t, y, yp)`` (N,), ``jacobian(t, y, yp)``, a consistent start ``t0``, ``y0``,
        ``yp0``, and ``state(y, yp)``, which gives u, v and λ.

    Raises:
        ArgumentError, ProblemError, DocumentError: As `problem`, and for other equations.

    Examples:
        >>> import newmark_cli as newmark
        >>> dae = newmark.dae("andrews", "index-2", integrals=False)
        >>> len(dae.y0), dae.algebraic
        (23, [16, 17, 18, 19, 20, 21, 22])
    """
    return Dae(problem(subject), one_of("equations", equations, ROWS), flag("integrals", integrals))


def _warned_of(loaded: Problem) -> Problem:
    warn(*loaded.doubts)
    return loaded


def _of_factory(label: str, arguments: Mapping[str, Any]) -> Problem:
    file, _, factory = label.rpartition(":")
    if not factory.isidentifier():
        raise ArgumentError(f'a Python problem is "file.py:factory", given {label!r}')
    spec = PythonFactory(Path(file).absolute(), factory, tuple(arguments.items()), label)
    return python_problem.load(spec.path, factory, arguments, spec.label, file)
