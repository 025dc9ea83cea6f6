"""Options and words that several commands share; nothing heavy is imported."""

import functools
import math
import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from newmark_cli.support.errors import InputError, visible_lines
from newmark_cli.support.processors import usable
from newmark_cli.support.spelling import nearest

#: An option that is on or off.
flag = functools.partial(click.option, is_flag=True)
#: An option that names a file.
file_option = functools.partial(click.option, type=click.Path(path_type=Path), metavar="FILE")


class Declared(click.Choice[str]):
    """Names that a module declares; it is imported when they are asked for."""

    def __init__(self, module: str, names: str) -> None:
        """Take the module, within the package, and its attribute; nothing is imported yet."""
        self.case_sensitive = True
        self._declared = f"newmark_cli.{module}", names

    @functools.cached_property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """The names."""
        module, names = self._declared
        return tuple(getattr(import_module(module), names))


class Number(click.FloatRange):
    """A finite number in a range; that of click has room for nan."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """The number; `click.BadParameter` is raised for others."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


def _folder(context: click.Context, option: click.Parameter, folder: Path) -> Path:
    if folder == Path():
        raise click.BadParameter("must name a folder other than the current one")
    if folder.exists() and not folder.is_dir():
        raise click.BadParameter(f"must name a folder, and {str(folder)!r} is a file")
    return folder


results_folder = click.option(
    "--results",
    "folder",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    callback=_folder,
    metavar="DIR",
    help="Results folder.",
)

studies_argument = click.argument("studies", nargs=-1, metavar="[STUDY...]")

allow_code_option = flag(
    "--allow-code", help="Allow problems in Python; loading one runs its code."
)


def axis_option(
    name: str, metavar: str, text: str, multiple: bool = False
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """An option for values of an axis of studies.

    Args:
        name: Of the option; ``preconditioning`` and ``scaling`` are the same one.
    """
    same = ("preconditioning", "scaling")
    return click.option(
        *(f"--{alias}" for alias in (same if name in same else (name,))), name, multiple=multiple,
        metavar=metavar, help=text,
    )  # fmt: skip


evaluation_option = click.option(
    "--evaluation",
    type=Declared("newmark.scheme", "EVALUATIONS"),
    help="How residuals are evaluated; direct by default.",
)

formulation_option = axis_option(
    "formulation",
    "FORMULATION",
    "Formulation, such as ggl or 'baumgarte rate_h=1'; index-3 by default.",
)


def choosing_options(command: Callable[..., int]) -> Callable[..., int]:
    """Options of the commands that choose among the series of studies; each may be repeated."""
    for name, metavar, text in (
        ("integrator", "I", "Integrator, with or without its parameters"),
        ("preconditioning", "V", "Scaling"),
        ("problem", "P", "Problem"),
        ("form", "F", "Form"),
        ("quantity", "Q", "Quantity, such as u or lambda"),
        ("measure", "M", "Measure, such as correction; for `plot` also work-precision"),
        ("code", "C", "What has computed: newmark-study, or the name of another code"),
    ):
        option = axis_option(name, metavar, f"{text}; may be repeated.", multiple=True)
        command = option(command)
    return command


def _formats(context: click.Context, option: click.Parameter, text: str) -> tuple[str, ...]:
    allowed = ("png", "svg", "pdf")
    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    for name in formats:
        if name not in allowed:
            raise click.BadParameter(f"unknown format {name!r}{nearest(name, allowed)}")
    return formats


def _size(
    context: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, float | None] | None:
    if text is None:
        return None
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)(?:x(\d+\.?\d*|\.\d+))?", text.strip().lower())
    sides = [float(side) for side in match.groups() if side] if match else []
    if not sides or not all(1 <= side <= 40 for side in sides):
        raise click.BadParameter(
            "must be a width, or a width and a height, from 1 to 40 inches, such as 3.3 or "
            f"3.3x2.4, given {text!r}"
        )
    return sides[0], sides[1] if len(sides) > 1 else None


formats_option = click.option(
    "--format",
    "formats",
    default="png",
    show_default=True,
    callback=_formats,
    metavar="LIST",
    help="File formats, separated by commas: png, svg, pdf.",
)

size_option = click.option(
    "--size",
    callback=_size,
    metavar="W[xH]",
    help="Width of each figure in inches, or width and height.",
)

style_option = file_option(
    "--style", "style_file", help="Matplotlib style file, applied on top of the project's style."
)


def running_options(command: Callable[..., int]) -> Callable[..., int]:
    """Options of the commands that run studies, gathered into `runner.Options`, ``how``."""

    @functools.wraps(command)
    def gathered(**given: Any) -> int:
        from newmark_cli.running.runner import Options

        names = ("jobs", "force", "fail_fast", "timeout", "executor", "scheduler")
        how = Options(**{name: given.pop(name) for name in names})
        if how.scheduler is not None and how.executor != "dask":
            raise click.UsageError("--scheduler needs --executor dask")
        return command(how=how, **given)

    for option in reversed(
        (
            click.option(
                "--jobs",
                type=click.IntRange(1, 1024),
                default=usable,
                metavar="N",
                help="Number of cells that run side by side; one per processor by default.",
            ),
            flag("--force", help="Recompute cached cells and references."),
            click.option(
                "--fail-fast/--keep-going",
                help="Stop at the first cell that fails, or run all others (default).",
            ),
            click.option(
                "--timeout",
                type=Number(0, 1e9, min_open=True),
                metavar="SECONDS",
                help="Time limit per cell, and for loading problems in Python; a cell that exceeds "
                "it fails.",
            ),
            click.option(
                "--executor",
                type=click.Choice(["local", "dask"]),
                default="local",
                show_default=True,
                help="Run cells on this machine, or on the workers of a dask scheduler.",
            ),
            click.option(
                "--scheduler",
                metavar="ADDRESS",
                help="Address of a dask scheduler; by default, workers start on this machine.",
            ),
            flag("-q", "--quiet", help="Print errors only."),
            flag("-v", "--verbose", help="Print a line for every cell."),
        )
    ):
        gathered = option(gathered)
    return gathered


json_option = flag("--json", "as_json", help="Print as JSON.")


def as_json_text(value: object) -> str:
    """JSON for programs; NaN and infinity are null, what no terminal prints is escaped."""
    import json

    from newmark_cli.support.arrays import plain

    # Other encodings lack something.
    encoding = str(getattr(sys.stdout, "encoding", "")).lower().replace("-", "")
    text = json.dumps(plain(value), indent=2, ensure_ascii=encoding != "utf8")
    # Only strings have such characters: JSON's own line ends are line feeds.
    hidden = {c for c in text if visible_lines(c) != c}
    return text.translate({ord(c): json.dumps(c)[1:-1] for c in hidden})


def integrator_named(text: str, allow_code: bool) -> Any:
    """The integrator that ``--integrator`` names, which may be code if that is allowed."""
    from newmark_cli.library.scalings import of_label
    from newmark_cli.study import keys
    from newmark_cli.study.subjects import Surroundings

    around = Surroundings(allow_code=allow_code)
    return of_label(text) or keys.read("--integrator", text, keys.IntegratorConfig, around)


def call_with_problem(spec: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of a problem as `with_problem` does.

    Raises:
        InputError: When the process of user code does not come back, or what the function raises.
    """
    from newmark_cli.mechanisms.spec import with_problem
    from newmark_cli.support.apart import ApartError

    try:
        return with_problem(spec, function, *arguments)
    except ApartError as error:
        raise InputError(f"{spec.named}: {error}") from None
