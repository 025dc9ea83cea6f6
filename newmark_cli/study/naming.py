"""What a command line names: a study, or a problem."""

import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from newmark_cli.mechanisms import loading, registry, tables_beside
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.spec import ForcedMechanism, ProblemSpec, with_ending
from newmark_cli.problems.problem import Problem
from newmark_cli.study import shipped
from newmark_cli.study.config import parse, warn_of
from newmark_cli.study.subjects import Surroundings, problem_of
from newmark_cli.support import documents
from newmark_cli.support.documents import Document, StrictModel
from newmark_cli.support.errors import InputError, warn
from newmark_cli.support.spelling import degrees_of_freedom, nearest


def is_study(subject: str) -> bool:
    """Whether it is the name or file of a study rather than of a problem; refuses anything else."""
    known = (*shipped.names(), *registry.PROBLEMS, *FAMILIES)
    if subject in known:
        return subject in shipped.names()
    name = with_ending(subject)
    if Path(name).suffix in (".yaml", ".yml"):
        return not loading.is_mechanism(documents.read(Path(name), name).data)
    if not (subject.endswith(")") or subject.rpartition(":")[0].endswith(".py")):
        near = nearest(subject, known)
        raise InputError(f"{subject}: no study and no problem of this name{near}")
    return False


def problem_named(text: str, allow_code: bool = False) -> ProblemSpec:
    """Problem that a command line names: shipped, a mechanism file, a label, or code."""
    if os.path.isfile(name := with_ending(text)) and name.endswith((".yaml", ".yml")):
        loading.require_mechanism(documents.read(Path(name), name))
    document = Document.of(documents.GIVEN, {"problem": text})
    around = Surroundings(allow_code=allow_code)
    try:
        spec: ProblemSpec = documents.validate(document, _OneProblem, context=around).problem
    except documents.DocumentError as error:
        # Nobody gave a key: the rest says what is wrong, and in which file.
        text = str(error).removeprefix(f"{documents.GIVEN}: problem: ")
        raise documents.DocumentError(text) from error
    warn_of(spec)
    return spec


class _OneProblem(StrictModel):
    problem: Annotated[Any, BeforeValidator(problem_of)]


def describe(name: str, allow_code: bool) -> list[str]:
    """Contents of a valid config or mechanism, in a line or a few."""
    if name in shipped.names():
        path = shipped.folder() / f"{name}.yaml"
    elif name in registry.PROBLEMS:
        path = registry.file(name)
    else:
        path = Path(with_ending(name))
        if path.suffix not in (".yaml", ".yml") and not path.exists() and not is_study(name):
            return _summary(name, problem_named(name, allow_code).load())
        name = str(path)
    file = tables_beside.fetch(path, name)
    document = file.document()
    if loading.is_mechanism(document.data):
        if allow_code and loading.has_code(document.data):
            problem = ForcedMechanism(file, path.absolute()).load()
        else:
            problem = loading.loaded(file, name)
        warn(*problem.doubts)
        from newmark_cli.mechanisms import guess

        return _summary(name, problem) + guess.assembled(problem)
    study = parse(document, Surroundings(path.parent, allow_code))
    return [f"{name}: study {study.study}, {study.count} cells"]


def _summary(name: str, problem: Problem) -> list[str]:
    if problem.drawing is not None and len(problem.axes) == 3:
        from newmark_cli.mechanisms import spatial_summary

        return spatial_summary.lines(name, problem)
    kind = "problem in Python" if problem.drawing is None else "mechanism"
    free = degrees_of_freedom(problem.n - problem.m)
    return [f"{name}: {kind}, {problem.n} coordinates, {problem.m} constraints, {free}"]
