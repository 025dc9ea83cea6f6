"""Time per step in space: the default solver, static elimination, partial pivoting.

The (u, λ) form with optimal scaling, the trapezoidal rule and h = 1e-4, on the shipped
mechanisms with many bodies.  Absolute times depend on the machine and on its other users; the
ratios, from interleaved rounds, do not.  Exits with 1 when the default takes more than a third
of the time of partial pivoting, or much more than static elimination.  Where Exudyn is installed
it marches Bricard's mechanism, too: rigid bodies with Euler parameters, index 3, full Newton.

    python benchmarks/spatial.py
    python benchmarks/spatial.py --against ../main   # another version, in alternate processes
"""

import argparse
import json
import os
import subprocess
import sys
import time

import numpy as np

MECHANISMS = "governor", "bricard", "spatial-slider-crank"
H = 1e-4
SOLVERS = "auto", "static-lu", "dense-lu"
AT_MOST = {"dense-lu": 1 / 3, "static-lu": 1.2}


def seconds(name, solver, steps):
    """Per step, after compilation and some steps."""
    from newmark_cli.mechanisms.registry import problem
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.integrator import Newmark
    from newmark_cli.newmark.march import March
    from newmark_cli.newmark.scaling import named_scaling
    from newmark_cli.newmark.scheme import Scheme

    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(0.25, 0.5), form, named_scaling("optimal", form), H)
    march = March(problem(name), scheme, solver)
    march.advance(100)
    begun = time.perf_counter()
    march.advance(steps)
    return (time.perf_counter() - begun) / steps


def by_exudyn(exudyn, steps):
    """A march of Bricard's mechanism in Exudyn: from nothing to seconds per step."""
    from exudyn.utilities import GenericJoint, MarkerBodyRigid, RigidBodyInertia

    from newmark_cli.mechanisms.registry import problem

    mechanism = problem("bricard").drawing.mechanism
    system = exudyn.SystemContainer().AddSystem()
    number = {"ground": system.CreateGround()}
    for name, body in mechanism.bodies.items():
        inertia = RigidBodyInertia(mass=body.mass, inertiaTensor=body.tensor)
        number[name] = system.CreateRigidBody(
            inertia=inertia, referencePosition=list(body.position),
            gravity=list(mechanism.gravity),
        )  # fmt: skip
    *joints, last = mechanism.joints.values()
    for joint in joints:
        system.CreateRevoluteJoint(
            bodyNumbers=[number[joint.from_], number[joint.to]], position=list(joint.at),
            axis=list(joint.axis), useGlobalFrame=True,
        )  # fmt: skip
    # About x, and without the row that is redundant.
    places = [0.0, 0.0, 0.0], mechanism.bodies[last.to].position
    markers = [
        system.AddMarker(
            MarkerBodyRigid(bodyNumber=number[end], localPosition=list(np.subtract(last.at, place)))
        )
        for end, place in zip((last.from_, last.to), places, strict=True)
    ]
    system.AddObject(GenericJoint(markerNumbers=markers, constrainedAxes=[1, 1, 1, 0, 0, 1]))
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = steps * H
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.generalizedAlpha.useNewmark = True
    settings.timeIntegration.generalizedAlpha.useIndex2Constraints = False
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse

    def run():
        begun = time.perf_counter()
        if not exudyn.MainSolverImplicitSecondOrder().SolveSystem(system, settings):
            sys.exit("Exudyn did not converge")
        return (time.perf_counter() - begun) / steps

    return run


def against_exudyn(steps, rounds):
    """Print the ratio of times per step, where there is an Exudyn."""
    try:
        import exudyn
    except ImportError:
        print("Exudyn is not installed: it is left out")
        return
    run = by_exudyn(exudyn, steps)
    pairs = [(run(), seconds("bricard", "auto", steps)) for _ in range(rounds)]
    ratio = float(np.median([theirs / ours for theirs, ours in pairs]))
    theirs, ours = (1e6 * min(times) for times in zip(*pairs, strict=True))
    print(
        f"bricard in Exudyn {exudyn.__version__}: {theirs:.0f} µs per step, auto {ours:.1f}, "
        f"{ratio:.0f} times as long: median"
    )


def measured(steps, rounds):
    """Rounds of times by mechanism and solver."""
    return [
        {f"{name} {solver}": seconds(name, solver, steps) for name in MECHANISMS
         for solver in SOLVERS}
        for _ in range(rounds)
    ]  # fmt: skip


def of_version(folder, steps):
    """A round of another version, in a process of its own."""
    command = [sys.executable, __file__, "--steps", str(steps), "--rounds", "2", "--json"]
    environment = {**os.environ, "PYTHONPATH": folder}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return {
        name: min(one[name] for one in found)
        for found in [json.loads(done.stdout)]
        for name in found[0]
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--against", help="worktree of another version")
    parser.add_argument("--json", action="store_true", help="times only")
    options = parser.parse_args()
    if options.json:
        print(json.dumps(measured(options.steps, options.rounds)))
        return 0
    if options.against:
        here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
        pairs = [
            [of_version(folder, options.steps) for folder in (here, options.against)]
            for _ in range(options.rounds)
        ]
        for name in MECHANISMS:
            default = f"{name} auto"
            ours, theirs = (min(pair[k][default] for pair in pairs) for k in range(2))
            ratio = float(np.median([mine[default] / other[default] for mine, other in pairs]))
            print(
                f"{name:<22} {1e6 * ours:8.1f} µs per step, {options.against} {1e6 * theirs:.1f}: "
                f"{ratio:.2f} times as long, median"
            )
        return 0
    rounds, slow = measured(options.steps, options.rounds), False
    for name in MECHANISMS:
        least = {solver: min(one[f"{name} {solver}"] for one in rounds) for solver in SOLVERS}
        print(f"{name:<22}", *(f"{solver} {1e6 * least[solver]:.1f} µs" for solver in SOLVERS))
        for other, most in AT_MOST.items():
            cost = [one[f"{name} auto"] / one[f"{name} {other}"] for one in rounds]
            ratio = float(np.median(cost))
            print(f"  auto takes {ratio:.2f} times as long as {other}, at most {most:.2f}: median")
            slow |= ratio > most
    against_exudyn(options.steps, options.rounds)
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
