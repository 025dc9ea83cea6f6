"""Time per Newton iteration on Andrews' mechanism: kernel, plain NumPy, plain C.

All march the (u, λ) form with optimal scaling and h = 1e-6, from the same start,
with the same stopping rule: the kernel with partial pivoting and with static elimination,
in compensated evaluation too, and C with either.  The static elimination of C is written
out in the same order, for the same pattern.  Absolute times depend on the machine and on
its other users; the ratios, from interleaved runs of one process, do not.  Exits with 1
when another version takes other steps, or when the kernel takes longer than it may.

    python benchmarks/kernel.py
"""

import argparse
import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from newmark_cli.mechanisms.registry import problem
from newmark_cli.newmark.engine import Engine
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import initial_state
from newmark_cli.newmark.march_data import counting
from newmark_cli.newmark.scaling import named_scaling
from newmark_cli.newmark.scheme import COMPENSATED, DIRECT, Scheme

H = 1e-6
CAP = 50
BETA, GAMMA = 0.25, 0.5
#: Most that an iteration may take, in those of another version.  A compensated one
#: evaluates G and Φ once more in a step and adds Φ up twice.
AT_MOST = {
    ("kernel", "C"): 0.8,
    ("static", "C"): 0.75,
    ("static", "C static"): 2.0,
    ("static compensated", "static"): 1.3,
    ("compensated", "kernel"): 1.5,
}

SUBJECT = problem("andrews")
MECHANISM = SUBJECT.drawing
NAMES = {"E": 0, "F": 1, "G": 2, "H": 3}
BARS = [(b.from_, b.to, b.length) for b in MECHANISM.bodies.values()]
Z = complex(*MECHANISM.body_points["D"].at) / MECHANISM.bodies["K3"].length
B = complex(*MECHANISM.points["B"].fixed)
D_FIXED = (1 - Z) * B
SPRING = MECHANISM.springs["spring"]
TORQUE = MECHANISM.torques["drive"].torque


def scheme(evaluation=DIRECT):
    """The (u, λ) form, optimally scaled."""
    form = FORMS["u-lambda"]
    scaling = named_scaling("optimal", form)
    return Scheme(Newmark(BETA, GAMMA), form, scaling, H, iteration_cap=CAP, evaluation=evaluation)


SETTLED_BELOW = scheme().settled_below


def start():
    """Consistent u, v, a, λ."""
    state = initial_state(SUBJECT, scheme())
    return [*(f.copy() for f in state.fields[:3]), state.multipliers.copy()]


def kernel(evaluation=DIRECT, static=False):
    """The package's kernel: from steps to corrections computed and the end state."""
    how = scheme(evaluation)
    engine = Engine(SUBJECT, how, StaticSystem(SUBJECT, how) if static else None)

    def run(steps):
        state = initial_state(SUBJECT, how)
        counts = counting(steps, 2)
        engine.march(state, 0, counts)
        return int(np.abs(counts.iterations).sum()), state.fields[0]

    return run


def plain_numpy(steps):
    """The same in NumPy, as one writes it: matrices, a loop over the bars, solve."""
    left, right = BETA * H**2, 1 / (BETA * H**2)
    mass = SUBJECT.M
    un, vn, an, multipliers = start()
    turn = np.array([[Z.real, -Z.imag], [Z.imag, Z.real]])
    d_fixed = np.array([D_FIXED.real, D_FIXED.imag])
    c = np.array(MECHANISM.points[SPRING.from_].fixed)
    ends = [
        (NAMES.get(i), NAMES[j], np.array(MECHANISM.points[i].fixed or (0, 0)), length)
        for i, j, length in BARS
    ]
    eye = np.eye(2)
    total = 0
    for _ in range(steps):
        u = un + H * vn
        j_n = mass @ (un / (BETA * H**2) + vn / (BETA * H) + (1 / (2 * BETA) - 1) * an)
        previous, settled = np.inf, 0
        for _ in range(CAP):
            x, g = np.zeros((8, 8)), np.zeros((8, 7))
            phi, force = np.zeros(7), np.zeros(8)
            for k, (i, j, anchor, length) in enumerate(ends):
                end = slice(2 * j, 2 * j + 2)
                delta = u[end] - (anchor if i is None else u[2 * i : 2 * i + 2])
                phi[k] = (delta @ delta - length**2) / 2
                g[end, k] = delta
                x[end, end] -= multipliers[k] * eye
                if i is not None:
                    first = slice(2 * i, 2 * i + 2)
                    g[first, k] = -delta
                    x[first, first] -= multipliers[k] * eye
                    x[first, end] += multipliers[k] * eye
                    x[end, first] += multipliers[k] * eye
            delta = d_fixed + turn @ u[:2] - c
            length = np.sqrt(delta @ delta)
            tension = SPRING.stiffness * (1 - SPRING.rest_length / length)
            stiffness = tension * eye + (
                SPRING.stiffness * SPRING.rest_length / length**3
            ) * np.outer(delta, delta)
            force[:2] -= turn.T @ (tension * delta)
            x[:2, :2] += turn.T @ stiffness @ turn
            fx, fy = u[2:4]
            square = fx**2 + fy**2
            force[2:4] += TORQUE / square * np.array([-fy, fx])
            x[2:4, 2:4] -= (
                TORQUE
                / square**2
                * np.array([[2 * fx * fy, fy**2 - fx**2], [fy**2 - fx**2, -2 * fx * fy]])
            )
            force += g @ multipliers
            jacobian = np.block([[left * (x + right * mass), -g], [g.T, np.zeros((7, 7))]])
            rhs = -np.concatenate([left * (right * (mass @ u) - force - j_n), phi])
            correction = np.linalg.solve(jacobian, rhs)
            total += 1
            norm = np.linalg.norm(correction)
            if settled >= 2 and norm >= previous:
                break
            previous = norm
            u = u + correction[:8]
            multipliers = multipliers + right * correction[8:]
            small = np.linalg.norm(correction[:8]) < SETTLED_BELOW * np.linalg.norm(u)
            settled = settled + 1 if small else 0
            if norm == 0:
                break
        a = (u - un) / (BETA * H**2) - vn / (BETA * H) - (1 / (2 * BETA) - 1) * an
        v = GAMMA / (BETA * H) * (u - un) + (1 - GAMMA / BETA) * vn
        v += H * (1 - GAMMA / (2 * BETA)) * an
        un, vn, an = u, v, a
    return total, un


def static_solver():
    """A function in C that solves by the static elimination of the package."""
    found = StaticSystem(SUBJECT, scheme()).elimination.lists
    rows, columns = found.order
    lines = ["static int solve(double a[S][S], double b[S])", "{", "double f;"]
    size = found.size
    upper = [set() for _ in range(size)]
    for j in range(size):
        for k in found.upper_rows[found.upper_starts[j] : found.upper_starts[j + 1]]:
            upper[k].add(j)
    for k in range(size):
        p, q = rows[k], columns[k]
        lines.append(f"if (a[{p}][{q}] == 0) return 0;")
        lines.append(f"a[{p}][{q}] = 1 / a[{p}][{q}];")
        for i in found.lower_rows[found.lower_starts[k] : found.lower_starts[k + 1]]:
            lines.append(f"f = a[{rows[i]}][{q}] * a[{p}][{q}];")
            lines.extend(
                f"a[{rows[i]}][{columns[j]}] -= f * a[{p}][{columns[j]}];" for j in upper[k]
            )
            lines.append(f"b[{rows[i]}] -= f * b[{p}];")
    lines.append("double x[S];")
    for k in reversed(range(size)):
        terms = "".join(f" - a[{rows[k]}][{columns[j]}] * x[{columns[j]}]" for j in upper[k])
        lines.append(f"x[{columns[k]}] = (b[{rows[k]}]{terms}) * a[{rows[k]}][{columns[k]}];")
    return "\n".join([*lines, "memcpy(b, x, sizeof x);", "return 1;", "}", ""])


def compiled_c(static=False):
    """The plain C version behind a Python function, or None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    folder = tempfile.mkdtemp()
    library = Path(folder) / "andrews.so"
    source = Path(__file__).with_name("andrews.c")
    if static:
        text = source.read_text()
        begin, end = text.index("static int solve("), text.index("/* mass: 8x8;")
        source = Path(folder) / "static.c"
        source.write_text(text[:begin] + static_solver() + text[end:])
    subprocess.run([compiler, "-O3", "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    march = ctypes.CDLL(str(library)).march
    march.restype = ctypes.c_long
    ends = np.array([(NAMES.get(i, -1), NAMES[j]) for i, j, _ in BARS], np.int32)
    anchors = np.array([MECHANISM.points[i].fixed or (0, 0) for i, _, _ in BARS], float)
    lengths = np.array([length for _, _, length in BARS])
    spring = np.array(
        [*MECHANISM.points[SPRING.from_].fixed, D_FIXED.real, D_FIXED.imag, Z.real, Z.imag,
         SPRING.stiffness, SPRING.rest_length]
    )  # fmt: skip
    mass = np.ascontiguousarray(SUBJECT.M)

    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    def run(steps):
        state, norms = np.concatenate(start()), np.zeros((steps, 2))
        total = march(
            pointer(mass), pointer(ends), pointer(anchors), pointer(lengths), pointer(spring),
            ctypes.c_double(TORQUE), ctypes.c_double(H), ctypes.c_long(steps),
            ctypes.c_int(CAP), ctypes.c_double(SETTLED_BELOW), pointer(state), pointer(norms),
        )  # fmt: skip
        return total, state[:8]

    return run


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    versions = {
        "kernel": (kernel(), options.steps),
        "static": (kernel(static=True), options.steps),
        "compensated": (kernel(COMPENSATED), options.steps),
        "static compensated": (kernel(COMPENSATED, static=True), options.steps),
        "C": (compiled_c(), options.steps),
        "C static": (compiled_c(static=True), options.steps),
        "NumPy": (plain_numpy, options.steps // 100),
    }
    if versions["C"][0] is None:
        print("no C compiler: C is left out")
        versions = {name: version for name, version in versions.items() if version[0]}

    check = 200
    reference = versions["kernel"][0](check)[1]
    for name, (run, _) in versions.items():
        difference = np.abs(run(check)[1] - reference).max()
        if not difference < 1e-12:
            sys.exit(f"{name} takes other steps: positions differ by {difference:g} m")

    seconds = {name: [] for name in versions}
    for _ in range(options.rounds):
        for name, (run, steps) in versions.items():
            begun = time.perf_counter()
            corrections = run(steps)[0]
            seconds[name].append((time.perf_counter() - begun) / corrections)
    best = {name: min(times) for name, times in seconds.items()}
    for name, least in best.items():
        ratio = least / best["kernel"]
        print(f"{name:<18} {1e6 * least:8.2f} µs per Newton iteration, {ratio:7.2f} × kernel")
    print(f"kernel is {best['NumPy'] / best['kernel']:.0f} times as fast as NumPy")
    slow = False
    for (name, other), most in AT_MOST.items():
        if other in versions:
            # Each round by itself, so that other users of the machine slow both alike.
            cost = float(np.median(np.array(seconds[name]) / np.array(seconds[other])))
            print(f"{name} takes {cost:.2f} times as long as {other}, at most {most}: median")
            slow |= cost > most
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
