"""What another code computed, judged: a textbook code with and without faults, and bad tables."""

import importlib.util
import itertools
import json
import sys

import faulty_code
import numpy as np
import pandas as pd
import pytest
from pages import ROOT
from scipy.integrate import solve_ivp

import newmark_cli as newmark

THROWN = str(ROOT / "docs/examples/thrown-pendulum.yaml")
#: Problem → step sizes, end, and a tolerance on λ that the last step size cannot meet.
RUNS = {
    THROWN: ([0.05, 0.02, 0.01, 0.005, 0.0025], 0.5, 1e-12, 5e-4),
    "slider-crank": ([3e-3, 1e-3, 5e-4, 2.5e-4], 0.15, 1e-11, 1.25e-4),
    "spatial-slider-crank": ([5e-3, 2e-3, 1e-3, 5e-4], 0.05, 1e-10, 5e-5),
}


def bench():
    """The bench of causes, which is run as a whole by hand."""
    spec = importlib.util.spec_from_file_location(
        "bench_of_causes", ROOT / "tests/verification/causes.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


BENCH = bench()


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


@pytest.mark.parametrize(
    ("subject", "fault"),
    [
        *((THROWN, fault) for fault in ("", *FAULTS)),
        *((CRANK, fault) for fault in ("", *FAULTS[4:10:3])),
        *((SPATIAL, fault) for fault in ("", *FAULTS[5:11:3])),
    ],
)
def test_a_fault_of_a_textbook_code_is_named_and_a_sound_one_has_none(subject, fault):
    """Every fault in the plainest mechanism, and in one of those with more constraints."""
    problem = newmark.problem(subject)
    sizes, t_end, tolerance, small = RUNS[subject]
    if fault == "tolerance on λ":
        sizes = [*sizes[:2], small]
    table = faulty_code.table(problem, sizes, t_end, fault, True, tolerance)
    found = judged(table, problem, integrator="generalized-alpha rho=0.9")
    names = {one.name for one in found.findings if one.name != "printing"}
    if fault:
        assert faulty_code.FAULTS[fault] in names
        # An iteration that ends early may not harm the results.
        assert found.fails() or faulty_code.FAULTS[fault] == "Newton ends early"
    else:
        assert not names
        assert not found.fails()


def test_mistakes_are_explained_by_numbers():
    """A mass of 1.1 that does not weigh more moves as under another gravity; λ of another Φ."""
    problem = newmark.problem(THROWN)
    sizes, t_end, *_ = RUNS[THROWN]
    (mass,) = judged(faulty_code.table(problem, sizes, t_end, "mass of one point"), problem).faults
    assert mass.name == "another mechanism"
    assert mass.evidence["changes"]["gravity"] == pytest.approx(1 / 1.1 - 1, rel=1e-3)
    (factor,) = judged(faulty_code.table(problem, sizes, t_end, "λ of |Δ|² − L²"), problem).faults
    assert factor.evidence["factors"]["bars.rod"] == pytest.approx(0.5, rel=1e-3)
    assert "|Δ|² − L²" in factor.text
    long = newmark.march(THROWN, h=1e-3, t_end=2.0, formulation="index-1", integrator="bdf2")
    (drift,) = judged(long.to_frame().assign(h=1e-3), problem, integrator="bdf2").faults
    assert drift.name == "drift"


@pytest.mark.parametrize(
    ("integrator", "alternates"),
    [("trapezoidal", True), ("hht alpha=0.1", False)],
)
def test_a_multiplier_alternates_under_an_undamped_integrator_only(integrator, alternates):
    table = swings((0.02, 0.01, 0.005), integrator, rows=slice(-3, None))
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
        newmark.march("shaken-pendulum", h=h, t_end=0.5, start="corrected").to_frame().assign(h=h)
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


CART = {
    "points": {
        "W": {"fixed": [-1, 0]},
        "C": {"at": [0, 0], "mass": 1.4, "velocity": [0.5, 0]},
        "P": {"at": [0.3, -0.4], "mass": 0.6, "velocity": [1.3, 0.6]},
    },
    "bars": {"rod": {"from": "C", "to": "P", "length": 0.5}},
    "sliders": {"rail": {"point": "C", "through": [0, 0], "direction": [1, 0]}},
    "springs": {"coil": {"from": "W", "to": "C", "stiffness": 30, "rest_length": 0.8}},
    "dampers": {"oil": {"from": "W", "to": "C", "damping": 0.7}},
    "gravity": [0, -9.81],
}
BDF2 = {"integrator": "bdf2"}


def with_number(path, factor):
    """The cart with one number times a factor."""
    document = json.loads(json.dumps(CART))
    *way, last = path
    there = document
    for key in way:
        there = there[key]
    value = there[last]
    there[last] = [factor * x for x in value] if isinstance(value, list) else factor * value
    return document


def cart(document=CART, parts="tuvl", rows=(0, 1, 2, -3, -2, -1), integrator="bdf2"):
    """A table of the cart, by this tool's own march of what may be another mechanism."""
    found = []
    for h in (0.01, 0.005, 0.0025, 0.00125):
        frame = newmark.march(document, h=h, t_end=0.4, integrator=integrator).to_frame()
        kept = [name for name in frame if name[0] in parts and name[:2] != "to"]
        found.append(frame[kept].iloc[[k for k in rows if k < len(frame)]].assign(h=h))
    return pd.concat(found, ignore_index=True)


@pytest.mark.parametrize(
    ("path", "factor", "said"),
    [
        (("points", "P", "mass"), 1.05, "points.P.mass × 1.05"),
        (("springs", "coil", "stiffness"), 0.9, "springs.coil.stiffness × 0.9"),
        (("springs", "coil", "rest_length"), 1.01, "springs.coil.rest_length × 1.01"),
        (("dampers", "oil", "damping"), 0.0, "dampers.oil.damping left out"),
        (("gravity",), -1.0, "gravity with its sign turned"),
    ],
)
def test_the_one_number_that_differs_is_named_with_its_value(path, factor, said):
    (fault,) = judged(cart(with_number(path, factor)), CART, **BDF2).faults
    assert fault.name == "another mechanism"
    name = ".".join(path)
    # Where spring and damper act along the rail, their length is told by the place of their end.
    others = ["points.W.fixed.0"] if path[-1] == "rest_length" else []
    assert list(fault.evidence["changes"]) == [name, *others]
    assert 1 + fault.evidence["changes"][name] == pytest.approx(factor, rel=1e-3, abs=1e-3)
    assert said in fault.text


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("gravity", [9.81 * np.sin(0.05), -9.81 * np.cos(0.05)], "gravity turned by 2.865°"),
        ("points", CART["points"] | {"W": {"fixed": [-1, 0.25]}}, "points.W.fixed.1 +0.25 m"),
    ],
)
def test_directions_and_places_are_numbers_too(key, value, said):
    (fault,) = judged(cart({**CART, key: value}), CART, **BDF2).faults
    assert fault.name == "another mechanism"
    assert said in fault.text


def test_a_number_is_named_in_tables_of_tolerances():
    table = cart(with_number(("springs", "coil", "stiffness"), 1.1))
    table["tolerance"] = table.pop("h").replace(
        {0.01: 1e-5, 0.005: 1e-6, 0.0025: 1e-7, 0.00125: 1e-8}
    )
    (fault,) = judged(table, CART).faults
    assert fault.evidence["changes"] == {"springs.coil.stiffness": pytest.approx(0.1, rel=1e-3)}
    assert "the smallest tolerance is off" in fault.text


def test_a_motion_driven_otherwise_is_no_other_start():
    driven = {
        "gravity": [0, -9.81],
        "points": {"O": {"fixed": [0, 0]}, "A": {"at": [0.3, 0.4]}, "B": {"at": [0.7, 0.1],
                   "mass": 0.8}},
        "bodies": {"arm": {"from": "O", "to": "A", "length": 0.5, "mass": 1, "inertia": 0.03}},
        "bars": {"rod": {"from": "A", "to": "B", "length": 0.5}},
        "motions": {"drive": {"body": "arm", "angle": {"rate": 3.0}}},
        "project_velocities": True,
    }  # fmt: skip
    faster = {**driven, "motions": {"drive": {"body": "arm", "angle": {"rate": 3.06}}}}
    (fault,) = judged(cart(faster), driven, **BDF2).faults
    assert fault.evidence["changes"] == {"motions.drive.angle.rate": pytest.approx(0.02, rel=1e-3)}


def top_without_gyroscopic_moment(J, mass, centre, omega, t):
    """Directors and their rates, (k, 9) each: J ω' = r × m g about the joint, by Runge–Kutta."""

    def rate(_, y):
        axes, turn = y[:9].reshape(3, 3), y[9:]
        moment = np.cross(centre @ axes, [0, 0, -9.81 * mass])
        return np.concatenate(
            [np.cross(turn, axes).ravel(), np.linalg.solve(J, axes @ moment) @ axes]
        )

    start = np.concatenate([np.eye(3).ravel(), omega])
    solved = solve_ivp(rate, (0, t[-1]), start, "DOP853", rtol=1e-12, atol=1e-12, t_eval=t)
    return solved.y[:9].T, np.array(
        [np.cross(y[9:], y[:9].reshape(3, 3)).ravel() for y in solved.y.T]
    )


def test_a_gyroscopic_moment_left_out_is_named():
    """Of a top in Euler's equations about its joint."""
    body = BENCH.MECHANISMS["gyro"]["bodies"]["rotor"]
    mass, centre = body["mass"], np.array(body["centre"])
    J = np.diag(body["inertia"]) + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    t = np.array([0, 0.1, 0.2, 0.3])
    axes, rates = top_without_gyroscopic_moment(J, mass, centre, body["angular_velocity"], t)
    rows = [[h, t[k], *axes[k], *rates[k]] for h in (0.01, 0.005, 0.0025) for k in range(4)]
    names = [f"rotor.d{i}.{x}" for i in (1, 2, 3) for x in "xyz"]
    table = pd.DataFrame(rows, columns=["h", "t", *(f"{p}[{x}]" for p in "uv" for x in names)])
    for name in (f"{part}[rotor.origin.{x}]" for part in "uv" for x in "xyz"):
        table[name] = 0.0
    (fault,) = judged(table, BENCH.MECHANISMS["gyro"]).faults
    assert "the gyroscopic moment ω × J ω about the joint left out: this alone" in fault.text


def test_single_precision_is_told_by_nine_digits():
    """C prints a number of single precision by %.9g, which no double is."""
    table = swings()
    state = [name for name in table if name[0] in "uvl"]
    table[state] = table[state].map(lambda x: float(f"{np.float32(x):.9g}"))
    (fault,) = judged(table, THROWN).faults
    assert fault.name == "single precision"


def test_rows_of_the_next_step_are_no_other_start():
    table = cart(rows=range(321))
    state = [name for name in table if name[0] in "uvl"]
    table[state] = table.groupby("h")[state].shift(-1)
    (fault,) = judged(table.dropna(), CART, **BDF2).faults
    assert (fault.name, fault.evidence["shift"]) == ("late", 1.0)


def test_exchanged_columns_and_degrees_are_undone():
    document = {
        **CART,
        "points": {"O": {"fixed": [0, 0]}, "A": {"at": [0.6, 0.0], "velocity": [0, 1.2]}},
        "bars": {}, "sliders": {}, "springs": {}, "dampers": {},
        "bodies": {"arm": {"from": "O", "to": "A", "length": 0.6, "mass": 1.5, "inertia": 0.1}},
        "torsion_springs": {
            "leaf": {"to": "arm", "stiffness": 4, "rest_angle": 0.2}
        },
    }  # fmt: skip
    table = cart(document)
    for name in ("u[arm.angle]", "v[arm.angle]"):
        table[name] = np.degrees(table[name])
    found = judged(table, document, **BDF2)
    assert not found.faults
    assert any("u of arm.angle is taken to be in degrees" in note for note in found.notes)
    swapped = cart().rename(columns={"v[P.x]": "v[P.y]", "v[P.y]": "v[P.x]"})
    found = judged(swapped, CART, **BDF2)
    assert not found.faults
    assert any("velocities are in the order C.x, C.y, P.y, P.x" in note for note in found.notes)


@pytest.mark.parametrize(
    ("mechanism", "name"), [("crane", "RK4, nothing said"), ("rocker", "BDF1, nothing said")]
)
def test_orders_of_a_code_without_a_method_are_shown(mechanism, name):
    """No λ alternates from the start of a method that nobody names, and no order is too high."""
    (case,) = [one for one in BENCH.sound() if (one.mechanism, one.name) == (mechanism, name)]
    found = BENCH.verdict(case)[1]
    assert {slope.verdict for slope in found.slopes if slope.quantity in "uv"} == {"shown"}
    assert not found.fails()


def test_another_start_is_named_from_its_row_only():
    document = json.loads(json.dumps(CART))
    for point in ("C", "P"):
        document["points"][point]["velocity"] = [
            1.02 * x for x in document["points"][point]["velocity"]
        ]
    (fault,) = judged(cart(document), CART, **BDF2).faults
    assert (fault.name, fault.evidence["coordinate"]) == ("start", "v[P.x]")
    assert fault.evidence["off"] == pytest.approx(0.02, rel=0.02)
    assert "the motion from there is what the code computes" in fault.text
    (fault,) = judged(cart(document, rows=(-30, -20, -1)), CART, **BDF2).faults
    assert fault.name == "another mechanism"
    assert fault.evidence["changes"] == {"the start's velocities": pytest.approx(0.02, rel=1e-3)}


def scaled(part, factor):
    return lambda table: table.assign(
        **{name: factor(table["h"]) * table[name] for name in table if name.startswith(part)}
    )


@pytest.mark.parametrize(
    ("change", "factor", "power"),
    [
        (lambda h: 3.0, 3.0, 0),
        (lambda h: h, 1.0, 1),
        (lambda h: 0.25 * h**2, 0.25, 2),
        (lambda h: h**-2, 1.0, -2),
    ],
)
def test_a_factor_of_the_multipliers_is_told_with_its_power_of_h(change, factor, power):
    (fault,) = judged(scaled("lambda", change)(cart()), CART, **BDF2).faults
    assert fault.name == "factor of λ"
    assert fault.evidence["powers"] == [power, power]
    assert [*fault.evidence["factors"].values()] == pytest.approx([factor] * 2, rel=0.02)


def test_multipliers_of_another_time_are_told():
    table = cart(rows=range(-40, 0))
    lambdas = [name for name in table if name.startswith("lambda")]
    table[lambdas] = table.groupby("h")[lambdas].shift(1)
    (fault,) = judged(table.dropna(), CART, **BDF2).faults
    assert (fault.name, fault.evidence["shift"]) == ("late", -1.0)


def test_order_1_is_a_fault_only_of_a_method_that_is_named():
    table = cart(integrator="bdf1")
    (note,) = judged(table, CART).findings
    assert not note.fault
    assert note.name == "backward Euler"
    assert note.evidence["orders"]["u"] == pytest.approx(1, abs=0.1)
    assert "No order was expected, as no integrator was named." in judged(table, CART).conclusion
    named = judged(table, CART, integrator="bdf1")
    assert (named.findings, named.conclusion) == ([], "Nothing wrong was found.")
    (fault,) = judged(table, CART, **BDF2).faults
    assert fault.name == "backward Euler"


def test_few_digits_limit_what_is_said_and_are_no_fault(cli):
    cart().to_csv(cli.folder / "few.csv", index=False, float_format="%.9g")
    found = judged(cli.folder / "few.csv", CART, **BDF2)
    assert [(one.name, one.fault) for one in found.findings] == [("printing", False)]
    assert not found.fails()
    assert "Nothing wrong was found." in str(found)


def test_what_is_expected_takes_the_place_of_the_order_of_the_method():
    table = cart(integrator="bdf1")
    expect = [{"quantity": ["u", "v"], "slope": 1, "within": 0.15}]
    held = judged(table, CART, expect=expect)
    assert {one.verdict for one in held.expected} == {"pass"}
    assert not held.fails()


@pytest.mark.parametrize("parts", ["tu", "tuv"])
def test_fewer_columns_still_name_a_number_or_those_that_cannot_be_told_apart(parts):
    table = cart(with_number(("springs", "coil", "stiffness"), 1.1), parts, (*range(-40, 0, 5), -1))
    (fault,) = judged(table, CART, **BDF2).faults
    assert "springs.coil.stiffness" in fault.evidence["changes"]
    change = fault.evidence["changes"]["springs.coil.stiffness"]
    assert change == pytest.approx(0.1, rel=2e-2)


def test_a_motion_past_a_singular_position_is_judged_by_differences():
    """A parallel four-bar that passes its flat position: x + h² c, from its last rows."""
    flat = {
        "points": {"O": {"fixed": [0, 0]}, "Q": {"fixed": [1, 0]},
                   "A": {"at": [0, 1], "mass": 1, "velocity": [1, 0]},
                   "B": {"at": [1, 1], "mass": 1, "velocity": [1, 0]}},
        "bars": {"a": {"from": "O", "to": "A", "length": 1},
                 "b": {"from": "A", "to": "B", "length": 1},
                 "c": {"from": "Q", "to": "B", "length": 1}},
        "gravity": [0, -9.81],
    }  # fmt: skip
    h = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    table = pd.DataFrame({"h": h, "t": 3.0, "u[A.x]": 0.3 + 5 * h**2, "u[A.y]": 0.9 - h**2})
    found = judged(table, flat)
    (note,) = found.findings
    assert (note.name, note.fault) == ("no solution", False)
    assert "of u with order 2.00" in note.text
    assert "singular position" in note.text


@pytest.mark.parametrize(
    "name",
    [
        "crane: RK4, nothing said",
        "rocker: bodies.arm.centre.0 × 1.02",
        "crane: a(0) = 0",
        "triple: γ + 0.08, nothing said",
        "crane: no centrifugal terms",
    ],
)
def test_tables_of_the_bench_are_judged_rightly(name):
    (case,) = [one for one in (*BENCH.sound(), *BENCH.faulty())
               if f"{one.mechanism}: {one.name}" == name]  # fmt: skip
    said, found = BENCH.verdict(case)
    assert said == ("right" if case.right else "sound")
    if case.change:
        assert BENCH.number(case, found) == "number"
