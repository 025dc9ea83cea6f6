"""``python -m newmark_cli``."""

from newmark_cli.cli import main

main()
