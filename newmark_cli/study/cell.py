"""Outcome of a cell of a study: measurements and status."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from newmark_cli.newmark.statistics import Measurement
from newmark_cli.support.arrays import Array, IndexArray

#: Statuses of a cell, from good to bad.
STATUSES = (
    "ok",
    "not_converged",
    "stagnated",
    "singular",
    "diverged",
    "redundant",
    "failed",
)
#: Verdict on a series that a study may be about, besides statuses of its cells.
NOT_CONVERGING = "not_converging"

#: Rows of largest errors over a part of the motion: from its start on, and later.
OVER_MOTION, WINDOWED = "motion_error", "window_error"
#: What drifts: the constraints, and their rate.
DRIFTS = ("position", "velocity")


@dataclass(frozen=True)
class Window:
    """A part of a motion, over which the largest errors are looked for."""

    since: float = 0.0  #: time since the start (s)
    until: float | None = None  #: the same of its end; None: the end of the march

    @property
    def record(self) -> str:
        """What its rows are called: a start leaves errors that a later window does not see."""
        return WINDOWED if self.since > 0 else OVER_MOTION


def _vector(value: Any) -> Array:
    array = np.asarray(value)
    if array.ndim != 1 or not (array.size == 0 or array.dtype.kind in "fi"):
        raise ValueError("not a vector of numbers")
    return array


class _AsList:
    """Makes pydantic write a vector as a list, and read it back."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema  # most commands read no cells

        return core_schema.no_info_plain_validator_function(
            _vector,
            serialization=core_schema.plain_serializer_function_ser_schema(np.ndarray.tolist),
        )


Column = Annotated[Array | IndexArray, _AsList()]


@dataclass(frozen=True)
class Outcome:
    """Measurements of a cell, and how it ended."""

    measurements: list[Measurement]  #: in the order of the CSV's rows
    not_converged: int  #: steps that ended above the terminal-phase threshold
    newton_iterations: float  #: corrections computed per step, mean; NaN without steps
    status: str  #: one of `STATUSES`
    reason: str = ""  #: why, where the status is failed or redundant
    met: int | None = None  #: steps that met the tolerance; None where rounding stops Newton
    #: why rows of the CSV are empty although the march reached its end: the reason for each thing
    #: that was not to be had, such as a reference
    lacks: tuple[str, ...] = ()
    #: column → (k,) values of the steps that were kept: ``step``, ``t``, ``u[A.x]`` and so on;
    #: empty where none were to be
    trajectory: Mapping[str, Column] = field(default_factory=dict)
    pivoted: int = 0  #: steps that static elimination left to partial pivoting
    #: of the march's linear systems, see `newmark_cli.newmark.operations`; None where it did not
    #: get that far
    operations: int | None = None


@dataclass(frozen=True)
class Done:
    """A cell that has ended."""

    outcome: Outcome  #: what it found
    seconds: float  #: its wall time (s)
    #: that of its march by itself (s), where it was measured; see
    #: `newmark_cli.study.compute.march_seconds`
    march_seconds: float | None = None
