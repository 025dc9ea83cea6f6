"""Functions that contradict each other are found; right ones, however rough, are not refused."""

import itertools
import re

import numba
import numpy as np
import pytest
from each import each
from scipy.interpolate import CubicSpline

import newmark_cli as newmark
from newmark_cli.problems.problem import ProblemError

I2 = np.eye(2)
GRAVITY = np.array([0.0, -9.81])


def pendulum(at=np.pi / 2, load=lambda u, v, t: 0 * u, **more):
    """A pendulum of length 1 at an angle from the vertical, under a further load."""
    given = {
        "mass_matrix": I2,
        "u0": np.array([np.sin(at), -np.cos(at)]),
        "v0": np.zeros(2),
        "force": lambda u, v, t: GRAVITY + load(u, v, t),
        "constraints": lambda u, t: np.array([(u @ u - 1) / 2]),
        "gradient": lambda u, t: u[:, None].copy(),
    }
    return given | more


def along_x(load, slope, at=np.pi / 2, **more):
    """A pendulum with a force along x that depends on x, and its stiffness."""
    return pendulum(
        at, lambda u, v, t: np.array([load(u[0]), 0.0]),
        stiffness=lambda u, v, reaction, t: np.diag([slope(u[0]), 0.0]) - reaction[0] * I2, **more,
    )  # fmt: skip


def against_v(load, slope, at=np.pi / 2, **more):
    """A pendulum with a force on each axis that depends on the velocity, and its damping."""
    return pendulum(
        at, lambda u, v, t: load(v), damping=lambda u, v, t: np.diag(slope(v)),
        energy=lambda u, v, t: v @ v / 2 + 9.81 * u[1], **more,
    )  # fmt: skip


def moved(x, rate, faster, **more):
    """A point whose x is a function of time."""
    nothing = np.zeros((2, 1))
    return {
        "mass_matrix": I2,
        "u0": np.array([x(0.0), 0.0]),
        "v0": np.array([rate(0.0), 0.0]),
        "force": lambda u, v, t: GRAVITY,
        "constraints": lambda u, t: np.array([u[0] - x(t)]),
        "gradient": lambda u, t: np.array([[1.0], [0.0]]),
        "constraint_rate": lambda u, t: np.array([-rate(t)]),
        "curvature": lambda u, v, t: np.array([-faster(t)]),
        "rate_gradient": lambda u, v, t: nothing,
        "acceleration_gradient": lambda u, v, w, t: nothing,
    } | more


def double():
    """A double pendulum with all that can be given."""

    def gradient(u, t):
        x, y = u[2] - u[0], u[3] - u[1]
        return np.array([[u[0], -x], [u[1], -y], [0.0, x], [0.0, y]])

    def stiffness(u, v, reactions, t):
        first, second = (force * I2 for force in reactions)
        return -np.block([[first + second, -second], [-second, second]])

    return {
        "mass_matrix": np.diag([1.0, 1.0, 2.0, 2.0]),
        "u0": np.array([1.0, 0.0, 2.0, 0.0]),
        "v0": np.zeros(4),
        "force": lambda u, v, t: -9.81 * np.array([0.0, 1.0, 0.0, 2.0]) - 0.1 * v**3,
        "constraints": lambda u, t: np.array(
            [u[0] ** 2 + u[1] ** 2 - 1, (u[2] - u[0]) ** 2 + (u[3] - u[1]) ** 2 - 1]
        ) / 2,
        "gradient": gradient,
        "stiffness": stiffness,
        "damping": lambda u, v, t: np.diag(0.3 * v**2),
        "constraint_rate": lambda u, t: np.zeros(2),
        "curvature": lambda u, v, t: np.array(
            [v[0] ** 2 + v[1] ** 2, (v[2] - v[0]) ** 2 + (v[3] - v[1]) ** 2]
        ),
        "rate_gradient": lambda u, v, t: gradient(v, t),
        "acceleration_gradient": lambda u, v, w, t: gradient(w, t),
    }  # fmt: skip


def crank(scale=1.0, shift=(0.0, 0.0), speed=3.0):
    """A driven crank: x, y and the angle that a law of time prescribes; lengths by scale."""
    length, shift = 0.5 * scale, np.array(shift)

    def constraints(u, t):
        tip = length * np.array([np.cos(u[2]), np.sin(u[2])])
        return np.array([*(u[:2] - shift - tip), u[2] - np.sin(speed * t)])

    return {
        "mass_matrix": np.diag([1.0, 1.0, 0.02 * scale**2]),
        "u0": np.array([shift[0] + length, shift[1], 0.0]),
        "v0": np.array([0.0, length * speed, speed]),
        "force": lambda u, v, t: np.array([0.0, -9.81 * scale, 0.0]),
        "constraints": constraints,
        "gradient": lambda u, t: np.array(
            [[1, 0, 0], [0, 1, 0], [length * np.sin(u[2]), -length * np.cos(u[2]), 1]]
        ),
        "constraint_rate": lambda u, t: np.array([0, 0, -speed * np.cos(speed * t)]),
        "curvature": lambda u, v, t: np.array(
            [
                length * np.cos(u[2]) * v[2] ** 2,
                length * np.sin(u[2]) * v[2] ** 2,
                speed**2 * np.sin(speed * t),
            ]
        ),
    }


def shifted(length=0.4, root=False):
    """A pendulum far from the origin."""
    centre = np.array([1000.0, -500.0])

    def constraints(u, t):
        distance = np.hypot(*(u - centre))
        return np.array([distance - length if root else (distance**2 - length**2) / 2])

    return pendulum(
        u0=centre + np.array([length, 0.0]), constraints=constraints,
        gradient=lambda u, t: ((u - centre) / (length if root else 1.0))[:, None],
        energy=lambda u, v, t: v @ v / 2 + 9.81 * u[1],
    )  # fmt: skip


def kepler(x):
    """The eccentric anomaly, by an iteration that is given up early."""
    y = x
    while abs(step := x + 0.3 * np.sin(y) - y) > 1e-8:
        y += step
    return y


def noise(u, size):
    return size * (2 * np.random.default_rng(abs(hash(u.tobytes()))).random() - 1)


NODES = np.linspace(-2, 2, 41)
HEIGHTS = 4 * np.sin(3 * NODES)
SPLINE = CubicSpline(np.linspace(0, 0.2, 9), np.cos(np.linspace(0, 0.2, 9)))


def slope_of_table(x):
    k = int(np.clip(np.searchsorted(NODES, x, side="right") - 1, 0, len(NODES) - 2))
    return (HEIGHTS[k + 1] - HEIGHTS[k]) / (NODES[k + 1] - NODES[k])


def of_spline(t, order=0):
    if not 0 <= t <= 0.2:
        raise ValueError(f"no table at {t}")
    return float(SPLINE(t, order))


RIGHT = {
    "double": double(),
    "crank": crank(),
    "crank, fast": crank(speed=1e4),
    "small and far away": shifted(1e-3, root=True),
    "coordinates of very different size": pendulum(
        u0=np.array([1e6, 0.0]), mass_matrix=np.diag([1e-12, 1e12]),
        force=lambda u, v, t: np.array([0.0, -1e6]),
        constraints=lambda u, t: np.array([((u[0] / 1e6) ** 2 + (u[1] / 1e-6) ** 2 - 1) / 2]),
        gradient=lambda u, t: np.array([[u[0] / 1e12], [u[1] / 1e-12]]),
    ),
    "dry friction": against_v(lambda v: -0.5 * np.sign(v), lambda v: 0 * v),
    "sharp friction": against_v(
        lambda v: -np.arctan(v / 1e-6), lambda v: 1e6 / (1 + (v / 1e-6) ** 2), at=0.1
    ),
    "drag": against_v(lambda v: -v * np.abs(v), lambda v: 2 * np.abs(v)),
    "kink": along_x(lambda x: -5 * abs(x), np.sign, at=0.0) | {"v0": np.array([1.0, 0.0])}
    | {"stiffness": lambda u, v, r, t: np.diag([5 * np.sign(u[0]), 0]) - r[0] * I2},
    "stop": along_x(lambda x: 1e4 * max(0.99 - x, 0.0), lambda x: 1e4 * (x < 0.99)),
    **{
        f"play at {at:g}": along_x(
            lambda x: -300 * (x - np.clip(x, -1e-6, 1e-6)),
            lambda x: 300.0 * (abs(x) > 1e-6),
            at,
            energy=lambda u, v, t: v @ v / 2 + 9.81 * u[1] + 150 * max(abs(u[0]) - 1e-6, 0) ** 2,
        )
        for at in (0.0, 1e-6, 3e-6)
    },
    "table of forces": along_x(lambda x: -np.interp(x, NODES, HEIGHTS), slope_of_table),
    "stairs": along_x(lambda x: -np.round(5 * x, 3), lambda x: 5.0),
    "iteration": along_x(
        lambda x: -kepler(x), lambda x: 1 / (1 - 0.3 * np.cos(kepler(x)))
    ),
    **{
        f"noise {size:g}": pendulum(
            load=lambda u, v, t, size=size: np.array([-5 * u[0] ** 3 + noise(u, size), 0.0]),
            stiffness=lambda u, v, r, t: np.diag([15 * u[0] ** 2, 0]) - r[0] * I2,
        )
        for size in (1e-12, 1e-9, 1e-6)
    },
    "no table before the start": moved(
        of_spline, lambda t: of_spline(t, 1), lambda t: of_spline(t, 2)
    ),
    "stopped": moved(
        lambda t: 1 - min(t - 0.08, 0) ** 2 / 2, lambda t: max(0.08 - t, 0.0),
        lambda t: -1.0 * (t < 0.08),
    ),
    "edge of a domain": pendulum(
        constraints=lambda u, t: np.array([u[0] - np.sqrt(1 - u[1] ** 2)]),
        gradient=lambda u, t: np.array([[1.0], [u[1] / np.sqrt(1 - u[1] ** 2)]]),
    ),
    "spring of no length": pendulum(
        load=lambda u, v, t: -50 * (u - [1, 0]) * (1 - 0.1 / max(np.hypot(*(u - [1, 0])), 1e-300)),
        v0=np.array([0.0, 0.5]),
    ),
    "magnet": pendulum(
        load=lambda u, v, t: 3 * np.array([-v[1], v[0]]), v0=np.array([0.0, 1.0]),
        damping=lambda u, v, t: 3 * np.array([[0.0, 1.0], [-1.0, 0.0]]),
        energy=lambda u, v, t: v @ v / 2 + 9.81 * u[1],
    ),
}  # fmt: skip


@each("name", RIGHT)
def test_right_problems_are_not_refused(name):
    """Whatever their scale, noise, kinks, jumps and singular states."""
    with np.errstate(invalid="ignore"):
        subject = newmark.problem(newmark.Definition(**RIGHT[name]))
    assert np.array_equal(subject.u0, RIGHT[name]["u0"])


def arguments(key, given):
    u, v = given["u0"], given["v0"]
    return {
        "stiffness": (u, v, np.ones(len(given["constraints"](u, 0.0))), 0.0),
        "acceleration_gradient": (u, v, u, 0.0),
    }.get(key, (u, 0.0) if key in ("gradient", "constraint_rate") else (u, v, 0.0))


def mutants(given):
    """Each entry of each function by 1 %, with the wrong sign and without; transposed."""
    for key in (
        "gradient", "stiffness", "damping", "constraint_rate", "curvature", "rate_gradient",
        "acceleration_gradient",
    ):  # fmt: skip
        if key not in given:
            continue
        shape = given[key](*arguments(key, given)).shape
        changes = [
            (place, factor)
            for place in itertools.product(*map(range, shape))
            for factor in (1.01, -1.0, 0.0)
        ]
        for place, factor in changes:

            def wrong(*at, function=given[key], place=place, factor=factor):
                values = np.array(function(*at), float)
                values[place] *= factor
                return values

            yield f"{key} {place} {factor}", wrong, given | {key: wrong}, key
        if len(shape) == 2 and shape[0] == shape[1]:

            def turned(*at, function=given[key]):
                return np.ascontiguousarray(np.array(function(*at), float).T)

            yield f"{key} transposed", turned, given | {key: turned}, key


def refusal(given):
    try:
        newmark.problem(newmark.Definition(**given))
    except ProblemError as error:
        return str(error)
    return ""


@each("given", [double(), crank(), crank(1e3), shifted()])
def test_wrong_derivatives_are_refused_at_load(given):
    """Also where the wrong entry vanishes at the start, in any unit."""
    refused, passed = 0, []
    nearby = np.random.default_rng(5).normal(size=(2, len(given["u0"])))
    for name, wrong, mutant, key in mutants(given):
        at = (*nearby[: len(arguments(key, given)) - 1], 0.3)
        if key == "stiffness":
            at = (*nearby, np.array([1.3, -0.7]), 0.3)
        if key == "acceleration_gradient":
            at = (*nearby, nearby[0], 0.3)
        if np.array_equal(wrong(*at), given[key](*at)):
            continue  # 0 in any case
        blamed = refusal(mutant)
        refused += f"{key} disagrees" in blamed
        if f"{key} disagrees" not in blamed and "redundant" not in blamed:
            passed.append(f"{name}: {blamed}")
    assert not passed
    assert refused >= 5


@each("factor, compiled", [(1.01, False), (2.0, False), (-1.0, False), (1.01, True)])
def test_the_message_names_entry_and_both_values(factor, compiled):
    """A pendulum from a level start, where the wrong entry is 0."""

    def gradient(u, t):
        return np.array([[u[0]], [factor * u[1]]])

    given = pendulum(gradient=gradient)
    if compiled:
        given |= {
            "force": numba.njit(lambda u, v, t: np.array([0.0, -9.81])),
            "constraints": numba.njit(lambda u, t: np.array([(u[0] ** 2 + u[1] ** 2 - 1) / 2])),
            "gradient": numba.njit(gradient),
        }
    with pytest.raises(ProblemError) as caught:
        newmark.problem(newmark.Definition(**given))
    found = re.fullmatch(
        r"definition: gradient disagrees with differences in row 2, column 1 next to the start: "
        r"given (\S+), differences say (\S+)",
        str(caught.value),
    )
    assert float(found[1]) / float(found[2]) == pytest.approx(factor, rel=1e-6)


@each(
    "energy",
    [
        lambda u, v, t: v @ v / 2 + 1.01 * 9.81 * u[1],
        lambda u, v, t: v @ v / 2 - 9.81 * u[1],
        lambda u, v, t: v @ v / 2,
        lambda u, v, t: 9.81 * u[1],
        lambda u, v, t: v @ v + 9.81 * u[1],
    ],
)
@each("given", [pendulum(), shifted(), RIGHT["drag"]])
def test_energies_that_nothing_conserves_are_refused(energy, given):
    """Also next to dissipation, which takes from a right energy."""
    with pytest.raises(ProblemError, match=r"energy is not conserved at the start: .* changes by"):
        newmark.problem(newmark.Definition(**given | {"energy": energy}))


def test_an_energy_without_a_spring_that_starts_unloaded():
    """Its rate is right at the start, where the spring has no force."""
    given = along_x(lambda x: -50 * x, lambda x: 50.0, at=0.0)
    energies = {
        k: lambda u, v, t, k=k: v @ v / 2 + 9.81 * u[1] + k * u[0] ** 2 / 2 for k in (0, 50)
    }
    assert not refusal(given | {"energy": energies[50]})
    assert "energy is not conserved next to the start: " in refusal(given | {"energy": energies[0]})


FILE = """\
import numpy as np
from newmark_cli import Definition
def swing(factor):
    def gradient(u, t):
        return np.array([[u[0]], [u[1] * factor]])
    return Definition(
        np.eye(2), np.array([1.0, 0.0]), np.zeros(2), lambda u, v, t: np.array([0.0, -1.0]),
        lambda u, t: np.array([(u @ u - 1) / 2]), gradient,
    )
"""


@each("command", ["validate", "run"])
def test_a_study_of_a_contradiction_is_refused(cli, command):
    """With the line of the function that is wrong; nothing is computed."""
    cli.write("mine.py", FILE)
    cli.write(
        "mine.yaml",
        "study: mine\nform: u-lambda\npreconditioning: none\nh: 0.1\nt_end: 0.8\n"
        "expect: [{measure: correction, at_least: 1.0e-99}]\n"
        'problem: {python: "mine.py:swing", args: {factor: 1.01}}\n',
    )
    said = cli.refused(command, "mine.yaml", "--allow-code")
    assert "mine.py, line 4: gradient disagrees with differences in row 2, column 1 next" in said
    assert not (cli.folder / "results" / "mine.csv").exists()
