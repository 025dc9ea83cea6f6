"""A position that assembling moves too far is warned of; a rough guess is not."""

import contextlib
import math
import re

import pytest
from each import each
from pages import ROOT, blocks, pages

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.support import documents

HOIST = (ROOT / "docs/examples/hoist.yaml").read_text()
#: Its line with the point that a wrong length moves.
LINE = HOIST.splitlines().index("  S: {at: [1.3, 0.65], mass: 2}") + 1

STUDY = """\
study: mine
problem: hoist.yaml
form: [u-lambda, v-lambda]
preconditioning: [none, optimal]
h: [1e-2, 5e-3]
steps: 2
"""


def pendulum(at, length=1):
    """A pendulum that is to be assembled."""
    return {
        "points": {"O": {"fixed": (0, 0)}, "P": {"at": at, "mass": 1}},
        "bars": {"rod": {"from": "O", "to": "P", "length": length}},
        "assemble": True,
    }


def swing(x):
    """A body in space whose place half a metre off its origin is to be on the ground's."""
    joint = {"type": "spherical", "from": "ground", "to": "B"}
    joint["at"] = {"ground": (0, 0, 0), "B": (-0.5, 0, 0)}
    body = {"position": (x, 0, 0), "mass": 1, "inertia": (0.1, 0.1, 0.1)}
    return {
        "dimensions": 3, "bodies": {"B": body}, "joints": {"J": joint}, "assemble": True,
    }  # fmt: skip


def hoist(length):
    """The hoist with another length of its link."""
    return documents.parse(HOIST.replace("length: 1.05", f"length: {length}"), "hoist").data


@each("mechanism", [pendulum((0.4, 0.1)), pendulum((2.4, 0)), swing(0.5), swing(0.9), hoist(1.2)])
def test_a_rough_guess_is_not_doubted(mechanism):
    assert newmark.problem(mechanism).doubts == ()


@pytest.mark.filterwarnings("error::newmark_cli.NewmarkWarning")
def test_nothing_that_is_shipped_or_documented_is_doubted():
    """Shipped mechanisms, the examples, and every mechanism that a page shows as a file."""
    for name in PROBLEMS:
        newmark.problem(name)
    shown = [block.text for page in pages().values() for block in blocks(page) if block.title]
    shown += [path.read_text() for path in (ROOT / "docs/examples").glob("*.yaml")]
    found = [
        documents.parse(text, "shown").data
        for text in shown
        if re.search("^(points|bodies):", text, re.M)
    ]
    valid = 0
    for mechanism in found:
        mechanism.pop("python_forces", None)
        with contextlib.suppress(newmark.DocumentError):  # some pages show mistakes
            newmark.problem(mechanism)
            valid += 1
    assert valid > 5


#: Around its fixed points and guess the hoist is as large as this (m).
SIZE = f"{math.hypot(2.2, 1.6):.3g}"


@each("mechanism, named, away, size", [
    (hoist(1050), "points.S.at: [1.3, 0.65]", "1.05e+03", SIZE),
    (hoist(10.5), "points.S.at: [1.3, 0.65]", "9.61", SIZE),
    (pendulum((0, 40)), "points.P.at: [0, 40]", "39", "1"),
    (pendulum((0.4, 0.3), length=400), "points.P.at: [0.4, 0.3]", "400", "0.5"),
    (swing(9), "bodies.B.position: [9, 0, 0]", "8.5", "0.5"),
])  # fmt: skip
def test_what_moves_too_far_is_named(mechanism, named, away, size):
    """By a wrong length, or from a wrong place; neither makes the mechanism large."""
    with pytest.warns(newmark.NewmarkWarning) as caught:
        found = newmark.problem(mechanism)
    part = named.split(".")[1]
    assert found.doubts == (
        f"mechanism: {named} is {away} m from where assembling puts {part}, more than twice the "
        f"size of the mechanism, {size} m",
    )
    assert [str(warning.message) for warning in caught] == list(found.doubts)
    assert caught[0].filename == __file__


def test_commands_warn_once_and_go_on(cli):
    """A line on stderr for the run, not for each cell; what is printed, and 0, stay as they are."""
    cli.write("hoist.yaml", HOIST.replace("length: 1.05", "length: 10.5"))
    cli.write("mine.yaml", STUDY)
    doubt = (
        f"newmark-study: warning: hoist.yaml, line {LINE}: points.S.at: [1.3, 0.65] is 9.61 m from "
        f"where assembling puts S, more than twice the size of the mechanism, {SIZE} m\n"
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
    (tmp_path / "hoist.yaml").write_text(HOIST.replace("length: 1.05", "length: 10.5"))
    (tmp_path / "mine.yaml").write_text(STUDY.replace("h: [1e-2, 5e-3]", "h: 1e-2"))
    far, guessed = pendulum((0, 40)), "mechanism: points.P.at"
    file = f"hoist.yaml, line {LINE}: points.S.at"
    for call, doubt in (
        (lambda: newmark.march(far, h=1e-3, steps=1), guessed),
        (lambda: newmark.steps(far, h=1e-3), guessed),
        (lambda: newmark.advise(far, h=1e-3), guessed),
        (lambda: newmark.problem(tmp_path / "hoist.yaml"), file),
        (lambda: newmark.run(tmp_path / "mine.yaml"), file),
    ):
        with pytest.warns(newmark.NewmarkWarning, match=doubt) as caught:
            call()
        assert [warning.filename for warning in caught] == [__file__]
