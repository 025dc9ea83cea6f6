"""Commands that read results: figures, values, verdicts, tables, provenance."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from newmark_cli.cli import screen
from newmark_cli.cli.shared import (
    Number,
    as_json_text,
    choosing_options,
    file_option,
    flag,
    formats_option,
    json_option,
    results_folder,
    size_option,
    studies_argument,
    style_option,
)
from newmark_cli.support.errors import InputError

if TYPE_CHECKING:
    from newmark_cli.report.judging.expectations import Expected
    from newmark_cli.report.judging.slopes import Slope
    from newmark_cli.report.tables.outcomes import Outcome
    from newmark_cli.report.tables.table import Report

#: Series of which `check` says why they are not as predicted, unless all are asked for.
REMARKS = 20


def _names(context: click.Context, option: click.Parameter, text: str | None) -> tuple[str, ...]:
    return tuple(dict.fromkeys(part.strip() for part in (text or "").split(",") if part.strip()))


@click.command()
@click.argument("names", nargs=-1, metavar="[FIGURE|STUDY...]")
@results_folder
@formats_option
@size_option
@style_option
@choosing_options
@click.option(
    "--cost",
    type=click.Choice(["operations", "wall-time"]),
    default="operations",
    show_default=True,
    help="Measure of work in work-precision figures: operations are linear systems times a formula "
    "in their size; wall-time needs `run --timed`.",
)
@flag("--all", "everything", help="Draw all figures of a study, however many.")
def plot(
    names: tuple[str, ...],
    folder: Path,
    formats: tuple[str, ...],
    size: tuple[float, float | None] | None,
    style_file: Path | None,
    measure: tuple[str, ...],
    cost: str,
    everything: bool,
    **values: tuple[str, ...],
) -> int:
    """Draw figures of the paper and of studies.

    By default, draws every figure that the CSVs in DIR suffice for.  A study gets one
    for each problem, form, quantity and measure, unless its config defines others
    under 'figures:'.  Writes DIR/figures/figure-<n> or <study>-<what it shows>, and
    DIR/slopes.csv.

    \b
    Example:
      newmark-study plot my-study --measure error --format pdf --size 5x4
    """
    from newmark_cli.report.drawing import plot as plotting
    from newmark_cli.report.drawing.sheets import Results
    from newmark_cli.report.judging import slopes
    from newmark_cli.report.reading.choosing import Choice

    choice = Choice(measure, values, everything)
    # Read everything before anything is written; a mechanism's figure needs no results.
    needed = bool(choice) or plotting.needs_results(names, folder)
    results = Results(folder, slopes.collect(folder) if needed else [], cost)
    chosen = plotting.chosen(names, results, choice)
    for file in plotting.plot(chosen.figures, results, formats, size, style_file):
        screen.line(file)
    if needed:
        slopes.write(folder, results.slopes)
    for note in chosen.notes:
        screen.complain(note)
    return 0


@click.command()
@studies_argument
@choosing_options
@results_folder
@flag("--record", "as_recorded", help="Show where results come from: code, versions, machine.")
@json_option
def show(
    studies: tuple[str, ...],
    folder: Path,
    as_recorded: bool,
    as_json: bool,
    measure: tuple[str, ...],
    **values: tuple[str, ...],
) -> int:
    """Show the values of studies: step sizes down, series across.

    Beside each value stands the local order, from the next larger step size to this
    one.  Below stand the fitted slope, its range of step sizes, the predicted order,
    the verdict and its reason.  Without STUDY and options, lists the studies in DIR.

    With --record, shows where results come from: code, versions, machine and times;
    with --json as well, the whole record, with the config and a list of cells.

    \b
    Example:
      newmark-study show pendulum-u --quantity lambda --preconditioning none
    """
    from newmark_cli.report.reading import records
    from newmark_cli.report.reading.choosing import Choice
    from newmark_cli.report.tables import showing
    from newmark_cli.study import csv_rows

    choice = Choice(measure, values)
    if as_recorded:
        files = (folder / f"{name}.csv" for name in csv_rows.named_studies(folder, studies))
        data: Sequence[Any] = [records.read(file) for file in files]
        text = "\n\n".join(map(records.as_text, data))
    elif not studies and not choice:
        found = showing.read(folder, studies)
        data, text = [study.row() for study in found], showing.listed(found)
    else:
        found = showing.choose(showing.read(folder, studies), choice)
        data = [study.data() for study in found]
        matching = [study for study in found if study.chosen or study.recovered]
        text = "\n\n".join(map(showing.as_text, matching))
    screen.lines(as_json_text(data) if as_json else text)
    return 0


@click.command()
@studies_argument
@results_folder
@flag(
    "--all", "show_all", help="Show every slope, not only misses and those of the paper's figures."
)
@json_option
@flag("--markdown", help="Print the tables as Markdown.")
@flag("--strict", help="Fail if a series or an expectation is undecided.")
@flag("--strict-expectations", help="Fail if a claim or an expectation is undecided.")
@file_option("--junit", help="Write the checks as JUnit XML, for continuous integration.")
def check(
    studies: tuple[str, ...],
    folder: Path,
    show_all: bool,
    as_json: bool,
    markdown: bool,
    strict: bool,
    strict_expectations: bool,
    junit: Path | None,
) -> int:
    """Check slopes against predicted orders, claims and expectations.

    Judges and prints the named studies, by default all in DIR, and writes nothing
    there.  Exits with 1 if a slope misses its prediction by more than its tolerance, a
    series does not converge or lacks results, a claim of a figure or an expectation of
    the config fails, a CSV differs from its record, or nothing could be judged.  Warns
    of series with too few or too coarse step sizes; with --strict they fail, with
    --strict-expectations only those of which the config expects something.  In GitHub
    workflows (GITHUB_ACTIONS=true), annotates the run with failures.

    \b
    Example:
      newmark-study check my-study --strict --junit slopes.xml
    """
    from newmark_cli.report.judging import expectations, slopes
    from newmark_cli.report.judging.text import wrapped
    from newmark_cli.report.reading import records
    from newmark_cli.report.tables import outcomes
    from newmark_cli.study import csv_rows
    from newmark_cli.support import files

    wanted = csv_rows.named_studies(folder, studies)
    series = slopes.collect(folder, wanted)
    expected = expectations.judge(folder, series)
    changed = records.changed(folder, wanted)
    if as_json:
        rows = [slope.row() for slope in series]
        rows += [e.row() for e in (*expectations.claims(expected), *expectations.own(expected))]
        rows += [{"file": str(entry.path), "finding": entry.finding} for entry in changed]
        screen.lines(as_json_text(rows))
    else:
        findings = [f"{entry.path}: {entry.finding}" for entry in changed]
        summary = show_claims(series, expected, show_all, markdown, findings)
        if not markdown:
            screen.lines(wrapped(summary))
    asserted = outcomes.of(series, expected, changed, tables=True)
    decided = outcomes.EXPECTATIONS if strict_expectations else outcomes.LENIENT
    decided = outcomes.ALL if strict else decided
    if junit is not None:
        files.write_output(junit, outcomes.junit(asserted, decided))
    if os.environ.get("GITHUB_ACTIONS") == "true":
        top = os.environ.get("GITHUB_WORKSPACE")
        # Not into what programs read, or what is published.
        tell = screen.note if as_json or markdown else screen.line
        for line in outcomes.annotations(asserted, decided, Path(top) if top else None):
            tell(line)
    return verdict(asserted, decided)


@click.command()
@studies_argument
@results_folder
@choosing_options
@click.option(
    "--rows",
    callback=_names,
    metavar="AXES",
    help="Axes of the rows, separated by commas; preconditioning by default, or with --list "
    "all that vary.",
)
@click.option(
    "--columns", callback=_names, metavar="AXES", help="Axes of the columns; quantity by default."
)
@flag("--list", "as_list", help="Print one row for each series, with its values as columns.")
@click.option(
    "--values",
    "shown",
    callback=_names,
    metavar="LIST",
    help="Values to print, separated by commas: predicted, tolerance, fitted, slope, stderr, "
    "points, h_from, h_to, local_orders, verdict, reason; by default predicted and fitted, or "
    "with --list slope, stderr, predicted and verdict.",
)
@click.option(
    "--format",
    "written",
    type=click.Choice(["text", "markdown", "latex", "csv"]),
    help="Format of printed tables.  By default markdown for a named study; other tables are "
    "printed as text and also written to DIR/tables.",
)
@flag("--formulations", help="Tabulate the predicted orders of all formulations; needs no results.")
def tables(
    studies: tuple[str, ...],
    folder: Path,
    measure: tuple[str, ...],
    rows: tuple[str, ...],
    columns: tuple[str, ...],
    as_list: bool,
    shown: tuple[str, ...],
    written: str | None,
    formulations: bool,
    **chosen: tuple[str, ...],
) -> int:
    """Make tables of studies, or Tables 1 and 2 of the paper, predicted and measured.

    For a named study, prints the tables that its config defines under 'tables:', or
    else the predicted and fitted orders of its series: one table for each combination
    of the axes that are neither rows nor columns.  With --list, prints one row for each
    series.  Options select other rows, columns, values and series.

    Without a study, reads the CSV of all-forms and writes DIR/tables/table-1 and table-2
    as .md, .csv and .tex.  With --formulations, writes DIR/tables/formulations:
    predicted orders of corrections and condition numbers, and the factors that
    formulations add to Table 2.  Exits with 1 if an entry is not as predicted.

    \b
    Example:
      newmark-study tables my-study --list --values slope,stderr,verdict --format csv
    """
    from newmark_cli.report.judging import slopes
    from newmark_cli.report.reading.choosing import Choice
    from newmark_cli.report.tables import study_tables, theory
    from newmark_cli.study.csv_rows import read_record

    choice = Choice(measure, chosen)
    choosing = bool(choice or rows or columns or as_list or shown)
    if studies:
        series = choice.series(slopes.collect(folder, studies))
        layout = study_tables.from_options(rows, columns, as_list, shown) if choosing else None
        for study in studies:
            ours = [slope for slope in series if slope.study == study]
            record = read_record(folder / f"{study}.csv")
            wanted = [layout] if layout else study_tables.defined(folder, study)
            for table_layout in wanted or [study_tables.USUAL]:
                found = study_tables.report(ours, table_layout, record, choice.keeps)
                screen.lines(found.written(written or "markdown").rstrip() + "\n")
        return 0
    if choosing:
        raise InputError("tables: options that choose rows, columns or series need a STUDY")
    if formulations:
        show_report(folder, theory.formulations(), written)
        return 0
    return show_tables(folder, slopes.collect(folder, [study_tables.PAPER]), written)


@click.command()
@click.argument("first", type=click.Path(path_type=Path), metavar="A")
@click.argument("second", type=click.Path(path_type=Path), metavar="B")
@click.option(
    "--rtol",
    type=Number(0, 1, max_open=True),
    default=1e-6,
    show_default=True,
    help="Relative tolerance of values that are not dominated by rounding.",
)
@flag("--all", "everything", help="Show all differences, not only ten of each kind.")
@json_option
def compare(first: Path, second: Path, rtol: float, everything: bool, as_json: bool) -> int:
    """Compare two results folders: cells, values, slopes, verdicts.

    Values at rounding level (corrections, errors, residuals) differ between machines
    and are compared within a factor of ten.  Exits with 1 if A and B differ in the
    verdict on a slope or a claim, or if a study in both has cells, series or rows in
    only one of them.

    \b
    Example:
      newmark-study compare results other-machine/results
    """
    from newmark_cli.report.tables import compare as comparing

    text, data, differs = comparing.compare(first, second, rtol, None if everything else 10)
    screen.lines(as_json_text(data) if as_json else text)
    return int(differs)


@click.command()
@results_folder
@file_option("--output", help="File to write; DIR/report.html by default.")
def report(folder: Path, output: Path | None) -> int:
    """Write the results in DIR as one HTML page.

    The page contains the claims, figures, tables and provenance.  It needs no other
    file and no network.  Writing it needs the extra `report`.

    \b
    Example:
      newmark-study report --output newmark.html
    """
    from newmark_cli.report import page

    screen.line(page.write(folder, output))
    return 0


def show_claims(
    slopes: "Sequence[Slope]",
    expected: "Sequence[Expected]" = (),
    show_all: bool = False,
    markdown: bool = False,
    changed: Sequence[str] = (),
) -> str:
    """Print slopes, claims and expectations, and why some fail; returns how many hold.

    As Markdown, the tables and nothing else.
    """
    from newmark_cli.report.judging import expectations
    from newmark_cli.report.judging.text import text_table, wrapped
    from newmark_cli.report.tables import check as checking
    from newmark_cli.report.tables.table import markdown_table

    chosen = checking.chosen(slopes, show_all)
    if markdown:
        # A table to publish: what nothing can be said of is for those who run the check.
        chosen = [s for s in chosen if show_all or s.figures or s.fails] or list(slopes)
        slope_rows, claims = checking.slope_rows(chosen), expectations.claim_rows(expected)
        for table in (slope_rows, claims, expectations.table(expected)):
            if len(table) > 1:
                screen.lines(markdown_table(table) + "\n")
        return ""
    slope_rows, claims = checking.slope_lines(chosen), expectations.claim_lines(expected)
    for table in (slope_rows, claims, expectations.lines(expected)):
        if len(table) > 1:
            screen.lines(text_table(table) + "\n")
    for remarks in (checking.remarks(slopes), expectations.remarks(expected), changed):
        most = len(remarks) if show_all else REMARKS
        for line in remarks[:most]:
            screen.lines(wrapped(line))
        if len(remarks) > most:
            screen.line(f"… and {len(remarks) - most} more (--all)")
        if remarks:
            screen.line()
    summary = checking.summary(slopes, expectations.summary(expected))
    if changed:
        summary += f", {len(changed)} not what was written"
    return summary


def verdict(asserted: "Sequence[Outcome]", strict: str = "") -> int:
    """1 when something that is asserted is not so; says what the tables of a check do not."""
    from newmark_cli.report.tables import outcomes

    for line in outcomes.notes(asserted, strict):
        screen.complain(line)
    return 0 if outcomes.hold(asserted, strict) else 1


def show_report(folder: Path, report: "Report", form: str | None) -> None:
    """Print tables in a format; without one as text, and write them in the others."""
    screen.lines(report.written(form or "text").rstrip())
    if form is None:
        screen.line()
        for file in report.write(folder):
            screen.line(file)


def show_tables(folder: Path, slopes: "Sequence[Slope]", form: str | None = None) -> int:
    """Print Tables 1 and 2; 1 when an entry is not as predicted."""
    from newmark_cli.report.tables import study_tables

    for table in study_tables.paper_reports(slopes):
        show_report(folder, table, form)
        screen.line()
    return 1 if study_tables.not_as_predicted(slopes) else 0
