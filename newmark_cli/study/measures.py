"""Measures as records: what each asks of a case, observes on a march, and makes known.

A `Measure` is what a config names.  It observes a march and gives rows of the CSV, each
with one of its `Record`: what that row's values are called, which statistic is drawn and
fitted, which order theory predicts, and how two results are compared.  Everything that
deals with measures loops over `MEASURES`; another one is another entry.

The march and the numerical core are imported where they are used: who reads CSVs needs
neither.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from newmark_cli.newmark import integrator, steps
from newmark_cli.newmark.forms import MULTIPLIERS, Form
from newmark_cli.newmark.formulation import CONSTRAINTS, Formulation, Projection, formulated
from newmark_cli.newmark.integrator import FIELDS
from newmark_cli.newmark.kept import DRIFT, ENERGY, KEPT, OUTPUT, Kept
from newmark_cli.newmark.linear.choice import GMRES
from newmark_cli.newmark.orders import FormOrders, form_orders
from newmark_cli.newmark.scaling import Preconditioning, Scaling
from newmark_cli.newmark.scheme import COMPENSATED, Scheme
from newmark_cli.newmark.statistics import Measurement, standard_error, statistics
from newmark_cli.newmark.steps import Change
from newmark_cli.newmark.truncation import Marched
from newmark_cli.study.axes import SATURATION, Cell, SeriesKey, value_text
from newmark_cli.study.cell import DRIFTS
from newmark_cli.support.arrays import Array, IndexArray, Mask

if TYPE_CHECKING:
    import pandas as pd

    from newmark_cli.newmark.invariants import Misfit
    from newmark_cli.newmark.march import March, Stretch
    from newmark_cli.newmark.march_data import State
    from newmark_cli.newmark.trajectory import Trajectory
    from newmark_cli.problems.problem import Outputs, Problem
    from newmark_cli.problems.reference import Reference

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


#: Measure, quantity, role and row block of a row of the CSV.
RowName = tuple[str, str, str, str]
#: Quantity → (samples, k) by how much components of it are off at each sample, with their
#: signs, in the unit of the row, whose statistics are those of the largest of each sample.
Deviations = Mapping[str, Array]


def _at_samples(samples: Mapping[str, Sequence[Array]]) -> Deviations:
    """Deviations of quantities from their samples, of which there may be none."""
    return {name: np.array(off) if off else np.zeros((0, 1)) for name, off in samples.items()}


def _of_largest(measure: str, deviations: Deviations) -> list[Measurement]:
    return [
        Measurement(quantity, measure, "primary", statistics(np.abs(off).max(axis=1)))
        for quantity, off in deviations.items()
    ]


class Observer:
    """Watches one march; this one sees nothing."""

    stops: frozenset[int] = frozenset()  #: steps after which it wants to see the march
    #: steps whose states the march is to record for it on the way, ascending. Only one measure may
    #: have any: each takes all that a stretch has recorded.
    looks: Sequence[int] = ()
    reason: str = ""  #: why the march is to end where it stands; empty as long as it may go on

    def took(self, stretch: "Stretch") -> None:
        """The march took these steps."""

    def sees(self, march: "March") -> None:
        """The march stands at one of the stops, or at its start if it takes no steps."""

    def measured(self) -> list[Measurement]:
        """Rows of the CSV, once the march is over."""
        return []

    @property
    def deviations(self) -> Deviations:
        """What its rows are about, of a measure that twins march for."""
        return {}

    def unresolved(self, quantity: str) -> float:
        """By how much what a quantity deviates from may be off itself."""
        return 0.0

    @property
    def trajectory(self) -> Mapping[str, Array | IndexArray]:
        """Column of the file of trajectories → (k,) values at the steps that were kept."""
        return {}


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
    #: whether an error may alternate undamped from step to step, from the key
    alternates: Callable[[SeriesKey], bool] = lambda key: _alternates(key)
    #: what each step leaves of an alternation of multipliers from the start, from the key
    fading: Callable[[SeriesKey], float] = lambda key: _fading(key)
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
    #: observer of one march, from the cell, the march and the solution at its end
    observe: Callable[[Cell, "March", "Reference | None"], Observer]
    along_steps: bool = True  #: whether it needs steps; else it can be taken at the initial state
    #: whether Newton must stop at a tolerance (True), or where rounding stops it (False); None
    #: where it does not matter
    stop: bool | None = None
    solvers: tuple[str, ...] = ()  #: linear solvers that it is about; any when empty
    #: whether it is taken at t_end, which must then be a whole number of steps
    at_end: bool = False
    reference: bool = False  #: whether it needs the solution at the end
    twins: bool = False  #: whether twins of the march tell the rounding of its rows
    #: measure, quantity, role and row block of every row that a cell of a form has of it, in their
    #: order; of all quantities of its records if omitted, and None where these have none
    rows: Callable[[Form], Sequence[RowName]] | None = None

    def __post_init__(self) -> None:
        names = tuple((r.name, q, "primary", "") for r in self.records for q in r.quantities)
        if self.rows is None and names:
            object.__setattr__(self, "rows", lambda form: names)


def sample_steps(steps: int, samples: int) -> IndexArray:
    """Up to ``samples`` evenly spread steps, counted from 1, the last among them."""
    return np.unique(np.round(np.linspace(0, steps, min(steps, samples) + 1)[1:]).astype(np.int64))


def _sampled(cell: Cell) -> frozenset[int]:
    return frozenset(sample_steps(cell.steps, cell.samples).tolist())


# -- correction -------------------------------------------------------------------------------


class _Corrections(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self._march = march
        self._norms = [np.zeros((0, len(march.scheme.recorded)))]
        self._iterations = [np.zeros(0, np.int64)]

    def took(self, stretch: "Stretch") -> None:
        self._norms.append(stretch.norms)
        self._iterations.append(stretch.iterations)

    def measured(self) -> list[Measurement]:
        norms, iterations = np.concatenate(self._norms), np.concatenate(self._iterations)
        return corrections(self._march.schemes.base, norms, iterations, self._physical(norms))

    def _physical(self, norms: Array) -> Mapping[str, Array]:
        """`physical_norms`, by the scheme of each step."""
        schemes, grid = self._march.schemes, self._march.grid
        if not grid.varies:
            return physical_norms(schemes.base, norms)
        kinds, which = np.unique(grid.kinds(np.arange(1, len(norms) + 1)), return_inverse=True)
        physical: dict[str, Array] = {}
        for number, kind in enumerate(kinds.tolist()):
            of_kind = physical_norms(schemes.of_kind(kind), norms[which == number])
            for name, values in of_kind.items():
                physical.setdefault(name, np.empty(len(norms)))[which == number] = values
        return physical


def physical_norms(scheme: Scheme, norms: Array) -> dict[str, Array]:
    """Norms of corrections in physical units: D_R times the scaled ones.

    An eliminated field's follows from the weights of the form, one kept field each.  Norms are
    (steps, k), of the blocks that `Scheme.recorded` names.
    """
    form = scheme.form
    right = dict(zip(form.unknowns, scheme.right, strict=True))
    physical = {
        name: right.get(name, 1.0) * of_block
        for name, of_block in zip(scheme.recorded, norms.T, strict=True)
    }
    for eliminated in set(form.eliminated) - set(physical):
        weights = np.abs(scheme.elimination.weights[FIELDS.index(eliminated)])
        source = int(np.argmax(weights))
        physical[eliminated] = weights[source] * physical[form.kept[source]]
    return physical


def corrections(
    scheme: Scheme,
    norms: Array,
    iterations: IndexArray,
    physical: Mapping[str, Array] | None = None,
) -> list[Measurement]:
    """Measurements of the recorded Newton corrections.

    Norms are (steps, k), of the blocks that `Scheme.recorded` names, with their `physical_norms`
    where the scheme is not that of all steps; steps with a negative count of iterations (steps,)
    did not converge and are left out.
    """
    physical = physical_norms(scheme, norms) if physical is None else physical
    form, counted = scheme.form, iterations > 0
    scaled = dict(zip(scheme.recorded, norms.T, strict=True))
    rows = []
    for measure, quantity, role, _ in _rows_of_corrections(form):
        values = (scaled if measure == "correction" else physical)[quantity][counted]
        of_steps = replace(statistics(values), rounding=standard_error(values))
        rows.append(Measurement(quantity, measure, role, of_steps))
    return rows


def _rows_of_corrections(form: Form) -> list[RowName]:
    roles = dict.fromkeys(form.eliminated, "recovered")
    return [
        *(("correction", unknown, "primary", "") for unknown in form.unknowns),
        *(
            ("physical_correction", quantity, roles.get(quantity, "primary"), "")
            for quantity in (*FIELDS, *form.multipliers)
        ),
    ]


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
        integrator.parse(key.integrator),
        Formulation.parse(key.formulation),
        Projection.parse(key.projection),
        key.multipliers,
        key.start,
        key.evaluation == COMPENSATED,
        steps.parse(key.h_sequence),
        key.auxiliary,
    )


def _alternates(key: SeriesKey) -> bool:
    """Whether an alternation stays: undamped, and not kept out by rows of accelerations."""
    march = _march_of(key)
    kept_out = {"Ca", "B"} & set(march.formulation.kind.rows)
    return not (march.integrator.damped or march.projection.level or kept_out)


def _fading(key: SeriesKey) -> float:
    """0 where the constraints of velocities hold, which keep an alternation out."""
    march = _march_of(key)
    kept_out = not march.by_position or march.projection.level or not march.integrator.damped
    return 0.0 if kept_out else integrator.fading(march.integrator)


def _bound_of_correction(key: SeriesKey) -> str:
    if "B" in _form_of(key).rows and key.evaluation != COMPENSATED:
        # Once u rests on a rounded number, a and λ make the sum vanish for that number.
        return "α²Φ changes by whole roundings of u, or not at all"
    return _orders_of(key).bounded.get(key.quantity, "")


def _order_of_unit(key: SeriesKey) -> int:
    """Order of the unit of a correction: scaled ones are divided by their factor in D_R."""
    return _scaling_of(key).right[key.quantity].order() if key.measure == "correction" else 0


def _order_of_correction(key: SeriesKey) -> float:
    if key.stop != SATURATION or not _march_of(key).settles:
        return np.nan  # Newton does not end where rounding stops it
    return _orders_of(key).physical_corrections()[key.quantity] - _order_of_unit(key)


def _scaled_and_physical(name: str, text: str, label: str, **others: Any) -> tuple[Record, Record]:
    """Records of corrections in the solver's unknowns, and in physical units."""

    def record(name: str, of_unit: str, mark: str) -> Record:
        return Record(
            name,
            lambda key: f"{text}Δ{symbol(key.quantity)}{of_unit}",
            lambda key: rf"{label} $\|\Delta{mark} {_math(key.quantity)}\|$ (rms)",
            "rms",
            kind="rounding",
            quantities=(*FIELDS, *MULTIPLIERS),
            **others,
        )

    return record(name, "", r"\bar"), record(f"physical_{name}", " (physical)", "")


CORRECTION = Measure(
    "correction",
    "the last decreasing Newton corrections, scaled and physical",
    _scaled_and_physical(
        "correction",
        "",
        "last decreasing correction",
        predicted=_order_of_correction,
        tolerance=0.15,
        bounded=_bound_of_correction,
    ),
    _Corrections,
    stop=False,
    rows=_rows_of_corrections,
)


# -- condition --------------------------------------------------------------------------------


class _Conditions(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self.stops = _sampled(cell)
        self._values: list[float] = []

    def sees(self, march: "March") -> None:
        self._values.append(march.system.balanced(march.t, march.here).condition())

    def measured(self) -> list[Measurement]:
        values = statistics(np.array(self._values))
        return [Measurement("jacobian", "condition", "primary", values)]


CONDITION = Measure(
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
            quantities=("jacobian",),
        ),
    ),
    _Conditions,
    along_steps=False,
)


# -- sensitivity ------------------------------------------------------------------------------


class _Sensitivities(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self.stops = _sampled(cell)
        self._samples: list[dict[tuple[str, str], float]] = []
        self._beside: list[dict[tuple[str, str], float]] = []

    def sees(self, march: "March") -> None:
        from newmark_cli.newmark import perturbation
        from newmark_cli.newmark.twins import beside

        here = march.here
        for state, samples in ((here, self._samples), (beside(here), self._beside)):
            samples.append(
                perturbation.sensitivities(
                    march.problem, march.scheme, march.t, state, march.system
                )
            )

    def measured(self) -> list[Measurement]:
        measurements = []
        for row, unknown in self._samples[0] if self._samples else ():
            values, others = (
                np.array([sample[row, unknown] for sample in samples])
                for samples in (self._samples, self._beside)
            )
            # Rounding alone tells a state from the one beside it.
            rounding = float(np.median(np.abs(values - others)))
            of_row = replace(statistics(values), rounding=rounding)
            measurements.append(Measurement(unknown, "sensitivity", "primary", of_row, row))
        return measurements


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


SENSITIVITY = Measure(
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
    _Sensitivities,
    along_steps=False,
    rows=lambda form: [
        ("sensitivity", unknown, "primary", row) for row in form.rows for unknown in form.solved
    ],
)


# -- error ------------------------------------------------------------------------------------


class _Errors(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self.stops = frozenset((cell.steps,))
        self._reference = reference
        self._errors: Deviations = {}

    @property
    def deviations(self) -> Deviations:
        return self._errors

    def sees(self, march: "March") -> None:
        self._errors = errors(self._reference, march.seen, march.problem, march.t)

    def unresolved(self, quantity: str) -> float:
        of = OF_OUTPUTS.get(quantity, quantity)
        name = {"lambda": "multipliers"}.get(of, of)
        return float(getattr(self._reference, f"{name}_error", 0.0))

    def measured(self) -> list[Measurement]:
        return _of_largest("error", self._errors)


#: Quantities that are multipliers, or reactions, which are linear in them.
OF_MULTIPLIERS = ("lambda", "multiplier", "force", "moment")
#: Errors of outputs → what their errors are of.  Names of outputs end in these and an axis.
OF_OUTPUTS: Mapping[str, str] = MappingProxyType(
    {"omega": "v", "force": "lambda", "moment": "lambda"}
)


def _groups(outputs: "Outputs") -> dict[str, Mask]:
    """Kind of output → (k,) mask of the outputs of that kind."""
    names = [name.rpartition(".")[0].rpartition(".")[2] for name in outputs.names]
    return {kind: np.array(names) == kind for kind in OF_OUTPUTS if kind in names}


def errors(
    reference: "Reference | None", state: "State", problem: "Problem | None" = None, t: float = 0.0
) -> Deviations:
    """Errors of a final state, component by component, relative to the largest component.

    Errors of λ are relative to `newmark_cli.problems.reference.Reference.scales`.  Without a
    reference there are none; of a problem with outputs there are errors of these, too.
    """
    from newmark_cli.problems.multipliers import relative

    off: dict[str, list[Array]] = {"u": [], "v": [], "lambda": []}
    if problem is not None and problem.outputs is not None:
        groups = _groups(problem.outputs)
        off |= {kind: [] for kind in groups}
        if reference is not None:
            u, v = np.asarray(state.fields[:2], float)
            multipliers = np.asarray(state.multipliers, float)
            here = problem.outputs.values(problem, t, u, v, multipliers)
            there = problem.outputs.values(
                problem, t, reference.u, reference.v, reference.multipliers
            )
            for kind, of in groups.items():
                size = float(np.abs(there[of]).max())
                if kind == "moment":
                    # Moments about axes that turn freely are rounding of those of forces.
                    lever = problem.outputs.length(reference.u)
                    size = max(lever * float(np.abs(there[groups["force"]]).max()), size)
                off[kind].append(relative(here[of] - there[of], size))
    if reference is not None:
        fields = zip(state.fields[:2], (reference.u, reference.v), strict=True)
        off["u"], off["v"] = (
            [relative(here - there, float(np.abs(there).max()))] for here, there in fields
        )
        off["lambda"].append(relative(state.multipliers - reference.multipliers, reference.scales))
    return _at_samples(off)


def _ratio(quantity: str) -> str:
    """What an error is, as mathtext; norms of λ weigh its constraints."""
    name = _math(quantity)
    if quantity == "lambda":
        return rf"\|\Delta {name}\| \,/\, \|{name}\|"
    # The label of a word may have to be broken here.
    between = r"$ $" if quantity in _WORDS else ""
    return rf"\max|\Delta {name}| \,/\, {between}\max|{name}|"


ERROR = Measure(
    "error",
    "relative errors of u, v, λ at `t_end`, in space also of angular velocities, reaction forces "
    "and moments: against the exact motion (pendulum), the published "
    "one (andrews, t = 0.03), or one that is computed from the index-1 equations at high order, "
    "kept in `results/references/` with an estimate of its own error",
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
            quantities=("u", "v", "lambda", *OF_OUTPUTS),
        ),
    ),
    _Errors,
    at_end=True,
    reference=True,
    twins=True,
)


# -- transient --------------------------------------------------------------------------------

#: Steps after a change of h in which the largest error is looked for.
WINDOW = 40


class _Transients(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self._problem = cell.problem.load()
        # Of changes that recur, those in the middle of the march.
        of_all = cell.h_sequence.at if isinstance(cell.h_sequence, Change) else cell.t_end / 2
        self._since = float(of_all)
        first = march.grid.reaching(self._problem.t0 + self._since)
        self.stops = frozenset(range(first + 1, min(first + WINDOW, cell.steps) + 1))
        self._seen: list[tuple[float, Array, Array, Array]] = []

    def sees(self, march: "March") -> None:
        u, v = np.asarray(march.here.fields[:2], float)
        self._seen.append((march.t, u, v, march.multipliers))

    @cached_property
    def _exact(self) -> Any:
        """The exact motion at those times; None if it cannot be computed."""
        from newmark_cli.problems import reference

        try:
            return reference.along(self._problem, self._since, [t for t, *_ in self._seen])
        except reference.NoReference:
            return None

    @cached_property
    def deviations(self) -> Deviations:
        from newmark_cli.problems.index_1 import Index1
        from newmark_cli.problems.multipliers import relative, weights

        names, problem = ("u", "v", "lambda"), self._problem
        if self._exact is None or not self._seen:
            return _at_samples({name: [] for name in names})
        # Sizes where the window begins, which are those of any h, and at the start.
        begin = self._exact.start
        _, first = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
        sizes = (
            max(np.abs(begin.u).max(), np.abs(problem.u0).max()),
            max(np.abs(begin.v).max(), np.abs(problem.v0).max()),
            weights(problem, problem.t0 + self._since, begin.u).scales(
                np.maximum(np.abs(begin.multipliers), np.abs(first))
            ),
        )
        there = zip(*(state for _, *state in self._seen), strict=True)
        exact = zip(*self._exact.states, strict=True)
        return {
            name: np.array(
                [relative(ours - exact, size) for ours, exact in zip(here, true, strict=True)]
            )
            for name, here, true, size in zip(names, there, exact, sizes, strict=True)
        }

    def unresolved(self, quantity: str) -> float:
        name = {"lambda": "multipliers"}.get(quantity, quantity)
        return float(getattr(self._exact and self._exact.start, f"{name}_error", 0.0))

    def measured(self) -> list[Measurement]:
        return _of_largest("transient", self.deviations)


TRANSIENT = Measure(
    "transient",
    f"largest relative errors of u, v, λ in the {WINDOW} steps after a change of the step size; "
    "without one, and where changes recur, after the middle of the march",
    (
        Record(
            "transient",
            lambda key: f"error of {symbol(key.quantity)} after a change",
            lambda key: f"error after a change of $h$, ${_ratio(key.quantity)}$",
            "max",
            lambda key: _march_of(key).transient(key.quantity),
            0.2,
            kind="truncation",
            quantities=("u", "v", "lambda"),
        ),
    ),
    _Transients,
    twins=True,
)


# -- invariant --------------------------------------------------------------------------------


class _Invariants(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self.stops = _sampled(cell)
        self._problem = march.problem
        self._samples: list[dict[str, Misfit]] = []

    def sees(self, march: "March") -> None:
        from newmark_cli.newmark.invariants import invariants as misfits

        self._samples.append(misfits(march.problem, march.t, march.seen))

    @property
    def deviations(self) -> Deviations:
        return invariants(self._problem, self._samples)

    def measured(self) -> list[Measurement]:
        return _of_largest("invariant", self.deviations)


def invariants(problem: "Problem", samples: "Sequence[Mapping[str, Misfit]]") -> Deviations:
    """`newmark_cli.newmark.invariants` at the sampled states.

    Each error is divided by the largest size among the samples; 0 where all vanish.
    """
    from newmark_cli.problems.multipliers import relative, weights_at_start

    relative_errors = {}
    for name in samples[0] if samples else ():
        errors, sizes = (
            np.array(values) for values in zip(*(s[name] for s in samples), strict=True)
        )
        largest = sizes.max(axis=0)
        if name == "multiplier":
            largest = weights_at_start(problem).scales(largest)
        relative_errors[name] = relative(errors, largest)
    return relative_errors


def _order_of_drift(key: SeriesKey) -> float:
    march = _march_of(key)
    if not march.formulated or key.stop != SATURATION:
        return np.nan
    return march.drift(key.quantity)


INVARIANT = Measure(
    "invariant",
    "what an exact motion keeps, along the way: constraints, their rate, λ against what u and v "
    "imply, and the energy where it is conserved",
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
    _Invariants,
    twins=True,
)


# -- krylov -----------------------------------------------------------------------------------


class _Krylov(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        self._system: Any = march.system

    def measured(self) -> list[Measurement]:
        return krylov(self._system.iterations, self._system.residuals)


def krylov(iterations: Sequence[int], residuals: Sequence[float]) -> list[Measurement]:
    """Measurements of a Krylov solver over all solves, from iterations and residuals of each."""
    return [
        Measurement("jacobian", measure, "primary", statistics(np.array(values, float)))
        for measure, values in (("krylov_iterations", iterations), ("krylov_residual", residuals))
    ]


KRYLOV = Measure(
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
    _Krylov,
    solvers=(GMRES,),
)


# -- tolerance --------------------------------------------------------------------------------


class _Iterations(_Corrections):
    def measured(self) -> list[Measurement]:
        counts = np.abs(np.concatenate(self._iterations)) * 1.0
        return [Measurement("newton", "tolerance", "primary", statistics(counts))]


TOLERANCE = Measure(
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
    _Iterations,
    stop=True,
)


# -- trajectory -------------------------------------------------------------------------------

#: Quantities of the rows of trajectories.
_OF_TRAJECTORIES = (*KEPT, ENERGY, OUTPUT, *DRIFTS)
_LABELS_OF_DRIFTS = {
    "position": r"largest $|\Phi_k|/\|G_k\|$ (m)",
    "velocity": r"largest $|(G^T v + \Phi_t)_k|/\|G_k\|$ (m/s)",
}


def _over_time(name: str, quantities: tuple[str, ...]) -> Record:
    return Record(
        name,
        lambda key: f"{symbol(key.quantity)} over time",
        lambda key: _LABELS_OF_DRIFTS.get(
            key.quantity, rf"largest $|{_math(key.quantity)}|$ along the way"
        ),
        "max",
        quantities=quantities,
    )


class _Trajectories(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        from newmark_cli.newmark.trajectory import Recorder

        self._problem = march.problem
        kept = self._kept = cell.trajectory or Kept()
        steps = kept.looks(march.grid, cell.steps)
        wanted = {*kept.keep, *(("u", "v") if {ENERGY, DRIFT} & {*kept.keep} else ())}
        if OUTPUT in kept.keep and march.problem.outputs is not None:
            wanted |= {"u", "v", "lambda"}
        self._recorder = Recorder(march, [name for name in KEPT if name in wanted], len(steps) + 1)
        if steps and steps[0] == 0:
            self._recorder.keep_here()
            steps = steps[1:]
        self.looks = steps

    def took(self, stretch: "Stretch") -> None:
        self._recorder.took(stretch)

    @cached_property
    def _recorded(self) -> "Trajectory":
        if not self._kept.at:
            self._recorder.keep_here()
        return self._recorder.trajectory()

    @cached_property
    def _drifts(self) -> dict[str, Array]:
        from newmark_cli.newmark.invariants import misfits

        if DRIFT not in self._kept.keep:
            return {}
        recorded = self._recorded
        states = zip(recorded.t.tolist(), recorded.u, recorded.v, strict=True)
        missed = [misfits(self._problem, *state) for state in states]
        return {name: np.array([of[name].error for of in missed]) for name in DRIFTS}

    @property
    def trajectory(self) -> Mapping[str, Array | IndexArray]:
        recorded = self._recorded
        drifts = {f"{DRIFT}[{name}]": values for name, values in self._drifts.items()}
        return {"step": recorded.numbers} | recorded.columns(self._kept.keep) | drifts

    def measured(self) -> list[Measurement]:
        from newmark_cli.problems.multipliers import weights_at_start

        recorded = self._recorded
        # The start is no step; where it is all that was kept, it has to do.
        after = slice(1, None) if len(recorded.t) > 1 and recorded.numbers[0] == 0 else slice(None)
        sizes = {name: recorded.arrays[name] for name in recorded.arrays if name in self._kept.keep}
        if ENERGY in self._kept.keep and recorded.energy is not None:
            sizes[ENERGY] = recorded.energy[:, None]
        if OUTPUT in self._kept.keep and recorded.output_names:
            sizes[OUTPUT] = recorded.outputs
        sizes |= {name: values[:, None] for name, values in self._drifts.items()}
        largest = {
            name: np.abs(values[after]).max(axis=1, initial=0.0) for name, values in sizes.items()
        }
        if "lambda" in sizes:
            largest["lambda"] = weights_at_start(self._problem).largest(sizes["lambda"][after])
        return [
            Measurement(name, "trajectory", "primary", statistics(largest[name]))
            for name in _OF_TRAJECTORIES
            if name in largest
        ]


TRAJECTORY = Measure(
    "trajectory",
    "u, v, a, λ, the energy, reactions and angular velocities in space, and how far the "
    "constraints and their rate are missed (m, m/s), over time, by name, into "
    "`results/trajectory/<study>.csv`; the key `trajectory` says what, and at which steps",
    (_over_time("trajectory", _OF_TRAJECTORIES),),
    _Trajectories,
)


# -- floor ------------------------------------------------------------------------------------

#: What is measured → its prediction.
FLOOR_OF: Mapping[str, str] = MappingProxyType(
    {"correction": "floor", "physical_correction": "physical_floor"}
)


class _Floors(Observer):
    def __init__(self, cell: Cell, march: "March", reference: "Reference | None") -> None:
        from newmark_cli.newmark.floor import unpredicted

        self._scheme = march.scheme
        self.stops = frozenset() if unpredicted(march.scheme) else _sampled(cell)
        self._converged = True
        self._samples: list[tuple[Mapping[str, float], Mapping[str, float]]] = []

    def took(self, stretch: "Stretch") -> None:
        if len(stretch.iterations):
            self._converged = bool(stretch.iterations[-1] > 0)

    def sees(self, march: "March") -> None:
        from newmark_cli.newmark.floor import floor

        # The state after a step that did not converge is no state of the motion.
        if self._converged:
            found = floor(march)
            if not np.isnan(list(found.scaled.values())).any():
                self._samples.append((found.scaled, found.physical))

    def measured(self) -> list[Measurement]:
        return [
            Measurement(
                unknown,
                name,
                "primary",
                statistics(np.array([at[k][unknown] for at in self._samples])),
            )
            for k, name in enumerate(FLOOR_OF.values())
            for unknown in self._scheme.form.unknowns
        ]


FLOOR = Measure(
    "floor",
    "expected size of the last decreasing Newton corrections, from steps off by rounding at "
    "sampled states",
    _scaled_and_physical("floor", "predicted ", "predicted floor of"),
    _Floors,
    stop=False,
    rows=lambda form: [
        (name, unknown, "primary", "") for name in FLOOR_OF.values() for unknown in form.unknowns
    ],
)


def _by_name(*measures: Measure) -> Mapping[str, Measure]:
    return MappingProxyType({measure.name: measure for measure in measures})


#: Measures by name, in the order of a cell's rows.
MEASURES = _by_name(
    CORRECTION, CONDITION, SENSITIVITY, ERROR, INVARIANT, KRYLOV, TOLERANCE, TRAJECTORY, FLOOR,
    TRANSIENT,
)  # fmt: skip

#: Records that only CSVs of versions before 0.4 have.
FORMER = (
    _over_time("history", ("lambda", *OF_OUTPUTS, ENERGY)),
    _over_time("drift", DRIFTS),
)
#: Records by name, as the CSV's column ``measure`` has them.
RECORDS: Mapping[str, Record] = MappingProxyType(
    {r.name: r for measure in MEASURES.values() for r in measure.records}
    | {record.name: record for record in FORMER}
)
#: Those that a study can have.
RECORDED = tuple(record.name for measure in MEASURES.values() for record in measure.records)
