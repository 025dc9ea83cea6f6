"""Reactions by name along a march, and those that are no property of the mechanism."""

import json

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet

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
cases:
  - {measure: [trajectory, error], h: [0.02, 0.01, 0.005], t_end: 0.1}
  - {measure: trajectory, problem: pendulum, h: 0.02, t_end: 0.1}
"""


@pytest.fixture
def ran(cli):
    """A folder with the study's results."""
    (cli.folder / "swing.yaml").write_text(SWING)
    (cli.folder / "mine.yaml").write_text(STUDY)
    cli("run", "mine.yaml")
    return cli


def test_trajectories_by_name(ran):
    """Reactions, angular velocities and energy at every recorded step, as the library has them."""
    frame = pd.read_csv(ran.folder / "results/trajectory/mine.csv")
    swing = newmark.problem(ran.folder / "swing.yaml")
    done = newmark.march(swing, h=0.01, t_end=0.1, integrator="generalized-alpha rho=0.9")
    ours = frame[(frame.problem == "swing.yaml") & (frame.h == 0.01)].set_index("step")
    multipliers = [f"lambda[{name}]" for name in done.constraint_names]
    np.testing.assert_array_equal(ours[multipliers], done.multipliers[ours.index])
    names = [f"output[{name}]" for name in done.output_names]
    np.testing.assert_array_equal(ours[names], done.outputs[ours.index])
    np.testing.assert_array_equal(ours["energy"], done.energy[ours.index])
    # Each problem has its own columns; a planar one its multipliers.
    plane = frame[frame.problem == "pendulum"]
    assert plane["lambda[bars.rod]"].notna().all()
    assert plane[[*multipliers, *names]].isna().to_numpy().all()
    # The CSV has the largest of each kind.
    table = pd.read_csv(ran.folder / "results/mine.csv")
    table = table[(table.measure == "trajectory") & (table.problem == "swing.yaml")]
    largest = table[table.h == 0.01].set_index("quantity")["max"]
    assert list(largest.index) == ["u", "v", "a", "lambda", "energy", "output"]
    assert largest["output"] == np.abs(ours.loc[1:, names]).to_numpy().max()
    ran("check", "mine")


def test_reactions_that_are_not_unique(ran):
    """They are named in the record, and wherever their values are shown."""
    swing = newmark.problem(ran.folder / "swing.yaml")
    shared = {name.split(".")[0] for name in swing.outputs.not_unique}
    assert shared == {"A", "B", "C", "D"}
    # The forces in the plane are unique, but their names are those of whole reactions.
    assert set(swing.outputs.not_unique) == {
        name for name in swing.outputs.names if ".force." in name or ".moment." in name
    }
    record = json.loads((ran.folder / "results/mine.json").read_text())["not_unique"]
    assert record == {
        "swing.yaml": {
            "outputs": list(swing.outputs.not_unique), "released": list(swing.released),
        }
    }  # fmt: skip
    assert len(swing.released) == 3
    dropped = f"not unique: redundant, dropped: {', '.join(swing.released)}"
    for quantity, said in (("force", True), ("lambda", True), ("omega", False), ("u", False)):
        shown = ran("show", "mine", "--quantity", quantity, "--measure", "error").stdout
        assert (dropped in " ".join(shown.split())) == said
    slopes = newmark.slopes(newmark.run(ran.folder / "mine.yaml", results=ran.folder / "results"))
    said = slopes[slopes["reason"].str.contains(dropped, regex=False)]
    assert set(said["quantity"]) >= {"force", "lambda"}
    assert not {"omega", "u"} & set(said["quantity"])
    sheet = mechanism_sheet("Swing", swing, swing.u0)
    assert sheet.panels[0].x_label == dropped.removeprefix("not unique: ")
    assert newmark.march(swing, h=0.02, steps=1).not_unique == swing.outputs.not_unique
    assert newmark.problem("heavy-top").outputs.not_unique == ()


#: Two shafts on a Hooke joint, the first one driven: as many constraints as coordinates.
HOOKE = """\
dimensions: 3
bodies:
  input: {position: [0, 0, 0], mass: 2, inertia: [0.01, 0.02, 0.02]}
  output: {position: [0.4, 0, 0], axes: {x: [0.9, 0.3, 0.1], y: [-0.3, 0.9, 0]}, mass: 1.5,
           centre: [0.2, 0, 0], inertia: [0.005, 0.03, 0.03]}
joints:
  A: {type: revolute, from: ground, to: input, at: [0, 0, 0], axis: [1, 0, 0]}
  U: {type: universal, from: input, to: output, at: [0.4, 0, 0],
      axes: [[0, 0, 1], [-0.3, 0.9, 0]]}
  L: {type: point-on-line, from: ground, to: output, at: [1.3, 0.3, 0.1], axis: [0.9, 0.3, 0.1]}
motions: {drive: {joint: A, angle: {rate: 5}}}
rates: {A: 5}
"""


def test_driven_mechanism_without_freedom(cli):
    """No force moves it: the sensitivity of u to D is rounding of 0, and no miss."""
    cli.write("hooke.yaml", HOOKE)
    cli.write(
        "mine.yaml",
        "study: mine\nproblem: hooke.yaml\nform: [u-v-lambda, u-lambda]\n"
        "preconditioning: [none, left]\nmeasure: sensitivity\nh: [1e-3, 1e-4, 1e-5, 1e-6]\n"
        "steps: 0\n",
    )
    cli("run", "mine.yaml")
    slopes = pd.DataFrame(json.loads(cli("check", "mine", "--json").stdout))
    lacking = slopes.reason.fillna("").str.contains("nothing but rounding: the problem may lack it")
    # Rounding may have the order of what it stands for by chance.
    assert "D" in set(slopes[lacking].row_block) <= {"D", "K"}
    assert set(slopes[lacking].quantity) <= {"u", "v"}
    # λ answers to each row, with the order that is predicted.
    of_lambda = slopes[slopes.quantity == "lambda"]
    assert (of_lambda.verdict == "pass").all()
    np.testing.assert_allclose(of_lambda.slope, of_lambda.expected, atol=0.05)
