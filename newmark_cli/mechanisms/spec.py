"""Which problem: what a config says and a cell carries, before anything is built.

Each kind of problem is a frozen, hashable value with

- ``label``, the CSV's ``problem`` column, without commas;
- ``given``, as a config spells it;
- ``load()``, the problem itself, built once for all cells that share it; of the user's
  code only a description, whose functions cannot be called: see `with_problem`;
- ``traits()``, what `Traits` names of it, at no cost where it is large.

What a file of the user's said is part of the value: a study is of what its files said when
it was read, and the next one of what they say then.

Another kind is another such class beside these and a member of `ProblemSpec`.
"""

import json
import math
import os
import re
import tempfile
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NoReturn, Self, TypeVar

from newmark_cli.mechanisms import loading, registry
from newmark_cli.problems.problem import Problem, ProblemError
from newmark_cli.support import apart
from newmark_cli.support.documents import Document, File, plain


@dataclass(frozen=True)
class Traits:
    """Facts of a problem that a config needs, for which a large one need not be built.

    Attributes:
        name: Name of the problem.
        n, m: Coordinates and constraints.
        sample: The problem, or a small one that is quadratic, single or symmetric
            where the problem is.
    """

    name: str
    n: int
    m: int
    sample: Problem

    @property
    def compiled(self) -> bool:
        """Whether its functions are compiled."""
        return self.sample.compiled


class _Loaded(ABC):
    """A problem that must be built to know its traits."""

    @abstractmethod
    def load(self) -> Problem:
        """The problem."""

    def traits(self) -> Traits:
        """Of the problem; raises what `load` does."""
        problem = self.load()
        return Traits(problem.name, problem.n, problem.m, problem)


@dataclass(frozen=True)
class Shipped(_Loaded):
    """A mechanism that travels with the package."""

    name: str

    @property
    def label(self) -> str:
        """The name."""
        return self.name

    given = label

    def load(self) -> Problem:
        """The problem; raises ProblemError when there is none of this name."""
        return registry.problem(self.name)


@dataclass(frozen=True)
class Sized:
    """A member of a family; its sizes are (parameter, number) pairs, in the family's order."""

    family: str
    sizes: tuple[tuple[str, int], ...]

    @property
    def label(self) -> str:
        """Family and sizes, such as ``chain(links=1000)``."""
        return f"{self.family}({' '.join(f'{name}={size}' for name, size in self.sizes)})"

    @property
    def given(self) -> dict[str, dict[str, int]]:
        """Family → parameter → number."""
        return {self.family: dict(self.sizes)}

    @cache  # noqa: B019 - one for all cells that share it
    def load(self) -> Problem:
        """The problem."""
        from newmark_cli.mechanisms.families import FAMILIES

        return FAMILIES[self.family].problem(self.label, dict(self.sizes))

    def traits(self) -> Traits:
        """From small members: each unit of a size adds as much as the one before."""
        names, n, m = [name for name, _ in self.sizes], 0, 0
        for at in product((2, 3), repeat=len(names)):
            member = Sized(self.family, tuple(zip(names, at, strict=True))).load()
            # Linear in each size by itself: between the members of 2 and of 3.
            parts = (
                size - 2 if here == 3 else 3 - size
                for here, (_, size) in zip(at, self.sizes, strict=True)
            )
            share = math.prod(parts)
            n, m = n + share * member.n, m + share * member.m
        twos = tuple((name, 2) for name in names)
        return Traits(self.label, n, m, Sized(self.family, twos).load())


@dataclass(frozen=True)
class MechanismFile(_Loaded):
    """A mechanism in a YAML file of the user's: what the file said when it was read."""

    file: File

    @property
    def label(self) -> str:
        """Name of the file, without commas."""
        return loading.label(self.file.name)

    @property
    def given(self) -> Any:
        """The file as the user named it."""
        return self.file.name

    def load(self) -> Problem:
        """The problem; raises DocumentError for a mistake in the file."""
        return _mechanism(self)


@cache
def _mechanism(spec: MechanismFile) -> Problem:
    return loading.loaded(spec.file, spec.label)


@dataclass(frozen=True)
class Code(_Loaded):
    """A problem that is user code: it runs only in separate processes.

    See `newmark_cli.support.apart`.

    Attributes:
        path: The file, in whose folder others are looked for.
        code: Digest that the code behind the problem must have; empty if it was not read.
        reading: Which reading of the code it is: what the code reads, and does not count,
            may have changed before the next.
        files: (path, content) pairs of the code where it is carried to another machine,
            relative to the folder of the file, whose own path means nothing there.
        described: The problem as it was read, with functions that cannot be called; it stays in
            this process.
    """

    path: Path
    _: KW_ONLY
    code: str = ""
    reading: str = ""
    files: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)
    described: Problem | None = field(default=None, compare=False, repr=False)

    @property
    @abstractmethod
    def named(self) -> str:
        """How errors name it."""

    @abstractmethod
    def run(self) -> Problem:
        """The problem, for which the code runs here."""

    def load(self) -> Problem:
        """The problem in a process of its own, elsewhere its description from one.

        Raises:
            ProblemError: When the code fails, is another, or ends its process.
        """
        if apart.inside():
            return _run(self)
        return self.described or _described(self)

    def read(self, timeout: float | None = None) -> Self:
        """The same with the code that it has now, read once for all that comes.

        Args:
            timeout: Most wall time of loading it (s).

        Raises:
            ProblemError: As `load`.
        """
        reading = uuid.uuid4().hex
        problem = _described(self, reading, timeout)
        return replace(self, code=problem.code, reading=reading, described=problem)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"described": None}


def _run(spec: Code) -> Problem:
    problem = _run_once(replace(spec, code="", reading=""))
    if spec.code not in ("", problem.code):
        raise ProblemError(f"{spec.named}: has changed since the run began")
    return problem


@cache  # a process is of one reading
def _run_once(spec: Code) -> Problem:
    with _unpacked(spec) as here:
        return here.run()


@contextmanager
def _unpacked(spec: Code) -> Iterator[Code]:
    """The same spec, its carried files unpacked where the code looks for them."""
    if not spec.files:
        yield spec
        return
    # Those of absolute paths are looked for there, and are not ours to write.
    carried = {Path(name): text for name, text in spec.files if not os.path.isabs(name)}
    levels = max(name.parts.count("..") for name in carried)
    with tempfile.TemporaryDirectory(prefix="newmark-study-") as outermost:
        folder = Path(outermost, *("level",) * levels)
        for name, text in carried.items():
            path = Path(os.path.normpath(folder / name))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text)
        folder.mkdir(parents=True, exist_ok=True)
        yield replace(spec, path=folder / spec.path.name)


def _described(spec: Code, reading: str | None = None, timeout: float | None = None) -> Problem:
    try:
        problem: Problem = apart.call(_description, (spec,), timeout, owner=reading)
    except apart.ApartError as error:
        raise ProblemError(f"{spec.named}: cannot be loaded: {error}") from None
    return problem


def _description(spec: Code) -> Problem:
    """The problem with functions that can be pickled but not called."""
    problem = spec.load()
    elsewhere = partial(_elsewhere, problem.name)
    return replace(
        problem,
        function=elsewhere,
        derivatives=elsewhere,
        potential=elsewhere if problem.potential else None,
    )


def _elsewhere(name: str, *arguments: Any) -> NoReturn:
    raise RuntimeError(f"{name} is user code, which only runs in separate processes")


@dataclass(frozen=True)
class PythonFactory(Code):
    """A problem that a Python function of the user's returns.

    Attributes:
        factory: Function in the file.
        arguments: (name, value) pairs.
        spelled: File and function as the user named them.
    """

    factory: str
    arguments: tuple[tuple[str, Any], ...]
    spelled: str

    @property
    def label(self) -> str:
        """File, function and arguments, such as ``car_axis.py:car_axis(compiled=True)``."""
        arguments = " ".join(f"{name}={value}" for name, value in self.arguments)
        text = f"{self.path.name}:{self.factory}" + (f"({arguments})" if arguments else "")
        return text.replace(",", "_")

    @property
    def given(self) -> dict[str, Any]:
        """As a config spells it."""
        return {"python": self.spelled, "args": dict(self.arguments)}

    @property
    def named(self) -> str:
        """As the user does."""
        return self.spelled

    def run(self) -> Problem:
        """The problem, for which the code runs here."""
        from newmark_cli.problems import python_problem

        file = self.spelled.rpartition(":")[0]
        arguments = dict(self.arguments)
        return python_problem.load(self.path, self.factory, arguments, self.label, file)


@dataclass(frozen=True)
class ForcedMechanism(Code, MechanismFile):
    """A mechanism in a YAML file with forces in Python, which is code as a whole."""

    @property
    def named(self) -> str:
        """By the file and the key of what runs."""
        return f"{self.file.name}: python_forces"

    def run(self) -> Problem:
        """The problem, for which the code runs here."""
        return loading.loaded(self.file, self.label, self.path.parent)


@dataclass(frozen=True)
class Inline(MechanismFile):
    """A mechanism that stands in a study, as JSON in place of a file."""

    @property
    def given(self) -> Any:
        """The mechanism itself."""
        return json.loads(self.file.content)


def inline(data: Any) -> Inline:
    """The mechanism with these keys.

    Raises:
        DocumentError: For every mistake, each with its key.
    """
    name = str(data.get("title") or "mechanism") if isinstance(data, dict) else "mechanism"
    loading.built(name, Document.of("mechanism", data))
    return Inline(File(name, json.dumps(data).encode()))


#: A label such as ``chain(links=20)``: a name, and arguments between blanks.
_LABEL = re.compile(r"([^()]+)\(([^()]*)\)")


def name_and_arguments(label: str) -> tuple[str, dict[str, Any]]:
    """Family and sizes, or Python factory and arguments, from the label of a problem.

    Raises:
        ProblemError: When an argument is given twice.
    """
    match = _LABEL.fullmatch(label)
    if match is None:
        return label, {}
    arguments: dict[str, Any] = {}
    for part in filter(None, re.split("[ ,]+", match[2].strip())):
        name, _, value = part.partition("=")
        if name in arguments:
            raise ProblemError(f"{label}: {name} is given twice")
        arguments[name] = plain(value)
    return match[1], arguments


def with_ending(name: str, folder: Path = Path()) -> str:
    """A YAML file by its name without the ending, if there is one; else the name as it is."""
    if name and not Path(name).suffix:
        for ending in (".yaml", ".yml"):
            if os.path.isfile(folder / f"{name}{ending}"):
                return name + ending
    return name


ProblemSpec = Shipped | Sized | MechanismFile | PythonFactory


def is_code(spec: ProblemSpec) -> bool:
    """Whether a problem is user code, which runs in separate processes."""
    return isinstance(spec, Code)


_Result = TypeVar("_Result")


def with_problem(
    spec: ProblemSpec,
    function: Callable[..., _Result],
    *arguments: Any,
    timeout: float | None = None,
) -> _Result:
    """What a function returns of a problem; in a separate process if that is the user's code.

    Args:
        spec: The problem.
        function: A function of a module; its first argument is the problem.
        arguments: Its others, such as pickle can carry.
        timeout: Most wall time of the process (s).

    Raises:
        ApartError: When the process does not come back.
        InputError: What the function raises.
    """
    if not isinstance(spec, Code):
        return function(spec.load(), *arguments)
    return beside(spec, function, *arguments, timeout=timeout)


def beside(
    spec: ProblemSpec,
    function: Callable[..., _Result],
    *arguments: Any,
    timeout: float | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> _Result:
    """The same, in a separate process in any case; ``stopped`` as of `apart.call`."""
    request = (spec, function, arguments)
    result: _Result = apart.call(_loaded_with, request, timeout, owner(spec), stopped)
    return result


def owner(spec: ProblemSpec) -> str | None:
    """Whose separate processes work on a problem: those of a reading of code, or all others'."""
    return spec.reading or None if isinstance(spec, Code) else "problems without code"


def _loaded_with(spec: ProblemSpec, function: Callable[..., Any], arguments: Any) -> Any:
    return function(spec.load(), *arguments)


def portable(spec: ProblemSpec) -> ProblemSpec:
    """The same problem for another machine: what its files said when it was read."""
    if isinstance(spec, Code):
        return replace(spec, files=tuple(spec.load().sources.items()), described=None)
    return spec
