"""The command line: parse, delegate, exit code."""

import sys
from collections.abc import Sequence

from newmark_cli.support import interrupts


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script: runs a command and exits with its code.

    The code is 0, 1 (a check or a cell failed), 2 (bad input), 70 (an error of the program
    itself), 141 (nobody reads the output), or 128 plus the number of the signal that ended
    the command: 130 after Ctrl-C, 143 after SIGTERM.
    """
    own_process = arguments is None
    if own_process:
        interrupts.catch()
    code = _code(arguments, own_process)
    if own_process:
        interrupts.ignore()
    sys.exit(code)


def _code(arguments: Sequence[str] | None, own_process: bool) -> int:
    """Run a command, whatever goes wrong; its exit code."""
    try:
        if own_process:
            from newmark_cli.cli import streams

            streams.prepare()
        from newmark_cli.cli.commands import run

        return run(arguments)
    except BaseException as error:
        from newmark_cli.cli import last_resort

        return last_resort.report(error)
