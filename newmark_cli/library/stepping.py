"""Marches that are taken, in one go or step by step, and what is kept of them."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain

import numpy as np

from newmark_cli.newmark.gaps import GapWatch
from newmark_cli.newmark.invariants import UNSTABLE
from newmark_cli.newmark.march import March
from newmark_cli.newmark.trajectory import Recorder, Step, Trajectory
from newmark_cli.support.errors import ArgumentError, warn

#: Most memory that a trajectory may take (bytes).
MOST_BYTES = 1_000_000_000
#: Fewest states of a trajectory that tell of its energy, and how many are looked at.
FEWEST, _LOOKS = 20, 200


class Steps(Iterator[Step]):
    """A march that is stepped: every ``next`` takes it to the next step that is kept.

    ``march(..., steps=True)`` and `steps` return one.

    Attributes:
        problem: What is marched, with its start.

    Examples:
        What was seen is there after a ``break``, an exception, or an interrupt:

        >>> import newmark_cli as newmark
        >>> stepped = newmark.march("pendulum", h=1e-2, steps=True)
        >>> for step in stepped:
        ...     if step.v[1] > 0:
        ...         break
        >>> stepped.trajectory
        Trajectory(pendulum, status='stopped', steps=186, h=0.01, kept=187)
    """

    def __init__(self, recorder: Recorder, halts: Iterator[int], bounded: int) -> None:
        """Not for callers; see `march`."""
        self.problem = recorder.march.problem
        self._recorder, self._halts, self._room = recorder, halts, bounded
        self._over = False

    def __next__(self) -> Step:
        recorder, march = self._recorder, self._recorder.march
        halt = next(self._halts, None) if not self._over else None
        if halt is None:
            self._over = True
            raise StopIteration
        self._room -= 1
        if self._room < 0:
            raise ArgumentError(
                f"the steps kept so far take {MOST_BYTES:g} bytes; step with every=k, or keep "
                'less: keep=("u",)'
            )
        before = march.done
        with _partial(recorder):
            for stretch in march.stretches(halt, recorder.stops(halt)):
                recorder.took(stretch)
                if recorder.reason:
                    break
        self._over = recorder.over
        recorder.keep_here()
        if self._over and march.done == before:
            raise StopIteration
        return recorder.here

    @property
    def trajectory(self) -> Trajectory:
        """The steps kept so far; usable at any time."""
        return self._recorder.trajectory("" if self._over else "stopped")


@contextmanager
def _partial(recorder: Recorder) -> Iterator[None]:
    """An exception of the block, Ctrl-C included, carries what was kept so far."""
    try:
        yield
    except BaseException as error:
        recorder.keep_here()
        with suppress(AttributeError):
            error.trajectory = recorder.trajectory("interrupted")  # type: ignore[attr-defined]
        error.add_note("its attribute 'trajectory' has what was marched until then")
        raise


def taken(
    march: March,
    last: int | None,
    looks: Sequence[int] | Iterator[int],
    keep: Sequence[str],
    callback: Callable[[Step], object] | None,
    stepped: bool,
    ends: tuple[bool, bool],
) -> Trajectory | Steps:
    """March to a last step, if there is one, and keep steps, which a callback sees.

    ``looks`` are the steps after the first to keep, in order, as a range where they are many.
    ``ends`` says whether those are kept, too, with which the march begins and ends.
    """
    most = None if isinstance(looks, Iterator) else len(looks) + 2
    recorder = Recorder(march, keep, most, GapWatch(march.problem, last, march.done))
    if ends[0]:
        recorder.keep_here()
    if stepped or callback is not None:
        end = [last] if ends[1] and last is not None and last > march.done else []
        bounded = room(march, keep) if most is None else most
        stepping = Steps(recorder, chain(looks, end), bounded)
        if callback is None:
            return stepping
        trajectory = _called(stepping, callback)
        if last == march.done or trajectory.status not in ("ok", "not_converged"):
            return trajectory
        looks = ()
    assert last is not None
    assert not isinstance(looks, Iterator)
    with _partial(recorder):
        for stretch in march.stretches(last, recorder.stops(last), looks):
            recorder.took(stretch)
            if recorder.over:
                break
    if ends[1]:
        recorder.keep_here()
    trajectory = recorder.trajectory()
    if told := unstable(trajectory):
        warn(told)
    return trajectory


def _called(stepping: Steps, callback: Callable[[Step], object]) -> Trajectory:
    for step in stepping:
        try:
            with _partial(stepping._recorder):
                callback(step)
        except StopIteration:
            return stepping._recorder.trajectory("stopped")
    return stepping.trajectory


def room(march: March, keep: Sequence[str]) -> int:
    """Steps that may be kept."""
    widths = sum(march.problem.m if name == "lambda" else march.problem.n for name in keep)
    return MOST_BYTES // (8 * (widths + 2))


def unstable(trajectory: Trajectory) -> str:
    """What tells that a march is unstable: kinetic energy that comes from nowhere; mostly empty.

    At some states, as a motion has little of either where it turns.
    """
    problem, last = trajectory.problem, len(trajectory.t) - 1
    if (
        problem.potential is None
        or last < FEWEST
        or trajectory.status not in ("ok", "not_converged")
    ):
        return ""
    if not (trajectory.u.size and trajectory.v.size):
        return ""  # not kept

    def energies(k: int) -> tuple[float, float]:
        at = float(trajectory.t[k]), trajectory.u[k], trajectory.v[k]
        return problem.energies(*at) or (math.nan, math.nan)

    (began, level), (ended, level_now) = energies(0), energies(last)
    if not ended > UNSTABLE * (began + abs(level_now - level)):
        return ""  # as nearly always: no need to look at the way
    places = np.unique(np.linspace(0, last, _LOOKS).round().astype(int)).tolist()
    kinetic, potential = np.array([energies(k) for k in places]).T
    there = kinetic[0] + np.abs(potential - potential[0]).max()
    if not kinetic[-1] > UNSTABLE * there > 0:
        return ""
    return (
        f"{problem.name}: the kinetic energy at the end, {kinetic[-1]:.3g} J, is "
        f"{kinetic[-1] / there:.3g} times what there was and what the potential can give: the "
        "march is unstable; take index 2, GGL, a velocity projection, or damping at a smaller h"
    )
