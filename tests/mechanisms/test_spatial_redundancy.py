"""Redundant rows of mechanisms of any size: which are dropped, and where they are needed."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import scipy.integrate
import scipy.sparse
import yaml
from mechanisms import built
from spatial import RATIO, START, bennett

import newmark_cli as newmark
from newmark_cli.mechanisms import start
from newmark_cli.problems import singular
from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet
from newmark_cli.support.documents import DocumentError

DAMPED = "generalized-alpha rho=0.9"
BRICARD = newmark.problem("bricard").sources["bricard.yaml"].decode()


def four_bars(count, lean=0.2, redundant="drop"):
    """Four-bar linkages that share the ground, each in a plane of its own."""
    bodies, joints = [], []
    for i in range(count):
        axis = f"axis: [{0.1 * i}, 1, 0]"
        bodies += [
            f"  l{i}: {{position: [0, {i}, 0], mass: 1, inertia: [1, 1, 1]}}",
            f"  p{i}: {{position: [0, {i}, -1], mass: 2, inertia: [1, 2, 3]}}",
            f"  r{i}: {{position: [1, {i - 0.1 * i}, 0], mass: 1, inertia: [1, 1, 1]}}",
        ]
        for name, one, two, x, z in (
            ("A", "ground", f"l{i}", 0, 0), ("B", f"l{i}", f"p{i}", 0, -1),
            ("C", f"p{i}", f"r{i}", 1, -1 - lean), ("D", "ground", f"r{i}", 1, 0),
        ):  # fmt: skip
            at = f"at: [{x}, {i - 0.1 * i * x:g}, {z:g}]"
            joints.append(f"  {name}{i}: {{type: revolute, from: {one}, to: {two}, {at}, {axis}}}")
    lines = ["dimensions: 3", "bodies:", *bodies, "joints:", *joints]
    return "\n".join([*lines, "gravity: [0, 0, -9.81]", f"redundant: {redundant}", ""])


@pytest.mark.parametrize("text", [four_bars(2), BRICARD.replace("{P5: [q]}", "drop")])
def test_large_mechanisms_drop_the_same_rows(text, monkeypatch):
    """The rule does not depend on how null vectors are found."""
    dense = built(text)
    monkeypatch.setattr(start, "DENSE_UP_TO", 10)
    sparse = built(text)
    assert dense.released
    assert sparse.released == dense.released
    assert sparse.outputs.not_unique == dense.outputs.not_unique
    assert sparse.n - sparse.m == dense.n - dense.m == (2 if "p1" in text else 1)
    np.testing.assert_allclose(sparse.v0, dense.v0, atol=1e-12)
    with pytest.raises(DocumentError) as caught:
        built(text.replace("redundant: drop", "redundant: refuse"))
    assert str(caught.value).endswith(f"releases {', '.join(dense.released)}")


def door(off=1e-9, lean=0.0, redundant="{high: [x, y, z, p, q]}", more=""):
    """A door whose second hinge is a little out of line."""
    return (
        "dimensions: 3\nbodies:\n"
        "  door: {position: [0.4, 0, 1], mass: 20, box: [0.8, 0.04, 2]}\njoints:\n"
        "  low: {type: revolute, from: ground, to: door, at: [0, 0, 0.2], axis: [0, 0, 1]}\n"
        f"  high: {{type: revolute, from: ground, to: door, at: [{off!r}, 0, 1.8], "
        f"axis: [{lean!r}, 0, 1]}}\n"
        f"gravity: [0, -9.81, -9.81]\nredundant: {redundant}\n{more}"
    )


#: How long the door falls (s).
FALLS = 0.5


@pytest.mark.parametrize(("off", "lean"), [(1e-6, 0.0), (0.0, 1e-7)])
def test_rows_released_by_name_may_be_a_little_off(off, lean):
    """A second hinge out of line leaves the freedom to open, and the motion of the first."""
    subject = built(door(off, lean))
    assert (subject.n, subject.m) == (12, 11)
    assert subject.released == ("high.x", "high.y", "high.z", "high.p", "high.q")
    done = newmark.march(subject, h=1e-3, t_end=FALLS, every=0, integrator=DAMPED)
    assert done.status == "ok"
    # J φ'' = −m g (w/2) cos φ, J = m (w²/3 + d²/12), of width 0.8 and thickness 0.04.
    factor = 9.81 * 0.8 / 2 / (0.8**2 / 3 + 0.04**2 / 12)
    fallen = scipy.integrate.solve_ivp(
        lambda _, y: [y[1], -factor * np.cos(y[0])], (0, FALLS), [0, 0], rtol=1e-12, atol=1e-13
    )
    assert done.output("low.angle")[-1] == pytest.approx(fallen.y[0, -1], abs=2.5e-5)


@pytest.mark.parametrize(
    ("redundant", "off", "lean"), [("refuse", 1e-9, 0.0), ("drop", 1e-5, 0.0), ("drop", 0.0, 1e-7)]
)
def test_rows_that_nearly_depend_on_each_other_are_named_with_the_way_out(redundant, off, lean):
    """Not "nothing can move", and a march of what is left would be one of rounding."""
    with pytest.raises(DocumentError) as caught:
        built(door(off, lean, redundant))
    found = re.fullmatch(
        r".*joints\.high: these constraints nearly depend on each other: low \(x, y, z, p, q\), "
        r"high \(x, y, z, p, q\); the least singular value of G is (\S+); correct what is a little "
        r"off, or release rows: 'redundant: (\{high: \[x, y, z, p, q\]\})'",
        str(caught.value),
    )
    assert found
    assert 0.05 * max(off, lean) < float(found[1]) < max(off, lean)
    assert built(door(off, lean, found[2])).m == 11


def test_a_door_that_is_out_of_line_cannot_move():
    with pytest.raises(DocumentError, match="nothing can move"):
        built(door(1e-3, redundant="drop"))
    with pytest.raises(DocumentError, match=r"only 4 of high\.x, .* can be released"):
        built(door(1e-3))


def missed_by(done):
    """By how much (rad) the angles of a march of Bennett's loop miss the closed form."""
    theta = (START + np.unwrap(done.output("J1.angle"))) / 2
    phi = 2 * np.arctan(RATIO / np.tan(START / 2)) + np.unwrap(done.output("J2.angle"))
    right = 2 * np.arctan2(RATIO * np.cos(theta), np.sin(theta))
    return np.abs(np.angle(np.exp(1j * (right - phi)))).max()


@pytest.mark.parametrize(("formulation", "most"), [("index-3", 1e-12), ("index-2", 3e-6)])
def test_rows_that_are_dropped_are_redundant_all_along_the_motion(formulation, most):
    """On a whole turn of Bennett's loop, where three positions of one joint are needed twice."""
    subject = newmark.problem(bennett("drop"))
    assert (subject.n - subject.m, len(subject.released)) == (1, 3)
    done = newmark.march(
        subject, h=2e-3, t_end=4.0, every=20, integrator=DAMPED, formulation=formulation
    )
    assert done.status == "ok"
    assert np.ptp(np.unwrap(done.output("J4.angle"))) > 2 * np.pi - 0.5
    assert missed_by(done) < most
    gradients = singular.gradients(subject, np.zeros(len(done.u)), done.u)
    least = np.linalg.svd(gradients, compute_uv=False)[:, -1]
    assert min(least) > 0.5 * least[0]


def test_a_march_ends_where_a_released_row_opens(cli):
    """Without the positions of one joint Bennett's loop has two more motions at t = 1.82."""
    subject = newmark.problem(bennett({"J4": ["x", "y", "z"]}))
    options = {"h": 5e-3, "t_end": 2.0, "integrator": DAMPED}
    done = newmark.march(subject, **options, formulation="index-2")
    assert (done.status, done.success) == ("redundant", False)
    assert "released rows (J4.x, J4.y, J4.z) are needed at t = 1.8" in done.message
    assert re.search(r"J4\.[xyz] is open by 0\.\d+ of the mechanism's size", done.message)
    gap, _, kept = subject.gaps(done.t[-1], done.u[-1])
    assert gap > max(1e-3, 10 * kept)
    # Where the constraints are met at every step, the march goes on along the right motion.
    whole = newmark.march(subject, **options)
    assert whole.status == "ok"
    assert missed_by(whole) < 1e-9
    # A cell of a study says it, too; one that drops other rows does not end.
    for name, released in (("mine", {"J4": ["x", "y", "z"]}), ("other", "drop")):
        cli.write(f"{name}.yaml", yaml.safe_dump(bennett(released)))
    cli.write(
        "study.yaml",
        "study: mine\nproblem: [mine.yaml, other.yaml]\nform: u-lambda\nformulation: index-2\n"
        "preconditioning: optimal\nintegrator: {method: generalized-alpha, rho: 0.9}\nh: 5e-3\n"
        "t_end: 2\n",
    )
    done = cli("run", "study.yaml", code=1)
    assert done.stdout.startswith("mine: 1 redundant, 1 ok -> ")
    assert "released rows (J4.x, J4.y, J4.z) are needed at t = 1.8" in done.stderr


def test_axes_of_six_digits_are_made_perpendicular():
    """A table of a drawing is no mistake; mistakes of all bodies are not a lack of bodies."""
    text = (
        "dimensions: 3\nbodies:\n"
        "  b: {position: [0, 0, 0], mass: 1, inertia: [1, 1, 1], "
        "axes: {x: [0.866025, 0.5, 0], y: [-0.5, 0.866026, 0]}}\n"
        "joints:\n  J: {type: spherical, from: ground, to: b, at: [0, 0, 0]}\n"
    )
    directors = built(text).u0.reshape(4, 3)[1:]
    np.testing.assert_allclose(directors @ directors.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(directors[:2, 0], [0.866025, -0.5], atol=1e-6)
    with pytest.raises(DocumentError) as caught:
        built(text.replace("-0.5,", "-0.6,"))
    assert "perpendicular to x" in str(caught.value)
    assert "at least one" not in str(caught.value)


#: A parallelogram that swings in the plane: in space three rows are redundant.
SWING = """\
dimensions: 3
bodies:
  left: {position: [0, 0, 0], mass: 1, box: [0.1, 0.1, 1], centre: [0, 0, -0.5]}
  plate: {position: [0, 0, -1], mass: 2, inertia: [0.1, 0.2, 0.3], centre: [0.5, 0, 0]}
  right: {position: [1, 0, 0], mass: 1, box: [0.1, 0.1, 1], centre: [0, 0, -0.5]}
joints:
  A: {type: revolute, from: ground, to: left, at: [0, 0, 0], axis: [0, 1, 0]}
  B: {type: revolute, from: left, to: plate, at: [0, 0, -1], axis: [0, 1, 0]}
  C: {type: revolute, from: plate, to: right, at: [1, 0, -1], axis: [0, 1, 0]}
  D: {type: revolute, from: ground, to: right, at: [1, 0, 0], axis: [0, 1, 0]}
rates: {A: 1}
redundant: drop
gravity: [0, 0, -9.81]
"""
STUDY = """\
study: mine
problem: swing.yaml
preconditioning: optimal
form: u-lambda
integrator: {method: generalized-alpha, rho: 0.9}
measure: [trajectory, error]
h: [0.02, 0.01, 0.005]
t_end: 0.1
"""


def test_reactions_that_are_not_unique(cli):
    """They are named in the record, and wherever their values are shown or written."""
    cli.write("swing.yaml", SWING)
    cli.write("mine.yaml", STUDY)
    cli("run", "mine.yaml")
    results, swing = cli.folder / "results", newmark.problem(cli.folder / "swing.yaml")
    frame = pd.read_csv(results / "trajectory/mine.csv")
    done = newmark.march(swing, h=0.01, t_end=0.1, integrator="generalized-alpha rho=0.9")
    ours = frame[frame.h == 0.01].set_index("step")
    names = [f"output[{name}]" for name in done.output_names]
    np.testing.assert_array_equal(ours[names], done.outputs[ours.index])
    shared = {name.split(".")[0] for name in swing.outputs.not_unique}
    assert shared == {"A", "B", "C", "D"}
    # The forces in the plane are unique, but their names are those of whole reactions.
    assert set(swing.outputs.not_unique) == {
        name for name in swing.outputs.names if ".force." in name or ".moment." in name
    }
    record = json.loads((results / "mine.json").read_text())["not_unique"]
    assert record == {
        "swing.yaml": {
            "outputs": list(swing.outputs.not_unique), "released": list(swing.released),
        }
    }  # fmt: skip
    assert len(swing.released) == 3
    dropped = f"not unique: redundant, dropped: {', '.join(swing.released)}"
    for quantity, said in (("force", True), ("lambda", True), ("omega", False), ("u", False)):
        shown = cli("show", "mine", "--quantity", quantity, "--measure", "error").stdout
        assert (dropped in " ".join(shown.split())) == said
    slopes = newmark.slopes(newmark.run(cli.folder / "mine.yaml", results=results))
    said = slopes[slopes["reason"].str.contains(dropped, regex=False)]
    assert set(said["quantity"]) >= {"force", "lambda"}
    assert not {"omega", "u"} & set(said["quantity"])
    sheet = mechanism_sheet("Swing", swing, swing.u0)
    assert sheet.panels[0].x_label == dropped.removeprefix("not unique: ")
    assert newmark.march(swing, h=0.02, steps=1).not_unique == swing.outputs.not_unique
    assert newmark.problem("heavy-top").outputs.not_unique == ()
