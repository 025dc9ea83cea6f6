"""The command that says what to set in one's own code."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from newmark_cli.cli import screen
from newmark_cli.cli.shared import (
    Declared,
    allow_code_option,
    as_json_text,
    axis_option,
    call_with_problem,
    evaluation_option,
    file_option,
    formulation_option,
    integrator_named,
    json_option,
)
from newmark_cli.support.errors import ArgumentError, InputError


def _numbers(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> tuple[float, ...]:
    try:
        return tuple(float(part) for text in texts for part in text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"must be step sizes such as 1e-3 or 1e-3,1e-4, given {', '.join(texts)}"
        ) from None


def _tolerances(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> float | dict[str, float] | None:
    tolerances = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        if (name or "all") in tolerances:
            raise click.BadParameter(f"{name or 'all unknowns'}: given twice")
        try:
            tolerances[name or "all"] = float(value)
        except ValueError:
            raise click.BadParameter(
                f"must be a number, or such as lambda=1e-8, given {text}"
            ) from None
    return tolerances or None


@click.command()
@click.argument("subject", required=False, metavar="[SUBJECT]")
@file_option(
    "--matrices",
    metavar="PATH",
    help="Instead of SUBJECT: an .npz file or a folder of .mtx files with M, G and more.",
)
@file_option(
    "--jacobian",
    "jacobians",
    multiple=True,
    help="Instead of SUBJECT: an .npz or .mtx file with a Jacobian; one for each h.",
)
@click.option("--blocks", metavar="SIZES", help="Blocks of the Jacobian, such as u=8,lambda=7.")
@click.option(
    "--h",
    "steps",
    multiple=True,
    callback=_numbers,
    metavar="H",
    help="Step size (s), or several with commas; may be repeated.  A study has its own.",
)
@axis_option("form", "FORM", "Form; u-lambda, or that of the study, by default.")
@axis_option(
    "integrator",
    "METHOD",
    "Method and parameters, such as 'generalized-alpha rho=0.9'; trapezoidal by default.",
)
@click.option("--beta", type=float, metavar="BETA", help="Parameter of Newmark's scheme.")
@click.option("--gamma", type=float, metavar="GAMMA", help="Parameter of Newmark's scheme.")
@formulation_option
@evaluation_option
@click.option(
    "--precision",
    type=Declared("newmark.scheme", "PRECISIONS"),
    help="Arithmetic of your code; float64 by default.",
)
@axis_option("scaling", "VARIANT", "Scaling in your code; optimal by default.")
@click.option(
    "--tolerance",
    multiple=True,
    callback=_tolerances,
    metavar="TOL",
    help="Your tolerance on Newton's correction, for all unknowns or such as lambda=1e-8.",
)
@click.option(
    "--tested",
    type=click.Choice(["scaled", "physical"]),
    help="Unknowns that --tolerance applies to; scaled by default.",
)
@click.option(
    "--residual-tolerance", type=float, metavar="TOL", help="Your tolerance on the residual."
)
@click.option(
    "--residual-tested",
    type=click.Choice(["before", "after"]),
    help="Whether --residual-tolerance applies before or after scaling; after by default.",
)
@click.option(
    "--t-end",
    type=float,
    metavar="T",
    help="Length of the motion to look at (s); by default, until it has moved by its size.",
)
@json_option
@allow_code_option
def advise(
    subject: str | None,
    matrices: Path | None,
    jacobians: tuple[Path, ...],
    blocks: str | None,
    steps: tuple[float, ...],
    as_json: bool,
    allow_code: bool,
    **options: Any,
) -> int:
    """Recommend scaling factors and tolerances for your code.

    SUBJECT is a problem, a mechanism file, a member of a family such as
    'chain(links=20)', a Python problem such as mine.py:factory, or a study.  Nothing
    needs to be run first: the command computes condition numbers and predicts
    rounding floors at a few states of the motion, or from matrices of another code.

    \b
    Example:
      newmark-study advise andrews --h 1e-4
    """
    if [subject is None, matrices is None, not jacobians].count(False) != 1:
        raise click.UsageError("give one of SUBJECT, --matrices and --jacobian")
    options = {name: value for name, value in options.items() if value is not None}
    if "integrator" in options:
        options["integrator"] = integrator_named(options["integrator"], allow_code)
    advice: list[Any]
    if jacobians:
        from newmark_cli.advice.jacobians import advise_jacobian

        for name in sorted(options.keys() - {"integrator", "beta", "gamma"}):
            raise click.UsageError(f"--{name.replace('_', '-')} does not go with --jacobian")
        advice = [advise_jacobian([*jacobians], blocks=blocks, h=[*steps] or None, **options)]
    elif blocks is not None:
        raise click.UsageError("--blocks needs --jacobian")
    elif matrices is not None:
        from newmark_cli.advice.advising import advise as advised
        from newmark_cli.advice.linearised import is_path_of_matrices

        if not is_path_of_matrices(matrices):
            raise InputError(f"{matrices}: must be an .npz file or a folder of .mtx files")
        advice = [advised(matrices, h=_required(steps), **options)]
    else:
        advice = list(_of_subject(str(subject), steps, options, allow_code))
    if as_json:
        plain = [entry.to_dict() for entry in advice]
        screen.lines(as_json_text(plain if len(plain) > 1 else plain[0]))
    else:
        screen.lines("\n\n\n".join(map(str, advice)))
    return 0


def _required(steps: tuple[float, ...]) -> list[float]:
    if not steps:
        raise click.UsageError("--h: give a step size (s), such as --h 1e-4")
    return [*steps]


def _of_subject(
    subject: str, steps: tuple[float, ...], options: dict[str, Any], allow_code: bool
) -> Iterator[Any]:
    """Advice on a problem, or for all schemes of a study."""
    from newmark_cli.study import config, naming

    if not naming.is_study(subject):
        options = {**options, "h": _required(steps)}
        spec = naming.problem_named(subject, allow_code)
        yield call_with_problem(spec, _advised, spec.label, options)
        return
    chosen: dict[tuple[Any, ...], set[float]] = {}
    names = ("problem", "form", "integrator", "formulation", "evaluation")
    for cell in config.find(subject, allow_code).cells():
        key = tuple(options.get(name, getattr(cell, name)) for name in names)
        chosen.setdefault(key, set()).add(cell.h)
    for (spec, *values), sizes in chosen.items():
        how = {**options, **dict(zip(names[1:], values, strict=True))}
        how["h"] = [*(steps or sorted(sizes, reverse=True))]
        yield call_with_problem(spec, _advised, spec.label, how)


def _advised(problem: Any, label: str, options: dict[str, Any]) -> Any:
    """Advice on a problem; errors name it."""
    from newmark_cli.advice.advising import advise as advised

    try:
        return advised(problem, **options)
    except ArgumentError as error:
        named = str(error).startswith(f"{label}: ")
        raise InputError(str(error) if named else f"{label}: {error}") from None
