"""Functions that contradict each other are found; right ones, however rough, are not refused."""

import re

import numpy as np
import pytest
from test_constraint_rows import ALL, wavy_definition

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


def resisted():
    """A pendulum with a cubic resistance and a spring, their tangents, and all of Φ' and Φ''."""
    return pendulum(
        load=lambda u, v, t: -0.1 * v**3 - 3 * u**3,
        stiffness=lambda u, v, r, t: np.diag(9 * u**2) - r[0] * I2,
        damping=lambda u, v, t: np.diag(0.3 * v**2),
    )


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


def noise(u, size):
    return size * (2 * np.random.default_rng(abs(hash(u.tobytes()))).random() - 1)


RIGHT = {
    "everything": wavy_definition(given=ALL),
    "resisted": resisted(),
    "small and far away": shifted(1e-3, root=True),
    "coordinates of very different size": pendulum(
        u0=np.array([1e6, 0.0]), mass_matrix=np.diag([1e-12, 1e12]),
        force=lambda u, v, t: np.array([0.0, -1e6]),
        constraints=lambda u, t: np.array([((u[0] / 1e6) ** 2 + (u[1] / 1e-6) ** 2 - 1) / 2]),
        gradient=lambda u, t: np.array([[u[0] / 1e12], [u[1] / 1e-12]]),
    ),
    "sharp friction": against_v(
        lambda v: -np.arctan(v / 1e-6), lambda v: 1e6 / (1 + (v / 1e-6) ** 2), at=0.1
    ),
    "drag": against_v(lambda v: -v * np.abs(v), lambda v: 2 * np.abs(v)),
    "kink": along_x(lambda x: -5 * abs(x), lambda x: 5 * np.sign(x), at=0.0)
    | {"v0": np.array([1.0, 0.0])},
    "stop": along_x(lambda x: 1e4 * max(0.99 - x, 0.0), lambda x: 1e4 * (x < 0.99)),
    "play": along_x(
        lambda x: -300 * (x - np.clip(x, -1e-6, 1e-6)), lambda x: 300.0 * (abs(x) > 1e-6), 3e-6,
        energy=lambda u, v, t: v @ v / 2 + 9.81 * u[1] + 150 * max(abs(u[0]) - 1e-6, 0) ** 2,
    ),
    "stairs": along_x(lambda x: -np.round(5 * x, 3), lambda x: 5.0),
    **{
        f"noise {size:g}": pendulum(
            load=lambda u, v, t, size=size: np.array([-5 * u[0] ** 3 + noise(u, size), 0.0]),
            stiffness=lambda u, v, r, t: np.diag([15 * u[0] ** 2, 0]) - r[0] * I2,
        )
        for size in (1e-9, 1e-6)
    },
    "edge of a domain": pendulum(
        constraints=lambda u, t: np.array([u[0] - np.sqrt(1 - u[1] ** 2)]),
        gradient=lambda u, t: np.array([[1.0], [u[1] / np.sqrt(1 - u[1] ** 2)]]),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", RIGHT)
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
    """Each entry of each function by 1 %, with the wrong sign, or without; and transposed."""
    for key, right in given.items():
        if key in ("mass_matrix", "u0", "v0", "force", "constraints", "energy"):
            continue
        shape = np.shape(right(*arguments(key, given)))
        for number, place in enumerate(np.ndindex(shape)):

            def wrong(*at, right=right, place=place, factor=(1.01, -1.0, 0.0)[number % 3]):
                values = np.array(right(*at), float)
                values[place] *= factor
                return values

            yield key, place, wrong
        if len(shape) == 2 and shape[0] == shape[1]:
            yield key, "transposed", lambda *at, right=right: np.array(right(*at), float).T.copy()


def refusal(given):
    try:
        newmark.problem(newmark.Definition(**given))
    except ProblemError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("given", [wavy_definition(given=ALL), resisted(), shifted()])
def test_wrong_derivatives_are_refused_at_load(given):
    """Also where the wrong entry vanishes at the start, in any unit."""
    refused, passed = 0, []
    nearby = np.random.default_rng(5).normal(size=(3, len(given["u0"])))
    for key, place, wrong in mutants(given):
        at = (*nearby[: len(arguments(key, given)) - 1], 0.3)
        if key == "stiffness":
            at = (*nearby[:2], np.array([1.3]), 0.3)
        if np.array_equal(wrong(*at), given[key](*at)):
            continue  # 0 in any case
        blamed = refusal(given | {key: wrong})
        refused += f"{key} disagrees" in blamed
        if f"{key} disagrees" not in blamed and "redundant" not in blamed:
            passed.append(f"{key} {place}: {blamed}")
    assert not passed
    assert refused >= 2


@pytest.mark.parametrize("factor", [-1.0, 1.01])
def test_the_message_names_entry_and_both_values(factor):
    """A pendulum from a level start, where the wrong entry is 0."""
    given = pendulum(gradient=lambda u, t: np.array([[u[0]], [factor * u[1]]]))
    found = re.fullmatch(
        r"definition: gradient disagrees with differences in row 2, column 1 next to the start: "
        r"given (\S+), differences say (\S+)",
        refusal(given),
    )
    assert float(found[1]) / float(found[2]) == pytest.approx(factor, rel=1e-6)


@pytest.mark.parametrize("given", [pendulum(), shifted(), RIGHT["drag"]])
def test_energies_that_nothing_conserves_are_refused(given):
    """Also next to dissipation, which takes from a right energy."""
    for kinetic, weight in ((0.5, 1.01), (0.5, -1), (0.5, 0), (0, 1), (1, 1)):
        wrong = given | {"energy": lambda u, v, t, a=kinetic, b=weight: a * v @ v + b * 9.81 * u[1]}
        assert re.search("energy is not conserved at the start: .* changes by", refusal(wrong))
