"""Integrators as their papers write them, marched in mpmath.

Unknowns of a step are u, v, v', a and λ, all at once; nothing is eliminated, and
nothing comes from the package but the parameters' values.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mpmath import matrix, mp, mpf, norm

from newmark_cli.newmark.integrator import BDF1, BDF2, HHT, Alpha, GeneralizedAlpha, Newmark

Vector = list[mpf]


@dataclass(frozen=True)
class System:
    """M v' = F(t, u, v, λ), 0 = Φ(u).

    Attributes:
        mass: M, rows of numbers.
        force: F = f + Gλ.
        phi: Φ.
    """

    mass: list[Vector]
    force: Callable[[mpf, Vector, Vector, Vector], Vector]
    phi: Callable[[Vector], Vector]


@dataclass(frozen=True)
class Motion:
    """One instant: u, v, the true acceleration v', the scheme's a, and λ."""

    t: mpf
    u: Vector
    v: Vector
    rate: Vector
    a: Vector
    multipliers: Vector


def relations(integrator, system: System, h: mpf, before: Motion, old: Motion, new: Motion):
    """What u, v, v', a satisfy beside dynamics and constraints; 3 n residuals."""
    index = range(len(new.u))
    half = mpf(1) / 2
    match integrator:
        case Newmark(beta, gamma):
            alpha_m = alpha_f = 0
        case Alpha(beta, gamma, alpha_m, alpha_f):
            pass
        case GeneralizedAlpha(rho):
            # Chung and Hulbert (1993), eqs. 25, 17, 20
            rho = mpf(rho)
            alpha_m, alpha_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
            beta, gamma = (1 - alpha_m + alpha_f) ** 2 / 4, half - alpha_m + alpha_f
        case HHT(alpha):
            # Hilber, Hughes and Taylor (1977): forces averaged over the step.
            alpha = mpf(alpha)
            beta, gamma = (1 + alpha) ** 2 / 4, half + alpha
            begin = system.force(old.t, old.u, old.v, old.multipliers)
            end = system.force(new.t, new.u, new.v, new.multipliers)
            averaged = [(1 - alpha) * y + alpha * x for x, y in zip(begin, end, strict=True)]
        case BDF1():
            return [
                *(new.u[i] - old.u[i] - h * new.v[i] for i in index),
                *(new.v[i] - old.v[i] - h * new.rate[i] for i in index),
                *(new.a[i] - new.rate[i] for i in index),
            ]
        case BDF2():
            return [
                *(3 * new.u[i] - 4 * old.u[i] + before.u[i] - 2 * h * new.v[i] for i in index),
                *(3 * new.v[i] - 4 * old.v[i] + before.v[i] - 2 * h * new.rate[i] for i in index),
                *(new.a[i] - new.rate[i] for i in index),
            ]
    moved = [
        old.u[i] + h * old.v[i] + h**2 * ((half - beta) * old.a[i] + beta * new.a[i]) for i in index
    ]
    turned = [old.v[i] + h * ((1 - gamma) * old.a[i] + gamma * new.a[i]) for i in index]
    if isinstance(integrator, HHT):
        last = [mp.fdot(system.mass[i], new.a) - averaged[i] for i in index]
    else:
        # Arnold and Brüls (2007), eq. 3
        last = [
            (1 - alpha_m) * new.a[i] + alpha_m * old.a[i]
            - (1 - alpha_f) * new.rate[i] - alpha_f * old.rate[i]
            for i in index
        ]  # fmt: skip
    return [*(new.u[i] - moved[i] for i in index), *(new.v[i] - turned[i] for i in index), *last]


def march(integrator, system: System, start: Motion, h: mpf, steps: int) -> Iterator[Motion]:
    """Steps from a start whose a is its v'; in the working precision of mpmath.

    The step before the first is a Taylor expansion backwards.
    """
    old, n = start, len(start.u)
    before = Motion(
        t=start.t - h,
        u=[u - h * v + h**2 * a / 2 for u, v, a in zip(start.u, start.v, start.a, strict=True)],
        v=[v - h * a for v, a in zip(start.v, start.a, strict=True)],
        rate=start.rate,
        a=start.a,
        multipliers=start.multipliers,
    )

    def unpacked(z, t):
        z = list(z)
        return Motion(t, z[:n], z[n : 2 * n], z[2 * n : 3 * n], z[3 * n : 4 * n], z[4 * n :])

    for step in range(1, steps + 1):
        t = start.t + step * h

        def residual(z, t=t, before=before, old=old):
            new = unpacked(z, t)
            force = system.force(t, new.u, new.v, new.multipliers)
            return matrix([
                *relations(integrator, system, h, before, old, new),
                *(mp.fdot(row, new.rate) - f for row, f in zip(system.mass, force, strict=True)),
                *system.phi(new.u),
            ])  # fmt: skip

        z = matrix([*old.u, *old.v, *old.rate, *old.a, *old.multipliers])
        shift = mpf(10) ** (-mp.dps // 2)
        correction = mpf(1)
        iterations = 0
        while norm(correction) > mpf(10) ** (5 - mp.dps) * norm(z) / h**2:
            here = residual(z)
            if iterations < 3:  # later ones gain digits with these factors too
                jacobian = matrix(len(z), len(z))
                for j in range(len(z)):
                    moved = z.copy()
                    moved[j] += shift
                    jacobian[:, j] = (residual(moved) - here) / shift
                factors, swaps = mp.LU_decomp(jacobian)
            correction = mp.U_solve(factors, mp.L_solve(factors, -here, swaps))
            z += correction
            iterations += 1
        before, old = old, unpacked(z, t)
        yield old
