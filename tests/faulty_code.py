"""A textbook generalized-α code for index 3, with faults to switch on; no part of the package."""

import numpy as np
import pandas as pd

#: Fault → name of the finding that must say so.
FAULTS = {
    "a(0) is not computed": "a(0)",
    "γ of another method": "averaging",
    "γ without its β": "unstable",
    "λ of |Δ|² − L²": "factor of λ",
    "tangent without ∂(Gλ)/∂u": "linear convergence",
    "tolerance on h² λ": "Newton ends early",
    "tolerance on λ": "tolerance out of reach",
    "constraints at the level of velocities": "drift",
    "constraints at the level of accelerations": "drift",
    "single precision": "single precision",
    "start off Gᵀv = 0": "start",
    "h summed up in single precision": "clock",
    "mass of one point": "another mechanism",
}


class System:
    """Terms of a problem as a code of one's own would have them."""

    def __init__(self, problem, fault):
        self.problem, self.M = problem, np.array(problem.M)
        if fault == "mass of one point":
            share = np.ones(problem.n)
            share[-max(2, problem.n // 3) :] = 1.1
            self.M *= np.sqrt(np.outer(share, share))

    def at(self, t, u, v, lam):
        """f + G λ, its derivatives X and Y with a minus, Φ and G."""
        return self.problem.evaluate(t, *(np.asarray(x, float) for x in (u, v, lam)))

    def rates(self, t, u, v):
        """Φ_t and κ."""
        return self.problem.constraint_derivatives(t, np.asarray(u, float), np.asarray(v, float))


def rows(problem, h, t_end, fault="", tolerance=1e-10):
    """t, u, v, λ, iterations and corrections: the start, two steps, and the last three."""
    dtype = np.float32 if fault == "single precision" else float
    system, m = System(problem, fault), problem.m
    rho = 0.9
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 - am + af
    beta = 0.25 * (0.5 + gamma) ** 2
    if fault == "γ of another method":
        gamma += 0.05
        beta = 0.25 * (0.5 + gamma) ** 2
    elif fault == "γ without its β":
        gamma += 0.1
    u, v, none = problem.u0.astype(dtype), problem.v0.astype(dtype), np.zeros(m)
    G = system.at(0, u, v, none).G
    if fault == "start off Gᵀv = 0":
        v = v + 0.02 * max(1.0, np.abs(v).max()) * G[:, 0] / np.linalg.norm(G[:, 0])
    first = np.block([[system.M, -G], [G.T, np.zeros((m, m))]])
    right = np.concatenate([system.at(0, u, v, none).force, -system.rates(0, u, v)[1]])
    vd, lam = np.split(np.linalg.solve(first, right).astype(dtype), [problem.n])
    if fault == "a(0) is not computed":
        vd = 0 * vd
    a, t, steps = vd.copy(), dtype(0), round(t_end / h)
    yield 0.0, u, v, lam, 0, []
    for k in range(1, steps + 1):
        now, step = k * h, h
        if fault == "h summed up in single precision":
            now = np.float32(t) + np.float32(h)
            step = float(now) - float(t)
        bh, gh = (x * (1 - af) / (1 - am) for x in (beta * step**2, gamma * step))
        part = (af * vd - am * a) / (1 - am)
        up = u + step * v + step**2 * ((0.5 - beta) * a + beta * part)
        vp = v + step * ((1 - gamma) * a + gamma * part)
        x, last, corrections = 0 * vd, np.inf, []
        while len(corrections) < 30:
            un, vn = (up + bh * x).astype(dtype), (vp + gh * x).astype(dtype)
            terms = system.at(now, un, vn, lam)
            stiffness = terms.X
            if fault == "tangent without ∂(Gλ)/∂u":
                stiffness = system.at(now, un, vn, none).X
            c, row, scale = terms.phi, terms.G.T * bh, 1 / bh
            if fault == "constraints at the level of velocities":
                c, row = terms.G.T @ vn + system.rates(now, un, vn)[0], terms.G.T * gh
                scale = 1 / gh
            elif fault == "constraints at the level of accelerations":
                c, row, scale = terms.G.T @ x + system.rates(now, un, vn)[1], terms.G.T, 1.0
            J = np.block([
                [system.M + gh * terms.Y + bh * stiffness, -terms.G],
                [scale * row, np.zeros((m, m))],
            ])  # fmt: skip
            residual = np.concatenate([system.M @ x - terms.force, scale * c])
            change = np.linalg.solve(J.astype(dtype), -residual.astype(dtype))
            x, lam = x + change[:-m], lam + change[-m:]
            size = bh * np.linalg.norm(change[:-m])
            corrections.append(float(size))
            of_lam = np.linalg.norm(change[-m:])
            if fault == "tolerance on h² λ":
                done = bh * of_lam < 1e-6
            elif fault == "tolerance on λ":
                done = of_lam < tolerance * np.linalg.norm(lam)
            else:
                done = size < 20 * np.finfo(dtype).eps * np.linalg.norm(u) or size >= last
            if done:
                break
            last = size
        a, vd = (part + (1 - af) / (1 - am) * x).astype(dtype), x.astype(dtype)
        u, v, t = (up + bh * x).astype(dtype), (vp + gh * x).astype(dtype), now
        if k <= 2 or k >= steps - 2:
            yield float(t), u, v, lam, len(corrections), corrections


def table(problem, sizes, t_end, fault="", corrections=False, tolerance=1e-10):
    """What the code writes, for each step size."""
    found = []
    for h in sizes:
        with np.errstate(all="ignore"):
            try:
                kept = list(rows(problem, h, t_end, fault, tolerance))
            except np.linalg.LinAlgError as error:
                found.append({"h": h, "t": t_end, "message": str(error)})
                continue
        for t, u, v, lam, iterations, sizes_of in kept:
            if fault == "λ of |Δ|² − L²":
                lam = lam / 2
            found.append({"h": h, "t": t, "iterations": iterations or np.nan})
            for part, names, values in (
                ("u", problem.coordinate_names, u),
                ("v", problem.coordinate_names, v),
                ("lambda", problem.constraint_names, lam),
            ):
                found[-1] |= {f"{part}[{n}]": float(x) for n, x in zip(names, values, strict=True)}
            if corrections:
                found[-1] |= {f"correction[{i}]": x for i, x in enumerate(sizes_of, start=1)}
    return pd.DataFrame(found)
