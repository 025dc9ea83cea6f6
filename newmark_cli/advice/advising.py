"""Advice for somebody's own code: factors, tolerances that can be met, believable multipliers."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import Subject, require_fit, subject_of
from newmark_cli.advice.sections import plain, sections
from newmark_cli.advice.tolerances import (
    ALL,
    RESIDUAL_TESTED,
    SPREAD,
    TESTED,
    largest,
    of_correction,
    of_residual,
    one_sided,
    tolerances_of,
)
from newmark_cli.library import arguments
from newmark_cli.library.marching import march
from newmark_cli.library.scalings import (
    Factors,
    integrator_or_newmark,
    read,
    scheme_of,
)
from newmark_cli.library.scalings import (
    scaling as factors_of,
)
from newmark_cli.library.stepping import FEWEST, unstable
from newmark_cli.newmark.balance import Inverted, block_factors, block_sizes, equilibrium
from newmark_cli.newmark.floor import Floor, unpredicted
from newmark_cli.newmark.forms import FORMS, INDEX_3
from newmark_cli.newmark.integrator import NEW_W, TRUE_ACCELERATION
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.noise import carried
from newmark_cli.newmark.orders import form_orders
from newmark_cli.newmark.scaling import PAPER_VARIANTS, Preconditioning
from newmark_cli.newmark.scheme import DIRECT, PRECISIONS, Scheme
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError

#: Optimally scaled condition numbers above this are ruled by something else than h.
LARGE = 1e6
#: Fractions of ‖λ‖ that the noise of λ is compared with.
FRACTIONS = (0.01, 1.0)
#: Most unknowns for which all forms are compared.
_MOST_COMPARED = 150
#: Times the motion that is looked at, and steps at most, that energy has to grow in.
_LONGER, _MOST_STEPS = 10, 5_000
#: Makes a scheme from its step size and, if another, its form, scaling or precision.
_Schemes = partial[Scheme]
#: Step sizes (s) at which the noise of λ is predicted; it follows powers of h between them.
_GRID = np.array([1e-1, 1e-3, 1e-6, 1e-9])


@dataclass(frozen=True)
class Smallest:
    """The smallest tolerance that Newton can meet on one unknown.

    It is twice the predicted rms of the 2-norm of the last correction, at the worst of the
    states.  Set three times as much: docs/verification.md says at how many steps each was met.

    Attributes:
        h: Step size (s).
        precision: ``"float64"`` or ``"float32"``.
        unknown: ``"u"``, ``"lambda"`` and so on; ``"all"`` for the norm of all of them.
        scaled: Tolerance on the unknown that the solver sees.
        physical: Tolerance on the unknown in its own unit; None for ``"all"``.
    """

    h: float
    precision: str
    unknown: str
    scaled: float
    physical: float | None


@dataclass(frozen=True)
class Noise:
    """Step sizes below which rounding moves λ by a part of itself.

    Attributes:
        one_step: Fraction of ‖λ‖ → step size (s) below which the predicted last correction of λ
            exceeds it, its rms over some of the states: what a single step cannot know.  0
            stands for less than 1e-9 s, and None for any step size, more than 0.1 s.
        carried: The same of the noise that stays from step to step, its rms over the states;
            None for any step size where the integrator does not damp it.  Empty for other
            formulations than index 3, of which it is not predicted.
    """

    one_step: Mapping[float, float | None]
    carried: Mapping[float, float | None]


@dataclass(frozen=True)
class Equilibration:
    """A diagonal scaling besides the powers of h.

    Attributes:
        h: Step size (s).
        optimal: Condition number with the optimal scaling only.
        fields: Block of the optimally scaled matrix, row or unknown → one further factor.
        with_fields: Condition number with these.
        left, right: A further factor for every row and every column.
        with_all: Condition number with these.
        cause: What rules the optimally scaled condition number.
    """

    h: float
    optimal: float
    fields: Mapping[str, float]
    with_fields: float
    left: Sequence[float] = field(repr=False)
    right: Sequence[float] = field(repr=False)
    with_all: float
    cause: str


@dataclass(frozen=True)
class Advice:
    """Numbers to set in your own code.

    ``print`` shows it as text; `to_dict` gives plain values for JSON.

    Attributes:
        subject: Name of the problem, or the file of the matrices.
        n, m: Coordinates and constraints.
        where: At which states.
        form, integrator, formulation, evaluation, scaling: Of the scheme.
        condition: Step size (s) → variant → 2-norm condition number of J̄; infinite where the
            matrix is singular.
        orders: Variant → power of h with which it grows, as predicted.
        factors: Step size (s) → factors of the optimal scaling.
        code: Lines of NumPy to paste, by ``"numpy"``.
        forms: Form → variant → condition number at the smallest step size; empty for large
            problems.
        tolerances: The smallest that Newton can meet; empty without a state.
        multipliers: Root mean square of ‖λ‖ over the states; None without one.
        noise: Below which step sizes λ is noise; None where that is not predicted.
        equilibrations: Where units or stiffness rule the conditioning.
        findings: What to know or to change, in sentences.

    Examples:
        >>> import newmark_cli as newmark
        >>> advice = newmark.advise("andrews", h=1e-4)
        >>> advice.factors[1e-4].left_formulas["D"], f"{advice.factors[1e-4].left['D']:.2g}"
        ('beta*h^2', '2.5e-09')
        >>> {name: f"{value:.0e}" for name, value in advice.condition[1e-4].items()}
        {'none': '2e+19', 'left': '5e+10', 'right': '5e+10', 'optimal': '1e+02'}
    """

    subject: str
    n: int
    m: int
    where: str
    form: str
    integrator: str
    formulation: str
    evaluation: str
    scaling: str
    condition: Mapping[float, Mapping[str, float]]
    orders: Mapping[str, float]
    factors: Mapping[float, Factors]
    code: Mapping[str, tuple[str, ...]]
    forms: Mapping[str, Mapping[str, float]]
    tolerances: tuple[Smallest, ...]
    multipliers: float | None
    noise: Noise | None
    equilibrations: tuple[Equilibration, ...]
    findings: tuple[str, ...]

    @property
    def best_form(self) -> str | None:
        """The form whose optimally scaled condition number is least at the smallest step size."""
        return _best(self.forms, "optimal") if self.forms else None

    def to_dict(self) -> dict[str, Any]:
        """Plain mappings, lists, numbers and text; step sizes are text where they are keys."""
        values: dict[str, Any] = plain(asdict(self))
        return values

    def __str__(self) -> str:
        return "\n\n".join(filter(None, sections(self)))


@arguments.scaling_by_either_name
def advise(
    subject: Any,
    *,
    h: float | Sequence[float],
    form: str = "u-lambda",
    beta: float | None = None,
    gamma: float | None = None,
    integrator: Any = None,
    formulation: Any = INDEX_3,
    evaluation: str = DIRECT,
    scaling: Any = "optimal",
    t_end: float | None = None,
    tolerance: float | Mapping[str, float] | None = None,
    tested: str = "scaled",
    residual_tolerance: float | None = None,
    residual_tested: str = "after",
    precision: str = "float64",
) -> Advice:
    """Say what to set for a mechanism, or for matrices of another code, before anything is run.

    Args:
        subject: What `problem` takes; or matrices: the path of an .npz file or of a folder of
            .mtx files, or a dict, with ``M`` (n, n) and ``G`` (n, m), where they are known
            ``X`` = −∂(f + Gλ)/∂u and ``Y`` = −∂f/∂v, and the state ``u``, ``v``, ``a``,
            ``lambda``.
        h: Step size, or several (s).
        form: Name of a form, such as ``"v-lambda"``.
        beta: Parameter of Newmark's scheme; 1/4 when omitted.
        gamma: Parameter of Newmark's scheme; 1/2 when omitted.
        integrator: An integrator in place of β and γ, as `march` takes it.
        formulation: As of `march`.
        evaluation: As of `march`.
        scaling: The scaling in use, as of `march`, for the tolerances on scaled unknowns and
            for the diagnosis.
        t_end: Time until which a problem's motion is looked at (s); a time in which it moves
            by about its own size when omitted.
        tolerance: A tolerance of your own on Newton's correction, to be diagnosed: on its
            whole norm, or unknown → tolerance.
        tested: Whether it is tested on ``"scaled"`` or on ``"physical"`` unknowns.
        residual_tolerance: A tolerance of your own on the residual's norm.
        residual_tested: Whether the residual is tested ``"before"`` or ``"after"`` its rows are
            scaled.
        precision: ``"float64"`` or ``"float32"``, for the diagnosis and the noise of λ.

    Returns:
        The advice.

    Raises:
        ArgumentError: For an argument of the wrong type, size or name.
        ProblemError, DocumentError: When the problem cannot be used.
        NewmarkError: When matrices cannot be used; says which and why.
        IntegratorError, FormulationError, ScalingError: For parameters that give no scheme.

    Examples:
        >>> import newmark_cli as newmark
        >>> advice = newmark.advise({"M": [[1, 0], [0, 1]], "G": [[1], [0]]}, h=1e-3)
        >>> round(advice.condition[1e-3]["optimal"], 3), advice.orders["none"]
        (2.618, -4.0)
    """
    steps = _step_sizes(h)
    method = integrator_or_newmark(beta, gamma, integrator)
    chosen = read("formulation", formulation)
    about = subject_of(subject, None if t_end is None else arguments.positive("t_end", t_end))
    problem, variant = about.problem, read("scaling", scaling)
    schemes = partial(
        scheme_of, form=form, integrator=method, formulation=chosen, scaling=variant,
        evaluation=evaluation, precision=precision,
    )  # fmt: skip
    scheme_at = {step: schemes(h=step) for step in steps}
    require_fit(about, chosen, evaluation)
    least = scheme_at[steps[-1]]
    tests = tolerances_of(tolerance, least.form.unknowns)
    arguments.one_of("tested", tested, TESTED)
    arguments.one_of("residual_tested", residual_tested, RESIDUAL_TESTED)
    if residual_tolerance is not None:
        arguments.positive("residual_tolerance", residual_tolerance)
    variants = {name: Preconditioning(name) for name in PAPER_VARIANTS} | {variant.label: variant}
    conditions = {step: _conditions(about, schemes, step, variants) for step in steps}
    condition = {step: by_variant for step, (by_variant, _) in conditions.items()}
    equilibrations = [found for _, found in conditions.values() if found]
    orders = {
        name: form_orders(least.form).condition(one.scaling(least.form))
        for name, one in variants.items()
    }
    factors = {
        step: factors_of(form, h=step, integrator=method, formulation=chosen) for step in steps
    }
    forms = {
        name: _conditions(about, partial(schemes, form=name), steps[-1], variants)[0]
        for name in (FORMS if problem.n + problem.m <= _MOST_COMPARED else ())
    }
    noise = _noise(about, schemes)
    floors = {
        name: {step: about.floors(schemes(h=step, precision=name)) for step in steps}
        for name in PRECISIONS
    }
    why = unpredicted(least)
    if why and tests:
        raise ArgumentError(f"a tolerance cannot be judged: {why}")
    if (tests or residual_tolerance is not None) and not all(floors[precision].values()):
        raise ArgumentError(
            f"{problem.name}: a tolerance can be judged only where a state u, v, a, lambda is given"
        )
    tolerances = tuple(_tolerances(floors, scheme_at))
    too_coarse = dict.fromkeys(f"{one.h:g}" for one in tolerances if math.isnan(one.scaled))
    findings = [
        of_correction(*test, tested, scheme_at, floors[precision]) for test in tests.items()
    ]
    if residual_tolerance is not None:
        findings.append(of_residual(residual_tolerance, residual_tested, about, scheme_at))
    findings += one_sided(least, orders[variant.label], condition[least.h])
    findings += _findings(least, orders, forms, noise, equilibrations)
    findings += [*_when_h_changes(least), *_unstable(about, schemes, steps)]
    if why:
        findings.append(f"no floors and no tolerances: {why}")
    if too_coarse:
        findings.append(
            f"no floors and no tolerances at h = {', '.join(too_coarse)}: Newton's iteration does "
            "not converge from some of the states"
        )
    return Advice(
        subject=problem.name,
        n=problem.n,
        m=problem.m,
        where=about.where,
        form=form,
        integrator=method.label,
        formulation=chosen.label,
        evaluation=evaluation,
        scaling=variant.label,
        condition=condition,
        orders=orders,
        factors=factors,
        code={"numpy": _code(factors[least.h], method.symbols(least.h), problem)},
        forms=forms,
        tolerances=tolerances,
        multipliers=about.multipliers,
        noise=noise,
        equilibrations=tuple(equilibrations),
        findings=(*findings, *about.notes),
    )


def _step_sizes(h: Any) -> list[float]:
    """Step sizes, the smallest last."""
    values = np.ravel(h).tolist() if isinstance(h, np.ndarray) else h
    values = values if isinstance(values, list | tuple) and len(values) else [h]
    return sorted({arguments.step_size(value) for value in values}, reverse=True)


def _conditions(
    about: Subject, schemes: _Schemes, h: float, variants: Mapping[str, Preconditioning]
) -> tuple[dict[str, float], Equilibration | None]:
    """Condition number of each variant, and an equilibration where all of them are large."""
    scheme = schemes(h=h)
    form, sizes = scheme.form, scheme.form.sizes(about.problem.n, about.problem.m)
    try:
        inverted = Inverted(about.jacobian(scheme), sizes)
    except np.linalg.LinAlgError:
        return dict.fromkeys(variants, math.inf), None
    factors = {
        name: scaling_factors(schemes(h=h, scaling=chosen), about.problem.n, about.problem.m)
        for name, chosen in variants.items()
    }
    condition = {name: inverted.condition(*both) for name, both in factors.items()}
    if not (optimal := condition["optimal"]) > LARGE:
        return condition, None
    left, right = factors["optimal"]
    balanced = left[:, None] * inverted.jacobian * right[None, :]
    further = np.concatenate(block_factors(block_sizes(balanced, sizes)))
    of_rows, of_columns = np.split(np.repeat(further, [*sizes, *sizes]), 2)
    with_fields = inverted.condition(left * of_rows, right * of_columns)
    rows, columns = equilibrium(balanced, sizes)
    with_all = inverted.condition(left * rows, right * columns)
    names = [*(f"row {row}" for row in form.rows), *form.solved]
    return condition, Equilibration(
        h, optimal, dict(zip(names, further.tolist(), strict=True)), with_fields, rows.tolist(),
        columns.tolist(), with_all, _cause(about, scheme, optimal, with_fields, with_all),
    )  # fmt: skip


def _cause(
    about: Subject, scheme: Scheme, optimal: float, with_fields: float, with_all: float
) -> str:
    at = about.states[0]
    terms = at.evaluate(at.t0, at.u0, at.v0, about.accelerations[0][1])
    mass, x, y = at.M, terms.X, terms.Y
    symbols = scheme.symbols
    stiff = symbols["beta"] * scheme.h**2 * np.linalg.norm(x, 2) / np.linalg.norm(mass, 2)
    damped = symbols["gamma"] * scheme.h * np.linalg.norm(y, 2) / np.linalg.norm(mass, 2)
    if max(stiff, damped) > 1:
        return (
            f"stiffness rules row D: βh²‖X‖ is {stiff:.2g} and γh‖Y‖ {damped:.2g} times ‖M‖ at "
            "this step"
        )
    if with_fields < optimal / 10 and with_fields < 10 * with_all:
        return "units: M and G are of very different size"
    if with_all < optimal / 10:
        return "units of single coordinates and constraints: rows are of very different size"
    return (
        "neither h nor units: constraints that are nearly dependent, or masses that are nearly zero"
    )


def _tolerances(
    floors: Mapping[str, Mapping[float, Sequence[Floor]]], schemes: Mapping[float, Scheme]
) -> Iterator[Smallest]:
    for h, scheme in schemes.items():
        for precision, by_step in floors.items():
            for unknown in (*by_step[h][0].scaled, ALL) if by_step[h] else ():
                scaled, physical = (
                    SPREAD * largest(by_step[h], unknown, kind, scheme)
                    for kind in ("scaled", "physical")
                )
                yield Smallest(h, precision, unknown, scaled, None if unknown == ALL else physical)


def _noise(about: Subject, schemes: _Schemes) -> Noise | None:
    size = about.multipliers
    if not size or not about.floors(schemes(h=float(_GRID[0])), roughly=True):
        return None

    def in_one_step(h: float) -> float:
        of_lambda = [at.physical["lambda"] for at in about.floors(schemes(h=h), roughly=True)]
        return math.sqrt(np.mean(np.square(of_lambda)))

    carried_on = schemes(h=1.0).formulation.method == INDEX_3
    return Noise(
        _crossings(in_one_step, size),
        _crossings(partial(_carried, about, schemes), size) if carried_on else {},
    )


def _carried(about: Subject, schemes: _Schemes, h: float) -> float:
    # The roundings that are carried on are those of Φ, and the same in every form.
    scheme = schemes(h=h, form="u-lambda")
    grown = carried(scheme.integrator)
    return math.inf if math.isinf(grown) else grown * about.multiplier_noise(scheme)


def _crossings(noise: Callable[[float], float], size: float) -> dict[float, float | None]:
    """Fraction of ‖λ‖ → largest step size at which its noise exceeds it."""
    parts = np.array([noise(float(h)) for h in _GRID]) / size
    known = ~np.isnan(parts)  # the largest steps may not converge
    return {fraction: _crossing(_GRID[known], parts[known], fraction) for fraction in FRACTIONS}


def _crossing(grid: Array, parts: Array, fraction: float) -> float | None:
    above = np.flatnonzero(parts >= fraction)
    if len(above) == 0:
        return 0.0 if len(grid) else None
    if (k := int(above[0])) == 0 or np.isinf(parts[k]):
        return None
    before, after = np.log(np.maximum(parts[k - 1 : k + 1], np.finfo(float).tiny))
    place = (math.log(fraction) - before) / (after - before)
    return float(grid[k - 1] * (grid[k] / grid[k - 1]) ** place)


def _code(factors: Factors, symbols: Mapping[str, float], problem: Problem) -> tuple[str, ...]:
    """Lines of NumPy to paste, for arrays of a factor for each row and each unknown."""
    fields = len(FORMS[factors.form].kept)
    size = len(factors.rows)
    counts = ", ".join(["n"] * fields + ["m"] * (size - fields))
    left, right = (
        ", ".join(formula.replace("^", "**") for formula in [*formulas.values()][:size])
        for formulas in (factors.left_formulas, factors.right_formulas)
    )
    return (
        f"n, m, beta, gamma = {problem.n}, {problem.m}, {symbols['beta']!r}, {symbols['gamma']!r}",
        f"left = np.repeat([{left}], [{counts}])",
        f"right = np.repeat([{right}], [{counts}])",
        "dq = right * np.linalg.solve(left[:, None] * J * right, -left * b)",
    )


def _best(forms: Mapping[str, Mapping[str, float]], variant: str) -> str:
    """The form with the least condition number, the first of those that are equal."""
    return min(forms, key=lambda name: float(f"{forms[name][variant]:.6g}"))


def _findings(
    scheme: Scheme,
    orders: Mapping[str, float],
    forms: Mapping[str, Mapping[str, float]],
    noise: Noise | None,
    equilibrations: Sequence[Equilibration],
) -> Iterable[str]:
    seeing = [f"{name} (h^{order:g})" for name, order in orders.items() if order < 0]
    blind = [name for name, order in orders.items() if order >= 0]
    yield (
        f"an iterative solver sees h under {', '.join(seeing)}; it does not under "
        f"{', '.join(blind)}: the number of iterations then depends on the mechanism only"
        if seeing
        else "an iterative solver does not see h under any of the scalings"
    )
    if forms:
        best, bare = _best(forms, "optimal"), _best(forms, "none")
        yield (
            f"best form at the smallest h: {best} with C = {forms[best]['optimal']:.3g} optimally "
            f"scaled; without scaling {bare} with C = {forms[bare]['none']:.3g}. All forms take "
            "the same step"
        )
    if noise:
        yield (
            "no scaling changes the noise of λ: it changes the units in which corrections are read"
        )
        if scheme.formulation.method == INDEX_3:
            grown = carried(scheme.integrator)
            yield (
                f"{scheme.integrator.label} carries noise of λ on from step to step: "
                + (
                    "it does not damp it, so that in time it adds up at any h; an error of λ that "
                    "alternates may be there from the start, too"
                    if math.isinf(grown)
                    else f"what rounding of the constraints does to λ in one step adds up to "
                    f"{grown:.3g} times that, as an rms over the motion; peaks are higher"
                )
            )
    for scaled in equilibrations:
        yield (
            f"h = {scaled.h:g}: C = {scaled.optimal:.3g} with the optimal scaling is not h's "
            f"doing. {scaled.cause}. With a further factor for each block "
            f"C = {scaled.with_fields:.3g}; with one for each row and column "
            f"C = {scaled.with_all:.3g}"
        )


def _unstable(about: Subject, schemes: _Schemes, step_sizes: Iterable[float]) -> Iterator[str]:
    """At which step sizes a march of the scheme makes energy."""
    length = about.states[-1].t0 - about.problem.t0
    for h in step_sizes if about.problem.potential is not None else ():
        steps = int(min(_LONGER * length / h, _MOST_STEPS))
        if steps < FEWEST:
            continue
        marched = march(
            about.problem, h=h, t_end=steps * h, steps=True, every=max(steps // (2 * FEWEST), 1),
            keep=("u", "v"), **schemes.keywords,
        )  # fmt: skip
        deque(marched, maxlen=0)
        if told := unstable(marched.trajectory):
            yield f"h = {h:g}, marched to t = {steps * h:.3g} s: {told}"


def _when_h_changes(scheme: Scheme) -> Iterable[str]:
    """What λ loses after h → h/2 where a code carries its past on, and what avoids it."""
    integrator, rows = scheme.integrator, scheme.formulation.kind.rows
    advance = integrator.relations(1.0).advance
    auxiliary = TRUE_ACCELERATION in advance
    by_position = rows == ("C",) or scheme.formulation.kind.penalised
    if not by_position and not (auxiliary and "Cv" in rows):
        return
    cures = ["a − v' by h_new/h"] if auxiliary else []
    if by_position:
        power = "h_new/h" if integrator.order == 1 and not auxiliary else "(h_new/h)²"
        if NEW_W in advance:
            power = "h_new (h_new + h)/(h (h + h_before)), at the change and one step later"
        cures.append(f"what v misses of Gᵀv + Φ_t = 0 by {power}")
    cure = " and ".join(cures)
    if by_position:
        cure += "; or take ggl, index-2 or projection velocity, recovered λ, where v misses nothing"
    lasting = "for some steps" if integrator.damped else "and then alternates for good"
    yield f"when your code changes h, λ loses an order {lasting}. To keep it multiply {cure}"
