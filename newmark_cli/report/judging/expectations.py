"""What configs expect of their series, judged: the orders, levels and quotients they assert.

They stand in the record next to the CSV, so that a results folder can be checked without the
config; those of the shipped studies are read from the shipped configs where a record has none.
An expectation with a figure is a claim about that figure, and `check` lists it as one.  An order
is judged by the rule of `newmark_cli.report.judging.verdicts`, as a predicted one is.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.report.judging.fits import format_fit, format_order
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.text import format_orders, gathered
from newmark_cli.report.judging.verdicts import INCOMPLETE, MISS, PASS, SHOWN, UNDECIDED, joined
from newmark_cli.report.reading import records
from newmark_cli.report.reading.words import quantity
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.csv_rows import mapping
from newmark_cli.study.entries import ExpectConfig, expectations
from newmark_cli.support.arrays import Array, Mask


@dataclass(frozen=True)
class Expected:
    """What an expectation comes to for one series, or that it matches none."""

    study: str  #: name of the study
    number: int  #: place of the expectation in its config, from 1
    figure: str  #: the figure that it is a claim about; empty for none
    slope: Slope | None  #: the series; None where it matches none, or is about several
    label: str  #: what it is about, in words
    said: str  #: what is expected of it
    measured: str  #: as text
    value: float  #: as a number; NaN where there is none
    verdict: str  #: one of the words of `newmark_cli.report.judging.verdicts`
    reason: str  #: why it is not a plain pass; may be empty
    quantity: str = ""  #: what is measured, in the field's symbols
    #: Where the config has it; empty and 0 where that is not known.
    file: str = ""
    line: int = 0

    @property
    def name(self) -> str:
        """How texts name it."""
        return f"figure {self.figure}" if self.figure else f"expect[{self.number}]"

    @property
    def text(self) -> str:
        """What is claimed, in a sentence."""
        between = ", " if ": " in self.said else ": "
        return f"{self.label}{between if self.said else ''}{self.said}"

    @property
    def missing(self) -> bool:
        """Whether there is no such series."""
        return self.verdict == INCOMPLETE and self.slope is None

    def row(self) -> dict[str, Any]:
        """As values for programs."""
        measured = {"measured": self.measured, "value": self.value, "verdict": self.verdict}
        if self.figure:
            of_figure = {"figure": self.figure, "study": self.study, "claim": self.text}
            return of_figure | measured
        return {
            "expect": self.number, "study": self.study,
            **(self.slope.key.named() if self.slope else {}), "expected": self.said,
            **measured, "reason": self.reason, "file": self.file, "line": self.line,
        }  # fmt: skip


class _NoDataError(Exception):
    """The results lack what an expectation needs; the text says what."""


def series_name(slope: Slope) -> str:
    """A series of a study in words, with all that tells it from others."""
    parts = slope.key.besides("study", "measure", "quantity", "row_block")
    return f"{quantity(slope)}, {' '.join(parts)}"


def claims(judged: Iterable[Expected]) -> list[Expected]:
    """Those that are about figures, in the order of the figures."""
    about = [entry for entry in judged if entry.figure]
    return sorted(about, key=lambda entry: (not entry.figure.isdigit(), entry.figure.zfill(9)))


def own(judged: Iterable[Expected]) -> list[Expected]:
    """Those that are about no figure."""
    return [entry for entry in judged if not entry.figure]


def judge(folder: Path, slopes: Sequence[Slope]) -> list[Expected]:
    """Expectations of the studies that series are of, each for every series that it matches."""
    judged: list[Expected] = []
    for study in dict.fromkeys(slope.study for slope in slopes):
        path = folder / f"{study}.csv"
        record = records.known(path)
        wanted = records.configured(path, "expect", expectations)
        ours = {slope.key: slope for slope in slopes if slope.study == study}
        for number, expectation in enumerate(wanted, 1):
            place = _place(record, number)
            judged += expected(study, number, expectation, ours, path, place)
    return judged


def expected(
    study: str,
    number: int,
    wanted: ExpectConfig,
    ours: Mapping[SeriesKey, Slope],
    path: Path,
    place: tuple[str, int] = ("", 0),
) -> Iterator[Expected]:
    """What an expectation comes to for each series that it matches, or that it matches none.

    Args:
        study: Name of the study.
        number: Place of the expectation in its config, from 1.
        wanted: The expectation.
        ours: Key → series, of those that it may be about.
        path: The study's CSV.
        place: File and line of the expectation.
    """
    matched = [slope for slope in ours.values() if wanted.matches(slope.key)]
    if wanted.h is not None and not wanted.figure:
        matched = [slope for slope in matched if _at(slope, wanted.h).any()]
    result = partial(Expected, study, number, wanted.figure or "")
    label, (low, high) = wanted.label or "", wanted.bounds
    if not matched:
        reason = f"{path} has no series with {wanted.described}"
        measured = f"no {label}" if label else ""
        finding = measured, math.nan, INCOMPLETE, reason
        yield result(None, label or "no such series", "", *finding, "", *place)
    elif wanted.over is not None:
        symbols = ", ".join(dict.fromkeys(map(quantity, matched)))
        judged = _level(lambda: _quotients(wanted, matched, ours), low, high)
        label = label or f"quotients of {len(matched)} series"
        yield result(None, label, bounds(low, high), *judged, symbols, *place)
    else:
        for slope in matched:
            for said, finding in _judged(wanted, slope):
                symbols = quantity(slope)
                yield result(slope, label or series_name(slope), said, *finding, symbols, *place)


def _place(record: Mapping[str, Any], number: int) -> tuple[str, int]:
    """Recorded file and line of an expectation."""
    place = mapping(record, "expect")
    file, lines = place.get("file"), place.get("lines")
    line = lines[number - 1] if isinstance(lines, list) and number <= len(lines) else 0
    if isinstance(file, str) and isinstance(line, int) and line > 0:
        return file, line
    return "", 0


#: What is measured as text and number, the verdict and the reason.
_Finding = tuple[str, float, str, str]


def _judged(wanted: ExpectConfig, slope: Slope) -> Iterator[tuple[str, _Finding]]:
    """Each assertion of an expectation in words, with its finding."""
    if wanted.slope is not None:
        again = slope.judged(wanted.slope, wanted.within)
        # An order that is given can be judged, or its data lack something.
        verdict = INCOMPLETE if again.verdict == SHOWN else again.verdict
        orders = "" if verdict == PASS else f"local orders {format_orders(slope)}"
        said = f"slope {format_order(wanted.slope)} ± {again.tolerance:g}"
        reason = joined(orders, again.reason)
        yield said, (format_fit(again.fit), again.fit.slope, verdict, reason)
    low, high = wanted.bounds
    if (low, high) != (0, math.inf):
        where = "every h" if wanted.h is None else f"h = {wanted.h:g}"
        yield (
            f"{where}: {bounds(low, high)}",
            _level(lambda: _points(slope, wanted.h)[1], low, high),
        )
    if wanted.spread is not None:
        said = f"(max − min)/min over h {bounds(0, wanted.spread)}"
        yield said, _level(lambda: _spread(slope), 0.0, wanted.spread)
    if wanted.status:
        place = int(np.argmin(slope.h))
        ended = slope.statuses[place]
        verdict = PASS if ended == wanted.status else MISS
        measured = f"{ended} at h = {slope.h[place]:g}"
        yield f"smallest h: {wanted.status}", (measured, math.nan, verdict, "")


def _level(values: Callable[[], Array], low: float, high: float) -> _Finding:
    """Of several values the one farthest beyond a bound, or else nearest to one."""
    try:
        levels = values()
    except _NoDataError as lacking:
        return "", math.nan, INCOMPLETE, str(lacking)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.fmax(low / levels, levels / high)
    value = float(levels[np.argmax(beyond)])
    return f"{value:.3g}", value, PASS if low <= value <= high else MISS, ""


def _at(slope: Slope, h: float) -> Mask:
    return np.isclose(slope.h, h, rtol=1e-9, atol=0)


def _points(slope: Slope, h: float | None = None) -> tuple[Array, Array]:
    """Ascending step sizes with their values, at h or at every step size."""
    places = np.argsort(slope.h)
    if h is not None:
        places = places[_at(slope, h)[places]]
        if len(places) == 0:
            raise _NoDataError(f"cell at h = {h:g}: not there")
    for place in places:
        where = f"cell at h = {slope.h[place]:g}"
        if slope.statuses[place] not in slope.record.ok:
            raise _NoDataError(f"{where}: {slope.statuses[place]}")
        if not math.isfinite(slope.values[place]):
            raise _NoDataError(f"{where}: no value")
    if len(places) == 0:
        raise _NoDataError("no cell")
    return slope.h[places], slope.values[places]


def _quotients(
    wanted: ExpectConfig, matched: Iterable[Slope], ours: Mapping[SeriesKey, Slope]
) -> Array:
    """Quotients of all series and their divisors, at one step size or each."""
    quotients = []
    for slope in matched:
        divisor = ours.get(wanted.divisor(slope.key))
        if divisor is None:
            raise _NoDataError(f"{series_name(slope)}: no series to divide by")
        h, above = _points(slope, wanted.h)
        other, below = _points(divisor, wanted.over.h or wanted.h)
        at_one = wanted.h is not None
        if not at_one and (len(h) != len(other) or not np.allclose(h, other, rtol=1e-9, atol=0)):
            raise _NoDataError(f"{series_name(slope)}, and its divisor: at different step sizes")
        if np.any(below == 0):
            raise _NoDataError(f"{series_name(divisor)}: zero")
        quotients.append(above / below)
    return np.concatenate(quotients)


def _spread(slope: Slope) -> Array:
    _, values = _points(slope)
    least = np.min(values)
    if len(values) < 2 or least == 0:
        raise _NoDataError("needs two values, none of them zero")
    return np.asarray((np.max(values, keepdims=True) - least) / least)


def bounds(low: float, high: float) -> str:
    """Bounds in words."""
    if low == high:
        return f"{low:g}"
    if math.isinf(high):
        return f"at least {low:g}"
    return f"{low:.3g} to {high:.3g}" if low else f"at most {high:g}"


# -- for people ---------------------------------------------------------------------------------


def table(judged: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the table of expectations, headings first."""
    return [
        ("config", "expectation", "series", "expected", "measured", "verdict"),
        *((e.study, str(e.number), e.label, e.said, e.measured, e.verdict) for e in own(judged)),
    ]


def lines(judged: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the same table for a terminal, gathered by expectation, headings first."""
    rows = (
        (": ".join(filter(None, (f"{study}, expect[{number}]", expected))), label, *row)
        for study, number, label, expected, *row in table(judged)[1:]
    )
    return gathered(("series", "measured", "verdict"), rows)


def claim_rows(judged: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the table of claims, headings first."""
    return [
        ("figure", "config", "quantity", "claim", "measured", "verdict"),
        *(
            (e.figure, e.study, e.quantity, e.text, e.measured or e.reason, e.verdict)
            for e in claims(judged)
        ),
    ]


def claim_lines(judged: Iterable[Expected]) -> list[tuple[str, ...]]:
    """Rows of the same table for a terminal, gathered by figure, headings first."""
    rows = (
        (f"figure {figure}, {study}: {measured}", *row)
        for figure, study, measured, *row in claim_rows(judged)[1:]
    )
    return gathered(("claim", "measured", "verdict"), rows)


def remarks(judged: Iterable[Expected]) -> list[str]:
    """A line for each that has no pass and a reason."""
    return [
        f"{entry.verdict}: {entry.study}, {entry.name}, {entry.label}: {entry.reason}"
        for entry in own(judged)
        if entry.verdict != PASS and entry.reason and not entry.missing
    ]


def summary(judged: Sequence[Expected]) -> str:
    """How many claims and how many expectations hold; empty without any."""
    parts = []
    for word, entries in (("claims", claims(judged)), ("expectations", own(judged))):
        if entries:
            held = sum(entry.verdict == PASS for entry in entries)
            undecided = sum(entry.verdict == UNDECIDED for entry in entries)
            open_ones = f" ({undecided} undecided)" if undecided else ""
            parts.append(f"{held} of {len(entries)} {word} hold{open_ones}")
    return ", ".join(parts)
