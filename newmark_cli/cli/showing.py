"""The command that shows measured values in the terminal."""

from pathlib import Path

import click

from newmark_cli.cli import screen
from newmark_cli.cli.options import (
    as_json_text,
    choosing_options,
    json_option,
    results_folder,
    studies_argument,
)


@click.command()
@studies_argument
@choosing_options
@results_folder
@json_option
def show(
    studies: tuple[str, ...],
    folder: Path,
    as_json: bool,
    measure: tuple[str, ...],
    **values: tuple[str, ...],
) -> int:
    """Show the values of studies: step sizes down, series across.

    Beside each value stands the local order, from the next larger step size to this
    one.  Below stand the fitted slope, its range of step sizes, the predicted order,
    the verdict and its reason.  Without STUDY and options, lists the studies in DIR.

    \b
    Example:
      newmark-study show pendulum-u --quantity lambda --preconditioning none
    """
    from newmark_cli.report.reading.choosing import Choice
    from newmark_cli.report.tables import showing

    read, choice = showing.read(folder, studies), Choice(measure, values)
    if not studies and not choice:
        screen.lines(
            as_json_text([study.row() for study in read]) if as_json else showing.listed(read)
        )
        return 0
    chosen = showing.choose(read, choice)
    if as_json:
        screen.lines(as_json_text([study.data() for study in chosen]))
        return 0
    matching = [study for study in chosen if study.chosen or study.recovered]
    screen.lines("\n\n".join(showing.as_text(study) for study in matching))
    return 0
