"""Fitted slopes next to predicted orders, with verdicts: what `check` asserts.

One `Slope` for each series in the CSVs: the rows of one study that differ in
the step size alone.  Predictions come from exponent arithmetic
(`newmark_cli.newmark.orders`) and from the order of the integrator, never from a
table of expected numbers.  Where theory predicts none, the series is shown.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import Formulation
from newmark_cli.newmark.invariants import UNSTABLE_MISFIT
from newmark_cli.report.judging.fits import Fit, power_law
from newmark_cli.report.judging.verdicts import (
    FAILING,
    INCOMPLETE,
    LEAST,
    MISS,
    NOT_CONVERGING,
    PASS,
    SHOWN,
    UNDECIDED,
    Evidence,
    Judgement,
    joined,
    judge,
    local_orders,
)
from newmark_cli.report.reading.figures import Figure, of_study
from newmark_cli.report.reading.figures import place as place_of
from newmark_cli.study import axes, results, shipped
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.measures import OF_MULTIPLIERS, RECORDS, Record
from newmark_cli.study.reading import (
    SERIES,
    Motion,
    Table,
    facts,
    read_rows,
    study_files,
)
from newmark_cli.study.results import NUMBERS, ROUNDING
from newmark_cli.study.tabulating import VALUES
from newmark_cli.support import files
from newmark_cli.support.arrays import Array, Mask
from newmark_cli.support.errors import InputError, ResultsError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

#: Columns that a series is made from.
_READ = ("h", "steps", "t_end", "status", *sorted(NUMBERS - {"h", "steps", "t_end"}))
#: Columns of ``slopes.csv``; a new one is appended.
COLUMNS = axes.appended(
    (
        (0, "figure"),
        *((axis.since[1], axis.name) for axis in axes.series_axes() if axis.column),
        *((0, name) for name in ("slope", "stderr", "points", "expected", "tolerance", "verdict")),
        *((3, name) for name in ("h_from", "h_to", "local_orders", "reason")),
    )
)
#: What each column holds.
ABOUT: Mapping[str, str] = {
    **{axis.name: axis.shows or axis.about for axis in axes.series_axes() if axis.column},
    **VALUES,
    "figure": "figures that draw the series",
    "expected": "predicted order; empty where theory predicts none",
    "tolerance": "largest |slope − expected| that passes",
    "verdict": "see the verdicts in “Reading results”",
}


@dataclass(frozen=True, eq=False)
class Slope:
    """A series with its fit and what theory says."""

    figures: tuple[str, ...]  #: figures that draw it, by number or word
    key: SeriesKey  #: what tells it from others; every axis is an attribute, as in the CSV
    role: str  #: as in the CSV
    h: Array  #: (points,) step sizes
    steps: Array  #: (points,) steps of the run
    #: (points,) the statistic that is drawn; where a Krylov solver stagnated, the number of
    #: iterations that it was allowed.
    values: Array
    #: (points,) what rounding alone changes in each value; NaN where it is not known.
    rounding: Array
    statuses: tuple[str, ...]  #: status of the cell behind each point
    #: (points,) which of them the fit is for; see `newmark_cli.report.judging.verdicts`.
    fitted: Mask
    fit: Fit  #: power law through them
    expected: float  #: predicted order; NaN where theory says nothing
    tolerance: float  #: largest |fit.slope − expected|; NaN likewise
    verdict: str  #: one of the words of `newmark_cli.report.judging.verdicts`
    reason: str = ""  #: what else there is to say, in a sentence; may be empty
    accepted: bool = False  #: whether the study is about series that end like this; see `accept`
    shipped: bool = False  #: whether it is of a shipped study, and not of a namesake
    in_paper: bool = False  #: whether `check` lists it first; see `Figure.in_paper`
    #: Whether it is a property of the mechanism, not of which redundant constraints were dropped.
    unique: bool = True
    #: (order, tolerance) → the same series as the same rule judges it by an order of the user's;
    #: the tolerance of the measure where it is None.
    rejudged: "Callable[[float, float | None], Slope] | None" = field(default=None, repr=False)

    @property
    def missed(self) -> bool:
        """Whether it is not as predicted, and the study is not about that."""
        return self.verdict not in (PASS, SHOWN) and not self.accepted

    @property
    def fails(self) -> bool:
        """Whether a check fails with it."""
        return self.verdict in FAILING and not self.accepted

    @property
    def local_orders(self) -> Array:
        """(points − 1,) orders between successive step sizes, the largest first."""
        order = np.argsort(-self.h, kind="stable")
        return local_orders(self.h[order], self.values[order])

    def __getattr__(self, name: str) -> str:
        if name == "key":
            raise AttributeError(name)
        value = self.__dict__[name] = str(getattr(self.key, name))  # found there the next time
        return value

    @property
    def record(self) -> Record:
        """The record of its measure."""
        return RECORDS[self.key.measure]

    def row(self) -> dict[str, Any]:
        """Row of ``slopes.csv``."""
        return {
            "figure": " ".join(self.figures),
            "slope": self.fit.slope,
            "stderr": self.fit.stderr,
            "points": self.fit.points,
            "expected": self.expected,
            "tolerance": self.tolerance,
            "verdict": self.verdict,
            "h_from": self.h[self.fitted].max(initial=-np.inf) if self.fitted.any() else None,
            "h_to": self.h[self.fitted].min() if self.fitted.any() else None,
            "local_orders": " ".join(f"{order:.3g}" for order in self.local_orders),
            "reason": self.reason,
            **self.key.named(),
        }


def collect(folder: Path, studies: Iterable[str] | None = None) -> list[Slope]:
    """Slopes of every series in a results folder."""
    if studies is None:
        csvs = study_files(folder)
    else:
        csvs = [folder / f"{name}.csv" for name in studies]
        for file in csvs:
            if not file.exists():
                raise ResultsError(f"{file}: no results; run 'newmark-study run {file.stem}' first")
    return [slope for file in csvs for slope in study_slopes(read_rows(file), file)]


def study_slopes(table: "Table | pd.DataFrame", path: Path) -> list[Slope]:
    """Slopes of one study's rows, in their order."""
    # A form, a variant or a quantity that lacks step sizes which others of the same
    # problem have was cut off; cases may differ in the rest on purpose.
    marched = [axis.name for axis in axes.cell_axes() if axis.series]
    alike = [axis.name for axis in axes.cell_axes() if axis.series and not axis.inner]
    columns = {name: np.asarray(table[name], object).tolist() for name in (*SERIES, *_READ)}
    at_start = [steps == 0 for steps in columns["steps"]]
    cases = list(zip(*(columns[name] for name in (*alike, "measure")), at_start, strict=True))
    sizes: dict[tuple[Any, ...], set[float]] = {}
    for case, h in zip(cases, columns["h"], strict=True):
        sizes.setdefault(case, set()).add(h)
    places: dict[tuple[Any, ...], list[int]] = {}
    for place, values in enumerate(zip(*(columns[name] for name in SERIES), at_start, strict=True)):
        places.setdefault(values, []).append(place)
    lost = _lost(columns, marched)
    recorded = facts(path)
    accepted = ("ok", *recorded.accepted)
    of_shipped = shipped.is_shipped(path.stem, recorded.config)
    try:
        drawing = _drawing(of_study(path.stem, recorded.config))
    except ValueError as error:
        raise ResultsError(f"{path.with_suffix('.json')}: {error}") from None
    slopes = []
    for values, at in places.items():
        *named, start = values
        rows = {name: [columns[name][place] for place in at] for name in _READ}
        row = dict(zip(SERIES, named, strict=True))
        key = SeriesKey.of(row | {"steps": 0 if start else 1})
        role = str(row["role"])
        if key.measure:
            of_motion = recorded.motions.get(key.problem, Motion())
            cell = tuple(row[name] for name in marched)
            of_motion = replace(of_motion, lost=lost.get(cell, ""))
            points = len(sizes[cases[at[0]]])
            drawn = drawing.get(key, ())
            series = partial(_slope, key, role, rows, points, accepted, path, of_motion, drawn)
            slope = _shared(series(), recorded.released.get(key.problem))
            slopes.append(replace(slope, rejudged=series, shipped=of_shipped))
        elif not set(rows["status"]) <= set(accepted):
            slopes.append(_failed(key, role))
    return slopes


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write ``slopes.csv``: series of the figures first."""
    rest = sorted((s for s in slopes if not s.figures), key=lambda slope: slope.study)
    ordered = in_figure_order(slopes) + rest
    rows = [slope.row() for slope in ordered]
    text = results.csv_text(axes.present(COLUMNS, rows), rows)
    files.write(folder / "slopes.csv", text)


def in_figure_order(slopes: Iterable[Slope]) -> list[Slope]:
    """Slopes that a figure draws, in the order of the figures."""
    drawn = [slope for slope in slopes if slope.figures]
    return sorted(drawn, key=lambda slope: place_of(slope.figures[0]))


def _drawing(figures: Iterable[Figure]) -> Mapping[SeriesKey, list[Figure]]:
    """Key of a series → the figures that draw it."""
    drawing: dict[SeriesKey, list[Figure]] = {}
    for figure in figures:
        for curve in figure.curves:
            drawing.setdefault(curve.key, []).append(figure)
    return drawing


def _slope(
    key: SeriesKey,
    role: str,
    rows: Mapping[str, Sequence[Any]],
    points: int,
    accepted: Sequence[str],
    path: Path,
    of_motion: Motion,
    figures: Sequence[Figure],
    own: float | None = None,
    within: float | None = None,
) -> Slope:
    """A series judged by the predicted order or the user's, with a tolerance."""
    if key.measure not in RECORDS:
        raise ResultsError(f"{path}: unknown measure {key.measure!r}; is it from a newer version?")
    record = RECORDS[key.measure]
    h = np.array(rows["h"], float)
    values = record.drawn(rows)
    expected = _predicted(key, path)
    exact = bool(np.isposinf(expected))
    if exact:
        expected = np.nan  # no order at all
    statuses = tuple(rows["status"])
    if not set(statuses) <= {"ok"} and set(statuses) <= set(accepted):
        # A cell that was expected to end like this measured something else.
        expected, exact = np.nan, False
    tolerance = np.nan if np.isnan(expected) else _tolerance(record, bool(key.initial), figures)
    if own is not None:
        expected, tolerance = own, within or _tolerance(record, bool(key.initial), ())
        # The order of a user is neither a bound nor met by zeros.
        exact, record = False, replace(record, may_vanish=False, bounded=lambda key: "")
    irregular = "" if key.initial or record.kind == "determined" else _irregular(of_motion)
    judgement = _judged(
        key, record, rows, values, expected, tolerance, points, exact, irregular, own is not None
    )
    steps, rounding = (np.array(rows[name], float) for name in ("steps", ROUNDING))
    # Where theory predicts an order, nobody can accept another.
    ends_as_accepted = judgement.verdict == NOT_CONVERGING and "not_converging" in accepted
    slope = Slope(
        tuple(figure.name for figure in figures), key, role,
        h, steps, values, rounding, statuses, judgement.fitted, judgement.fit,
        expected, tolerance, judgement.verdict, judgement.reason,
        accepted=ends_as_accepted and bool(np.isnan(expected)),
        in_paper=any(figure.in_paper for figure in figures),
    )  # fmt: skip
    return _moved(slope if own is not None else _resolved(slope), of_motion)


def _resolved(slope: Slope) -> Slope:
    """Leave a miss undecided where h does not resolve a fixed rate α: orders need small α h."""
    parameter = Formulation.parse(slope.formulation).parameter
    if slope.verdict != MISS or parameter is None or parameter[0] != "rate":
        return slope
    products = parameter[1] * slope.h
    if np.count_nonzero(products <= _SLOW) >= LEAST:
        return slope
    reason = f"α h is {products.min():.2g} to {products.max():.2g}: orders show below {_SLOW:g}"
    return replace(slope, verdict=UNDECIDED, reason=joined(slope.reason, reason))


#: Largest α h at which a fixed rate of Baumgarte's is one that h resolves.
_SLOW = 0.1


def _irregular(motion: Motion) -> str:
    """Why theory, which assumes regular motions, says nothing of this one; empty where it does."""
    times = list(dict.fromkeys(motion.singular))
    if not times:
        return ""
    where = ", ".join(f"{t:g}" for t in times[:3]) + (", …" if len(times) > 3 else "")
    return f"the motion passes a singular position near t = {where}, where no order holds"


def _lost(
    columns: Mapping[str, Sequence[Any]], marched: Sequence[str]
) -> dict[tuple[Any, ...], str]:
    """Axes of cells → at which h the energy, where it was measured, tells of another motion."""
    names = ("measure", "quantity", "h", "max")
    told: dict[tuple[Any, ...], tuple[float, float]] = {}
    rows = zip(*(columns[name] for name in (*names, *marched)), strict=True)
    for measure, quantity, h, misfit, *cell in rows:
        if (measure, quantity) == ("invariant", "energy") and misfit > UNSTABLE_MISFIT:
            told[tuple(cell)] = min(told.get(tuple(cell), (math.inf, 0.0)), (h, misfit))
    return {
        cell: f"at h = {h:g} the energy, which is conserved, is off by {misfit:.0%} of its size: "
        "what is marched there is not the motion"
        for cell, (h, misfit) in told.items()
    }


def _moved(slope: Slope, motion: Motion) -> Slope:
    """The verdict where nothing moves, and the reason where something else does."""
    if slope.initial or slope.verdict in (SHOWN, INCOMPLETE) or slope.record.kind == "determined":
        return slope
    if motion.still:
        return replace(slope, verdict=UNDECIDED, reason="nothing moves: there is only rounding")
    return replace(slope, reason=joined(slope.reason, "" if slope.verdict == PASS else motion.lost))


#: Quantities of these measures depend on which redundant rows were dropped, where any were.
_OF_VALUES, _SHARED = ("error", "history"), ("lambda", "force", "moment")


def _shared(slope: Slope, dropped: Sequence[str] | None) -> Slope:
    """Mark a series of reactions that are not unique."""
    if dropped is None or slope.measure not in _OF_VALUES or slope.quantity not in _SHARED:
        return slope
    reason = f"not unique: redundant, dropped: {', '.join(dropped) or 'some rows'}"
    reason = joined(slope.reason, reason)
    return replace(slope, reason=reason, unique=False)


def _judged(
    key: SeriesKey,
    record: Record,
    rows: Mapping[str, Sequence[Any]],
    values: Array,
    expected: float,
    tolerance: float,
    points: int,
    exact: bool,
    irregular: str,
    written: bool,
) -> Judgement:
    """The verdict on one series; points stay in their order."""
    h = np.array(rows["h"], float)
    everything = np.full(len(h), True)
    if not np.isnan(expected):
        # An exact zero at every h is within any order: a block that this problem lacks.
        if record.may_vanish and bool((values == 0).all()):
            return Judgement(
                PASS, power_law(h, values), everything, "exactly 0: the problem lacks this block"
            )
        ended = [status for status in dict.fromkeys(rows["status"]) if status != "ok"]
        # Errors cost a reference and long runs: cases may have fewer step sizes on purpose.
        if ended or (len(h) < points and record.kind != "truncation"):
            reason = f"cells ended {', '.join(ended)}" if ended else f"{len(h)} of {points} h"
            return Judgement(INCOMPLETE, power_law(h, values), everything, reason)
    if record.at_end and len({t for t in rows["t_end"] if not np.isnan(t)}) > 1:
        return Judgement(SHOWN, power_law(h, values), everything, "taken at different times")
    if not set(rows["status"]) <= set(record.ok):
        return Judgement(SHOWN, power_law(h, values), everything)
    order = np.argsort(-h, kind="stable")
    evidence = Evidence(
        h=h[order],
        values=values[order],
        uncertainty=_uncertainty(record, rows, values)[order],
        steps=np.array(rows["steps"], float)[order],
        kind=record.kind,
        expected=expected,
        tolerance=tolerance,
        exact=exact,
        bound=record.bounded(key),
        coarse=record.coarse(key),
        typical=np.array(rows["median"], float)[order],
        largest=np.array(rows["max"], float)[order],
        undamped=key.quantity in OF_MULTIPLIERS and record.alternates(key),
        fading=record.fading(key) if key.quantity in OF_MULTIPLIERS else 0.0,
        irregular=irregular,
        written=written,
    )
    judgement = judge(evidence)
    fitted = np.empty(len(h), bool)
    fitted[order] = judgement.fitted
    return replace(judgement, fitted=fitted)


#: Relative standard deviation by which the place of h between powers of two changes what
#: rounding leaves: ln 2/√12, as the unit in the last place doubles from one to the next.
_BINADE = math.log(2) / math.sqrt(12)


def _uncertainty(record: Record, rows: Mapping[str, Sequence[Any]], values: Array) -> Array:
    """(points,) relative uncertainty of each value; NaN where it was not measured."""
    rounding, steps = (np.array(rows[name], float) for name in (ROUNDING, "steps"))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(rounding == 0, 0.0, rounding / values)
        if record.kind == "rounding":
            # Without blocks of steps the scatter of a normal distribution.
            sampling = np.where(np.isnan(relative), 1 / np.sqrt(2 * steps), relative)
            return np.asarray(np.sqrt(sampling * sampling + _BINADE**2))
    if record.kind == "determined":
        return np.nan_to_num(relative, nan=0.0)
    return np.asarray(relative)


def _tolerance(record: Record, at_start: bool, figures: Sequence[Figure]) -> float:
    """The strictest tolerance of the figures with the series, else that of its measure."""
    own = [figure.tolerance for figure in figures if figure.tolerance is not None]
    default = record.tolerance_at_start if at_start else None
    return min(own, default=record.tolerance if default is None else default)


def _failed(key: SeriesKey, role: str) -> Slope:
    """An incomplete series without a measure, for a cell that failed."""
    none = np.array([])
    return Slope(
        (), key, role, none, none, none, none, (), none.astype(bool), power_law(none, none),
        np.nan, np.nan, INCOMPLETE,
    )  # fmt: skip


def _predicted(key: SeriesKey, path: Path) -> float:
    """Predicted order; NaN where theory says nothing."""
    record = RECORDS[key.measure]
    try:
        for name, known in (("form", FORMS), ("quantity", record.quantities)):
            value = getattr(key, name)
            if known and value not in known:
                raise ResultsError(f"unknown {name} {value!r}{nearest(value, known)}")
        return record.predicted(key)
    except (InputError, KeyError, ValueError) as error:
        raise ResultsError(f"{path}: {key.form}, {key.quantity}: no prediction: {error}") from None
