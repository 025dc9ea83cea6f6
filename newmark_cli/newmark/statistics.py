"""Quantities that a cell reports, and their statistics over its steps."""

from dataclasses import dataclass

import numpy as np

from newmark_cli.support.arrays import Array


@dataclass(frozen=True)
class Statistics:
    """A quantity over the steps that count."""

    rms: float  #: NaN, as the next three, when no step counts
    max: float
    median: float
    last: float
    zeros: int  #: exact zeros; they are part of the statistics, but a log axis cannot show them
    #: what rounding alone changes in the one that is drawn; NaN where that is not known
    rounding: float = np.nan


def statistics(values: Array) -> Statistics:
    """Statistics of non-negative values, in the order of the steps; shape (steps,)."""
    if len(values) == 0:
        return Statistics(np.nan, np.nan, np.nan, np.nan, 0)
    # Corrections of 1e-200 must not underflow when squared.
    largest = float(np.max(values))
    scale = largest if 0 < largest < np.inf else 1.0
    return Statistics(
        rms=float(scale * np.sqrt(np.mean((values / scale) ** 2))),
        max=largest,
        median=float(np.median(values)),
        last=float(values[-1]),
        zeros=int(np.count_nonzero(values == 0)),
    )


#: Blocks of successive steps from which the error of an rms is estimated, at most.
_BLOCKS = 16


def standard_error(values: Array) -> float:
    """Standard error of the rms of non-negative values that scatter from step to step.

    It is that of the mean squares of blocks of successive steps, as neighbours may be alike:
    up to 16 blocks; NaN of less than two values.
    """
    largest = float(np.max(values, initial=0.0))
    if len(values) < 2 or not 0 < largest < np.inf:
        return 0.0 if len(values) > 1 and largest == 0 else np.nan
    squared, count = (values / largest) ** 2, min(_BLOCKS, len(values))
    size, longer = divmod(len(squared), count)  # the first blocks have a step more
    first, rest = np.split(squared, [longer * (size + 1)])
    blocks = first.reshape(longer, size + 1), rest.reshape(count - longer, size)
    squares = np.concatenate([block.mean(axis=1) for block in blocks])
    error = squares.std(ddof=1) / np.sqrt(len(squares))
    return float(largest * error / (2 * np.sqrt(squares.mean())))


@dataclass(frozen=True)
class Measurement:
    """One quantity of a cell; see the CSV's columns of the same names."""

    quantity: str
    measure: str
    role: str
    statistics: Statistics
    row_block: str = ""
