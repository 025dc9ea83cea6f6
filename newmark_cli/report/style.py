"""One style for all figures, and how they are written."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from newmark_cli.study.results import write_atomically

#: What the drawing modules make.
Drawing = Figure

#: Settings of matplotlib.
STYLE: Any = {
    "font.size": 7.5,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "legend.borderpad": 0.2,
    "legend.columnspacing": 1.2,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "newmark-study",
    "savefig.dpi": 300,
}


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as PNG and SVG, the same bytes each time; returns the files."""
    files = []
    for kind in ("png", "svg"):
        files.append(stem.with_suffix(f".{kind}"))
        write_atomically(files[-1], rendered(figure, kind))
    return files


def rendered(figure: Figure, kind: str) -> bytes:
    """A figure as a file: png or svg, the same bytes each time."""
    content = io.BytesIO()
    with mpl.rc_context(STYLE):
        metadata = {"Date": None} if kind == "svg" else {}
        figure.savefig(content, format=kind, metadata=metadata)
    return content.getvalue()
