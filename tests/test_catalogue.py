"""What `list` says of problems, integrators, scalings and measures, against the code."""

import pytest
from each import each

from newmark_cli.mechanisms import planar, registry
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.study import catalogue
from newmark_cli.support.documents import Document


@pytest.fixture(scope="module")
def sections():
    return catalogue.sections()


def test_sizes_of_shipped_problems_are_those_of_the_built(sections):
    """n and m, and the title and the description of the file."""
    for name in registry.PROBLEMS:
        built = registry.problem(name)
        mechanism = built.drawing
        text = f"{mechanism.title}: {mechanism.description}; n = {built.n}, m = {built.m}"
        assert sections["problems"][name] == text
        assert mechanism.description


@each("name", registry.PROBLEMS)
def test_pictures_show_the_start_of_the_built(name):
    """What is drawn without building anything is where the problem starts, to the last bit."""
    picture, built = registry.picture(name), registry.problem(name)
    assert (picture.drawing, picture.points) == (built.drawing, built.points)
    assert picture.u0.dtype == built.u0.dtype
    assert picture.u0.tobytes() == built.u0.tobytes()


@each("name", FAMILIES)
def test_sizes_of_families_are_those_of_their_members(sections, name):
    """The formulas, evaluated for a member of size 3."""
    family = FAMILIES[name]
    built = family.problem(name, dict.fromkeys(family.parameters, 3))
    *_, n, m = sections["families of problems"][name].replace("; n", ", n").split(", ")
    for formula, count in ((n, built.n), (m, built.m)):
        right = formula.partition("= ")[2]
        for parameter in family.parameters:
            assert parameter in right
            right = right.replace(f" {parameter}", "*3").replace(parameter, "3")
        assert eval(right) == count, formula


def test_sizes_with_every_kind_of_constraint():
    """Bodies, bars, sliders, and a prescribed motion, which counts by its laws."""
    data = {
        "points": {
            "O": {"fixed": [0, 0]},
            "A": {"at": [1, 0], "mass": 1},
            "B": {"at": [2, 0], "mass": 1},
            "C": {"at": [3, 0], "mass": 1},
            "D": {"at": [4, 0], "mass": 1},
        },
        "bodies": {"rod": {"from": "O", "to": "A", "length": 1, "mass": 1, "inertia": 0.1}},
        "bars": {"bar": {"from": "A", "to": "B", "length": 1}},
        "sliders": {"rail": {"point": "C", "through": [0, 0], "direction": [1, 0]}},
        "motions": {
            "turn": {"body": "rod", "angle": {"rate": 0}},
            "hold": {"point": "D", "x": {"rate": 0}, "y": {"rate": 0}},
        },
    }
    built = planar.built("all", Document("all", data, {}))
    assert registry.size(data) == (built.n, built.m) == (8, 6)
