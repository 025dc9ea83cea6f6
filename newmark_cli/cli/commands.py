"""All commands, and what becomes of their errors.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import click

from newmark_cli import __version__
from newmark_cli.cli import (
    advising,
    inspecting,
    judging,
    last_resort,
    results,
    running,
    screen,
)
from newmark_cli.cli.streams import UNREAD, OutputError
from newmark_cli.support import compiling
from newmark_cli.support.errors import ExecutorError, InputError
from newmark_cli.support.retired import RETIRED
from newmark_cli.support.spelling import nearest


class _Interrupted(BaseException):
    """A `KeyboardInterrupt` hidden from click, which would print an empty line."""


class _Commands(click.Group):
    def make_context(self, *arguments: Any, **more: Any) -> click.Context:
        with _past_click():
            return super().make_context(*arguments, **more)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if not (ctx.resilient_parsing or args[0].startswith("-") or args[0] in self.commands):
            raise click.UsageError(f"No such command {args[0]!r}{nearest(args[0], self.commands)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        with _past_click(), last_resort.watching():
            return super().invoke(ctx)


@contextlib.contextmanager
def _past_click() -> Iterator[None]:
    """Hide errors for which click has answers of its own."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise _Interrupted from interrupt
    # Of a prompt and of stdout, click believes; and to exit is not for what a command calls.
    except (EOFError, BrokenPipeError, SystemExit) as error:
        raise RuntimeError(f"{type(error).__name__}: {error}") from error


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="newmark-study")
def cli() -> None:
    """Study what small time steps do to Newmark integration of constrained mechanisms.

    A study varies the step size and records Newton's corrections, condition numbers
    and errors.  The commands run studies, draw them and check the fitted slopes
    against predicted orders.  They reproduce Figures 1-9 of Bottasso, Dopico and
    Trainelli (2008) and do the same for your own mechanism.

    \b
    Example:
      newmark-study reproduce
    """


for command in (
    running.run,
    running.reproduce,
    results.plot,
    results.show,
    results.check,
    results.tables,
    results.compare,
    results.report,
    advising.advise,
    judging.judge,
    inspecting.orders,
    inspecting.validate,
    inspecting.draw,
    inspecting.list_,
):
    cli.add_command(command)


def run(arguments: Sequence[str] | None) -> int:
    """Run a command; its exit code, with a line on stderr where it went wrong."""
    # Cells run side by side: a BLAS with threads of its own would only be in the way.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    if sys.stderr.isatty():
        compiling.tell(screen.note)
    try:
        code = int(cli.main(arguments, prog_name="newmark-study", standalone_mode=False) or 0)
        sys.stdout.flush()
        return code
    except SystemExit as ending:  # completion has said what it has to say
        return int(ending.code or 0)
    except (Exception, _Interrupted) as error:
        return _exit_code(error)


def _exit_code(error: BaseException) -> int:
    """Print an error and return the exit code; raise internal errors."""
    match error:
        case click.exceptions.NoArgsIsHelpError():
            screen.lines(error.ctx.get_help())
        case click.NoSuchOption() if error.option_name in RETIRED:
            way = RETIRED[error.option_name][1]
            screen.complain(f"No such option {error.option_name!r}; it is gone: {way}")
        case click.ClickException():
            screen.complain(error.format_message())
        case InputError():
            screen.complain(str(error))
        case ExecutorError():
            screen.complain(
                f"{error}; finished cells are cached, run the same command again to continue"
            )
            return 1
        case OutputError():
            if error.unread:
                return UNREAD
            screen.complain(str(error))
        case OSError() if error.filename is not None:
            screen.complain(f"{error.filename}: {error.strerror or error}")
        case click.Abort() | _Interrupted():
            screen.complain("interrupted")
            return 130
        case _:
            raise error
    return 2
