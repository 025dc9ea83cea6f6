"""The floor of Newton's corrections, measured where a march stands by taking a step again.

Far down, Newton's corrections are what rounding makes of them.  A step from the same state, off
by some units in the last place, solves the same equations but for rounding, and rounds everything
anew.  So the last decreasing corrections of many such steps are draws of the floor.  The march
itself takes them, whatever its form, scaling, formulation and solver.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED, State
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.newmark.steps import TimeGrid
from newmark_cli.support.arrays import Array

#: Units in the last place by which a state may be off: enough that few draws round alike.
_UNITS = 16
_SEED = 20061012


@dataclass(frozen=True)
class Floor:
    """Expected size of the last Newton correction; see `newmark_cli.newmark.floor`.

    NaN where one of the steps does not converge: what Newton's iteration leaves hangs on more
    than rounding there.

    Attributes:
        scaled: Unknown → rms of the 2-norm of its correction, as the solver sees it.
        physical: The same in the unknown's own units.
        zeros: Unknown → share of the corrections that are exactly zero.

    Examples:
        >>> import newmark_cli as newmark
        >>> found = newmark.floor("pendulum", h=1e-3, form="v-lambda")
        >>> 5e-14 < found.physical["v"] < 1e-13
        True
    """

    scaled: Mapping[str, float]
    physical: Mapping[str, float]
    zeros: Mapping[str, float]


def floor(march: March, samples: int = 32) -> Floor:
    """Measure the last Newton corrections of steps that begin where a march stands.

    Args:
        march: Stands at the state; it is not touched.
        samples: Steps; where one direction dominates, the floor scatters by about
            1/√(2 samples).

    Raises:
        ValueError: For a scheme that `unpredicted` refuses.
    """
    if reason := unpredicted(march.scheme):
        raise ValueError(reason)
    scheme = march.scheme.at(march.scheme.h, 1.0)
    again = March(
        march.problem, scheme, march.solver, march.krylov, march.state,
        grid=TimeGrid(march.t, scheme.h),
    )  # fmt: skip
    random, drawn = np.random.default_rng(_SEED), []
    none = np.full(len(scheme.recorded), np.nan)
    for _ in range(samples):
        again.state.restore(_aside(march.state, random))
        again.done, again.ending = 0, COMPLETED
        step = again.advance(1)
        converged = np.any(step.iterations > 0)
        drawn.append(step.norms[0].astype(float) if converged else none)
    norms = np.array(drawn)
    sizes = np.sqrt(np.mean(norms**2, axis=0)).tolist()
    scaled = dict(zip(scheme.recorded, sizes, strict=True))
    right = dict(zip(scheme.form.unknowns, scheme.right, strict=True))
    physical = {name: size * float(right.get(name, 1.0)) for name, size in scaled.items()}
    zeros = dict(zip(scheme.recorded, np.mean(norms == 0, axis=0).tolist(), strict=True))
    return Floor(*(MappingProxyType(values) for values in (scaled, physical, zeros)))


def unpredicted(scheme: Scheme) -> str:
    """Why rounding is not what ends Newton's iteration; empty where it is."""
    if scheme.formulation.kind.penalised:
        return "with a penalty λ comes from an iteration of its own, not from Newton's correction"
    if scheme.stop is not None:
        return "Newton's iteration stops at a tolerance, before rounding stops it"
    return ""


def _aside(state: State, random: np.random.Generator) -> State:
    """The state with what a step begins from off by up to some units in the last place."""

    def off(array: Array) -> Array:
        units = random.integers(-_UNITS, _UNITS + 1, array.shape).astype(array.dtype)
        return np.asarray(array + units * np.finfo(array.dtype).eps * array)

    fields, past, multipliers = off(state.fields), off(state.past), off(state.multipliers)
    return state._replace(fields=fields, past=past, multipliers=multipliers)
