"""Spatial mechanisms without directors and without multipliers.

Accelerations in minimal coordinates, and Euler's equations with quaternions, by SciPy.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

G = 9.81


def rotation(q):
    """(3, 3) of a unit quaternion (scalar first)."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def euler(inertia, torque, start, t):
    """Rotation and body rates of a body from the axes of the ground, by Euler's equations.

    Args:
        inertia: (3, 3) about what is fixed, in body axes.
        torque: Rotation → (3,) torque in body axes.
        start: (3,) body rates.
        t: Time.
    """
    inverse = np.linalg.inv(inertia)

    def rates(_, state):
        q, w = state[:4], state[4:]
        a, x = q[0], q[1:]
        turned = 0.5 * np.concatenate([[-x @ w], a * w + np.cross(x, w)])
        pull = torque(rotation(q / np.linalg.norm(q)))
        return np.concatenate([turned, inverse @ (pull - np.cross(w, inertia @ w))])

    start = np.concatenate([[1, 0, 0, 0], start])
    state = solve_ivp(rates, (0, t), start, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return rotation(state[:4] / np.linalg.norm(state[:4])), state[4:], rates(t, state)[4:]


@dataclass(frozen=True)
class OneFreedom:
    """A linkage with one degree of freedom, by its energy.

    Attributes:
        masses, inertias: (b,) and (b, 3) about centres, in body axes.
        places: q → (b, 3) centres and (b, 3, 3) rotations of bodies; takes complex q.
        gravity: (3,).
    """

    masses: np.ndarray
    inertias: np.ndarray
    places: object
    gravity: np.ndarray

    def first(self, q):
        """(b, 3) velocities of centres, and rates of turn in body axes, for q' = 1."""
        centres, turns = self.places(q + 1e-30j)
        here = self.places(q + 0j)[1].real
        rates = np.einsum("bji,bjk->bik", here, turns.imag / 1e-30)
        axial = np.stack([rates[:, 2, 1], rates[:, 0, 2], rates[:, 1, 0]], axis=1)
        return centres.imag / 1e-30, axial

    def inertia(self, q):
        """∂²T/∂q'²."""
        velocity, spin = self.first(q)
        return self.masses @ (velocity**2).sum(axis=1) + (self.inertias * spin**2).sum()

    def pull(self, q):
        """−∂V/∂q."""
        velocity, _ = self.first(q)
        return float(self.masses @ (velocity @ self.gravity))

    def faster(self, q, rate):
        """q'' of a state, by Lagrange's equation; differences of order 4 of what is smooth."""
        h, weights = 0.005, {1: 2 / 3, 2: -1 / 12}
        slope = sum(
            w * (self.inertia(q + k * h) - self.inertia(q - k * h)) for k, w in weights.items()
        )
        return (self.pull(q) - slope / h * rate**2 / 2) / self.inertia(q)

    def accelerations(self, q, rate, faster):
        """(b, 3) of the centres."""
        h = 1e-3
        weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
        bend = (
            sum(
                w * (self.first(q + k * h)[0] - self.first(q - k * h)[0])
                for k, w in weights.items()
            )
            / h
        )
        return self.first(q)[0] * faster + bend * rate**2


def turned(axis, angle):
    """(3, 3) rotation about a coordinate axis, of complex angles too."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    found = np.eye(3, dtype=complex)
    found[i, i], found[i, j], found[j, i], found[j, j] = c, -s, s, c
    return found


def crossed(a, b):
    """The cross product, without what NumPy's does for arrays of any shape."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def slider_crank():
    """The spatial slider-crank: q is the angle of its crank from the upright."""

    def places(q):
        b = np.array([0, 0.1 - 0.08 * np.sin(q), 0.12 + 0.08 * np.cos(q)])
        x = np.sqrt(0.09 - b[1] ** 2 - b[2] ** 2)
        c = np.array([x, 0 * x, 0 * x])
        along = (c - b) / 0.3
        across = crossed(along, [1, 0, 0])
        across = -across / np.sqrt((across**2).sum())
        rod = np.stack([along, across, crossed(along, across)], axis=1)
        crank = (np.array([0, 0.1, 0.12]) + b) / 2
        # The crank of the file is centred midway, its axes those of the ground at q = 0.
        return (
            np.stack([crank, (b + c) / 2, c]),
            np.stack([turned("x", q), rod, np.eye(3, dtype=complex)]),
        )

    return OneFreedom(
        np.array([0.12, 0.5, 2]),
        np.array([[1e-4, 1e-4, 1e-5], [4e-4, 4e-3, 4e-3], [1e-4, 1e-4, 1e-4]]),
        places,
        np.array([0, 0, -G]),
    )


def bricard():
    """Bricard's mechanism: q is the angle of its first rod about the y axis."""

    def places(q):
        a = q
        # (1 + sin a)(1 + sin b) = 1, the joint angles being a, b, a, b, a, b.
        sine = 1 / (1 + np.sin(a)) - 1
        b = np.arcsin(sine)
        frame, at = np.eye(3, dtype=complex), np.zeros(3, complex)
        centres, turns = [], []
        steps = ("y", a, [1, 0, 0]), ("z", b, [0, -1, 0]), ("x", a, [0, 0, 1])
        steps += ("y", b, [-1, 0, 0]), ("z", a, [0, 1, 0])
        for axis, angle, along in steps:
            frame = frame @ turned(axis, angle)
            centres.append(at + frame @ (0.5 * np.array(along)))
            at = at + frame @ np.array(along)
            turns.append(frame)
        return np.stack(centres), np.stack(turns)

    short, long = 0.02 / 12, 1.01 / 12
    inertias = np.array(
        [[short, long, long], [long, short, long], [long, long, short],
         [short, long, long], [long, short, long]]
    )  # fmt: skip
    return OneFreedom(np.ones(5), inertias, places, np.array([0, -G, 0]))


def governor(beta, s, spin, turn, slide):
    """The flyball governor: β'', s'', ψ'' of a state β, s, ψ', β', s'.

    By symmetry both rods have one angle β below the horizontal; s is the height of the
    sleeve. The angular momentum I ψ' is constant.
    """
    short, long = 0.3 * 0.0002 / 12, 0.3 * 1.0001 / 12
    of_rod = long + 0.3 * 0.25 + 5

    def about_shaft(beta):
        c, d = np.cos(beta), np.sin(beta)
        rod = short * d**2 + long * c**2 + 0.3 * (0.05 + 0.5 * c) ** 2 + 5 * (0.05 + c) ** 2
        return 0.3 * 0.0002 / 12 + 3 * 0.02 / 12 + 2 * rod

    c, d = np.cos(beta), np.sin(beta)
    x, z = 0.5 * c, 1 - 0.5 * d - s  # from the sleeve to the middle of a rod
    length = np.hypot(x, z)
    of_beta, of_s = (-0.5 * d * x - 0.5 * c * z) / length, -z / length
    force = 8e5 * (length - 0.5) + 4e4 * (of_beta * turn + of_s * slide)
    shrinks = about_shaft(beta + 1e-30j).imag / 1e-30
    out = spin**2 * shrinks / 4 + (0.3 * 0.5 + 5) * G * c - force * of_beta
    return out / of_rod, -G - 2 * force * of_s / 3, -shrinks * turn * spin / about_shaft(beta)
