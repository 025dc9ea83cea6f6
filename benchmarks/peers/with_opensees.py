"""OpenSees by OpenSeesPy: the rod is a corotational truss, a stiff spring in place of a constraint.

Needs the libraries of its own folder on LD_LIBRARY_PATH, which `run.py` puts there.  The start of
a Transient analysis has no acceleration unless it is set: the cure is a consistent start, with
the acceleration and the stretch of the rod that belong to u and v, and HHT in place of Newmark.
"""

from functools import partial

import openseespy.opensees as ops
from common import STEPS, Result, Run, main

NEWMARK, HHT = ("Newmark", 0.5, 0.25), ("HHT", 0.9)
SERIES = {  # label → integrator, stiffness EA (N), whether accelerations are set
    "OpenSees, truss 1e6 N, Newmark": (NEWMARK, 1e6, False),
    "OpenSees, truss 1e6 N, Newmark, consistent start": (NEWMARK, 1e6, True),
    "OpenSees, truss 1e9 N, HHT 0.9, consistent start": (HHT, 1e9, True),
    "OpenSees, truss 1e12 N, HHT 0.9, consistent start": (HHT, 1e12, True),
}


def march(t_end, h, integrator, stiffness, consistent):
    ops.model("basic", "-ndm", 2, "-ndf", 2)
    ops.node(1, 0.0, 0.0)
    ops.fix(1, 1, 1)
    ops.node(2, 1.0, 0.0)
    ops.mass(2, 1.0, 1.0)
    ops.setNodeVel(2, 2, -1.0, "-commit")
    if consistent:  # v²/L towards O, and the weight
        ops.setNodeDisp(2, 1, 1 / stiffness, "-commit")
        ops.setNodeAccel(2, 1, -1.0, "-commit")
        ops.setNodeAccel(2, 2, -9.81, "-commit")
    ops.uniaxialMaterial("Elastic", 1, stiffness)
    ops.element("corotTruss", 1, 1, 2, 1.0, 1)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(2, 0.0, -9.81)
    ops.system("FullGeneral")
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.test("NormDispIncr", 1e-12, 25, 0)
    ops.algorithm("Newton")
    ops.integrator(*integrator)
    ops.analysis("Transient")
    steps = round(t_end / h)
    if failed := ops.analyze(steps, h):
        return Result(message=f"analyze returned {failed} at t = {ops.getTime():.3g}")
    u, v = [1 + ops.nodeDisp(2, 1), ops.nodeDisp(2, 2)], ops.nodeVel(2)
    # λ of ½ (|Δ|² − L²) is a force per length, negative in tension.
    return Result(u, v, [-ops.basicForce(1)[0]], calls=steps)


def runs(name, problem, t_end):
    for label, how in SERIES.items() if name == "thrown-pendulum" else ():
        for h in STEPS[name][:5]:
            yield Run(label, "h", h, partial(march, t_end, h, *how))


if __name__ == "__main__":
    main(runs)
