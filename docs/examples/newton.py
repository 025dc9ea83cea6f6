"""A Newton loop of one's own in the optimal scaling, on the first step of a falling pendulum.

python docs/examples/newton.py
"""

import numpy as np


def newton(residual, jacobian, q, n, m, h, tolerance, beta=0.25):
    """Unknowns q = (u, λ) of one step, solved in the optimal scaling."""
    left = np.repeat([beta * h**2, 1], [n, m])  # rows D, C
    right = np.repeat([1, 1 / (beta * h**2)], [n, m])  # unknowns u, λ
    for _ in range(20):
        scaled = np.linalg.solve(left[:, None] * jacobian(q) * right, -left * residual(q))
        q = q + right * scaled
        if np.linalg.norm(scaled) <= tolerance:  # of the scaled unknowns: "all" of advise, times 3
            return q
    raise ArithmeticError("Newton's iteration did not converge")


# A pendulum of length 1 falls from the horizontal; the trapezoidal rule.
h, weight = 1e-5, np.array([0.0, -1.0])
u, v, a = np.array([1.0, 0.0]), np.zeros(2), np.array([0.0, -1.0])
past = u + h * v + h**2 / 4 * a  # u = past + h²/4 v' at the end of the step


def residual(q):
    """Rows D and C."""
    u, multiplier = q[:2], q[2]
    return np.append((u - past) / (h**2 / 4) - weight - multiplier * u, (u @ u - 1) / 2)


def jacobian(q):
    """Of rows D and C, by u and λ."""
    u, multiplier = q[:2], q[2]
    D = np.eye(2) * (4 / h**2 - multiplier)
    return np.block([[D, -u[:, None]], [u, 0]])


q = newton(residual, jacobian, np.append(u + h * v, 0.0), n=2, m=1, h=h, tolerance=1e-15)
print("u", q[:2], "lambda", q[2])
