"""The command line: parse, delegate, exit code.

Everything heavy is imported inside the commands, so that ``--help`` is quick.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from newmark_cli import __version__
from newmark_cli.errors import InputError

if TYPE_CHECKING:
    from newmark_cli.report.slopes import Slope
    from newmark_cli.study.config import Study
    from newmark_cli.study.runner import StudyRun

_results = click.option(
    "--results",
    "folder",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    metavar="DIR",
    help="Results folder.",
)
_jobs = click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    default=None,
    metavar="N",
    help="Threads; as many as processors when omitted.",
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


@cli.command()
@click.argument("configs", nargs=-1, required=True, metavar="CONFIG...")
@_results
@_jobs
def run(configs: tuple[str, ...], folder: Path, jobs: int | None) -> int:
    r"""Run studies: YAML files, or names of shipped configs.

    Writes DIR/<study>.csv and, beside it, the resolved config, versions and
    wall times as .json.  Exits with 1 when a cell did not end well.

    \b
    Example:
      newmark-study run pendulum-u my-study.yaml --results out
    """
    from newmark_cli.study import config

    return _run([config.find(name) for name in configs], folder, jobs)


@cli.command()
@click.argument("figures", nargs=-1, metavar="[FIGURE...]")
@_results
def plot(figures: tuple[str, ...], folder: Path) -> int:
    r"""Draw figures, all nine by default, from the CSVs in DIR.

    Writes DIR/figures/figure-<n>.png and .svg, and DIR/slopes.csv.

    \b
    Example:
      newmark-study plot 2 8
    """
    from newmark_cli.report import plot as plotting
    from newmark_cli.report import slopes

    wanted = plotting.numbers(figures)
    for file in plotting.plot(folder, wanted):
        click.echo(file)
    slopes.write(folder, slopes.collect(folder))
    return 0


@cli.command()
@_results
@click.option("--all", "show_all", is_flag=True, help="Show every slope, not figures and misses.")
@click.option("--json", "as_json", is_flag=True, help="Print every slope as JSON.")
@click.option("--markdown", is_flag=True, help="Print the table as Markdown.")
def check(folder: Path, show_all: bool, as_json: bool, markdown: bool) -> int:
    r"""Check every fitted slope in DIR against its predicted order.

    Writes DIR/slopes.csv.  Exits with 1 when a slope misses its prediction by
    more than its tolerance, or cannot be fitted.

    \b
    Example:
      newmark-study check --json
    """
    from newmark_cli.report import slopes

    found = slopes.collect(folder)
    slopes.write(folder, found)
    if as_json:
        import json

        rows = [
            {key: None if value != value else value for key, value in slope.row().items()}
            for slope in found
        ]
        click.echo(json.dumps(rows, indent=2, ensure_ascii=False))
    else:
        _show_claims(found, show_all, markdown)
    return _verdict(found)


@cli.command()
@_results
@_jobs
def reproduce(folder: Path, jobs: int | None) -> int:
    r"""Run the paper's studies, draw its nine figures, check every slope.

    Exits with 1 when a slope is not as predicted.

    \b
    Example:
      newmark-study reproduce --results out
    """
    from newmark_cli.study import config

    code = _run([config.find(name) for name in config.REPRODUCED], folder, jobs)

    from newmark_cli.report import plot as plotting
    from newmark_cli.report import slopes

    files = plotting.plot(folder, plotting.numbers(()))
    click.echo(f"{len(files)} files in {folder / 'figures'}")
    found = slopes.collect(folder, config.REPRODUCED)
    slopes.write(folder, found)
    click.echo()
    _show_claims(found)
    return code or _verdict(found)


@cli.command("list")
def list_() -> int:
    r"""List problems, forms, variants, configs and figures.

    \b
    Example:
      newmark-study list
    """
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.scaling import VARIANTS
    from newmark_cli.problems.registry import PROBLEMS
    from newmark_cli.report.figures import FIGURES
    from newmark_cli.study import config

    sections: dict[str, Sequence[tuple[str, str]]] = {
        "problems": [(name, "") for name in PROBLEMS],
        "forms": [
            (f.name, f"unknowns {', '.join(f.unknowns)}; rows {', '.join(f.rows)}")
            for f in FORMS.values()
        ],
        "preconditioning": [
            (name, " and ".join(sides) or "no scaling") for name, sides in VARIANTS.items()
        ],
        "configs": [(name, config.find(name).description) for name in config.shipped()],
        "figures": [(str(figure.number), figure.title) for figure in FIGURES.values()],
    }
    for title, entries in sections.items():
        click.echo(f"{title}:")
        for name, text in entries:
            click.echo(f"  {name:<16} {text}".rstrip())
    return 0


def _run(studies: "Sequence[Study]", folder: Path, jobs: int | None) -> int:
    from newmark_cli.study import runner

    def report(done: "StudyRun") -> None:
        counts = {status: done.statuses.count(status) for status in dict.fromkeys(done.statuses)}
        spelled = ", ".join(f"{count} {status}" for status, count in counts.items())
        click.echo(f"{done.study}: {spelled} -> {done.path}")

    with _progress(runner.total_weight(studies)) as advance:
        runs = runner.run_studies(studies, folder, jobs or os.cpu_count() or 1, advance)
    for done in runs:
        report(done)
    return 0 if all(done.ok for done in runs) else 1


@contextlib.contextmanager
def _progress(steps: int) -> Iterator[Callable[[int], None]]:
    """A bar weighted by steps on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda steps: None
        return
    lock = threading.Lock()
    with click.progressbar(length=steps, label="steps", file=sys.stderr) as bar:

        def advance(steps: int) -> None:
            with lock:
                bar.update(steps)

        yield advance


def _show_claims(slopes: "Sequence[Slope]", show_all: bool = False, markdown: bool = False) -> None:
    from newmark_cli.report import plot as plotting
    from newmark_cli.report.slopes import PASS

    drawn = sorted((s for s in slopes if s.figures), key=lambda s: s.figures)
    rest = [s for s in slopes if not s.figures and (show_all or s.verdict != PASS)]
    table = plotting.claims([*drawn, *rest])
    if len(table) > 1:
        click.echo((plotting.markdown_table if markdown else plotting.text_table)(table))
        click.echo()
    if not markdown:
        click.echo(plotting.summary(slopes))


def _verdict(slopes: "Sequence[Slope]") -> int:
    from newmark_cli.report.slopes import PASS

    return 0 if all(slope.verdict == PASS for slope in slopes) else 1


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
    except (click.Abort, KeyboardInterrupt):
        _complain("interrupted")
        code = 130
    sys.exit(code)


def _complain(message: str) -> None:
    click.echo(f"newmark-study: {' '.join(message.split())}", err=True)
