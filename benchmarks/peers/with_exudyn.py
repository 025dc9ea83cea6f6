"""Exudyn with fixed steps: points as nodes, M and forces of the problem, Exudyn's own distances.

Newton ends where the residual is below relativeTolerance (1e-8) times that at the start of the
step, or below absoluteTolerance (1e-10).  The cure for λ of index 2 is to ask for more.
"""

from functools import partial

import exudyn
import exudyn.itemInterface as items
import numpy as np
from common import STEPS, Result, Run, main, spec

SERIES = {  # label → useNewmark, useIndex2Constraints, both tolerances of Newton
    "Exudyn, generalized-α 0.9, index 3": (False, False, None),
    "Exudyn, trapezoidal, index 3": (True, False, None),
    "Exudyn, trapezoidal, index 2": (True, True, None),
    "Exudyn, trapezoidal, index 2, tolerance 1e-13": (True, True, 1e-13),
}


def parts(problem):
    return [name.split(".") for name in problem.constraint_names]


def assembled(given, problem):
    system, nodes, none = exudyn.SystemContainer().AddSystem(), {}, np.zeros(problem.m)
    starts = np.stack([problem.u0, problem.v0]).reshape(2, -1, 2)
    for name, u, v in zip(problem.points, *starts, strict=True):
        node = items.NodePoint2D(referenceCoordinates=u, initialVelocities=v)
        nodes[name] = system.AddNode(node)
    body = items.ObjectGenericODE2(nodeNumbers=list(nodes.values()), massMatrix=problem.M)
    body.forceUserFunction = lambda mbs, t, k, q, v: (
        problem.values(t, problem.u0 + q, np.array(v), none).force
    )
    if problem.n == 2:  # the weight alone, without calls of Python
        body.forceVector, body.forceUserFunction = body.forceUserFunction(0, 0, 0, 0, [0, 0]), 0
    system.AddObject(body)
    for name, point in given["points"].items():
        if "fixed" in point:
            ground = items.NodePointGround(referenceCoordinates=[*point["fixed"], 0])
            nodes[name] = system.AddNode(ground)
    for kind, part in parts(problem):
        at = given[kind][part]
        marks = [items.MarkerNodePosition(nodeNumber=nodes[at.get(k, "O")]) for k in ("from", "to")]
        joint = items.DistanceConstraint(distance=at.get("length", 1))
        if kind == "sliders":  # a point on the x axis
            ends = (nodes["O"], nodes[at["point"]])
            marks = [items.MarkerNodeCoordinate(nodeNumber=node, coordinate=1) for node in ends]
            joint = items.CoordinateConstraint()
        joint.markerNumbers = [system.AddMarker(mark) for mark in marks]
        system.AddObject(joint)
    system.Assemble()
    return system


def march(name, problem, t_end, h, trapezoidal, index_2, tolerance):
    given, settings = spec(name), exudyn.SimulationSettings()
    system = assembled(given, problem)
    settings.solution.file.write = False
    time, data = settings.timeIntegration, system.systemData
    time.numberOfSteps, time.endTime, time.verboseMode = round(t_end / h), t_end, 0
    time.newton.useModifiedNewton = False
    time.generalizedAlpha.useNewmark = trapezoidal
    time.generalizedAlpha.useIndex2Constraints = index_2
    if tolerance:
        time.newton.relativeTolerance = time.newton.absoluteTolerance = tolerance
    solver = exudyn.MainSolverImplicitSecondOrder()
    message = "" if solver.SolveSystem(system, settings) else "SolveSystem returned False"
    u, v = problem.u0 + data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
    # λ of a distance |Δ| − L is a force, ours a force per length; signs are opposite.
    lengths = [given[kind][part].get("length", 1) for kind, part in parts(problem)]
    multipliers = -data.GetAECoordinates() / lengths
    counted = (solver.it.newtonStepsCount, time.numberOfSteps)
    return Result(u, v, multipliers, *counted, message)


def runs(name, problem, t_end):
    for label, how in SERIES.items() if name != "heavy-top" else ():
        for h in STEPS[name]:
            yield Run(label, "h", h, partial(march, name, problem, t_end, h, *how))


if __name__ == "__main__":
    main(runs)
