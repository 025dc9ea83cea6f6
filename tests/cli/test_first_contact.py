"""What a new user types: labels that were printed, names without endings, and mistakes."""

import json

import numpy as np
import pandas as pd
import pytest
from pydantic import TypeAdapter, ValidationError

import newmark_cli as newmark
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import SHIPPED
from newmark_cli.mechanisms.spatial_model import SpatialMechanism, inertias
from newmark_cli.mechanisms.spatial_summary import inertia_of
from newmark_cli.newmark import integrator, integrator_labels
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.formulation import METHODS, PROJECTIONS, REPORTED, STARTS
from newmark_cli.newmark.linear.choice import LINEAR_SOLVERS
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.newmark.scheme import EVALUATIONS, PRECISIONS
from newmark_cli.report.drawing import automatic
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import collect
from newmark_cli.study import axes, keys
from newmark_cli.study.entries import FigureConfig

SWING = {
    "points": {"O": {"fixed": [0, 0]}, "P": {"at": [1, 0], "mass": 2}},
    "bars": {"rod": {"from": "O", "to": "P", "length": 1}},
    "gravity": [0, -9.81],
}
STUDY = {
    "study": "s", "problem": "pendulum", "form": "u-lambda", "preconditioning": "optimal",
    "h": [1e-2], "t_end": 0.1, "measure": "condition",
}  # fmt: skip
OWN = {"name": "mine", "left": {"D": "h^2"}, "right": {"lambda": "1/h^2"}}
#: Axis → values of all its registries, as a config gives them.
VALUES = {
    "problem": [
        *SHIPPED,
        *({name: dict.fromkeys(of.parameters, 3)} for name, of in FAMILIES.items()),
    ],
    "integrator": [
        {"method": name} | {p: 0.25 if p == "beta" else 0.5 if p == "gamma" else 0.2
                            for p in integrator.parameters(name)}
        for name in integrator.INTEGRATORS
    ],
    "form": [*FORMS],
    "preconditioning": [*VARIANTS, OWN],
    "evaluation": [*EVALUATIONS],
    "precision": [*PRECISIONS],
    "linear_solver": [*LINEAR_SOLVERS],
    "formulation": [
        *METHODS, *({"method": name, p: 0.5} for name, of in METHODS.items() for p in of.parameters)
    ],
    "projection": [*PROJECTIONS, {"method": "velocity", "accelerations": True}],
    "multipliers": [*REPORTED],
    "start": [*STARTS],
    "stop": ["saturation", {"absolute": 1e-8}, {"absolute": 1e-8, "relative": 1e-9}],
    "h_sequence": [
        "constant", {"change": 0.5, "at": 0.5}, {"alternate": [1, 0.5], "every": 5},
        {"random": [0.5, 2]},
    ],
    "auxiliary": [*integrator.AUXILIARY],
    "code": ["newmark-study", "a code of mine"],
    "h": [1e-3],
}  # fmt: skip


def parsed(axis, given):
    """The value of an axis of cells that a config gives; rules between keys do not matter."""
    found = TypeAdapter(keys.annotation(axis)).validate_python(given)
    return axis.value(found[0] if axis.many and found is not None else found)


@pytest.mark.parametrize("axis", [axis for axis in axes.cell_axes() if axis.cell])
def test_what_is_printed_can_be_typed(axis):
    """A label of a CSV, and what tables and legends make of it, mean the value again."""
    assert VALUES.keys() == {axis.name for axis in axes.cell_axes() if axis.cell}
    for given in VALUES[axis.name]:
        value = parsed(axis, given)
        label = str(axis.usual if value is None else getattr(value, "label", value))
        # The factors of a scaling of one's own are not in its text.
        printed = {label, label if axis.name == "preconditioning" else axis.text(label)}
        for text in printed:
            typed = float(text) if axis.name == "h" else text
            assert parsed(axis, typed) == value, text
            if axis.name == "integrator":
                assert integrator_labels.parse(text) == value


@pytest.mark.parametrize(
    "key", ["form", "integrator", "preconditioning", "formulation", "projection", "start"]
)
def test_a_value_under_another_key(key):
    """The message names the key that has it."""
    (axis,) = (axis for axis in axes.cell_axes() if axis.name == key)
    for other in ("form", "preconditioning", "formulation", "precision", "multipliers"):
        for name in VALUES[other] if other != key else ():
            if isinstance(name, str) and name not in ("none", *VALUES[key]):
                with pytest.raises(ValidationError, match=rf"{name}', which is .* key {other};"):
                    parsed(axis, [name])


def test_scaling_is_preconditioning(cli):
    """One word in results; either where something is typed, and not both."""
    given = {key: value for key, value in STUDY.items() if key != "preconditioning"}
    figure = {"measure": "condition", "series": "scaling", "scaling": "left"}
    frame = newmark.run(given | {"scaling": ["none", "left"], "figures": [figure]})
    assert frame["preconditioning"].unique().tolist() == ["none", "left"]
    with pytest.raises(newmark.NewmarkError, match="scaling: is the same as preconditioning"):
        newmark.run(STUDY | {"scaling": "left"})
    names = ("scaling", "preconditioning")
    one, other = (newmark.march("pendulum", h=1e-2, steps=3, **{n: "none"}).u for n in names)
    np.testing.assert_array_equal(one, other)
    one, other = (newmark.scaling("v-lambda", h=1e-2, **{n: "left"}) for n in names)
    assert one == other
    with pytest.raises(newmark.NewmarkError, match="are one argument"):
        newmark.march("pendulum", h=1e-2, steps=3, scaling="none", preconditioning="none")
    one, other = (cli("orders", f"--{n}", "left").stdout for n in names)
    assert one == other
    cli.write("s.yaml", json.dumps(given | {"cases": [{"scaling": "lft"}]}))
    line = cli.refused("validate", "s")
    assert "unknown preconditioning 'lft'; did you mean 'left'?" in line


def test_yaml_1_1_reads_on_as_true():
    """PyYAML makes True of the key `on`; so may Python."""
    wheel = {"from": "P", "to": "Q", "length": 1, "mass": 1, "inertia": 1}
    points = SWING["points"] | {"Q": {"at": [2, 0]}}
    given = SWING | {"points": points, "bodies": {"b": wheel}}
    found = [
        newmark.problem(given | {"torques": {"t": {key: "b", "torque": 3}}}) for key in ("on", True)
    ]
    forces = [newmark.march(one, h=1e-3, steps=2).u for one in found]
    np.testing.assert_array_equal(*forces)


def test_names_without_endings(cli):
    """`draw hoist` finds hoist.yaml, `run lift` finds lift.yaml, in the library, too."""
    cli.write("hoist.yaml", json.dumps(SWING))
    cli.write(
        "lift.yaml",
        json.dumps(STUDY | {"study": "lift", "problem": "hoist", "h": [1e-2, 1e-3, 1e-4]}),
    )
    assert "hoist.png" in cli("draw", "hoist").stdout
    assert cli("run", "lift").stdout == "lift: 3 ok -> results/lift.csv\n"
    assert set(pd.read_csv(cli.folder / "results/lift.csv")["problem"]) == {"hoist.yaml"}
    told = cli("validate", "hoist", "lift", "andrews", "pendulum-u", "chain(links=3)")
    told = told.stdout.splitlines()
    assert told == [
        "hoist.yaml: mechanism, 2 coordinates, 1 constraints, 1 degree of freedom",
        "lift.yaml: study lift, 3 cells",
        "andrews: mechanism, 8 coordinates, 7 constraints, 1 degree of freedom",
        "pendulum-u: study pendulum-u, 16 cells",
        "chain(links=3): mechanism, 6 coordinates, 3 constraints, 3 degrees of freedom",
    ]
    assert newmark.march(cli.folder / "hoist.yaml", h=1e-2, steps=1).problem.n == 2
    assert len(cli("check", "lift", "--markdown").stdout.splitlines()) > 2


def test_masses_of_body_points_count():
    """Inertia about the centre and the origin, against two point masses and a rod by hand."""
    rod = {"position": [0, 0, 0], "mass": 1, "centre": [0.5, 0, 0], "inertia": [0.1, 0.1, 0.1]}
    tip = {"on": "rod", "at": [1, 0, 0], "mass": 2}
    given = {"dimensions": 3, "bodies": {"rod": rod}, "body_points": {"tip": tip}}
    made = inertias(SpatialMechanism.model_validate(given))[0]
    centre, about_centre, about_origin = inertia_of(made)
    np.testing.assert_allclose(centre, [2.5 / 3, 0, 0])
    np.testing.assert_allclose(np.diag(about_origin), [0.1, 2.35, 2.35])
    np.testing.assert_allclose(np.diag(about_centre), [0.1] + 2 * [2.35 - 3 * (2.5 / 3) ** 2])


def test_one_step_size(cli):
    """What is undecided for one reason is said in one line."""
    cli.write("s.yaml", json.dumps(STUDY | {"measure": ["condition", "correction"]}))
    cli("run", "s")
    told = " ".join(cli("check", "s", code=1).stdout.split())
    assert told.count("step size") == 1
    assert "undecided: s, 7 series alike: 1 usable step size, an order needs 3" in told


def test_figures_have_the_title_of_a_mechanism(cli):
    """Else its name; panels of several mechanisms likewise."""
    cli.write("swing.yaml", json.dumps(SWING | {"title": "A swing"}))
    cli.write("plain.yaml", json.dumps(SWING))
    for study, problem in (("of-swing", "swing"), ("of-plain", "plain"), ("both", None)):
        problems = [f"{problem}.yaml"] if problem else ["swing.yaml", "plain.yaml"]
        given = STUDY | {"study": study, "problem": problems, "h": [1e-2, 1e-3], "t_end": 0.01}
        cli.write(f"{study}.yaml", json.dumps(given))
    cli("run", "of-swing", "of-plain", "both")
    results = Results(cli.folder / "results", collect(cli.folder / "results"))
    for study, said in (("of-swing", "A swing"), ("of-plain", "plain")):
        (figure,) = automatic.figures(study, results)
        assert figure.title.startswith(f"{said}, (u, λ) form")
    definition = FigureConfig(measure="condition", panels=["problem"])
    (figure,) = automatic.figures("both", results, [definition])
    assert [part.titles for part in figure.parts] == [("A swing",), ("plain",)]
