"""References that share no code with the package: formulas typed again, in mpmath.

Data and formulas of Andrews' mechanism are those of the IVP test set; the
package reads the same data from a YAML file and assembles element by element.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from mpmath import cos, matrix, mp, mpf, sin, sqrt
from scipy.integrate import solve_ivp

DIGITS = 60

#: The trapezoidal rule.
BETA, GAMMA = mpf("0.25"), mpf("0.5")

#: from, to, length, mass, centre along, centre across, inertia
_BODIES = {
    1: ("O", "F", ".007", ".04325", ".00092", "0", "2.194e-6"),
    2: ("F", "E", ".028", ".00365", ".0115", "0", "4.410e-7"),
    3: ("B", "E", ".035", ".02373", ".01874", ".01043", "5.255e-6"),
    4: ("G", "E", ".02", ".00706", ".00579", "0", "5.667e-7"),
    5: ("A", "G", ".04", ".07050", ".02308", ".00916", "1.169e-5"),
    6: ("H", "E", ".02", ".00706", ".00579", "0", "5.667e-7"),
    7: ("A", "H", ".04", ".05498", ".01228", ".00449", "1.912e-5"),
}
_MOVING = "EFGH"

#: IVP test set, t = 0.03: beta, Theta, gamma, Phi, delta, Omega, epsilon.
REFERENCE_ANGLES = (
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
    0.5244099658805304, 0.5347301163226948, 1.048080741042263,
)  # fmt: skip
REFERENCE_RATES = (
    1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385,
    0.5735699284790808, -19.29337464421385, 0.3231791658026955,
)  # fmt: skip


def andrews_points(angles, rates):
    """Positions and velocities of E, F, G, H from the seven angles and their rates."""
    beta, theta, _, _, delta, _, epsilon = (mpf(x) for x in angles)
    dbeta, dtheta, _, _, ddelta, _, depsilon = (mpf(x) for x in rates)
    rr, d, zt, u = mpf(".007"), mpf(".028"), mpf(".04"), mpf(".04")
    ax, ay = mpf("-.06934"), mpf("-.00227")
    f = (rr * cos(beta), rr * sin(beta))
    df = (-rr * sin(beta) * dbeta, rr * cos(beta) * dbeta)
    both, dboth = beta + theta, dbeta + dtheta
    e = (f[0] - d * cos(both), f[1] - d * sin(both))
    de = (df[0] + d * sin(both) * dboth, df[1] - d * cos(both) * dboth)
    g = (ax + zt * cos(delta), ay + zt * sin(delta))
    dg = (-zt * sin(delta) * ddelta, zt * cos(delta) * ddelta)
    h = (ax + u * sin(epsilon), ay - u * cos(epsilon))
    dh = (u * cos(epsilon) * depsilon, u * sin(epsilon) * depsilon)
    return [*e, *f, *g, *h], [*de, *df, *dg, *dh]


@dataclass
class Reference:
    """A problem in mpmath.

    Attributes:
        n, m: Coordinates and constraints.
        mass: (n, n) M.
        force: u, λ → f + Gλ as a list.
        phi: u → Φ as a list.
    """

    n: int
    m: int
    mass: matrix
    force: object
    phi: object

    def jacobian_terms(self, u, multipliers):
        """X = −∂(f + Gλ)/∂u and G = Φ_uᵀ, by central differences at 60 digits."""
        step = mpf(10) ** -25
        u = [mpf(x) for x in u]
        multipliers = [mpf(x) for x in multipliers]
        x, g = matrix(self.n, self.n), matrix(self.n, self.m)
        for j in range(self.n):
            up, down = list(u), list(u)
            up[j] += step
            down[j] -= step
            force = zip(self.force(up, multipliers), self.force(down, multipliers), strict=True)
            for i, (plus, minus) in enumerate(force):
                x[i, j] = -(plus - minus) / (2 * step)
            for k, (plus, minus) in enumerate(zip(self.phi(up), self.phi(down), strict=True)):
                g[j, k] = (plus - minus) / (2 * step)
        return x, g


def pendulum():
    """Unit pendulum in Cartesian coordinates."""
    return Reference(
        n=2,
        m=1,
        mass=matrix([[1, 0], [0, 1]]),
        force=lambda u, multipliers: [multipliers[0] * u[0], multipliers[0] * u[1] - 1],
        phi=lambda u: [(u[0] ** 2 + u[1] ** 2 - 1) / 2],
    )


def andrews():
    """Andrews' mechanism in natural coordinates."""
    fixed = {
        "O": (mpf(0), mpf(0)),
        "A": (mpf("-.06934"), mpf("-.00227")),
        "B": (mpf("-.03635"), mpf(".03273")),
        "C": (mpf(".014"), mpf(".072")),
    }
    mass = matrix(8, 8)
    for start, end, length, m, along, across, inertia in _BODIES.values():
        length, m, x, y = mpf(length), mpf(m), mpf(along), mpf(across)
        i_start = mpf(inertia) + m * (x**2 + y**2)
        ii = m - 2 * m * x / length + i_start / length**2
        jj = i_start / length**2
        a, b = m * x / length - i_start / length**2, m * y / length
        blocks = {
            (start, start): (ii, 0),
            (end, end): (jj, 0),
            (start, end): (a, b),
            (end, start): (a, -b),
        }
        for (p, q), (same, turn) in blocks.items():
            if p in _MOVING and q in _MOVING:
                i, j = 2 * _MOVING.index(p), 2 * _MOVING.index(q)
                mass[i, j] += same
                mass[i + 1, j + 1] += same
                mass[i, j + 1] -= turn
                mass[i + 1, j] += turn

    def point(u, name):
        if name in fixed:
            return fixed[name]
        i = 2 * _MOVING.index(name)
        return u[i], u[i + 1]

    def difference(u, start, end):
        (x1, y1), (x2, y2) = point(u, start), point(u, end)
        return x2 - x1, y2 - y1

    def phi(u):
        return [
            (sum(x**2 for x in difference(u, start, end)) - mpf(length) ** 2) / 2
            for start, end, length, *_ in _BODIES.values()
        ]

    def force(u, multipliers):
        total = [mpf(0)] * 8
        for multiplier, (start, end, *_) in zip(multipliers, _BODIES.values(), strict=True):
            dx, dy = difference(u, start, end)
            for name, sign in ((start, -1), (end, 1)):
                if name in _MOVING:
                    i = 2 * _MOVING.index(name)
                    total[i] += sign * multiplier * dx
                    total[i + 1] += sign * multiplier * dy
        # Spring C-D: D = B + (sc/ss)(E−B) + (sd/ss) R(E−B), force on D pulled back to E.
        p, q = mpf(".018") / mpf(".035"), mpf(".02") / mpf(".035")
        bx, by = fixed["B"]
        ex, ey = u[0] - bx, u[1] - by
        dx = bx + p * ex - q * ey - fixed["C"][0]
        dy = by + p * ey + q * ex - fixed["C"][1]
        length = sqrt(dx**2 + dy**2)
        tension = mpf(4530) * (length - mpf(".07785"))
        fx, fy = -tension * dx / length, -tension * dy / length
        total[0] += p * fx + q * fy
        total[1] += p * fy - q * fx
        # Torque 0.033 through the angle of F.
        square = u[2] ** 2 + u[3] ** 2
        total[2] += -mpf(".033") * u[3] / square
        total[3] += mpf(".033") * u[2] / square
        return total

    return Reference(8, 7, mass, force, phi)


REFERENCES = {"pendulum": pendulum, "andrews": andrews}


def _of_force(b, g, h):
    return b * h**2


def _of_relation(b, g, h):
    return b * h / g


def _of_velocity(b, g, h):
    return g / (b * h)


def _of_acceleration(b, g, h):
    return 1 / (b * h**2)


_D, _LAMBDA = {"D": _of_force}, {"lambda": _of_acceleration}
#: Table 2, typed again, with the V row that makes C constant: (left, right) of
#: D V K C and u v a lambda, as functions of β, γ, h.
TABLE_2 = {
    "u-v-a-lambda": (_D | {"V": _of_relation},
                     {"v": _of_velocity, "a": _of_acceleration} | _LAMBDA),
    "u-v-lambda": (_D, {"v": _of_velocity} | _LAMBDA),
    "u-lambda": (_D, _LAMBDA),
    "v-lambda": ({"D": lambda b, g, h: g * h**2}, {"v": lambda b, g, h: 1 / (g * h)} | _LAMBDA),
    "a-lambda": (_D, {"a": _of_acceleration} | _LAMBDA),
    "u-a-lambda": (_D, {"a": _of_acceleration} | _LAMBDA),
    "v-a-lambda": (_D | {"V": _of_relation},
                   {"v": _of_velocity, "a": _of_acceleration} | _LAMBDA),
}  # fmt: skip

#: Form → rows, and weights of u, v, a in the kept unknowns (Section 1's table).
FORMS = {
    "u-v-a-lambda": ("DVKC", "uva", lambda b, g, h: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "u-v-lambda": ("DKC", "uv", lambda b, g, h: [[1, 0], [0, 1], [0, 1 / (g * h)]]),
    "u-lambda": ("DC", "u", lambda b, g, h: [[1], [g / (b * h)], [1 / (b * h**2)]]),
    "v-lambda": ("DC", "v", lambda b, g, h: [[b * h / g], [1], [1 / (g * h)]]),
    "a-lambda": ("DC", "a", lambda b, g, h: [[b * h**2], [g * h], [1]]),
    "u-a-lambda": ("DKC", "ua", lambda b, g, h: [[1, 0], [0, g * h], [0, 1]]),
    "v-a-lambda": ("DVC", "va", lambda b, g, h: [[0, b * h**2], [1, 0], [0, 1]]),
}


def scale(form, variant, jacobian, row_names, column_names, h, beta=BETA, gamma=GAMMA):
    """D_L J D_R for a variant."""
    beta, gamma, h = map(mpf, (beta, gamma, h))
    left, right = TABLE_2[form]
    one = lambda b, g, h: mpf(1)  # noqa: E731
    left = left if variant in ("left", "optimal") else {}
    right = right if variant in ("right", "optimal") else {}
    scaled = matrix(jacobian.rows, jacobian.cols)
    for i, row in enumerate(row_names):
        for j, column in enumerate(column_names):
            factor = left.get(row, one)(beta, gamma, h) * right.get(column, one)(beta, gamma, h)
            scaled[i, j] = factor * jacobian[i, j]
    return scaled


def condition_number(scaled):
    """2-norm condition number from singular values at 60 digits."""
    values = mp.svd_r(scaled, compute_uv=False)
    return values[0] / values[len(values) - 1]


def index_1(subject, t, u, v):
    """a and λ that u and v imply: the bordered matrix written out, in a unit of mass."""
    terms = subject.evaluate(t, u, v, np.zeros(subject.m))
    _, curvature = subject.constraint_derivatives(t, u, v)
    unit = np.abs(subject.M).max()
    bordered = np.block([[subject.M / unit, -terms.G], [terms.G.T, np.zeros((subject.m,) * 2)]])
    rhs = np.concatenate([terms.force / unit, -curvature])
    found = np.linalg.solve(bordered, rhs)
    found += np.linalg.solve(bordered, rhs - bordered @ found)
    return found[: subject.n], unit * found[subject.n :]


def constraint_rows(phi, t, u, v, w):
    """Φ_t, the curvature, ∂Φ'/∂u and ∂Φ''/∂u, by central differences of Φ at 60 digits.

    Args:
        phi: u, t → Φ as a list, in mpmath.
        t, u, v, w: The state, and the acceleration in Φ''.
    """
    with mp.workdps(DIGITS):
        step, t = mpf(10) ** -12, mpf(float(t))
        u, v, w = ([mpf(float(x)) for x in array] for array in (u, v, w))
        m = len(phi(u, t))

        def moved(s, direction, aside=0, j=0, later=0):
            place = [x + s * step * d for x, d in zip(u, direction, strict=True)]
            place[j] += aside * step
            return phi(place, t + later * step)

        def combined(terms, divisor):
            return [sum(weight * row[k] for weight, row in terms) / divisor for k in range(m)]

        rate = combined([(s, moved(0, v, later=s)) for s in (-1, 1)], 2 * step)
        bent = [(weight, moved(s, v, later=s)) for s, weight in ((-1, 1), (0, -2), (1, 1))]
        first, second = [], []
        for j in range(len(u)):
            mixed = [
                [(s * a, moved(s, d, a, j, s * timed)) for s in (-1, 1) for a in (-1, 1)]
                for d, timed in ((v, 1), (w, 0))
            ]
            turned = [
                (a * weight, moved(s, v, a, j, s))
                for a in (-1, 1)
                for s, weight in ((-1, 1), (0, -2), (1, 1))
            ]
            first.append(combined(mixed[0], 4 * step**2))
            straight = combined(mixed[1], 4 * step**2)
            curved = combined(turned, 2 * step**3)
            second.append([a + b for a, b in zip(straight, curved, strict=True)])
        found = rate, combined(bent, step**2), first, second
        return [np.array(part, float).T for part in found]


#: A pendulum that begins to swing downwards, with 1 m/s.
THROWN = {
    "points": {"O": {"fixed": (0, 0)}, "P": {"at": (1, 0), "velocity": (0, -1), "mass": 1}},
    "bars": {"rod": {"from": "O", "to": "P", "length": 1}},
    "gravity": (0, -9.81),
}


@cache
def _swing(rate, gravity):
    return solve_ivp(
        lambda t, y: [y[1], -gravity * np.cos(y[0])], (0, 2.5), [0, rate], method="DOP853",
        rtol=1e-13, atol=1e-14, dense_output=True, max_step=0.01,
    ).sol  # fmt: skip


def swing(t, rate=0.0, gravity=1.0):
    """Angle from the horizontal, and its rate, of a rod of length 1 at times up to 2.5 s."""
    return _swing(rate, gravity)(t)
