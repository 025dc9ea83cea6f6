"""Steps of other sizes: sequences, grids, engines, what changes do to errors, and studies."""

from fractions import Fraction
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marching import formulated, in_python
from oracles import THROWN, swing

import newmark_cli as newmark
from newmark_cli.advice import advising
from newmark_cli.library.scalings import read, scheme_of
from newmark_cli.newmark import steps
from newmark_cli.newmark.formulation import Projection
from newmark_cli.newmark.march import March
from newmark_cli.newmark.steps import Alternate, Change, Random, TimeGrid

SIZES = st.floats(1e-9, 10)
FACTORS = st.floats(0.01, 100)
SEQUENCES = st.one_of(
    st.builds(Change, FACTORS, SIZES),
    st.builds(Alternate, st.lists(FACTORS, min_size=2, max_size=4).map(tuple), st.integers(1, 9)),
    st.builds(Random, st.tuples(st.floats(0.1, 1), st.floats(1.5, 9)), st.integers(0, 99)),
)


@given(SEQUENCES, st.integers(1, 200), st.floats(1e-3, 1))
def test_sequences(sequence, count, h):
    """Labels are read back; the first steps are those of a longer march; the end is reached."""
    assert steps.parse(sequence.label) == sequence
    factors = sequence.factors(count, h)
    assert np.array_equal(factors, sequence.factors(2 * count, h)[:count])
    total = float(h * factors.sum())
    assert steps.steps_until(total * (1 + 1e-12), h, sequence) == count


@given(st.lists(SIZES, min_size=1, max_size=50), st.floats(-5, 5))
def test_times_are_sums_rounded_once(sizes, t0):
    grid = TimeGrid(t0, sizes[0], np.array(sizes))
    for k in range(len(sizes) + 1):
        assert grid.t(k) == t0 + float(sum(map(Fraction, sizes[:k]), Fraction(0)))
    assert grid.times(np.arange(len(sizes) + 1)).tolist() == [
        grid.t(k) for k in range(len(sizes) + 1)
    ]


@pytest.mark.parametrize(
    "integrator", ["trapezoidal", "generalized-alpha rho=0.9", "hht alpha=0.1", "bdf1", "bdf2"]
)
def test_ratio_1_has_the_bits_of_one_size(integrator):
    """An array of equal sizes, and its halts, on the pendulum."""
    one = newmark.march("pendulum", h=0.0078125, steps=100, integrator=integrator)
    other = newmark.march("pendulum", h=np.full(100, 0.0078125), integrator=integrator)
    for name in ("t", "u", "v", "a", "multipliers"):
        assert np.array_equal(getattr(one, name), getattr(other, name))


EIGHT = [
    ("andrews", "bdf2", "u-lambda", "index-3", "none", "random 0.5 2.0 seed 1", "static-lu",
     "rescale-velocity", "direct"),
    ("andrews", "generalized-alpha rho=0.9", "v-lambda", "index-3", "none",
     "alternate 1.0 0.5 every 5", "auto", "rescale-velocity", "compensated"),
    ("andrews", "trapezoidal", "a-lambda", "index-3", "none", "change 0.5 at 0.001", "sparse-lu",
     "keep", "direct"),
    ("pendulum", "bdf2", "a-lambda", "ggl", "none", "random 0.5 2.0 seed 2", "auto", "restart",
     "direct"),
    ("pendulum", "bdf2", "a-lambda", "ggl", "none", "random 0.5 2.0 seed 2", "auto",
     "rescale-velocity", "compensated"),
    ("four-bar", "generalized-alpha rho=0.5", "u-lambda", "augmented-lagrangian", "none",
     "alternate 1.0 0.5 every 1", "auto", "rescale", "direct"),
    ("four-bar", "hht alpha=0.1", "u-v-lambda", "index-3", "velocity", "random 0.5 2.0 seed 3",
     "auto", "rescale-velocity", "direct"),
    ("shaken-pendulum", "bdf1", "u-v-a-lambda", "baumgarte rate_h=1", "none",
     "alternate 1.0 2.0 0.5 every 2", "auto", "keep", "direct"),
]  # fmt: skip


@pytest.mark.parametrize("case", EIGHT)
def test_engines_agree(case):
    """With halts and without, solved in Python or not, under all that is carried over."""
    (
        problem, integrator, form, formulation, projection, sequence, solver, auxiliary, evaluation,
    ) = case  # fmt: skip
    subject = newmark.problem(problem)
    h = 1e-2 if "pendulum" in problem else 1e-4
    scheme = scheme_of(
        form, read("integrator", integrator), formulation, "optimal", h, evaluation=evaluation,
        precision="float64", projection=Projection(projection), auxiliary=auxiliary,
    )  # fmt: skip
    grid, found = TimeGrid.of(steps.parse(sequence), subject.t0, h, 30), []
    for way in ("kernel", "halts", "python"):
        march = March(subject, scheme, solver, grid=grid)
        if way == "python":
            march._engine = in_python(
                subject, scheme, schemes=march.schemes, system_at=march.system_of,
                constraining=march.system_of(0).constraining,
            )  # fmt: skip
        for _ in march.stretches(30, range(1, 30, 7) if way == "halts" else ()):
            pass
        assert (march.ending, march.done, march.t) == (0, 30, grid.t(30))
        found.append([*march.state.fields[:2], march.state.multipliers])
    kernel, halting, in_calls = found
    for one, other, third in zip(kernel, halting, in_calls, strict=True):
        assert np.array_equal(one, other)
        assert third == pytest.approx(one, rel=0, abs=1e-5 * max(np.abs(one).max(), 1e-3))


# -- errors after a change --------------------------------------------------------------------


def errors(h, sequence, **options):
    """Largest errors of v and λ after t = 0.6 of a pendulum."""
    found = newmark.march(THROWN, h=h, t_end=1.2, h_sequence=sequence, **options)
    angle, rate = swing(found.t, -1.0, 9.81)
    off = np.abs(found.v - (rate * [-np.sin(angle), np.cos(angle)]).T).max(axis=1)
    multiplier = 9.81 * np.sin(angle) - rate**2
    behind = found.t > 0.6
    return off[behind].max(), np.abs(found.multipliers[:, 0] - multiplier)[behind].max()


FIVE, FOUR, RANDOM = (
    "alternate 1.0 0.5 every 5", "alternate 1.0 0.5 every 4", "random 0.5 2.0 seed 1"
)  # fmt: skip


@pytest.mark.parametrize(
    ("integrator", "formulation", "projection", "auxiliary", "sequence", "of_v", "of_lambda"),
    [
        ("hht alpha=0.3", "index-3", "none", "keep", FIVE, 1, 1),
        ("hht alpha=0.3", "index-3", "none", "rescale", FIVE, 2, 1),
        ("hht alpha=0.3", "index-3", "none", "rescale-velocity", FIVE, 2, 2),
        ("generalized-alpha rho=0.5", "index-3", "none", "rescale-velocity", FOUR, 2, 2),
        ("generalized-alpha rho=0.5", "ggl", "none", "restart", FOUR, 1, 1),
        ("generalized-alpha rho=0.5", "index-2", "none", "rescale", FIVE, 2, 2),
        ("bdf2", "index-3", "none", "keep", FIVE, 2, 1),
        ("bdf2", "index-3", "none", "rescale-velocity", RANDOM, 2, 2),
        ("bdf2", "index-3", "velocity", "keep", FOUR, 2, 2),
        ("bdf1", "index-3", "none", "keep", FIVE, 1, 0),
        ("bdf1", "index-3", "none", "rescale-velocity", FIVE, 1, 1),
        ("trapezoidal", "index-2", "none", "keep", FIVE, 2, 1),
        ("trapezoidal", "index-2", "none", "keep", FOUR, 2, 2),
        ("trapezoidal", "index-3", "velocity", "keep", FOUR, 2, 2),
    ],
)
def test_orders_of_changes_that_recur(
    integrator, formulation, projection, auxiliary, sequence, of_v, of_lambda
):
    """As measured on a pendulum; constants of generalized-α are small."""
    how = {
        "integrator": integrator, "formulation": formulation, "projection": projection,
        "auxiliary": auxiliary,
    }  # fmt: skip
    # What is kept shows its order in small steps only; what is scaled takes long in them.
    sizes = (1e-3, 5e-4) if auxiliary == "keep" else (2e-3, 1e-3)
    (v, multiplier), (finer_v, finer) = (errors(h, sequence, **how) for h in sizes)
    assert np.log2(v / finer_v) == pytest.approx(of_v, abs=0.35)
    assert np.log2(multiplier / finer) == pytest.approx(of_lambda, abs=0.35)


@pytest.mark.parametrize(
    ("integrator", "formulation", "told"),
    [
        ("generalized-alpha rho=0.9", "index-3", "multiply a − v' by h_new/h and what v misses"),
        ("bdf2", "index-3", "for some steps. To keep it multiply what v misses of Gᵀv + Φ_t = 0 "
         "by h_new (h"),
        ("trapezoidal", "index-3", "alternates for good"),
        ("generalized-alpha rho=0.9", "ggl", "multiply a − v' by h_new/h"),
        ("bdf2", "index-2", None),
    ],
)  # fmt: skip
def test_advice_says_what_keeps_the_order(integrator, formulation, told):
    """And nothing where there is none."""
    scheme = formulated(formulation, h=1e-3, integrator=read("integrator", integrator))
    found = [*advising._when_h_changes(scheme)]
    assert len(found) == (told is not None)
    assert told is None or told in found[0]


@pytest.mark.usefixtures("few_draws")
def test_advice_has_it_among_its_findings():
    found = newmark.advise("pendulum", h=1e-3, integrator="bdf2").findings
    assert len([text for text in found if text.startswith("when your code changes h")]) == 1


# -- studies ----------------------------------------------------------------------------------

STUDY = """study: changing
problem: pendulum
form: u-lambda
preconditioning: optimal
integrator: generalized-alpha rho=0.9
h_sequence: [constant, {change: 0.5, at: 0.5}, {alternate: [1, 0.5], every: 5}, {random: [0.5, 2]}]
auxiliary: [rescale-velocity, keep]
measure: [error, correction, trajectory]
trajectory: {at: [0.25, 0.75], keep: [u, lambda]}
h: [0.02, 0.01, 0.005]
t_end: 1.0
twins: 1
"""


def test_a_study_of_sequences(cli):
    """Run, resumed from kept cells, checked: columns, labels, orders, times of what is kept."""
    cli.write("changing.yaml", STUDY)
    cli("run", "changing.yaml")
    rows = pd.read_csv(cli.folder / "results" / "changing.csv")
    assert set(rows.h_sequence) == {
        "constant", "change 0.5 at 0.5", "alternate 1.0 0.5 every 5", "random 0.5 2.0 seed 1",
    }  # fmt: skip
    assert set(rows.auxiliary) == {"rescale-velocity", "keep"}
    of_lambda = rows[(rows.measure == "error") & (rows.quantity == "lambda")]
    worst = of_lambda[of_lambda.h == 0.005].groupby(["h_sequence", "auxiliary"])["last"].max()
    assert worst["constant", "rescale-velocity"] == worst["constant", "keep"]
    for changing in ("alternate 1.0 0.5 every 5", "random 0.5 2.0 seed 1"):
        assert worst[changing, "keep"] > 5 * worst[changing, "rescale-velocity"]
    kept = pd.read_csv(cli.folder / "results" / "trajectory" / "changing.csv")
    assert np.abs(kept.t - kept.t.round(2)).max() <= 0.02
    usual = rows[(rows.quantity == "lambda") & (rows.h == 0.005) & (rows.auxiliary == "keep")]
    rms = usual.groupby(["measure", "h_sequence"])["rms"].first()
    of_one, of_both = (
        rms["physical_correction", sequence] / rms["correction", sequence]
        for sequence in ("constant", "alternate 1.0 0.5 every 5")
    )
    # 1/(βh²) of the sizes is 1 and 4 times that of one; weighed alike: √((1 + 16)/2).
    assert 1.5 < of_both / of_one < 4
    cli("run", "changing.yaml")
    assert pd.read_csv(cli.folder / "results" / "changing.csv").equals(rows)
    found = cli("check", "changing")
    assert "0 miss" in found.stdout or "miss" not in found.stdout


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{change: 0.5}", "h_sequence.change: needs at"),
        ("{change: 0.5, every: 3}", "every: does not belong to change"),
        ("{alternate: [1], every: 5}", "at least 2"),
        ("{random: [2, 0.5]}", "random: must ascend"),
        ("{change: 0.5, random: [1, 2]}", "needs one of change, random"),
        ("sometimes", "unknown sequence of step sizes 'sometimes'"),
    ],
)
def test_sequences_that_are_none(cli, text, told):
    lines = STUDY.splitlines()
    lines[5] = f"h_sequence: {text}"
    cli.write("changing.yaml", "\n".join(lines) + "\n")
    (line,) = cli("validate", "changing.yaml", code=2).stderr.splitlines()[:1]
    assert told in line
    assert "line 6" in line


def test_arrays_of_sizes_that_cannot_be_used():
    for h, more, told in (
        ([0.1, 0.0], {}, "every step size must be positive"),
        ([0.1, 0.2], {"steps": 3}, "has the sizes of 2 steps, 3 are asked for"),
        ([0.1, 0.2], {"t_end": 0.55}, "has the sizes of 2 steps, which end 0.25 s before it"),
        ([0.1, True], {}, "h must be a list of numbers"),
        ([0.1, 1e-320], {}, "h is too large or too small, given 9.99989e-321; allowed are 1e-60"),
        (1e-320, {"t_end": 1.0, "form": "a-lambda", "scaling": "none"}, "h is too large or too"),
        ([], {}, "every step size"),
        ([0.1, 0.2], {"h_sequence": "random 0.5 2.0 seed 1"}, "not with an array h"),
        (0.1, {"h_sequence": {"change": 2}}, "needs at"),
        (0.1, {"h_sequence": "random 0.5 2.0 seed 1"}, "give t_end or the number of steps"),
    ):
        with pytest.raises(newmark.NewmarkError, match=told):
            newmark.march("pendulum", h=h, **more)


# -- very short steps --------------------------------------------------------------------------


def test_steps_of_an_array_end_where_it_ends():
    """Also when they are stepped; t_end may lie within the step that there would be next."""
    sizes = [0.1, 0.2]
    assert [round(step.t, 9) for step in newmark.steps("pendulum", h=sizes)] == [0.1, 0.3]
    assert newmark.march("pendulum", h=sizes, t_end=0.45).t.round(9).tolist() == [0, 0.1, 0.3]


SLIDER = {"every": 0, "problem": "slider-crank"}
LONG = 1e-3


@cache
def right_at(t):
    """State with velocities enforced, in 4000 steps."""
    return newmark.march(
        h=t / 4000, steps=4000, integrator="generalized-alpha rho=0.9", formulation="ggl",
        **SLIDER,
    ).state  # fmt: skip


def errors_at_the_end(sizes, state=None, **how):
    """Of u, v and λ, against 20 times as many steps with velocities enforced."""
    found = newmark.march(h=sizes, state=state, **SLIDER, **how)
    assert found.status == "ok"
    end = found.state
    right = right_at(end.t)
    return np.array([
        np.abs(end.u - right.u).max(), np.abs(end.v - right.v).max(),
        np.abs(end.multipliers - right.multipliers).max(),
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("integrator", "how"),
    [
        ("trapezoidal", {"formulation": "index-2"}),
        ("generalized-alpha rho=0.9", {}),
        ("generalized-alpha rho=0.9", {"projection": "velocity"}),
        ("hht alpha=0.1", {}),
        ("bdf2", {"formulation": "ggl"}),
        ("bdf1", {}),
        ("generalized-alpha rho=0.9", {"evaluation": "compensated", "form": "a-lambda"}),
    ],
)
@pytest.mark.filterwarnings("ignore:h. rounding alone")
def test_a_very_short_step_does_no_harm(integrator, how):
    """Among long ones, at the start and twice in a row: errors as without it, but for a factor.

    What a step of 1e-8 s leaves of the hidden constraints and in a − v' is rounding, which the
    change to a longer step would multiply by 1e10 and 1e5.
    """
    how = {"integrator": integrator, **how}
    before, after = [LONG] * 150, [LONG] * 50
    without = errors_at_the_end([*before, *after], **how)
    for short in (1e-5, 1e-7, 1e-9):
        assert np.all(errors_at_the_end([*before, short, *after], **how) < 3 * without)
    twice = errors_at_the_end([1e-8, *before, 1e-8, 3e-8, *after], **how)
    assert np.all(twice < 3 * without)


@pytest.mark.release
def test_a_very_short_step_in_single_precision():
    """A thousandth of the time of others is too short there."""
    how = {"integrator": "generalized-alpha rho=0.9", "precision": "float32", "form": "a-lambda"}
    with pytest.warns(newmark.NewmarkWarning):
        found = errors_at_the_end([LONG] * 150 + [1e-5] + [LONG] * 50, **how)
    assert np.all(found < 3 * errors_at_the_end([LONG] * 200, **how))


def test_what_is_remembered_goes_with_the_state():
    """Of a march that is continued after a step that was too short, and of one taken again."""
    how = {"integrator": "generalized-alpha rho=0.9"}
    state = newmark.march(h=LONG, steps=150, **SLIDER, **how).state
    state = newmark.march(h=1e-8, steps=1, state=state, **SLIDER, **how).state
    found = errors_at_the_end([LONG] * 50, state, **how)
    assert np.all(found < 3 * errors_at_the_end([LONG] * 200, **how))


def test_multipliers_of_a_short_last_step_are_said_to_be_rounding():
    """λ of that step is 200 times as far off as others, and nothing can be done about it."""
    how = {"integrator": "generalized-alpha rho=0.9"}
    with pytest.warns(newmark.NewmarkWarning, match=r"a step of 1e-08 s by some \de\+00, and λ of"):
        newmark.march(h=[LONG] * 200 + [1e-8], **SLIDER, **how)
