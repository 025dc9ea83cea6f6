"""The command that judges what another code computed."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from newmark_cli.cli import screen
from newmark_cli.cli.shared import (
    allow_code_option,
    as_json_text,
    axis_option,
    call_with_problem,
    file_option,
    flag,
    formulation_option,
    integrator_named,
    json_option,
)


@click.command()
@click.argument("table", required=False, type=click.Path(path_type=Path))
@click.option(
    "--problem",
    metavar="PROBLEM",
    help="What was solved: a problem, a mechanism file, a member of a family, a Python problem.",
)
@click.option(
    "--template",
    metavar="PROBLEM",
    help="Print the header of a table for PROBLEM and its start, and judge nothing.",
)
@axis_option(
    "integrator", "METHOD", "The code's integrator: its orders are expected; without it, none."
)
@formulation_option
@click.option("--projection", metavar="METHOD", help="The code's projection; none by default.")
@file_option(
    "--columns",
    help="YAML with other names, numbers and formulas: 'h: 0.002', 'u[A.x]: 0.5 * cos(angle)'.",
)
@file_option(
    "--reference",
    help="A table of the solution and its errors, in place of one that is computed.",
)
@file_option(
    "--expect", help="YAML with the key 'expect' of a study: orders and levels that you expect."
)
@file_option("--plot", help="Draw the errors next to those of this tool: .png, .svg or .pdf.")
@flag("--strict", help="Fail where a verdict is undecided, too.")
@json_option
@allow_code_option
def judge(
    table: Path | None,
    problem: str | None,
    template: str | None,
    plot: Path | None,
    strict: bool,
    as_json: bool,
    allow_code: bool,
    **options: Any,
) -> int:
    """Judge what another code computed: errors, orders, and what is wrong.

    TABLE is text with any separator, Parquet, .npy or .mat.  It has a row for each run and
    time: h, t, and the state under the names of the problem, as --template prints them.
    Exits with 1 if a fault is found or an order is missed.

    \b
    Example:
      newmark-study judge mine.csv --problem andrews
    """
    from newmark_cli.library import judging
    from newmark_cli.study import naming

    if template is not None:
        if table is not None or problem is not None:
            raise click.UsageError("--template goes without a table")
        screen.lines(
            call_with_problem(naming.problem_named(template, allow_code), judging.template)
        )
        screen.note(f"Write {judging.ROWS}, with 17 digits (%.17g).")
        return 0
    if table is None or problem is None:
        raise click.UsageError("give TABLE and --problem, or --template")
    arguments = {name: value for name, value in options.items() if value is not None}
    if "integrator" in arguments:
        arguments["integrator"] = integrator_named(arguments["integrator"], allow_code)
    judge_problem = partial(judging.judge, table, **arguments)
    judged = call_with_problem(naming.problem_named(problem, allow_code), judge_problem)
    if plot is not None:
        from newmark_cli.library import drawn_errors

        drawn_errors.write(judged, plot)
    screen.lines(as_json_text(judged.to_dict()) if as_json else str(judged))
    return 1 if judged.fails(strict) else 0
