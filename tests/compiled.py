"""The kernel, compiled before the workers of pytest-xdist would each compile it.

Numba keeps what it has compiled, but of two processes that find nothing kept each
compiles all of it.  Here each compiles a part, and the workers find the whole.
"""

import subprocess
import sys
from pathlib import Path

import newmark_cli

NEWMARK = Path(newmark_cli.__file__).parent / "newmark"
#: The march, and what it is compiled with.
KERNEL = [NEWMARK / f"{name}.py" for name in ("kernel", "newton", "enforcing", "room")]
EXAMPLES = Path(__file__).parents[1] / "docs/examples"


def march(problem, **how):
    """One step."""
    return newmark_cli.march(problem, h=1e-3, steps=1, **how)


#: What is compiled, by the types of the kernel and the functions of a problem: those of
#: most mechanisms, of one with every element, and what compares functions in Python with
#: differences.  About as long for each process.
PARTS = (
    lambda: (
        march("pendulum", formulation="index-2"),
        march("spatial-slider-crank", formulation="index-2"),
    ),
    lambda: (
        march("pendulum").energy,
        newmark_cli.problem(EXAMPLES / "shaper.yaml"),
        newmark_cli.problem(f"{EXAMPLES / 'car_axis.py'}:car_axis", compiled=False),
    ),
)


def is_kept():
    """Whether anything is, of the kernel as it is now."""
    changed = max(file.stat().st_mtime for file in KERNEL)
    kept = (NEWMARK / "__pycache__").glob("kernel.*.nbc")
    return any(file.stat().st_mtime > changed for file in kept)


def compile_all():
    """Every part in a process of its own; should one fail, a test will say why."""
    processes = [
        subprocess.Popen([sys.executable, __file__, str(part)], stderr=subprocess.DEVNULL)
        for part in range(len(PARTS))
    ]
    for process in processes:
        process.wait()


if __name__ == "__main__":
    PARTS[int(sys.argv[1])]()
