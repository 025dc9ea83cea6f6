"""What `list` says of problems, integrators, scalings and measures, against the code."""

import pytest
from each import each

from newmark_cli.documents import Document
from newmark_cli.mechanisms import planar, registry
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import INTEGRATORS, parameters
from newmark_cli.newmark.scaling import VARIANTS, named_scaling
from newmark_cli.study import catalogue
from newmark_cli.study.measures import MEASURES


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


def test_integrators_name_their_parameters(sections):
    """With their ranges; those without say so."""
    for method in INTEGRATORS:
        text = sections["integrators"][method]
        assert all(name in text for name in parameters(method))
        assert bool(parameters(method)) != ("no parameters" in text)


def test_scalings_differ_in_what_they_say(sections):
    """Where `optimal-printed` differs from `optimal`: in the forms that are named."""
    texts = sections["preconditioning"]
    assert len(set(texts.values())) == len(texts) == len(VARIANTS)
    for name, form in FORMS.items():
        printed, optimal = (named_scaling(v, form) for v in ("optimal-printed", "optimal"))
        differing = printed.left != optimal.left or printed.right != optimal.right
        assert differing == (f" {name}" in texts["optimal-printed"]), name
        if differing:
            assert str(printed.left["V"]) == "1"
            assert str(optimal.left["V"]) == "beta*h/gamma"


def test_every_measure_has_a_text(sections):
    """The measures that a config accepts, in their order, as the code describes them."""
    assert tuple(sections["measures"]) == tuple(MEASURES)
    assert sections["measures"]["condition"] == MEASURES["condition"].about
    assert "`" not in "".join(sections["measures"].values())
