"""Sizes that can hardly be meant are warned of; those of plausible mechanisms are not."""

import contextlib
import copy
import math
import re

import pytest
from each import each
from pages import ROOT, blocks, pages

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.support import documents

HOIST = (ROOT / "docs/examples/hoist.yaml").read_text()
#: Its line with the link.
LINK = HOIST.splitlines().index("  link: {from: P, to: S, length: 1.05}") + 1

STUDY = """\
study: mine
problem: hoist.yaml
form: [u-lambda, v-lambda]
preconditioning: [none, optimal]
h: [1e-2, 5e-3]
steps: 2
"""


def chain(bodies, points=(), further=None):
    """A planar chain along a line: lengths, masses and inertias of bodies; masses at joints."""
    x, found = 0.0, {"points": {"P0": {"fixed": (0, 0)}}, "bodies": {}, **(further or {})}
    for i, (length, mass, inertia) in enumerate(bodies):
        x += length
        found["points"][f"P{i + 1}"] = {"at": (x, 0)}
        found["bodies"][f"B{i + 1}"] = {
            "from": f"P{i}", "to": f"P{i + 1}", "length": length, "mass": mass,
            "centre": (length / 2, 0), "inertia": inertia,
        }  # fmt: skip
    for i, mass in enumerate(points):
        found["points"][f"P{i + 1}"]["mass"] = mass
    return found


def rods(*bodies, points=(), further=None):
    """The same of slender rods: lengths and masses."""
    return chain([(x, m, m * x**2 / 12) for x, m in bodies], points, further)


def in_space(bodies):
    """A chain in space: extents, masses and moments of inertia of bodies with ball joints."""
    x, found, before = 0.0, {"dimensions": 3, "bodies": {}, "joints": {}}, "ground"
    for i, (length, mass, moments) in enumerate(bodies):
        name = f"B{i + 1}"
        found["bodies"][name] = {
            "position": (x + length / 2, 0, 0), "mass": mass, "inertia": moments,
        }  # fmt: skip
        joint = {"type": "spherical", "from": before, "to": name, "at": (x, 0, 0)}
        found["joints"][f"J{i + 1}"] = joint
        x, before = x + length, name
    return found


#: Mechanisms that somebody might well build, in which sizes differ for a reason.
PLAUSIBLE = {
    "a heavy flywheel with light rods": chain([(0.05, 120, 15), (0.4, 1.5, 0.02), (0.3, 1, 8e-3)]),
    "a crane with a hook": rods((45, 20_000), (12, 1500), (20, 400), (0.4, 90)),
    "a body with a very small inertia": chain([(1, 1, 4e-4), (1, 1, 0.08), (0.8, 1, 0.05)]),
    "a robot, graded": rods((0.5, 150), (0.9, 60), (0.7, 15), (0.1, 2), (0.05, 0.1)),
    "a press": rods((0.1, 2), (0.4, 1), points=[0, 500]),
    "a see-saw with children": rods((3, 40), points=[30]),
    "a rough guess of a pendulum": {
        "points": {"O": {"fixed": (0, 0)}, "P": {"at": (0.4, 0.1), "mass": 1}},
        "bars": {"rod": {"from": "O", "to": "P", "length": 1}},
        "assemble": True,
    },
    "a weak spring of no length": rods(
        (1, 1), (1, 1),
        further={"springs": {"s": {"from": "P0", "to": "P2", "stiffness": 1, "rest_length": 1e-3}}},
    ),
    "an unbalanced rotor": {
        **rods((0.4, 3), (0.5, 2)),
        "body_points": {"E": {"on": "B1", "at": (1e-5, 0)}},
    },
    "a wheel on a wide arc": {
        "points": {"C": {"fixed": (0, 0)}, "W": {"at": (10.1, 0)}, "R": {"at": (10.2, 0)}},
        "bodies": {"wheel": {"from": "W", "to": "R", "length": 0.1, "mass": 1, "inertia": 5e-3}},
        "rolling": {
            "track": {"wheel": "wheel", "radius": 0.1, "circle": {"centre": "C", "radius": 10}}
        },
    },
    "a satellite with a boom": in_space(
        [(2, 1200, (900, 800, 700)), (8, 12, (0.01, 64, 64)), (0.3, 5, (0.05, 0.05, 0.06))]
    ),
    "a gyroscope": in_space([(0.2, 0.4, (2e-3, 2e-3, 1e-3)), (0.04, 0.6, (3e-4, 1.6e-4, 1.6e-4))]),
    "a wind turbine": in_space(
        [(90, 350_000, (1e6, 2.4e8, 2.4e8)), (63, 18_000, (1e4, 6e6, 6e6)), (3, 9e3, (9e3,) * 3)]
    ),
    "thin rods in space": in_space([(1, 1, (1e-7, 0.08, 0.08)), (0.6, 1, (0.02, 0.03, 0.03))]),
}  # fmt: skip


@each("name", PLAUSIBLE)
def test_plausible_mechanisms_are_not_doubted(name):
    """Sizes may be graded, small altogether, or differ by anything up to a factor of 300."""
    assert newmark.problem(PLAUSIBLE[name]).doubts == ()


@pytest.mark.filterwarnings("ignore::newmark_cli.NewmarkWarning")
def test_nothing_that_is_shipped_or_documented_is_doubted():
    """Shipped mechanisms, the examples, and every mechanism that a page shows as a file.

    All but a rod of 1e-9 kg m², which is shown because such a part is marched wrongly.
    """
    for name in PROBLEMS:
        assert newmark.problem(name).doubts == ()
    shown = [block.text for page in pages().values() for block in blocks(page) if block.title]
    shown += [path.read_text() for path in (ROOT / "docs/examples").glob("*.yaml")]
    found = [
        documents.parse(text, "shown").data
        for text in shown
        if re.search("^(points|bodies):", text, re.M)
    ]
    valid, doubted = 0, []
    for mechanism in found:
        mechanism.pop("python_forces", None)
        with contextlib.suppress(newmark.DocumentError):  # some pages show mistakes
            doubted += newmark.problem(mechanism).doubts
            valid += 1
    assert valid > 5
    assert ["other inertias, 1e-09 kg" in doubt for doubt in doubted] == [True]


def changed(name, *path, value):
    """A plausible mechanism with another value."""
    mechanism = copy.deepcopy(PLAUSIBLE[name])
    inner = mechanism
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return mechanism


TOO_SMALL = "is less than 1/300 of the other"
TOO_LARGE = "is more than 300 times the other"


@each("mechanism, doubt", [
    (changed("a press", "points", "P2", "mass", value=1e-6),
     f"points.P2.mass: 1e-06 kg {TOO_SMALL} masses, 1 to 2 kg"),
    (changed("a see-saw with children", "points", "P1", "mass", value=12_001),
     f"points.P1.mass: 12001 kg {TOO_LARGE} masses, 40 kg"),
    (changed("a body with a very small inertia", "bodies", "B1", "inertia", value=1e-6),
     f"bodies.B1.inertia: 1e-06 kg m² {TOO_SMALL} inertias, 0.05 to 0.08 kg m²"),
    (rods((1, 1e-6), (1, 1), (1, 2), (1, 2e-7), (1, 1)),
     f"bodies.B1.mass: 1e-06 kg {TOO_SMALL} masses, 1 to 2 kg (and 1 more like it)"),
    (changed("an unbalanced rotor", "body_points", "E", "at", value=(400, 0)),
     f"body_points.E.at: 400 m from the first point of B1 {TOO_LARGE} lengths, 0.4 to 0.5 m"),
    (changed("thin rods in space", "bodies", "B2", "inertia", value=(20, 30, 30)),
     f"bodies.B2.inertia: 30 kg m² {TOO_LARGE} inertias, 0.08 kg m²"),
    (changed("a gyroscope", "bodies", "B2", "centre", value=(0, 0, 40)),
     f"bodies.B2.centre: 40 m from the origin of B2 {TOO_LARGE} lengths, 0.1 m"),
])  # fmt: skip
def test_what_stands_out_is_named(mechanism, doubt):
    with pytest.warns(newmark.NewmarkWarning, match=re.escape(f"mechanism: {doubt}")) as caught:
        found = newmark.problem(mechanism)
    assert [warning.filename for warning in caught] == [__file__] * len(found.doubts)
    assert [str(warning.message) for warning in caught] == list(found.doubts)
    assert found.doubts == (f"mechanism: {doubt}",)


GUESS = "is {} m from where assembling puts {}, more than the size of the mechanism, {} m"


def test_a_length_that_moves_points_too_far():
    """The hoist with its link a thousand times too long, and ten times; a guess that is too far."""
    link = f"bars.link.length: 1050 m {TOO_LARGE} lengths, 0.5 to 0.9 m"
    # Around its fixed points and guess the hoist is 2.7 m large, and two lengths more.
    size = 0.5 + 0.9 + 2 * math.hypot(2.2, 1.6)
    for length, doubts in (
        (1050, ["points.S.at: [1.3, 0.65] " + GUESS.format("1.05e+03", "S", f"{size:.3g}"), link]),
        (10.5, ["points.S.at: [1.3, 0.65] " + GUESS.format("9.61", "S", f"{size:.3g}")]),
    ):
        mechanism = documents.parse(
            HOIST.replace("length: 1.05", f"length: {length}"), "hoist"
        ).data
        with pytest.warns(newmark.NewmarkWarning) as caught:
            newmark.problem(mechanism)
        found = [str(warning.message) for warning in caught]
        assert found == [f"mechanism: {doubt}" for doubt in doubts]
    lost = changed("a rough guess of a pendulum", "points", "P", "at", value=(0, 40))
    with pytest.warns(newmark.NewmarkWarning, match=re.escape(GUESS.format(39, "P", 1))):
        newmark.problem(lost)
    swing = in_space([(1, 1, (0.1, 0.1, 0.1))]) | {"assemble": True}
    swing["joints"]["J1"]["at"] = {"ground": (0, 0, 0), "B1": (-0.5, 0, 0)}
    assert newmark.problem(swing).doubts == ()
    swing["bodies"]["B1"]["position"] = (9, 0, 0)
    with pytest.warns(newmark.NewmarkWarning, match=r"bodies\.B1\.position: \[9, 0, 0\] is 8\.5 m"):
        newmark.problem(swing)


def test_commands_warn_once_and_go_on(cli):
    """A line on stderr for the run, not for each cell; what is printed, and 0, stay as they are."""
    cli.write("hoist.yaml", HOIST.replace("mass: 2}", "mass: 2000}"))
    cli.write("mine.yaml", STUDY)
    line = HOIST.splitlines().index("  S: {at: [1.3, 0.65], mass: 2}") + 1
    doubt = (
        f"newmark-study: warning: hoist.yaml, line {line}: points.S.mass: 2000 kg is more than 300 "
        "times the other masses, 1.2 kg\n"
    )
    for arguments in (
        ("validate", "hoist.yaml", "mine.yaml"),
        ("run", "mine.yaml", "--jobs", "2"),
        ("run", "mine.yaml", "--quiet"),
        ("run", "mine.yaml", "--dry-run"),
    ):
        assert cli(*arguments).stderr == doubt
    cli.write("hoist.yaml", HOIST)
    assert cli("run", "mine.yaml").stderr == ""
    assert cli("validate", "hoist.yaml").stderr == ""


def test_the_library_warns_where_it_is_called(tmp_path):
    """`problem`, `march` and `run`, of files and dicts, each once and at the line of the caller."""
    (tmp_path / "hoist.yaml").write_text(HOIST.replace("length: 1.05", "length: 0.001"))
    (tmp_path / "mine.yaml").write_text(STUDY.replace("h: [1e-2, 5e-3]", "h: 1e-2"))
    mechanism = changed("a see-saw with children", "points", "P1", "mass", value=1e5)
    heavy = "points.P1.mass: 100000 kg"
    for call, doubt in (
        (lambda: newmark.march(mechanism, h=1e-3, steps=1), heavy),
        (lambda: newmark.steps(mechanism, h=1e-3), heavy),
        (lambda: newmark.advise(mechanism, h=1e-3), heavy),
    ):
        with pytest.warns(newmark.NewmarkWarning, match=doubt) as caught:
            call()
        assert [warning.filename for warning in caught] == [__file__]
    short = f"hoist.yaml, line {LINK}: bars.link.length: 0.001 m {TOO_SMALL} lengths, 0.5 to 0.9 m"
    for call in (
        lambda: newmark.problem(tmp_path / "hoist.yaml"),
        lambda: newmark.run(tmp_path / "mine.yaml"),
    ):
        with pytest.warns(newmark.NewmarkWarning, match=re.escape(short)) as caught:
            call()
        assert [warning.filename for warning in caught] == [__file__]
