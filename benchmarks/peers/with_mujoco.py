"""MuJoCo with fixed steps: soft constraints, a rod that is a tendon, a top on a `connect`.

The time constant of a constraint, `solref`, is 0.02 s by default; the documentation asks that it
be at least 2h, which is the hardest that it allows, and is the cure here.  With impedances
`solimp` close to 1 constraints are harder still.
"""

import mujoco
import numpy as np
from rows import last_row

PENDULUM = """<mujoco><option timestep="{h}" gravity="0 -9.81 0" integrator="{integrator}"/>
<worldbody><site name="O"/><body pos="1 0 0"><joint type="slide" axis="1 0 0"/>
<joint type="slide" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<site name="P"/></body></worldbody>
<tendon><spatial name="rod"><site site="O"/><site site="P"/></spatial></tendon>
<equality><tendon tendon1="rod" solref="{solref} 1" solimp="{solimp}"/></equality></mujoco>"""
TOP = """<mujoco><option timestep="{h}" gravity="0 0 -9.81" integrator="{integrator}"/>
<worldbody><body name="top"><freejoint/>
<inertial pos="0 1 0" mass="15" diaginertia="0.234375 0.46875 0.234375"/></body></worldbody>
<equality><connect body1="top" anchor="0 0 0" solref="{solref} 1" solimp="{solimp}"/></equality>
</mujoco>"""


def solve(problem, h, t_end, u0, v0, integrator="Euler", hard=False, impedance=0.0):
    """The row at `t_end`, from the start of the problem.

    Args:
        integrator: Euler or RK4.
        hard: Whether the time constant is 2h.
        impedance: Both ends of `solimp`; 0 for its default.
    """
    planar = problem.n == 2
    settings = {
        "integrator": integrator,
        "solref": 2 * h if hard else 0.02,
        "solimp": f"{impedance} {impedance} 0.001" if impedance else "0.9 0.95 0.001",
    }
    text = (PENDULUM if planar else TOP).format(h=h, **settings)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = [0, -1] if planar else [0, 0, 0, 0, 150, -4.61538]
    mujoco.mj_step(model, data, round(t_end / h))
    mujoco.mj_forward(model, data)  # λ of the state that the last step has reached
    warned = [mujoco.mju_warningText(k, 0) for k, w in enumerate(data.warning) if w.number]
    if warned:
        raise RuntimeError(". ".join(warned))
    if planar:
        return last_row(problem, t_end, data.qpos + problem.u0, data.qvel, data.efc_force)
    axes = data.xmat[1].reshape(3, 3)
    v = [data.qvel[:3], *np.cross(axes @ data.qvel[3:], axes.T)]
    return last_row(problem, t_end, [data.qpos[:3], *axes.T], v, data.efc_force)
