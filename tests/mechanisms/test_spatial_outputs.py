"""Reactions by name along a march, and those that are no property of the mechanism."""

import json

import numpy as np
import pandas as pd

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
