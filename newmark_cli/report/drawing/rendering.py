"""Many figures at once, on as many processors as there are.

Drawing takes longer than most studies.  Half of the figures of two processors are drawn by
another process: a fresh interpreter, not a fork, so that nothing of the program runs twice.
"""

import pickle
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from newmark_cli.report.drawing.panels import Sheet
from newmark_cli.support.processors import usable

#: Fewest figures for a process of their own: it takes as long to start as to draw two.
_WORTH = 3

_START = (
    "import sys; sys.path[:] = {path!r}; from newmark_cli.report.drawing import rendering; "
    "rendering.serve()"
)

#: Contents of a figure's files, by kind.
Files = dict[str, bytes]


def rendered(
    sheets: Sequence[Sheet],
    kinds: Sequence[str],
    size: tuple[float, float | None] | None,
    settings: Mapping[str, Any],
    processes: int | None = None,
) -> list[Files]:
    """Files of figures of these kinds, in their order, of a size (inch) or as suits each.

    By at most so many processes, this one among them; by default one for each processor.
    """
    count = max(min(processes or usable(), len(sheets) // _WORTH), 1)
    with ThreadPoolExecutor(count) as threads:
        others = [
            threads.submit(_elsewhere, (sheets[first::count], kinds, size, settings))
            for first in range(1, count)
        ]
        files = {i: _files(sheets[i], kinds, size, settings) for i in range(0, len(sheets), count)}
    for first, other in enumerate(others, 1):
        # What was not drawn there fails here, too, and says why.
        for i, drawn in zip(range(first, len(sheets), count), other.result(), strict=True):
            files[i] = drawn or _files(sheets[i], kinds, size, settings)
    return [files[i] for i in range(len(sheets))]


def _files(
    sheet: Sheet,
    kinds: Sequence[str],
    size: tuple[float, float | None] | None,
    settings: Mapping[str, Any],
) -> Files:
    from newmark_cli.report.drawing import draw, style

    drawing = draw.drawn(sheet, size, settings)
    return {kind: style.rendered(drawing, kind, settings) for kind in kinds}


def _elsewhere(request: tuple[Sequence[Sheet], Any, Any, Any]) -> Sequence[Files | None]:
    """Files drawn by another process; None for those that it failed to draw."""
    sheets, *rest = request
    try:
        # Pickle takes no read-only mapping.
        portable = [replace(sheet, settings=dict(sheet.settings)) for sheet in sheets]
        done = subprocess.run(
            [sys.executable, "-c", _START.format(path=sys.path)],
            input=pickle.dumps((portable, *rest)),
            capture_output=True,
            check=True,
            start_new_session=True,  # an interrupt is the matter of this process
        )
        files: Sequence[Files | None] = pickle.loads(done.stdout)
    except (pickle.PickleError, AttributeError, TypeError, EOFError, subprocess.SubprocessError):
        return [None] * len(sheets)
    return files


def serve() -> None:
    """Draw the pickled sheets on standard input; of one that warns or fails the answer is None."""
    import warnings

    sheets, *rest = pickle.load(sys.stdin.buffer)
    answers: list[Files | None] = []
    for sheet in sheets:
        with warnings.catch_warnings(record=True) as caught:
            try:
                files: Files | None = _files(sheet, *rest)
            except Exception:
                files = None
        answers.append(None if caught else files)
    sys.stdout.buffer.write(pickle.dumps(answers))
