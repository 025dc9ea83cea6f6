"""Settings of Exudyn for its two codes.

Newton ends where the residual is below relativeTolerance (1e-8) times that at the start of the
step, or below absoluteTolerance (1e-10).  The cure for λ of index 2 is to ask for more.
"""

import exudyn


def marched(system, t_end, h, trapezoidal=False, index_2=False, tolerance=None):
    """March a system to its end: Newton's iterations per step."""
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
    if not solver.SolveSystem(system, settings):
        raise RuntimeError("SolveSystem returned False")
    return solver.it.newtonStepsCount / time.numberOfSteps
