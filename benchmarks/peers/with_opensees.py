"""OpenSees by OpenSeesPy: the rod is a corotational truss, a stiff spring in place of a constraint.

The start of a Transient analysis has no acceleration unless it is set: the cure is a consistent
start, with the acceleration and the stretch of the rod that belong to u and v, and HHT in place of
Newmark.
"""

import ctypes
from importlib import util
from pathlib import Path

from rows import last_row

#: The wheel's own libraries, which its loader does not look for, each after those that it needs.
LIBRARIES = ("quadmath.so.0", "gfortran.so.4", "gomp.so.1", "blas.so.3", "lapack.so.3")


def loaded():
    """The module of OpenSees."""
    if wheel := util.find_spec("openseespylinux"):
        for name in LIBRARIES:
            ctypes.CDLL(str(Path(wheel.origin).parent / f"lib/lib{name}"), ctypes.RTLD_GLOBAL)
    import openseespy.opensees as ops

    return ops


def solve(problem, h, t_end, u0, v0, stiffness, damped=False, consistent=True):
    """The row at `t_end`: HHT 0.9 if damped, else Newmark; stiffness is EA of the truss (N)."""
    ops = loaded()
    ops.wipe()
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
    ops.integrator(*(("HHT", 0.9) if damped else ("Newmark", 0.5, 0.25)))
    ops.analysis("Transient")
    if failed := ops.analyze(round(t_end / h), h):
        raise RuntimeError(f"analyze returned {failed} at t = {ops.getTime():.3g}")
    u, v = [1 + ops.nodeDisp(2, 1), ops.nodeDisp(2, 2)], ops.nodeVel(2)
    # λ of ½ (|Δ|² − L²) is a force per length, negative in tension.
    return last_row(problem, t_end, u, v, [-ops.basicForce(1)[0]])
