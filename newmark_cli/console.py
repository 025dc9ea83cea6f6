"""The console script's way in: it answers Ctrl-C before anything else is imported."""

from newmark_cli.support import interrupts


def main() -> None:
    """Run the command line, answering signals from here on; see `newmark_cli.cli.main`."""
    interrupts.catch()
    from newmark_cli.cli import main

    main()
