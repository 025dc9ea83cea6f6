"""Studies that strangers might write: 200 random mechanisms with literal step sizes.

    python strangers.py OUT [--count 50] [--seed 1] [--kinds four-bar …]

Writes pendulums, double pendulums, four-bars and slider-cranks, so many of each, as OUT/<name>.yaml
with a study beside each, OUT/<name>-<list>.yaml, for every list of step sizes; runs and judges
them.  Finished cells are kept: run it again to go on.  Prints how many series have which verdict,
and every series that is a miss or not converging.  Exits with 1 if any is a miss:
the package integrates and solves as it says, so every miss is wrong.
"""

import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

import judge
import numpy as np
import pandas as pd
import yaml
from judge import RED, decided

Random = np.random.Generator
Data = dict[str, Any]

#: Step sizes (s) as somebody writes them.
LISTS = {
    "halves": [0.1, 0.05, 0.02],
    "finer-halves": [1e-2, 5e-3, 2e-3],
    "decades": [1e-1, 1e-2, 1e-3],
    "finer-decades": [1e-2, 1e-3, 1e-4],
}
FORMS = ("u-lambda", "a-lambda", "v-lambda")
INTEGRATORS = ({"method": "newmark"}, {"method": "generalized-alpha", "rho": 0.9})
G = -9.81


class Stranger(NamedTuple):
    """A mechanism, and how long it is marched (s)."""

    name: str
    data: Data
    t_end: float


def _size(random: Random, low: float, high: float) -> float:
    """A number of three digits, its logarithm uniform."""
    return float(f"{math.exp(random.uniform(math.log(low), math.log(high))):.3g}")


def _at(place: complex, digits: int = 3) -> list[float]:
    return [round(place.real, digits), round(place.imag, digits)]


def _unit(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


def _body(random: Random, start: str, end: str, length: float) -> Data:
    mass = _size(random, 0.1, 10)
    along = float(f"{random.uniform(0.3, 0.7) * length:.3g}")
    inertia = float(f"{mass * length**2 / 12:.3g}")
    body = {"from": start, "to": end, "length": length, "mass": mass, "centre": [along, 0.0]}
    return body | {"inertia": inertia}


def _link(random: Random, data: Data, name: str, start: str, end: str, length: float) -> None:
    """A bar with a mass at its end, or a body."""
    if random.random() < 0.5:
        data.setdefault("bars", {})[name] = {"from": start, "to": end, "length": length}
        data["points"][end]["mass"] = _size(random, 0.1, 10)
    else:
        data.setdefault("bodies", {})[name] = _body(random, start, end, length)


def _base(title: str, random: Random) -> Data:
    gravity = G if random.random() < 0.8 else -1.62
    return {"title": title, "points": {"O": {"fixed": [0.0, 0.0]}}, "gravity": [0.0, gravity]}


def pendulum(random: Random) -> Data:
    """One link, thrown or let go."""
    data = _base("Pendulum", random)
    length, angle = _size(random, 0.2, 3), random.uniform(-math.pi, math.pi)
    rate = random.normal() * math.sqrt(9.81 / length) if random.random() < 0.6 else 0.0
    data["points"]["A"] = {
        "at": _at(length * _unit(angle)),
        "velocity": _at(1j * rate * length * _unit(angle)),
    }
    _link(random, data, "rod", "O", "A", length)
    return data | {"assemble": True, "project_velocities": True}


def double_pendulum(random: Random) -> Data:
    """Two links."""
    data = _base("Double pendulum", random)
    lengths = [_size(random, 0.3, 2) for _ in "AB"]
    angles = random.uniform(-math.pi, math.pi, 2)
    rates = random.normal(size=2) * (random.random() < 0.5)
    place = speed = 0j
    for name, length, angle, rate in zip("AB", lengths, angles, rates, strict=True):
        place += length * _unit(angle)
        speed += 1j * rate * length * _unit(angle)
        data["points"][name] = {"at": _at(place), "velocity": _at(speed)}
    _link(random, data, "upper", "O", "A", lengths[0])
    _link(random, data, "lower", "A", "B", lengths[1])
    return data | {"assemble": True, "project_velocities": True}


def _driven(random: Random, data: Data, body: str, turns: bool) -> None:
    """Prescribe the angle of a body, a turn or an oscillation, or leave it free."""
    choice = random.random()
    if choice < 0.4:
        law: Data = {"rate": round(float(random.uniform(1, 8)), 2)}
        if not turns:
            law = {
                "amplitude": round(float(random.uniform(0.02, 0.1)), 3),
                "frequency": round(float(random.uniform(3, 10)), 2),
            }
        data["motions"] = {"motor": {"body": body, "angle": law}}
    elif choice < 0.7:
        torque = float(f"{random.uniform(-5, 5):.2g}")
        data["torques"] = {"motor": {"on": body, "torque": torque}}
    data |= {"assemble": True, "project_velocities": True}


def four_bar(random: Random) -> Data:
    """A four-bar, with a crank that turns or not; driven, loaded or free."""
    while True:
        crank, coupler, rocker, ground = (_size(random, 0.2, 2) for _ in range(4))
        shortest, *others, longest = sorted((crank, coupler, rocker, ground))
        turns = shortest + longest < 0.95 * sum(others) and crank == shortest
        base = random.uniform(-math.pi, math.pi)
        pin, far = crank * _unit(base), complex(ground, 0)
        apart = abs(far - pin)
        # Neither flat now nor about to be.
        if not 1.1 * abs(coupler - rocker) < apart < 0.9 * (coupler + rocker):
            continue
        cosine = (coupler**2 + apart**2 - rocker**2) / (2 * coupler * apart)
        if abs(cosine) < 0.95:
            break
    lean = math.acos(cosine) * (1 if random.random() < 0.5 else -1)
    joint = pin + coupler * (far - pin) / apart * _unit(lean)
    data = _base("Four-bar", random)
    data["points"] |= {
        "A": {"at": _at(pin)},
        "B": {"at": _at(joint)},
        "C": {"fixed": [ground, 0.0]},
    }
    data["bodies"] = {
        "crank": _body(random, "O", "A", crank),
        "coupler": _body(random, "A", "B", coupler),
        "rocker": _body(random, "C", "B", rocker),
    }
    _driven(random, data, "crank", turns)
    return data


def slider_crank(random: Random) -> Data:
    """A slider-crank, with the line of its slider through the pivot or beside it."""
    crank = _size(random, 0.1, 1)
    rod = float(f"{crank * random.uniform(1.5, 4):.3g}")
    beside = 0.0 if random.random() < 0.5 else round(float(random.uniform(-0.3, 0.3)) * crank, 3)
    angle = random.uniform(-math.pi, math.pi)
    pin = crank * _unit(angle)
    end = pin.real + math.sqrt(rod**2 - (pin.imag - beside) ** 2)
    data = _base("Slider-crank", random)
    data["points"] |= {
        "A": {"at": _at(pin)},
        "B": {"at": _at(complex(end, beside)), "mass": _size(random, 0.1, 10)},
    }
    data["bodies"] = {"crank": _body(random, "O", "A", crank), "rod": _body(random, "A", "B", rod)}
    data["sliders"] = {"guide": {"point": "B", "through": [0.0, beside], "direction": [1.0, 0.0]}}
    _driven(random, data, "crank", True)
    return data


KINDS = {
    "pendulum": pendulum, "double-pendulum": double_pendulum, "four-bar": four_bar,
    "slider-crank": slider_crank,
}  # fmt: skip


def strangers(count: int, seed: int, kinds: Any = tuple(KINDS)) -> list[Stranger]:
    """So many of each kind, the same for the same seed."""
    found = []
    for kind in kinds:
        for number in range(count):
            random = np.random.default_rng([seed, list(KINDS).index(kind), number])
            data = KINDS[kind](random)
            found.append(Stranger(f"{kind}-{number:02}", data, float(random.choice([1.0, 2.0]))))
    return found


def write(folder: Path, stranger: Stranger) -> dict[str, Path]:
    """Write a mechanism and its studies; name of a list of step sizes → path of its study."""
    folder.mkdir(parents=True, exist_ok=True)
    _dump(folder / f"{stranger.name}.yaml", stranger.data)
    paths = {steps: folder / f"{stranger.name}-{steps}.yaml" for steps in LISTS}
    for steps, path in paths.items():
        fine = steps == "finer-decades"
        measures = ["correction", "condition", "error", "invariant"]
        study = {
            "study": path.stem,
            "problem": f"{stranger.name}.yaml",
            "form": list(FORMS[:1] if fine else FORMS),
            "preconditioning": "optimal" if fine else "none",
            "integrator": list(INTEGRATORS),
            "measure": measures + (["sensitivity"] if steps == "finer-halves" else []),
            "h": LISTS[steps],
            "t_end": stranger.t_end,
        }
        _dump(path, study)
    return paths


def _dump(path: Path, data: Data) -> None:
    path.write_text(yaml.safe_dump(data, sort_keys=False))


def main() -> int:
    parser = judge.options(__doc__)
    parser.add_argument("--count", type=int, default=50, help="mechanisms of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    given = parser.parse_args()
    import newmark_cli as newmark

    results, frames = given.results / "results", []
    for stranger in strangers(given.count, given.seed, given.kinds):
        for steps, path in write(given.results, stranger).items():
            try:
                rows = newmark.run(path, results=results, jobs=1)
            except newmark.InputError as error:
                print(f"{path.name}: {error}")
                continue
            frames.append(newmark.slopes(rows).assign(steps=steps))
        print(f"{stranger.name} done", file=sys.stderr, flush=True)
    every = pd.concat(frames, ignore_index=True)
    every["kind"] = every["problem"].str.replace(r"-\d+\.yaml$", "", regex=True)
    every["verdict"] = every["verdict"].map(decided)
    for rows in ("kind", "steps", "measure"):
        print(pd.crosstab(every[rows], every["verdict"], margins=True).to_string(), "\n")
    every[judge.KEY] = every[judge.KEY].astype(object).fillna("").astype(str)
    red = every[every["verdict"].isin(RED)].assign(label="right")
    undamped = red["integrator"].str.startswith("newmark")
    undamped &= red["quantity"].isin(["lambda", "multiplier"])
    missed = red["verdict"] == "miss"
    judge.listed("misses", red[missed])
    judge.listed("not converging", red[~missed & ~undamped])
    judge.listed("not converging, multipliers that nothing damps", red[~missed & undamped])
    misses = int(missed.sum())
    print(f"\n{len(every)} series: {misses} miss, {len(red) - misses} do not converge")
    return int(misses > 0)


if __name__ == "__main__":
    sys.exit(main())
