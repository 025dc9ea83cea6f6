"""Angular velocity of a light rod, which multipliers that alternate turn.

python docs/examples/rod.py
"""

from pathlib import Path

import newmark_cli as newmark

ROD = Path(__file__).with_name("rod.yaml")


def rate(h, **options):
    """Angular velocity of the rod at t = 1 s."""
    end = newmark.march(ROD, h=h, t_end=1.0, every=0, **options)
    (x, y), (dx, dy) = (end.point("B", f)[-1] - end.point("A", f)[-1] for f in "uv")
    return (x * dy - y * dx) / 0.1**2


print(rate(4e-5), rate(4e-5, formulation="index-2"))
