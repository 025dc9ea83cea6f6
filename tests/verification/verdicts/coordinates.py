"""The same motion in other coordinates: u' = s (T u + d), with a turn T, a shift d and a unit s.

Masses stay in kg and times in s.  In millimetres, s = 1000, forces are then in kg mm/s² = mN, and
energies and torques in kg mm²/s², so that stiffness (N/m) and damping (N s/m) keep their numbers.
"""

import cmath
import importlib.util
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

Data = dict[str, Any]

#: Numbers of a law of time that have its unit.
_OF_LAW = ("value", "rate", "acceleration", "amplitude")


@dataclass(frozen=True)
class Coordinates:
    """Other coordinates.

    Attributes:
        turn: Angle (rad).
        unit: New units in a metre.
        shift: Where the old origin is (m), in the turned axes.
        reordered: Whether points, bodies and other parts come in reverse order.
    """

    turn: float = 0.0
    unit: float = 1.0
    shift: complex = 0j
    reordered: bool = False

    def of(self, data: Data) -> "Coordinates":
        """Those that a mechanism can be written in: laws of x or y want a quarter of a turn."""
        return replace(self, turn=math.pi / 2) if self.turn and _has_laws(data) else self

    @property
    def rotor(self) -> complex:
        """The turn as a factor."""
        return 1j if self.turn == math.pi / 2 else cmath.exp(1j * self.turn)

    def place(self, at: Any) -> list[float]:
        """Coordinates of a place."""
        return _pair(self.unit * (self.rotor * complex(*at) + self.shift))

    def vector(self, along: Any) -> list[float]:
        """Components of a vector with a length in it."""
        return _pair(self.unit * self.rotor * complex(*along))

    def local(self, at: Any) -> list[float]:
        """A place in axes of a body."""
        return _pair(self.unit * complex(*at))

    def mechanism(self, data: Data) -> Data:
        """The data of a planar mechanism."""
        unit, found = self.unit, {key: value for key, value in data.items() if key != "dimensions"}
        if "python_forces" in data:
            raise ValueError("forces in Python cannot be rewritten")

        def scaled(key: str, **powers: int) -> None:
            found[key] = {
                name: part
                | {of: _times(part[of], unit**power) for of, power in powers.items() if of in part}
                for name, part in found.get(key, {}).items()
            }

        found["points"] = {name: self._point(point) for name, point in data["points"].items()}
        found["bodies"] = {
            name: body | ({"centre": self.local(body["centre"])} if "centre" in body else {})
            for name, body in data.get("bodies", {}).items()
        }
        scaled("bodies", length=1, inertia=2)
        found["body_points"] = {
            name: point | {"at": self.local(point["at"])}
            for name, point in data.get("body_points", {}).items()
        }
        for key, powers in {
            "bars": {"length": 1},
            "springs": {"rest_length": 1},
            "torques": {"torque": 2},
            "torsion_springs": {"stiffness": 2},
            "torsion_dampers": {"damping": 2},
            "rolling": {"radius": 1},
        }.items():
            scaled(key, **powers)
        found["sliders"] = {n: self._line(part) for n, part in data.get("sliders", {}).items()}
        found["motions"] = {n: self._motion(m, data) for n, m in data.get("motions", {}).items()}
        found["forces"] = {
            name: force | {"force": self._force(force["force"])}
            for name, force in data.get("forces", {}).items()
        }
        for part in found["rolling"].values():
            if "line" in part:
                part["line"] = self._line(part["line"])
            else:
                part["circle"] = part["circle"] | {"radius": unit * part["circle"]["radius"]}
        for key, angle in (("torsion_springs", "rest_angle"), ("angle_joints", "angle")):
            for part in found.get(key, {}).values():
                if angle in part and part.get("from", "ground") == "ground":
                    part[angle] += self._turned(part["to"], data)
        found["gravity"] = self.vector(data.get("gravity", (0, 0)))
        found = {key: value for key, value in found.items() if value != {}}
        if self.reordered:
            found = {
                key: dict(reversed(value.items())) if isinstance(value, dict) else value
                for key, value in found.items()
            }
        return found

    def _point(self, point: Data) -> Data:
        places = {key: self.place(point[key]) for key in ("fixed", "at") if key in point}
        speed = {"velocity": self.vector(point["velocity"])} if "velocity" in point else {}
        return point | places | speed

    def _line(self, part: Data) -> Data:
        if "on" in part:
            return part | {"through": self.local(part["through"])}
        turned = _pair(self.rotor * complex(*part["direction"]))
        return part | {"through": self.place(part["through"]), "direction": turned}

    def _motion(self, motion: Data, data: Data) -> Data:
        if "distance" in motion:
            return motion | {"distance": _times(motion["distance"], self.unit)}
        if "angle" in motion:
            law = motion["angle"]
            if "relative_to" in motion:
                return motion
            return motion | {"angle": _raised(law, self._turned(motion["body"], data))}
        laws = {key: law for key, law in motion.items() if key in "xy"}
        if self.turn:  # a quarter of one: x' = −y, y' = x
            laws = {
                {"x": "y", "y": "x"}[key]: _times(law, -1.0 if key == "y" else 1.0)
                for key, law in laws.items()
            }
        shift = {"x": self.shift.real, "y": self.shift.imag}
        laws = {key: _times(_raised(law, shift[key]), self.unit) for key, law in laws.items()}
        return {key: value for key, value in motion.items() if key not in "xy"} | laws

    def _force(self, force: Any) -> list[Any]:
        if not any(isinstance(amount, dict) for amount in force):
            return self.vector(force)
        x, y = (_times(amount, self.unit) for amount in force)
        return [_times(y, -1.0), x] if self.turn else [x, y]

    def _turned(self, body: str, data: Data) -> float:
        """How much the angle of a body changes, which starts between −π and π."""
        ends = (data["points"][data["bodies"][body][key]] for key in ("from", "to"))
        start, end = (complex(*(point.get("fixed") or point["at"])) for point in ends)
        angle = cmath.phase(end - start) + self.turn
        return self.turn - 2 * math.pi * round(angle / (2 * math.pi))

    # -- problems in Python ------------------------------------------------------------------

    def matrix(self, n: int, axes: int) -> Any:
        """(n, n) T of points with so many coordinates each, their order reversed if wanted."""
        block = np.eye(axes)
        block[:2, :2] = [
            [self.rotor.real, -self.rotor.imag],
            [self.rotor.imag, self.rotor.real],
        ]
        order = np.eye(n // axes)[:: -1 if self.reordered else 1]
        return np.kron(order, block)

    def definition(self, given: Any, axes: int) -> Any:
        """A `Definition` of compiled functions, in these coordinates.

        Args:
            given: The definition, without derivatives of its own.
            axes: Coordinates of each point, 2 or 3.
        """
        n = len(given.u0)
        turn = self.matrix(n, axes)
        shift = np.tile([self.shift.real, self.shift.imag, 0.0][:axes], n // axes)
        force, constraints, gradient = _rewritten(
            (given.force, given.constraints, given.gradient), turn, shift, self.unit
        )
        return replace(
            given,
            mass_matrix=turn @ given.mass_matrix @ turn.T,
            u0=self.unit * (turn @ given.u0 + shift),
            v0=self.unit * (turn @ given.v0),
            force=force,
            constraints=constraints,
            gradient=gradient,
        )


def _rewritten(
    functions: tuple[Callable[..., Any], ...], turn: Any, shift: Any, unit: float
) -> tuple[Callable[..., Any], ...]:
    from numba import njit

    force, constraints, gradient = functions
    back = np.ascontiguousarray(turn.T)
    turn = np.ascontiguousarray(turn)

    @njit
    def product(matrix, vector):
        found = np.zeros(len(matrix))
        for i in range(len(matrix)):
            for j in range(len(vector)):
                found[i] += matrix[i, j] * vector[j]
        return found

    @njit
    def new_force(u, v, t):
        return unit * product(
            turn, force(product(back, u / unit - shift), product(back, v / unit), t)
        )

    @njit
    def new_constraints(u, t):
        return unit * constraints(product(back, u / unit - shift), t)

    @njit
    def new_gradient(u, t):
        old = gradient(product(back, u / unit - shift), t)
        found = np.zeros(old.shape)
        for k in range(old.shape[1]):
            found[:, k] = product(turn, old[:, k])
        return found

    return new_force, new_constraints, new_gradient


def rewritten(path: str, factory: str, axes: int, there: Coordinates, given: Data) -> Any:
    """What a factory of a file returns, in other coordinates."""
    spec = importlib.util.spec_from_file_location(f"original_{Path(path).stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return there.definition(getattr(module, factory)(**given), axes)


def _pair(number: complex) -> list[float]:
    return [number.real, number.imag]


def _has_laws(data: Data) -> bool:
    return any("point" in motion for motion in data.get("motions", {}).values()) or any(
        isinstance(amount, dict)
        for force in data.get("forces", {}).values()
        for amount in force["force"]
    )


def _times(amount: Any, factor: float) -> Any:
    """A number or a law of time, multiplied."""
    if not isinstance(amount, dict):
        return factor * amount
    found = amount | {key: factor * amount[key] for key in _OF_LAW if key in amount}
    if "powers" in amount:
        found["powers"] = [factor * power for power in amount["powers"]]
    if "sines" in amount:
        found["sines"] = [s | {"amplitude": factor * s["amplitude"]} for s in amount["sines"]]
    if "table" in amount:
        table = amount["table"]
        found["table"] = table | {"values": [factor * value for value in table["values"]]}
    return found


def _raised(law: Data, by: float) -> Data:
    """A law of time of what starts elsewhere by so much."""
    if "value" in law or {"powers", "table"} & law.keys():
        return law | {"value": law.get("value", 0.0) + by}
    return law  # its constant follows from the start
