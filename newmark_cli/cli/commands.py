"""All commands, and what becomes of their errors.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import errno
import glob
import os
import sys
import warnings
from collections.abc import Sequence
from functools import cache
from typing import Any

import click
from click.shell_completion import shell_complete

from newmark_cli import __version__
from newmark_cli.cli import advise, evaluating, inspecting, judge, launching, screen
from newmark_cli.support import compiling
from newmark_cli.support.errors import ExecutorError, InputError
from newmark_cli.support.retired import RETIRED
from newmark_cli.support.spelling import nearest

_NAME, _COMPLETE = "newmark-study", "_NEWMARK_STUDY_COMPLETE"
#: Exit code where nobody reads the output any more, like that of other tools in a pipe.
_UNREAD = 141


class _Commands(click.Group):
    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if not (ctx.resilient_parsing or args[0].startswith("-") or args[0] in self.commands):
            raise click.UsageError(f"No such command {args[0]!r}{nearest(args[0], self.commands)}")
        return super().resolve_command(ctx, args)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name=_NAME)
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
    launching.run,
    launching.reproduce,
    evaluating.plot,
    evaluating.show,
    evaluating.check,
    evaluating.tables,
    evaluating.compare,
    evaluating.report,
    advise.advise,
    judge.judge,
    inspecting.orders,
    inspecting.validate,
    inspecting.draw,
    inspecting.list_,
):
    cli.add_command(command)


def prepare() -> None:
    """Have streams that take any text, and warnings as lines; for a process of its own."""
    for name in ("stdout", "stderr"):
        if (stream := getattr(sys, name)) is not None:
            stream.reconfigure(errors="backslashreplace")
        else:
            screen.drop(name)
    once = cache(screen.complain)  # of this command
    warnings.showwarning = lambda message, *rest: once(f"warning: {message}")


def words() -> list[str]:
    """Arguments of the process, with the names of files for patterns, as shells give them."""
    if os.name != "nt":
        return sys.argv[1:]
    return [name for word in sys.argv[1:] for name in sorted(glob.glob(word)) or [word]]


def run(arguments: Sequence[str]) -> int:
    """Run a command; its exit code, with a line on stderr where it went wrong."""
    # Cells run side by side: a BLAS with threads of its own would only be in the way.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    if sys.stderr.isatty():
        compiling.tell(screen.note)
    try:
        # Not `cli.main`, which takes errors of what a command calls for those of a prompt.
        if instruction := os.environ.get(_COMPLETE):
            return shell_complete(cli, {}, _NAME, _COMPLETE, instruction)
        with cli.make_context(_NAME, [*arguments]) as context:
            return int(cli.invoke(context) or 0)
    except click.exceptions.Exit as ending:
        return ending.exit_code
    except (Exception, KeyboardInterrupt) as error:
        return _exit_code(error)


def _exit_code(error: BaseException) -> int:
    """Print an error and return the exit code; raise internal errors."""
    match error:
        case click.exceptions.NoArgsIsHelpError():
            screen.lines(error.ctx.get_help())
        case click.NoSuchOption() if way := _way_out(error):
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
        case BrokenPipeError():
            screen.drop("stdout")
            return _UNREAD
        case OSError() if error.filename is not None:
            screen.complain(f"{error.filename}: {error.strerror or error}")
        case OSError() if error.errno == errno.ENOSPC:
            screen.drop("stdout")
            screen.complain(f"standard output: {error.strerror}")
        case click.Abort() | KeyboardInterrupt():
            screen.complain("interrupted")
            return 130
        case _:
            raise error
    return 2


def _way_out(error: click.NoSuchOption) -> str:
    """What to take in place of an option that went, of this command or of any; mostly empty."""
    name, command = error.option_name, error.ctx.info_name if error.ctx else ""
    return RETIRED.get(f"{command} {name}", RETIRED.get(name, ("", "")))[1]
