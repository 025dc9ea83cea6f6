"""Exudyn with fixed steps: points as nodes, M and forces of the problem, Exudyn's own distances."""

from functools import partial

import exudyn
import exudyn.itemInterface as items
import numpy as np
from common import STEPS, Result, Run, main, spec
from exudyn_steps import SERIES, integrated

HEIGHT = partial(items.MarkerNodeCoordinate, coordinate=1)


def assembled(given, problem):
    """The system, and lengths of its bars."""
    system, nodes, lengths = exudyn.SystemContainer().AddSystem(), {}, []
    starts = np.stack([problem.u0, problem.v0]).reshape(2, -1, 2)
    for name, point in given["points"].items():
        node = items.NodePointGround(referenceCoordinates=[*point.get("fixed", (0, 0)), 0])
        if name in problem.points:
            u, v = starts[:, problem.points.index(name)]
            node = items.NodePoint2D(referenceCoordinates=u, initialVelocities=v)
        nodes[name] = system.AddNode(node)

    def force(mbs=None, t=0, number=0, q=0, v=0):
        return problem.values(0.0, problem.u0 + q, problem.v0, np.zeros(problem.m)).force

    moving = [nodes[name] for name in problem.points]
    forces = {"forceUserFunction": force} if "springs" in given else {"forceVector": force()}
    system.AddObject(items.ObjectGenericODE2(nodeNumbers=moving, massMatrix=problem.M, **forces))
    for kind, part in (name.split(".") for name in problem.constraint_names):
        at = given[kind][part]
        lengths.append(at.get("length", 1))
        ends = [at.get("from", "O"), at.get("to", at.get("point"))]
        mark, joint = items.MarkerNodePosition, items.DistanceConstraint(distance=lengths[-1])
        if kind == "sliders":  # on the x axis through O
            mark, joint = HEIGHT, items.CoordinateConstraint()
        joint.markerNumbers = [system.AddMarker(mark(nodeNumber=nodes[end])) for end in ends]
        system.AddObject(joint)
    system.Assemble()
    return system, lengths


def march(given, problem, t_end, h, *how):
    system, lengths = assembled(given, problem)
    counted, message = integrated(system, t_end, h, *how)
    at = system.systemData
    u, v = problem.u0 + at.GetODE2Coordinates(), at.GetODE2Coordinates_t()
    # λ of |Δ| − L is a force, ours a force per |Δ|, which drifts where Φ is not held.
    apart = np.sqrt(np.square(lengths) + 2 * problem.constraint_values(t_end, u))
    return Result(u, v, -at.GetAECoordinates() / apart, *counted, message)


def runs(name, problem, t_end):
    for label, how in SERIES.items() if name != "heavy-top" else ():
        for h in STEPS[name]:
            yield Run(label, "h", h, partial(march, spec(name), problem, t_end, h, *how))


if __name__ == "__main__":
    main(runs)
