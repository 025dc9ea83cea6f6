"""The console script's way in: it answers Ctrl-C before anything else is imported.

Importing this module does nothing, and takes nothing but what every Python process has
loaded already.  What comes before it, Python's own start and the first lines of the
script, is out of reach.
"""

import _signal
import os

#: What the signals are called; the exit code is 128 plus the signal's number.
NAMES = {
    _signal.SIGINT: "interrupted",
    _signal.SIGTERM: "terminated",
}
if hasattr(_signal, "SIGHUP"):  # not on Windows
    NAMES[_signal.SIGHUP] = "hung up"


def answer(number: int, frame: object) -> None:
    """End the process at once: nothing is open yet."""
    try:  # noqa: SIM105  # contextlib would have to be imported
        os.write(2, f"newmark-study: {NAMES[number]}\n".encode())
    except OSError:  # a terminal that was closed
        pass
    os._exit(128 + number)


def main() -> None:
    """Run the command line, answering signals from here on; see `newmark_cli.cli.main`."""
    for number in NAMES:
        if _signal.getsignal(number) in (_signal.SIG_DFL, _signal.default_int_handler):
            _signal.signal(number, answer)
    from newmark_cli.cli import main

    main()
