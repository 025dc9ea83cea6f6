"""Time series of multipliers: reading them back."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from newmark_cli.arrays import Array
from newmark_cli.errors import ResultsError
from newmark_cli.report.curves import Curve
from newmark_cli.study import axes
from newmark_cli.study.reading import number, read_csv
from newmark_cli.study.results import (
    HISTORY_COLUMNS,
    HISTORY_MAY_HAVE,
    history_path,
    read,
)


@dataclass(frozen=True, eq=False)
class History:
    """Multipliers of one cell at its recorded steps.

    Attributes:
        t: (recorded,) times (s), ascending.
        multipliers: (recorded, m) λ.
    """

    t: Array
    multipliers: Array


def read_histories(
    folder: Path, study: str, curves: Sequence[Curve], h: float
) -> list[History | None]:
    """Time series of curves at one step size; None for one that is not there.

    Args:
        folder: Results folder.
        study: Name of the study.
        curves: Which cells.
        h: Their step size (s).

    Raises:
        ResultsError: When the file is missing, truncated or of another schema.
    """
    path = history_path(folder, study)
    content = read(folder / f"{study}.csv", series=True)[path]
    frame = read_csv(path, HISTORY_COLUMNS, content=content)
    known = (*HISTORY_COLUMNS, *HISTORY_MAY_HAVE)
    names = [name for name in frame.columns if name not in known]
    if not names or names != [f"lambda_{k + 1}" for k in range(len(names))]:
        raise ResultsError(f"{path}, line 1: the columns after t must be lambda_1, lambda_2, …")
    values = {
        name: np.array([number(path, line, name, text) for line, text in frame[name].items()])
        for name in ("h", "t", *names)
    }
    found: list[History | None] = []
    for curve in curves:
        rows = np.isclose(values["h"], h, rtol=1e-9, atol=0)
        for axis in (axes.STUDY, *axes.cell_axes()):
            if axis.series and axis.name in frame.columns:
                ours = [axis.same(text) == getattr(curve, axis.name) for text in frame[axis.name]]
                rows &= np.array(ours)
        table = np.column_stack([values[name][rows] for name in ("t", *names)])
        # Problems with fewer multipliers leave the last columns empty.
        table = table[np.argsort(table[:, 0])][:, ~np.isnan(table).all(axis=0)]
        found.append(History(table[:, 0], table[:, 1:]) if table.size else None)
    return found
