"""A script of a user, which `mypy --strict` accepts against the installed package."""

import numpy as np
from numpy.typing import NDArray

import newmark_cli as newmark


def watch(step: newmark.Step) -> None:
    print(step.t, step.norms["u"])


found: newmark.Trajectory = newmark.march("pendulum", h=1e-2, t_end=1.0, callback=watch)
values: NDArray[np.float64] = found.constraint("bars.rod")
frame = found.to_frame()
for step in newmark.march("pendulum", h=1e-2, steps=True, every=3):
    if step.u[1] < -0.5:
        break
later = newmark.march("pendulum", h=1e-2, steps=10, state=step)
factors: newmark.Factors = newmark.scaling("v-lambda", beta=0.3025, gamma=0.6, h=1e-3)
number: float = factors.right["lambda"]
definition = newmark.Definition(
    mass_matrix=np.eye(1),
    u0=np.zeros(1),
    v0=np.zeros(1),
    force=lambda u, v, t: u,
    constraints=lambda u, t: u,
    gradient=lambda u, t: np.eye(1),
)
subject: newmark.Problem = newmark.problem(definition)
try:
    newmark.problem("nothing")
except newmark.NewmarkError as error:
    print(error)

rows = newmark.run(
    {
        "study": "swing",
        "problem": "pendulum",
        "form": "u-lambda",
        "preconditioning": ["none", "optimal"],
        "h": [1e-2, 1e-3, 1e-4],
        "t_end": 0.1,
        "measure": ["condition", "trajectory"],
    }
)
print(newmark.slopes(rows)["verdict"].tolist(), newmark.trajectories(rows, "swing").shape)
newmark.plot(rows, measure="condition").savefig("condition.png")
