"""``python -m newmark_cli``."""

from newmark_cli.console import main

main()
