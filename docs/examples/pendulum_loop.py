"""A textbook generalized-α method for a pendulum of length 1, whose runs `judge` reads.

python docs/examples/pendulum_loop.py

writes mine.csv, a table of runs at five step sizes.
"""

import numpy as np


def rows_of(h, t_end=1.0, rho=0.9):
    """First and last states of a run: t, u, v, λ and the iterations of the step."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 - am + af
    beta = 0.25 * (0.5 + gamma) ** 2
    u, v, f = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([0.0, -1.0])
    lam = -(u @ f + v @ v)  # G = u: M a = f + u lam, u a + v v = 0
    vd = f + u * lam  # the accelerations, at the start
    a = vd.copy()
    steps = round(t_end / h)
    yield 0.0, u, v, lam, 0
    for k in range(1, steps + 1):
        part = (af * vd - am * a) / (1 - am)  # a at the end is part + (1 - af) / (1 - am) x
        up = u + h * v + h * h * ((0.5 - beta) * a + beta * part)
        vp = v + h * ((1 - gamma) * a + gamma * part)
        bh, gh = (factor * (1 - af) / (1 - am) for factor in (beta * h * h, gamma * h))
        x = np.zeros(2)  # unknowns: the acceleration, and lam
        for iterations in range(1, 30):  # noqa: B007 (yielded below)
            u = up + bh * x
            scaled = np.array([1, 1, 1 / bh])  # the row of the constraint, over its factor
            residual = np.array([*(x - f - u * lam), 0.5 * (u @ u - 1)])
            jacobian = np.block([[(1 - bh * lam) * np.eye(2), -u[:, None]], [bh * u[None, :], 0]])
            step = np.linalg.solve(scaled[:, None] * jacobian, -scaled * residual)
            x, lam = x + step[:2], lam + step[2]
            if bh * np.linalg.norm(step[:2]) < 1e-15:
                break
        a, vd = part + (1 - af) / (1 - am) * x, x
        u, v = up + bh * x, vp + gh * x
        if k <= 2 or k >= steps - 2:
            yield k * h, u, v, lam, iterations


with open("mine.csv", "w") as table:
    table.write("h,t,u[P.x],u[P.y],v[P.x],v[P.y],lambda[bars.rod],iterations\n")
    for h in (0.01, 0.005, 0.002, 0.001, 0.0005):
        for t, u, v, lam, iterations in rows_of(h):
            numbers = ",".join(f"{x:.17g}" for x in (h, t, *u, *v, lam))
            table.write(f"{numbers},{iterations}\n")
