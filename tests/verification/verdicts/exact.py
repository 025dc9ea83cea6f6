"""The exact side of the bench: schemes and motions in numbers of 33 digits.

Mechanism files are read a second time here, with nothing of the package, and handed to
`exact/march.cpp`, which marches the same schemes at the same step sizes without rounding
and integrates the motion itself.  Results are kept in ``exact/runs/<study>.json``.

    python exact.py [STUDY…]
"""

import cmath
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

HERE = Path(__file__).resolve().parent
SOURCE, RUNS = HERE / "exact" / "march.cpp", HERE / "exact" / "runs"

#: Problems in Python, written a second time in march.cpp: name there, M, u0, v0, constraints.
SPECIAL: dict[str, tuple[str, Any, list[float], list[float], int]] = {
    "rheonomic_pendulum.py:pendulum": ("shaken", np.eye(2), [0.8, -0.6], [0.0, 0.5], 1),
    "bead.py:bowl": ("bowl", 0.5 * np.eye(3), [1.0, 0.0, 0.5], [0.0, 1.5, 0.0], 1),
    "bead.py:floor": (
        "floor", 0.5 * np.eye(3), [0.3, 0.2, 0.2 * math.sin(0.9) * math.cos(0.4)], [0.0] * 3, 1,
    ),
    "charged.py:bead": ("charged", np.eye(3), [1.0, 0.0, 0.0], [0.0, 2.0, 0.5], 1),
    "car_axis.py:car_axis": (
        "car-axis", 0.0005 * np.eye(4), [0.0, 0.5, 1.0, 0.5], [-0.5, 0.0, -0.5, 0.0], 2,
    ),
}  # fmt: skip


def read_yaml(path: Path) -> Any:
    """A YAML file: what reads as a number is one, `on` is a word."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, list):
            return [plain(item) for item in value]
        try:
            return float(value)
        except ValueError:
            return {"true": True, "false": False}.get(value, value)

    return plain(yaml.load(path.read_text(), yaml.BaseLoader))


class Mechanism:
    """A planar mechanism file as masses, elements and a start.

    A site is a dict of complex weights over points: a + bi stands for a + bR, R a quarter
    turn to the left.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self.points = data["points"]
        self.place = {
            name: complex(*(point.get("fixed") or point.get("at")))
            for name, point in self.points.items()
        }
        moving = [name for name, point in self.points.items() if "at" in point]
        self.at = {name: 2 * k for k, name in enumerate(moving)}
        self.n = 2 * len(moving)
        self.sites: dict[str, dict[str, complex]] = {name: {name: 1} for name in self.points}
        bodies = data.get("bodies", {})
        for name, point in data.get("body_points", {}).items():
            body = bodies[point["on"]]
            z = complex(*point["at"]) / body["length"]
            self.sites[name] = {body["from"]: 1 - z, body["to"]: z}
        self.mass = np.zeros((self.n, self.n))
        self.loads = np.zeros(self.n)
        self.lines: list[str] = []
        self.m = 0
        gravity = complex(*data.get("gravity", (0, 0)))
        for body in bodies.values():
            length, mass = body["length"], body["mass"]
            centre = complex(*body.get("centre", (0, 0)))
            about_start = body["inertia"] + mass * abs(centre) ** 2
            share = centre / length
            second = about_start / length**2
            ends = (body["from"], body["to"])
            self._mass(ends[0], ends[0], mass * (1 - 2 * share.real) + second)
            self._mass(ends[1], ends[1], second)
            self._mass(ends[0], ends[1], mass * share - second)
            self._load(ends[0], mass * (1 - share).conjugate() * gravity)
            self._load(ends[1], mass * share.conjugate() * gravity)
            self._constraint("distance", self._difference(*ends), [length**2])
        for name, point in self.points.items():
            self._mass(name, name, point.get("mass", 0))
            self._load(name, point.get("mass", 0) * gravity)
        for bar in data.get("bars", {}).values():
            site = self._difference(bar["from"], bar["to"])
            self._constraint("distance", site, [bar["length"] ** 2])
        for slider in data.get("sliders", {}).values():
            normal = 1j * cmath.exp(1j * cmath.phase(complex(*slider["direction"])))
            level = (normal.conjugate() * complex(*slider["through"])).real
            law = [level, 0, 0, 0, 0, 0]
            self._constraint("line", self.sites[slider["point"]], [normal.real, normal.imag, *law])
        for motion in data.get("motions", {}).values():
            if "point" in motion:
                site = self.sites[motion["point"]]
                now = self._value(site)
                for key, line, place in (("x", (1, 0), now.real), ("y", (0, 1), now.imag)):
                    if key in motion:
                        self._constraint("line", site, [*line, *self._law(motion[key], place)])
            else:
                body = bodies[motion["body"]]
                site = self._difference(body["from"], body["to"])
                now = cmath.phase(self._value(site))
                self._constraint("angle", site, self._law(motion["angle"], now))
        for spring in data.get("springs", {}).values():
            self._force("spring", spring, [spring["stiffness"], spring["rest_length"]])
        for damper in data.get("dampers", {}).values():
            self._force("damper", damper, [damper["damping"]])
        for torque in data.get("torques", {}).values():
            self._force("torque", bodies[torque["on"]], [torque["torque"]])
        for k in range(0, self.n, 2):
            if self.loads[k] or self.loads[k + 1]:
                x, y = (float(force) for force in self.loads[k : k + 2])
                self.lines.append(f"force load 1 {k} 1 0 0 0 {x!r} {y!r}")
        self.u0 = [c for name in moving for c in self.points[name]["at"]]
        self.v0 = [c for name in moving for c in self.points[name].get("velocity", (0, 0))]

    def _difference(self, start: str, end: str) -> dict[str, complex]:
        found = dict(self.sites[end])
        for name, weight in self.sites[start].items():
            found[name] = found.get(name, 0) - weight
        return {name: weight for name, weight in found.items() if weight}

    def _value(self, site: dict[str, complex]) -> complex:
        return sum((weight * self.place[name] for name, weight in site.items()), 0j)

    def _law(self, law: dict[str, float], now: float) -> list[float]:
        amplitude, phase = law.get("amplitude", 0), law.get("phase", 0)
        value = law.get("value", now - amplitude * math.sin(phase))
        return [
            value, law.get("rate", 0), law.get("acceleration", 0),
            amplitude, law.get("frequency", 0), phase,
        ]  # fmt: skip

    def _mass(self, first: str, second: str, value: complex) -> None:
        if first in self.at and second in self.at:
            i, j = self.at[first], self.at[second]
            value = complex(value)
            block = np.array([[value.real, -value.imag], [value.imag, value.real]])
            self.mass[i : i + 2, j : j + 2] += block
            if i != j:
                self.mass[j : j + 2, i : i + 2] += block.T

    def _load(self, name: str, force: complex) -> None:
        if name in self.at:
            self.loads[self.at[name]] += force.real
            self.loads[self.at[name] + 1] += force.imag

    def _element(self, site: dict[str, complex], numbers: list[float]) -> str:
        moving = {name: complex(w) for name, w in site.items() if name in self.at}
        fixed = sum((w * self.place[p] for p, w in site.items() if p not in self.at), 0j)
        parts = [f"{self.at[name]} {w.real!r} {w.imag!r}" for name, w in moving.items()]
        rest = [fixed.real, fixed.imag, *numbers]
        return " ".join([str(len(moving)), *parts, *(repr(float(x)) for x in rest)])

    def _constraint(self, kind: str, site: dict[str, complex], numbers: list[float]) -> None:
        self.lines.append(f"constraint {kind} {self._element(site, numbers)}")
        self.m += 1

    def _force(self, kind: str, ends: dict[str, str], numbers: list[float]) -> None:
        site = self._difference(ends["from"], ends["to"])
        self.lines.append(f"force {kind} {self._element(site, numbers)}")

    def text(self) -> str:
        """What march.cpp reads."""
        return _text(self.n, self.m, self.mass, self.u0, self.v0, self.lines)


def _text(n: int, m: int, mass: Any, u0: Any, v0: Any, lines: list[str]) -> str:
    def numbers(values: Any) -> str:
        return " ".join(repr(float(x)) for x in np.asarray(values).ravel())

    head = [f"size {n} {m}", f"mass {numbers(mass)}", f"u0 {numbers(u0)}", f"v0 {numbers(v0)}"]
    return "\n".join([*head, *lines]) + "\n"


def problem_text(problem: Any) -> str:
    """A problem of a study, as march.cpp reads it."""
    if isinstance(problem, dict):
        special, mass, u0, v0, m = SPECIAL[problem["python"].rpartition("/")[2]]
        return _text(len(u0), m, mass, u0, v0, [f"special {special}"])
    path = HERE / "studies" / problem
    return Mechanism(read_yaml(path)).text()


def labels(integrators: Any) -> list[str]:
    """Integrators of a case as the CSV names them."""
    if integrators is None:
        return ["newmark beta=0.25 gamma=0.5"]
    found = []
    for given in integrators if isinstance(integrators, list) else [integrators]:
        values = {"beta": 0.25, "gamma": 0.5} if given["method"] == "newmark" else {}
        values |= {key: value for key, value in given.items() if key != "method"}
        found.append(" ".join([given["method"], *(f"{k}={float(v)!r}" for k, v in values.items())]))
    return found


def plan(study: dict[str, Any]) -> tuple[Any, float, dict[str, list[float]]]:
    """Problem, end, and step sizes of each integrator that a study marches."""
    cases = [{**study, **case} for case in study.get("cases", [{}])]
    wanted: dict[str, list[float]] = {}
    for case in cases:
        for label in labels(case.get("integrator")):
            wanted.setdefault(label, [])
            given = case["h"] if isinstance(case["h"], list) else [case["h"]]
            wanted[label] += [float(h) for h in given if float(h) not in wanted[label]]
    return study["problem"], float(study.get("t_end", 0)), wanted


def run(name: str) -> None:
    """March a study's schemes without rounding, and one smaller step size each."""
    study = read_yaml(HERE / "studies" / f"{name}.yaml")
    problem, t_end, wanted = plan(study)
    if not t_end:
        t_end, wanted = 1e-3, {}
    RUNS.mkdir(parents=True, exist_ok=True)
    text = RUNS / f"{name}.txt"
    text.write_text(problem_text(problem))
    arguments = []
    for label, steps in wanted.items():
        arguments += [f"{label}:{h!r}" for h in steps]
        # Half the smallest step, where that is not too many of them: what the order tends to.
        if t_end / min(steps) <= 20_000:
            arguments += [f"{label}:{min(steps) / 2!r}"]
    print(f"{name}: {len(arguments)} marches", flush=True)
    command = [SOURCE.with_suffix(""), text, repr(t_end), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"{name}: march ended with {done.returncode}: {done.stderr}")
        return
    found = json.loads(
        done.stdout.replace("-nan", "NaN").replace("nan", "NaN").replace("inf", "Infinity")
    )
    (RUNS / f"{name}.json").write_text(json.dumps(found) + "\n")


def build() -> None:
    """Compile march.cpp."""
    target = SOURCE.with_suffix("")
    if not target.exists() or target.stat().st_mtime < SOURCE.stat().st_mtime:
        options = ["-O2", "-std=gnu++17"]
        subprocess.run(["g++", *options, SOURCE, "-lquadmath", "-o", target], check=True)


if __name__ == "__main__":
    build()
    chosen = sys.argv[1:] or sorted(path.stem for path in (HERE / "studies").glob("*.yaml"))
    for study_name in chosen:
        run(study_name)
