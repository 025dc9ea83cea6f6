"""Exudyn's own rigid body with Euler parameters on its own spherical joint: the heavy top."""

import exudyn
import numpy as np
from exudyn.utilities import RigidBodyInertia
from exudyn_steps import marched
from rows import last_row

SHOWN = exudyn.OutputVariableType


def solve(problem, h, t_end, u0, v0, **settings):
    """The row at `t_end`; the start is that of the problem, as Euler parameters have others."""
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
    iterations = marched(system, t_end, h, **settings)

    def output(kind, at=(0, -1, 0)):
        return np.array(system.GetObjectOutputBody(body, kind, localPosition=list(at)))

    axes = output(SHOWN.RotationMatrix).reshape(3, 3).T
    rates = np.cross(output(SHOWN.AngularVelocity), axes)
    u = [output(SHOWN.Position), *axes]
    v = [output(SHOWN.Velocity), *rates]
    force = -system.GetObjectOutput(joint, SHOWN.Force)  # on the top
    return last_row(problem, t_end, u, v, force, iterations=iterations)
