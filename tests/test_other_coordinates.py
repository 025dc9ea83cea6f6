"""Mechanisms in other coordinates, as the bench of verdicts rewrites them, move the same way."""

from bench import VERDICTS, bench
from each import each

from newmark_cli.mechanisms import loading
from newmark_cli.problems.index_1 import Index1

#: Turned, in millimetres, shifted and reordered.
THERE = bench("coordinates").Coordinates(0.7, 1000.0, 3 - 2j, True)

#: Parts that no mechanism of the bench has.
FURTHER = {
    "points": {
        "O": {"fixed": [0.0, 0.0]},
        "A": {"at": [-0.3, 0.4], "mass": 2.0},
        "B": {"at": [0.108, -0.044], "velocity": [-0.156, 0.008], "mass": 1.0},
        "W": {"at": [0.7, 0.25], "velocity": [0.2, 0.0]},
        "X": {"at": [0.75, 0.25], "velocity": [0.2, -0.04]},
    },
    "bodies": {
        "arm": {"from": "O", "to": "A", "length": 0.5, "mass": 1.0, "centre": [0.2, 0.1],
                "inertia": 0.03},
        "wheel": {"from": "W", "to": "X", "length": 0.05, "mass": 0.4, "inertia": 0.01},
    },
    "body_points": {"P": {"on": "arm", "at": [0.3, 0.1]}},
    "sliders": {"guide": {"point": "B", "on": "arm", "through": [0.2, 0.3],
                          "direction": [1.0, 1.2]}},
    "springs": {"s": {"from": "P", "to": "B", "stiffness": 30.0, "rest_length": 0.2}},
    "dampers": {"d": {"from": "O", "to": "B", "damping": 2.0}},
    "torques": {"motor": {"on": "arm", "torque": {"value": 0.4, "amplitude": 1.0,
                                                  "frequency": 2.0, "phase": 0.3}}},
    "forces": {"push": {"at": "B", "force": [3.0, -1.0]}},
    "torsion_springs": {"t": {"to": "arm", "stiffness": 3.0, "rest_angle": 1.9}},
    "torsion_dampers": {"t": {"from": "arm", "to": "wheel", "damping": 0.2}},
    "rolling": {"road": {"wheel": "wheel", "radius": 0.25,
                         "line": {"through": [0.0, 0.0], "direction": [1.0, 0.0]}}},
    "gravity": [0.3, -9.81],
}  # fmt: skip
LAWS = {
    "points": {
        "O": {"fixed": [0.0, 0.3]},
        "A": {"at": [0.4, 0.3], "mass": 2.0},
        "B": {"at": [0.9, 0.3], "mass": 1.0},
    },
    "bars": {"one": {"from": "A", "to": "B", "length": 0.5}},
    "motions": {"m": {"point": "A", "x": {"powers": [0.4, 0.5, -0.3]},
                      "y": {"amplitude": 0.1, "frequency": 3.0, "phase": 0.2}}},
    "forces": {"push": {"at": "B", "force": [{"value": 3.0, "rate": 0.2}, -1.0]}},
    "gravity": [0.0, -9.81],
    "project_velocities": True,
}  # fmt: skip


def accelerations(data):
    """Acceleration of every moving point at the start, by name, as a complex number."""
    problem = loading.made("mechanism", data)
    a, _ = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    size = len(problem.points)
    return dict(zip(problem.points, a[: 2 * size].reshape(size, 2) @ [1, 1j], strict=True))


def bench():
    """Mechanisms of the bench."""
    from newmark_cli import documents

    return {
        path.stem: documents.read(path).data
        for path in sorted((VERDICTS / "problems").glob("*.yaml"))
    }


MECHANISMS = {**bench(), "further": FURTHER, "laws": LAWS}


@each("name", MECHANISMS)
def test_the_same_motion_in_other_coordinates(name):
    """Accelerations are those of before, turned and in millimetres."""
    data = MECHANISMS[name]
    there = THERE.of(data)
    before, after = accelerations(data), accelerations(there.mechanism(data))
    size = max(map(abs, before.values()))
    assert after.keys() == before.keys()
    for point, a in before.items():
        assert abs(after[point] / 1000 - there.rotor * a) <= 1e-7 * max(size, 1e-3), (name, point)
