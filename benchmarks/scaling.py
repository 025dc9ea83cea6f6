"""Time per Newton iteration and peak memory of the sparse march against size.

Chains of growing length take a few steps of the (u, λ) form with optimal scaling
at h = 1e-4, each in a process of its own, whose memory before the chain is built
is subtracted.  Fits exponents; then shows that memory does not grow with the
number of steps.

    python benchmarks/scaling.py
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time

import numpy as np

SIZES = (1_000, 10_000, 100_000)
H = 1e-4
LARGEST_EXPONENT = 1.1


def measure(links, steps, rounds):
    """March one chain; returns what the table shows."""
    from newmark_cli.mechanisms.spec import Sized
    from newmark_cli.newmark import scipy_march
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.integrator import Newmark
    from newmark_cli.newmark.linear.sparse import SparseSystem
    from newmark_cli.newmark.march import initial_state
    from newmark_cli.newmark.scaling import named_scaling
    from newmark_cli.newmark.scheme import Scheme

    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(), form, named_scaling("optimal", form), H)

    def run(size, rounds):
        start = time.perf_counter()
        subject = Sized("chain", (("links", size),)).load()
        built = time.perf_counter() - start
        state = initial_state(subject, scheme)
        system = SparseSystem(subject, scheme)
        times, corrections = [], 0
        for k in range(rounds):
            norms, iterations = np.zeros((steps, 2)), np.zeros(steps, np.int64)
            start = time.perf_counter()
            scipy_march.march(subject, scheme, state, k * steps, norms, iterations, system)
            corrections = int(np.abs(iterations).sum())
            times.append((time.perf_counter() - start) / corrections)
        return {"built": built, "iteration": min(times), "unknowns": system.size}

    run(10, 1)  # imports, compilation
    before = peak()
    return run(links, rounds) | {"memory": peak() - before}


def peak():
    """Peak resident memory of this process so far, in bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def in_process(links, steps, rounds):
    command = [sys.executable, __file__, "--links", links, "--steps", steps, "--rounds", rounds]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [str(part) for part in command], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def exponent(sizes, values):
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, help="measure this one size and print JSON")
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    if options.links:
        print(json.dumps(measure(options.links, options.steps, options.rounds)))
        return 0

    print(f"{'links':>8} {'unknowns':>9} {'built':>8} {'per iteration':>14} {'peak memory':>12}")
    found = []
    for links in SIZES:
        one = in_process(links, options.steps, options.rounds)
        found.append(one)
        print(
            f"{links:8d} {one['unknowns']:9d} {one['built']:6.2f} s "
            f"{1e3 * one['iteration']:11.2f} ms {one['memory'] / 1e6:9.1f} MB"
        )
    failed = False
    for quantity, title in (("iteration", "time per Newton iteration"), ("memory", "peak memory")):
        values = [one[quantity] for one in found]
        steps = [exponent(SIZES[i : i + 2], values[i : i + 2]) for i in range(len(SIZES) - 1)]
        fitted = exponent(SIZES, values)
        failed |= fitted > LARGEST_EXPONENT
        print(
            f"{title}: exponent {fitted:.2f} (at most {LARGEST_EXPONENT}); "
            f"between sizes {', '.join(f'{step:.2f}' for step in steps)}"
        )
    few, many = (in_process(10_000, steps, 1)["memory"] / 1e6 for steps in (3, 60))
    print(f"peak memory at 10000 links: {few:.1f} MB for 3 steps, {many:.1f} MB for 60")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
