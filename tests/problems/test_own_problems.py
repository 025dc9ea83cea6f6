"""Problems of one's own, from the command line, in an empty folder."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from each import each
from matplotlib.axes import Axes
from PIL import Image

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import PROBLEMS, problem
from newmark_cli.report.drawing import draw_mechanism
from newmark_cli.study import config

EXAMPLES = Path(__file__).parents[2] / "docs/examples"

STUDY = """\
study: mine
problem: PROBLEM
form: [u-lambda, u-v-lambda]
preconditioning: [none, left, right, optimal]
h: [1e-2, 1e-3, 1e-4]
t_end: 0.3
"""


@pytest.fixture
def hoist(cli):
    """The example mechanism and a study of it."""
    cli.write("hoist.yaml", (EXAMPLES / "hoist.yaml").read_text())
    cli.write("mine.yaml", STUDY.replace("PROBLEM", "hoist.yaml"))


def test_a_mechanism_of_ones_own(cli, hoist):
    """Spring, damper, torque, body-fixed point and slider: runs, is checked and drawn."""
    assert cli("run", "mine.yaml").stdout == "mine: 24 ok -> results/mine.csv\n"
    found = json.loads(cli("check", "--json").stdout)
    assert len(found) == 2 * 4 * (4 + 1) + 4 * (2 + 3)
    # On some processors the scatter of one series' rounding hides its order.
    others = [row for row in found if row["verdict"] != "pass"]
    assert len(others) <= 2
    assert all(row["verdict"] == "undecided" and row["reason"] for row in others)
    assert {row["problem"] for row in found} == {"hoist.yaml"}
    by_series = {(r["form"], r["preconditioning"], r["quantity"], r["measure"]): r for r in found}
    for variant, slope in (("none", -2), ("left", -2), ("right", 0), ("optimal", 0)):
        row = by_series["u-lambda", variant, "lambda", "correction"]
        assert row["slope"] == pytest.approx(slope, abs=0.15)
    assert by_series["u-lambda", "none", "jacobian", "condition"]["expected"] == -4
    cli("draw", "hoist.yaml", "--at", "0.1")
    assert (cli.folder / "results/figures/hoist-at-0.1.png").stat().st_size > 5000


CODE = '{python: "car_axis.py:car_axis", args: {compiled: COMPILED}}'


def python_study(cli, compiled):
    begins = '\nwith open("begun", "a") as file:\n    file.write(".")\n'
    cli.write("car_axis.py", (EXAMPLES / "car_axis.py").read_text() + begins)
    # Of (u, v, λ), C is asymptotic only at much smaller steps, as for Andrews' mechanism.
    text = STUDY.replace("PROBLEM", CODE.replace("COMPILED", compiled)).replace(", u-v-lambda", "")
    text = text.replace("[none, left, right, optimal]", "[none, optimal]")
    cli.write(
        "mine.yaml", text.replace("t_end: 0.3", "t_end: 0.3" if compiled == "true" else "steps: 20")
    )


def test_compiled_code_runs_through_the_kernel(cli):
    """Refused without --allow-code; with it, run and checked."""
    python_study(cli, "true")
    line = cli.refused("run", "mine.yaml")
    assert "mine.yaml, line 2: problem.python: car_axis.py is code, which runs only with" in line
    assert "--allow-code" in line
    # A second job would compile it once more; the process that has read it computes the cells.
    assert "6 ok" in cli("run", "mine.yaml", "--allow-code", "--jobs", 1).stdout
    assert (cli.folder / "begun").read_text() == "."
    # Without scaling, u is recorded by a norm that λ rules, and a few steps in 3000
    # catch it before it is rounding: its own slope is no claim here.
    found = json.loads(cli("check", "--json").stdout)
    chosen = [r for r in found if r["quantity"] != "u" and r["measure"] != "physical_correction"]
    assert len(chosen) == 4
    verdicts = [row["verdict"] for row in chosen]
    assert set(verdicts) <= {"pass", "undecided"}
    assert verdicts.count("pass") >= 3


def test_plain_code_runs(cli):
    """Functions that numba did not compile; every cell ends well."""
    python_study(cli, "false")
    assert "6 ok" in cli("run", "mine.yaml", "--allow-code", "--jobs", 1).stdout
    # The process that has read it computes the cells.
    assert (cli.folder / "begun").read_text() == "."


@each(
    "problem, words",
    [
        ('{python: "car_axis.py"}', 'must be "file.py:factory"'),
        ('{python: "car_axis.py:axis"}', "has no function 'axis'"),
        ('{python: "raises.py:axis"}', "raises.py, line 2: axis failed: ValueError: not today"),
        ("{chian: {links: 3}}", "did you mean 'chain'"),
    ],
)
def test_problems_that_cannot_be_used(cli, problem, words):
    cli.write("car_axis.py", (EXAMPLES / "car_axis.py").read_text())
    cli.write("raises.py", "def axis():\n    raise ValueError('not today')\n")
    cli.write("mine.yaml", STUDY.replace("PROBLEM", problem))
    line = cli.refused("run", "mine.yaml", "--allow-code")
    assert "mine.yaml, line 2: problem" in line
    assert words in line
    assert not (cli.folder / "results").exists()


@each("name", [*PROBLEMS, "chain(links=40)", "four-bars(windows=3)", "spatial-chain(bodies=30)"])
def test_every_mechanism_can_be_drawn(name):
    """Each body, bar and joint has its line, and a small mechanism its names and a key."""
    subject = config.problem_named(name).load()
    drawn = draw_mechanism.mechanism_figure(name, subject, subject.u0)
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


def test_a_later_picture_leaves_that_of_the_start(cli):
    """A picture at another time has its own files."""
    first = cli("draw", "pendulum").stdout.split()
    assert first == ["results/figures/pendulum.png"]
    before = (cli.folder / first[0]).read_bytes()
    later = cli("draw", "pendulum", "--at", "0.5", "--format", "svg,png", "--size", "3").stdout
    assert later.split() == [f"results/figures/pendulum-at-0.5.{kind}" for kind in ("svg", "png")]
    assert (cli.folder / first[0]).read_bytes() == before


def test_animation(cli, monkeypatch):
    """A GIF with as many different frames as asked for, each with its time."""
    cli("draw", "slider-crank", "--at", "0.3", "--animate", "motion.gif", "--frames", "5")
    with Image.open(cli.folder / "motion.gif") as image:
        assert image.n_frames == 5
    titles = []
    monkeypatch.setattr(Axes, "set_title", lambda axes, title: titles.append(title))
    names = [f"t = {time} s" for time in range(3)]
    subject = problem("slider-crank")
    draw_mechanism.animation(names, subject, [subject.u0] * 3, cli.folder / "titles.gif")
    assert titles == names


def test_validate_says_what_was_assembled(cli):
    """The farthest point or body, in the plane and in space; nothing where nothing is guessed."""
    hanging = "points: {A: {fixed: [0, 0]}, B: {at: [3, 4], mass: 1}}\n"
    bar = "bars: {rod: {from: A, to: B, length: LENGTH}}\n"
    for length, said in ((5, "nothing moved"),
                         (8, "B, the farthest, is 3 m from its guess")):  # fmt: skip
        text = hanging + bar.replace("LENGTH", str(length)) + "assemble: true\n"
        cli.write("rod.yaml", text)
        assert cli("validate", "rod.yaml").stdout.splitlines()[1:] == [f"  assembled: {said}"]
    cli.write("rod.yaml", text.replace("8", "5").replace("assemble: true\n", ""))
    assert len(cli("validate", "rod.yaml").stdout.splitlines()) == 1
    cli.write(
        "swing.yaml",
        "dimensions: 3\nbodies: {box: {position: [0, 0, 7], mass: 1, box: [1, 1, 1]}}\n"
        "joints: {ball: {type: spherical, from: ground, to: box,\n"
        "                at: {ground: [0, 0, 0], box: [0, 0, 5]}}}\nassemble: true\n",
    )
    *_, last = cli("validate", "swing.yaml").stdout.splitlines()
    origin = float(re.fullmatch(r"  assembled: box, the farthest, is ([\d.]+) m .*", last)[1])
    # The ball is 5 m from the origin, whichever way the box has turned.
    with pytest.warns(newmark.NewmarkWarning, match="12 m from where assembling puts box"):
        subject = newmark.problem(str(cli.folder / "swing.yaml"))
    assert np.linalg.norm(subject.u0[:3]) == pytest.approx(5)
    assert origin == pytest.approx(np.linalg.norm(subject.u0[:3] - [0, 0, 7]), rel=1e-2)
    cli.write(
        "turn.yaml",
        "dimensions: 3\nbodies: {box: {position: [0, 0, 0], mass: 1, box: [1, 1, 1]}}\n"
        "joints: {hinge: {type: revolute, from: ground, to: box, at: [0, 0, 0],\n"
        "                 axis: {ground: [0, 0, 1], box: [0.3, 0, 1]}}}\nassemble: true\n",
    )
    *_, last = cli("validate", "turn.yaml").stdout.splitlines()
    assert last == f"  assembled: box has turned most, by {np.degrees(np.arctan(0.3)):.3g}°"


def test_draw_refuses(cli):
    """Unknown problems, times and steps without sense."""
    assert "unknown problem 'andrew'; did you mean 'andrews'" in cli.refused("draw", "andrew")
    assert "command line: problem: a.yaml: cannot be read" in cli.refused("draw", "a.yaml")
    for time in ("-1", "nan", "inf"):
        assert "Invalid value for '--at'" in cli.refused("draw", "andrews", "--at", time)
    for twice in ("chain(links=2,links=3)", "chain(links=2 links=2)"):
        assert f"{twice}: links is given twice" in cli.refused("draw", twice)
    with pytest.raises(newmark.NewmarkError, match="links is given twice"):
        newmark.problem("chain(links=2,links=3)")
    line = cli.refused("draw", "pendulum", "--at", "1", "--integrator", "hht alpha=0 alpha=-0.1")
    assert "alpha is given twice" in line
    assert "--h: must be" in cli.refused("draw", "andrews", "--at", "1", "--h", "2")
    assert "--animate: needs --at" in cli.refused("draw", "andrews", "--animate", "x.gif")
