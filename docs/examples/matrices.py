"""Matrices of a double pendulum with a spring and a damper, for `newmark-study advise`.

Two point masses on two bars swing under gravity; a spring and a damper join the second mass
to the ground.  NumPy is all that this script needs: it stands for somebody's own code.

    python matrices.py FOLDER

writes FOLDER/double.npz and the folder FOLDER/double of Matrix Market files, both with M, X,
Y, G and one state, and FOLDER/jacobians.npz with the Jacobians of the (u, λ) form at two step
sizes, of which only the equations are scaled.
"""

import sys
from pathlib import Path

import numpy as np

MASSES, LENGTHS, GRAVITY = (2.0, 0.5), (1.0, 0.7), 9.81
STIFFNESS, DAMPING = 40.0, 0.3
BETA = 0.25


def equations():
    """M, X, Y, G and a state at which Φ = 0, Φ' = 0, Φ'' = 0 and M a = f + G λ.

    M v' = f + G λ and 0 = Φ with Φ₁ = (|p|² − L₁²)/2, Φ₂ = (|q − p|² − L₂²)/2, u = (p, q);
    X = −∂(f + Gλ)/∂u and Y = −∂f/∂v.
    """
    first, second = 0.7, -0.4  # angles from the vertical
    rates = (1.3, -2.1)
    p = LENGTHS[0] * np.array([np.sin(first), -np.cos(first)])
    d = LENGTHS[1] * np.array([np.sin(second), -np.cos(second)])
    p_rate = rates[0] * np.array([-p[1], p[0]])
    d_rate = rates[1] * np.array([-d[1], d[0]])
    u, v = np.concatenate([p, p + d]), np.concatenate([p_rate, p_rate + d_rate])

    mass = np.diag(np.repeat(MASSES, 2))
    gradient = np.zeros((4, 2))
    gradient[:2, 0] = p
    gradient[:2, 1], gradient[2:, 1] = -d, d
    force = -GRAVITY * mass @ np.array([0.0, 1.0, 0.0, 1.0])
    force[2:] -= STIFFNESS * u[2:] + DAMPING * v[2:]
    curvature = np.array([p_rate @ p_rate, d_rate @ d_rate])  # Φ'' = Gᵀ a + curvature
    saddle = np.block([[mass, -gradient], [gradient.T, np.zeros((2, 2))]])
    solution = np.linalg.solve(saddle, np.concatenate([force, -curvature]))
    a, multipliers = solution[:4], solution[4:]

    # ∂(Gλ)/∂u of each bar is λ times what couples its two ends.
    identity, zero = np.eye(2), np.zeros((2, 2))
    of_bars = multipliers[0] * np.block([[identity, zero], [zero, zero]])
    of_bars = of_bars + multipliers[1] * np.block([[identity, -identity], [-identity, identity]])
    x, y = -of_bars, np.zeros((4, 4))
    x[2:, 2:] += STIFFNESS * identity
    y[2:, 2:] += DAMPING * identity
    return {
        "M": mass, "X": x, "Y": y, "G": gradient,
        "u": u, "v": v, "a": a, "lambda": multipliers,
    }  # fmt: skip


def left_scaled(found, h, gamma=0.5):
    """J of the (u, λ) form with row D times βh²: what scaling only one side leaves."""
    dynamic = found["X"] + gamma / (BETA * h) * found["Y"] + found["M"] / (BETA * h**2)
    jacobian = np.block([[dynamic, -found["G"]], [found["G"].T, np.zeros((2, 2))]])
    left = np.repeat([BETA * h**2, 1.0], [4, 2])
    return left[:, None] * jacobian


def write_market(path, matrix):
    """Write a dense matrix, or a vector as one column, as Matrix Market text."""
    matrix = matrix.reshape(len(matrix), -1)
    lines = ["%%MatrixMarket matrix array real general", "{} {}".format(*matrix.shape)]
    lines += [repr(float(value)) for value in matrix.T.ravel()]
    path.write_text("\n".join(lines) + "\n")


def main(folder):
    """Write all of it."""
    found = equations()
    (folder / "double").mkdir(parents=True, exist_ok=True)
    np.savez(folder / "double.npz", **found)
    for name, matrix in found.items():
        write_market(folder / "double" / f"{name}.mtx", matrix)
    steps = np.array([1e-3, 1e-4])
    jacobians = np.array([left_scaled(found, h) for h in steps])
    np.savez(folder / "jacobians.npz", J=jacobians, h=steps, blocks="u=4,lambda=2")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
