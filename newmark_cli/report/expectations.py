"""Expectations of a study's config, judged: the orders and levels that its author asserts.

They stand in the record next to the CSV, so that a results folder can be checked without the
config.  An order is judged by the rule of `newmark_cli.report.verdicts`, as a predicted one is.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from newmark_cli.errors import ResultsError
from newmark_cli.report import records
from newmark_cli.report.check import format_orders, gathered
from newmark_cli.report.claims import BoundClaim, SlopeClaim, evaluate
from newmark_cli.report.curves import Curve
from newmark_cli.report.fits import format_fit
from newmark_cli.report.slopes import Slope
from newmark_cli.report.traces import quantity
from newmark_cli.report.verdicts import INCOMPLETE, PASS, SHOWN, UNDECIDED, joined
from newmark_cli.study.expectations import Expectation, expectations


@dataclass(frozen=True)
class Expected:
    """What an expectation comes to for one series, or that it matches none.

    Attributes:
        study: Name of the study.
        expectation: The expectation.
        slope: The series; None where it matches none.
        said: What is expected of it.
        measured: As text.
        value: As a number; NaN where there is none.
        verdict: One of the words of `newmark_cli.report.verdicts`.
        reason: Why it is not a plain pass; may be empty.
        file, line: Where the config has it; empty and 0 where that is not known.
    """

    study: str
    expectation: Expectation
    slope: Slope | None
    said: str
    measured: str
    value: float
    verdict: str
    reason: str
    file: str
    line: int

    @property
    def series(self) -> str:
        """The series in words."""
        return series_name(self.slope) if self.slope else "no such series"

    def row(self) -> dict[str, Any]:
        """As values for programs."""
        return {
            "expect": self.expectation.number,
            "study": self.study,
            **(self.slope.key.named() if self.slope else {}),
            "expected": self.said,
            "measured": self.measured,
            "value": self.value,
            "verdict": self.verdict,
            "reason": self.reason,
            "file": self.file,
            "line": self.line,
        }


def series_name(slope: Slope) -> str:
    """A series of a study in words, with all that tells it from others."""
    parts = slope.key.besides("study", "measure", "quantity", "row_block")
    return f"{quantity(slope)}, {' '.join(parts)}"


def judge(folder: Path, slopes: Sequence[Slope]) -> list[Expected]:
    """Expectations of the studies that series are of, each for every series that it matches.

    Args:
        folder: Results folder.
        slopes: The series.

    Raises:
        ResultsError: When a record's expectations are not as a run has written them.
    """
    found = []
    for study in dict.fromkeys(slope.study for slope in slopes):
        path = folder / f"{study}.csv"
        record = records.known(path)
        try:
            given = expectations(record.get("config"))
        except ValueError as error:
            raise ResultsError(f"{path.with_suffix('.json')}: {error}") from None
        ours = [slope for slope in slopes if slope.study == study]
        for expectation in given:
            file, line = _place(record, expectation.number)
            matched = [slope for slope in ours if expectation.matches(slope.key)]
            if expectation.h is not None:
                matched = [slope for slope in matched if _has(slope, expectation.h)]
            if not matched:
                reason = f"{path} has no series with {expectation.described}"
                missing = ("", "", math.nan, INCOMPLETE, reason)
                found.append(Expected(study, expectation, None, *missing, file, line))
            found += [
                Expected(study, expectation, slope, *judged, file, line)
                for slope in matched
                for judged in _judged(expectation, slope)
            ]
    return found


def _has(slope: Slope, h: float) -> bool:
    return any(math.isclose(size, h, rel_tol=1e-9) for size in slope.h)


def _place(record: Mapping[str, Any], number: int) -> tuple[str, int]:
    """File and line of an expectation, as the run has recorded them."""
    given = record.get("expect")
    file, lines = (given.get("file"), given.get("lines")) if isinstance(given, dict) else ("", [])
    line = lines[number - 1] if isinstance(lines, list) and number <= len(lines) else 0
    if isinstance(file, str) and isinstance(line, int) and line > 0:
        return file, line
    return "", 0


_Judged = tuple[str, str, float, str, str]


def _judged(expectation: Expectation, slope: Slope) -> Iterator[_Judged]:
    """What is said, measured as text and number, verdict and reason: of an order, of a level."""
    curve = Curve("cell", **slope.key.named())
    if expectation.slope is not None:
        assert slope.rejudged is not None
        again = slope.rejudged(expectation.slope, expectation.within)
        claim = SlopeClaim(curve, expectation.slope, again.tolerance)
        # An order that is given can be judged, or its data lack something.
        verdict = INCOMPLETE if again.verdict == SHOWN else again.verdict
        orders = "" if verdict == PASS else f"local orders {format_orders(slope)}"
        reason = joined(orders, again.reason)
        yield claim.said, format_fit(again.fit), again.fit.slope, verdict, reason
    if expectation.bounded:
        bound = BoundClaim(curve, expectation.at_least, expectation.at_most, expectation.h)
        finding = evaluate(bound, lambda _: slope)
        lacks = finding.measured if finding.verdict == INCOMPLETE else ""
        measured = "" if lacks else finding.measured
        yield bound.said, measured, finding.value, finding.verdict, lacks


# -- for people ---------------------------------------------------------------------------------


def table(found: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the table of expectations, headings first."""
    headings = ("config", "expectation", "series", "expected", "measured", "verdict")
    return [
        headings,
        *(
            (
                each.study, str(each.expectation.number), each.series, each.said, each.measured,
                each.verdict,
            )
            for each in found
        ),
    ]  # fmt: skip


def lines(found: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the same table for a terminal, gathered by expectation, headings first."""
    return gathered(
        ("series", "measured", "verdict"),
        (
            (
                ": ".join(filter(None, (f"{each.study}, {each.expectation.name}", each.said))),
                each.series,
                each.measured,
                each.verdict,
            )
            for each in found
        ),
    )


def remarks(found: Iterable[Expected]) -> list[str]:
    """A line for each that has no pass and a reason."""
    return [
        f"{each.verdict}: {each.study}, {each.expectation.name}, {each.series}: {each.reason}"
        for each in found
        if each.verdict != PASS and each.reason and each.slope
    ]


def summary(found: Sequence[Expected]) -> str:
    """How many hold; empty without any."""
    if not found:
        return ""
    held = sum(each.verdict == PASS for each in found)
    undecided = sum(each.verdict == UNDECIDED for each in found)
    text = f"{held} of {len(found)} expectations hold"
    return text + (f" ({undecided} undecided)" if undecided else "")
