"""MuJoCo with fixed steps: soft constraints, a rod that is a tendon, a top on a `connect`.

The time constant of a constraint, `solref`, is 0.02 s by default; the documentation asks that it
be at least 2h, which is the hardest that it allows, and is the cure here.  With impedances
`solimp` close to 1 constraints are harder still.
"""

from functools import partial

import mujoco
import numpy as np
from common import STEPS, Result, Run, main

SERIES = {  # label → integrator, solref of a step size, solimp
    "MuJoCo, Euler, default": ("Euler", lambda h: 0.02, "0.9 0.95 0.001"),
    "MuJoCo, Euler, solref 2h": ("Euler", lambda h: 2 * h, "0.9 0.95 0.001"),
    "MuJoCo, Euler, solref 2h, solimp 0.9999": ("Euler", lambda h: 2 * h, "0.9999 0.9999 0.001"),
    "MuJoCo, RK4, solref 2h, solimp 0.9999": ("RK4", lambda h: 2 * h, "0.9999 0.9999 0.001"),
}
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


def march(text, problem, t_end, h, integrator, solref, solimp):
    settings = {"integrator": integrator, "solref": solref(h), "solimp": solimp}
    model = mujoco.MjModel.from_xml_string(text.format(h=h, **settings))
    data = mujoco.MjData(model)
    data.qvel[:] = [0, -1] if problem.n == 2 else [0, 0, 0, 0, 150, -4.61538]
    steps = round(t_end / h)
    mujoco.mj_step(model, data, steps)
    mujoco.mj_forward(model, data)  # λ of the state that the last step has reached
    if problem.n == 2:
        u, v, multipliers = data.qpos + problem.u0, data.qvel, data.efc_force
    else:
        axes = data.xmat[1].reshape(3, 3)
        v = [data.qvel[:3], *np.cross(axes @ data.qvel[3:], axes.T)]
        u, v = np.ravel([data.qpos[:3], *axes.T]), np.ravel(v)
        multipliers = np.append(np.full(6, np.nan), data.efc_force)
    warned = [mujoco.mju_warningText(k, 0) for k, w in enumerate(data.warning) if w.number]
    return Result(u, v, multipliers, calls=steps, message=". ".join(warned))


def runs(name, problem, t_end):
    text = {"thrown-pendulum": PENDULUM, "heavy-top": TOP}.get(name)
    for label, how in SERIES.items() if text else ():
        for h in STEPS[name][:5]:
            yield Run(label, "h", h, partial(march, text, problem, t_end, h, *how))


if __name__ == "__main__":
    main(runs)
