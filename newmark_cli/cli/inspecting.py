"""Commands that look at problems, configs and theory; nothing is run."""

import math
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from newmark_cli.cli import screen
from newmark_cli.cli.shared import (
    Declared,
    Number,
    allow_code_option,
    as_json_text,
    axis_option,
    call_with_problem,
    evaluation_option,
    file_option,
    flag,
    formats_option,
    formulation_option,
    integrator_named,
    json_option,
    results_folder,
    size_option,
    style_option,
)
from newmark_cli.support.errors import InputError

if TYPE_CHECKING:
    from newmark_cli.library.testset import Member
    from newmark_cli.newmark.scaling import Preconditioning


@click.command()
@axis_option("form", "FORM", "One form; all seven by default.")
@axis_option("preconditioning", "VARIANT", "One scaling; the paper's four by default.")
@evaluation_option
@formulation_option
@click.option(
    "--config",
    "file",
    metavar="CONFIG",
    help="Use the forms, scalings and formulations of a config.",
)
@flag("--derive", help="Derive the optimal scaling from the orders.")
@json_option
@allow_code_option
def orders(
    form: str | None,
    preconditioning: str | None,
    evaluation: str | None,
    formulation: str | None,
    file: str | None,
    derive: bool,
    as_json: bool,
    allow_code: bool,
) -> int:
    """Predict orders in h: of J, its inverse, corrections and C.

    Prints tables as in Sections 3 and 4 of the paper; C is the condition number.  With
    --derive, finds the smallest powers of h that make every block O(1) and compares
    them with Table 2.

    \b
    Example:
      newmark-study orders --form u-lambda --preconditioning optimal
    """
    from newmark_cli.report.tables import theory

    options = form, preconditioning, evaluation, formulation
    chosen = _chosen_orders(options, file, allow_code)
    if derive:
        forms = dict.fromkeys((name, kind) for name, _, _, kind in chosen)
        predicted = [theory.derive(*arguments) for arguments in forms]
        texts = [theory.derived_as_text(entry) for entry in predicted]
    else:
        predicted = [theory.predict(*arguments) for arguments in chosen]
        texts = [theory.as_text(entry) + "\n" for entry in predicted]
    screen.lines(as_json_text(predicted) if as_json else "\n".join(texts))
    return 0


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@json_option
@allow_code_option
def validate(files: tuple[str, ...], as_json: bool, allow_code: bool) -> int:
    """Check configs and mechanism files without running them.

    FILE may also be a shipped study, or a problem by name, such as 'chain(links=20)', and
    may lack its .yaml.  Prints one line for each valid file and one for each mistake in the
    others.  The line of a mechanism has its degrees of freedom; for a spatial one, further
    lines have redundant constraints and the inertia of each body.  Warns of sizes that are
    probably mistakes.  Exits with 2 if a file is not valid.

    \b
    Example:
      newmark-study validate my-study.yaml my-mechanism.yaml
    """
    from newmark_cli.study import naming
    from newmark_cli.support.documents import DocumentError

    checked = []
    for name in files:
        lines, mistakes = list[str](), list[str]()
        try:
            lines = naming.describe(name, allow_code)
        except DocumentError as error:
            mistakes = [mistake.text for mistake in error.mistakes]
            if error.more or error.stopped:
                least = "at least " * error.stopped
                count = f"{least}{error.more}" if error.more else "possibly"
                mistakes.append(f"{name}: … and {count} more")
        except InputError as error:
            mistakes = [str(error)]
        checked.append({"file": name, "description": lines, "mistakes": mistakes})
        if not as_json:
            for line in lines:
                screen.line(line)
            for mistake in mistakes:
                screen.complain(mistake)
    if as_json:
        screen.lines(as_json_text(checked))
    return 2 if any(entry["mistakes"] for entry in checked) else 0


#: Places on a path.
_ON_PATH = 801


@click.command()
@click.argument("problem", metavar="PROBLEM")
@results_folder
@click.option(
    "--at",
    "time",
    type=Number(0),
    default=0.0,
    metavar="T",
    help="Draw the mechanism at time T (s).",
)
@click.option(
    "--h",
    "step",
    type=Number(0, min_open=True),
    metavar="H",
    help="Step size (s); by default halved until nothing visible changes.",
)
@click.option(
    "--integrator",
    "method",
    default="generalized-alpha rho=0.9",
    show_default=True,
    metavar="METHOD",
    help="Method and parameters, such as 'newmark beta=0.25 gamma=0.5'.",
)
@file_option(
    "--animate",
    "animated",
    metavar="FILE.gif",
    help="Write the motion from 0 to T as a looping GIF.",
)
@click.option(
    "--frames",
    type=click.IntRange(2, 1000),
    default=60,
    show_default=True,
    metavar="N",
    help="Number of frames of --animate.",
)
@click.option(
    "--path",
    "points",
    multiple=True,
    metavar="P",
    help="Draw the path of point P from the start to --until; may be repeated.",
)
@click.option("--until", type=Number(0, min_open=True), metavar="T", help="Where paths end (s).")
@formats_option
@size_option
@style_option
@allow_code_option
def draw(
    problem: str,
    folder: Path,
    time: float,
    step: float | None,
    method: str,
    animated: Path | None,
    frames: int,
    points: tuple[str, ...],
    until: float | None,
    formats: tuple[str, ...],
    size: tuple[float, float | None] | None,
    style_file: Path | None,
    allow_code: bool,
) -> int:
    """Draw a mechanism, at its start or after a motion.

    PROBLEM is a shipped problem, a mechanism file, or a member of a family such as
    'chain(links=20)'.  Writes DIR/figures/<problem>.png, with --at T
    <problem>-at-<T>.png, with --path P <problem>-path-<P>.png: the mechanism at its start
    and the path of a point over the motion to --until T.  The motion is computed with
    numerical damping and compared with a coarser one; a warning is printed if they
    differ visibly.

    \b
    Example:
      newmark-study draw andrews --at 0.01
    """
    from newmark_cli.study import naming

    if bool(points) != (until is not None):
        raise InputError("--path: needs --until T" if points else "--until: needs --path P")
    if points and (time or animated):
        raise InputError("--path: is drawn with the mechanism at its start, without --at")
    time = until or time
    if step is not None and step > time:
        raise InputError(f"--h: must be at most T = {time:g}, given {step:g}")
    if animated is not None and animated.suffix.lower() != ".gif":
        raise InputError(f"--animate: must be a file that ends in .gif, given {animated}")
    if animated is not None and time == 0:
        raise InputError("--animate: needs --at T, the end of the motion")
    from newmark_cli.report.drawing import draw as drawing
    from newmark_cli.report.drawing import draw_mechanism, style

    spec = naming.problem_named(problem, allow_code)
    integrator = integrator_named(method, allow_code)
    shown = frames if animated else _ON_PATH if points else 2
    subject, places = _moved(spec, points, time, shown, step, integrator)
    title = subject.drawing.title or spec.label
    if animated is not None:
        step = time / (frames - 1)
        digits = max(0, -math.floor(math.log10(step)))  # those that differ from frame to frame
        titles = [f"{title}, t = {part * step:.{digits}f} s" for part in range(frames)]
        screen.line(draw_mechanism.animation(titles, subject, places, animated))
        return 0
    ways = draw_mechanism.paths(subject, points, places)
    title += f", {'to ' * bool(points)}t = {time:g} s" if time else ""
    shape = draw_mechanism.mechanism_sheet(title, subject, places[0 if points else -1], ways)
    name = _drawing_name(spec.label, points, time)
    with style.of_file(style_file) as settings:
        figure = drawing.drawn(shape, size, settings)
        drawn = {f"{name}.{kind}": style.rendered(figure, kind, settings) for kind in formats}
    for file in style.save(drawn, folder):
        screen.line(file)
    return 0


def _moved(
    spec: Any, points: Sequence[str], time: float, shown: int, step: float | None, integrator: Any
) -> tuple[Any, list[Any]]:
    """A mechanism, and so many of its positions (n,) from the start to a time, if it moves."""
    from newmark_cli.problems.problem import is_beyond
    from newmark_cli.report.drawing import draw_mechanism
    from newmark_cli.study import motion

    subject = spec.load()
    if subject.drawing is None:
        raise InputError(
            f"{spec.label}: a problem in Python has no points to draw; draw shows mechanisms"
        )
    if is_beyond(subject.until, time):
        raise InputError(
            f"--{'until' if points else 'at'}: must be at most {subject.until:g} s, where a table "
            f"of {spec.label} ends, given {time:g} s"
        )
    draw_mechanism.paths(subject, points, [subject.u0])  # refuses unknown points at once
    if not time:
        return subject, [subject.u0]
    moved = call_with_problem(spec, motion.motion, time, shown, step, integrator)
    if moved.doubt:
        advice = "" if step is None else "; try a smaller --h"
        screen.complain(f"warning: {spec.label} at t = {time:g}: {moved.doubt}{advice}")
    return subject, list(moved.positions)


def _drawing_name(label: str, points: Sequence[str], time: float) -> str:
    """The name of a drawing's files, without their ending."""
    parts = [label.removesuffix(".yaml"), *(("path", *points) if points else ())]
    name = re.sub(r"[^\w-]+", "-", "-".join(parts)).strip("-") or "mechanism"
    return f"{name}-at-{time:g}" if time and not points else name


#: What the entries of a section of `list` mean.
_EXPLAINED = {
    "problems": "n coordinates, m constraints",
    "forms": "rows: D dynamics, V and K updates of v and u, C constraints",
}


@click.command("list")
@flag("--problems", help="List the shipped problems: what they test, sources, reference errors.")
@click.option(
    "--testset",
    "folder",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write the test set into DIR, for codes in any language.",
)
@json_option
@click.option(
    "--schema",
    type=Declared("study.schema", "SCHEMAS"),
    help="Print the JSON Schema of configs, or of mechanism files in the plane or in space.",
)
def list_(problems: bool, folder: Path | None, as_json: bool, schema: str | None) -> int:
    """List everything that a config can name, and the figures.

    Lists problems, forms, integrators, scalings, measures, shipped studies and
    figures, with one line of description each.  With a JSON Schema, which lists all
    keys, editors complete and check files.  --testset writes the mechanisms of the test set
    as YAML and JSON, with reference values and templates as CSV, and names the files.

    \b
    Example:
      newmark-study list --schema config > newmark-study.json
      newmark-study list --testset testset
    """
    if sum((problems, folder is not None, schema is not None)) > 1:
        raise click.UsageError("give one of --problems, --testset and --schema")
    from newmark_cli.mechanisms import registry
    from newmark_cli.report.reading.figures import FIGURES
    from newmark_cli.study import catalogue
    from newmark_cli.study import schema as schemas

    data: Any
    if schema is not None:
        screen.lines(schemas.text(schema))
        return 0
    if problems or folder is not None:
        from newmark_cli.library import testset  # heavier than the rest

    if problems:
        data = [testset.member(name) for name in registry.PROBLEMS]
        text = _problems_text(data)
    elif folder is not None:
        data = [str(file) for file in testset.write(folder)]
        text = "\n".join(data)
    else:
        data = catalogue.sections()
        data["figures"] = {figure.name: figure.title for figure in FIGURES.values()}
        text = _sections_text(data)
    screen.lines(as_json_text(data) if as_json else text)
    return 0


def _sections_text(sections: Mapping[str, Mapping[str, str]]) -> str:
    """Sections of the list; in a pipe an entry stays a line, for grep."""
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    width = max(len(name) for entries in sections.values() for name in entries)
    lines = []
    for title, entries in sections.items():
        lines.append(f"{title} ({_EXPLAINED[title]}):" if title in _EXPLAINED else f"{title}:")
        for name, text in entries.items():
            begin = f"  {name:<{width}} "
            lines.append(click.wrap_text(text, columns, begin, " " * len(begin)).rstrip())
    return "\n".join(lines)


def _problems_text(members: "Sequence[Member]") -> str:
    """What is known of the shipped problems."""
    from newmark_cli.library.testset import PARTS
    from newmark_cli.report.judging.text import text_table, wrapped

    rows: list[tuple[str, ...]] = [("problem", "DOF", "n", "m", "t_end", "error u", "v", "λ")]
    for one in members:
        t_end = "" if one["t_end"] is None else f"{one['t_end']:g}"
        errors = [f"{one['errors'][part]:.0e}" if one["errors"] else "" for part in PARTS]
        sizes = (str(size) for size in (one["degrees_of_freedom"], one["n"], one["m"]))
        rows.append((one["name"], *sizes, t_end, *errors))
    head, rule, *lines = text_table(rows).splitlines()
    told = [head, rule]
    for one, line in zip(members, lines, strict=True):
        about = wrapped(f"{one['tests'] or one['description']}; {one['source']}", 4)
        told += [line.rstrip(), about]
    return "\n".join(told)


def _chosen_orders(
    chosen: Sequence[str | None], file: str | None, allow_code: bool
) -> "list[tuple[str, Preconditioning, str, str]]":
    """Form, scaling, evaluation and formulation chosen by the options of `orders`."""
    from newmark_cli.library.arguments import one_of
    from newmark_cli.newmark.forms import FORMS, INDEX_3
    from newmark_cli.newmark.scaling import PAPER_VARIANTS, Preconditioning
    from newmark_cli.study import config, keys

    if file is not None:
        if any(option is not None for option in chosen):
            raise click.UsageError(
                "--config already names form, preconditioning, evaluation and formulation"
            )
        cells = config.find(file, allow_code).cells()
        chosen_by_cells = (
            (cell.form, cell.preconditioning, cell.evaluation, cell.formulation.label)
            for cell in cells
        )
        return list(dict.fromkeys(chosen_by_cells))
    form, variant, evaluation, formulation = chosen
    scalings = [Preconditioning.parse(v) for v in ([variant] if variant else PAPER_VARIANTS)]
    names = FORMS if form is None else [one_of("form", form, FORMS)]
    label = keys.read("--formulation", formulation or INDEX_3, keys.FormulationConfig).label
    return [
        (name, scaling, evaluation or "direct", label) for name in names for scaling in scalings
    ]
