"""The bench in other coordinates: turned, in millimetres, reordered, shifted; and what changes.

    python variants.py OUT [--only turned …] [--base RESULTS] [--studies swing …]

Runs the studies of the bench as they are (or takes RESULTS of judge.py), and then each variant,
into OUT/<variant>.  The motion is the same, so verdicts should be: prints how many went from
which verdict to which, and every series that

  (a) passed and is now a miss or not converging, or the reverse,
  (b) is now called so although the truth says otherwise.

Exits with 1 when there are any.  A mechanism with a law of time for x or y turns by a quarter
of a turn, as its file cannot say a law along another line.  Left out: series that are given as
numbers (`named`), which are in no coordinates.
"""

import sys
from pathlib import Path
from typing import Any

import judge
import pandas as pd
import running
import yaml
from coordinates import Coordinates
from exact import read_yaml
from running import GREEN, RED, decided

HERE = Path(__file__).resolve().parent
#: Turn (rad), unit (1/m), shift (m), order.
VARIANTS = {
    "turned": Coordinates(turn=0.7),
    "millimetres": Coordinates(unit=1000.0),
    "reordered": Coordinates(reordered=True),
    "shifted": Coordinates(shift=1000 - 500j),
    "together": Coordinates(0.7, 1000.0, 1000 - 500j, True),
}
#: Coordinates of each point of problems in Python.
AXES = {"bowl": 3, "floor": 3, "bead": 3, "pendulum": 2, "car_axis": 2}


def write(folder: Path, there: Coordinates, wanted: list[str]) -> None:
    """Write problems and studies in other coordinates."""
    for name in ("problems", "studies"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    factories: dict[Path, list[str]] = {}
    for path in sorted((HERE / "studies").glob("*.yaml")):
        if wanted and path.stem not in wanted:
            continue
        study = read_yaml(path)
        if isinstance(study["problem"], dict):
            file, _, factory = study["problem"]["python"].partition(":")
            source = (path.parent / file).resolve()
            factories.setdefault(source, []).append(factory)
            study["problem"]["python"] = f"../problems/{source.name}:{factory}"
        else:
            source = (path.parent / study["problem"]).resolve()
            data = read_yaml(source)
            _dump(folder / "problems" / source.name, there.of(data).mechanism(data))
            study["problem"] = f"../problems/{source.name}"
        if "absolute" in study.get("stop", {}):
            study["stop"]["absolute"] *= there.unit
        for key in ("steps", "iteration_cap"):
            if key in study:
                study[key] = int(study[key])
        _dump(folder / "studies" / path.name, study)
    for source, names in factories.items():
        lines = [
            "import sys",
            f"sys.path.insert(0, {str(HERE)!r})",
            "from coordinates import Coordinates, rewritten",
            f"THERE = {there!r}",
        ]
        for name in dict.fromkeys(names):
            call = f"rewritten({str(source)!r}, {name!r}, {AXES[name]}, THERE, given)"
            lines += [f"def {name}(**given):", f"    return {call}"]
        (folder / "problems" / source.name).write_text("\n".join(lines) + "\n")


def _dump(path: Path, data: Any) -> None:
    path.write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True))


def compared(base: pd.DataFrame, variant: pd.DataFrame) -> pd.DataFrame:
    """Truth and verdicts of both, one row for each series that the truth knows."""
    frame = judge.truths()
    frame = frame[frame["study"] != "named"]
    for name, found in (("before", base), ("after", variant)):
        found = found[found["measure"] != ""].drop_duplicates(judge.KEY)
        found = found[[*judge.KEY, "verdict", "slope", "said"]]
        found = found.rename(columns={key: f"{key}_{name}" for key in ("verdict", "slope", "said")})
        frame = frame.merge(found, on=judge.KEY, how="inner")
    return frame


def report(name: str, frame: pd.DataFrame) -> int:
    """Print what changed; how many series are wrong."""
    before, after = (frame[f"verdict_{when}"].map(decided) for when in ("before", "after"))
    print(f"\n== {name}: {len(frame)} series, {int((before != after).sum())} verdicts change ==")
    print(pd.crosstab(before, after, margins=True).to_string())
    crossed = (before.isin(GREEN) & after.isin(RED)) | (before.isin(RED) & after.isin(GREEN))
    allowed = [decided(v) in a.split("|") for v, a in zip(after, frame["accept"], strict=True)]
    reddened = after.isin(RED) & ~before.isin(RED) & ~pd.Series(allowed, index=frame.index)
    for title, rows in (
        ("(a) from green to red, or the reverse", frame[crossed]),
        ("(b) now red, and the truth says otherwise", frame[reddened & ~crossed]),
    ):
        print(f"\n{title}: {len(rows)}")
        for _, row in rows.iterrows():
            print("  " + " ".join(str(row[key]) for key in judge.KEY))
            print(f"      {row['label']}: {row['verdict_before']} → {row['verdict_after']}, "
                  f"slope {row['slope_before']} → {row['slope_after']}")  # fmt: skip
            print(f"      said: {row['said_after']}; truth: {row['reason']}")
    return int((crossed | reddened).sum())


def main() -> int:
    parser = running.options(__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--base", type=Path, help="results of judge.py; they are not run again")
    parser.add_argument("--studies", nargs="+", default=[], help="names of studies; all if omitted")
    parser.add_argument("--command", default=running.command(), help="what runs and judges")
    parser.add_argument("--kept", action="store_true", help="take results that are there")
    given = running.parsed(parser)
    base = given.base or given.results / "as-it-is"
    if not given.base and not given.kept:
        write(base, Coordinates(), given.studies)
        judge.run(given.command, base / "results", base / "studies")
    before = judge.verdicts(given.command, given.base or base / "results")
    wrong = {}
    for name in given.only:
        folder = given.results / name
        if not given.kept:
            write(folder, VARIANTS[name], given.studies)
            judge.run(given.command, folder / "results", folder / "studies")
        after = judge.verdicts(given.command, folder / "results")
        wrong[name] = report(name, compared(before, after))
    print("\nwrong: " + ", ".join(f"{name} {count}" for name, count in wrong.items()))
    return 1 if any(wrong.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
