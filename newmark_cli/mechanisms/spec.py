"""Which problem: what a config says and a cell carries, before anything is built.

Each kind of problem is a frozen, hashable value with

- ``label``, the CSV's ``problem`` column, without commas;
- ``given``, as a config spells it;
- ``load()``, the problem itself, built once for all cells that share it; of the user's
  code only a description, whose functions cannot be called: see `with_problem`;
- ``traits()``, what `Traits` names of it, at no cost where it is large.

Another kind is another such class beside these and a member of `ProblemSpec`.
"""

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from newmark_cli import apart
from newmark_cli.mechanisms import registry
from newmark_cli.problems.problem import Problem, ProblemError


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


def _traits(problem: Problem) -> Traits:
    return Traits(problem.name, problem.n, problem.m, problem)


@dataclass(frozen=True)
class Shipped:
    """A mechanism that travels with the package.

    Attributes:
        name: One of `registry.PROBLEMS`.
    """

    name: str

    @property
    def label(self) -> str:
        """The name."""
        return self.name

    @property
    def given(self) -> str:
        """The name."""
        return self.name

    def load(self) -> Problem:
        """The problem; raises ProblemError when there is none of this name."""
        return registry.problem(self.name)

    def traits(self) -> Traits:
        """Of the problem; raises what `load` does."""
        return _traits(self.load())


@dataclass(frozen=True)
class Sized:
    """A member of a family.

    Attributes:
        family: One of `families.FAMILIES`.
        sizes: (parameter, number) pairs, in the family's order.
    """

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

    def load(self) -> Problem:
        """The problem."""
        return _sized(self)

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


@cache
def _sized(spec: Sized) -> Problem:
    from newmark_cli.mechanisms.families import FAMILIES

    return FAMILIES[spec.family].problem(spec.label, dict(spec.sizes))


@dataclass(frozen=True)
class MechanismFile:
    """A mechanism in a YAML file of the user's.

    Attributes:
        path: The file.
        spelled: How the user named it.
    """

    path: Path
    spelled: str

    @property
    def label(self) -> str:
        """Name of the file, without commas."""
        return self.path.name.replace(",", "_")

    @property
    def given(self) -> str:
        """As spelled."""
        return self.spelled

    def load(self) -> Problem:
        """The problem; raises DocumentError for a mistake in the file."""
        return _mechanism(self)

    def traits(self) -> Traits:
        """Of the problem; raises what `load` does."""
        return _traits(self.load())


@cache
def _mechanism(spec: MechanismFile) -> Problem:
    from newmark_cli.mechanisms import loading

    return loading.load(spec.path, spec.label, spec.spelled)


@dataclass(frozen=True)
class PythonFactory:
    """A problem that a Python function of the user's returns.

    Its code runs in processes of its own only; see `newmark_cli.apart`.

    Attributes:
        path: Python file.
        factory: Function in it.
        arguments: (name, value) pairs.
        spelled: File and function as the user named them.
        code: Digest that the code behind the problem must have; empty for any.
    """

    path: Path
    factory: str
    arguments: tuple[tuple[str, Any], ...]
    spelled: str
    code: str = ""

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

    def load(self) -> Problem:
        """The problem in a process of its own, elsewhere its description from one.

        Raises:
            ProblemError: When the code fails, is another, ends its process, or returns
                nonsense.
        """
        return _python(self) if apart.inside() else _described(self)

    def traits(self) -> Traits:
        """Of the problem; raises what `load` does."""
        return _traits(self.load())

    def pinned(self) -> "PythonFactory":
        """The same, to be loaded from the code that it has now."""
        return replace(self, code=self.load().code)


@cache
def _python(spec: PythonFactory) -> Problem:
    from newmark_cli.problems import python_problem

    file = spec.spelled.rpartition(":")[0]
    arguments = dict(spec.arguments)
    problem = python_problem.load(spec.path, spec.factory, arguments, spec.label, file)
    if spec.code not in ("", problem.code):
        raise ProblemError(f"{spec.spelled}: has changed since the run began")
    return problem


@cache
def _described(spec: PythonFactory) -> Problem:
    try:
        found = apart.call(_description, (spec,))
    except apart.ApartError as error:
        raise ProblemError(f"{spec.spelled}: cannot be loaded: {error}") from None
    if not isinstance(found, Problem):
        raise ProblemError(
            f"{spec.spelled}: cannot be loaded: returned something that is not a problem"
        )
    return found


def _description(spec: PythonFactory) -> Problem:
    """The problem with functions that pickle can carry."""
    problem = spec.load()
    elsewhere = partial(_elsewhere, spec.label)
    return replace(
        problem,
        function=elsewhere,
        derivatives=elsewhere,
        rates=elsewhere if problem.rates else None,
        potential=elsewhere if problem.potential else None,
    )


def _elsewhere(label: str, *arguments: Any) -> NoReturn:
    raise RuntimeError(f"{label} is code of the user's, which only runs in processes of its own")


@dataclass(frozen=True)
class ForcedMechanism(PythonFactory):
    """A mechanism in a YAML file with forces in Python, which is code as a whole.

    Attributes:
        path: The YAML file.
        factory, arguments: Not used.
        spelled: How the user named the file.
        code: As of `PythonFactory`.
    """

    @property
    def label(self) -> str:
        """Name of the file, without commas."""
        return self.path.name.replace(",", "_")

    @property
    def given(self) -> Any:
        """As spelled."""
        return self.spelled

    def load(self) -> Problem:
        """The problem in a process of its own, elsewhere its description from one."""
        return _forced(self) if apart.inside() else _described(self)


@cache
def _forced(spec: ForcedMechanism) -> Problem:
    from newmark_cli.mechanisms import loading

    problem = loading.load(spec.path, spec.label, spec.spelled, allow_code=True)
    if spec.code not in ("", problem.code):
        raise ProblemError(f"{spec.spelled}: has changed since the run began")
    return problem


@dataclass(frozen=True)
class Carried:
    """A problem of the user's that travels to another machine by its content.

    Attributes:
        spec: The problem; its path means nothing there.
        files: (path, content) pairs: its file, and the modules beside it that a
            Python problem imports; paths are relative to the file's folder.
    """

    spec: MechanismFile | PythonFactory
    files: tuple[tuple[str, bytes], ...]

    @property
    def label(self) -> str:
        """That of the problem."""
        return self.spec.label

    @property
    def given(self) -> Any:
        """As a config spells it."""
        return self.spec.given

    def load(self) -> Problem:
        """The problem, from copies of its files; see the problem's own."""
        return _carried(self)


@cache
def _carried(carried: Carried) -> Problem:
    with tempfile.TemporaryDirectory(prefix="newmark-study-") as folder:
        for name, content in carried.files:
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return replace(carried.spec, path=Path(folder) / carried.spec.path.name).load()


ProblemSpec = Shipped | Sized | MechanismFile | PythonFactory | Carried


def is_code(spec: ProblemSpec) -> bool:
    """Whether a problem is code of the user's, which runs in processes of its own."""
    return isinstance(spec.spec if isinstance(spec, Carried) else spec, PythonFactory)


_Found = TypeVar("_Found")


def with_problem(
    spec: ProblemSpec,
    function: Callable[..., _Found],
    *arguments: Any,
    timeout: float | None = None,
) -> _Found:
    """What a function returns of a problem; in a process of its own if that is the user's code.

    Args:
        spec: The problem.
        function: A function of a module; its first argument is the problem.
        arguments: Its others, such as pickle can carry.
        timeout: Most wall time of the process (s).

    Raises:
        ApartError: When the process does not come back.
        InputError: What the function raises.
    """
    if not is_code(spec):
        return function(spec.load(), *arguments)
    asked = (pinned(spec), function, arguments)
    found: _Found = apart.call(_loaded_with, asked, timeout, owner(spec))
    return found


def _loaded_with(spec: ProblemSpec, function: Callable[..., Any], arguments: Any) -> Any:
    return function(spec.load(), *arguments)


def owner(spec: ProblemSpec) -> ProblemSpec | None:
    """Who a process of the user's code is kept for: compiled code, which compiles for long."""
    return pinned(spec) if spec.load().compiled else None


def pinned(spec: ProblemSpec) -> ProblemSpec:
    """The same problem for another process, which does not take it when its code has changed."""
    return spec.pinned() if isinstance(spec, PythonFactory) else spec


def portable(spec: ProblemSpec) -> ProblemSpec:
    """The same problem for another machine: what its files said when it was loaded."""
    if isinstance(spec, PythonFactory):
        return Carried(spec.pinned(), tuple(spec.load().sources.items()))
    if isinstance(spec, MechanismFile):
        return Carried(spec, tuple(spec.load().sources.items()))
    return spec
