"""Progress of a run: counts for everybody, a display only on a terminal."""

import contextlib
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from newmark_cli.cli import screen
from newmark_cli.running.runner import Planned, Watcher
from newmark_cli.study import axes
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Done
from newmark_cli.support import compiling, interrupts
from newmark_cli.support.errors import visible

if TYPE_CHECKING:
    from rich.progress import Progress


#: What a cell takes besides its steps, in steps: measuring, and writing it down.
_PER_CELL = 2_000


class Counts(Watcher):
    """Counts the cells of a run and says nothing.

    Attributes:
        total: Cells of all studies.
        kept: Those that the same run would not compute again, were it to end now.
        done: Those that have ended well, now or in an earlier run.
        failed: Those that have not.
    """

    def __init__(self) -> None:
        self.total = self.kept = self.done = self.failed = 0
        self._places: Counter[Cell] = Counter()

    def planned(self, plan: Sequence[Planned]) -> None:
        """Count what is kept of the plan."""
        self.total = len(plan)
        for entry in plan:
            if entry.done is None:
                self._places[entry.cell] += 1
            else:
                self._ended(entry.cell, entry.done, 1)

    def finished(self, cell: Cell, done: Done) -> None:
        """Count a cell in each study that has it."""
        self._ended(cell, done, self._places[cell])

    def _ended(self, cell: Cell, done: Done, places: int) -> None:
        self.kept += places * (done.outcome.status != "failed")
        if done.outcome.status in ("ok", *cell.accept):
            self.done += places
        else:
            self.failed += places

    @property
    def left(self) -> int:
        """Cells that have not ended."""
        return self.total - self.done - self.failed


class Reporting(Counts):
    """Tells of a run on stderr: a display on a terminal, and a line per cell when asked for."""

    def __init__(self, verbose: bool) -> None:
        super().__init__()
        self._verbose = verbose
        self._stack = contextlib.ExitStack()
        self._display: Progress | None = None

    def planned(self, plan: Sequence[Planned]) -> None:
        """Open the display; a run that has nothing to do shows none."""
        super().planned(plan)
        total = sum(cell.weight + _PER_CELL for cell in self._places)
        if total and sys.stderr.isatty():
            bar = _bar(total, done=self.done, failed=self.failed, left=self.left)
            self._display = _opened(bar, self._stack)
            compiling.tell(self._say)
            self._display.refresh()  # a run may end before the next frame

    def steps(self, steps: int) -> None:
        """So many steps were done; from any thread."""
        if self._display is not None:
            self._display.advance(self._display.task_ids[0], steps)

    def announced(self, line: str) -> None:
        """A line, above the display if there is one."""
        if self._display is not None:
            self._say(line)
        elif self._verbose:
            screen.note(line)

    def finished(self, cell: Cell, done: Done) -> None:
        """Count a cell, and write a line for it when lines are asked for."""
        super().finished(cell, done)
        self.steps(_PER_CELL)
        if self._verbose:
            reason = f": {done.outcome.reason}" if done.outcome.reason else ""
            reason += "".join(f"; measured no error: {why}" for why in done.outcome.lacks)
            ended = f"{done.outcome.status}{reason}, {done.seconds:.2f} s"
            self._say(f"{axes.described(cell)}: {ended}")
        self._count()

    def close(self) -> None:
        """Leave the display as it stands, and give the cursor back."""
        self._stack.close()

    def _say(self, line: str) -> None:
        if self._display is None:
            screen.note(line)
        else:
            self._display.console.print(
                visible(line), markup=False, highlight=False, emoji=False, soft_wrap=True
            )

    def _count(self) -> None:
        if self._display is not None:
            (task,) = self._display.tasks
            self._display.update(
                task.id,
                done=self.done,
                failed=self.failed,
                left=self.left,
                # What a failed cell has not marched is not left, either.
                completed=task.completed if self.left else task.total,
            )


def _bar(total: int, **counts: int) -> "Progress":
    """A progress bar with counts and the time left."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, Task, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining
    from rich.text import Text

    class Percent(TaskProgressColumn):
        def render(self, task: Task) -> Text:
            most = 99 if task.fields.get("left") else 100
            return Text(f"{min(int(task.percentage), most):>3}%", style="progress.percentage")

    display = Progress(
        BarColumn(bar_width=20),
        Percent(),
        TextColumn(", ".join(f"{{task.fields[{name}]}} {name}" for name in counts)),
        Remaining(compact=True, elapsed_when_finished=True),
        console=Console(stderr=True),
        redirect_stdout=False,  # which would make it stderr
        redirect_stderr=False,
    )
    display.add_task("", total=total, **counts)  # type: ignore[arg-type]
    return display


def _opened(display: "Progress", stack: contextlib.ExitStack) -> "Progress":
    """A display shown until the stack is closed."""
    with interrupts.postponed():
        # What hides the cursor must show it again.
        interrupts.Line.before = "\n\x1b[?25h"
        stack.callback(setattr, interrupts.Line, "before", "")
        return stack.enter_context(display)


@contextlib.contextmanager
def watching(quiet: bool, verbose: bool) -> Iterator[Counts]:
    """The watcher of a run."""
    if quiet:
        yield Counts()
        return
    reporting = Reporting(verbose)
    try:
        yield reporting
    finally:
        reporting.close()
