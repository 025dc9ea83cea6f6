"""Measures as records: what each asks of a case, and what is known of its rows.

A `Measure` is what a config names.  Its observer, of `newmark_cli.study.observers`, gives rows of
the CSV, each with one of its `Record`: what that row's values are called, which statistic is
drawn and fitted, which order theory predicts, and how two results are compared.  Everything
that deals with measures loops over `MEASURES`; another one is an entry here and one there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark import integrator, integrator_labels, steps
from newmark_cli.newmark.forms import MULTIPLIERS, Form
from newmark_cli.newmark.formulation import CONSTRAINTS, Formulation, Projection, formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.kept import ENERGY, KEPT, OUTPUT
from newmark_cli.newmark.linear.choice import GMRES
from newmark_cli.newmark.orders import FormOrders, form_orders
from newmark_cli.newmark.scaling import Preconditioning, Scaling
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.newmark.truncation import Marched
from newmark_cli.study.axes import SATURATION, SeriesKey, value_text
from newmark_cli.study.axis import GIVEN_BY
from newmark_cli.study.cell import DRIFTS, OVER_MOTION, WINDOWED
from newmark_cli.support.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

#: Symbols of quantities in labels of axes, as mathtext has them.
_MATH = {
    "lambda": r"\lambda", "eta": r"\eta", ENERGY: "E", "omega": r"\omega",
}  # fmt: skip
#: Quantities without a symbol.
_WORDS = ("force", "moment", OUTPUT)
_MATH |= {word: rf"\mathrm{{{word}}}" for word in _WORDS}


def symbol(quantity: str) -> str:
    """A quantity in the field's symbols."""
    return value_text("quantity", quantity)


def _math(quantity: str) -> str:
    return _MATH.get(quantity, quantity)


#: Problems of unit mass, length and gravity; all others are in SI units.
_DIMENSIONLESS = ("pendulum", "chain")


def is_dimensionless(problem: str) -> bool:
    """Whether a problem's values have no units; of all others they are in SI units."""
    return problem.partition("(")[0] in _DIMENSIONLESS


#: Quantities that are multipliers, or reactions, which are linear in them.
OF_MULTIPLIERS = ("lambda", "multiplier", "force", "moment")
#: Errors of outputs → what their errors are of.  Names of outputs end in these and an axis.
OF_OUTPUTS: Mapping[str, str] = MappingProxyType(
    {"omega": "v", "force": "lambda", "moment": "lambda"}
)


def kind_of(output: str) -> str:
    """Kind of an output, such as ``force`` of ``A.force.x``; empty of a point's ``force.x``."""
    _, dot, kind = output.rpartition(".")[0].rpartition(".")
    return kind if dot else ""


#: Quantities of the rows of trajectories.
OF_TRAJECTORIES = (*KEPT, ENERGY, OUTPUT, *DRIFTS)
#: What is measured → its prediction.
FLOOR_OF: Mapping[str, str] = MappingProxyType(
    {"correction": "floor", "physical_correction": "physical_floor"}
)


def _unpredicted(key: SeriesKey) -> float:
    return np.nan


@dataclass(frozen=True)
class Record:
    """One kind of row: a value of the CSV's column ``measure``."""

    name: str  #: as in the CSV
    text: Callable[[SeriesKey], str]  #: what the row measures, in the field's symbols, from its key
    label: Callable[[SeriesKey], str]  #: label of the ordinate, from its key, as mathtext
    statistic: str  #: column that is drawn and fitted
    #: order of the statistic in h, from the series' key; NaN where theory says nothing
    predicted: Callable[[SeriesKey], float] = _unpredicted
    tolerance: float = np.nan  #: largest |fitted − predicted|, unless a figure sets its own
    tolerance_at_start: float | None = None  #: the same at the initial state
    #: what rules the values: ``rounding``, scattered from step to step; ``truncation``, down to a
    #: floor of rounding; or ``determined``, smooth in h
    kind: str = "determined"
    ok: tuple[str, ...] = ("ok",)  #: statuses of a cell with which its value counts
    linear: bool = False  #: whether its ordinate is linear, from zero
    share: bool = False  #: whether the statistic counts steps, and is drawn as a share of them
    may_vanish: bool = False  #: whether exact zeros at every h are within any order
    #: statistic that is drawn where a Krylov solver has stagnated, if another
    at_limit: str | None = None
    at_end: bool = False  #: whether it is taken at t_end, so that all of a series must end together
    #: why the predicted order is only a lower bound, from the key; empty where it is the order
    bounded: Callable[[SeriesKey], str] = lambda key: ""
    #: orders that may show while h is too coarse, from the key
    coarse: Callable[[SeriesKey], tuple[float, ...]] = lambda key: ()
    quantities: tuple[str, ...] = ()  #: what the rows may be about, as in the CSV

    def drawn(self, rows: "pd.DataFrame | Mapping[str, Sequence[Any]]") -> Array:
        """Values as they are drawn and fitted, one for each row of a study's CSV."""
        values = np.asarray(rows[self.statistic], float)
        if self.share:
            values = values / np.asarray(rows["steps"], float)
        if self.at_limit is not None:
            stagnated = np.asarray(rows["status"], object) == "stagnated"
            values = np.where(stagnated, np.asarray(rows[self.at_limit], float), values)
        return np.asarray(values, float)

    @staticmethod
    def alternates(key: SeriesKey) -> bool:
        """Whether an error of a series may alternate undamped from step to step."""
        march = _march_of(key)
        # Rows of accelerations keep an alternation out.
        kept_out = {"Ca", "B"} & set(march.formulation.kind.rows)
        return not (march.integrator.damped or march.projection.level or kept_out)

    @staticmethod
    def fading(key: SeriesKey) -> float:
        """What each step of a series leaves of an alternation of multipliers from the start."""
        march = _march_of(key)
        # Constraints of velocities, where they hold, keep an alternation out.
        kept_out = not march.by_position or march.projection.level or not march.integrator.damped
        return 0.0 if kept_out else integrator.fading(march.integrator)

    @property
    def predicts(self) -> bool:
        """Whether theory says anything of such rows."""
        return self.predicted is not _unpredicted


@dataclass(frozen=True)
class Measure:
    """A measure, as a config names it."""

    name: str  #: as in configs
    about: str  #: what it records, for the docs
    records: tuple[Record, ...]  #: kinds of rows that it gives
    along_steps: bool = True  #: whether it needs steps; else it can be taken at the initial state
    #: whether Newton must stop at a tolerance (True), or where rounding stops it (False); None
    #: where it does not matter
    stop: bool | None = None
    solvers: tuple[str, ...] = ()  #: linear solvers that it is about; any when empty
    #: whether it is taken at t_end, which must then be a whole number of steps
    at_end: bool = False
    twins: bool = False  #: whether twins of the march tell the rounding of its rows


_form = cache(formulated)


def _form_of(key: SeriesKey) -> Form:
    """The form of a series, with the rows and multipliers of its formulation."""
    return _form(key.form, key.formulation)


@cache
def _orders(form: str, formulation: str, compensated: bool) -> FormOrders:
    return form_orders(_form(form, formulation), compensated=compensated)


def _orders_of(key: SeriesKey) -> FormOrders:
    return _orders(key.form, key.formulation, key.evaluation == COMPENSATED)


@cache
def _scaling_of(key: SeriesKey) -> Scaling:
    return Preconditioning.parse(key.preconditioning).scaling(_form_of(key))


@cache
def _march_of(key: SeriesKey) -> Marched:
    return Marched(
        integrator_labels.parse(key.integrator),
        Formulation.parse(key.formulation),
        Projection.parse(key.projection),
        key.multipliers,
        key.start,
        key.evaluation == COMPENSATED,
        steps.parse(key.h_sequence),
        key.auxiliary,
    )


def _bound_of_correction(key: SeriesKey) -> str:
    if "B" in _form_of(key).rows and key.evaluation != COMPENSATED:
        # Once u rests on a rounded number, a and λ make the sum vanish for that number.
        return "α²Φ changes by whole roundings of u, or not at all"
    return _orders_of(key).bounded.get(key.quantity, "")


def _order_of_correction(key: SeriesKey) -> float:
    if key.stop != SATURATION or not _march_of(key).settles:
        return np.nan  # Newton does not end where rounding stops it
    return _orders_of(key).physical_corrections()[key.quantity] - _order_of_unit(key)


def _order_of_unit(key: SeriesKey) -> float:
    """Order of what a correction is divided by: scaled ones by their factor in D_R."""
    return _scaling_of(key).right[key.quantity].order() if key.measure == "correction" else 0


def _order_of_forces(key: SeriesKey) -> tuple[float]:
    return (_orders_of(key).of_forces(key.quantity) - _order_of_unit(key),)


def _orders_of_entries(key: SeriesKey) -> tuple[float, ...]:
    """Orders of C while entries that do not rule for h → 0 are still the largest of J̄ and J̄⁻¹."""
    jacobian, inverse = _orders_of(key).scaled(_scaling_of(key))
    products = {float(a + b) for a in jacobian.ravel() for b in inverse.ravel()}
    return tuple(sorted(order for order in products if np.isfinite(order)))


def _scaled_and_physical(name: str, text: str, label: str, **others: Any) -> tuple[Record, Record]:
    """Records of corrections in the solver's unknowns, and in physical units."""

    def in_units(key: SeriesKey) -> str:
        scaled = key.measure == name or is_dimensionless(key.problem)
        return "(rms)" if scaled else "(rms, SI\u00a0units)"

    def record(name: str, of_unit: str, mark: str) -> Record:
        return Record(
            name,
            lambda key: f"{text}Δ{symbol(key.quantity)}{of_unit}",
            lambda key: rf"{label} $\|\Delta{mark} {_math(key.quantity)}\|$ {in_units(key)}",
            "rms",
            kind="rounding",
            quantities=(*FIELDS, *MULTIPLIERS),
            **others,
        )

    return record(name, "", r"\bar"), record(f"physical_{name}", " (physical)", "")


def _order_of_sensitivity(key: SeriesKey) -> float:
    form = _form_of(key)
    _, inverse = _orders_of(key).scaled(_scaling_of(key))
    return float(inverse[form.solved.index(key.quantity), form.rows.index(key.row_block)])


def _bound_of_sensitivity(key: SeriesKey) -> str:
    form, orders = _form_of(key), _orders_of(key)
    place = form.solved.index(key.quantity), form.rows.index(key.row_block)
    # In index 3 a block that may be smaller is 0 there.
    if form.formulation == CONSTRAINTS.label or orders.special[place] == orders.inverse[place]:
        return ""
    return "blocks are smaller at rest, without damping, or with P = M⁻¹G"


def _ratio(quantity: str) -> str:
    """What an error is, as mathtext; norms of λ weigh its constraints."""
    name = _math(quantity)
    if quantity == "lambda":
        return rf"\|\Delta {name}\| \,/\, \|{name}\|"
    # The label of a word may have to be broken here.
    between = r"$ $" if quantity in _WORDS else ""
    return rf"\max|\Delta {name}| \,/\, {between}\max|{name}|"


def _order_of_drift(key: SeriesKey) -> float:
    march = _march_of(key)
    if not march.formulated or key.stop != SATURATION:
        return np.nan
    return march.drift(key.quantity)


#: Labels of drifts, as mathtext.
DRIFT_LABELS = {
    "position": r"$|\Phi_k|/\|G_k\|$ (m)",
    "velocity": r"$|(G^T v + \Phi_t)_k|/\|G_k\|$ (m/s)",
}


def _over_time(name: str, quantities: tuple[str, ...]) -> Record:
    return Record(
        name,
        lambda key: f"{symbol(key.quantity)} over time",
        lambda key: (
            "largest " + DRIFT_LABELS.get(key.quantity, rf"$|{_math(key.quantity)}|$ along the way")
        ),
        "max",
        quantities=quantities,
    )


_WITH_ERRORS = ("u", "v", "lambda", *OF_OUTPUTS)


def _over_motion(name: str, where: str, since_start: bool) -> Record:
    def predicted(key: SeriesKey) -> float:
        return _march_of(key).largest_error(OF_OUTPUTS.get(key.quantity, key.quantity), since_start)

    def bound(key: SeriesKey) -> str:
        multipliers = key.quantity in OF_MULTIPLIERS
        low = multipliers and since_start and predicted(key) < _march_of(key).order
        return "where Gᵀu‴ = 0 at the start, λ keeps its order" if low else ""

    return Record(
        name,
        lambda key: f"error of {symbol(key.quantity)} {where}",
        lambda key: f"largest error {where}, ${_ratio(key.quantity)}$",
        "max",
        predicted,
        0.2,
        kind="truncation",
        bounded=bound,
        quantities=_WITH_ERRORS,
    )


_MEASURES = (
    Measure(
        "correction",
        "the last decreasing Newton corrections, scaled and physical",
        _scaled_and_physical(
            "correction",
            "",
            "last decreasing correction",
            predicted=_order_of_correction,
            tolerance=0.15,
            bounded=_bound_of_correction,
            coarse=_order_of_forces,
        ),
        stop=False,
    ),
    Measure(
        "condition",
        "condition number of the scaled Jacobian",
        (
            Record(
                "condition",
                lambda key: symbol(key.quantity),
                lambda key: r"condition number $C = \|\bar J\|\,\|\bar J^{-1}\|$",
                "median",
                lambda key: _orders_of(key).condition(_scaling_of(key)),
                # Condition numbers are not noisy; along a run they still vary with the motion.
                0.05,
                0.02,
                coarse=_orders_of_entries,
                quantities=("jacobian",),
            ),
        ),
        along_steps=False,
    ),
    Measure(
        "sensitivity",
        "change of each unknown for a perturbation of each row of the residual",
        (
            Record(
                "sensitivity",
                lambda key: f"∂{symbol(key.quantity)}/∂b_{key.row_block}",
                lambda key: rf"$\|\delta\bar {_math(key.quantity)}\|/\varepsilon$",
                "median",
                _order_of_sensitivity,
                0.15,
                0.05,
                may_vanish=True,
                bounded=_bound_of_sensitivity,
                quantities=(*FIELDS, *MULTIPLIERS),
            ),
        ),
        along_steps=False,
    ),
    Measure(
        "error",
        "relative errors of u, v, λ at `t_end`, in space also of angular velocities, reaction "
        "forces and moments: against the exact motion (pendulum), the published one (andrews, "
        "t = 0.03), or one that is computed from the index-1 equations at high order, kept in "
        "`results/references/` with an estimate of its own error; with the key `error` also the "
        "largest errors over the motion, or over a window of it",
        (
            Record(
                "error",
                lambda key: f"error of {symbol(key.quantity)}",
                lambda key: f"error at the end, ${_ratio(key.quantity)}$",
                "last",
                lambda key: _march_of(key).error(OF_OUTPUTS.get(key.quantity, key.quantity)),
                0.2,
                kind="truncation",
                at_end=True,
                quantities=_WITH_ERRORS,
            ),
            _over_motion(OVER_MOTION, "over the motion", since_start=True),
            _over_motion(WINDOWED, "in a window", since_start=False),
        ),
        at_end=True,
        twins=True,
    ),
    Measure(
        "invariant",
        "what an exact motion keeps, along the way: constraints, their rate, λ against what u and "
        "v imply, and the energy where it is conserved",
        (
            Record(
                "invariant",
                lambda key: f"invariant: {symbol(key.quantity)}",
                lambda key: f"largest error of the invariant: {symbol(key.quantity)}",
                "max",
                _order_of_drift,
                0.2,
                kind="truncation",
                quantities=("position", "velocity", "multiplier", "energy"),
            ),
        ),
        twins=True,
    ),
    Measure(
        "krylov",
        "iterations and achieved residual of every linear solve",
        (
            Record(
                "krylov_iterations",
                lambda key: "Krylov iterations",
                lambda key: "iterations per linear solve (median)",
                "median",
                linear=True,
                at_limit="max",
                quantities=("jacobian",),
            ),
            Record(
                "krylov_residual",
                lambda key: "Krylov residual",
                lambda key: "largest relative residual of a linear solve",
                "max",
                kind="rounding",
                quantities=("jacobian",),
            ),
        ),
        solvers=(GMRES,),
    ),
    Measure(
        "tolerance",
        "with `stop`: Newton's iterations in each step, and how many steps met it",
        (
            Record(
                "tolerance",
                lambda key: "share of steps",
                lambda key: "share of steps that meet the tolerance",
                "met",
                # A step that misses its tolerance is what this is about.
                ok=("ok", "not_converged"),
                kind="rounding",
                linear=True,
                share=True,
                quantities=("newton",),
            ),
        ),
        stop=True,
    ),
    Measure(
        "trajectory",
        "u, v, a, λ, the energy, reactions and angular velocities in space, and how far the "
        "constraints and their rate are missed (m, m/s), over time, by name, into "
        "`results/trajectory/<study>.csv`; the key `trajectory` says what, and at which steps",
        (_over_time("trajectory", OF_TRAJECTORIES),),
    ),
    Measure(
        "floor",
        "expected size of the last decreasing Newton corrections, from steps off by rounding at "
        "sampled states",
        _scaled_and_physical("floor", "predicted ", "predicted floor of"),
        stop=False,
    ),
)
#: Measures by name, in the order of a cell's rows.
MEASURES: Mapping[str, Measure] = MappingProxyType({of.name: of for of in _MEASURES})
for _measure in _MEASURES:
    for _record in _measure.records:
        GIVEN_BY.setdefault(_record.name, []).append(_measure.name)

#: Records that only CSVs of versions before 0.4 have.
FORMER = (
    _over_time("history", ("lambda", *OF_OUTPUTS, ENERGY)),
    _over_time("drift", DRIFTS),
    Record(
        "transient",
        lambda key: f"error of {symbol(key.quantity)} after a change",
        lambda key: f"error after a change of $h$, ${_ratio(key.quantity)}$",
        "max",
        kind="truncation",
        quantities=("u", "v", "lambda"),
    ),
)
#: Records by name, as the CSV's column ``measure`` has them.
RECORDS: Mapping[str, Record] = MappingProxyType(
    {r.name: r for measure in MEASURES.values() for r in measure.records}
    | {record.name: record for record in FORMER}
)
#: Those that a study can have.
RECORDED = tuple(record.name for measure in MEASURES.values() for record in measure.records)
