"""The command line: parse, delegate, exit code.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import os
import sys
from collections.abc import Sequence

import click

from newmark_cli import __version__
from newmark_cli.cli import inspecting, results, running, showing
from newmark_cli.cli.options import complain
from newmark_cli.errors import ExecutorError, InputError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: exit code 0, 1 (a check or a cell failed) or 2 (bad input)."""
    # Cells run side by side: a BLAS with threads of its own would only be in the way.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        code = cli.main(arguments, prog_name="newmark-study", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help())
        code = 2
    except click.ClickException as error:
        complain(error.format_message())
        code = 2
    except InputError as error:
        complain(str(error))
        code = 2
    except ExecutorError as error:
        complain(f"{error}; what was finished is kept, run again to go on")
        code = 1
    except OSError as error:
        complain(f"{error.filename or 'output'}: {error.strerror or error}")
        code = 2
    except (click.Abort, KeyboardInterrupt):
        complain("interrupted")
        code = 130
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        complain("no folder for compiled code can be written; set NUMBA_CACHE_DIR to one")
        code = 2
    sys.exit(code)
