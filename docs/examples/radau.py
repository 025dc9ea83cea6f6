"""Radau of solve_dae on Andrews' mechanism, in GGL with integrals of the multipliers.

python docs/examples/radau.py

scipy_dae takes the same lines.
"""

from solve_dae.integrate import solve_dae  # or from scipy_dae.integrate
from tolerances import tolerances

import newmark_cli as newmark

dae = newmark.dae("andrews", "ggl", integrals=True)
rtol, atol = tolerances("andrews", accuracy=1e-6, t_end=0.03)

span, options = (dae.t0, 0.03), {"jac": dae.jacobian, "rtol": rtol, "atol": atol}
found = solve_dae(dae.residual, span, dae.y0, dae.yp0, method="Radau", **options)
u, v, multipliers = dae.state(found.y[:, -1], found.yp[:, -1])
print(u, v, multipliers)
