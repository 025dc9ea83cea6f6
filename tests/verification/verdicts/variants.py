"""The bench in other coordinates: turned, in millimetres, reordered, shifted; and what changes.

    python variants.py OUT [--only turned …] [--studies swing …]

Runs the studies of mechanisms as they are, and then each variant, into OUT/<variant>.  The motion
is the same, so verdicts should be: prints how many went from which verdict to which, and every
series that

  (a) passed and is now a miss or not converging, or the reverse,
  (b) is now called so although the truth says otherwise.

Exits with 1 when there are any.  Left out: problems in Python, and series given as numbers.

u' = s (T u + d), with a turn T, a shift d and a unit s.  Masses stay in kg and times in s; in
millimetres forces are then in mN, so that stiffness (N/m) and damping (N s/m) keep their numbers.
"""

import cmath
import sys
from pathlib import Path
from typing import Any, NamedTuple

import judge
import pandas as pd
import yaml
from exact import read_yaml
from judge import GREEN, RED, decided

Data = dict[str, Any]

HERE = Path(__file__).resolve().parent
#: What `Coordinates` can rewrite of a mechanism.
KEYS = {
    "title", "source", "points", "bodies", "body_points", "bars", "sliders", "springs", "dampers",
    "torques", "motions", "gravity", "assemble", "project_velocities", "dimensions",
}  # fmt: skip
#: Key → what its parts have a length in: a power of it, or how a pair of numbers changes.
RULES: dict[str, dict[str, int | str]] = {
    "points": {"fixed": "place", "at": "place", "velocity": "vector"},
    "bodies": {"length": 1, "inertia": 2, "centre": "own"},
    "body_points": {"at": "own"},
    "bars": {"length": 1},
    "sliders": {"through": "place", "direction": "direction"},
    "springs": {"rest_length": 1},
    "torques": {"torque": 2},
}


class Coordinates(NamedTuple):
    """A turn (rad), new units in a metre, the old origin (m, in turned axes), and the order."""

    turn: float = 0.0
    unit: float = 1.0
    shift: complex = 0j
    reordered: bool = False

    def mechanism(self, data: Data) -> Data:
        """The data of a planar mechanism; a law of time for x or y keeps its axes."""
        assert data.keys() <= KEYS, data.keys() - KEYS
        motions = data.get("motions", {})
        if any("point" in motion for motion in motions.values()):
            self = self._replace(turn=0.0)
        found = dict(data)
        for key, rules in RULES.items():
            found[key] = {
                name: part | {of: self._changed(part[of], rules[of]) for of in rules.keys() & part}
                for name, part in data.get(key, {}).items()
            }
        found["motions"] = {name: self._motion(law) for name, law in motions.items()}
        found["gravity"] = self._changed(data.get("gravity", (0, 0)), "vector")
        return {
            key: dict(reversed(value.items()))
            if self.reordered and isinstance(value, dict)
            else value
            for key, value in found.items()
            if value != {}
        }

    def _changed(self, value: Any, how: int | str) -> Any:
        if isinstance(how, int):
            return value * self.unit**how
        number, rotor = complex(*value), cmath.exp(1j * self.turn)
        changed = {
            "place": self.unit * (rotor * number + self.shift),
            "vector": self.unit * rotor * number,
            "own": self.unit * number,
            "direction": rotor * number,
        }[how]
        return [changed.real, changed.imag]

    def _motion(self, motion: Data) -> Data:
        """Laws of x and y; one of an angle starts where the mechanism does."""
        found = dict(motion)
        for key, start in (("x", self.shift.real), ("y", self.shift.imag)):
            if key in motion:
                law = dict(motion[key])
                if "value" in law:
                    law["value"] += start
                for name in {"value", "rate", "acceleration", "amplitude"} & law.keys():
                    law[name] *= self.unit
                found[key] = law
        assert "value" not in motion.get("angle", {}), "an angle that a turn changes"
        return found


VARIANTS = {
    "turned": Coordinates(turn=0.7),
    "millimetres": Coordinates(unit=1000.0),
    "reordered": Coordinates(reordered=True),
    "shifted": Coordinates(shift=1000 - 500j),
    "together": Coordinates(0.7, 1000.0, 1000 - 500j, True),
}


def write(folder: Path, there: Coordinates, wanted: list[str]) -> None:
    """Write mechanisms and studies in other coordinates."""
    for name in ("problems", "studies"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for path in sorted((HERE / "studies").glob("*.yaml")):
        study = read_yaml(path)
        if isinstance(study["problem"], dict) or (wanted and path.stem not in wanted):
            continue
        source = (path.parent / study["problem"]).resolve()
        _dump(folder / "problems" / source.name, there.mechanism(read_yaml(source)))
        study["problem"] = f"../problems/{source.name}"
        if "absolute" in study.get("stop", {}):
            study["stop"]["absolute"] *= there.unit
        for key in ("steps", "iteration_cap"):
            if key in study:
                study[key] = int(study[key])
        _dump(folder / "studies" / path.name, study)


def _dump(path: Path, data: Any) -> None:
    path.write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True))


def judged(folder: Path, there: Coordinates, studies: list[str]) -> pd.DataFrame:
    """Verdicts of the studies in other coordinates."""
    write(folder, there, studies)
    judge.run(folder / "results", folder / "studies")
    return judge.verdicts(folder / "results")[[*judge.KEY, "verdict", "slope", "said"]]


def report(name: str, frame: pd.DataFrame) -> int:
    """Print what changed; how many series are wrong."""
    before, after = (frame[f"verdict{when}"].map(decided) for when in ("_before", ""))
    print(f"\n== {name}: {len(frame)} series, {int((before != after).sum())} verdicts change ==")
    print(pd.crosstab(before, after, margins=True).to_string())
    crossed = (before.isin(GREEN) & after.isin(RED)) | (before.isin(RED) & after.isin(GREEN))
    allowed = [decided(v) in a.split("|") for v, a in zip(after, frame["accept"], strict=True)]
    reddened = after.isin(RED) & ~before.isin(RED) & ~pd.Series(allowed, index=frame.index)
    judge.listed("(a) from green to red, or the reverse", frame[crossed])
    judge.listed("(b) now red, and the truth says otherwise", frame[reddened & ~crossed])
    return int((crossed | reddened).sum())


def main() -> int:
    parser = judge.options(__doc__)
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--studies", nargs="+", default=[], help="names of studies; all if omitted")
    given = parser.parse_args()
    before = judged(given.results / "as-it-is", Coordinates(), given.studies)
    before = judge.truths().merge(before, on=judge.KEY)
    wrong = {}
    for name in given.only:
        after = judged(given.results / name, VARIANTS[name], given.studies)
        both = before.merge(after, on=judge.KEY, suffixes=("_before", ""))
        wrong[name] = report(name, both)
    print("\nwrong: " + ", ".join(f"{name} {count}" for name, count in wrong.items()))
    return int(any(wrong.values()))


if __name__ == "__main__":
    sys.exit(main())
