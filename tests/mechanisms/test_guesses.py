"""A position that assembling moves too far is warned of; a rough guess is not."""

import math

import pytest
from pages import ROOT

import newmark_cli as newmark
from newmark_cli.support import documents

HOIST = (ROOT / "docs/examples/hoist.yaml").read_text()
#: Its line with the point that a wrong length moves.
LINE = HOIST.splitlines().index("  S: {at: [1.3, 0.65], mass: 2}") + 1

STUDY = """\
study: mine
problem: hoist.yaml
form: u-lambda
preconditioning: [none, optimal]
h: 1e-2
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


@pytest.mark.parametrize(
    "mechanism", [pendulum((0.4, 0.1)), pendulum((2.4, 0)), swing(0.5), swing(0.9), hoist(1.2)]
)
def test_a_rough_guess_is_not_doubted(mechanism):
    assert newmark.problem(mechanism).doubts == ()


#: Around its fixed points and guess the hoist is as large as this (m).
SIZE = f"{math.hypot(2.2, 1.6):.3g}"


@pytest.mark.parametrize(("mechanism", "named", "away", "size"), [
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


def test_commands_and_the_library_warn_once_and_go_on(cli):
    """A line on stderr for a run, not for each cell; in Python a warning at the caller's line."""
    cli.write("hoist.yaml", HOIST.replace("length: 1.05", "length: 10.5"))
    cli.write("mine.yaml", STUDY)
    file = f"hoist.yaml, line {LINE}: points.S.at"
    doubt = (
        f"newmark-study: warning: {file}: [1.3, 0.65] is 9.61 m from where assembling puts S, more "
        f"than twice the size of the mechanism, {SIZE} m\n"
    )
    for arguments in (("validate", "hoist.yaml", "mine.yaml"), ("run", "mine.yaml", "--jobs", "2")):
        assert cli(*arguments).stderr == doubt
    for call in (
        lambda: newmark.march(cli.folder / "hoist.yaml", h=1e-3, steps=1),
        lambda: newmark.run(cli.folder / "mine.yaml"),
    ):
        with pytest.warns(newmark.NewmarkWarning, match=file) as caught:
            call()
        assert [warning.filename for warning in caught] == [__file__]
    cli.write("hoist.yaml", HOIST)
    assert cli("validate", "hoist.yaml", "mine.yaml").stderr == ""
