"""Problems of one's own, from the command line, in an empty folder."""

from pathlib import Path

import numpy as np
import pytest
from conftest import SWING
from matplotlib.axes import Axes
from PIL import Image

from newmark_cli.mechanisms.registry import problem
from newmark_cli.report.drawing import draw, draw_mechanism
from newmark_cli.study import naming

#: Files that tests of commands take, too.
EXAMPLES = Path(__file__).parents[2] / "docs/examples"

STUDY = """\
study: mine
problem: {python: "mine.py:swing"}
form: u-lambda
preconditioning: [none, optimal]
h: [1e-1, 5e-2, 2e-2]
t_end: 0.1
"""


def test_code_of_ones_own_runs_from_its_file(cli):
    """Refused without --allow-code; with it, read once and run."""
    begins = '\nwith open("begun", "a") as file:\n    file.write(".")\n'
    cli.write("mine.py", SWING + begins)
    cli.write("mine.yaml", STUDY)
    line = cli.refused("run", "mine.yaml")
    assert "mine.yaml, line 2: problem.python: mine.py is code, which runs only with" in line
    assert "--allow-code" in line
    # A second job would read it once more; the process that has read it computes the cells.
    assert "6 ok" in cli("run", "mine.yaml", "--allow-code", "--jobs", 1).stdout
    assert (cli.folder / "begun").read_text() == "."


@pytest.mark.parametrize("name", [
    "andrews", "slider-crank", "shaken-pendulum", "governor", "spatial-slider-crank",
    "chain(links=40)", "four-bars(windows=3)", "spatial-chain(bodies=30)",
])  # fmt: skip
def test_every_mechanism_can_be_drawn(name):
    """Each body, bar and joint has its line, and a small mechanism its names and a key."""
    subject = naming.problem_named(name).load()
    drawn = draw.drawn(draw_mechanism.mechanism_sheet(name, subject, subject.u0))
    (axes,) = drawn.axes
    spatial, mechanism = len(subject.axes) == 3, subject.drawing
    in_millimetres = "(mm)" in axes.get_xlabel() or any(
        text.get_text().endswith(" mm") for text in axes.texts
    )
    factor = 1e3 if in_millimetres else 1.0
    lines = {
        frozenset(zip(line.get_xdata().round(9), line.get_ydata().round(9), strict=True))
        for line in axes.get_lines()
    }
    if spatial:
        # From where one looks: 58 degrees about the upright, 20 above the level.
        up = int(np.argmax(np.abs(mechanism.gravity)))
        a, b = np.radians([-58, 20])
        right = np.roll([0, -np.sin(a), np.cos(a)], up)
        above = np.roll([np.cos(b), -np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a)], up)
        paper = factor * np.stack([right, above], axis=1)
        bodies = subject.u0.reshape(-1, 4, 3)
        expected = [
            (bodies[side.body, 0] + np.array(body.centre) @ bodies[side.body, 1:],
             side.place(bodies))
            for joint in subject.outputs.joints.values() for side in joint.sides if side.body >= 0
            for body in [[*mechanism.bodies.values()][side.body]]
        ]  # fmt: skip
    else:
        paper = factor * np.eye(2)
        places = dict(zip(subject.points, subject.u0.reshape(-1, 2), strict=True))
        places |= {key: point.fixed for key, point in mechanism.points.items() if point.fixed}
        parts = (*mechanism.bodies.values(), *mechanism.bars.values())
        expected = [(places[part.from_], places[part.to]) for part in parts]
    assert expected
    for ends in np.array(expected) @ paper:
        assert frozenset(map(tuple, ends.round(9))) in lines
    labels = {text.get_text() for text in axes.texts}
    names = {*mechanism.bodies, *getattr(mechanism, "joints", mechanism.points)}
    assert (labels >= names) == ("=" not in name or "windows" in name)
    key = {text.get_text() for legend in drawn.legends for text in legend.get_texts()}
    assert (not key) == ("links" in name or "bodies" in name)
    for symbol in ("spring", "damper"):
        kinds = (f"{symbol}s", f"torsion_{symbol}s")
        assert (symbol in key) == any(getattr(mechanism, kind) for kind in kinds)


def test_pictures_and_animations(cli, monkeypatch):
    """A picture at another time has its own files; a GIF has as many frames as asked for."""
    first = cli("draw", "pendulum").stdout.split()
    assert first == ["results/figures/pendulum.png"]
    before = (cli.folder / first[0]).read_bytes()
    later = cli("draw", "pendulum", "--at", "0.5", "--format", "svg,png", "--size", "3").stdout
    assert later.split() == [f"results/figures/pendulum-at-0.5.{kind}" for kind in ("svg", "png")]
    assert (cli.folder / first[0]).read_bytes() == before
    titles = []
    monkeypatch.setattr(Axes, "set_title", lambda axes, title: titles.append(title))
    names, subject = [f"t = {time} s" for time in range(3)], problem("slider-crank")
    moved = [subject.u0 * (1 - 0.1 * frame) for frame in range(3)]
    draw_mechanism.animation(names, subject, moved, cli.folder / "motion.gif")
    assert titles == names
    with Image.open(cli.folder / "motion.gif") as image:
        assert image.n_frames == 3


BALL = """\
dimensions: 3
bodies: {box: {position: [0, 0, 7], mass: 1, box: [1, 1, 1]}}
joints: {ball: {type: spherical, from: ground, to: box, at: {ground: [0, 0, 0], box: [0, 0, 5]}}}
"""
TURN = (
    BALL.replace("7]", "0]")
    .replace("spherical", "revolute")
    .replace(
        "at: {ground: [0, 0, 0], box: [0, 0, 5]}",
        "at: [0, 0, 0], axis: {ground: [0, 0, 1], box: [0.3, 0, 1]}",
    )
)
BAR = """\
points: {A: {fixed: [0, 0]}, B: {at: [3, 4], mass: 1}}
bars: {rod: {from: A, to: B, length: LENGTH}}
"""


@pytest.mark.parametrize(("text", "said"), [
    (BAR.replace("LENGTH", "5"), "nothing moved"),
    (BAR.replace("LENGTH", "8"), "B, the farthest, is 3 m from its guess"),
    (TURN, f"box has turned most, by {np.degrees(np.arctan(0.3)):.3g}°"),
    # The ball is 5 m from the origin, whichever way the box has turned.
    (BALL, "box, the farthest, is 12 m from its guess"),
])  # fmt: skip
def test_validate_says_what_was_assembled(cli, text, said):
    """The farthest point or body; nothing where nothing is guessed."""
    cli.write("mine.yaml", text + "assemble: true\n")
    last = cli("validate", "mine.yaml").stdout.splitlines()[-1]
    assert last.startswith(f"  assembled: {said}")
    if text.startswith("points") and "5}" in text:
        cli.write("mine.yaml", text)
        assert len(cli("validate", "mine.yaml").stdout.splitlines()) == 1
