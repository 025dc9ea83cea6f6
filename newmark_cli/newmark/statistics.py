"""Quantities that a cell reports, and their statistics over its steps."""

from dataclasses import dataclass

import numpy as np

from newmark_cli.arrays import Array


@dataclass(frozen=True)
class Statistics:
    """A quantity over the steps that count.

    Attributes:
        rms, max, median, last: NaN when no step counts.
        zeros: Exact zeros; they are part of the statistics, but a log axis
            cannot show them.
    """

    rms: float
    max: float
    median: float
    last: float
    zeros: int


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


@dataclass(frozen=True)
class Measurement:
    """One quantity of a cell; see the CSV's columns of the same names."""

    quantity: str
    measure: str
    role: str
    statistics: Statistics
    row_block: str = ""
