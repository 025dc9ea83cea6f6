"""Mechanisms in other coordinates, as the bench of verdicts rewrites them, move the same way."""

import cmath

from bench import VERDICTS, bench
from each import each

from newmark_cli.mechanisms import loading
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support import documents

#: Turned, in millimetres, shifted and reordered.
THERE = bench("variants").Coordinates(0.7, 1000.0, 3 - 2j, True)


def accelerations(data):
    """Acceleration of every moving point at the start, by name, as a complex number."""
    problem = loading.made("mechanism", data)
    a, _ = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    size = len(problem.points)
    return dict(zip(problem.points, a[: 2 * size].reshape(size, 2) @ [1, 1j], strict=True))


@each("name", [path.stem for path in sorted((VERDICTS / "problems").glob("*.yaml"))])
def test_the_same_motion_in_other_coordinates(name):
    """Accelerations are those of before, turned and in millimetres."""
    data = documents.read(VERDICTS / "problems" / f"{name}.yaml").data
    before, after = accelerations(data), accelerations(THERE.mechanism(data))
    of_time = any("point" in motion for motion in data.get("motions", {}).values())
    rotor = 1 if of_time else cmath.exp(1j * THERE.turn)
    size = max(map(abs, before.values()))
    assert after.keys() == before.keys()
    for point, a in before.items():
        assert abs(after[point] / 1000 - rotor * a) <= 1e-7 * max(size, 1e-3), (name, point)
