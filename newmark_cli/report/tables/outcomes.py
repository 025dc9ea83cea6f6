"""All that `check` asserts, one by one: for its exit code, and for continuous integration."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from newmark_cli.report.judging.expectations import Expected, series_name
from newmark_cli.report.judging.fits import format_fit
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.verdicts import FAILING, INCOMPLETE, PASS, SHOWN, UNDECIDED, joined
from newmark_cli.report.reading.records import Changed
from newmark_cli.report.tables import study_tables
from newmark_cli.report.tables.check import counting, format_prediction
from newmark_cli.support.errors import visible

#: Annotations of each kind that GitHub shows of one step.
_SHOWN_BY_GITHUB = 10
#: What must be decided, or a check fails: nothing, what configs expect, everything.
LENIENT, EXPECTATIONS, ALL = "", "expectations", "all"


@dataclass(frozen=True)
class Outcome:
    """Something that is asserted, and what it comes to."""

    study: str  #: name of the study
    name: str  #: what is asserted
    verdict: str  #: one of the words of `newmark_cli.report.judging.verdicts`
    text: str  #: what was found, and why it is not a plain pass
    #: Where a config asserts it; empty and 0 where that is not known.
    file: str = ""
    line: int = 0
    expected: bool = False  #: whether it is a claim or an expectation, not a prediction of theory
    erroneous: bool = False  #: whether there is no such series
    shown: bool = True  #: whether the tables of `check` show it

    def fails(self, strict: str) -> bool:
        """Whether `check` fails with it: `ALL` and `EXPECTATIONS` say what must be decided."""
        counts = strict == ALL or (strict == EXPECTATIONS and self.expected)
        return self.verdict in FAILING or (counts and self.verdict == UNDECIDED)

    @property
    def description(self) -> str:
        """Verdict and text."""
        return f"{self.verdict}: {self.text}" if self.text else self.verdict


def of(
    slopes: Sequence[Slope],
    expected: Iterable[Expected] = (),
    changed: Iterable[Changed] = (),
    tables: bool = False,
) -> list[Outcome]:
    """All that is asserted, a study's expectations first.

    Series of which theory predicts no order assert nothing, nor do those that end as the
    study accepts.  With ``tables``, entries of Tables 1 and 2 do, too, where all else holds.
    """
    outcomes = list(map(_of_expected, expected))
    for slope in counting(slopes):
        if slope.verdict != SHOWN:
            predicted = format_prediction(slope)
            fitted = f"slope {format_fit(slope.fit)}" if slope.fit.points else ""
            text = joined(fitted, f"predicted {predicted}" if predicted else "", slope.reason)
            outcomes.append(Outcome(slope.study, series_name(slope), slope.verdict, text))
    outcomes += (Outcome(f.path.stem, str(f.path), INCOMPLETE, f.finding) for f in changed)
    if (
        tables
        and hold(outcomes)
        and any(slope.study == study_tables.PAPER and slope.shipped for slope in slopes)
    ):
        for name, slope in study_tables.not_as_predicted(slopes):
            text = "not as predicted"
            outcomes.append(Outcome(study_tables.PAPER, name, slope.verdict, text, shown=False))
    return outcomes


def _of_expected(entry: Expected) -> Outcome:
    if entry.figure:
        name, measured = f"{entry.name}, {entry.text}", joined(entry.measured, entry.reason)
        return Outcome(entry.study, name, entry.verdict, measured, entry.file, entry.line, True)
    name = entry.name if entry.missing else f"{entry.name}, {entry.label}, {entry.said}"
    measured = f"measured {entry.measured}" if entry.measured else ""
    return Outcome(
        entry.study, name, entry.verdict, joined(measured, entry.reason), entry.file, entry.line,
        expected=True, erroneous=entry.missing, shown=not entry.missing,
    )  # fmt: skip


def hold(outcomes: Sequence[Outcome], strict: str = LENIENT) -> bool:
    """Whether something was judged, and nothing fails."""
    return any(outcome.verdict == PASS for outcome in outcomes) and not any(
        outcome.fails(strict) for outcome in outcomes
    )


def notes(outcomes: Sequence[Outcome], strict: str) -> list[str]:
    """What the tables of `check` do not say: a line for each that they lack, and a warning."""
    lines = [f"{o.study}: {o.name}: {o.text}" for o in outcomes if not o.shown]
    if undecided := [outcome for outcome in outcomes if outcome.verdict == UNDECIDED]:
        warning = "" if any(outcome.fails(strict) for outcome in undecided) else "warning: "
        lines.append(f"{warning}not judged: {len(undecided)} {UNDECIDED}")
    return lines


# -- continuous integration ---------------------------------------------------------------------


def junit(outcomes: Iterable[Outcome], strict: str) -> str:
    """A report in JUnit's XML: a suite for each study.  What is undecided is skipped or fails."""
    of_study: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        of_study.setdefault(outcome.study, []).append(outcome)
    root = ElementTree.Element("testsuites", name="newmark-study check")
    for study, cases in of_study.items():
        suite = ElementTree.SubElement(root, "testsuite", name=visible(study))
        for outcome in cases:
            _case(suite, outcome, strict)
        _count(suite)
    _count(root)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _case(suite: ElementTree.Element, outcome: Outcome, strict: str) -> None:
    place = {"file": visible(outcome.file), "line": str(outcome.line)} if outcome.line else {}
    names = {"classname": visible(outcome.study), "name": visible(outcome.name)}
    case = ElementTree.SubElement(suite, "testcase", {**names, **place})
    if outcome.verdict == PASS:
        return
    kind = "skipped"
    if outcome.fails(strict):
        kind = "error" if outcome.erroneous else "failure"
    ElementTree.SubElement(case, kind, message=visible(outcome.description), type=outcome.verdict)


def _count(element: ElementTree.Element) -> None:
    """Write the numbers of test cases, and of failures, into an element."""
    element.set("tests", str(len([*element.iter("testcase")])))
    for kind, plural in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        element.set(plural, str(len([*element.iter(kind)])))


def annotations(outcomes: Iterable[Outcome], strict: str, top: Path | None = None) -> list[str]:
    """Workflow commands of GitHub, of each kind as many as it shows; files are named from `top`.

    What fails are errors, and what else is undecided warnings.
    """
    lines: dict[str, list[str]] = {"error": [], "warning": []}
    for outcome in outcomes:
        if outcome.fails(strict) or outcome.verdict == UNDECIDED:
            kind = "error" if outcome.fails(strict) else "warning"
            place = {**_place(outcome, top), "title": f"{outcome.study}: {outcome.verdict}"}
            properties = ",".join(f"{key}={_escaped(text, ':,')}" for key, text in place.items())
            message = _escaped(joined(outcome.name, outcome.text))
            lines[kind].append(f"::{kind} {properties}::{message}")
    return [line for kind_lines in lines.values() for line in kind_lines[:_SHOWN_BY_GITHUB]]


def _place(outcome: Outcome, top: Path | None) -> dict[str, str]:
    """File and line, if the file exists inside the repository."""
    path = Path(outcome.file)
    try:
        inside = path.resolve().relative_to((top or Path()).resolve())
        known = bool(outcome.line) and path.is_file()
    except (OSError, ValueError):
        return {}
    return {"file": inside.as_posix(), "line": str(outcome.line)} if known else {}


def _escaped(text: str, further: str = "") -> str:
    """Text escaped for a workflow command or one of its properties."""
    for character in "%\r\n" + further:
        text = text.replace(character, f"%{ord(character):02X}")
    return visible(text)
