"""Settings of Exudyn for its two scripts.

Newton ends where the residual is below relativeTolerance (1e-8) times that at the start of the
step, or below absoluteTolerance (1e-10).  The cure for λ of index 2 is to ask for more.
"""

import exudyn

SERIES = {  # label → useNewmark, useIndex2Constraints, both tolerances of Newton
    "Exudyn, generalized-α 0.9, index 3": (False, False, None),
    "Exudyn, trapezoidal, index 3": (True, False, None),
    "Exudyn, trapezoidal, index 2": (True, True, None),
    "Exudyn, trapezoidal, index 2, tolerance 1e-13": (True, True, 1e-13),
}


def integrated(system, t_end, h, trapezoidal, index_2, tolerance):
    """March a system: Newton iterations and steps, and a message if Exudyn says that it failed."""
    settings = exudyn.SimulationSettings()
    settings.solution.file.write = False
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime, time.verboseMode = round(t_end / h), t_end, 0
    time.newton.useModifiedNewton = False
    time.generalizedAlpha.useNewmark = trapezoidal
    time.generalizedAlpha.useIndex2Constraints = index_2
    if tolerance:
        time.newton.relativeTolerance = time.newton.absoluteTolerance = tolerance
    solver = exudyn.MainSolverImplicitSecondOrder()
    message = "" if solver.SolveSystem(system, settings) else "SolveSystem returned False"
    return (solver.it.newtonStepsCount, time.numberOfSteps), message
