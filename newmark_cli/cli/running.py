"""Commands that run studies, and remove what they no longer need."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from newmark_cli.cli import screen
from newmark_cli.cli.options import (
    allow_code_option,
    complete_config,
    flag,
    format_option,
    results_folder,
    running_options,
)
from newmark_cli.cli.results import show_claims, show_cures, show_tables, verdict
from newmark_cli.support import interrupts

if TYPE_CHECKING:
    from newmark_cli.cli.terminal import Counts
    from newmark_cli.running.runner import Options, StudyRun
    from newmark_cli.study.config import Study


def _shard(
    context: click.Context, option: click.Parameter, text: str | None
) -> tuple[int, int] | None:
    if text is None:
        return None
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"must be I/N with 1 <= I <= N, given {text!r}")
    return int(match[1]), int(match[2])


@click.command()
@click.argument(
    "configs", nargs=-1, required=True, metavar="CONFIG...", shell_complete=complete_config
)
@results_folder
@running_options
@flag("--dry-run", help="List every cell as done or to run, and why; run nothing.")
@click.option(
    "--shard",
    callback=_shard,
    metavar="I/N",
    help="Run only part I of N; `merge` combines the parts.",
)
@flag("--timed", help="Also time each march alone, one cell at a time.")
@flag(
    "--replace", "replacing", help="Overwrite results of another config with the same study name."
)
@format_option
@allow_code_option
def run(
    configs: tuple[str, ...],
    folder: Path,
    how: "Options",
    quiet: bool,
    verbose: bool,
    dry_run: bool,
    shard: tuple[int, int] | None,
    timed: bool,
    replacing: bool,
    kind: str,
    allow_code: bool,
) -> int:
    """Run studies: YAML files or names of shipped studies.

    Writes DIR/<study>.csv, the resolved config as .json beside it, and versions and
    wall times as DIR/runs/<study>.json.  Caches finished cells in DIR/cells, so that
    an interrupted run resumes where it stopped.  Exits with 1 if a cell fails, or ends
    with a status that its study does not accept.

    \b
    Example:
      newmark-study run pendulum-u my-study.yaml --results out
    """
    from newmark_cli.study import config

    studies = [config.find(name, allow_code, how.timeout) for name in configs]
    for line in () if quiet else (line for study in studies for line in config.unjudged(study)):
        screen.complain(f"warning: {line}")
    if dry_run:
        return _dry_run(studies, folder, how.force, shard)
    how = replace(how, shard=shard, parquet=kind == "parquet", timed=timed, replace=replacing)
    if timed:
        how = replace(how, jobs=1)
    return _tell(_run(studies, folder, how, quiet, verbose), folder, quiet)


@click.command()
@click.argument(
    "configs", nargs=-1, required=True, metavar="CONFIG...", shell_complete=complete_config
)
@click.option(
    "--from",
    "sources",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    multiple=True,
    required=True,
    metavar="DIR",
    help="Results folder of a shard; repeat for each shard.",
)
@results_folder
@format_option
@allow_code_option
def merge(
    configs: tuple[str, ...], sources: tuple[Path, ...], folder: Path, kind: str, allow_code: bool
) -> int:
    """Combine the cells of shards and write the studies.

    Computes nothing.  If cells are missing, reports how many and exits with 1.

    \b
    Example:
      newmark-study merge andrews-u --from node1/results --from node2/results
    """
    from newmark_cli.running import runner
    from newmark_cli.study import config

    studies = [config.find(name, allow_code) for name in configs]
    merged = runner.merge(studies, folder, sources, kind == "parquet")
    for source, count in zip(sources, merged.taken, strict=True):
        screen.line(f"{source}: {count} cells")
    for i, (study, count) in enumerate(zip(studies, merged.missing, strict=True)):
        if count:
            why = "".join(f"; {n} cached otherwise: {how}" for how, n in merged.why[i].items())
            total = len(study.cells())
            screen.complain(f"{study.study}: {count} of {total} cells are missing{why}")
    if any(merged.missing):
        return 1
    return _tell(merged.runs, folder)


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
    from newmark_cli.study import config

    studies = (*config.REPRODUCED, *config.BEYOND) if everything else config.REPRODUCED
    runs = _run([config.load_shipped(name) for name in studies], folder, how, quiet, verbose)
    code = _tell(runs, folder, quiet)

    from newmark_cli.report.drawing import plot as plotting
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging import expectations, slopes
    from newmark_cli.report.reading import records
    from newmark_cli.report.tables import outcomes
    from newmark_cli.study import reading

    series = slopes.collect(folder, studies)
    files = plotting.plot(plotting.of_studies(studies), Results(folder, series))
    screen.line()
    show_tables(folder, series)
    if everything:
        code = max(code, show_cures(folder))
    expected = expectations.judge(folder, series)
    summary = show_claims(series, expected)
    # slopes.csv is about all that is in the folder; what is printed, and the exit code,
    # only about what was run.
    others = [file.stem for file in reading.study_files(folder) if file.stem not in studies]
    slopes.write(folder, series + slopes.collect(folder, others))
    code = code or verdict(outcomes.of(series, expected, tables=True))
    ended = sum(status == "ok" for done in runs for status in done.statuses)
    for line in (
        f"Summary of {len(studies)} studies, whose CSVs are in {folder}:",
        f"cells: {ended} of {sum(len(done.statuses) for done in runs)} ok",
        f"written: {len(files)} files in {folder / 'figures'}, tables in {folder / 'tables'}",
        summary,
        records.agreement(folder, studies, config.shipped_sums()),
        "next: 'newmark-study show andrews-u' for values, 'newmark-study report' for a page"
        if code == 0
        else "not all is as it should be: the lines that begin with 'newmark-study:' say what",
    ):
        screen.line(line)
    return code


@click.command()
@click.argument("configs", nargs=-1, metavar="[CONFIG]...", shell_complete=complete_config)
@results_folder
@flag("--dry-run", help="Report what would be removed; remove nothing.")
@allow_code_option
def prune(configs: tuple[str, ...], folder: Path, dry_run: bool, allow_code: bool) -> int:
    """Remove cached cells that no study needs.

    Keeps the cells in DIR/cells that a CSV in DIR was made from, and those of
    unfinished studies.  For each CONFIG, keeps the cells that it needs now instead of
    those of its CSV.  Also removes damaged cells, cells of another version of the
    numerical core that no CSV was made from, and old temporary files of killed runs.
    Never touches CSVs or figures.

    \b
    Example:
      newmark-study prune --dry-run
    """
    from rich.filesize import decimal

    from newmark_cli.running import prune as pruning

    studies = []
    if configs:
        from newmark_cli.study import config

        studies = [config.find(name, allow_code) for name in configs]
    pruned = pruning.prune(folder, studies, dry_run)
    verb = "would remove" if dry_run else "removed"
    for removed in pruned.removed:
        count = len(removed.files)
        kind = removed.kind.format(s="s" * (count != 1))
        screen.line(f"{verb} {count} {kind} ({decimal(removed.size)})")
    if not pruned.removed:
        screen.line("nothing to remove")
    cells = "1 cell stays" if pruned.stay == 1 else f"{pruned.stay} cells stay"
    screen.line(f"{cells} ({decimal(pruned.size)})")
    if pruned.outdated:
        are = "is" if pruned.outdated == 1 else "are"
        screen.line(
            f"{pruned.outdated} of them {are} of another numerical core: run their studies again "
            "and prune again, or name their configs"
        )
    if pruned.unfinished:
        screen.line(f"not finished, so that their cells stay: {', '.join(pruned.unfinished)}")
    return 0


def _run(
    studies: "Sequence[Study]", folder: Path, how: "Options", quiet: bool, verbose: bool
) -> "list[StudyRun]":
    from newmark_cli.cli import terminal
    from newmark_cli.running import runner

    with terminal.watching(quiet, verbose) as watcher:
        interrupts.Line.after = lambda: _kept(watcher, how.force)
        return runner.run_studies(studies, folder, how, watcher)


def _kept(counts: "Counts", force: bool) -> str:
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
    return 0 if all(done.ok for done in runs) else 1


def _dry_run(
    studies: "Sequence[Study]", folder: Path, force: bool, shard: tuple[int, int] | None
) -> int:
    from newmark_cli.running import runner
    from newmark_cli.study import axes

    planned = runner.plan(studies, folder, force, shard)
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
