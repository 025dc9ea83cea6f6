"""What the Python library adds to a march, and what importing it takes.

A march of 100,000 steps of Andrews' mechanism of which only the end is kept, next to one
call of the kernel for the same steps, interleaved in one process; and, for comparison,
with every thousandth and with every step kept.  All eliminate statically: what partial
pivoting compiles on its way is not the library's.  Exits with 1 when the library takes more
than 1.2 times the kernel's time, or importing takes 50 ms or NumPy.

    python benchmarks/library.py
"""

import statistics
import subprocess
import sys
import time

import numpy as np

import newmark_cli as newmark
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import counting
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import Scheme

H, STEPS, ROUNDS = 1e-7, 100_000, 15
AT_MOST, IMPORT_AT_MOST = 1.2, 0.05
IMPORT = (
    "import sys, time; begin = time.perf_counter(); import newmark_cli; "
    "print(time.perf_counter() - begin, 'numpy' in sys.modules)"
)
SUBJECT = newmark.problem("andrews")


def kernel():
    """One call of the kernel, with the start that it needs."""
    form = FORMS["u-lambda"]
    scheme = Scheme(Newmark(), form, named_scaling("optimal", form), H)
    state = initial_state(SUBJECT, scheme)
    engine = Engine(SUBJECT, scheme, StaticSystem(SUBJECT, scheme))
    engine.march(state, 0, counting(STEPS, 2))
    return state.fields[0]


def library(every):
    how = {"h": H, "steps": STEPS, "linear_solver": "static-lu"}
    return newmark.march(SUBJECT, every=every, **how).u[-1]


def main():
    versions = {
        "kernel": kernel,
        "march, the end": lambda: library(0),
        "march, every 1000th step": lambda: library(1000),
        "march, every step": lambda: library(1),
    }
    ends = [run() for run in versions.values()]
    if not all(np.array_equal(ends[0], end) for end in ends):
        sys.exit("the library takes other steps than the kernel")
    times = {name: [] for name in versions}
    for _ in range(ROUNDS):
        for name, run in versions.items():
            # Time of this process only: others may use the machine.
            begin = time.process_time()
            run()
            times[name].append(time.process_time() - begin)
    print(f"{STEPS} steps of andrews, h = {H:g}; medians of {ROUNDS} interleaved runs")
    ratios = {}
    for name, values in times.items():
        ratios[name] = statistics.median(
            one / other for one, other in zip(values, times["kernel"], strict=True)
        )
        print(f"{name:<26} {statistics.median(values):.3f} s  {ratios[name]:.3f}")
    imports = []
    for _ in range(5):
        done = subprocess.run(
            [sys.executable, "-c", IMPORT], text=True, capture_output=True, check=True
        )
        taken, numpy = done.stdout.split()
        imports.append(float(taken))
    print(f"import newmark_cli         {1e3 * min(imports):.1f} ms, numpy imported: {numpy}")
    if ratios["march, the end"] > AT_MOST:
        sys.exit(f"more than {AT_MOST} times the kernel's time")
    if min(imports) > IMPORT_AT_MOST or numpy == "True":
        sys.exit("importing takes too much")


if __name__ == "__main__":
    main()
