"""Exudyn's own rigid body with Euler parameters on its own spherical joint: the heavy top."""

from functools import partial

import exudyn
import numpy as np
from common import STEPS, Result, Run, main
from exudyn.utilities import RigidBodyInertia
from exudyn_steps import SERIES, integrated

SHOWN = exudyn.OutputVariableType


def march(t_end, h, *how):
    system = exudyn.SystemContainer().AddSystem()
    ground = system.CreateGround()
    body = system.CreateRigidBody(
        referencePosition=[0, 1, 0],
        inertia=RigidBodyInertia(15, np.diag([0.234375, 0.46875, 0.234375])),
        initialVelocity=[4.61538, 0, 0],  # ω × (0, 1, 0)
        initialAngularVelocity=[0, 150, -4.61538],
        gravity=[0, 0, -9.81],
        nodeType=exudyn.NodeType.RotationEulerParameters,
    )
    joint = system.CreateSphericalJoint(itemNumbers=[ground, body], position=[0, 0, 0])
    joint = joint[0] if isinstance(joint, (list, tuple)) else joint
    system.Assemble()
    counted, message = integrated(system, t_end, h, *how)

    def output(kind, at=(0, -1, 0)):
        return np.array(system.GetObjectOutputBody(body, kind, localPosition=list(at)))

    axes = output(SHOWN.RotationMatrix).reshape(3, 3).T
    rates = np.cross(output(SHOWN.AngularVelocity), axes)
    u = np.concatenate([output(SHOWN.Position), *axes])
    v = np.concatenate([output(SHOWN.Velocity), *rates])
    force = -system.GetObjectOutput(joint, SHOWN.Force)  # on the top
    return Result(u, v, np.append(np.full(6, np.nan), force), *counted, message)


def runs(name, problem, t_end):
    for label, how in SERIES.items() if name == "heavy-top" else ():
        for h in STEPS[name]:
            yield Run(label, "h", h, partial(march, t_end, h, *how))


if __name__ == "__main__":
    main(runs)
