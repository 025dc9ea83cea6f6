"""The axes of a study: what tells cells, rows, series and slopes apart, declared once.

Everything else derives from the declarations: the keys of a config's grid, the order
of its cells, the columns of CSVs, what a kept cell is found by, what names a series,
and how tables, terminals and records spell it.

A new axis is one more field of `Cell` (or of `RowAxes`, for what tells the rows of one
cell apart), besides the code that gives it a meaning; what a config may give along it, where
that is not one of its names, stands in `newmark_cli.study.keys`.
"""

import re
from collections import namedtuple
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from functools import cache, cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

from newmark_cli.newmark import formulation as formulations
from newmark_cli.newmark import integrator as integrators
from newmark_cli.newmark.forms import FORMS, Form
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import Integrator
from newmark_cli.newmark.integrator_labels import plain_label
from newmark_cli.newmark.kept import Kept
from newmark_cli.newmark.linear.choice import AUTO, DENSE, GMRES, LINEAR_SOLVERS, Krylov, choose
from newmark_cli.newmark.scaling import VARIANTS, Preconditioning, canonical
from newmark_cli.newmark.scheme import DIRECT, EVALUATIONS, PRECISIONS, Tolerance
from newmark_cli.newmark.steps import CONSTANT, StepSequence, TimeGrid
from newmark_cli.study.axis import (
    ALIASES,
    GIVEN_BY,
    MULTIPLIERS,
    SYMBOLS,
    TRAPEZOIDAL,
    Axis,
    axes_of,
    axis,
    formulation_label,
    formulation_text,
    integrator_text,
    projection_text,
    setting,
)
from newmark_cli.study.cell import Window

if TYPE_CHECKING:
    from newmark_cli.codes.given_references import ReferenceFile
    from newmark_cli.codes.programs import OtherCode
    from newmark_cli.mechanisms.spec import ProblemSpec

#: Names of studies, and so of their files.
STUDY_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")

SATURATION = "saturation"
#: What this package is called among codes.
OURS = "newmark-study"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One cell's computation; steps = 0 measures at the consistent initial state."""

    problem: "ProblemSpec" = axis(
        since=(0, 1),
        text=lambda label: re.sub(r"\.ya?ml$", "", label),
        about="name of a problem, mechanism file, family with its size, Python factory, or a list",
        shows="the problem, as the config names it",
    )
    integrator: Integrator = axis(
        usual=TRAPEZOIDAL,
        since=(0, 1),
        names=(*integrators.INTEGRATORS, integrators.TRAPEZOIDAL_NAME),
        text=integrator_text,
        plain=plain_label,
        also=lambda label: label.split()[:1],
        default="newmark",
        about="an integrator or a list; default: trapezoidal",
        shows="method and parameters",
    )
    form: str = axis(
        since=(0, 0),
        inner=True,
        names=FORMS,
        text=lambda form: f"({form.replace('-', ', ').replace('lambda', 'λ')}) form",
        about="name of a form, or a list",
        shows="the form, by the unknowns that it keeps",
    )
    preconditioning: Preconditioning = axis(
        same=cache(canonical),
        since=(0, 0),
        inner=True,
        names=VARIANTS,
        text=lambda label: label.partition("[")[0],
        about="variant, scaling of your own, or a list",
        shows="variant, or a scaling of your own with its factors: "
        "`name[left D=…; right lambda=…]`",
        value=lambda given: Preconditioning(given) if isinstance(given, str) else given.value(),
    )
    evaluation: str = axis(
        initial=DIRECT,
        since=(0, 2),
        names=EVALUATIONS,
        about="in the unknowns themselves, or in compensated increments",
        shows="how residuals are evaluated: `direct` or `compensated`",
    )
    precision: str = axis(
        initial="float64",
        since=(0, 2),
        names=PRECISIONS,
        about="arithmetic of the march",
    )
    linear_solver: str = axis(
        "linear solver",
        write=lambda cell: cell.solver,
        usual=DENSE,
        initial=AUTO,
        since=(0, 2),
        names=LINEAR_SOLVERS,
        text=lambda label: label.upper() if label == GMRES else label,
        also=lambda label: (AUTO,),
        about="what solves for the corrections; auto: by size",
        shows="what solves for the corrections; `condition` is in the 2-norm with `dense-lu`, and "
        "with `static-lu` up to 300 unknowns, else estimated in the 1-norm; last bits are the same "
        "on every processor but with `sparse-lu`, and past 120 unknowns, where SuperLU solves for "
        "the start",
    )
    formulation: Formulation = axis(
        initial=formulations.CONSTRAINTS,
        since=(4, 4),
        names=formulations.METHODS,
        text=formulation_text,
        plain=formulation_label,
        about="which constraint rows are solved, a name or a mapping with a parameter, or a list",
        shows="which constraint rows are solved, with the parameter",
    )
    projection: Projection = axis(
        initial=formulations.UNPROJECTED,
        since=(4, 4),
        names=formulations.PROJECTIONS,
        text=projection_text,
        plain=lambda text: (
            text.replace("no projection", "none").replace(" projection", "").replace(" with ", " ")
        ),
        about="what is projected after each step, a name or a mapping, or a list",
        shows="what is projected after each step",
    )
    multipliers: str = axis(
        write=lambda cell: cell.reported,
        usual=formulations.NEWTON,
        initial=AUTO,
        since=(4, 4),
        names=formulations.REPORTED,
        text=lambda label: MULTIPLIERS.get(label, label),
        also=lambda label: (AUTO,),
        about="which λ is reported; auto: recovered after a projection, else newton",
        shows="which λ is reported: `newton`, `recovered` or `total`",
    )
    start: str = axis(
        initial=formulations.CONSISTENT,
        since=(4, 4),
        names=formulations.STARTS,
        text=lambda label: f"{label} start",
        about="velocities that the march starts from",
    )
    stop: Tolerance | None = axis(
        write=lambda cell: cell.stop.label if cell.stop else SATURATION,
        usual=SATURATION,
        initial=None,
        since=(2, 2),
        many=False,
        text=lambda label: (
            label.replace(" ", " tolerance ", 1)
            if label.startswith(("absolute", "relative"))
            else label
        ),
        plain=lambda text: text.removeprefix("tolerance ").replace(" tolerance ", " "),
        about="test that ends Newton's iteration: a tolerance on the scaled correction, on it by "
        "field, or on the residual; default: where rounding stops it",
        shows="what stops Newton: `saturation`, which is rounding, or a test with its limits, such "
        "as `absolute 1e-08`, `residual relative 1e-08`, `lambda relative 0.0001`",
    )
    h_sequence: StepSequence = axis(
        "step sizes",
        initial=CONSTANT,
        since=(6, 4),
        rare=True,
        about="how the step size varies along the march, in multiples of h; default: constant",
        shows="how the step size varies: `constant`, `change 0.5 at 0.5` (once, at a time in s), "
        "`alternate 1.0 0.5 every 5`, `random 0.5 2.0 seed 1`, all in multiples of `h`",
    )
    auxiliary: str = axis(
        initial=integrators.RESCALE_VELOCITY,
        since=(6, 4),
        rare=True,
        names=integrators.AUXILIARY,
        about="what becomes of the integrator's past where the step size changes",
    )
    code: "OtherCode | str" = axis(
        initial=OURS,
        since=(7, 5),
        rare=True,
        about="what computes: newmark-study, or another code by its command, Python function or "
        "table of results",
        shows="what has computed the row: `newmark-study`, or the name of another code",
    )
    h: float = axis(
        series=False,
        since=(0, 0),
        inner=True,
        about="step sizes (s)",
        shows="step size (s; without unit for the pendulum)",
    )
    t_end: float = setting(
        "end of the march, from 0 (s)",
        shows="end of the march as configured (s)",
        column=True,
        since=(0, 0),
        default=None,
    )
    steps: int = setting(
        "steps to take, in place of t_end; 0: measure at the initial state",
        shows="steps taken: whole steps up to `t_end`; 0: measured at the initial state",
        column=True,
        since=(0, 0),
        default=None,
    )
    measure: tuple[str, ...] = setting(
        "what is measured",
        default=("correction", "condition"),
    )
    iteration_cap: int = setting(
        "most Newton corrections in a step",
        initial=50,
    )
    samples: int = setting(
        "most steps at which J is evaluated for condition and sensitivity",
        initial=32,
    )
    twins: int = setting(
        "marches from starts one unit in the last place away, by which the rounding of errors, "
        "invariants and drifts is measured; 0: none",
        initial=0,
        default=3,
    )
    krylov: Krylov | None = setting(
        "when gmres stops",
        initial=None,
    )
    trajectory: Kept | None = setting(
        "which steps `trajectory` keeps, and what of them; default: all",
        initial=None,
    )
    error: Window | None = setting(
        "where `error` looks for the largest errors besides those at t_end: over the motion, or "
        "in a window of it; default: nowhere",
        initial=None,
    )
    reference: "ReferenceFile | None" = setting(
        "table with the solution at the end, in place of one that is computed; columns t, u[…], "
        "v[…], lambda[…], and their relative errors error[u] …",
        initial=None,
    )
    accept: tuple[str, ...] = setting(
        "statuses that cells may end with and not count as failed; not_converging, for series",
        computed=False,
        compare=False,
        initial=(),
    )

    @cached_property
    def computed(self) -> dict[str, Any]:
        """All that its numbers depend on besides its problem's content, as JSON holds it."""

        def plain(value: Any) -> Any:
            if is_dataclass(value) and not isinstance(value, type):
                return asdict(value)
            return list(value) if isinstance(value, tuple) else value

        return {axis.name: plain(axis.write(self)) for axis in cell_axes() if axis.computed}

    @property
    def reported(self) -> str:
        """Which multipliers are reported."""
        return formulations.reported(self.multipliers, self.projection)

    @property
    def formulated(self) -> Form:
        """The form with the rows and multipliers of the formulation."""
        return self.formulation.applied(FORMS[self.form])

    @property
    def solver(self) -> str:
        """The linear solver that is used; the problem's size decides where it may."""
        formulated = formulations.is_formulated(self.formulation, self.projection)
        return choose(
            self.linear_solver, self.problem.load(), self.formulated, formulated, self.precision
        )

    @property
    def reached(self) -> float:
        """Time that the march comes to, from its start (s)."""
        return self.t_end if self.h_sequence == CONSTANT else self.grid(0.0).t(self.steps)

    def grid(self, t0: float) -> TimeGrid:
        """When the steps are, from a time (s)."""
        return TimeGrid.of(self.h_sequence, t0, self.h, self.steps)

    @property
    def weight(self) -> int:
        """Steps, as progress counts them, those of twins included; never zero."""
        return max(self.steps, 1) * (1 + self.twins)


def _of_row(title: str = "", **rest: Any) -> Any:
    return axis(title, **{"since": (0, 0), "cell": False, "computed": False, **rest})


@dataclass(frozen=True)
class RowAxes:
    """Axes that tell the rows of one cell apart; the attributes of a `Measurement`."""

    quantity: str = _of_row(
        text=lambda name: SYMBOLS.get(name, name),
        shows="what the row is about: `u`, `v`, `a`, `lambda`, `eta`, `jacobian`, `newton`, or the "
        "name of an invariant or an output",
    )
    measure: str = _of_row(
        text=lambda name: name.replace("_", " ").replace("work-precision", "work and precision"),
        also=lambda record: GIVEN_BY.get(record, ()),
        shows="what was measured, see the measures",
    )
    role: str = _of_row(
        series=False,
        shows="`primary`: an unknown; `recovered`: an eliminated field, whose correction follows "
        "by the form's weights",
    )
    row_block: str = _of_row(
        "row block",
        usual="",
        since=(1, 1),
        initial="",
        text=lambda row: f"row {row} perturbed",
        shows="perturbed row `D`, `V`, `K` or `C` of a sensitivity; empty otherwise",
    )


#: The study, which every row names first.
STUDY = Axis(
    "study", "study", lambda study: study, since=(0, 0), cell=False, computed=False,
    shows="name of the study",
)  # fmt: skip
#: Whether a series was measured at the initial state, or along a run: the steps say.
INITIAL = Axis(
    "initial", "start", lambda steps: "start" if steps == 0 else "", usual="", column=False,
    cell=False, computed=False,
    text=lambda value: "at the start" if value else "along the motion",
)  # fmt: skip


@cache
def cell_axes() -> tuple[Axis, ...]:
    """Every axis and setting of cells, in the order of the declaration."""
    return axes_of(Cell)


@cache
def row_axes() -> tuple[Axis, ...]:
    """Axes of the rows of one cell."""
    return axes_of(RowAxes)


@cache
def series_axes() -> tuple[Axis, ...]:
    """Axes that tell series apart."""
    every = (STUDY, *cell_axes(), *row_axes(), INITIAL)
    return tuple(axis for axis in every if axis.series)


@cache
def named(name: str) -> Axis:
    """An axis of series by its name, or another name of it."""
    usual = ALIASES.get(name, name)
    return next(axis for axis in series_axes() if axis.name == usual)


def value_text(axis: str, value: str) -> str:
    """A value of an axis as legends and titles have it."""
    return named(axis).text(value)


@cache
def means(axis: str, word: str, value: str) -> bool:
    """See `Axis.means`."""
    return named(axis).means(word, value)


def is_among(series: Any, choice: Mapping[str, Sequence[str]]) -> bool:
    """Whether a series has one of the values of every axis, as people or CSVs write them.

    A series has every axis as an attribute, as in the CSV.  Axes without a value leave the choice
    open; a measure is the kind of its rows.
    """
    return all(
        not words
        or (
            series.measure in words
            if axis == "measure"
            else any(means(axis, word, getattr(series, axis)) for word in words)
        )
        for axis, words in choice.items()
    )


def labels(cell: Cell) -> dict[str, Any]:
    """Labels that tell a cell from others of its study, by column."""
    return {axis.name: axis.write(cell) for axis in cell_axes() if axis.cell}


def described(cell: Cell) -> str:
    """A cell in a line: what tells it from others, without what goes without saying."""
    labels = [(axis.write(cell), axis.usual) for axis in cell_axes() if axis.cell and axis.series]
    parts = [str(label) for label, usual in labels if label != usual]
    return " ".join([*parts, f"h={cell.h:g}", f"steps={cell.steps}"])


def grid(along: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Every combination of `values` of a case, in the order of the CSV."""
    order = [axis.name for axis in cell_axes() if axis.name in along]
    inner = {axis.name for axis in cell_axes() if axis.inner}
    order.sort(key=lambda name: name in inner)
    for combination in product(*(along[name] for name in order)):
        yield dict(zip(order, combination, strict=True))


def values(case: Any) -> dict[str, tuple[Any, ...]]:
    """Axis → values of the cells of a case, of those axes that tell cells apart."""
    return {axis.name: axis.values(case) for axis in cell_axes() if axis.cell}


def _labels() -> Any:
    return namedtuple("_Labels", [axis.name for axis in series_axes()])


class SeriesKey(_labels()):  # type: ignore[misc]
    """Labels that tell a series from all others: every axis of `series_axes` is an attribute.

    All spellings of one value are the same.
    """

    __slots__ = ()

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> "SeriesKey":
        """Key of the series that a row belongs to.

        Args:
            row: Column → value; an axis that is missing has its usual value, and
                ``steps``, where it is given, says whether it was measured at the start.
        """
        labels = []
        for of in series_axes():
            if of is INITIAL and "initial" not in row:
                labels.append(INITIAL.write(row.get("steps", 1)))
            else:
                label = row[of.name] if of.usual is None else row.get(of.name, of.usual)
                labels.append(of.same(str(label)))
        return cls(*labels)

    def named(self) -> dict[str, str]:
        """Axis → value."""
        values: dict[str, str] = self._asdict()
        return values

    def besides(self, *said: str) -> list[str]:
        """Values of the axes that neither go without saying nor are said already."""
        return [
            value
            for axis, value in zip(series_axes(), self, strict=True)
            if axis.name not in said and value and value != axis.usual
        ]


def appended(columns: Iterable[tuple[int, str]]) -> tuple[str, ...]:
    """Columns in the order in which files have them: later ones behind."""
    return tuple(name for _, name in sorted(columns, key=lambda column: column[0]))


def present(
    columns: Iterable[str],
    rows: Sequence[Mapping[str, Any]],
    rare: Collection[str] | None = None,
) -> list[str]:
    """Columns of a CSV but those of rare axes in which every row has the usual value."""
    usual = {
        axis.name: axis.usual for axis in cell_axes() if axis.name in (rare or ()) or axis.rare
    }
    return [
        name
        for name in columns
        if name not in usual or any(row.get(name, usual[name]) != usual[name] for row in rows)
    ]
