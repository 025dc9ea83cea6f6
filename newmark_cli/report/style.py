"""One style for all figures, and how they are written."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from newmark_cli.study.results import write_atomically

#: What the drawing modules make.
Drawing = Figure

#: Width of a journal column (inch).
WIDTH = 3.5

#: Settings of matplotlib.
STYLE: Any = {
    "font.size": 7.5,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "newmark-study",
    "savefig.dpi": 300,
}

#: Colours of Okabe and Ito, dark to light, so that they differ in grey too; open
#: and filled markers of different sizes, so that coinciding series all show.
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "marker": "o", "markersize": 7.5, "fill": False, "linestyle": "-"},
    {"color": "#0072B2", "marker": "x", "markersize": 4.5, "fill": True, "linestyle": "--"},
    {"color": "#D55E00", "marker": "s", "markersize": 7.0, "fill": False, "linestyle": "-."},
    {"color": "#E69F00", "marker": "D", "markersize": 3.0, "fill": True, "linestyle": ":"},
    {"color": "#009E73", "marker": "^", "markersize": 5.0, "fill": False, "linestyle": "-"},
    {"color": "#56B4E9", "marker": "v", "markersize": 7.5, "fill": False, "linestyle": "--"},
    {"color": "#CC79A7", "marker": "*", "markersize": 4.5, "fill": True, "linestyle": "-."},
)


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
