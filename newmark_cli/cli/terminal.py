"""Progress of a run: counts for everybody, a display only on a terminal."""

import contextlib
import sys
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from newmark_cli.cli import screen
from newmark_cli.running.runner import Planned, Watcher
from newmark_cli.study import axes
from newmark_cli.study.axes import Cell
from newmark_cli.study.cell import Done
from newmark_cli.support import compiling, interrupts
from newmark_cli.support.errors import visible

if TYPE_CHECKING:
    from rich.progress import Progress as Display


#: What a cell takes besides its steps, in steps: measuring, and writing it down.
_PER_CELL = 2_000


class Progress(Watcher):
    """Counts the cells of a run, and tells of it on stderr unless it is quiet.

    That is a display on a terminal, and a line for each cell when asked for.

    Attributes:
        total: Cells of all studies.
        kept: Those that the same run would not compute again, were it to end now.
        done: Those that have ended well, now or in an earlier run.
        failed: Those that have not.
    """

    def __init__(self, quiet: bool, verbose: bool) -> None:
        self.total = self.kept = self.done = self.failed = 0
        self._places: Counter[Cell] = Counter()
        self._quiet, self._verbose = quiet, verbose
        self._stack = contextlib.ExitStack()
        self._display: Display | None = None

    def planned(self, plan: Sequence[Planned]) -> None:
        """Count what is kept, and open the display; a run that has nothing to do shows none."""
        self.total = len(plan)
        for entry in plan:
            if entry.done is None:
                self._places[entry.cell] += 1
            else:
                self._ended(entry.cell, entry.done, 1)
        weight = sum(cell.weight + _PER_CELL for cell in self._places)
        if weight and not self._quiet and sys.stderr.isatty():
            self._display = _opened(_bar(weight, **self._counts), self._stack)
            compiling.tell(self._say)
            self._display.refresh()  # a run may end before the next frame

    def steps(self, steps: int) -> None:
        """So many steps were done; from any thread."""
        if self._display is not None:
            self._display.advance(self._display.task_ids[0], steps)

    def announced(self, line: str) -> None:
        """A line, above the display if there is one."""
        if self._display is not None or (self._verbose and not self._quiet):
            self._say(line)

    def finished(self, cell: Cell, done: Done) -> None:
        """Count a cell in each study that has it, and write a line when lines are asked for."""
        self._ended(cell, done, self._places[cell])
        self.steps(_PER_CELL)
        if self._verbose and not self._quiet:
            reason = f": {done.outcome.reason}" if done.outcome.reason else ""
            reason += "".join(f"; measured no error: {why}" for why in done.outcome.lacks)
            ended = f"{done.outcome.status}{reason}, {done.seconds:.2f} s"
            self._say(f"{axes.described(cell)}: {ended}")
        if self._display is not None:
            (task,) = self._display.tasks
            # What a failed cell has not marched is not left, either.
            completed = task.completed if self._counts["left"] else task.total
            self._display.update(task.id, completed=completed, **self._counts)  # type: ignore[arg-type]

    def close(self) -> None:
        """Leave the display as it stands, and give the cursor back."""
        self._stack.close()

    @property
    def _counts(self) -> dict[str, int]:
        left = self.total - self.done - self.failed
        return {"done": self.done, "failed": self.failed, "left": left}

    def _ended(self, cell: Cell, done: Done, places: int) -> None:
        self.kept += places * (done.outcome.status != "failed")
        if done.outcome.status in ("ok", *cell.accept):
            self.done += places
        else:
            self.failed += places

    def _say(self, line: str) -> None:
        if self._display is None:
            screen.note(line)
        else:
            self._display.console.print(
                visible(line), markup=False, highlight=False, emoji=False, soft_wrap=True
            )


def _bar(total: int, **counts: int) -> "Display":
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


def _opened(display: "Display", stack: contextlib.ExitStack) -> "Display":
    """A display shown until the stack is closed."""
    with interrupts.postponed():
        # What hides the cursor must show it again.
        interrupts.Line.before = "\n\x1b[?25h"
        stack.callback(setattr, interrupts.Line, "before", "")
        return stack.enter_context(display)
