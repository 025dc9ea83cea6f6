"""What another code computed, judged: a textbook code with and without faults, and bad tables."""

import itertools
import json
from dataclasses import replace

import faulty_code
import numpy as np
import pandas as pd
import pytest
from each import each
from pages import ROOT

import newmark_cli as newmark

THROWN = str(ROOT / "docs/examples/thrown-pendulum.yaml")
#: Problem → step sizes, end, and a tolerance on λ that the last step size cannot meet.
RUNS = {
    THROWN: ([0.05, 0.02, 0.01, 0.005, 0.0025], 0.5, 1e-12, 5e-4),
    "slider-crank": ([3e-3, 1e-3, 5e-4, 2.5e-4], 0.15, 1e-11, 1.25e-4),
    "spatial-slider-crank": ([5e-3, 2e-3, 1e-3, 5e-4], 0.05, 1e-10, 5e-5),
}


def judged(table, problem, **options):
    with np.errstate(all="ignore"):
        return newmark.judge(table, problem, **options)


def swings(sizes=(0.02, 0.01, 0.005, 0.0025), integrator="generalized-alpha rho=0.9", rows=None):
    """A table of the thrown pendulum, by this tool's own march."""
    found = []
    for h in sizes:
        march = newmark.march(THROWN, h=h, t_end=0.5, integrator=integrator)
        frame = march.to_frame().assign(h=h)
        kept = [name for name in frame if name[0] in "htuvl"]
        found.append(frame[kept] if rows is None else frame[kept].iloc[rows])
    return pd.concat(found, ignore_index=True)


FAULTS = [*faulty_code.FAULTS]
CRANK, SPATIAL = "slider-crank", "spatial-slider-crank"


@each(
    "subject, fault",
    [
        *((THROWN, fault) for fault in ("", *FAULTS)),
        *((CRANK, fault) for fault in ("", *FAULTS[::2])),
        *((SPATIAL, fault) for fault in ("", *FAULTS[1::2])),
    ],
)
def test_a_fault_of_a_textbook_code_is_named_and_a_sound_one_has_none(subject, fault):
    """Every fault in the plainest mechanism, and in one of those with more constraints."""
    problem = newmark.problem(subject)
    sizes, t_end, tolerance, small = RUNS[subject]
    if fault == "tolerance on λ":
        sizes = [*sizes[:2], small]
    table = faulty_code.table(problem, sizes, t_end, fault, True, tolerance)
    found = judged(table, problem)
    names = {one.name for one in found.faults}
    if fault:
        assert faulty_code.FAULTS[fault] in names
        assert found.fails()
    else:
        assert not names
        assert not found.fails()


def test_mistakes_are_explained_by_numbers():
    """A mass of 1.1 that does not weigh more, λ of another Φ, and when it drifts like t²."""
    problem = newmark.problem(THROWN)
    sizes, t_end, *_ = RUNS[THROWN]
    (mass,) = judged(faulty_code.table(problem, sizes, t_end, "mass of one point"), problem).faults
    assert "the inertia, but not the weight, of P were 1.1 times the mechanism's" in mass.text
    (factor,) = judged(faulty_code.table(problem, sizes, t_end, "λ of |Δ|² − L²"), problem).faults
    assert factor.evidence["factor"] == 0.5
    long = newmark.march(THROWN, h=1e-3, t_end=2.0, formulation="index-1", integrator="bdf2")
    (drift,) = judged(long.to_frame().assign(h=1e-3), problem, integrator="bdf2").faults
    assert drift.name == "drift"


def test_signs_and_factors_of_all_constraints_are_those_of_most():
    """Where some multipliers vanish at the end, or have large errors, in a mechanism in space."""
    problem = newmark.problem("spatial-slider-crank")
    sizes, t_end, *_ = RUNS["spatial-slider-crank"]
    table = faulty_code.table(problem, sizes, t_end, "", True)
    multipliers = [name for name in table if name.startswith("lambda")]
    turned = table.assign(**{name: -table[name] for name in multipliers})
    assert not judged(turned, problem).faults
    impulse = table.assign(**{name: table["h"] * table[name] for name in multipliers})
    assert {one.name for one in judged(impulse, problem).faults} == {"factor of λ"}


@each(
    "integrator, alternates",
    [("trapezoidal", True), ("bdf2", False), ("hht alpha=0.1", False)],
)
def test_a_multiplier_alternates_under_an_undamped_integrator_only(integrator, alternates):
    table = swings((0.02, 0.01, 0.005), integrator, rows=slice(-3, None))
    names = [one.name for one in judged(table, THROWN).faults]
    assert ("alternation" in names) == alternates
    # Of an integrator that is known not to damp it is a limit.
    told = judged(table, THROWN, integrator=integrator)
    assert not told.faults


def test_orders_are_those_of_the_theory_and_verdicts_those_of_check(cli):
    methods, steps = ("bdf2", "bdf1", "hht alpha=0.1", "trapezoidal"), (1e-3, 5e-4, 2e-4, 1e-4)
    cli.write(
        "own.yaml",
        "study: own\nproblem: double-pendulum\nform: u-lambda\n"
        "preconditioning: optimal\nmeasure: error\nt_end: 0.05\nh: [1e-3, 5e-4, 2e-4, 1e-4]\n"
        "integrator: [{method: bdf2}, {method: bdf1}, {method: hht, alpha: 0.1}, trapezoidal]\n",
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
    assert len(theirs) == len(ours) > 10
    for row in theirs.itertuples():
        one = ours[row.integrator, row.quantity]
        assert one.verdict == row.verdict, row
        assert one.fit.slope == pytest.approx(row.slope, abs=1e-6, nan_ok=True)


def test_step_sizes_that_do_not_divide_the_time_are_judged_together():
    """Each run is held against the solution at its own end."""
    found = judged(swings((0.03, 0.012, 0.007, 0.003)), THROWN)
    assert {round(float(each.run.t[-1]), 3) for each in found.measured} == {
        0.48,
        0.492,
        0.497,
        0.498,
    }
    (u,) = (one for one in found.slopes if one.quantity == "u")
    assert u.verdict == "pass"
    assert u.fit.slope == pytest.approx(2, abs=0.1)


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
    for one in found.slopes:
        assert one.fit.slope == pytest.approx(usual[one.quantity], rel=1e-6, nan_ok=True)
    mapped = judged(
        other, THROWN,
        columns={"u[P.x]": "0.001 * u1", "u[P.y]": "0.001*u2", lam: "-lam1"},
    )  # fmt: skip
    assert {one.quantity for one in mapped.slopes} == {"u", "v", "lambda", "position",
                                                      "velocity", "multiplier"}  # fmt: skip
    crank = newmark.problem("slider-crank")
    mixed = []
    for h in (2e-3, 1e-3, 5e-4):
        frame = newmark.march(crank, h=h, t_end=0.1, integrator="bdf2").to_frame().assign(h=h)
        multipliers = [name for name in frame if name.startswith("lambda")]
        kept = frame[[name for name in frame if name[:2] in ("h", "t", "u[", "v[")]].copy()
        for number, place in enumerate((2, 0, 1), start=1):
            kept[f"lam{number}"] = frame[multipliers[place]]
        mixed.append(kept)
    found = judged(pd.concat(mixed), crank, integrator="bdf2")
    assert not found.fails()
    assert "in the order sliders.guide, bodies.crank, bodies.rod" in " ".join(found.notes)


def test_a_template_is_where_a_code_begins(cli):
    header, start = cli("judge", "--template", "slider-crank").stdout.splitlines()
    crank = newmark.problem("slider-crank")
    row = dict(zip(header.split(","), map(float, start.split(",")), strict=True))
    assert [row[f"u[{name}]"] for name in crank.coordinate_names] == crank.u0.tolist()
    _, *columns = newmark.march("slider-crank", h=1e-3, t_end=1e-3).to_frame().columns
    assert set(row) - {"h", "t"} == {name for name in columns if name[:2] in ("u[", "v[", "la")}
    first = newmark.march("slider-crank", h=1e-6, t_end=2e-6, integrator="bdf2")
    assert row["lambda[bodies.rod]"] == pytest.approx(first.constraint("bodies.rod")[0], rel=1e-9)


def test_the_command_judges_draws_and_holds_against_expectations(cli):
    table = swings((0.02, 0.01, 0.005, 0.002))
    table.to_csv(cli.folder / "mine.csv", index=False, float_format="%.17g")
    done = cli("judge", "mine.csv", "--problem", THROWN, "--json", "--plot", "mine.svg")
    found = json.loads(done.stdout)
    assert found["findings"] == []
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
        (("--columns", "dots.yaml"), "columns: u[P.x]: mine.csv: not a factor, given '1.2.3'"),
        (("--columns", "huge.yaml"), "columns: u[P.x]: mine.csv: not a factor, given '1e999'"),
        (("--plot", "mine.gif"), "mine.gif: a figure ends in .png"),
    ):
        table.to_csv(path, index=False)
        assert said in cli.refused(*command, *options)
    # What looks like an address is the path of a file, and read from nowhere else.
    for address in (path.as_uri(), "http://127.0.0.1:9/mine.csv", "s3://mine/mine.parquet"):
        line = cli.refused("judge", address, "--problem", THROWN)
        assert line.endswith(": cannot be read: No such file or directory")


def test_times_count_from_the_start_of_the_problem():
    """A start before t = 0, off the grid of multiples of h; rows of a frame have no lines."""
    subject = replace(newmark.problem(THROWN), t0=-0.25)
    table = pd.concat([
        newmark.march(subject, h=h, t_end=0.25, integrator="generalized-alpha rho=0.8")
        .to_frame().assign(h=h) for h in (0.02, 0.01, 0.005)
    ])  # fmt: skip
    assert judged(table, subject, integrator="generalized-alpha rho=0.8").faults == ()
    with pytest.raises(newmark.NewmarkError, match=r"row 1: t must be a time, at least -0\.25"):
        newmark.judge(table.assign(t=table["t"] - 1), subject)


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


def test_few_digits_are_said_and_a_long_table_is_read(tmp_path):
    path = tmp_path / "long.csv"
    swings((2e-2, 1e-2, 5e-3, 1e-5)).to_csv(path, index=False, float_format="%.7g")
    found = judged(path, THROWN)
    assert [one.name for one in found.faults] == ["few digits"]


def test_rounding_that_piles_up_in_u_is_no_other_mechanism():
    """In (u, λ) rounding shifts u by more at smaller h, alike in twins; no other motion does."""
    ends = [
        newmark.march("pendulum", h=h, t_end=1.0, every=0, integrator="newmark").to_frame()
        for h in (1e-5, 5e-6, 2.5e-6, 2e-6)
    ]
    table = pd.concat([end.assign(h=end["t"].iloc[-1] / n) for end, n in zip(
        ends, (100_000, 200_000, 400_000, 500_000), strict=True)])  # fmt: skip
    assert judged(table, "pendulum", integrator="newmark").faults == ()


def test_a_corrected_start_is_off_the_rates_on_purpose():
    table = pd.concat([
        newmark.march("shaken-pendulum", h=h, t_end=0.5, start="corrected").to_frame().assign(h=h)
        for h in (2e-3, 1e-3, 5e-4)
    ])  # fmt: skip
    options = {"integrator": "newmark", "start": "corrected"}
    assert judged(table, "shaken-pendulum", **options).faults == ()
    del options["start"]
    (fault,) = judged(table, "shaken-pendulum", **options).faults
    assert fault.name == "start off its constraints"


FAR = """points:
  P: {at: [300, 400], velocity: [0, 1], mass: 1}
  Q: {at: [300.6, 400.8], velocity: [-1.6, 2.2], mass: 2}
bars: {b: {from: P, to: Q, length: 1}}
"""


@each("name", ["double-pendulum", "far.yaml"])
def test_rounding_of_a_projected_code_is_no_miss(name, tmp_path, monkeypatch):
    """Its last places differ from ours, which meets what it projects to the bit.

    Far from the origin they are many times as much of what a mechanism's points are apart.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.yaml").write_text(FAR)
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
