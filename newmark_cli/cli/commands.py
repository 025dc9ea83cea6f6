"""All commands, and what becomes of their errors.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import os
from collections.abc import Sequence
from typing import Any

import click

from newmark_cli import __version__, interrupts
from newmark_cli.cli import inspecting, pruning, results, running, screen, showing
from newmark_cli.errors import ExecutorError, InputError


class _Interrupted(BaseException):
    """A `KeyboardInterrupt` on its way past click, which would print an empty line."""


class _Commands(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise _Interrupted from interrupt


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="newmark-study")
def cli() -> None:
    """Newmark integration of index-3 multibody DAEs at small step sizes.

    Runs studies of last decreasing Newton corrections and condition numbers,
    draws Figures 1-9 of Bottasso, Dopico and Trainelli, and checks fitted
    slopes against predicted orders.

    \b
    Example:
      newmark-study reproduce
    """


for command in (
    running.run,
    running.merge,
    running.reproduce,
    pruning.prune,
    results.plot,
    showing.show,
    results.check,
    results.tables,
    results.info,
    results.verify,
    results.compare,
    results.report,
    inspecting.orders,
    inspecting.validate,
    inspecting.draw,
    inspecting.schema,
    inspecting.list_,
):
    cli.add_command(command)


def run(arguments: Sequence[str] | None) -> int:
    """Run a command; its exit code, with a line on stderr where it went wrong.

    Args:
        arguments: Words of the command line; those of the process when omitted.
    """
    # Cells run side by side: a BLAS with threads of its own would only be in the way.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        return int(cli.main(arguments, prog_name="newmark-study", standalone_mode=False) or 0)
    except (Exception, _Interrupted) as error:
        if interrupts.received():
            raise  # or a consequence of the interrupt
        return _told(error)


def _told(error: BaseException) -> int:
    """Print what went wrong; the exit code.  What is nobody's mistake but ours is raised."""
    match error:
        case click.exceptions.NoArgsIsHelpError():
            screen.lines(error.ctx.get_help())
        case click.ClickException():
            screen.complain(error.format_message())
        case InputError():
            screen.complain(str(error))
        case ExecutorError():
            screen.complain(f"{error}; what was finished is kept, run again to go on")
            return 1
        case OSError():
            screen.complain(f"{error.filename or 'output'}: {error.strerror or error}")
        case click.Abort() | _Interrupted():
            screen.complain("interrupted")
            return 130
        case RuntimeError() if "no locator available" in str(error):
            screen.complain(
                "no folder for compiled code can be written; set NUMBA_CACHE_DIR to one"
            )
        case _:
            raise error
    return 2
