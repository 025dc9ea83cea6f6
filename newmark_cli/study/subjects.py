"""The problem that a study config names, and an integrator of the user's own."""

import re
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter, ValidationInfo

from newmark_cli.mechanisms import loading, spec, tables_beside
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import ProblemSpec
from newmark_cli.newmark import own_integrator
from newmark_cli.newmark.own_integrator import OwnIntegrator
from newmark_cli.problems import user_code
from newmark_cli.study.kinds import unknown
from newmark_cli.support import apart, documents
from newmark_cli.support.documents import misfit
from newmark_cli.support.errors import InputError

# Every row of the CSV has the problem's name, which is file, function and arguments.
_LONGEST_LABEL = 2_000


@dataclass(frozen=True)
class Surroundings:
    """Context on which a config's meaning depends besides its text."""

    folder: Path = Path()  #: where files that it names are looked for
    allow_code: bool = False  #: whether problems in Python may be loaded
    timeout: float | None = None  #: most wall time of loading one (s)
    #: those of the document that were read, by how it names them, None for one whose mistakes are
    #: reported already: what their files said then holds for all of it
    problems: dict[Hashable, ProblemSpec | None] = field(default_factory=dict, compare=False)


def problem_of(value: Any, info: ValidationInfo) -> ProblemSpec:
    """The problem that a config names; `Surroundings` are the context of the validation."""
    around = info.context or Surroundings()
    if isinstance(value, ProblemSpec):
        return value
    if isinstance(value, str):
        value = _labelled(value, around)
    if loading.is_mechanism(value):
        return _read_once(repr(value), "", partial(spec.inline, value), around)
    if isinstance(value, dict) and "python" in value:
        return _python_problem(value, around)
    if isinstance(value, dict):
        if len(value) != 1:
            raise ValueError("must be one family with its sizes, such as {chain: {links: 1000}}")
        (family,) = value
        if family not in FAMILIES:
            raise documents.unknown_name("family of problems", family, (*FAMILIES, "python"))
        # As a mapping, so that a mistake is found under the family's name.
        sizes: Any = dict.__class_getitem__((str, FAMILIES[family].size))
        check: TypeAdapter[Any] = TypeAdapter(sizes)
        return spec.Sized(family, tuple(check.validate_python(value)[family]))
    if isinstance(value, str) and value in FAMILIES:
        sizes = ", ".join(f"{parameter}: N" for parameter in FAMILIES[value].parameters)
        raise ValueError(f"needs a size: {{{value}: {{{sizes}}}}}")
    if isinstance(value, str) and Path(value).suffix in (".yaml", ".yml"):
        path = (around.folder / value).absolute()
        read = partial(_mechanism, path, value, around)
        return _read_once(value, loading.label(value), read, around)
    if not isinstance(value, str) or value not in PROBLEMS:
        raise unknown("problem", value, (*PROBLEMS, *FAMILIES))
    return spec.Shipped(value)


def _labelled(text: str, around: Surroundings) -> Any:
    """What a label stands for, ``chain(links=20)`` or the name of a file without its ending."""
    name, arguments = spec.name_and_arguments(text)
    if re.fullmatch(r".+\.py:\w+", name):
        return {"python": name, "args": arguments}
    if name in FAMILIES and arguments:
        return {name: arguments}
    return text if text in (*PROBLEMS, *FAMILIES) else spec.with_ending(text, around.folder)


def _mechanism(path: Path, name: str, around: Surroundings) -> ProblemSpec:
    """What a mechanism file says now."""
    file, with_code = tables_beside.fetch(path, name), False
    with suppress(InputError):  # what is wrong with it is told later
        with_code = around.allow_code and loading.has_code(file.document().data)
    if with_code:
        return spec.ForcedMechanism(file, path).read(around.timeout)
    mechanism = spec.MechanismFile(file)
    mechanism.load()
    return mechanism


def _python_problem(value: dict[str, Any], around: Surroundings) -> ProblemSpec:
    for key in value:
        if key not in ("python", "args"):
            raise documents.unknown_name("key", key, ("python", "args"))
    file, colon, factory = str(value["python"]).rpartition(":")
    arguments = value.get("args", {})
    if not colon or not file or not factory.isidentifier():
        raise misfit("python", 'must be "file.py:factory"')
    if not isinstance(arguments, dict):
        raise misfit("args", "must be a mapping of names to values")
    if not all(isinstance(item, str | int | float | bool | None) for item in arguments.values()):
        raise misfit("args", "values must be numbers, text, true or false")
    if not around.allow_code:
        raise misfit("python", f"{file} is code, which runs only with --allow-code")
    path = (around.folder / file).absolute()
    made = spec.PythonFactory(path, factory, tuple(arguments.items()), str(value["python"]))
    return _read_once(made, made.label, partial(made.read, around.timeout), around)


def _read_once(
    key: Hashable, label: str, read: Callable[[], ProblemSpec], around: Surroundings
) -> ProblemSpec:
    """The problem, once it has shown that it can be used."""
    if key not in around.problems:
        if len(label) > _LONGEST_LABEL:
            raise ValueError(
                f"too long for a name in the CSV: {len(label)} characters, at most {_LONGEST_LABEL}"
            )
        if re.search("[\ud800-\udfff]", label):
            raise ValueError("half a surrogate pair cannot be written into a CSV")
        around.problems[key] = None
        try:
            around.problems[key] = read()
        except InputError as error:
            raise documents.refused(error) from None
    problem = around.problems[key]
    if problem is None:
        raise documents.reported()
    return problem


def own_integrator_of(name: str, around: Surroundings) -> OwnIntegrator:
    """The integrator that a class is.

    Args:
        name: ``file.py:Class``.
        around: Where the file is looked for, and whether its code may run.

    Raises:
        ValueError: When it cannot be used: which, and why.
    """
    file = name.rpartition(":")[0]
    if not around.allow_code:
        raise ValueError(f"{file} is code, which runs only with --allow-code")
    path = (around.folder / file).absolute()
    try:
        return _integrator(name, path, path.read_bytes(), around.timeout)
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror}") from None
    except (InputError, apart.ApartError) as error:
        raise ValueError(str(error)) from None


@lru_cache(maxsize=64)
def _integrator(name: str, path: Path, source: bytes, timeout: float | None) -> OwnIntegrator:
    found = apart.call(_integrator_made, (name, path, source), timeout)
    assert isinstance(found, OwnIntegrator)
    return found


def _integrator_made(name: str, path: Path, source: bytes) -> OwnIntegrator:
    """The integrator, in a process apart."""
    file, _, kind = name.rpartition(":")
    made = partial(own_integrator.of, name)
    return cast(OwnIntegrator, user_code.made_of(path, source, kind, made, file, "class "))
