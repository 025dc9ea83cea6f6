"""What processes for user code are forks of: imports, and what each would do first."""

import numpy as np

from newmark_cli.newmark import march, scheme
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.problems import python_problem
from newmark_cli.study import compute

rod = python_problem.from_definition(
    python_problem.Definition(
        mass_matrix=np.eye(2),
        u0=np.array([1.0, 0.0]),
        v0=np.zeros(2),
        force=lambda u, v, t: np.zeros(2),
        constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
        gradient=lambda u, t: u[:, None],
    ),
    "rod",
)
form = FORMS["u-lambda"]
march.March(rod, scheme.Scheme(Newmark(), form, named_scaling("none", form), 0.1)).advance(2)
compute._MEASURED = 1e-9
