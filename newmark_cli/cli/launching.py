"""Commands that run studies."""

import contextlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from newmark_cli.cli import screen
from newmark_cli.cli.evaluating import show_claims, show_tables, verdict
from newmark_cli.cli.shared import (
    allow_code_option,
    flag,
    results_folder,
    running_options,
)
from newmark_cli.support import interrupts

if TYPE_CHECKING:
    from newmark_cli.cli.terminal import Progress
    from newmark_cli.running.runner import Options, StudyRun
    from newmark_cli.study.config import Study


@click.command()
@click.argument("configs", nargs=-1, required=True, metavar="CONFIG... [KEY=VALUE...]")
@results_folder
@running_options
@flag("--dry-run", help="List every cell as done or to run, and why; run nothing.")
@flag("--timed", help="Also time each march alone, one cell at a time.")
@flag(
    "--replace", "replacing", help="Overwrite results of another config with the same study name."
)
@click.option(
    "--trajectories",
    type=click.Choice(["csv", "parquet"]),
    default="csv",
    show_default=True,
    help="File format of the trajectories that a study keeps.",
)
@allow_code_option
def run(
    configs: tuple[str, ...],
    folder: Path,
    how: "Options",
    quiet: bool,
    verbose: bool,
    dry_run: bool,
    timed: bool,
    replacing: bool,
    trajectories: str,
    allow_code: bool,
) -> int:
    """Run studies: YAML files or names of shipped studies.

    Writes DIR/<study>.csv, the resolved config as .json beside it, and versions and
    wall times as DIR/runs/<study>.json.  Caches finished cells in DIR/cells, so that
    an interrupted run resumes where it stopped.  Exits with 1 if a cell fails, or ends
    with a status that its study does not accept.

    KEY=VALUE sets a key of the studies, as their files spell it.  What is changed like
    this is another study, <study>-KEY-VALUE, or as study=NAME calls it.

    \b
    Example:
      newmark-study run pendulum-u my-study.yaml --results out
      newmark-study run my-study.yaml h=[1e-3,1e-4] form=v-lambda
    """
    from newmark_cli.study import config, overrides

    names, settings = overrides.parsed(configs)
    if not names:
        raise click.UsageError("Missing argument 'CONFIG...'.")
    studies = [config.find(name, allow_code, how.timeout, settings) for name in names]
    if dry_run:
        return _dry_run(studies, folder, how.force)
    how = replace(how, parquet=trajectories == "parquet", timed=timed, replace=replacing)
    if timed:
        how = replace(how, jobs=1)
    return _tell(_run(studies, folder, how, quiet, verbose), folder, quiet)


@click.command()
@results_folder
@running_options
@flag("--all", "everything", help="Also run the studies beyond the paper.")
def reproduce(folder: Path, how: "Options", quiet: bool, verbose: bool, everything: bool) -> int:
    """Run the paper's studies, draw its figures, check slopes.

    With --all, also runs the studies beyond the paper and checks their claims.  The
    summary at the end says how many studies match the shipped numbers bit for bit.
    Exits with 1 if a slope is not as predicted or a claim fails.

    \b
    Example:
      newmark-study reproduce --results out
    """
    from newmark_cli.study import config, shipped

    studies = (*config.REPRODUCED, *config.BEYOND) if everything else config.REPRODUCED
    runs = _run([config.load_shipped(name) for name in studies], folder, how, quiet, verbose)
    code = _tell(runs, folder, quiet)

    from newmark_cli.report.drawing import plot as plotting
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging import expectations, slopes
    from newmark_cli.report.reading import records
    from newmark_cli.report.tables import outcomes
    from newmark_cli.study import csv_rows

    series = slopes.collect(folder, studies)
    files = plotting.plot(plotting.of_studies(studies), Results(folder, series))
    screen.line()
    show_tables(folder, series)
    expected = expectations.judge(folder, series)
    summary = show_claims(series, expected)
    # slopes.csv is about all that is in the folder; what is printed, and the exit code,
    # only about what was run.
    others = [file.stem for file in csv_rows.study_files(folder) if file.stem not in studies]
    slopes.write(folder, series + slopes.collect(folder, others))
    code = code or verdict(outcomes.of(series, expected, tables=True))
    ended = sum(status == "ok" for done in runs for status in done.statuses)
    for line in (
        f"Summary of {len(studies)} studies, whose CSVs are in {folder}:",
        f"cells: {ended} of {sum(len(done.statuses) for done in runs)} ok",
        f"written: {len(files)} files in {folder / 'figures'}, tables in {folder / 'tables'}",
        summary,
        records.agreement(folder, studies, shipped.folder() / "results.json"),
        "next: 'newmark-study show andrews-u' for values, 'newmark-study report' for a page"
        if code == 0
        else "not all is as it should be: the lines that begin with 'newmark-study:' say what",
    ):
        screen.line(line)
    return code


def _run(
    studies: "Sequence[Study]", folder: Path, how: "Options", quiet: bool, verbose: bool
) -> "list[StudyRun]":
    from newmark_cli.cli import terminal
    from newmark_cli.running import runner

    with contextlib.closing(terminal.Progress(quiet, verbose)) as watcher:
        interrupts.Line.after = lambda: _kept(watcher, how.force)
        return runner.run_studies(studies, folder, how, watcher)


def _kept(counts: "Progress", force: bool) -> str:
    """End of an interrupt's message: how many cells are cached."""
    if not counts.total:
        return ""
    kept = f"; {counts.kept} of {counts.total} cells are cached"
    return kept if force else f"{kept}, run the same command again to continue"


def _tell(runs: "Sequence[StudyRun]", folder: Path, quiet: bool = False) -> int:
    """Print a line for each study, and complaints; 1 if a cell did not end well."""
    for done in runs:
        ended = ", ".join(f"{n} {status}" for status, n in Counter(done.statuses).items())
        kept = f" ({done.kept} cached)" if done.kept else ""
        where = f"-> {done.path}" if done.path else "cached in " + str(folder / "cells")
        if not quiet:
            screen.line(f"{done.study}: {ended or 'no cells'}{kept} {where}")
    for done in runs:
        for complaint in done.complaints:
            screen.complain(f"{done.study}: {complaint}")
    return 1 if any(done.complaints for done in runs) else 0


def _dry_run(studies: "Sequence[Study]", folder: Path, force: bool) -> int:
    from newmark_cli.running import runner
    from newmark_cli.study import axes

    planned = runner.plan(studies, folder, force)
    for entry in planned:
        state = f"to run: {entry.why}"
        if entry.done:
            lacks = "".join(f"; measured no error: {why}" for why in entry.done.outcome.lacks)
            again = "; a run tries again" if lacks else ""
            state = f"done, {entry.done.outcome.status}{lacks}{again}"
        screen.line(f"{studies[entry.study].study}: {axes.described(entry.cell)}: {state}")
    left = sum(entry.done is None for entry in planned)
    screen.line(f"{left} of {len(planned)} cells to run")
    return 0
