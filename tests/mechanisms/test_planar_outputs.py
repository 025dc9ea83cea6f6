"""Places of points on bodies and forces of pins, which a mechanism file asks for."""

import csv
import pickle

import numpy as np
import pytest
from matplotlib.figure import Figure

import newmark_cli as newmark
from newmark_cli.mechanisms import registry
from newmark_cli.problems.index_1 import Index1
from newmark_cli.report.drawing import draw_mechanism
from newmark_cli.support import documents

WITH_PINS = [
    name for name in registry.TESTSET if (registry.TESTSET_FOLDER / f"{name}-pins.csv").exists()
]


def rows_of(name):
    """Rows of a table of the test set, by column."""
    with (registry.TESTSET_FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def outputs_of(problem, t, u, v, multipliers):
    """Output → value."""
    values = problem.outputs.values(problem, t, u, v, multipliers)
    return dict(zip(problem.outputs.names, values.tolist(), strict=True))


def asking(name, **changes):
    """Data of a mechanism of the test set that asks for all outputs."""
    data = documents.read(registry.file(name)).data
    return {**data, "outputs": ["points", "pins"], **changes}


@pytest.mark.parametrize("name", WITH_PINS)
def test_pin_forces_of_the_test_set(name):
    """They are those of an assembly of its own in 80 bits, which has none of this package."""
    problem = newmark.problem(asking(name))
    parts = {"u": "coordinate_names", "v": "coordinate_names", "lambda": "constraint_names"}
    for row, pins in zip(rows_of(name), rows_of(f"{name}-pins"), strict=True):
        state = [
            np.array([float(row[f"{part}[{of}]"]) for of in getattr(problem, names)])
            for part, names in parts.items()
        ]
        ours = outputs_of(problem, float(row["t"]), *state)
        wanted = {
            f"{column[6:-3]}.force{column[-3:-1]}": float(value)
            for column, value in pins.items()
            if column.startswith("force[")
        }
        assert [of for of in ours if ".force." in of] == list(wanted)
        found = np.array([ours[of] for of in wanted])
        exact = np.array(list(wanted.values()))
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


#: Three bodies at one pin, on which a spring, a weight and a bar act, too; two are driven.
STAR = {
    "points": {
        "O": {"fixed": [0, 0]}, "W": {"fixed": [-1, 1.5]},
        "A": {"at": [0.6, 0.8], "mass": 0.4}, "B": {"at": [1.6, 0.8]},
        "C": {"at": [0.6, 1.6]}, "D": {"at": [1.4, 1.4], "mass": 0.3},
    },
    "bodies": {
        "arm": {"from": "O", "to": "A", "length": 1, "mass": 2, "centre": [0.4, 0.1],
                "inertia": 0.2},
        "rod": {"from": "A", "to": "B", "length": 1, "mass": 1, "centre": [0.5, 0],
                "inertia": 0.1},
        "link": {"from": "C", "to": "A", "length": 0.8, "mass": 0.5, "centre": [0.3, -0.2],
                 "inertia": 0.05},
    },
    "body_points": {"tip": {"on": "link", "at": [0.1, 0.3]}},
    "bars": {"strut": {"from": "A", "to": "D", "length": 1}},
    "springs": {"s": {"from": "W", "to": "A", "stiffness": 20, "rest_length": 1},
                "t": {"from": "tip", "to": "B", "stiffness": 5, "rest_length": 0.5}},
    "motions": {"drive": {"body": "arm", "angle": {"rate": 0.5}}},
    "torques": {"motor": {"on": "rod", "from": "link", "torque": {"value": 3}}},
    "torsion_dampers": {"rub": {"from": "arm", "to": "rod", "damping": 0.3}},
    "forces": {"push": {"at": "A", "force": [1, -2]}},
    "gravity": [0, -9.81], "project_velocities": True, "outputs": ["pins", "points"],
}  # fmt: skip


def test_newton_and_euler_for_each_body():
    """Of each body forces add up to m a, and their moments to I α; at the pin they cancel."""
    problem = newmark.problem(STAR)
    u, v = problem.u0, problem.v0
    a, multipliers = Index1(problem).accelerations(0.0, u, v)
    ours = outputs_of(problem, 0.0, u, v, multipliers)
    plain = {key: value for key, value in STAR.items() if key != "outputs"}
    assert newmark.problem(plain).content != problem.content
    assert outputs_of(pickle.loads(pickle.dumps(problem)), 0.0, u, v, multipliers) == ours
    places = {name: complex(*of["fixed"]) for name, of in STAR["points"].items() if "fixed" in of}
    rates, changes = (dict.fromkeys(places, 0j) for _ in range(2))
    for field, known in ((u, places), (v, rates), (a, changes)):
        known |= {name: complex(*field[2 * i :][:2]) for i, name in enumerate(problem.points)}

    def body(name, at, field):
        of = STAR["bodies"][name]
        z = complex(*at) / of["length"]
        return (1 - z) * field[of["from"]] + z * field[of["to"]]

    places["tip"] = body("link", [0.1, 0.3], places)
    assert complex(ours["tip.x"], ours["tip.y"]) == pytest.approx(places["tip"])
    pull = {}
    for name, of in STAR["springs"].items():
        arm = places[of["to"]] - places[of["from"]]
        pull[name] = of["stiffness"] * (abs(arm) - of["rest_length"]) * arm / abs(arm)
    gravity = -9.81j
    # What else acts on a body: (force, place), and a torque, which pins do not tell of.
    others = {"arm": [], "rod": [], "link": [(pull["t"], places["tip"])]}
    named = dict(zip(problem.constraint_names, multipliers, strict=True))
    turning = {
        name: (arm := places[of["to"]] - places[of["from"]]).conjugate()
        * (rates[of["to"]] - rates[of["from"]]) / abs(arm) ** 2
        for name, of in STAR["bodies"].items()
    }  # fmt: skip
    rubbing = -0.3 * (turning["rod"].imag - turning["arm"].imag)
    torques = {"arm": named["motions.drive.angle"] - rubbing, "rod": 3 + rubbing, "link": -3.0}
    at_pin = 0j
    for name, of in STAR["bodies"].items():
        centre = body(name, of["centre"], places)
        arm = places[of["to"]] - places[of["from"]]
        apart = changes[of["to"]] - changes[of["from"]]
        spin = (arm.conjugate() * apart).imag / abs(arm) ** 2
        acting = list(others[name]) + [
            (complex(*(ours[f"{name}@{end}.force.{c}"] for c in "xy")), places[end])
            for end in (of["from"], of["to"])
        ]
        inertia = of["mass"] * (body(name, of["centre"], changes) - gravity)
        assert sum(force for force, _ in acting) == pytest.approx(inertia, abs=1e-10)
        moment = sum(((at - centre).conjugate() * force).imag for force, at in acting)
        assert moment + torques[name] == pytest.approx(of["inertia"] * spin, abs=1e-10)
        at_pin += complex(*(ours[f"{name}@A.force.{c}"] for c in "xy"))
    strut = named["bars.strut"] * (places["A"] - places["D"])
    weight = 0.4 * (changes["A"] - gravity)
    assert at_pin == pytest.approx(-pull["s"] + strut + (1 - 2j) - weight, abs=1e-10)


def test_points_of_a_march():
    """Moving, fixed and fixed on a body, and their velocities; others are refused."""
    bars = newmark.march("four-bar", h=1e-3, t_end=0.01)
    b, c = (bars.point(name) @ [1, 1j] for name in "BC")
    tip = b + (c - b) / 0.38 * (0.19 + 0.1j)
    np.testing.assert_allclose(bars.point("D") @ [1, 1j], tip, rtol=1e-14)
    b, c = (bars.point(name, "v") @ [1, 1j] for name in "BC")
    tip = b + (c - b) / 0.38 * (0.19 + 0.1j)
    np.testing.assert_allclose(bars.point("D", "v") @ [1, 1j], tip, rtol=1e-13)
    assert (bars.point("E") == [0.4, 0]).all()
    assert (bars.point("E", "v") == 0).all()
    with pytest.raises(newmark.InputError, match=r"unknown point 'Q'; allowed: B, C, A, E, F, D"):
        bars.point("Q")


def test_points_on_bodies_in_space():
    """The origin and the axes carry them."""
    data = documents.read(registry.file("governor")).data
    problem = newmark.problem({**data, "outputs": ["points"]})
    (name, of), *_ = data["body_points"].items()
    moved = newmark.march(problem, h=1e-4, t_end=1e-3)
    first = problem.points.index(next(p for p in problem.points if p.startswith(of["on"] + ".")))
    carried = moved.u[:, 3 * first : 3 * first + 12].reshape(-1, 4, 3)
    place = carried[:, 0] + np.einsum("i,kic->kc", of["at"], carried[:, 1:])
    np.testing.assert_allclose(moved.point(name), place, atol=1e-15)
    np.testing.assert_array_equal(moved.output(f"{name}.y"), moved.point(name)[:, 1])
    usual = newmark.problem(data).outputs.names
    assert problem.outputs.names[: len(usual)] == usual


def test_drawn_paths(cli):
    """They go where a march's points go, in the figure's unit; the mechanism is at its start."""
    problem = newmark.problem("stephenson-sixbar")
    turned = newmark.march(problem, h=1e-4, t_end=0.02, every=20)
    paths = draw_mechanism.paths(problem, ("E", "D"), [*turned.u])
    np.testing.assert_allclose(paths["E"], 1e3 * turned.point("E") @ [1, 1j], rtol=1e-14)
    assert set(paths["D"]) == {135}
    axes = Figure().add_subplot()
    key = draw_mechanism.draw_mechanism(axes, problem, problem.u0, paths=paths)
    assert [line.get_label() for line in key][-2:] == ["path of E", "path of D"]
    drawn = [line.get_xydata() @ [1, 1j] for line in axes.get_lines()]
    assert any(len(line) == 11 and np.array_equal(line, paths["E"]) for line in drawn)
    done = cli("draw", "four-bar", "--path", "D", "--path", "B", "--until", "0.02")
    assert done.stdout == "results/figures/four-bar-path-D-B.png\n"
    assert (cli.folder / "results/figures/four-bar-path-D-B.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--path", "Q", "--until", "0.1"], "--path: unknown point 'Q'; allowed: A, E, F, B, C, D"),
        (["--path", "D"], "--path: needs --until T"),
        (["--until", "1"], "--until: needs --path P"),
        (["--path", "D", "--until", "1", "--at", "1"], "--path: is drawn with the mechanism at "),
    ],
)
def test_paths_that_are_refused(cli, options, told):
    assert cli.refused("draw", "four-bar", *options).startswith(f"newmark-study: {told}")
