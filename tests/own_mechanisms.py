"""Mechanisms that are not shipped: the kinds that people simulate, with sizes of one's own."""

import math

import numpy as np

GRAVITY = {"gravity": [0, -9.81]}


def rod(length, mass):
    """A homogeneous rod."""
    return {
        "length": length, "mass": mass, "centre": [length / 2, 0], "inertia": mass * length**2 / 12,
    }  # fmt: skip


def turned(vector):
    """A quarter turn to the left."""
    return np.array([-vector[1], vector[0]])


def towards(angle):
    """Unit vector at an angle (degrees)."""
    return np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])


def point(place, velocity=(0, 0), **further):
    """A moving point."""
    return {"at": [*map(float, place)], "velocity": [*map(float, velocity)], **further}


def pendulum(length, mass, angle, rate, origin):
    """A mass on a bar that hangs anywhere."""
    arm = length * towards(angle)
    return {
        "points": {"O": {"fixed": [*origin]},
                   "P": point(np.array(origin) + arm, rate * turned(arm), mass=mass)},
        "bars": {"bar": {"from": "O", "to": "P", "length": length}}, **GRAVITY,
    }  # fmt: skip


def double_pendulum(lengths, masses, angles, rates):
    """Two rods."""
    upper, lower = (length * towards(angle) for length, angle in zip(lengths, angles, strict=True))
    middle = rates[0] * turned(upper)
    return {
        "points": {"O": {"fixed": [0, 0]}, "A": point(upper, middle),
                   "B": point(upper + lower, middle + rates[1] * turned(lower))},
        "bodies": {"upper": {"from": "O", "to": "A", **rod(lengths[0], masses[0])},
                   "lower": {"from": "A", "to": "B", **rod(lengths[1], masses[1])}}, **GRAVITY,
    }  # fmt: skip


def slider_crank(crank=0.1, connecting=0.25, rate=10.0, angle=90.0, masses=(0.2, 0.4, 0.3)):
    """A crank that turns at a rate (rad/s), a connecting rod, a piston on the x axis."""
    pin = crank * towards(angle)
    end = np.array([pin[0] + math.sqrt(connecting**2 - pin[1] ** 2), 0.0])
    velocity = rate * turned(pin)
    piston = velocity[0] - velocity[1] * pin[1] / (end[0] - pin[0])
    return {
        "points": {"O": {"fixed": [0, 0]}, "A": point(pin, velocity),
                   "B": point(end, (piston, 0), mass=masses[2])},
        "bodies": {"crank": {"from": "O", "to": "A", **rod(crank, masses[0])},
                   "rod": {"from": "A", "to": "B", **rod(connecting, masses[1])}},
        "sliders": {"guide": {"point": "B", "through": [0, 0], "direction": [1, 0]}}, **GRAVITY,
    }  # fmt: skip


def four_bar(lengths, masses, rate, angle):
    """Crank, coupler, rocker and the ground's length between the two fixed joints."""
    crank, coupler, rocker, ground = lengths
    pin, joint = crank * towards(angle), np.array([ground, 0.0])
    apart = joint - pin
    distance = math.hypot(*apart)
    along = (coupler**2 - rocker**2 + distance**2) / (2 * distance)
    across = math.sqrt(coupler**2 - along**2)
    end = pin + (along * apart + across * turned(apart)) / distance
    velocity, swing = rate * turned(pin), turned(end - joint)
    swing = swing * (velocity @ (end - pin)) / (swing @ (end - pin))
    return {
        "points": {"O": {"fixed": [0, 0]}, "C": {"fixed": joint.tolist()},
                   "A": point(pin, velocity), "B": point(end, swing)},
        "bodies": {"crank": {"from": "O", "to": "A", **rod(crank, masses[0])},
                   "coupler": {"from": "A", "to": "B", **rod(coupler, masses[1])},
                   "rocker": {"from": "C", "to": "B", **rod(rocker, masses[2])}}, **GRAVITY,
    }  # fmt: skip


def driven_pendulum(length=0.8, mass=1.5, torque=4.0, frequency=3.0):
    """A rod that hangs at rest, with a motor whose torque begins at zero."""
    return {
        "points": {"O": {"fixed": [0, 0]}, "P": {"at": [0, -length]}},
        "bodies": {"rod": {"from": "O", "to": "P", **rod(length, mass)}},
        "torques": {"motor": {"on": "rod",
                              "torque": {"amplitude": torque, "frequency": frequency}}}, **GRAVITY,
    }  # fmt: skip


def shaken_pendulum(length=1.0, mass=1.0, amplitude=0.3, frequency=4.0):
    """A rod on a carriage that a law of time moves."""
    velocity = [amplitude * frequency, 0]
    return {
        "points": {"C": point((0, 0), velocity, mass=0.5),
                   "P": point(length * towards(-60), velocity)},
        "bodies": {"rod": {"from": "C", "to": "P", **rod(length, mass)}},
        "sliders": {"rail": {"point": "C", "through": [0, 0], "direction": [1, 0]}},
        "motions": {"drive": {"point": "C",
                              "x": {"amplitude": amplitude, "frequency": frequency}}}, **GRAVITY,
    }  # fmt: skip


IN_SPACE = {"dimensions": 3, "gravity": [0, 0, -9.81]}


def heavy_top(spin=150.0, precession=-4.61538, mass=15.0):
    """A disc on a massless rod of 1 m: M is singular."""
    body = {
        "position": [0, 0, 0], "mass": mass, "centre": [0, 1, 0],
        "inertia": [0.234375, 0.46875, 0.234375], "angular_velocity": [0, spin, precession],
    }  # fmt: skip
    joint = {"type": "spherical", "from": "ground", "to": "top", "at": [0, 0, 0]}
    return {"bodies": {"top": body}, "joints": {"O": joint}, **IN_SPACE}


def space_pendulum(rates, joint="spherical", **further):
    """A box on a joint."""
    body = {"position": [0.5, 0, 0], "mass": 2, "box": [1, 0.1, 0.2],
            "angular_velocity": [*rates]}  # fmt: skip
    held = {"type": joint, "from": "ground", "to": "box", "at": [0, 0, 0], **further}
    return {"bodies": {"box": body}, "joints": {"O": held}, "project_velocities": True, **IN_SPACE}


def space_double(rate=2.0):
    """A bar on a hinge, and another on a ball at its end."""
    return {
        "bodies": {"a": {"position": [0.3, 0, 0], "mass": 1, "box": [0.6, 0.1, 0.1]},
                   "b": {"position": [0.6, 0.25, 0], "mass": 1.5, "box": [0.1, 0.5, 0.05]}},
        "joints": {"O": {"type": "revolute", "from": "ground", "to": "a", "at": [0, 0, 0],
                         "axis": [0, 1, 0]},
                   "Q": {"type": "spherical", "from": "a", "to": "b", "at": [0.6, 0, 0]}},
        "rates": {"O": rate}, "project_velocities": True, **IN_SPACE,
    }  # fmt: skip


def space_crank(rate=6.0):
    """A slider-crank in space: crank, rod between a ball and a universal joint, block."""

    def at(first, second, axes=None, key="axis"):
        names = (first[0], second[0])
        return {
            "from": names[0], "to": names[1],
            "at": dict(zip(names, (first[1], second[1]), strict=True)),
            **({key: dict(zip(names, axes, strict=True))} if axes else {}),
        }  # fmt: skip

    z, x = ([0, 0, 1],) * 2, ([1, 0, 0],) * 2
    return {
        "bodies": {"crank": {"position": [0.1, 0, 0], "mass": 0.5, "box": [0.2, 0.03, 0.03]},
                   "rod": {"position": [0.45, 0, 0.1], "mass": 0.5, "box": [0.7, 0.03, 0.03]},
                   "block": {"position": [0.8, 0, 0.2], "mass": 1, "box": [0.1, 0.1, 0.1]}},
        "joints": {
            "A": {"type": "revolute", **at(("ground", [0, 0, 0]), ("crank", [-0.1, 0, 0]), z)},
            "B": {"type": "spherical", **at(("crank", [0.1, 0, 0]), ("rod", [-0.35, 0, 0]))},
            "C": {"type": "universal", **at(("rod", [0.35, 0, 0]), ("block", [0, 0, 0]),
                                            ([0, 1, 0], [0, 0, 1]), "axes")},
            "S": {"type": "prismatic", **at(("ground", [0.8, 0, 0.2]), ("block", [0, 0, 0]), x)},
        },
        "assemble": True, "rates": {"A": rate}, **IN_SPACE,
    }  # fmt: skip


def bricard():
    """Bricard's linkage: five rods along the edges of a cube, six hinges, one row too many."""
    places = ([0.5, 0, 0], [1, -0.5, 0], [1, -1, 0.5], [0.5, -1, 1], [0, -0.5, 1])
    sizes = ([1, 0.1, 0.1], [0.1, 1, 0.1], [0.1, 0.1, 1], [1, 0.1, 0.1], [0.1, 1, 0.1])
    hinges = ([0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1])
    axes = ([0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1])
    joints = {
        f"P{k}": {"type": "revolute", "from": f"rod{k}" if k else "ground", "to": f"rod{k + 1}",
                  "at": place, "axis": axis}
        for k, (place, axis) in enumerate(zip(hinges, axes, strict=True))
    }  # fmt: skip
    joints["P5"] = {"type": "revolute", "from": "ground", "to": "rod5", "at": [0, 0, 1],
                    "axis": [1, 0, 0]}  # fmt: skip
    bodies = {
        f"rod{k + 1}": {"position": place, "mass": 1,
                        "box": size}
        for k, (place, size) in enumerate(zip(places, sizes, strict=True))
    }  # fmt: skip
    further = {"redundant": "drop", "gravity": [0, -9.81, 0]}
    return {"dimensions": 3, "bodies": bodies, "joints": joints, **further}


def several(seed=7):
    """Name → mechanism: 33 of all kinds, sizes and starts at random."""
    draw = np.random.default_rng(seed).uniform
    found = {}
    for k in range(4):
        found[f"pendulum {k}"] = pendulum(
            draw(0.2, 3), draw(0.2, 5), draw(-150, -20), draw(-2, 2), draw(-1, 1, 2).round(3)
        )
    for k in range(5):
        found[f"double pendulum {k}"] = double_pendulum(
            draw(0.3, 2, 2), draw(0.3, 2, 2), draw(-120, 60, 2), draw(-2, 2, 2)
        )
    for k in range(5):
        size = draw(0.3, 2)
        lengths = size * np.array([draw(0.15, 0.3), draw(0.65, 0.85), draw(0.5, 0.65), 0.8])
        found[f"four-bar {k}"] = four_bar(lengths, draw(0.3, 3, 3), draw(-8, 8), draw(0, 360))
    for k in range(5):
        crank = draw(0.05, 0.3)
        found[f"slider-crank {k}"] = slider_crank(
            crank, crank * draw(1.6, 4), draw(-20, 20), draw(0, 360), draw(0.1, 2, 3)
        )
    found["slider-crank at 10 rad/s"] = slider_crank()
    found["slider-crank at 10 rad/s, nearly straight"] = slider_crank(angle=30)
    found["driven pendulum"] = driven_pendulum()
    found["shaken pendulum"] = shaken_pendulum()
    found["heavy top"], found["slow top"] = heavy_top(), heavy_top(30, -1, 5)
    for k in range(3):
        found[f"pendulum in space {k}"] = space_pendulum(draw(-4, 4, 3))
    axes = {"axes": [[0, 1, 0], [0, 0, 1]]}
    found["universal joint"] = space_pendulum((0, 0, 0), "universal", **axes)
    found["hinge"] = space_pendulum((0, 3, 0), "revolute", axis=[0, 1, 0])
    found["double pendulum in space"] = space_double()
    found["slider-crank in space"] = space_crank()
    found["Bricard's linkage"] = bricard()
    return found
