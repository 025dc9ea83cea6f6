"""What cells record over time, multipliers and drifts: reading them back."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from newmark_cli.newmark.kept import DRIFT
from newmark_cli.report.reading.figures import Curve
from newmark_cli.study import axes, trajectories
from newmark_cli.study.cell import DRIFTS
from newmark_cli.study.csv_files import read, trajectory_path
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ResultsError


@dataclass(frozen=True, eq=False)
class Recorded:
    """What one cell records over time, its start left out.

    Multipliers go by their constraints, or by numbers in files of older versions; drifts are
    ``position``, misfits of Φ (m), and ``velocity``, those of its rate (m/s).
    """

    t: Array  #: (recorded,) times (s), ascending
    values: Array  #: (recorded, names)
    names: tuple[str, ...]


def read_recorded(
    folder: Path, study: str, kind: str, cells: Sequence[tuple[Curve, float]]
) -> tuple[Path, list[Recorded | None]]:
    """The file of a study, and what it has of cells; None for one that is not there.

    The kind is history or drift; a cell is a series, and a step size (s) of it.
    """
    path = trajectory_path(folder, study)
    former = folder / kind / path.name  # of versions before 0.4
    content = read(folder / path.name, series=True)[former]
    if isinstance(content, FileNotFoundError):
        frame = trajectories.read(folder, study)
    else:
        path, frame = former, trajectories.parse(former, content)
    wanted, listed = ("lambda", ()) if kind == "history" else (DRIFT, DRIFTS)
    # Files of older versions number the multipliers, lambda_1, or have drifts by their names.
    columns = [n for n in frame.columns if n in listed or n.startswith((f"{wanted}[", "lambda_"))]
    if not columns:
        raise ResultsError(f"{path}, line 1: no columns {wanted}[…]; run it with 'keep: {wanted}'")
    kept = frame.loc[frame["step"] > 0]
    recorded: list[Recorded | None] = []
    for curve, h in cells:
        rows = np.isclose(kept["h"], h, rtol=1e-9, atol=0)
        for axis in (axes.STUDY, *axes.cell_axes()):
            if axis.series and axis.name in kept.columns:
                rows &= kept[axis.name].map(axis.same).to_numpy() == getattr(curve, axis.name)
        # Problems with fewer multipliers leave the last columns empty.
        own = kept.loc[rows, ["t", *columns]].sort_values("t").dropna(axis="columns", how="all")
        names = (name.removeprefix(wanted).strip("[]_") for name in own.columns[1:])
        values = own.iloc[:, 1:].to_numpy(float)
        recorded.append(Recorded(own["t"].to_numpy(float), values, (*names,)) if own.size else None)
    return path, recorded
