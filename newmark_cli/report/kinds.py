"""Kinds of figures: each says what it needs, what it draws and what that must show.

A new kind is a class with the members of `Figure`, here or in a file of its own; nothing else
needs to know of it.  Nothing here draws: a figure gives a `Sheet`, plain data, see
`newmark_cli.report.panels`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from newmark_cli.errors import ResultsError
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.scaling import PAPER_VARIANTS
from newmark_cli.report import traces
from newmark_cli.report.curves import Curve
from newmark_cli.report.history import History, read_histories
from newmark_cli.report.panels import (
    LOOKS,
    WIDTH,
    Layout,
    Legend,
    Look,
    Panel,
    Sheet,
    Trace,
    look,
    power,
    spread,
)
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.results import history_path

if TYPE_CHECKING:
    from newmark_cli.report.slopes import Slope


@dataclass(frozen=True)
class Results:
    """The data that a figure is made from.

    Attributes:
        folder: Results folder.
        slopes: Series of its CSVs.
        cost: What work is measured by, of `newmark_cli.report.work.COSTS`.
    """

    folder: Path
    slopes: Sequence["Slope"]
    cost: str = "operations"

    @cached_property
    def by_key(self) -> Mapping[SeriesKey, "Slope"]:
        """The series by what a `Curve` finds them by."""
        return {slope.key: slope for slope in self.slopes}

    def series(self, figure: "Figure") -> list["Slope"]:
        """Series of a figure, in the order of its curves.

        Raises:
            ResultsError: When the results lack one.
        """
        missing = [curve.label for curve in figure.curves if curve.key not in self.by_key]
        if missing:
            raise _lacks(self.folder / f"{figure.study}.csv", figure, missing)
        return [self.by_key[curve.key] for curve in figure.curves]


def _lacks(path: Path, figure: "Figure", missing: Iterable[str]) -> ResultsError:
    return ResultsError(
        f"{path}: figure {figure.name} needs {', '.join(dict.fromkeys(missing))}; "
        f"run 'newmark-study run {figure.study}' again"
    )


class Figure(Protocol):
    """Members of every kind of figure."""

    @property
    def name(self) -> str:
        """Number, or a word; names its files."""

    @property
    def title(self) -> str:
        """The curves or cells that it shows."""

    @property
    def study(self) -> str:
        """Study that gives what it needs."""

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Series of the CSV that it draws."""

    @property
    def tolerance(self) -> float | None:
        """Largest |fitted − predicted slope| of its series; None for that of their measure."""

    @property
    def in_paper(self) -> bool:
        """Whether its series are the claims of the paper."""

    def require(self, results: Results) -> None:
        """See whether it is drawn where nobody asks for it by name.

        Raises:
            ResultsError: When the results are not enough; says what is missing.
        """

    def sheet(self, results: Results) -> Sheet:
        """Its panels.

        Raises:
            ResultsError: When the results lack what it draws.
        """


@dataclass(frozen=True)
class OrderFigure:
    """A quantity against the step size on logarithmic axes, a series for each variant.

    Attributes:
        name: Number in the paper, or a word.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, form, quantity, measure: Which rows.
        tolerance: Largest |fitted − predicted slope|.
        variants: Series, in the order of the legend.
    """

    name: str
    title: str
    study: str
    problem: str
    form: str
    quantity: str
    measure: str
    tolerance: float
    variants: tuple[str, ...] = PAPER_VARIANTS
    in_paper: ClassVar[bool] = True

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series."""
        return variants(
            self.study, self.problem, self.quantity, self.measure, self.variants, form=self.form
        )

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """One panel, fitted slopes in the legend, predicted ones as lines."""
        return traces.single(self.title, self.curves, results.series(self))


@dataclass(frozen=True)
class MechanismFigure:
    """A mechanism in its initial position; read from the problem's definition.

    Attributes:
        name: Number in the paper, or a word.
        title: What it shows.
        study: A study of this mechanism.
        problem: Which mechanism.
    """

    name: str
    title: str
    study: str
    problem: str
    curves: ClassVar[tuple[Curve, ...]] = ()
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    def require(self, results: Results) -> None:
        """A series of any study of this mechanism: no stranger's results are about it."""
        if all(slope.problem != self.problem for slope in results.slopes):
            raise ResultsError(
                f"{results.folder}: figure {self.name}: no results of {self.problem}; "
                f"run 'newmark-study run {self.study}' first"
            )

    def sheet(self, results: Results) -> Sheet:
        """The mechanism, whatever the results are."""
        from newmark_cli.mechanisms.registry import picture
        from newmark_cli.report.draw_mechanism import mechanism_sheet

        subject = picture(self.problem)
        return mechanism_sheet(self.title, subject, subject.u0)


@dataclass(frozen=True)
class SensitivityFigure:
    """Sensitivities to each row block, a panel for each row block and unknown.

    Attributes:
        name: A word.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, form: Which rows.
        tolerance: Largest |fitted − predicted slope|.
        variants: Series of each panel.
        measure: Which rows.
    """

    name: str
    title: str
    study: str
    problem: str
    form: str
    tolerance: float
    variants: tuple[str, ...] = ("none", "optimal")
    measure: str = "sensitivity"
    in_paper: ClassVar[bool] = False

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel."""
        form = FORMS[self.form]
        return tuple(
            curve
            for unknown, row in product(form.unknowns, form.rows)
            for curve in variants(
                self.study, self.problem, unknown, self.measure, self.variants,
                form=self.form, row_block=row, initial="start",
            )
        )  # fmt: skip

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """A small panel for each unknown (down) and row block (across)."""
        form, series = FORMS[self.form], results.series(self)
        most = len(self.variants)
        return Sheet(
            self.title,
            tuple(
                self._panel(
                    series[k * most : (k + 1) * most],
                    title=f"row {row} perturbed" if unknown == form.unknowns[0] else "",
                    labelled=row == form.rows[0],
                )
                for k, (unknown, row) in enumerate(product(form.unknowns, form.rows))
            ),
            columns=len(form.rows),
            layout=Layout(
                (2 * WIDTH, 1.35 * len(form.unknowns) + 0.6), (0.085, 0.105, 0.9, 0.805),
                gaps=(0.3, 0.12),
            ),
            ticks=(6, 5),
            minor_ticks=False,
            grid=False,
            settings={
                "font.size": 6, "axes.titlesize": 7, "axes.labelsize": 7, "legend.fontsize": 6.5,
                "legend.borderpad": 0.4, "legend.columnspacing": 2.0,
            },
        )  # fmt: skip

    def _panel(self, series: Sequence["Slope"], title: str, labelled: bool) -> Panel:
        # With two variants their looks differ most.
        looks = (LOOKS[0], LOOKS[3]) if len(series) == 2 else [*map(look, range(len(series)))]
        return Panel(
            tuple(
                traces.trace(
                    slope, variant, own, size=0.6, fit=_three_decimals(slope), ascending=False
                )
                for slope, variant, own in zip(series, self.variants, looks, strict=True)
            ),
            "$h$ (s)",
            series[0].record.label(series[0].key) if labelled else "",
            title,
            y_limits=spread([slope.values for slope in series], headroom=0.4),
            references=tuple(line for slope in series for line in traces.through(slope)),
            fits=True,
            tell_zeros=False,
        )


def _three_decimals(slope: "Slope") -> str:
    """Slope of values that hardly scatter; a block that a problem lacks is zero."""
    if not np.any(slope.values > 0):
        return "exactly 0"
    return f"{round(slope.fit.slope, 3) + 0.0:.3f}".replace("-", "−")


@dataclass(frozen=True)
class StudyFigure:
    """Series of a study past the paper against the step size, and what they must show.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV it reads.
        curves: Series of one quantity and measure, in the order of the legend.
        linear: Whether the ordinate is linear, from zero.
        note: What the legend says above the series.
    """

    name: str
    title: str
    study: str
    curves: tuple[Curve, ...]
    linear: bool = False
    note: str = ""
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """One panel, fitted slopes in the legend, predicted ones as lines."""
        return traces.single(self.title, self.curves, results.series(self), self.linear, self.note)


@dataclass(frozen=True)
class PrecisionFigure:
    """Corrections in two precisions, a panel for each unknown, and what they must show.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV it reads.
        problem, integrator, form: Which rows are drawn; the claim holds for every form.
        factor: How far the quotient of the precisions may be from that of their unit roundoffs.
        variants: Series of each panel and precision.
        precisions: The two, their unit roundoffs 2^29 apart.
    """

    name: str
    title: str
    study: str
    problem: str
    integrator: str
    form: str
    factor: float
    variants: tuple[str, ...] = PAPER_VARIANTS
    precisions: tuple[str, str] = ("float32", "float64")
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its series, panel by panel and in each panel precision by precision."""
        return self._of_form(self.form)

    def _of_form(self, form: str) -> tuple[Curve, ...]:
        return tuple(
            Curve(
                f"{variant}, {precision}", self.study, self.problem, unknown, "correction",
                form=form, preconditioning=variant, integrator=self.integrator,
                precision=precision,
            )
            for unknown in FORMS[form].unknowns
            for precision in self.precisions
            for variant in self.variants
        )  # fmt: skip

    def require(self, results: Results) -> None:
        """All series."""
        results.series(self)

    def sheet(self, results: Results) -> Sheet:
        """A panel for each unknown, one below the other; the precisions share their looks."""
        series, unknowns = results.series(self), FORMS[self.form].unknowns
        most = len(self.precisions) * len(self.variants)
        return Sheet(
            self.title,
            tuple(
                self._panel(
                    self.curves[k * most : (k + 1) * most], series[k * most : (k + 1) * most]
                )
                for k in range(len(unknowns))
            ),
            legend=Legend(columns=len(self.variants), centre=0.56),
            layout=Layout(
                (WIDTH, 0.75 + 1.75 * len(unknowns)), (0.165, 0.155, 0.815, 0.79), gaps=(0.0, 0.06)
            ),
            ticks=(10, 10),
            settings={
                "legend.handlelength": 2.6, "legend.borderpad": 0.4, "legend.columnspacing": 1.0,
            },
        )  # fmt: skip

    def _panel(self, curves: Sequence[Curve], series: Sequence["Slope"]) -> Panel:
        label = series[0].record.label(series[0].key)
        return Panel(
            tuple(
                traces.trace(
                    slope,
                    curve.preconditioning,
                    look(self.variants.index(curve.preconditioning)),
                    size=0.8,
                    fit="",
                    name=curve.label,
                )
                for curve, slope in zip(curves, series, strict=True)
            ),
            traces.step_label(self.problem),
            label.removeprefix("last decreasing "),
            y_limits=spread([slope.values for slope in series], headroom=0.06),
            x_room=0.17,
            names=tuple(
                name
                for precision in self.precisions
                for name in traces.beside(
                    precision, [slope for slope in series if slope.precision == precision]
                )
            ),
        )


@dataclass(frozen=True)
class HistoryFigure:
    """A multiplier over time, in the range of the solution and in its own.

    Of the multipliers the one is drawn that is largest in the last curve.

    Attributes:
        name: Number, after the paper's.
        title: What it shows.
        study: Study whose CSV and time series it reads.
        h: Step size (s).
        curves: Which cells; their largest |λ| are what claims read.
    """

    name: str
    title: str
    study: str
    h: float
    curves: tuple[Curve, ...]
    tolerance: ClassVar[float | None] = None
    in_paper: ClassVar[bool] = False

    def histories(self, folder: Path) -> list[History]:
        """Its time series, in the order of its curves.

        Raises:
            ResultsError: When the results lack one.
        """
        found = read_histories(folder, self.study, self.curves, self.h)
        given = [history for history in found if history is not None]
        if len(given) < len(found):
            missing = [c.label for c, there in zip(self.curves, found, strict=True) if not there]
            raise _lacks(history_path(folder, self.study), self, missing)
        return given

    def require(self, results: Results) -> None:
        """All time series."""
        self.histories(results.folder)

    def sheet(self, results: Results) -> Sheet:
        """Above in the range of the last curve, below as far as any goes."""
        histories = self.histories(results.folder)
        component = int(np.argmax(np.max(np.abs(histories[-1].multipliers), axis=0)))
        series = tuple(
            Trace(
                curve.label,
                history.t,
                1e-3 * history.multipliers[:, component],
                _over_time(place),
                said=f"{curve.label}: |λ| up to {np.max(np.abs(history.multipliers)):.3g}",
            )
            for place, (curve, history) in enumerate(zip(self.curves, histories, strict=True))
        )
        span = float(np.ptp(series[-1].y))
        zoomed = Panel(
            series,
            "time $t$ (s)",
            rf"$\lambda_{component + 1}$ (kN/m)",
            x_scale="linear",
            y_scale="linear",
            y_limits=_around(series[-1:], 0.25),
        )
        whole = replace(
            zoomed,
            traces=tuple(replace(trace, said="") for trace in series),
            y_scale="symlog",
            y_limits=_around(series, 0.05),
            linthresh=10.0 ** math.floor(math.log10(span)) if span > 0 else 1.0,
        )
        step = power("10", f"{math.log10(self.h):.0f}")
        return Sheet(
            self.title,
            (zoomed, whole),
            legend=Legend(f"$h$ = {step} s; pairs of successive steps", 1, centre=0.56),
            layout=Layout((WIDTH, 4.4), (0.165, 0.24, 0.8, 0.71), gaps=(0.0, 0.08)),
            settings={"legend.handlelength": 2.6},
        )


#: Curves over time; the first alternates from step to step, the last two coincide.
_OVER_TIME = (
    Look("#D55E00", ".", 1.2, linewidth=0.4, alpha=0.7),
    Look("#56B4E9", linewidth=2.6),
    Look("#000000", linewidth=0.8, linestyle="--"),
)


def _over_time(place: int) -> Look:
    if place < len(_OVER_TIME):
        return _OVER_TIME[place]
    return Look(look(place).color, linewidth=0.8, linestyle=look(place).linestyle)


def _around(series: Sequence[Trace], margin: float) -> tuple[float, float]:
    """Ends of an ordinate around all values, with room on either side as a share of their span."""
    low = min(float(np.min(trace.y)) for trace in series)
    high = max(float(np.max(trace.y)) for trace in series)
    return low - margin * (high - low), high + margin * (high - low)


def variants(
    study: str,
    problem: str,
    quantity: str,
    measure: str,
    variants: tuple[str, ...] = PAPER_VARIANTS,
    **columns: str,
) -> tuple[Curve, ...]:
    """A series for each variant of the scaling, named by it."""
    return tuple(
        Curve(variant, study, problem, quantity, measure, preconditioning=variant, **columns)
        for variant in variants
    )
