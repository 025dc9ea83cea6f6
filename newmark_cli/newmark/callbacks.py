"""What the kernel calls in Python: functions of a problem, and solvers of linear systems.

The kernel takes compiled functions only.  For a problem in plain Python it is given one that
calls what stands at an address, where ctypes has put a function of Python's.  An exception
cannot pass through compiled code: it is kept, ends the march, and is raised after it.
"""

import contextlib
import ctypes
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from newmark_cli.newmark.constraints import Tangents
from newmark_cli.newmark.linear.choice import Stagnation
from newmark_cli.newmark.linear.solvers import LinearSystem
from newmark_cli.newmark.march_data import (
    COMPLETED,
    RAISED,
    SINGULAR,
    STAGNATED,
    PythonCalls,
    State,
)
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem, Values
from newmark_cli.support import interrupts
from newmark_cli.support.cached_code import cached_njit
from newmark_cli.support.machine_code import generate_call


@intrinsic
def _evaluate(typing, address, t, u, v, multipliers, force, phi, x, y, g):  # type: ignore[no-untyped-def]
    """Call the function at an address."""
    arguments = (address, t, u, v, multipliers, force, phi, x, y, g)
    return types.void(*arguments), generate_call


@intrinsic
def _derive(typing, address, t, u, v, w, rate, curvature, r, q):  # type: ignore[no-untyped-def]
    """Call the function at an address."""
    return types.void(address, t, u, v, w, rate, curvature, r, q), generate_call


@cached_njit(nogil=True, error_model="numpy")
def evaluate(t, u, v, multipliers, ints, reals, force, phi, x, y, g):  # type: ignore[no-untyped-def]
    """Evaluate the problem whose `Callbacks.ints` are given; of `kernel.evaluate_type`."""
    _evaluate(ints[0, 0], t, u, v, multipliers, force, phi, x, y, g)  # type: ignore[call-arg]


@cached_njit(nogil=True, error_model="numpy")
def derive(t, u, v, w, ints, reals, rate, curvature, r, q):  # type: ignore[no-untyped-def]
    """Differentiate its constraints; of `kernel.derivatives_type`."""
    _derive(ints[0, 1], t, u, v, w, rate, curvature, r, q)  # type: ignore[call-arg]


class Callbacks:
    """Functions of Python's that the kernel calls in one march.

    Args:
        problem: Whose functions are called where they are not compiled.
        dtype: Of the march's numbers.
        system_at: The linear system of a step, counted from 1, where the kernel has no matrix.

    Attributes:
        calls: What the kernel reads.
        ints: Addresses of the problem's functions, in place of its table of integers.
        first: Steps taken before those of a call of the kernel.
    """

    def __init__(
        self,
        problem: Problem,
        dtype: type[Any],
        system_at: Callable[[int], LinearSystem] | None = None,
    ) -> None:
        self._problem, self._system_at = problem, system_at
        self.first, self.ints = 0, problem.ints
        self._error: BaseException | None = None
        #: What has addresses: gone, they would call freed memory.
        self._functions: list[Any] = []
        if not problem.compiled:
            pattern, n, m = problem.pattern, problem.n, problem.m
            x, y, g = (len(rows) for rows in (pattern.x_rows, pattern.y_rows, pattern.g_rows))
            evaluating = self._of_problem(problem.function, dtype, (n, n, m, n, m, x, y, g))
            deriving = self._of_problem(problem.derivatives, dtype, (n, n, n, m, m, g, g))
            self.ints = np.array([[evaluating, deriving]], np.int64)
        solvers = [self._solver(self._solve), self._solver(self._project)] if system_at else [0, 0]
        self.calls = PythonCalls(
            addresses=np.array(solvers, np.uint64),
            raised=np.zeros(1, np.int64),
            step=np.zeros(1, np.int64),
        )

    @contextlib.contextmanager
    def served(self, state: State, room: Any) -> Iterator[None]:
        """Serve the kernel once; raises what was raised in its calls.

        Args:
            state, room: What the kernel is handed.
        """
        work = room.work
        arrays = [*state.fields, *state.past, state.multipliers, *room.values, room.iterate.g_old]
        if work is not None:
            arrays += [work.shifted, work.rate, work.curvature, work.r, work.r_old, work.q]
        # By where they stand and their length; nothing stands nowhere.
        of = [] if self._problem.compiled else arrays
        self._vectors = {(array.ctypes.data, len(array)): array for array in of}
        self._room = room
        self._error, self.calls.raised[0] = None, 0
        # An exception of a signal's handler would be lost in compiled code.
        with interrupts.deferred() as self._calling:
            yield
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _of_problem(
        self, function: Callable[..., None], dtype: type[Any], sizes: Sequence[int]
    ) -> int:
        """Address of a function of the problem: t, so many arrays, tables behind the third."""
        tables = self._problem.ints, self._problem.reals

        def call(t: float, addresses: tuple[int | None, ...]) -> None:
            keys = zip(addresses, sizes, strict=True)
            vectors = [self._vectors[key] if key[1] else np.empty(0) for key in keys]
            function(t, *vectors[:3], *tables, *vectors[3:])

        def called(t: float, *addresses: int | None) -> None:
            if self._error is None:
                try:
                    self._calling(call, t, addresses)
                except BaseException as error:  # an exit and an interrupt, too
                    self._keep(error)

        number = ctypes.c_float if dtype == np.float32 else ctypes.c_double
        return self._address(called, None, number, *[ctypes.c_void_p] * len(sizes))

    def _solver(self, solve: Callable[[], None]) -> int:
        """Address of a solver, which returns how it ended."""

        def called() -> int:
            if self._error is None:
                try:
                    self._calling(solve)
                    return COMPLETED
                except Stagnation:
                    return STAGNATED
                except np.linalg.LinAlgError:
                    return SINGULAR
                except BaseException as error:
                    self._keep(error)
            return RAISED

        return self._address(called, ctypes.c_int64)

    def _address(self, function: Callable[..., Any], *kinds: Any) -> int:
        made = ctypes.CFUNCTYPE(*kinds)(function)
        self._functions.append(made)
        return int(ctypes.cast(made, ctypes.c_void_p).value or 0)

    def _keep(self, error: BaseException) -> None:
        self._error, self.calls.raised[0] = error, 1

    def _solve(self) -> None:
        """Solve Newton's system."""
        assert self._system_at is not None
        room, work = self._room, self._room.work
        values = Values(*(np.asarray(array, float) for array in room.values))
        tangents = Tangents(work.tangents, work.directions) if work is not None else None
        system = self._system_at(self.first + int(self.calls.step[0]) + 1)
        rhs = room.system.rhs
        rhs[:] = system.solve(values, np.asarray(rhs, float), tangents)

    def _project(self) -> None:
        """Solve the system of a projection."""
        rhs = self._room.work.saddle.rhs
        g = np.asarray(self._room.values.g, float)
        rhs[:] = self._index_1.solution(g, np.asarray(rhs, float))

    @cached_property
    def _index_1(self) -> Index1:
        return Index1(self._problem)
