"""IDA of scikit-sundae on Andrews' mechanism, in GGL with integrals of the multipliers.

python docs/examples/ida.py
"""

from sksundae.ida import IDA
from tolerances import tolerances

import newmark_cli as newmark

dae = newmark.dae("andrews", "ggl", integrals=True)
rtol, atol = tolerances("andrews", accuracy=1e-6, t_end=0.03)


def residual(t, y, yp, res):
    """F(t, y, y')."""
    res[:] = dae.residual(t, y, yp)


def jacobian(t, y, yp, res, cj, JJ):
    """∂F/∂y + c_j ∂F/∂y'."""
    of_y, of_yp = dae.jacobian(t, y, yp)
    JJ[:] = of_y + cj * of_yp


solver = IDA(residual, jacfn=jacobian, rtol=rtol, atol=atol, max_num_steps=100_000)
found = solver.solve([dae.t0, 0.03], dae.y0, dae.yp0)
u, v, multipliers = dae.state(found.y[-1], found.yp[-1])
print(u, v, multipliers)
