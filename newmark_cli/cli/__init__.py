"""The command line: parse, delegate, exit code."""

import contextlib
import sys
from collections.abc import Sequence

from newmark_cli.support import interrupts

#: Exit code of an error of the program itself, as in sysexits.h; 1 means a failed check.
_INTERNAL = 70


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script: runs a command and exits with its code.

    The code is 0, 1 (a check or a cell failed), 2 (bad input), 70 (an error of the program
    itself), 141 (nobody reads the output), or 128 plus the number of the signal that ended
    the command: 130 after Ctrl-C, 143 after SIGTERM.
    """
    own_process = arguments is None
    if own_process:
        interrupts.catch()
    try:
        from newmark_cli.cli import commands

        if own_process:
            commands.prepare()
        code = commands.run(commands.words() if arguments is None else arguments)
    except BaseException as error:
        import traceback

        from newmark_cli.support.errors import described, visible_lines

        trace = visible_lines("".join(traceback.format_exception(error)))
        line = f"internal error: {described(error)}; please report this, with the lines above"
        with contextlib.suppress(OSError):
            print(f"{trace}newmark-study: {line}", file=sys.stderr)
        code = _INTERNAL
    if own_process:
        interrupts.ignore()
    sys.exit(code)
