"""One style for all figures, whatever the user's settings are, and how they are written."""

import io
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from newmark_cli.support import files
from newmark_cli.support.errors import InputError

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
    "text.usetex": False,
    "savefig.dpi": 300,
}

#: No settings.
NONE: Mapping[str, Any] = MappingProxyType({})

#: Settings that a style file does not decide: how matplotlib shows windows, which nobody sees
#: here, the salt of the names inside SVGs, without which no two files are the same, and TeX,
#: which would run what a name says.
_NOT_STYLE = (
    "backend", "backend_fallback", "figure.hooks", "interactive", "svg.hashsalt", "text.usetex",
)  # fmt: skip


@contextmanager
def settled(*settings: Mapping[str, Any]) -> Iterator[None]:
    """Draw in this context: with matplotlib's defaults, the project's style, and these settings."""
    merged: Any = {
        key: value for key, value in mpl.rcParamsDefault.items() if key not in _NOT_STYLE
    }
    for overrides in (STYLE, *settings):
        merged |= overrides
    with mpl.rc_context(merged):
        yield


def read(path: Path) -> dict[str, Any]:
    """Settings of a style file of matplotlib, without those that are not a matter of style."""
    try:
        # matplotlib would look for a name that is no file on the network, and wait for a pipe
        content = files.read(Path(os.path.realpath(path)), 1 << 20)
        for line in content.decode().splitlines():
            key = line.partition("#")[0].partition(":")[0].strip()
            if key and key not in mpl.rcParams:  # of which matplotlib only warns
                raise ValueError(f"unknown setting {key!r}")
        settings = mpl.rc_params_from_file(path, fail_on_error=True, use_default_template=False)
    except OSError as error:
        raise InputError(f"--style {path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"--style {path}: not a style of matplotlib: {reason}") from None
    return {key: value for key, value in settings.items() if key not in _NOT_STYLE}


def checked(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a figure as a config has them; a cycle is lists by property."""
    settings: Any = mpl.RcParams()
    for key, value in entries.items():
        try:
            if key in _NOT_STYLE:
                raise KeyError(key)
            # Never from text, which matplotlib would evaluate.
            settings[key] = cycler(**value) if key == "axes.prop_cycle" else value
        except (KeyError, TypeError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"style: {key}: not a setting of matplotlib: {reason}") from None
    return dict(settings)


def save(contents: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write drawn figures, by the names of their files, into ``figures`` of a results folder."""
    if contents:
        files.make_folder(folder / "figures", folder, parents=True)
    written = {folder / "figures" / name: content for name, content in contents.items()}
    for path, content in written.items():
        files.write(path, content, folder)
    return list(written)


@contextmanager
def of_file(path: Path | None) -> Iterator[Mapping[str, Any]]:
    """Settings of a style file, none without one; errors of what is drawn with them name it.

    Raises:
        InputError: If it is no style file, or nothing can be drawn with it.
    """
    settings = read(path) if path else NONE
    try:
        yield settings
    except (LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        if path is None:
            raise
        raise InputError(f"--style {path}: cannot be drawn with: {error}") from None


def rendered(figure: Figure, kind: str, settings: Mapping[str, Any] = NONE) -> bytes:
    """A figure as a file: png, svg or pdf, the same bytes each time."""
    content = io.BytesIO()
    with settled(settings):
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        figure.savefig(content, format=kind, metadata=metadata)
    return content.getvalue()
