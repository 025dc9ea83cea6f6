"""Fitted slopes next to predicted orders, with verdicts: what `check` asserts.

One `Slope` for each series in the CSVs: the rows of one study that differ in
the step size alone.  Predictions come from exponent arithmetic
(`newmark_cli.newmark.orders`) and from the order of the integrator, never from a
table of expected numbers.  Where theory predicts none, the series is shown.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
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
from newmark_cli.report.reading import records
from newmark_cli.report.reading.figures import Figure, of_study
from newmark_cli.report.reading.figures import place as place_of
from newmark_cli.study import axes, csv_files, shipped
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.cell import NOT_CONVERGING as STALLING
from newmark_cli.study.cell import STATUSES
from newmark_cli.study.csv_files import NUMBERS, ROUNDING
from newmark_cli.study.csv_rows import (
    SERIES,
    listed,
    mapping,
    read_record,
    read_rows,
    study_files,
)
from newmark_cli.study.measures import OF_MULTIPLIERS, RECORDS, Record
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


def _no_points() -> Array:
    return np.array([])


@dataclass(frozen=True, eq=False)
class Slope:
    """A series, its fit and what theory says; `judged` fills in what comes of it."""

    key: SeriesKey  #: what tells it from others; every axis is an attribute, as in the CSV
    role: str  #: as in the CSV
    h: Array = field(default_factory=_no_points)  #: (points,) step sizes, the largest first
    steps: Array = field(default_factory=_no_points)  #: (points,) steps of the run
    #: (points,) the statistic that is drawn; where a Krylov solver stagnated, the number of
    #: iterations that it was allowed.
    values: Array = field(default_factory=_no_points)
    #: (points,) what rounding alone changes in each value; NaN where it is not known.
    rounding: Array = field(default_factory=_no_points)
    typical: Array | None = None  #: (points,) medians along the runs
    largest: Array | None = None  #: (points,) largest values along the runs
    statuses: tuple[str, ...] = ()  #: status of the cell behind each point
    together: bool = True  #: whether all runs end at the same time
    most: int = 0  #: step sizes that series of its case have
    lost: str = ""  #: why marches are not of the motion; empty where nothing tells
    drawn_in: Sequence[Figure] = ()  #: figures that draw it
    accepts: Collection[str] = ()  #: statuses and verdicts that the study is about
    recorded: Mapping[str, Any] = field(default_factory=dict, repr=False)  #: record of the study
    shipped: bool = False  #: whether it is of a shipped study, and not of a namesake
    path: Path = Path()  #: where it stands, for messages
    #: (points,) which of them the fit is for; see `newmark_cli.report.judging.verdicts`.
    fitted: Mask = field(default_factory=lambda: np.array([], bool))
    #: Power law through them.
    fit: Fit = field(default_factory=lambda: Fit(np.nan, np.nan, 0))
    expected: float = np.nan  #: predicted order; NaN where theory says nothing
    tolerance: float = np.nan  #: largest |fit.slope − expected|; NaN likewise
    verdict: str = INCOMPLETE  #: one of the words of `newmark_cli.report.judging.verdicts`
    reason: str = ""  #: what else there is to say, in a sentence; may be empty
    accepted: bool = False  #: whether the study is about series that end like this
    #: Whether it is a property of the mechanism, not of which redundant constraints were dropped.
    unique: bool = True

    @property
    def figures(self) -> tuple[str, ...]:
        """Figures that draw it, by number or word."""
        return tuple(figure.name for figure in self.drawn_in)

    @property
    def in_paper(self) -> bool:
        """Whether `check` lists it first; see `Figure.in_paper`."""
        return any(figure.in_paper for figure in self.drawn_in)

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
        return local_orders(self.h, self.values)

    @property
    def span(self) -> tuple[float, float] | tuple[None, None]:
        """Largest and smallest step size of the fit; None where no point was fitted."""
        h = self.h[self.fitted].tolist()
        return (max(h), min(h)) if h else (None, None)

    @property
    def least(self) -> tuple[float, float] | None:
        """Smallest value and its step size; None where no value is finite."""
        finite = np.flatnonzero(np.isfinite(self.values))
        if not len(finite):
            return None
        place = finite[np.argmin(self.values[finite])]
        return float(self.values[place]), float(self.h[place])

    @property
    def finest(self) -> tuple[float, float] | None:
        """Value at the smallest step size, and that; None where there is none."""
        return (float(self.values[-1]), float(self.h[-1])) if len(self.h) else None

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
            "h_from": self.span[0],
            "h_to": self.span[1],
            "local_orders": " ".join(f"{order:.3g}" for order in self.local_orders),
            "reason": self.reason,
            **self.key.named(),
        }

    def judged(self, own: float | None = None, within: float | None = None) -> "Slope":
        """It with a verdict, by the predicted order or one of the user's, NaN where any will do.

        Without ``within`` the tolerance of the user's order is that of the measure.
        """
        written, statuses = own is not None, {*self.statuses}
        expected = _predicted(self.key, self.path) if own is None else own
        # A cell that was expected to end like this measured something else.
        if not written and not statuses <= {"ok"} and statuses <= {*self.accepts}:
            expected = np.nan
        exact = bool(np.isposinf(expected))
        expected = np.nan if exact else expected  # no order at all
        tolerance = within or self._tolerance(() if written else self.drawn_in)
        tolerance = np.nan if np.isnan(expected) else tolerance
        judgement = self._judgement(expected, tolerance, exact, written)
        verdict, reason = self._on_this_motion(judgement, written)
        # Where theory predicts an order, nobody can accept another.
        ends_as_accepted = judgement.verdict == NOT_CONVERGING and STALLING in self.accepts
        dropped = "" if written else self._dropped
        return replace(
            self, fitted=judgement.fitted, fit=judgement.fit, expected=expected,
            tolerance=tolerance, verdict=verdict, reason=joined(reason, dropped),
            accepted=ends_as_accepted and bool(np.isnan(expected)), unique=not dropped,
        )  # fmt: skip

    def _tolerance(self, figures: Sequence[Figure]) -> float:
        """The strictest tolerance of the figures with the series, else that of its measure."""
        own = [figure.tolerance for figure in figures if figure.tolerance is not None]
        default = self.record.tolerance_at_start if self.key.initial else None
        return min(own, default=self.record.tolerance if default is None else default)

    def _judgement(
        self, expected: float, tolerance: float, exact: bool, written: bool
    ) -> Judgement:
        """The verdict by the points; the order of a user is neither a bound nor met by zeros."""
        key, record, h, values = self.key, self.record, self.h, self.values
        ended = [status for status in dict.fromkeys(self.statuses) if status != "ok"]

        def plain(verdict: str, reason: str = "") -> Judgement:
            return Judgement(verdict, power_law(h, values), np.full(len(h), True), reason)

        if not np.isnan(expected):
            # An exact zero at every h is within any order: a block that this problem lacks.
            if record.may_vanish and not written and bool((values == 0).all()):
                return plain(PASS, "exactly 0: the problem lacks this block")
            if ended:
                return plain(INCOMPLETE, f"cells ended {', '.join(ended)}")
            # Errors cost a reference and long runs: cases may have fewer step sizes on purpose.
            if len(h) < self.most and record.kind != "truncation":
                return plain(INCOMPLETE, f"{len(h)} of {self.most} h")
        if record.at_end and not self.together:
            return plain(SHOWN, "taken at different times")
        if not {*self.statuses} <= {*record.ok}:
            return plain(SHOWN)
        multipliers = key.quantity in OF_MULTIPLIERS and record.kind == "truncation"
        regular = key.initial or record.kind == "determined"
        return judge(
            Evidence(
                h=h,
                values=values,
                uncertainty=self._uncertainty,
                steps=self.steps,
                kind=record.kind,
                expected=expected,
                tolerance=tolerance,
                exact=exact,
                bound="" if written else record.bounded(key),
                coarse=record.coarse(key),
                typical=self.typical,
                largest=self.largest,
                undamped=multipliers and record.alternates(key),
                fading=record.fading(key) if multipliers else 0.0,
                irregular="" if regular else _irregular(self._motion),
                written=written,
            )
        )

    def _on_this_motion(self, judgement: Judgement, written: bool) -> tuple[str, str]:
        """Verdict and reason where h does not resolve a rate, nothing moves, or something else."""
        verdict, reason = judgement.verdict, judgement.reason
        name, rate = Formulation.parse(self.key.formulation).parameter or ("", 0.0)
        products = rate * self.h
        slow = np.count_nonzero(products <= _SLOW) >= LEAST
        # As a pendulum's corrections with α = 1000 and h from 0.1 to 0.003.
        if verdict == MISS and name == "rate" and not slow and not written:
            verdict, between = UNDECIDED, f"{products.min():.2g} to {products.max():.2g}"
            reason = joined(reason, f"α h is {between}: orders show below {_SLOW:g}")
        if self.key.initial or verdict in (SHOWN, INCOMPLETE) or self.record.kind == "determined":
            return verdict, reason
        if self._motion.get("still") is True:
            return UNDECIDED, "nothing moves: there is only rounding"
        # An integrator has no say in positions that Φ(u, t) = 0 determines.
        bare = verdict == UNDECIDED and not judgement.fitted.any()
        if bare and not written and self._motion.get("driven") is True:
            return SHOWN, "only rounding: the constraints alone determine it"
        return verdict, reason if verdict == PASS else joined(reason, self.lost)

    @property
    def _motion(self) -> Mapping[str, Any]:
        """What the record says of the motion; see `newmark_cli.study.motion.Facts`."""
        return mapping(mapping(self.recorded, "motions"), self.key.problem)

    @property
    def _dropped(self) -> str:
        """Why reactions are not unique; empty where they are, and of what is no reaction."""
        key, recorded = self.key, mapping(self.recorded, "not_unique")
        unlike = key.measure in _OF_VALUES and key.quantity in _SHARED
        if not unlike or key.problem not in recorded:
            return ""
        dropped = map(str, listed(mapping(recorded, key.problem), "released"))
        return f"not unique: redundant, dropped: {', '.join(dropped) or 'some rows'}"

    @property
    def _uncertainty(self) -> Array:
        """(points,) relative uncertainty of each value; NaN where it was not measured."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(self.rounding == 0, 0.0, self.rounding / self.values)
            if self.record.kind == "rounding":
                # Without blocks of steps the scatter of a normal distribution.
                sampling = np.where(np.isnan(relative), 1 / np.sqrt(2 * self.steps), relative)
                return np.asarray(np.sqrt(sampling * sampling + _BINADE**2))
        if self.record.kind == "determined":
            return np.nan_to_num(relative, nan=0.0)
        return np.asarray(relative)


def collect(folder: Path, studies: Iterable[str] | None = None) -> list[Slope]:
    """Slopes of every series in a results folder."""
    if studies is None:
        csvs = study_files(folder)
    else:
        csvs = [folder / f"{name}.csv" for name in studies]
        for file in csvs:
            if not file.exists():
                raise ResultsError(f"{file}: no results; run 'newmark-study run {file.stem}' first")
    return [slope for file in csvs for slope in of_csv(file)]


def of_csv(path: Path) -> list[Slope]:
    """Slopes of every series in a study's CSV."""
    return study_slopes(read_rows(path), path, read_record(path))


def study_slopes(
    table: "Mapping[str, Sequence[Any]] | pd.DataFrame", path: Path, record: Mapping[str, Any]
) -> list[Slope]:
    """Slopes of one study's rows, in their order.

    Args:
        table: Its rows by columns.
        path: Where they stand, for messages.
        record: What the record beside them says.
    """
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
    lost, study, config = _lost(columns, marched), str(columns["study"][0]), record.get("config")
    accepted, of_shipped = _accepted(config), shipped.is_shipped(study, config)
    drawing: dict[SeriesKey, list[Figure]] = {}
    for figure in records.told(path, partial(of_study, study), config):
        for curve in figure.curves:
            drawing.setdefault(curve.key, []).append(figure)
    slopes = []
    for values, at in places.items():
        *named, start = values
        row = dict(zip(SERIES, named, strict=True))
        key = SeriesKey.of(row | {"steps": 0 if start else 1})
        by_size = np.argsort([-columns["h"][place] for place in at], kind="stable").tolist()
        rows = {name: [columns[name][at[i]] for i in by_size] for name in _READ}
        if not key.measure:
            if not accepted.issuperset(rows["status"]):
                slopes.append(Slope(key, str(row["role"])))
            continue
        if key.measure not in RECORDS:
            raise ResultsError(
                f"{path}: unknown measure {key.measure!r}; is it from a newer version?"
            )
        series = Slope(
            key, str(row["role"]),
            h=np.array(rows["h"], float), steps=np.array(rows["steps"], float),
            values=RECORDS[key.measure].drawn(rows), rounding=np.array(rows[ROUNDING], float),
            typical=np.array(rows["median"], float), largest=np.array(rows["max"], float),
            statuses=tuple(rows["status"]),
            together=len({t for t in rows["t_end"] if not np.isnan(t)}) <= 1,
            most=len(sizes[cases[at[0]]]),
            lost=lost.get(tuple(row[name] for name in marched), ""),
            drawn_in=drawing.get(key, ()),
            accepts=accepted, recorded=record, shipped=of_shipped, path=path,
        )  # fmt: skip
        slopes.append(series.judged())
    return slopes


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write ``slopes.csv``: series of the figures first."""
    rest = sorted((s for s in slopes if not s.figures), key=lambda slope: slope.study)
    ordered = in_figure_order(slopes) + rest
    rows = [slope.row() for slope in ordered]
    text = csv_files.csv_text(axes.present(COLUMNS, rows), rows)
    files.write(folder / "slopes.csv", text)


def in_figure_order(slopes: Iterable[Slope]) -> list[Slope]:
    """Slopes that a figure draws, in the order of the figures."""
    drawn = [slope for slope in slopes if slope.figures]
    return sorted(drawn, key=lambda slope: place_of(slope.figures[0]))


#: Largest α h at which a fixed rate of Baumgarte's is one that h resolves.
_SLOW = 0.1
#: Quantities of these measures depend on which redundant rows were dropped, where any were.
_OF_VALUES, _SHARED = ("error", "history", "trajectory"), ("lambda", "force", "moment")


def _accepted(config: Any) -> set[str]:
    """How cells and series may end, by a recorded config."""
    cases = listed(config, "cases") if isinstance(config, dict) else ()
    words = (word for case in cases if isinstance(case, dict) for word in listed(case, "accept"))
    return {"ok", *(word for word in words if word in (*STATUSES, STALLING))}


def _irregular(motion: Mapping[str, Any]) -> str:
    """Why theory, which assumes regular motions, says nothing of this one; empty where it does."""
    times = list(dict.fromkeys(t for t in listed(motion, "singular") if isinstance(t, float)))
    if not times:
        return ""
    where = ", ".join(f"{t:g}" for t in times[:3]) + (", …" if len(times) > 3 else "")
    return f"the motion passes a singular position near t = {where}, where no order holds"


def _lost(
    columns: Mapping[str, Sequence[Any]], marched: Sequence[str]
) -> dict[tuple[Any, ...], str]:
    """Axes of cells → at which h the energy, where it was measured, tells of another motion."""
    told: dict[tuple[Any, ...], str] = {}
    names = ("h", "measure", "quantity", "max", *marched)
    rows = sorted(zip(*(columns[name] for name in names), strict=True), key=lambda row: row[0])
    for h, measure, quantity, misfit, *cell in rows:
        if (measure, quantity) == ("invariant", "energy") and misfit > UNSTABLE_MISFIT:
            told.setdefault(
                tuple(cell),
                f"at h = {h:g} the energy, which is conserved, is off by {misfit:.0%} of its "
                "size: what is marched there is not the motion",
            )
    return told


#: Relative standard deviation by which the place of h between powers of two changes what
#: rounding leaves: ln 2/√12, as the unit in the last place doubles from one to the next.
_BINADE = math.log(2) / math.sqrt(12)


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
