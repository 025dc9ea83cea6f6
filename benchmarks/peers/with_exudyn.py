"""Exudyn with fixed steps: points as nodes, M and forces of the problem, Exudyn's own distances."""

from functools import partial

import exudyn
import exudyn.itemInterface as items
import numpy as np
from exudyn_steps import marched
from rows import last_row

HEIGHT = partial(items.MarkerNodeCoordinate, coordinate=1)


def solve(problem, h, t_end, u0, v0, **settings):
    """The row at `t_end` of a mechanism of points in the plane; settings are those of `marched`."""
    given, system, nodes, lengths = problem.drawing, exudyn.SystemContainer().AddSystem(), {}, []
    starts = np.stack([u0, v0]).reshape(2, -1, 2)
    for name, point in given.points.items():
        node = items.NodePointGround(referenceCoordinates=[*(point.fixed or (0, 0)), 0])
        if name in problem.points:
            u, v = starts[:, problem.points.index(name)]
            node = items.NodePoint2D(referenceCoordinates=u, initialVelocities=v)
        nodes[name] = system.AddNode(node)

    def force(mbs=None, t=0, number=0, q=0, v=0):
        return problem.values(0.0, u0 + q, v0, np.zeros(problem.m)).force

    moving = [nodes[name] for name in problem.points]
    forces = {"forceUserFunction": force} if given.springs else {"forceVector": force()}
    system.AddObject(items.ObjectGenericODE2(nodeNumbers=moving, massMatrix=problem.M, **forces))
    for kind, name in (each.split(".") for each in problem.constraint_names):
        part = getattr(given, kind)[name]
        lengths.append(getattr(part, "length", 1))
        mark, joint = items.MarkerNodePosition, items.DistanceConstraint(distance=lengths[-1])
        if kind == "sliders":  # on the x axis through O
            mark, joint = HEIGHT, items.CoordinateConstraint()
        ends = ("O", part.point) if kind == "sliders" else (part.from_, part.to)
        joint.markerNumbers = [system.AddMarker(mark(nodeNumber=nodes[end])) for end in ends]
        system.AddObject(joint)
    system.Assemble()
    iterations = marched(system, t_end, h, **settings)
    at = system.systemData
    u, v = u0 + at.GetODE2Coordinates(), at.GetODE2Coordinates_t()
    # λ of |Δ| − L is a force, ours a force per |Δ|, which drifts where Φ is not held.
    apart = np.sqrt(np.square(lengths) + 2 * problem.constraint_values(t_end, u))
    return last_row(problem, t_end, u, v, -at.GetAECoordinates() / apart, iterations=iterations)
