"""Many figures at once, on as many processors as there are.

Drawing takes longer than most studies.  Half of the figures of two processors are drawn by
another process, which takes pickled sheets on its standard input and gives back the files.
It is a fresh interpreter, not a fork: nothing of the program runs twice.
"""

import contextlib
import pickle
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import IO, Any, NamedTuple

from newmark_cli.report.drawing.panels import Sheet
from newmark_cli.support.processors import usable

#: Fewest figures for a process of their own: it takes as long to start as to draw two.
_WORTH = 3

_START = (
    "import sys; sys.path[:] = {path!r}; from newmark_cli.report.drawing import rendering; "
    "rendering.serve(sys.stdin.buffer, sys.stdout.buffer)"
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
    """Files of figures, in their order.

    Args:
        sheets: What is drawn.
        kinds: Endings of the files, see `newmark_cli.report.drawing.style.rendered`.
        size: Width and height of each (inch); as suits it when None.
        settings: Settings of matplotlib over those of the project.
        processes: Most processes, this one among them; as many as there are processors
            when omitted.

    Raises:
        InputError: When the size leaves no room for the panels.
    """
    count = max(min(processes or usable(), len(sheets) // _WORTH), 1)
    shares = [range(first, len(sheets), count) for first in range(count)]
    found: dict[int, Files] = {}
    with contextlib.ExitStack() as stack:
        others = []
        for share in shares[1:]:
            asked = [_portable(sheets[k]) for k in share], kinds, size, dict(settings)
            others.append((share, stack.enter_context(_process(asked))))
        for k in shares[0]:
            found[k] = _files(sheets[k], kinds, size, settings)
        for share, other in others:
            answers: Iterator[Files | None] = other.answers() if other else iter(())
            for k in share:
                # Whatever went wrong there is found out here, and said as it always is.
                drawn = next(answers, None)
                found[k] = drawn or _files(sheets[k], kinds, size, settings)
    return [found[k] for k in range(len(sheets))]


def _portable(sheet: Sheet) -> Sheet:
    """The same sheet; pickle takes no read-only mapping."""
    return replace(sheet, settings=dict(sheet.settings))


def _files(
    sheet: Sheet,
    kinds: Sequence[str],
    size: tuple[float, float | None] | None,
    settings: Mapping[str, Any],
) -> Files:
    from newmark_cli.report.drawing import draw, style

    drawing = draw.drawn(sheet, size, settings)
    return {kind: style.rendered(drawing, kind, settings) for kind in kinds}


@contextlib.contextmanager
def _process(asked: Any) -> Iterator["_Other | None"]:
    """Another process, at work; None where there can be none.  It is ended on leaving."""
    try:
        request = pickle.dumps(asked)
    except (pickle.PicklingError, AttributeError, TypeError):
        yield None
        return
    # Files, as a pipe takes no more than a part of a figure until somebody reads it.
    with tempfile.TemporaryFile() as question, tempfile.TemporaryFile() as answers:
        question.write(request)
        question.seek(0)
        process = subprocess.Popen(
            [sys.executable, "-c", _START.format(path=sys.path)],
            stdin=question,
            stdout=answers,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # an interrupt is the matter of this process
        )
        try:
            yield _Other(process, answers)
        finally:
            process.kill()
            process.wait()


class _Other(NamedTuple):
    """A process that draws."""

    process: "subprocess.Popen[bytes]"
    output: IO[bytes]

    def answers(self) -> Iterator[Files | None]:
        """Files of one figure after the other, until there are no more."""
        self.process.wait()
        self.output.seek(0)
        with contextlib.suppress(EOFError, pickle.UnpicklingError):
            while True:
                files, told = pickle.load(self.output)
                for message, category in told:
                    warnings.warn_explicit(message, category, "", 0)
                yield files


def serve(asked: IO[bytes], answers: IO[bytes]) -> None:
    """Draw what is asked for; of a figure that cannot be drawn the answer is None.

    Args:
        asked: Has pickled sheets, kinds, size and settings.
        answers: Takes files and warnings of each, pickled.
    """
    sheets, kinds, size, settings = pickle.load(asked)
    for sheet in sheets:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                files: Files | None = _files(sheet, kinds, size, settings)
            except Exception:
                files = None
        told = [(str(each.message), each.category) for each in caught] if files else []
        pickle.dump((files, told), answers)
        answers.flush()
