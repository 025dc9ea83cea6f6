"""The command line: parse, delegate, exit code."""

import sys
from collections.abc import Sequence

from newmark_cli import interrupts


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script: runs a command and exits with its code.

    The code is 0, 1 (a check or a cell failed), 2 (bad input), 70 (an error of the program
    itself), 141 (nobody reads the output), or 128 plus the number of the signal that ended
    the command: 130 after Ctrl-C, 143 after SIGTERM.
    """
    try:
        try:
            # First of all: the imports of a command take time, in which Ctrl-C may come.
            interrupts.catch()
            code = _code(arguments)
        except interrupts.Interrupt:
            code = interrupts.answer()
        if arguments is None:
            interrupts.end(code)
        sys.exit(code)
    finally:
        # The console script's process ends here; another caller's goes on.
        if arguments is not None:
            interrupts.release()


def _code(arguments: Sequence[str] | None) -> int:
    """Run a command, whatever goes wrong; its exit code."""
    try:
        if arguments is None:
            from newmark_cli.cli import streams

            streams.prepare()
        from newmark_cli.cli.commands import run

        code = run(arguments)
        interrupts.settle()
    except BaseException as error:
        if interrupts.received():
            return interrupts.answer()
        interrupts.settle()
        from newmark_cli.cli import last_resort

        code = last_resort.told(error)
    if arguments is None:
        from newmark_cli.cli import last_resort

        last_resort.silence()
    return code
