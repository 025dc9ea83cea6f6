"""Which problem: what a config says and a cell carries, before anything is built.

Each kind of problem is a frozen, hashable value with

- ``label``, the CSV's ``problem`` column, without commas;
- ``given``, as a config spells it;
- ``load()``, the problem itself, built once for all cells that share it.

Another kind is another such class beside these and a member of `ProblemSpec`.
"""

from dataclasses import dataclass
from functools import cache

from newmark_cli.problems import registry
from newmark_cli.problems.families import FAMILIES
from newmark_cli.problems.problem import Problem


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


@dataclass(frozen=True)
class Sized:
    """A member of a family.

    Attributes:
        family: One of `FAMILIES`.
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


@cache
def _sized(spec: Sized) -> Problem:
    return FAMILIES[spec.family].problem(spec.label, dict(spec.sizes))


ProblemSpec = Shipped | Sized
