"""The command line without what no test looks at.

Advice draws less often what rounding does, marches are timed once, and figures are drawn by the
process itself.  Processes for user code import it, too.
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

    from newmark_cli.report.drawing import rendering

    advising._advised = quicker.advised
    rendering._WORTH = 10**9
    main()
