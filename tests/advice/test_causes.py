"""Causes of what other codes compute wrongly: the number, the term or the change of a step."""

import itertools
import json
import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from judged_tables import (
    BDF2,
    BENCH,
    CART,
    THROWN,
    cart,
    fitted,
    judged,
    of_motion,
    swings,
    with_number,
)
from scipy.spatial.transform import Rotation

import newmark_cli as newmark
from newmark_cli.codes.changes import FittedChange, explained_by
from newmark_cli.codes.evidence import SeriesErrors
from newmark_cli.codes.truth import Truth


@pytest.mark.parametrize(
    ("path", "factor", "among", "said"),
    [
        (("points", "P", "mass"), 1.05, [""], "points.P.mass × 1.05"),
        (("springs", "coil", "rest_length"), 1.01, [""], "springs.coil.rest_length × 1.01"),
        (("dampers", "oil", "damping"), 0.0, ["oil", "drag"], "dampers.oil.damping left out"),
        (("gravity",), -1.0, ["gravity", "mass"], "gravity with its sign turned"),
    ],
)  # fmt: skip
def test_the_one_number_that_differs_is_named_with_its_value(path, factor, among, said):
    # A spring's own length shows later, as the others do where few columns tell of them.
    long = {"t_end": 0.4} if path[-1] == "rest_length" else {}
    (fault,) = judged(cart(with_number(path, factor), **long), CART, among, **BDF2).faults
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


def test_a_component_of_gravity_is_a_number_too():
    slope = {**CART, "gravity": [1.2, -9.7]}
    table = cart({**CART, "gravity": [1.1, -9.7]})
    (fault,) = judged(table, slope, ["gravity", "mass"], **BDF2).faults
    assert fault.evidence["changes"] == {"gravity.0": pytest.approx(1.1 / 1.2 - 1, rel=1e-3)}


def test_a_place_on_the_wrong_side_is_told():
    walls = [{**CART, "points": CART["points"] | {"W": {"fixed": [x, 0.25]}}} for x in (-1, 1)]
    (fault,) = judged(cart(walls[1]), walls[0], ["coil", "points.W"], **BDF2).faults
    assert fault.evidence["changes"] == {"points.W.fixed.0": pytest.approx(2.0, rel=1e-3)}


def test_a_length_is_told_by_how_much_it_differs():
    """A bar between two points that move, whose start has that length, too."""
    long = {**CART, "bars": {"rod": {"from": "C", "to": "P", "length": 0.51}}}
    long["points"] = CART["points"] | {"P": CART["points"]["P"] | {"at": [0.306, -0.408]}}
    (fault,) = judged(cart(long), CART, **BDF2).faults
    assert fault.evidence["changes"] == {"bars.rod.length": pytest.approx(0.02, rel=1e-6)}
    assert "bars.rod.length × 1.02: " in fault.text


def slot(offset):
    """A block in a slot of an arm that turns, beside the arm's line."""
    return {
        "points": {
            "O": {"fixed": [0, 0]},
            "A": {"at": [0.5, 0], "velocity": [0, 1.5]},
            "S": {"at": [0.28, offset], "mass": 0.6, "velocity": [0.5 - 3 * offset, 0.84]},
        },
        "bodies": {"arm": {"from": "O", "to": "A", "length": 0.5, "mass": 1, "inertia": 0.02}},
        "sliders": {
            "slot": {"point": "S", "on": "arm", "through": [0, offset], "direction": [1, 0]}
        },
        "springs": {"coil": {"from": "A", "to": "S", "stiffness": 60, "rest_length": 0.3}},
        "gravity": [0, -9.81],
    }


def test_a_place_of_a_slot_is_missed_alike_while_the_gradient_changes():
    (fault,) = judged(cart(slot(0.03)), slot(0.04), **BDF2).faults
    assert fault.evidence["changes"] == {"sliders.slot.through.1": pytest.approx(-0.01, rel=1e-6)}
    assert "Φ of sliders.slot is missed" in fault.text


def test_two_differences_of_the_named_order_tell_numbers_apart():
    table = cart(with_number(("springs", "coil", "stiffness"), 1.01))
    (fault,) = judged(table[table["h"] > 0.002], CART, ["coil", "mass"], **BDF2).faults
    assert fault.evidence["changes"] == {"springs.coil.stiffness": pytest.approx(0.01, rel=1e-2)}


def test_a_number_is_named_in_tables_of_tolerances():
    table = cart(with_number(("springs", "coil", "stiffness"), 1.1))
    table["tolerance"] = table.pop("h").replace(
        {0.01: 1e-5, 0.005: 1e-6, 0.0025: 1e-7, 0.00125: 1e-8}
    )
    (fault,) = judged(table, CART, ["coil", "mass"]).faults
    assert fault.evidence["changes"] == {"springs.coil.stiffness": pytest.approx(0.1, rel=1e-3)}
    assert "the smallest tolerance is off" in fault.text


DRIVEN = {
    "gravity": [0, -9.81],
    "points": {"O": {"fixed": [0, 0]}, "A": {"at": [0.3, 0.4]}, "B": {"at": [0.7, 0.1],
               "mass": 0.8}},
    "bodies": {"arm": {"from": "O", "to": "A", "length": 0.5, "mass": 1, "inertia": 0.03,
                       "centre": [0.2, 0]}},
    "bars": {"rod": {"from": "A", "to": "B", "length": 0.5}},
    "motions": {"drive": {"body": "arm", "angle": {"rate": 3.0, "amplitude": 0.2,
                                                   "frequency": 6}}},
    "project_velocities": True,
}  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value", "name", "change"),
    [
        ("rate", 3.06, "motions.drive.angle.rate", 0.02),
        ("phase", 0.1, "motions.drive.angle.phase", 0.1),
    ],
)
def test_a_motion_driven_otherwise_is_no_other_start(key, value, name, change):
    law = DRIVEN["motions"]["drive"]["angle"] | {key: value}
    other = {**DRIVEN, "motions": {"drive": {"body": "arm", "angle": law}}}
    (fault,) = judged(cart(other), DRIVEN, ["motions", "mass"], **BDF2).faults
    assert fault.evidence["changes"] == {name: pytest.approx(change, rel=1e-3)}


def test_a_ratio_of_gears_is_no_other_start():
    """Nor where points are assembled: teeth mesh where the start is, not where the file says."""

    def geared(ratio):
        return {
            "points": {"O": {"fixed": [0, 0]}, "C": {"fixed": [0.3, 0]}, "B": {"at": [0.45, 0]},
                       "A": {"at": [0.1, 0.0], "mass": 0.3, "velocity": [0, 0.4]}},
            "bodies": {"pinion": {"from": "O", "to": "A", "length": 0.1, "mass": 0.5,
                                  "inertia": 0.002},
                       "wheel": {"from": "C", "to": "B", "length": 0.15, "mass": 0.9,
                                 "inertia": 0.01}},
            "gears": {"mesh": {"from": "pinion", "to": "wheel", "ratio": ratio}},
            "gravity": [0, -9.81],
            "project_velocities": True,
        }  # fmt: skip

    right, wrong = {**geared(-0.5), "assemble": True}, geared(-0.55)
    right["points"]["B"]["at"] = [0.44, 0.05]
    starts = newmark.problem(right)
    u = dict(zip(starts.coordinate_names, starts.u0.tolist(), strict=True))
    for name in "AB":
        wrong["points"][name]["at"] = [u[f"{name}.x"], u[f"{name}.y"]]
    for table, problem in ((cart(geared(-0.55)), geared(-0.5)), (cart(wrong), right)):
        (fault,) = judged(table, problem, **BDF2).faults
        assert fault.evidence["changes"] == {"gears.mesh.ratio": pytest.approx(0.1, rel=1e-6)}


def test_a_mass_that_only_multipliers_feel_is_no_factor_of_them():
    """Of a driven mechanism without a degree of freedom: a mass scales some λ, and not all."""
    slide = {**DRIVEN, "sliders": {"guide": {"point": "B", "through": [0, 0.1],
                                             "direction": [1, 0]}}}  # fmt: skip
    heavy = {**slide, "points": slide["points"] | {"B": {"at": [0.7, 0.1], "mass": 0.88}}}
    (fault,) = judged(cart(heavy), slide, ["mass"], **BDF2).faults
    assert fault.evidence["changes"] == {"points.B.mass": pytest.approx(0.1, rel=1e-3)}
    (fault,) = judged(scaled("lambda", lambda h: 1.1)(cart(slide)), slide, ["mass"], **BDF2).faults
    assert fault.name == "factor of λ"
    assert [*fault.evidence["factors"].values()] == pytest.approx([1.1] * 4, rel=1e-3)


def test_the_direction_of_a_slider_is_no_other_start():
    def along(angle):
        rail = {"point": "C", "through": [0, 0], "direction": [np.cos(angle), np.sin(angle)]}
        return {**CART, "sliders": {"rail": rail}, "project_velocities": True}

    (fault,) = judged(cart(along(0.02)), along(0.0), **BDF2).faults
    assert fault.evidence["changes"] == {"sliders.rail.direction": pytest.approx(0.02, rel=1e-3)}
    assert "turned by 1.146°" in fault.text


def test_an_axis_in_space_is_told_with_where_it_points():
    def hinge(axis):
        return {
            "dimensions": 3,
            "bodies": {"arm": {"position": [0, 0, -0.2], "mass": 1.5, "box": [0.06, 0.05, 0.4]}},
            "joints": {"pin": {"type": "revolute", "from": "ground", "to": "arm",
                               "at": [0, 0, 0], "axis": axis}},
            "rates": {"pin": 2},
            "gravity": [0, 0, -9.81],
        }  # fmt: skip

    tilted = [np.cos(0.03), np.sin(0.03) * 0.8, np.sin(0.03) * 0.6]
    (fault,) = judged(cart(hinge(tilted)), hinge([1, 0, 0]), **BDF2).faults
    assert fault.evidence["changes"] == {"joints.pin.axis": pytest.approx(0.03, rel=1e-3)}
    assert "joints.pin.axis tilted by 1.719°, to [0.99955, 0.024, 0.018]" in fault.text


def test_numbers_beside_forces_in_python_are_named(tmp_path):
    (tmp_path / "air.py").write_text("def drag(places, pace, t):\n    return -0.4 * pace\n")

    def problem(name, stiffness):
        document = {
            "points": {"W": {"fixed": [0, 0]}, "C": {"at": [1, 0], "mass": 1.4}},
            "sliders": {"rail": {"point": "C", "through": [0, 0], "direction": [1, 0]}},
            "springs": {"coil": {"from": "W", "to": "C", "stiffness": stiffness,
                                 "rest_length": 0.8}},
            "python_forces": {"air": {"python": "air.py:drag", "on": ["C"]}},
        }  # fmt: skip
        (tmp_path / name).write_text(json.dumps(document))
        return newmark.problem(tmp_path / name, allow_code=True)

    ours = problem("ours.yaml", 30.0)
    (fault,) = judged(cart(problem("theirs.yaml", 33.0)), ours, ["coil", "mass"], **BDF2).faults
    assert fault.evidence["changes"] == {"springs.coil.stiffness": pytest.approx(0.1, rel=1e-3)}
    (fault,) = judged(of_motion(ours, lambda t, u, v: 0.4 * v), ours, ["Python", "mass"]).faults
    assert "the forces in Python left out" in fault.text


def test_single_precision_is_told_by_nine_digits():
    """C prints a number of single precision by %.9g, which no double is."""
    table = swings()
    state = [name for name in table if name[0] in "uvl"]
    table[state] = table[state].map(lambda x: float(f"{np.float32(x):.9g}"))
    (fault,) = judged(table, THROWN).faults
    assert fault.name == "single precision"


def test_coordinates_that_are_stored_in_single_precision_are_no_other_length():
    table = swings()
    places = [name for name in table if name[0] == "u"]
    table[places] = table[places].astype(np.float32)
    (fault,) = judged(table, THROWN).faults
    assert fault.name == "single precision"
    assert fault.text.startswith("every number of u is one of single precision")


def test_velocities_of_half_a_step_before_are_told_of_a_code_of_order_2():
    """Also where 16 % of their error is something else: no change of a step does it to v only."""
    table = cart(rows=range(-20, 0))
    rates = [name for name in table if name[0] == "v"]
    before = table.groupby("h")[rates].shift(1)
    table[rates] = 0.57 * table[rates] + 0.43 * before
    (fault,) = judged(table.dropna(), CART).faults
    assert (fault.name, fault.evidence["parts"], fault.evidence["shift"]) == ("late", ["v"], -0.5)
    assert fault.evidence["left"] == pytest.approx(0.07 / 0.43, rel=0.05)


def test_multipliers_without_centrifugal_terms_are_told_where_u_and_v_are_right():
    """λ of M a = f + G λ, Gᵀa = 0 at the states of a march."""
    problem, table = newmark.problem(CART), cart()
    u, v = (table[[f"{part}[{name}]" for name in problem.coordinate_names]] for part in "uv")
    for row in table.index:
        none = np.zeros(problem.m)
        x = problem.evaluate(table["t"][row], u.loc[row].to_numpy(), v.loc[row].to_numpy(), none)
        inverse = np.linalg.inv(problem.M)
        implied = np.linalg.solve(x.G.T @ inverse @ x.G, -x.G.T @ inverse @ x.force)
        for name, value in zip(problem.constraint_names, implied, strict=True):
            table.loc[row, f"lambda[{name}]"] = value
    (fault,) = judged(table, CART, **BDF2).faults
    assert fault.evidence["changes"] == {
        "κ of Gᵀa + κ = 0 (centrifugal terms) in λ": pytest.approx(-1, rel=1e-3)
    }


def test_rows_of_the_next_step_are_no_other_start():
    table = cart(rows=range(-20, 0))
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
    table["u[arm.angle]"] = np.degrees(table["u[arm.angle]"])
    table["v[arm.angle]"] *= 30 / np.pi
    found = judged(table, document, **BDF2)
    assert not found.faults
    assert any("v of arm.angle is taken to be in revolutions per m" in one for one in found.notes)
    assert any("u of arm.angle is taken to be in degrees" in note for note in found.notes)
    table = cart().assign(**{"u[P.x]": 1e3 * cart()["u[P.x]"]})
    found = judged(table, CART, **BDF2)
    assert not found.faults
    assert any("u of P.x is taken to be in mm" in note for note in found.notes)
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


def ends_of(document, t_end):
    """A table of backward Euler: the first and last row of three step sizes."""
    found = []
    for h in (0.01, 0.005, 0.0025):
        frame = newmark.march(document, h=h, t_end=t_end, integrator="bdf1").to_frame()
        kept = [name for name in frame if name[0] in "tuvl" and name[:2] != "to"]
        found.append(frame[kept].iloc[[0, -1]].assign(h=h))
    return pd.concat(found, ignore_index=True)


def test_coarse_steps_of_a_sound_code_are_no_other_mechanism():
    """Errors of 29 % to 85 % of a motion that is nearly chaotic, which a drag would explain."""
    rocker = BENCH.MECHANISMS["rocker"]
    assert judged(ends_of(rocker, 0.8), rocker).faults == ()


def test_euler_is_named_where_weights_that_are_off_explain_as_much():
    triple = BENCH.MECHANISMS["triple"]
    (fault,) = judged(ends_of(triple, 0.7), triple, **BDF2).faults
    assert fault.name == "backward Euler"
    assert fault.evidence["tried"]["averaging"]["leaves"] < 0.15


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
    (fault,) = judged(
        cart(document, rows=(-30, -20, -1), t_end=0.4), CART, ["start"], **BDF2
    ).faults
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
    """Also where the table does not have all of λ."""
    table = scaled("lambda", change)(cart())
    for count, given in ((2, table), (1, table.drop(columns="lambda[sliders.rail]"))):
        (fault,) = judged(given, CART, ["mass", "κ"], **BDF2).faults
        assert fault.name == "factor of λ"
        assert fault.evidence["powers"] == [power] * count
        assert [*fault.evidence["factors"].values()] == pytest.approx([factor] * count, rel=0.02)


def test_multipliers_of_another_time_are_told():
    table = cart(rows=range(-40, 0), t_end=0.4)
    lambdas = [name for name in table if name.startswith("lambda")]
    table[lambdas] = table.groupby("h")[lambdas].shift(1)
    (fault,) = judged(table.dropna(), CART, **BDF2).faults
    assert (fault.name, fault.evidence["shift"]) == ("late", -1.0)


def test_multipliers_from_differences_of_velocities_are_told():
    """λ of M (v − v of the step before)/h = f + G λ is of order 1, where u and v have order 2."""
    problem, table = newmark.problem(CART), cart(rows=range(-40, 0), t_end=0.4)
    u, v = (table[[f"{part}[{name}]" for name in problem.coordinate_names]] for part in "uv")
    a = v.groupby(table["h"]).diff().div(table["h"], axis=0)
    for row in table.index[a.notna().all(axis=1)]:
        x = problem.evaluate(table["t"][row], *(of.loc[row].to_numpy() for of in (u, v)), [0, 0])
        found = np.linalg.lstsq(x.G, problem.M @ a.loc[row].to_numpy() - x.force, rcond=None)[0]
        for name, value in zip(problem.constraint_names, found, strict=True):
            table.loc[row, f"lambda[{name}]"] = value
    (fault,) = judged(table[a.notna().all(axis=1)], CART, **BDF2).faults
    assert (fault.name, fault.evidence["parts"]) == ("late", ["lambda"])
    assert fault.evidence["shift"] == pytest.approx(-0.5, abs=0.05)
    assert "accelerations of t − 0.5" in fault.text


def test_a_coarsest_run_that_does_not_fit_is_left_out_and_said_to_be():
    table = cart()
    table.loc[(table["h"] == 0.01) & (table["t"] > 0), ["u[P.x]", "v[P.x]"]] *= 1.3
    notes = [one for one in judged(table, CART).findings if one.name == "mixed"]
    assert [(one.fault, one.evidence["h"]) for one in notes] == [(False, 0.01)]
    assert "as that h is the coarsest, the run is left out" in notes[0].text


def test_order_1_is_a_fault_only_of_a_method_that_is_named():
    table = cart(integrator="bdf1")
    unnamed = judged(table, CART, ["mass"])
    (note,) = unnamed.findings
    assert not note.fault
    assert note.name == "backward Euler"
    assert note.evidence["left"] < 1e-3
    assert note.evidence["orders"]["u"] == pytest.approx(1, abs=0.1)
    assert "No order was expected, as no integrator was named." in unnamed.conclusion
    named = judged(table, CART, integrator="bdf1")
    assert (named.findings, named.conclusion) == ([], "Nothing wrong was found.")
    (fault,) = judged(table, CART, ["mass"], **BDF2).faults
    assert fault.name == "backward Euler"
    expect = [{"quantity": ["u", "v"], "slope": 1, "within": 0.15}]
    held = judged(table, CART, expect=expect)
    assert {one.verdict for one in held.expected} == {"pass"}
    assert not held.fails()


def test_few_digits_limit_what_is_said_and_are_no_fault(cli):
    cart().to_csv(cli.folder / "few.csv", index=False, float_format="%.9g")
    found = judged(cli.folder / "few.csv", CART, **BDF2)
    assert [(one.name, one.fault) for one in found.findings] == [("printing", False)]
    assert not found.fails()
    assert "Nothing wrong was found." in str(found)


def test_fewer_columns_still_name_a_number_or_those_that_cannot_be_told_apart():
    stiff = with_number(("springs", "coil", "stiffness"), 1.1)
    table = cart(stiff, "tu", (*range(-40, 0, 5), -1), t_end=0.4)
    (fault,) = judged(table, CART, ["coil", "oil", "mass"], **BDF2).faults
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


def test_a_step_without_centrifugal_terms_is_told():
    """Of a whole code, as the bench has it."""
    (case,) = [one for one in BENCH.faulty()
               if (one.mechanism, one.name) == ("crane", "no centrifugal terms")]  # fmt: skip
    with fitted(["κ", "mass", "drag"]):
        assert BENCH.verdict(case)[0] == "right"


def test_an_interpolation_of_a_table_is_named():
    """With which the start's velocities are others, too."""

    def driven(interpolation):
        t = np.linspace(0, 0.35, 8)
        angles = math.atan2(0.4, 0.3) + 3 * t + 0.2 * np.sin(6 * t)
        table = {"times": t.tolist(), "values": angles.tolist(), "interpolation": interpolation}
        return {**DRIVEN, "motions": {"drive": {"body": "arm", "angle": {"table": table}}}}

    (fault,) = judged(cart(driven("cubic")), driven("quintic"), ["motions"], **BDF2).faults
    assert "motions.drive.angle.table.interpolation cubic in place of quintic" in fault.text


def test_a_load_of_several_numbers_is_named_as_a_whole():
    def pushed(sign):
        force = [{"value": 2.0 * sign, "amplitude": 3.0 * sign, "frequency": 7}, 0.5 * sign]
        return {**CART, "forces": {"push": {"at": "C", "force": force}}}

    (fault,) = judged(cart(pushed(-1)), pushed(1), ["push", "further"], **BDF2).faults
    assert "forces.push.force with its sign turned: this alone" in fault.text


def test_the_gyroscopic_moment_of_one_body_is_named():
    """Of two that are free: one turns about a principal axis, the other lacks ω × J ω."""
    spins = {"drum": np.array([4.0, 0.0, 0.0]), "hub": np.array([2.0, 5.0, 1.0])}
    mechanism = {
        "dimensions": 3,
        "bodies": {
            name: {"position": [2.0 * k, 0, 0], "mass": 1, "inertia": [0.1, 0.2, 0.25],
                   "angular_velocity": spin.tolist()}
            for k, (name, spin) in enumerate(spins.items())
        },
    }  # fmt: skip
    rows = []
    for h, t in itertools.product((0.01, 0.005, 0.0025), (0.0, 0.1, 0.2, 0.3)):
        row = {"h": h, "t": t}
        for k, (name, spin) in enumerate(spins.items()):
            axes = Rotation.from_rotvec(spin * t).as_matrix().T
            vectors = {"origin": ([2.0 * k, 0, 0], [0, 0, 0])}
            vectors |= {f"d{i + 1}": (axes[i], np.cross(spin, axes[i])) for i in range(3)}
            for vector, fields in vectors.items():
                for part, values in zip("uv", fields, strict=True):
                    row |= {f"{part}[{name}.{vector}.{x}]": values[i] for i, x in enumerate("xyz")}
        rows.append(row)
    (fault,) = judged(pd.DataFrame(rows), mechanism, ["gyroscopic"]).faults
    assert "the gyroscopic moment ω × J ω of hub left out" in fault.text
    assert "of drum" not in fault.text


def test_what_falls_with_h_is_no_number(monkeypatch):
    """The phase of a force that is taken at the start of each step explains any one run."""
    # Also where differences of step sizes are so small in some rows that runs seem to converge.
    bound = SeriesErrors.bound
    monkeypatch.setattr(SeriesErrors, "bound", lambda evidence, part: bound(evidence, part) / 20)

    def pushed(phase):
        law = {"amplitude": 9.0, "frequency": 14, "phase": phase}
        return {**CART, "forces": {"push": {"at": "C", "force": [law, 0]}}}

    tables = []
    for h in (0.01, 0.005, 0.0025, 0.00125):
        frame = newmark.march(pushed(0.4 - 14 * h), h=h, t_end=0.4, **BDF2).to_frame()
        kept = [name for name in frame if name[0] in "tuv" and name[:2] != "to"]
        tables.append(frame[kept].iloc[-2:].assign(h=h))
    (fault,) = judged(pd.concat(tables), pushed(0.4), ["push"], **BDF2).faults
    assert fault.name == "old force"


def test_a_table_of_velocities_alone():
    (fault,) = judged(
        cart(with_number(("gravity",), 1.1), "tv"), CART, ["gravity", "mass"], **BDF2
    ).faults
    assert fault.evidence["changes"] == {"gravity": pytest.approx(0.1, rel=1e-2)}


def test_errors_that_still_fall_are_no_other_solution():
    """As Runge-Kutta's of order 4 do where those of order 6 hide them at large h."""
    end = Truth(newmark.problem(CART), 0.4).at(np.array([0.4]))["u"][0, 0]
    errors = {0.025: 1.24e-5, 0.0125: 2.05e-7, 0.00625: 4.65e-9, 0.003125: 8.28e-10}
    table = pd.DataFrame({"h": [*errors], "t": 0.4, "u[C.x]": [end + e for e in errors.values()]})
    assert not judged(table, CART).faults


@pytest.mark.parametrize(("second", "names"), [(0.7, ["better"]), (0.69, ["better", "other"])])
def test_a_much_better_explanation_stands_alone(second, names):
    """Of two that explain the table, by four times what the better leaves, and 0.3."""
    fits = [
        FittedChange(worst, 0.0, 0.0, 1.0, SimpleNamespace(name=name, rank=0))
        for name, worst in (("better", 0.1), ("other", second))
    ]
    assert [fit.candidate.name for fit in explained_by(fits)] == names
