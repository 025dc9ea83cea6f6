"""``python -m newmark_cli``, which imports nothing from the current folder, as the script does."""

import sys

if not sys.flags.safe_path:
    del sys.path[0]

from newmark_cli.console import main

main()
