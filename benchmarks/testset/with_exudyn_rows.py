"""Exudyn with fixed steps, given M, f, Φ and its gradient: any mechanism, one object and one row.

Exudyn's own joints are in benchmarks/peers/with_exudyn.py; here its integrators and its Newton
solve the equations that the other codes are given, too.
"""

import sys
from pathlib import Path

import exudyn
import exudyn.itemInterface as items
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "peers"))
from exudyn_steps import marched
from rows import last_row


def solve(problem, h, t_end, u0, v0, **settings):
    """The row at `t_end`; settings are those of `exudyn_steps.marched`."""
    n, m, t0 = problem.n, problem.m, problem.t0
    system, none = exudyn.SystemContainer().AddSystem(), np.zeros(m)

    def force(mbs, t, number, q, v):
        return problem.values(t0 + t, u0 + q, np.array(v), none).force

    def gradient(t, q):
        return problem.evaluate(t0 + t, u0 + q, v0, none).G.T

    def misfit(mbs, t, number, q, v, of_rates):
        if of_rates:
            rate, _ = problem.constraint_derivatives(t0 + t, u0 + q, np.array(v))
            return gradient(t, q) @ v + rate
        return problem.constraint_values(t0 + t, u0 + q)

    def jacobian(mbs, t, number, q, v, of_rates):
        return gradient(t, q)

    node = items.NodeGenericODE2(
        numberOfODE2Coordinates=n, referenceCoordinates=u0 * 0, initialCoordinates=u0 * 0,
        initialCoordinates_t=v0,
    )  # fmt: skip
    nodes = [system.AddNode(items.NodePointGround()), system.AddNode(node)]
    system.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=nodes[1:], massMatrix=problem.M, forceUserFunction=force
        )
    )
    marks = [system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node)) for node in nodes]
    joint = items.ObjectConnectorCoordinateVector(
        markerNumbers=marks, scalingMarker0=np.zeros((m, 1)), offset=none,
        constraintUserFunction=misfit, jacobianUserFunction=jacobian,
    )  # fmt: skip
    system.AddObject(joint)
    system.Assemble()
    iterations = marched(system, t_end, h, **settings)
    at = system.systemData
    u, v = u0 + at.GetODE2Coordinates(), at.GetODE2Coordinates_t()
    return last_row(problem, t_end, u, v, -at.GetAECoordinates(), iterations=iterations)
