"""What another code computed, judged: a textbook code with and without faults, and bad tables."""

import itertools
import json
from types import SimpleNamespace

import faulty_code
import numpy as np
import pandas as pd
import pytest
from judged_tables import FEW, THROWN, judged, swings

import newmark_cli as newmark
from newmark_cli.library.judging import Judged

#: Problem → step sizes, end, and a tolerance on λ that the last step size cannot meet.
RUNS = {
    THROWN: ([0.05, 0.02, 0.01, 0.005, 0.0025], 0.5, 1e-12, 5e-4),
    "slider-crank": ([3e-3, 1e-3, 5e-4, 2.5e-4], 0.15, 1e-11, 1.25e-4),
    "spatial-slider-crank": ([5e-3, 2e-3, 1e-3, 5e-4], 0.05, 1e-10, 5e-5),
}


FAULTS = [*faulty_code.FAULTS]
#: What explains a fault by a number: a mass of 1.1 that does not weigh more moves as under
#: another gravity, and λ is that of another Φ.
NUMBERS = {
    "mass of one point": ("changes", "gravity", 1 / 1.1 - 1),
    "λ of |Δ|² − L²": ("factors", "bars.rod", 0.5),
}
CRANK, SPATIAL = "slider-crank", "spatial-slider-crank"


@pytest.mark.parametrize(
    ("subject", "fault"),
    [
        *((THROWN, fault) for fault in ("", *FAULTS)),
        *((CRANK, fault) for fault in ("", FAULTS[7])),
        *((SPATIAL, fault) for fault in ("", FAULTS[8])),
    ],
)
def test_a_fault_of_a_textbook_code_is_named_and_a_sound_one_has_none(subject, fault):
    """Every fault in the plainest mechanism, and one in those with more constraints."""
    problem = newmark.problem(subject)
    sizes, t_end, tolerance, small = RUNS[subject]
    if fault == "tolerance on λ":
        sizes = [*sizes[:2], small]
    table = faulty_code.table(problem, sizes, t_end, fault, True, tolerance)
    # Changes that a number or a start explains best, and all where none explains.
    among = ["gravity", "mass", "start"] if fault in NUMBERS else [""]
    found = judged(table, problem, among, integrator="generalized-alpha rho=0.9")
    names = {one.name for one in found.findings if one.name != "printing"}
    if fault:
        assert faulty_code.FAULTS[fault] in names
        # An iteration that ends early may not harm the results.
        assert found.fails() or faulty_code.FAULTS[fault] == "Newton ends early"
        if fault in NUMBERS:
            (told,) = found.faults
            of, name, value = NUMBERS[fault]
            assert told.evidence[of][name] == pytest.approx(value, rel=1e-3)
            assert of != "factors" or "|Δ|² − L²" in told.text
    else:
        assert not names
        assert not found.fails()


@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_an_early_end_of_newton_is_harmless_only_where_multipliers_are_right(factor):
    problem = newmark.problem(THROWN)
    sizes, t_end, tolerance, _ = RUNS[THROWN]
    table = faulty_code.table(problem, sizes, t_end, "tolerance on h² λ", True, tolerance)
    for name in table.columns[table.columns.str.startswith("lambda")]:
        table[name] *= factor
    found = judged(table, problem, [""], integrator="generalized-alpha rho=0.9").findings
    (early,) = (one for one in found if one.name == "Newton ends early")
    assert ("do not suffer" in early.text) == (factor == 1)


def test_a_drift_is_told():
    problem = newmark.problem(THROWN)
    how = {"formulation": "index-1", "integrator": "bdf2", "every": 200}
    long = newmark.march(THROWN, h=1e-3, t_end=2.0, **how).to_frame()
    (drift,) = judged(long.assign(h=1e-3), problem, integrator="bdf2").faults
    assert drift.name == "drift"


@pytest.mark.parametrize(
    ("integrator", "alternates"),
    [("trapezoidal", True), ("hht alpha=0.1", False)],
)
def test_a_multiplier_alternates_under_an_undamped_integrator_only(integrator, alternates):
    table = swings((0.02, 0.01, 0.005), integrator, rows=(-3, -2, -1))
    for told in (judged(table, THROWN), judged(table, THROWN, integrator=integrator)):
        assert ("alternation" in [one.name for one in told.findings]) == alternates
        assert not told.faults


def test_orders_are_those_of_the_theory_and_verdicts_those_of_check(cli):
    methods, steps = ("bdf1", "trapezoidal"), (1e-3, 5e-4, 2e-4, 1e-4)
    cli.write(
        "own.yaml",
        "study: own\nproblem: double-pendulum\nform: u-lambda\n"
        "preconditioning: optimal\nmeasure: error\nt_end: 0.05\nh: [1e-3, 5e-4, 2e-4, 1e-4]\n"
        "integrator: [{method: bdf1}, trapezoidal]\n",
    )
    cli("run", "own.yaml")
    theirs = newmark.slopes(pd.read_csv(cli.folder / "results/own.csv"))
    tables = []
    for method, h in itertools.product(methods, steps):
        march = newmark.march(
            "double-pendulum", h=h, t_end=0.05, integrator=method, every=0, twins=3
        )
        for number, one in enumerate((march, *march.twins)):
            frame = one.to_frame()
            kept = [name for name in frame if name[:2] in ("t", "u[", "v[", "la", "ou")]
            tables.append(frame[kept].assign(h=h, twin=number, series=method, integrator=method))
    found = judged(pd.concat(tables, ignore_index=True), "double-pendulum")
    ours = {(s.integrator, s.quantity): s for s in found.slopes if s.measure == "error"}
    assert len(theirs) == len(ours) == 6
    for row in theirs.itertuples():
        one = ours[row.integrator, row.quantity]
        assert one.verdict == row.verdict, row
        assert one.fit.slope == pytest.approx(row.slope, abs=1e-6, nan_ok=True)


def test_units_names_signs_and_order_are_found_out():
    table = swings()
    lam, places = "lambda[bars.rod]", [name for name in table if name[0] in "uv"]
    usual = {one.quantity: one.fit.slope for one in judged(table, THROWN).slopes}
    other = table.copy()
    other[places] *= 1000
    other[lam] *= -1
    numbered = dict(zip([*places, lam], ["u1", "u2", "v1", "v2", "lam1"], strict=True))
    other = other.rename(columns=numbered)
    found = judged(other, THROWN)
    assert not found.faults
    notes = " ".join(found.notes)
    assert "u is 1000 times as large, and taken to be in mm" in notes
    assert "the sign of λ is turned, of bars.rod" in notes
    assert found.conclusion.startswith("Nothing else was found")
    for one in found.slopes:
        assert one.fit.slope == pytest.approx(usual[one.quantity], rel=1e-6, nan_ok=True)
    mapped = judged(
        other, THROWN,
        columns={"u[P.x]": "0.001 * u1", "u[P.y]": "0.001*u2", lam: "-lam1"},
    )  # fmt: skip
    assert {one.quantity for one in mapped.slopes} == {"u", "v", "lambda", "position",
                                                      "velocity", "multiplier"}  # fmt: skip


def test_the_command_judges_draws_and_holds_against_expectations(cli):
    table = swings((0.02, 0.01, 0.005, 0.002))
    table.to_csv(cli.folder / "mine.csv", index=False, float_format="%.17g")
    done = cli("judge", "mine.csv", "--problem", THROWN, "--json", "--plot", "mine.svg")
    found = json.loads(done.stdout)
    assert [one for one in found["findings"] if one["fault"]] == []
    orders = {one["quantity"]: one["slope"] for one in found["series"] if one["measure"] == "error"}
    assert orders["u"] == pytest.approx(2, abs=0.1)
    assert b"newmark-study" in (cli.folder / "mine.svg").read_bytes()
    cli.write("orders.yaml", "expect:\n  - {quantity: u, slope: 3, within: 0.1}\n")
    done = cli("judge", "mine.csv", "--problem", THROWN, "--expect", "orders.yaml", code=1)
    assert "miss: expect[1]" in done.stdout


BAD = [
    (lambda table: table.rename(columns={"u[P.x]": "u[Q.x]"}),
     "mine.csv: thrown-pendulum.yaml has no u[Q.x]; did you mean 'u[P.x]'?"),
    (lambda table: table.drop(columns="h"), "mine.csv: needs a column h, tolerance or"),
    (lambda table: table.drop(columns="t"), "mine.csv: needs a column t; has"),
    (lambda table: table[["h", "t"]], "no column of thrown-pendulum.yaml, such as u[P.x]"),
    (lambda table: table.astype(str).replace("0.02", "big"), "line 3: not a number, given 'big'"),
    (lambda table: table.assign(h=-table["h"]), "line 2: h must be positive, given -0.02"),
    (lambda table: pd.concat([table, table]), "t = 0 is there twice"),
    (lambda table: table[["h", "t", "u[P.x]", "u[P.y]"]].set_axis(["h", "t", "u1", "u3"], axis=1),
     "no column of thrown-pendulum.yaml"),
    (lambda table: table[:0], "mine.csv: no row"),
]  # fmt: skip


def test_bad_tables_are_refused_in_a_line(cli):
    table, path = swings((0.02,)), cli.folder / "mine.csv"
    for change, said in BAD:
        change(table).to_csv(path, index=False)
        with pytest.raises(newmark.NewmarkError) as caught:
            newmark.judge(path, THROWN)
        assert said in str(caught.value)
        assert str(caught.value).isprintable()
    cli.write("dots.yaml", "'u[P.x]': 1.2.3 * t\n")
    cli.write("huge.yaml", "'u[P.x]': 1e999 * t\n")
    command = ("judge", "mine.csv", "--problem", THROWN)
    assert "mine.csv: no row" in cli.refused(*command)
    for options, said in (
        (("--integrator", "bdf9"), "unknown method 'bdf9'"),
        (("--columns", "none.yaml"), "none.yaml: cannot be read"),
        (("--columns", "dots.yaml"), "columns: u[P.x]: mine.csv: not a formula, given '1.2.3 * t'"),
        (("--columns", "huge.yaml"), "columns: u[P.x]: mine.csv: not a formula, given '1e999 * t'"),
        (("--plot", "mine.gif"), "mine.gif: a figure ends in .png"),
    ):
        table.to_csv(path, index=False)
        assert said in cli.refused(*command, *options)
    # What looks like an address is the path of a file, and read from nowhere else.
    for address in (path.as_uri(), "http://127.0.0.1:9/mine.csv", "s3://mine/mine.parquet"):
        line = cli.refused("judge", address, "--problem", THROWN)
        assert line.endswith(": cannot be read: No such file or directory")


def test_a_warning_of_the_method_is_printed_once(cli):
    """Every run of the table names the integrator, and so does the command."""
    method = "alpha beta=0.3025 gamma=0.6 alpha_m=0 alpha_f=0"
    table = swings((0.02, 0.01, 0.005), integrator="newmark beta=0.3025 gamma=0.6")
    table.assign(integrator=method).to_csv(cli.folder / "mine.csv", index=False)
    told = cli("judge", "mine.csv", "--problem", THROWN, "--integrator", method).stderr
    assert told.count("gamma = 0.6 is not 1/2 - alpha_m + alpha_f = 0.5") == 1


def test_a_method_has_no_other_arguments():
    with pytest.raises(TypeError, match="unexpected keyword argument 'integrater'"):
        newmark.judge(swings((0.02,)), THROWN, integrater="bdf2")


def test_poor_tables_still_tell_something():
    table = swings()
    gaps = table.copy()
    gaps.loc[gaps["h"] < 0.004, "u[P.x]"] = np.nan
    (fault,) = judged(gaps, THROWN).faults
    assert fault.name == "failure"
    assert "u[P.x]" in fault.text
    few = judged(table[["h", "t", "u[P.x]"]].groupby("h").tail(1), THROWN)
    assert [one.quantity for one in few.slopes] == ["u"]
    one = judged(swings((0.01,)), THROWN)
    assert {each.verdict for each in one.slopes} <= {"undecided", "shown"}
    assert one.undecided
    assert one.fails()
    assert "No order could be judged." in str(one)
    adaptive = table.rename(columns={"h": "tolerance"})
    assert {each.verdict for each in judged(adaptive, THROWN).slopes} == {"shown"}


def test_rounding_that_piles_up_in_u_is_no_other_mechanism():
    """In (u, λ) rounding shifts u by more at smaller h, alike in twins; no other motion does."""
    ends = [
        newmark.march("pendulum", h=h, t_end=0.2, every=0, integrator="newmark").to_frame()
        for h in (1e-5, 5e-6, 2.5e-6, 2e-6)
    ]
    table = pd.concat([end.assign(h=end["t"].iloc[-1] / n) for end, n in zip(
        ends, (20_000, 40_000, 80_000, 100_000), strict=True)])  # fmt: skip
    assert judged(table, "pendulum", integrator="newmark").faults == ()


def test_a_corrected_start_is_off_the_rates_on_purpose():
    table = pd.concat([
        newmark.march("shaken-pendulum", h=h, t_end=0.5, start="corrected")
        .to_frame().iloc[[*FEW]].assign(h=h)
        for h in (2e-3, 1e-3, 5e-4)
    ])  # fmt: skip
    options = {"integrator": "newmark", "start": "corrected"}
    assert judged(table, "shaken-pendulum", **options).faults == ()
    del options["start"]
    (fault,) = judged(table, "shaken-pendulum", **options).faults
    assert fault.name == "start"
    assert "misses Φ" in fault.text


def test_rounding_of_a_projected_code_is_no_miss():
    """Its last places differ from ours, which meets what it projects to the bit."""
    name = "double-pendulum"
    how = {"integrator": "generalized-alpha rho=0.9", "projection": "velocity"}
    problem = newmark.problem(name)
    parts = {"u": problem.coordinate_names, "v": problem.coordinate_names}
    parts["lambda"] = problem.constraint_names
    columns = [f"{part}[{name}]" for part, names in parts.items() for name in names]
    rows, random = [], np.random.default_rng(0)
    for h in (1e-2, 5e-3, 2e-3, 1e-3):
        done = newmark.march(name, h=h, t_end=0.2, **how)
        for k in (0, len(done.t) // 2, -1):
            state = np.concatenate([done.u[k], done.v[k], done.multipliers[k]])
            units = random.integers(-2, 3, len(state)) * np.finfo(float).eps
            rows.append([h, done.t[k], *(state * (1 + units))])
    table = pd.DataFrame(rows, columns=["h", "t", *columns])
    judged = newmark.judge(table, name, **how)
    assert {slope.verdict for slope in judged.slopes} == {"pass"}
    assert "λ of u, v: rounding only: " in " ".join(str(judged).split())


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        ({"u": "pass", "lambda": "pass"}, "Nothing wrong was found."),
        (
            {"u": "pass", "lambda": "undecided"},
            "Nothing wrong was found; no order could be judged of λ.",
        ),
        (
            {"u": "miss", "lambda": "undecided"},
            "No cause of a fault was found; see above what is said of u.",
        ),
    ],
)
def test_what_is_said_without_a_fault(verdicts, said):
    """An order that cannot be judged is no fault."""
    slopes = [
        SimpleNamespace(
            study="mine", measure="error", quantity=quantity, verdict=verdict, expected=2.0
        )
        for quantity, verdict in verdicts.items()
    ]
    assert Judged("pendulum", (), (), slopes).conclusion == said
