"""Data that engines take and hand on: numbers, whatever the form is."""

from typing import NamedTuple

import numpy as np

#: Most Newton corrections of a projection of positions; one or two are enough.
MOST_POSITIONS = 5
#: How a march ends; only a Krylov solver stagnates.
COMPLETED, SINGULAR, DIVERGED, STAGNATED = range(4)
#: A correction that static elimination leaves to a solver that exchanges rows; a system that
#: waits for a solver; an exception in Python, which is raised.  No march that returns ends so.
PIVOTING, UNSOLVED, RAISED = 4, 5, 6
#: What results call the endings before the last step.
ENDINGS = {SINGULAR: "singular", DIVERGED: "diverged", STAGNATED: "stagnated"}
#: What ends Newton's iteration in a step.
BY_ROUNDING, BY_CORRECTION, BY_FIELD, BY_RESIDUAL = range(4)
#: The same by the names of `newmark_cli.newmark.scheme.Tolerance.test`.
TESTS = {"correction": BY_CORRECTION, "field": BY_FIELD, "residual": BY_RESIDUAL}


class StepTables(NamedTuple):
    """Form, integrator and scaling at one step size, as numbers.

    In compensated evaluation the increments w and ν stand for u and v.

    p is the number of kept fields among (u, v, a), P of past vectors, r of kept
    rows among (V, K), N = p n + m.
    """

    kept: np.ndarray  #: (p,) kept fields, 0 = u, 1 = v, 2 = a
    weights: np.ndarray  #: (3, p) ∂(u, v, a)/∂(kept)
    past_weights: np.ndarray  #: (3, P) what the past adds to (u, v, a)
    differenced: np.ndarray  #: (3,) 1 where a field is formed from kept − past 0, 1, else 0
    dynamic_weights: np.ndarray  #: (p,) ∂v'/∂(kept) in row D
    dynamic_past: np.ndarray  #: (P,) what the past adds to v' in row D
    row_weights: np.ndarray  #: (r, p) rows V, K in the kept fields
    row_past: np.ndarray  #: (r, P) what the past adds to rows V, K
    predictor: np.ndarray  #: (3, P) u, v, a at the start of Newton's iteration
    acceleration: np.ndarray  #: (1 + P,) v' from the new a and the past
    advance: np.ndarray  #: (P,) new past: 0..3 = u, v, a, v'; 4, 5 = increments w, ν
    left: np.ndarray  #: (r + 2,) left factors of rows D, (V, K), C
    right: np.ndarray  #: (p + 1,) right factors of the kept fields and λ


class ProblemTables(NamedTuple):
    """A problem's tables as the kernel reads them; the values come from its function."""

    ints: np.ndarray  #: two-dimensional, meaning known to the problem's function
    reals: np.ndarray  #: likewise
    mass_values: np.ndarray
    mass_rows: np.ndarray
    mass_columns: np.ndarray
    x_rows: np.ndarray
    x_columns: np.ndarray
    y_rows: np.ndarray
    y_columns: np.ndarray
    g_rows: np.ndarray
    g_columns: np.ndarray


class MatrixTables(NamedTuple):
    """D_L J D_R and how a solver of the kernel takes it; see `kernel.solve_type`.

    S is the number of its entries, T of terms; what a place means is the solver's matter.
    """

    constant: np.ndarray  #: (S,) what no state changes
    places: np.ndarray  #: (T,) where a coefficient times a source is added
    origins: np.ndarray  #: (T,) the source: an entry of X, then of Y, then of G
    coefficients: np.ndarray  #: (T,)
    structure: np.ndarray  #: indices known to the solver
    room: np.ndarray  #: indices that it may overwrite
    work: np.ndarray  #: numbers that it may overwrite


class State(NamedTuple):
    """State that one step hands to the next; overwritten by the march."""

    fields: np.ndarray  #: (4, n) u, v, a and v'
    past: np.ndarray  #: (P, n) past vectors of the integrator, u and v first
    multipliers: np.ndarray  #: (m,) λ
    lows: np.ndarray  #: (2, n) what u and v have beyond past 0, 1; compensated evaluation
    phi: np.ndarray  #: (m,) Φ as carried along; compensated evaluation
    psi: np.ndarray  #: (m,) Gᵀv likewise, of formulations that have it
    impulse: np.ndarray  #: (m,) μ of the last projection of velocities
    #: (1 + m,) size of an earlier step, 0 of none, and Gᵀv + Φ_t as it left them, over
    #: `Integrator.across`; see `newmark_cli.newmark.carrying.Carrying`
    rates: np.ndarray
    offsets: np.ndarray  #: (1 + n,) likewise a − v' of an auxiliary acceleration, over h

    def copy(self) -> "State":
        """The same, in arrays of its own."""
        return State(*(array.copy() for array in self))

    def restore(self, before: "State") -> None:
        """Overwrite it with another one."""
        for array, values in zip(self, before, strict=True):
            array[:] = values


class Sizes(NamedTuple):
    """When the steps of a call of the kernel are, and what depends on their sizes.

    All numbers that change with the step size stand in one array, of which the tables are
    parts; where the step size changes, another row of numbers is copied there.
    """

    times: np.ndarray  #: (steps + 1,) of the state and after each step (s)
    which: np.ndarray  #: (steps + 1,) row of the step before, and of each step
    rows: np.ndarray  #: (k, W) numbers
    numbers: np.ndarray  #: (W,) those of the step under way
    h: np.ndarray  #: (1,) step size (s), a part of them
    carried: np.ndarray  #: (P, P + 1) new past from the old one and v', likewise


class Schedule(NamedTuple):
    """When Newton's iteration ends."""

    compensated: bool  #: whether the tables relate increments; Φ is then quadratic in u
    cap: int  #: most corrections computed in a step
    settled_below: float  #: see `newmark_cli.newmark.scheme.Scheme.settled_below`
    test: int  #: what ends Newton's iteration, ``BY_…``
    limits: np.ndarray  #: (4, 2) see `newmark_cli.newmark.scheme.Tolerance.limits`
    patience: int  #: steps given up by ``solve`` or the code, after which the march halts


class Plan(NamedTuple):
    """What a march of index 3 is told; a formulation adds its own tables."""

    problem: ProblemTables
    tables: StepTables
    static: MatrixTables  #: of static elimination, without ``structure`` where there is none
    dense: MatrixTables  #: of partial pivoting, empty where Python solves
    schedule: Schedule
    sizes: Sizes


class PythonCalls(NamedTuple):
    """What the kernel calls in Python besides a problem's functions."""

    #: (2,) where functions stand that overwrite the right-hand side of Newton's system, and of a
    #: projection's, with the solution; 0 where the kernel solves
    addresses: np.ndarray
    raised: np.ndarray  #: (1,) other than 0 once one of them, or of the problem, has raised
    step: np.ndarray  #: (1,) the step under way, counted from 0 in a call; overwritten


class Counts(NamedTuple):
    """What a march counts and records in each step."""

    norms: np.ndarray  #: (steps, k) 2-norms of the recorded correction's blocks, scaled
    iterations: np.ndarray  #: (steps,) corrections; negative where they ended too large
    positions: np.ndarray  #: (steps,) zeros, to which corrections of positions are added
    pivoted: np.ndarray  #: (steps,) zeros; 1 where ``solve`` or the code gave a matrix up

    def part(self, begin: int, count: int) -> "Counts":
        """Those of some of the steps, the same memory."""
        return Counts(*(array[begin : begin + count] for array in self))


class Record(NamedTuple):
    """States after some steps of a march, in the type of its numbers."""

    steps: np.ndarray  #: (k,) which, counted from 0 among the steps of the call; ascending
    fields: np.ndarray  #: (k, 4, n) overwritten with u, v, a and v' after each of them
    multipliers: np.ndarray  #: (k, m) overwritten with λ

    def after(self, done: int) -> "Record":
        """The rest once so many steps are done."""
        k = int(np.searchsorted(self.steps, done))
        return Record(self.steps[k:] - done, self.fields[k:], self.multipliers[k:])


def counting(steps: int, blocks: int) -> Counts:
    """Room for the counts of so many steps, with norms of so many blocks."""
    return Counts(np.zeros((steps, blocks)), *(np.zeros(steps, np.int64) for _ in range(3)))


def recording(state: State, steps: np.ndarray) -> Record:
    """Room for the record of steps, as `Record` counts them."""
    fields, multipliers = state.fields, state.multipliers
    return Record(
        np.asarray(steps, np.int64),
        np.empty((len(steps), *fields.shape), fields.dtype),
        np.empty((len(steps), *multipliers.shape), multipliers.dtype),
    )
