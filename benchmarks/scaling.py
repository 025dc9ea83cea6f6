"""Time per Newton iteration and peak memory of large mechanisms against size.

Chains, random chains and rows of four-bars of growing length take a few steps of the
(u, λ) form with optimal scaling at h = 1e-4, by static elimination and by the sparse
march with partial pivoting in turn, each mechanism in a process of its own, whose memory
before the mechanism is built is subtracted.  Prints the ratio of both, the median of
interleaved rounds, and fits exponents to the least time and the memory of static
elimination; then shows that its memory does not grow with the number of steps, and what a
second thread brings.

    python benchmarks/scaling.py

Exits with 1 when static elimination is less than 4 times as fast on chains of 10,000
links and more, when its time or memory grows faster than it may, when 100,000 links take longer
than 3 s to load, or when two cells on two threads have less than 1.7 times the throughput of one.
"""

import argparse
import contextlib
import ctypes
import gc
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

LINKS = {"chain": "links", "random-chain": "links", "four-bars": "windows"}
SIZES = {
    "chain": (1_000, 10_000, 100_000),
    "random-chain": (1_000, 10_000, 100_000),
    "four-bars": (1_000,),
}
H = 1e-4
LARGEST_EXPONENT = {"iteration": 1.05, "memory": 1.0}
LEAST_RATIO, FROM_SIZE = 4.0, 10_000
LEAST_THROUGHPUT = 1.7
LONGEST_TO_BUILD = 3.0


def prepared(family, size):
    """A mechanism and a scheme; imports only what a march takes."""
    from newmark_cli.mechanisms.spec import Sized
    from newmark_cli.newmark.forms import FORMS
    from newmark_cli.newmark.integrator import Newmark
    from newmark_cli.newmark.scaling import named_scaling
    from newmark_cli.newmark.scheme import Scheme

    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(), form, named_scaling("optimal", form), H)
    return Sized(family, ((LINKS[family], size),)).load(), scheme


def measure(family, size, steps, rounds, pivoting):
    """March one mechanism; returns what the table shows."""
    from newmark_cli.newmark.march import March

    def per_iteration(march):
        start = time.perf_counter()
        iterations = march.advance(steps).iterations
        return (time.perf_counter() - start) / int(np.abs(iterations).sum())

    solvers = ("static-lu", "sparse-lu") if pivoting else ("static-lu",)
    for solver in solvers:
        March(*prepared(family, 10), solver).advance(2)  # imports, compilation
    gc.collect()
    forget_peak()
    before = peak()
    start = time.perf_counter()
    subject, scheme = prepared(family, size)
    built = time.perf_counter() - start
    march = March(subject, scheme, "static-lu")
    times = [per_iteration(march)]
    memory = peak() - before
    ratios = []
    if pivoting:
        other = March(subject, scheme, "sparse-lu")
        for _ in range(rounds):
            mine = per_iteration(march)
            times.append(mine)
            ratios.append(per_iteration(other) / mine)
    return {
        "built": built,
        "iteration": min(times),
        "unknowns": march.system.elimination.size,
        "memory": memory,
        "ratio": statistics.median(ratios) if ratios else None,
    }


def throughput(rounds):
    """Two chains of 10,000 links on two threads over one of them alone, in steps a second."""
    from newmark_cli.newmark.march import March

    subject, scheme = prepared("chain", 10_000)
    marches = [March(subject, scheme, "static-lu") for _ in range(2)]
    steps = 20

    def advance(march):
        return int(np.abs(march.advance(steps).iterations).sum())

    def rate(go):
        start = time.perf_counter()
        iterations = go()
        return iterations / (time.perf_counter() - start)

    found = []
    with ThreadPoolExecutor(2) as threads:
        for march in marches:
            advance(march)
        for _ in range(rounds):
            one = rate(lambda: advance(marches[0]))
            two = rate(lambda: sum(threads.map(advance, marches)))
            found.append(two / one)
    return statistics.median(found)


def peak():
    """Peak resident memory of this process so far, in bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def forget_peak():
    """Count from the memory of now on: what compilation took and gave back is no part of it.

    Without this, a small mechanism would live in what was given back, and seem to need none.
    """
    with contextlib.suppress(AttributeError, OSError):  # not on Linux
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def in_process(*arguments):
    command = [sys.executable, __file__, "--only", *map(str, arguments)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def exponent(sizes, values):
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs=5, help=argparse.SUPPRESS)
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    if options.only:
        family, *numbers = options.only
        print(json.dumps(measure(family, *map(int, numbers))))
        return 0

    print(
        f"{'mechanism':>12} {'size':>7} {'unknowns':>9} {'built':>8} {'per iteration':>14} "
        f"{'peak memory':>12} {'pivoting takes':>15}"
    )
    failed = False
    for family, sizes in SIZES.items():
        found = []
        for size in sizes:
            one = in_process(family, size, options.steps, options.rounds, 1)
            found.append(one)
            failed |= size >= FROM_SIZE and one["ratio"] < LEAST_RATIO
            failed |= one["built"] > LONGEST_TO_BUILD
            print(
                f"{family:>12} {size:7d} {one['unknowns']:9d} {one['built']:6.2f} s "
                f"{1e3 * one['iteration']:11.2f} ms {one['memory'] / 1e6:9.1f} MB "
                f"{one['ratio']:11.1f} ×"
            )
        for quantity, most in LARGEST_EXPONENT.items() if len(sizes) > 1 else ():
            fitted = exponent(sizes, [one[quantity] for one in found])
            failed |= fitted > most
            print(f"{family}: {quantity} grows with exponent {fitted:.2f} (at most {most})")
    few, many = (in_process("chain", 10_000, steps, 1, 0)["memory"] / 1e6 for steps in (3, 300))
    print(f"peak memory at 10000 links: {few:.1f} MB for 3 steps, {many:.1f} MB for 300")
    gain = throughput(2 * options.rounds)
    failed |= gain < LEAST_THROUGHPUT
    print(
        f"two cells of 10000 links on two threads: {gain:.2f} times the throughput of one "
        f"(at least {LEAST_THROUGHPUT})"
    )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
