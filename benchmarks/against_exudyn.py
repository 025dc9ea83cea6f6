"""Time per Newton iteration on a chain against Exudyn's sparse solver.

Both integrate the falling chain of point masses by the trapezoidal rule, index 3,
h = 1e-4, with a full Newton method: Exudyn (Gerstmayr 2024) with its EigenSparse solver
and constraints of distance between points, the package with static elimination.  Rounds
are interleaved in one process; what is printed is the median of the ratios.

    pip install exudyn
    python benchmarks/against_exudyn.py

Without Exudyn it says so and does nothing.  Exits with 1 when both end in different
places, or when an iteration of the package is less than 3 times as fast.
"""

import argparse
import statistics
import sys
import time
import warnings

import numpy as np

from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.march import March
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme

H = 1e-4
STEPS = 6
LEAST_RATIO = 3.0


def ours(links):
    """A march of the package: seconds per iteration, and where the end of the chain is."""
    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(), form, named_scaling("optimal", form), H)
    march = March(Sized("chain", (("links", links),)).load(), scheme, "static-lu")

    def run():
        begun = time.perf_counter()
        iterations = int(np.abs(march.advance(STEPS).iterations).sum())
        return (time.perf_counter() - begun) / iterations

    March(march.problem, scheme, "static-lu").advance(1)  # compilation
    return run, march


def theirs(exudyn, links):
    """The same in Exudyn."""
    from exudyn.itemInterface import (
        Force,
        MarkerNodePosition,
        MassPoint2D,
        NodePoint2D,
        NodePointGround,
        ObjectConnectorDistance,
    )

    system = exudyn.SystemContainer().AddSystem()
    ground = system.AddNode(NodePointGround(referenceCoordinates=[0, 0, 0]))
    last = system.AddMarker(MarkerNodePosition(nodeNumber=ground))
    for i in range(1, links + 1):
        node = system.AddNode(NodePoint2D(referenceCoordinates=[0.8 * i, -0.6 * i]))
        system.AddObject(MassPoint2D(physicsMass=1, nodeNumber=node))
        marker = system.AddMarker(MarkerNodePosition(nodeNumber=node))
        system.AddLoad(Force(markerNumber=marker, loadVector=[0, -1, 0]))
        system.AddObject(ObjectConnectorDistance(markerNumbers=[last, marker], distance=1))
        last = marker
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = STEPS
    settings.timeIntegration.endTime = STEPS * H
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.generalizedAlpha.useNewmark = True
    settings.timeIntegration.generalizedAlpha.useIndex2Constraints = False
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse

    def run():
        solver = exudyn.MainSolverImplicitSecondOrder()
        begun = time.perf_counter()
        if not solver.SolveSystem(system, settings):
            sys.exit("Exudyn did not converge")
        return (time.perf_counter() - begun) / solver.it.newtonStepsCount

    def end():
        shown = exudyn.OutputVariableType.Position
        return np.array(system.GetNodeOutput(links, shown))[:2]

    return run, end


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    warnings.simplefilter("ignore", DeprecationWarning)
    try:
        import exudyn
    except ImportError:
        print("Exudyn is not installed: nothing is compared")
        return 0
    run_ours, march = ours(options.links)
    run_theirs, end = theirs(exudyn, options.links)
    ratios = []
    for k in range(options.rounds):
        mine, other = run_ours(), run_theirs()
        ratios.append(other / mine)
        if k == 0:
            # Exudyn starts each run from the same state, the march goes on.
            difference = np.abs(end() - march.state.fields[0, -2:]).max()
            if not difference < 1e-9 * options.links:
                sys.exit(f"the ends of the chains differ by {difference:g} m")
    ratio = statistics.median(ratios)
    print(
        f"chain of {options.links} links, Exudyn {exudyn.__version__}: {ratio:.1f} times as "
        f"long per Newton iteration (at least {LEAST_RATIO}), median of {options.rounds}"
    )
    return int(ratio < LEAST_RATIO)


if __name__ == "__main__":
    sys.exit(main())
