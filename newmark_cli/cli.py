"""The command line: parse, delegate, exit code.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import functools
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from newmark_cli import __version__
from newmark_cli.completion import complete
from newmark_cli.errors import ExecutorError, InputError, one_line

if TYPE_CHECKING:
    from newmark_cli.newmark.scaling import Preconditioning
    from newmark_cli.report.slopes import Slope
    from newmark_cli.report.tables import Entry
    from newmark_cli.study.config import Study
    from newmark_cli.study.runner import StudyRun


_complete_config = complete("configs", files=True)


def _folder(context: click.Context, option: click.Parameter, given: Path) -> Path:
    if given == Path():
        raise click.BadParameter("must name a folder other than the current one")
    return given


_results = click.option(
    "--results",
    "folder",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    callback=_folder,
    metavar="DIR",
    help="Results folder.",
)
_allow_code = click.option(
    "--allow-code", is_flag=True, help="Let configs name problems in Python, which runs them."
)
_jobs = click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    default=None,
    metavar="N",
    help="Threads, or processes for plain Python; as many as processors when omitted.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="newmark-study")
def cli() -> None:
    r"""Newmark integration of index-3 multibody DAEs at small step sizes.

    Runs studies of last decreasing Newton corrections and condition numbers,
    draws Figures 1-9 of Bottasso, Dopico and Trainelli, and checks fitted
    slopes against predicted orders.

    \b
    Example:
      newmark-study reproduce
    """


def _running(command: Callable[..., int]) -> Callable[..., int]:
    """Options of the commands that run studies, gathered into one argument ``how``."""

    @functools.wraps(command)
    def gathered(
        jobs: int | None, force: bool, fail_fast: bool, timeout: float | None, executor: str,
        scheduler: str | None, quiet: bool, verbose: bool, **rest: Any,
    ) -> int:  # fmt: skip
        if scheduler is not None and executor != "dask":
            raise click.UsageError("--scheduler needs --executor dask")
        if timeout is not None and math.isnan(timeout):
            raise click.UsageError("--timeout: must be a number of seconds, given nan")
        how = _How(
            jobs or os.cpu_count() or 1, force, fail_fast, timeout, executor, scheduler, quiet,
            verbose,
        )  # fmt: skip
        return command(how=how, **rest)

    for option in reversed(
        (
            _jobs,
            click.option("--force", is_flag=True, help="Compute cells again that are kept."),
            click.option(
                "--fail-fast/--keep-going",
                help="End the run with the first cell that does not end well; default: go on.",
            ),
            click.option(
                "--timeout",
                type=click.FloatRange(0, 1e9, min_open=True),
                metavar="SECONDS",
                help="Longest time of a cell; it then counts as failed.",
            ),
            click.option(
                "--executor",
                type=click.Choice(["local", "dask"]),
                default="local",
                show_default=True,
                help="Who runs the cells: this machine, or the workers of a dask scheduler.",
            ),
            click.option(
                "--scheduler", metavar="ADDRESS", help="Of dask; workers of its own without one."
            ),
            click.option("-q", "--quiet", is_flag=True, help="Say nothing but what is wrong."),
            click.option("-v", "--verbose", is_flag=True, help="A line for every cell."),
        )
    ):
        gathered = option(gathered)
    return gathered


@dataclass(frozen=True)
class _How:
    """Options of `_running`."""

    jobs: int
    force: bool
    fail_fast: bool
    timeout: float | None
    executor: str
    scheduler: str | None
    quiet: bool
    verbose: bool


def _shard(
    context: click.Context, option: click.Parameter, given: str | None
) -> tuple[int, int] | None:
    if given is None:
        return None
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", given)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"must be I/N with 1 <= I <= N, given {given!r}")
    return int(match[1]), int(match[2])


@cli.command()
@click.argument(
    "configs", nargs=-1, required=True, metavar="CONFIG...", shell_complete=_complete_config
)
@_results
@_running
@click.option("--dry-run", is_flag=True, help="List every cell as done, or to run and why.")
@click.option(
    "--shard", callback=_shard, metavar="I/N", help="Every N-th cell alone; then `merge`."
)
@_allow_code
def run(
    configs: tuple[str, ...],
    folder: Path,
    how: _How,
    dry_run: bool,
    shard: tuple[int, int] | None,
    allow_code: bool,
) -> int:
    r"""Run studies: YAML files, or names of shipped configs.

    Writes DIR/<study>.csv and, beside it, the resolved config, versions and
    wall times as .json.  Finished cells are kept in DIR/cells: a run that was
    interrupted goes on where it was.  Exits with 1 when a cell did not end well.

    \b
    Example:
      newmark-study run pendulum-u my-study.yaml --results out
    """
    from newmark_cli.study import config

    studies = [config.find(name, allow_code) for name in configs]
    if dry_run:
        return _dry_run(studies, folder, how.force, shard)
    return _run(studies, folder, how, shard)


@cli.command()
@click.argument(
    "configs", nargs=-1, required=True, metavar="CONFIG...", shell_complete=_complete_config
)
@click.option(
    "--from",
    "sources",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    multiple=True,
    required=True,
    metavar="DIR",
    help="Results folder of a shard; once for each.",
)
@_results
@_allow_code
def merge(
    configs: tuple[str, ...], sources: tuple[Path, ...], folder: Path, allow_code: bool
) -> int:
    r"""Put the cells of shards together and write the studies.

    Computes nothing: exits with 1 when cells are missing, and says how many.

    \b
    Example:
      newmark-study merge andrews-u --from node1/results --from node2/results
    """
    from newmark_cli.study import config, runner

    studies = [config.find(name, allow_code) for name in configs]
    merged = runner.merge(studies, folder, sources)
    for source, count in zip(sources, merged.taken, strict=True):
        click.echo(f"{source}: {count} cells")
    for study, count in zip(studies, merged.missing, strict=True):
        if count:
            _complain(f"{study.study}: {count} of {len(study.cells())} cells are missing")
    if any(merged.missing):
        return 1
    return _tell(merged.runs, folder)


@cli.command()
@click.argument("figures", nargs=-1, metavar="[FIGURE...]", shell_complete=complete("figures"))
@_results
def plot(figures: tuple[str, ...], folder: Path) -> int:
    r"""Draw figures, by default all that the CSVs in DIR are enough for.

    Writes DIR/figures/figure-<n>.png and .svg, and DIR/slopes.csv.

    \b
    Example:
      newmark-study plot 2 8
    """
    from newmark_cli.report import plot as plotting
    from newmark_cli.report import slopes

    wanted = plotting.names(figures)
    # Read everything before anything is written.
    found = slopes.collect(folder) if plotting.needs_results(wanted) else []
    lacking = [] if figures else plotting.without_data(wanted, found, folder)
    for file in plotting.plot(folder, [name for name in wanted if name not in lacking], found):
        click.echo(file)
    if found:
        slopes.write(folder, found)
    if lacking:
        _complain(plotting.how_to_get(lacking))
    return 0


@cli.command()
@_results
@click.option("--all", "show_all", is_flag=True, help="Show every slope, not figures and misses.")
@click.option("--json", "as_json", is_flag=True, help="Print every slope as JSON.")
@click.option("--markdown", is_flag=True, help="Print the table as Markdown.")
def check(folder: Path, show_all: bool, as_json: bool, markdown: bool) -> int:
    r"""Check every fitted slope in DIR against its predicted order, and the claims.

    Writes DIR/slopes.csv.  Exits with 1 when a slope misses its prediction by
    more than its tolerance, or cannot be fitted, or when a claim of a figure
    fails whose study is in DIR.

    \b
    Example:
      newmark-study check --json
    """
    from newmark_cli.report import check as checking
    from newmark_cli.report import slopes

    found = slopes.collect(folder)
    slopes.write(folder, found)
    if as_json:
        judged = checking.judge(found)
        click.echo(_json([s.row() for s in found] + [entry.row() for entry in judged]))
    else:
        _show_claims(found, show_all, markdown)
    return _verdict(found)


@cli.command()
@_results
@_running
@click.option("--all", "everything", is_flag=True, help="The studies past the paper too.")
def reproduce(folder: Path, how: _How, everything: bool) -> int:
    r"""Run the paper's studies, draw its nine figures, check every slope.

    With --all also the studies past the paper, their figures and claims.  Exits
    with 1 when a slope is not as predicted or a claim fails.

    \b
    Example:
      newmark-study reproduce --results out
    """
    from newmark_cli.study import config

    studies = (*config.REPRODUCED, *config.BEYOND) if everything else config.REPRODUCED
    code = _run([config.load_shipped(name) for name in studies], folder, how, None)

    from newmark_cli.report import plot as plotting
    from newmark_cli.report import slopes
    from newmark_cli.report import tables as tabling

    found = slopes.collect(folder, studies)
    files = plotting.plot(folder, plotting.of_studies(studies), found)
    click.echo(f"{len(files)} files in {folder / 'figures'}")
    slopes.write(folder, found)
    click.echo()
    _show_tables(folder, tabling.build(found))
    _show_claims(found)
    return code or _verdict(found)


@cli.command()
@click.argument("studies", nargs=-1, metavar="[STUDY...]", shell_complete=complete("configs"))
@_results
@click.option("--cells", "with_cells", is_flag=True, help="Print every cell with its wall time.")
@click.option("--config", "with_config", is_flag=True, help="Print the resolved config.")
def info(studies: tuple[str, ...], folder: Path, with_cells: bool, with_config: bool) -> int:
    r"""Say where results come from: code, versions, machine, wall times, checksums.

    Reads DIR/<study>.json, by default of every study in DIR.

    \b
    Example:
      newmark-study info pendulum-u --cells
    """
    from newmark_cli.report import check as checking
    from newmark_cli.report import records, table

    files = [folder / f"{name}.csv" for name in studies] or table.study_files(folder)
    found = [records.read(file) for file in files]
    for record in found:
        click.echo(records.as_text(record))
        if with_config:
            click.echo("\n" + records.config_text(record).rstrip())
        if with_cells:
            click.echo("\n" + checking.text_table(records.cell_rows(record)))
        click.echo()
    return 0


@cli.command()
@_results
def verify(folder: Path) -> int:
    r"""Compare the CSVs in DIR with the checksums that were recorded beside them.

    Prints a line for each file; exits with 1 when one differs, or is missing, or
    has no record.

    \b
    Example:
      newmark-study verify --results out
    """
    from newmark_cli.report import records

    found = records.verify(folder)
    for entry in found:
        click.echo(f"{entry.path}: {entry.finding}")
    return 0 if all(entry.ok for entry in found) else 1


@cli.command()
@click.argument("first", type=click.Path(path_type=Path), metavar="A")
@click.argument("second", type=click.Path(path_type=Path), metavar="B")
@click.option(
    "--rtol",
    type=click.FloatRange(0, 1, max_open=True),
    default=1e-6,
    show_default=True,
    help="Relative tolerance of values that rounding does not rule.",
)
@click.option("--all", "everything", is_flag=True, help="Show every difference, not the first.")
def compare(first: Path, second: Path, rtol: float, everything: bool) -> int:
    r"""Compare two results folders: cells, values, slopes, verdicts, environments.

    Values that rounding rules (corrections, errors, residuals) agree within a
    factor, since they differ from one machine to another.  Exits with 1 when a
    slope or a claim has another verdict in B than in A.

    \b
    Example:
      newmark-study compare results other-machine/results
    """
    if math.isnan(rtol):
        raise InputError("--rtol: must be a number from 0 to 1, given nan")
    from newmark_cli.report import compare as comparing

    found = comparing.compare(first, second, rtol)
    click.echo(comparing.as_text(found, None if everything else 10))
    return 1 if found.verdicts else 0


@cli.command()
@_results
@click.option(
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="The page; DIR/report.html when omitted.",
)
def report(folder: Path, output: Path | None) -> int:
    r"""Write the results in DIR as one page: claims, figures, tables, provenance.

    The HTML needs no other file and no network.  Needs the extra `report`.

    \b
    Example:
      newmark-study report --output newmark.html
    """
    from newmark_cli.report import page

    click.echo(page.write(folder, output or folder / "report.html"))
    return 0


@cli.command()
@click.option(
    "--form",
    "form",
    metavar="FORM",
    shell_complete=complete("forms"),
    help="One form; all seven when omitted.",
)
@click.option(
    "--preconditioning",
    "variant",
    metavar="VARIANT",
    shell_complete=complete("preconditioning"),
    help="One variant; the paper's four when omitted.",
)
@click.option(
    "--evaluation",
    type=click.Choice(["direct", "compensated"]),
    default=None,
    help="How residuals are evaluated; direct when omitted.",
)
@click.option(
    "--config",
    "file",
    metavar="CONFIG",
    shell_complete=_complete_config,
    help="Forms and scalings of a config.",
)
@click.option("--derive", is_flag=True, help="Derive the optimal scaling from the orders.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@_allow_code
def orders(
    form: str | None,
    variant: str | None,
    evaluation: str | None,
    file: str | None,
    derive: bool,
    as_json: bool,
    allow_code: bool,
) -> int:
    r"""Predict orders in h: blocks of J and its inverse, corrections, condition number.

    Laid out as in Sections 3 and 4 of the paper.  With --derive, finds the least
    powers of h that make every block O(1), and compares them with Table 2.

    \b
    Example:
      newmark-study orders --form u-lambda --preconditioning optimal
    """
    from newmark_cli.report import theory

    chosen = _forms_and_scalings(form, variant, evaluation, file, allow_code)
    if derive:
        found = [theory.derive(name) for name in dict.fromkeys(name for name, *_ in chosen)]
        texts = [theory.derived_as_text(entry) for entry in found]
    else:
        found = [theory.predict(*one) for one in chosen]
        texts = [theory.as_text(entry) + "\n" for entry in found]
    click.echo(_json(found) if as_json else "\n".join(texts))
    return 0


@cli.command()
@_results
def tables(folder: Path) -> int:
    r"""Tables 1 and 2 of the paper, every entry predicted beside measured.

    Reads the CSV of all-forms; writes DIR/tables/table-1 and table-2 as .md, .csv
    and .tex.  Exits with 1 when an entry is not as predicted.

    \b
    Example:
      newmark-study tables
    """
    from newmark_cli.report import slopes
    from newmark_cli.report import tables as tabling

    entries = tabling.build(slopes.collect(folder, [tabling.STUDY]))
    _show_tables(folder, entries)
    return 1 if tabling.missed(entries) else 0


@cli.command()
@click.argument(
    "files", nargs=-1, required=True, metavar="FILE...", shell_complete=complete(files=True)
)
@_allow_code
def validate(files: tuple[str, ...], allow_code: bool) -> int:
    r"""Check configs and mechanism files without running them.

    Prints a line for each file; exits with 2 when one is not valid.

    \b
    Example:
      newmark-study validate my-study.yaml my-mechanism.yaml
    """
    from newmark_cli.study import config

    code = 0
    for name in files:
        try:
            click.echo(one_line(config.describe(Path(name), name, allow_code)))
        except InputError as error:
            _complain(str(error))
            code = 2
    return code


@cli.command()
@click.argument("problem", metavar="PROBLEM", shell_complete=complete("problems", files=True))
@_results
@click.option("--at", "time", type=float, default=0.0, metavar="T", help="Time of the drawing (s).")
@click.option("--h", "step", type=float, metavar="H", help="Step size (s); T/2000 when omitted.")
@click.option(
    "--animate",
    "animated",
    type=click.Path(path_type=Path),
    metavar="FILE.gif",
    help="Write the motion from 0 to T as a looping GIF.",
)
@click.option("--frames", type=click.IntRange(2, 1000), default=60, show_default=True)
def draw(
    problem: str, folder: Path, time: float, step: float | None, animated: Path | None, frames: int
) -> int:
    r"""Draw a mechanism: a shipped problem, a mechanism file, or a family's member.

    Writes DIR/figures/<problem>.png and .svg.

    \b
    Example:
      newmark-study draw andrews --at 0.01
    """
    from newmark_cli.study import config

    if not (math.isfinite(time) and time >= 0):
        raise InputError(f"--at: must be zero or positive, given {time:g}")
    if step is not None and not (math.isfinite(step) and 0 < step <= time):
        raise InputError(f"--h: must be positive and at most T = {time:g}, given {step:g}")
    if animated is not None and time == 0:
        raise InputError("--animate: needs --at T, the end of the motion")
    spec = config.problem_named(problem)
    subject = spec.load()
    from newmark_cli.report import draw_mechanism, style
    from newmark_cli.study import motion

    count = frames if animated else 2
    places = motion.positions(subject, time, step or time / 2000, count) if time else [subject.u0]
    title = (subject.drawing.title or spec.label) + (f", t = {time:g} s" if time else "")
    if animated is not None:
        click.echo(draw_mechanism.animation(title, subject, places, animated))
        return 0
    stem = folder / "figures" / re.sub(r"[^\w-]+", "-", spec.label.removesuffix(".yaml")).strip("-")
    for file in style.save(draw_mechanism.mechanism_figure(title, subject, places[-1]), stem):
        click.echo(file)
    return 0


@cli.command()
@click.argument("kind", type=click.Choice(["config", "mechanism"]), default="config")
def schema(kind: str) -> int:
    r"""Print the JSON Schema of study configs, or of mechanism files, for editors.

    \b
    Example:
      newmark-study schema > newmark-study.json
    """
    from newmark_cli.study import schema as schemas

    click.echo(schemas.text(kind))
    return 0


@cli.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def list_(as_json: bool) -> int:
    r"""List problems, forms, integrators, variants, configs and figures.

    \b
    Example:
      newmark-study list
    """
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.integrator import INTEGRATORS, parameters
    from newmark_cli.newmark.scaling import VARIANTS
    from newmark_cli.problems.families import FAMILIES
    from newmark_cli.problems.registry import PROBLEMS
    from newmark_cli.report.figures import FIGURES
    from newmark_cli.study import config

    sections: dict[str, Sequence[tuple[str, str]]] = {
        "problems": [(name, "") for name in PROBLEMS],
        "families of problems": [
            (name, f"{family.title}; size: {', '.join(family.parameters)}")
            for name, family in FAMILIES.items()
        ],
        "forms": [
            (f.name, f"unknowns {', '.join(f.unknowns)}; rows {', '.join(f.rows)}")
            for f in FORMS.values()
        ],
        "integrators": [
            (name, f"parameters: {', '.join(parameters(name))}" if parameters(name) else "")
            for name in INTEGRATORS
        ],
        "preconditioning": [
            (name, " and ".join(sides) or "no scaling") for name, sides in VARIANTS.items()
        ],
        "configs": [(name, config.load_shipped(name).description) for name in config.shipped()],
        "figures": [(figure.name, figure.title) for figure in FIGURES.values()],
    }
    if as_json:
        click.echo(_json({title: dict(entries) for title, entries in sections.items()}))
        return 0
    for title, entries in sections.items():
        click.echo(f"{title}:")
        for name, text in entries:
            click.echo(f"  {name:<16} {text}".rstrip())
    return 0


def _run(studies: "Sequence[Study]", folder: Path, how: _How, shard: tuple[int, int] | None) -> int:
    from newmark_cli import terminal
    from newmark_cli.study import runner

    options = runner.Options(
        how.jobs, how.force, how.fail_fast, how.timeout, how.executor, how.scheduler, shard
    )
    with terminal.watching(how.quiet, how.verbose) as watcher:
        runs = runner.run_studies(studies, folder, options, watcher)
    return _tell(runs, folder, how.quiet)


def _tell(runs: "Sequence[StudyRun]", folder: Path, quiet: bool = False) -> int:
    """How studies went, a line each; 1 when a cell did not end well."""
    for done in runs:
        counts = {status: done.statuses.count(status) for status in dict.fromkeys(done.statuses)}
        spelled = ", ".join(f"{count} {status}" for status, count in counts.items())
        kept = f" ({done.kept} kept)" if done.kept else ""
        where = f"-> {done.path}" if done.path else "kept in " + str(folder / "cells")
        if not quiet:
            click.echo(f"{done.study}: {spelled or 'no cells'}{kept} {where}")
    return 0 if all(done.ok for done in runs) else 1


def _dry_run(
    studies: "Sequence[Study]", folder: Path, force: bool, shard: tuple[int, int] | None
) -> int:
    from newmark_cli import terminal
    from newmark_cli.study import runner

    planned = runner.plan(studies, folder, force, shard)
    for one in planned:
        state = f"done, {one.done.outcome.status}" if one.done else f"to run: {one.why}"
        click.echo(f"{studies[one.study].study}: {terminal.described(one.cell)}: {state}")
    left = sum(one.done is None for one in planned)
    click.echo(f"{left} of {len(planned)} cells to run")
    return 0


def _show_claims(slopes: "Sequence[Slope]", show_all: bool = False, markdown: bool = False) -> None:
    from newmark_cli.report import check as checking

    judged = checking.judge(slopes)
    tables = [
        checking.slope_rows(checking.chosen(slopes, show_all)),
        checking.claim_rows(judged),
    ]
    for table in tables:
        if len(table) > 1:
            click.echo((checking.markdown_table if markdown else checking.text_table)(table))
            click.echo()
    if not markdown:
        click.echo(checking.summary(slopes, judged))


def _verdict(found: "Sequence[Slope]") -> int:
    """1 when a slope, a claim or an entry of the tables is not as predicted."""
    from newmark_cli.report import check as checking
    from newmark_cli.report import tables

    if not checking.all_hold(found, checking.judge(found)):
        return 1
    if not any(slope.study == tables.STUDY for slope in found):
        return 0
    missed = tables.missed(tables.build(found))
    for entry in missed:
        click.echo(
            f"Table {entry.table}, {entry.entry}, {entry.form}, {entry.problem}: not as predicted"
        )
    return 1 if missed else 0


def _show_tables(folder: Path, entries: "Sequence[Entry]") -> None:
    from newmark_cli.report import check as checking
    from newmark_cli.report import tables as tabling

    for title, grid in tabling.grids(entries):
        click.echo(f"{title}\n\n{checking.text_table(grid)}\n")
    click.echo(f"{tabling.worst(entries)}\n")
    for file in tabling.write(folder, entries):
        click.echo(file)
    click.echo()


def _forms_and_scalings(
    form: str | None,
    variant: str | None,
    evaluation: str | None,
    file: str | None,
    allow_code: bool,
) -> "list[tuple[str, Preconditioning, str]]":
    """Form, scaling and evaluation that the options of `orders` choose, in their order."""
    from newmark_cli.documents import nearest
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.scaling import PAPER_VARIANTS, Preconditioning

    if file is not None:
        if any(option is not None for option in (form, variant, evaluation)):
            raise click.UsageError("--config already names form, preconditioning and evaluation")
        from newmark_cli.study import config

        cells = config.find(file, allow_code).cells()
        return list(
            dict.fromkeys((cell.form, cell.preconditioning, cell.evaluation) for cell in cells)
        )
    if form is not None and form not in FORMS:
        raise InputError(f"unknown form {form!r}{nearest(form, FORMS)}")
    scalings = [Preconditioning.parse(v) for v in ([variant] if variant else PAPER_VARIANTS)]
    names = [form] if form else FORMS
    return [(name, scaling, evaluation or "direct") for name in names for scaling in scalings]


def _json(value: object) -> str:
    """JSON for programs; NaN and infinity are null."""
    import json

    def plain(part: object) -> object:
        if isinstance(part, dict):
            return {key: plain(item) for key, item in part.items()}
        if isinstance(part, list):
            return [plain(item) for item in part]
        return None if isinstance(part, float) and not math.isfinite(part) else part

    return json.dumps(plain(value), indent=2, ensure_ascii=False)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: exit code 0, 1 (a check or a cell failed) or 2 (bad input)."""
    # Cells run side by side: a BLAS with threads of its own would only be in the way.
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        code = cli.main(arguments, prog_name="newmark-study", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help())
        code = 2
    except click.ClickException as error:
        _complain(error.format_message())
        code = 2
    except InputError as error:
        _complain(str(error))
        code = 2
    except ExecutorError as error:
        _complain(f"{error}; what was finished is kept, run again to go on")
        code = 1
    except OSError as error:
        _complain(f"{error.filename or 'output'}: {error.strerror or error}")
        code = 2
    except (click.Abort, KeyboardInterrupt):
        _complain("interrupted")
        code = 130
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        _complain("no folder for compiled code can be written; set NUMBA_CACHE_DIR to one")
        code = 2
    sys.exit(code)


def _complain(message: str) -> None:
    click.echo(f"newmark-study: {one_line(message)}", err=True)
