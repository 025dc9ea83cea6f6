"""What a run tells on a terminal; in a pipe it is quiet."""

import contextlib
import os
import shutil
import sys
import threading
from collections.abc import Iterator, Sequence

import click

from newmark_cli.running.runner import Planned, Watcher, weight
from newmark_cli.study.cell import Cell, Done


class _Bar(Watcher):
    """A bar weighted by the steps that will run, with the time left."""

    def __init__(self, verbose: bool) -> None:
        self._verbose = verbose
        self._lock = threading.Lock()
        self._stack = contextlib.ExitStack()
        self._bar: click._termui_impl.ProgressBar[int] | None = None

    def planned(self, plan: Sequence[Planned]) -> None:
        """Open the bar; a run that has nothing to do shows none."""
        total = weight(plan)
        if total and sys.stderr.isatty() and not self._verbose:
            plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"
            bar: click._termui_impl.ProgressBar[int] = click.progressbar(
                length=total, label="steps", file=sys.stderr, color=False if plain else None
            )
            self._bar = self._stack.enter_context(bar)

    def steps(self, steps: int) -> None:
        """So many steps were done; from any thread."""
        with self._lock:
            if self._bar is not None:
                self._bar.update(steps)

    def told(self, line: str) -> None:
        """A line, above the bar if there is one."""
        if self._bar is not None:
            line = "\r" + line.ljust(shutil.get_terminal_size().columns - 1)
        if self._verbose or sys.stderr.isatty():
            click.echo(line, err=True)

    def finished(self, cell: Cell, done: Done) -> None:
        """A line for each cell, when they are asked for."""
        if self._verbose:
            reason = f": {done.outcome.reason}" if done.outcome.reason else ""
            reason += "".join(f"; measured no error: {why}" for why in done.outcome.lacks)
            click.echo(
                f"{described(cell)}: {done.outcome.status}{reason}, {done.seconds:.2f} s", err=True
            )

    def close(self) -> None:
        """Take the bar away."""
        self._stack.close()


@contextlib.contextmanager
def watching(quiet: bool, verbose: bool) -> Iterator[Watcher]:
    """The watcher of a run.

    Args:
        quiet: Whether nothing is shown.
        verbose: Whether every cell has a line of its own, in place of the bar.
    """
    if quiet:
        yield Watcher()
        return
    bar = _Bar(verbose)
    try:
        yield bar
    finally:
        bar.close()


def described(cell: Cell) -> str:
    """A cell in a line: what tells it from others, without what is as always."""
    parts = [
        cell.problem.label,
        cell.integrator.label,
        cell.form,
        cell.preconditioning.label,
        cell.evaluation if cell.evaluation != "direct" else "",
        cell.precision if cell.precision != "float64" else "",
        cell.solver,
        f"h={cell.h:g}",
        f"steps={cell.steps}",
    ]
    return " ".join(filter(None, parts))
