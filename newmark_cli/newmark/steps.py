"""Step sizes of a march: constant, or a sequence that is refined with h.

Sequences are prescribed, so that orders can be measured: a march at h/2 follows the same
pattern with steps of half the size.  Nothing here chooses a step size by an error.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from newmark_cli.support.arrays import Array, IndexArray
from newmark_cli.support.errors import InputError

#: Sizes that a random sequence draws from, evenly spaced: pairs of successive ones are few,
#: and what depends on them is computed once.
LEVELS = 9
#: Times nearer to a step than this, relative to its size, are that step's.
_SAME = 1e-9


class SequenceError(InputError):
    """A sequence of step sizes that is not usable; says which and why."""


@dataclass(frozen=True)
class Constant:
    """Steps of one size."""

    label: ClassVar[str] = "constant"

    def factors(self, count: int, h: float) -> Array:
        """(count,) ones."""
        return np.ones(count)


@dataclass(frozen=True)
class Change:
    """One change of the step size: h before a time, a multiple of it from there on.

    Attributes:
        change: The multiple, positive.
        at: The time, counted from the start of the march (s); the change is at the first
            step that begins there or later.
    """

    change: float
    at: float

    def __post_init__(self) -> None:
        _require_positive("change", self.change)
        _require_positive("at", self.at)

    @property
    def label(self) -> str:
        """How the CSV names it; `parse` reads it back."""
        return f"change {self.change!r} at {self.at!r}"

    def factors(self, count: int, h: float) -> Array:
        """(count,) ones, then the multiple."""
        before = math.ceil(self.at / h * (1 - _SAME))
        return np.where(np.arange(count) < before, 1.0, self.change)


@dataclass(frozen=True)
class Alternate:
    """Step sizes that take turns.

    Attributes:
        alternate: Multiples of h, positive, two or more.
        every: Steps before the next one takes its turn.
    """

    alternate: tuple[float, ...]
    every: int = 1

    def __post_init__(self) -> None:
        if len(self.alternate) < 2:
            raise SequenceError(f"alternate: needs two sizes or more, given {self.alternate!r}")
        for factor in self.alternate:
            _require_positive("alternate", factor)
        if self.every < 1:
            raise SequenceError(f"every: must be at least 1, given {self.every!r}")

    @property
    def label(self) -> str:
        """How the CSV names it; `parse` reads it back."""
        return f"alternate {' '.join(map(repr, self.alternate))} every {self.every}"

    def factors(self, count: int, h: float) -> Array:
        """(count,) the multiples in turn."""
        turns = np.arange(count) // self.every % len(self.alternate)
        return np.array(self.alternate)[turns]


@dataclass(frozen=True)
class Random:
    """Step sizes drawn from `LEVELS` evenly spaced multiples of h between two.

    Attributes:
        random: The smallest and the largest multiple, positive.
        seed: Of the generator; the first steps do not depend on how many there are.
    """

    random: tuple[float, float]
    seed: int = 1

    def __post_init__(self) -> None:
        low, high = self.random
        _require_positive("random", low)
        if not low < high < math.inf:
            raise SequenceError(f"random: must ascend, given {low!r}, {high!r}")
        if self.seed < 0:
            raise SequenceError(f"seed: must not be negative, given {self.seed!r}")

    @property
    def label(self) -> str:
        """How the CSV names it; `parse` reads it back."""
        return f"random {self.random[0]!r} {self.random[1]!r} seed {self.seed}"

    def factors(self, count: int, h: float) -> Array:
        """(count,) multiples as drawn."""
        low, high = self.random
        drawn = np.floor(LEVELS * np.random.default_rng(self.seed).random(count))
        return np.asarray(low + (high - low) * (drawn / (LEVELS - 1)))


def _require_positive(name: str, value: float) -> None:
    if not 0 < value < math.inf:
        raise SequenceError(f"{name}: must be positive, given {value!r}")


StepSequence = Constant | Change | Alternate | Random
CONSTANT = Constant()
#: Sequences by the key that a config gives.
SEQUENCES: Mapping[str, type[StepSequence]] = MappingProxyType(
    {"constant": Constant, "change": Change, "alternate": Alternate, "random": Random}
)
_NUMBER = r"(\S+)"
_LABELS = (
    (rf"change {_NUMBER} at {_NUMBER}", lambda a, b: Change(float(a), float(b))),
    (
        rf"alternate (.+) every {_NUMBER}",
        lambda a, b: Alternate(tuple(map(float, a.split())), int(b)),
    ),
    (
        rf"random {_NUMBER} {_NUMBER} seed {_NUMBER}",
        lambda a, b, c: Random((float(a), float(b)), int(c)),
    ),
)


def parse(label: str) -> StepSequence:
    """Read a `label`.

    Raises:
        SequenceError: If the label is not valid.
    """
    if label == CONSTANT.label:
        return CONSTANT
    for pattern, make in _LABELS:
        if match := re.fullmatch(pattern, label):
            try:
                return make(*match.groups())
            except ValueError:
                break
    forms = "constant, change 0.5 at 0.5, alternate 1 0.5 every 5, random 0.5 2 seed 1"
    raise SequenceError(f"unknown sequence of step sizes {label!r}; such as: {forms}")


class TimeGrid:
    """Times and sizes of the steps of a march; step k ends at ``t(k)``.

    Attributes:
        t0: Time of step 0 (s).
        h: Step size (s); of a sequence that of which its sizes are multiples.
        sizes: (N,) sizes of the steps (s); None where all are h.
        before: Sizes of the step before the first and of the one before that (s).
    """

    def __init__(
        self,
        t0: float,
        h: float,
        sizes: Array | None = None,
        before: tuple[float, float] | None = None,
    ) -> None:
        self.t0, self.h, self.sizes = t0, h, sizes
        self.before = (self.size(1),) * 2 if before is None else before

    @classmethod
    def of(cls, sequence: StepSequence, t0: float, h: float, count: int) -> "TimeGrid":
        """So many steps of a sequence."""
        return cls(t0, h, None if sequence == CONSTANT else h * sequence.factors(count, h))

    def scaled(self, factor: float) -> "TimeGrid":
        """The same steps, each this many times as long."""
        sizes = None if self.sizes is None else self.sizes * factor
        before = self.before[0] * factor, self.before[1] * factor
        return TimeGrid(self.t0, self.h * factor, sizes, before)

    @cached_property
    def _elapsed(self) -> Array:
        """(N + 1,) sums of the sizes, each rounded once.

        All sizes are whole multiples of the last place of the smallest.
        """
        assert self.sizes is not None
        unit = math.ulp(float(self.sizes.min(initial=self.h)))
        sums = accumulate((int(size / unit) for size in self.sizes.tolist()), initial=0)
        return np.array([float(total) for total in sums]) * unit

    def t(self, step: int) -> float:
        """Time after so many steps (s)."""
        if self.sizes is None:
            return self.t0 + step * self.h
        return self.t0 + float(self._elapsed[step])

    def times(self, steps: IndexArray) -> Array:
        """Times after these numbers of steps (s)."""
        if self.sizes is None:
            return np.asarray(self.t0 + steps * self.h, float)
        return np.asarray(self.t0 + self._elapsed[steps])

    def size(self, step: int) -> float:
        """Size of a step, counted from 1 (s); 0 and −1 are those before."""
        if step < 1:
            return self.before[-step]
        return self.h if self.sizes is None or not len(self.sizes) else float(self.sizes[step - 1])

    @property
    def varies(self) -> bool:
        """Whether any step differs in size from the one before."""
        return self.sizes is not None or self.before != (self.h, self.h)

    @cached_property
    def successive(self) -> Array:
        """(3, N) sizes of each step, of the one before it and of the one before that (s).

        Of steps of one size the first three stand for all.
        """
        sizes = np.full(3, self.h) if self.sizes is None else self.sizes
        padded = np.concatenate([self.before[::-1], sizes])
        return np.array([padded[2:], padded[1:-1], padded[:-2]])

    @cached_property
    def _kinds(self) -> tuple[Array, IndexArray]:
        """(K, 2) distinct pairs of a size and its ratio to the one before; that of each step."""
        sizes, behind, _ = self.successive
        kinds, which = np.unique(np.array([sizes, sizes / behind]).T, axis=0, return_inverse=True)
        return kinds, which.ravel()

    def kinds(self, steps: IndexArray) -> IndexArray:
        """Numbers of the kinds of steps, counted from 1, that `kind` tells.

        Steps of one kind have the same size and the same size before them; step 0 is of the
        first one's kind unless the size changes there, else of none, −1.
        """
        which = self._kinds[1]
        numbers = which[np.clip(steps, 1, len(which)) - 1]
        return np.where((steps == 0) & (self.before[0] != self.size(1)), -1, numbers)

    def kind(self, number: int) -> tuple[float, float]:
        """Size of a kind of steps (s), and its ratio to the size of the step before."""
        size, ratio = self._kinds[0][number].tolist()
        return size, ratio

    def until(self, elapsed: float) -> int:
        """Whole steps up to a time that counts from step 0 (s)."""
        if self.sizes is None:
            return steps_until(elapsed, self.h)
        return int(np.searchsorted(self._elapsed, elapsed * (1 + _SAME), side="right")) - 1

    def reaching(self, time: float) -> int:
        """First step that comes to a time (s), but for a millionth of h."""
        if self.sizes is None:
            return math.ceil(round((time - self.t0) / self.h, 6))
        return int(np.searchsorted(self._elapsed, time - self.t0 - 1e-6 * self.h))

    def nearest(self, times: Array, first: int, last: int) -> IndexArray:
        """(k,) distinct steps nearest to times (s), ascending, between two steps."""
        if self.sizes is None:
            steps = np.rint((times - self.t0) / self.h).astype(np.int64)
        else:
            of_steps = self.times(np.arange(last + 1))
            steps = np.searchsorted((of_steps[1:] + of_steps[:-1]) / 2, times)
        return np.asarray(np.unique(np.clip(steps, first, last)))


def steps_until(t_end: float, h: float, sequence: StepSequence = CONSTANT) -> int:
    """Whole steps up to a time (s) that counts from the start.

    Args:
        t_end: The time.
        h: Step size (s).
        sequence: How sizes vary.
    """
    # h = 1e-7 is no binary fraction.
    end = t_end / h * (1 + _SAME)
    if sequence == CONSTANT:
        return math.floor(end)
    count = 64
    while (sums := np.cumsum(sequence.factors(count, h)))[-1] <= end:
        count *= 2
    return int(np.searchsorted(sums, end, side="right"))
