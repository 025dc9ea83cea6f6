"""The command that writes linear systems for other people's solvers."""

import contextlib
import math
import re
from pathlib import Path
from typing import Any

import click

from newmark_cli.cli import screen
from newmark_cli.cli.completion import complete
from newmark_cli.cli.options import allow_code_option, axis_options, flag


def _steps(context: click.Context, option: click.Parameter, text: str | None) -> tuple[int, ...]:
    if text is None:
        return ()
    parts = [part.strip() for part in text.split(",")]
    if not all(re.fullmatch("[0-9]{1,9}", part) and int(part) > 0 for part in parts):
        raise click.BadParameter(
            f"must be numbers of steps from 1 on, with commas between them, given {text!r}"
        )
    return tuple(sorted({int(part) for part in parts}))


def _sizes(
    context: click.Context, option: click.Parameter, sizes: tuple[float, ...]
) -> tuple[float, ...]:
    for h in sizes:
        if not (math.isfinite(h) and h > 0):
            raise click.BadParameter(f"must be positive, given {h:g}")
    return sizes


@click.command()
@click.argument(
    "subjects",
    nargs=-1,
    required=True,
    metavar="STUDY|PROBLEM...",
    shell_complete=complete("configs", "problems", files=True),
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("systems"),
    show_default=True,
    metavar="DIR",
    help="Folder to write; replaced if all its files come from an export.",
)
@click.option(
    "--steps",
    callback=_steps,
    metavar="LIST",
    help="Steps to export, such as 1,10,100; by default five, evenly spread.",
)
@click.option(
    "--every", type=click.IntRange(1), metavar="K", help="Export every K-th step instead."
)
@click.option(
    "--t-end",
    type=float,
    metavar="T",
    help="End of a problem's march (s); by default 100 steps, or the last of --steps.",
)
@flag(
    "--all-iterations",
    help="Export every Newton iteration; by default the first and last of each step.",
)
@click.option(
    "--h",
    type=float,
    multiple=True,
    callback=_sizes,
    metavar="H",
    help="Step size (s); may be repeated.  By default the study's, or 1e-3, 1e-5 and 1e-7.",
)
@axis_options({
    "form": ("FORM", "Form; may be repeated.  By default the study's, or u-lambda.", "forms"),
    "preconditioning": (
        "VARIANT",
        "Scaling; may be repeated.  By default the study's, or none and optimal.",
        "preconditioning",
    ),
    "integrator": (
        "METHOD",
        "Integrator, such as 'generalized-alpha rho=0.9'; may be repeated.",
        "integrators",
    ),
    "formulation": (
        "FORMULATION",
        "Formulation, such as ggl or 'baumgarte rate_h=1'; may be repeated.",
        "formulations",
    ),
})  # fmt: skip
@click.option(
    "--evaluation",
    type=click.Choice(["direct", "compensated"]),
    multiple=True,
    help="How residuals are evaluated; may be repeated.",
)
@flag("--force", help="Write to DIR even if it holds other files.")
@allow_code_option
def export(
    subjects: tuple[str, ...],
    out: Path,
    steps: tuple[int, ...],
    every: int | None,
    t_end: float | None,
    all_iterations: bool,
    force: bool,
    allow_code: bool,
    **wanted: Any,
) -> int:
    """Export the linear systems of marches as Matrix Market files.

    For every chosen step, writes the Jacobian as the solver sees it, the right-hand
    side and the solution to 60 digits; DIR/index.json describes them, and
    docs/export.md has the format.  If the subject is a study, the options select some
    of its cells.  Repeating an export writes the same bytes.  Exits with 1 if a march
    ends before the last chosen step.

    \b
    Example:
      newmark-study export andrews --h 1e-6 --preconditioning none --out andrews
    """
    if steps and every is not None:
        raise click.UsageError("--steps and --every: give one of them, not both")
    from newmark_cli.cli.terminal import Exporting
    from newmark_cli.study import collection, keys

    choice = collection.Choice(steps, every, all_iterations)
    for name, model in (
        ("integrator", keys.IntegratorConfig), ("formulation", keys.FormulationConfig),
    ):  # fmt: skip
        wanted[name] = [keys.read(f"--{name}", text, model).label for text in wanted[name]]
    cells = [
        cell
        for subject in subjects
        for cell in collection.cells_of(subject, wanted, choice, t_end, allow_code)
    ]
    with contextlib.closing(Exporting()) as watcher:
        done = collection.write(cells, out, choice, force, watcher=watcher)
    marches = "1 march" if done.marches == 1 else f"{done.marches} marches"
    screen.line(f"{done.systems} systems of {marches} -> {out / collection.INDEX}")
    for reason in done.left_out:
        screen.complain(f"warning: {reason}")
    for ended in done.ended:
        screen.complain(ended)
    return 1 if done.ended else 0
