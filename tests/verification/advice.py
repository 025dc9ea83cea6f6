"""What `advise` promises beside marches of 33 mechanisms that are not shipped.

The noise of λ: its rms over the motion that the advice is about, λ less what u and v imply,
over what is predicted, for three integrators that damp.  And the smallest tolerance: at which
share of the steps three times as much, as much and a thirtieth are missed, for two forms and
two integrators.  Prints a line for each mechanism, and the ranges.

    python tests/verification/advice.py [part of a name ...]
"""

import sys
from pathlib import Path

import numpy as np

import newmark_cli as newmark
from newmark_cli.problems.index_1 import Index1

sys.path.insert(0, str(Path(__file__).parents[1]))
from own_mechanisms import several

DAMPING = ("generalized-alpha rho=0.9", "generalized-alpha rho=0.5", "bdf2")
PARTS = (3, 1, 1 / 30)


def time_of(problem) -> float:
    """How long the motion is (s) that advice is about."""
    where = newmark.advise(problem, h=1e-6, integrator=DAMPING[0]).where
    return float(where.partition("t = ")[2].removesuffix(" s"))


def noise_of(problem, t_end: float) -> list[float]:
    """Measured over predicted, for each integrator that damps."""
    large, found, of_state = problem.n > 40, [], Index1(problem)
    steps = 30_000 if large else 100_000
    h = t_end / steps
    for integrator in DAMPING[:1] if large else DAMPING:
        motion = newmark.march(
            problem, h=h, steps=steps, every=steps // 1000, integrator=integrator
        )
        implied = [of_state.accelerations(t, u, v)[1]
                   for t, u, v in zip(motion.t, motion.u, motion.v, strict=True)]  # fmt: skip
        errors = np.linalg.norm(motion.multipliers - implied, axis=1)
        advice = newmark.advise(problem, h=h, integrator=integrator)
        predicted = advice.multipliers * (advice.noise.carried[1.0] / h) ** 2
        # The start has no noise, and its errors of other kinds die out.
        found.append(float(np.sqrt(np.mean(errors[50:] ** 2))) / predicted)
    return found


def missed_by(problem, t_end: float) -> list[list[float]]:
    """Shares of the steps that miss each part of the smallest tolerance, for each scheme."""
    found, h = [], t_end / 5_000
    steps = 500 if problem.n > 40 else 5_000
    for form in ("u-lambda", "a-lambda"):
        for integrator in ("newmark", DAMPING[0]):
            how = {"h": h, "form": form, "integrator": integrator}
            (smallest,) = [
                one.scaled for one in newmark.advise(problem, **how).tolerances
                if (one.unknown, one.precision) == ("all", "float64")
            ]  # fmt: skip
            marches = [newmark.march(problem, steps=steps, every=0, scaling="optimal",
                                     stop={"absolute": part * smallest}, **how)
                       for part in PARTS]  # fmt: skip
            found.append([march.not_converged / steps for march in marches])
    return found


def main(parts) -> int:
    """Print what was found; 1 where advice promises too much."""
    quotients, missed = [], []
    for name, mechanism in several().items():
        if parts and not any(part in name for part in parts):
            continue
        problem = newmark.problem(mechanism)
        t_end = time_of(problem)
        quotients += (noise := noise_of(problem, t_end))
        missed += (shares := missed_by(problem, t_end))
        print(f"{name}: t = {t_end:.2g} s, noise {', '.join(f'{q:.2f}' for q in noise)}; missed "
              + "; ".join(", ".join(f"{share:.2%}" for share in of) for of in shares),
              flush=True)  # fmt: skip
    print(f"noise: {len(quotients)} marches, {min(quotients):.2f} to {max(quotients):.2f}")
    for part, shares in zip(PARTS, zip(*missed, strict=True), strict=True):
        print(f"{part:.3g} times the smallest tolerance: {len(shares)} marches miss it at "
              f"{min(shares):.2%} to {max(shares):.2%} of their steps")  # fmt: skip
    return int(
        not 0.5 < min(quotients) <= max(quotients) < 2.5 or max(of[0] for of in missed) > 1e-3
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
