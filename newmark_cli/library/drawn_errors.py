"""Figures of another code's errors, next to those of this tool's march."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from newmark_cli.codes.reading import STEP_SIZE
from newmark_cli.codes.solutions import Measured, roundings
from newmark_cli.library.judging import Judged
from newmark_cli.report.drawing.panels import Look, Panel, Sheet, Trace, look
from newmark_cli.report.judging.verdicts import RULED
from newmark_cli.support import files
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError

#: Look of this tool's own march.
_OURS = Look("0.6", "", linestyle="--", linewidth=1.5)
_ENDINGS = (".png", ".svg", ".pdf")
#: What work is counted by, the first that a table has, and how axes name it.
_WORK = {"calls": "calls", "seconds": "time (s)"}
_LABELS = {"u": "$u$", "v": "$v$", "lambda": r"$\lambda$"}


def sheet(judged: Judged) -> Sheet:
    """Errors of u, v and λ over the step size or tolerance; λ over work, if it was counted."""
    present = [q for q in _LABELS if any(("error", q) in m.errors for m in judged.measured)]
    label = "step size $h$ (s)" if judged.abscissa == STEP_SIZE else "tolerance"
    panels = [
        Panel(tuple(_traces(judged, quantity)), label, f"error of {_LABELS[quantity]}")
        for quantity in present
    ]
    counted = {name for m in judged.measured for name in m.run.numbers}
    work = next((name for name in _WORK if name in counted), None)
    if work is not None and present:
        panels.append(Panel(tuple(_traces(judged, present[-1], work)), _WORK[work],
                            f"error of {_LABELS[present[-1]]}"))  # fmt: skip
    return Sheet(
        f"{judged.problem}: errors",
        tuple(panels),
        columns=len(panels) if len(panels) < 4 else 2,
        share_x=work is None,
    )


def _traces(judged: Judged, quantity: str, work: str = "") -> list[Trace]:
    traces, ours = [], False
    for place, label in enumerate(dict.fromkeys(m.run.series for m in judged.measured)):
        own = [m for m in judged.measured if m.run.series == label]
        of = [m for m in own if ("error", quantity) in m.errors]
        if not of:
            continue
        values = np.array([m.errors["error", quantity].statistics.last for m in of])
        bars = roundings(of, ("error", quantity))
        x = _abscissa(of, work)
        traces.append(Trace(label, x, values, look(place), place, bars=bars,
                            ruled=np.nan_to_num(bars) > RULED * values))  # fmt: skip
        known = [m for m in of if m.ours]
        if known and not work:
            y = np.array([m.ours["error", quantity].statistics.last for m in known])
            name = "newmark-study" if not ours else f"newmark-study, as {label}"
            traces.append(Trace(name, _abscissa(known, ""), y, _OURS))
            ours = True
    return traces


def _abscissa(measurements: Sequence[Measured], work: str) -> Array:
    if not work:
        return np.array([m.run.size for m in measurements])
    return np.array([float(m.run.numbers.get(work, np.array([np.nan]))[-1]) for m in measurements])


def write(judged: Judged, path: Path) -> None:
    """Draw the errors into a file.

    Raises:
        ArgumentError: When its ending is none of a figure's.
    """
    if path.suffix not in _ENDINGS:
        raise ArgumentError(f"{path}: a figure ends in {', '.join(_ENDINGS)}")
    from newmark_cli.report.drawing import draw, style

    files.write_output(path, style.rendered(draw.drawn(sheet(judged)), path.suffix[1:]))
