"""A study from starts one unit in the last place apart: do its verdicts stay?

    python starts.py OUT [--config ../../../configs/cures.yaml] [--starts 40]

Each start has a folder of its own in OUT, and the first is the start as it is; finished cells are
kept, so run it again to go on.  References are those of the start as it is.  Prints the exit code
of `check` for each start, how many verdicts went from which to which, and every series whose
verdict is not the same from all starts.  Exits with 1 if a `check` fails, if any verdict goes to
or from red, or if more than one in a hundred goes between others.
"""

import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import judge
import pandas as pd
import running
from running import RED, decided

TESTS = Path(__file__).resolve().parents[2]
KEY = [*judge.KEY, "formulation", "projection", "multipliers", "start"]


def run(config: Path, folder: Path, seed: int) -> int:
    """Run the study as ``pytest --one-ulp SEED`` starts marches; the exit code of `check`."""
    moved = {"ONE_ULP": str(seed), "PYTHONPATH": str(TESTS / "one_ulp")} if seed else {}
    where = ["--results", str(folder)]
    subprocess.run(
        [running.command(), "run", str(config), "--jobs", "1", "--quiet", *where],
        env=os.environ | moved, check=False,
    )  # fmt: skip
    done = subprocess.run(
        [running.command(), "check", config.stem, *where], capture_output=True, check=False
    )
    return done.returncode


def main() -> int:
    parser = running.options(__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=TESTS.parent / "configs/cures.yaml")
    parser.add_argument("--starts", type=int, default=40)
    given = running.parsed(parser)
    codes, verdicts = {}, {}
    for seed in range(given.starts + 1):
        folder = given.results / f"start-{seed:02}"
        known = given.results / "start-00/references"
        if known.exists() and not (folder / "references").exists():
            shutil.copytree(known, folder / "references")
        codes[seed] = run(given.config, folder, seed)
        frame = judge.verdicts(running.command(), folder)
        frame = frame[frame["measure"] != ""]
        keys = frame[[key for key in KEY if key in frame]].astype(str)
        verdicts[seed] = pd.Series(
            frame["verdict"].map(decided).to_numpy(), index=pd.MultiIndex.from_frame(keys)
        )
        print(f"start {seed}: check {codes[seed]}", flush=True)
    return report(codes, pd.DataFrame(verdicts))


def report(codes: dict[int, int], verdicts: pd.DataFrame) -> int:
    """Print what differs."""
    went: Counter[tuple[str, str]] = Counter()
    for seed in list(verdicts)[1:]:
        went.update(zip(verdicts[0], verdicts[seed], strict=True))
    print(f"\n{len(verdicts)} series; verdicts as it is (rows), one unit apart (columns)")
    print(pd.Series(went).unstack(fill_value=0).to_string())
    changing = verdicts[verdicts.nunique(axis=1, dropna=False) > 1]
    print(f"\nseries whose verdict is not the same from all starts: {len(changing)}")
    for key, row in changing.iterrows():
        counts = ", ".join(f"{verdict} {count}" for verdict, count in row.value_counts().items())
        print(f"  {' '.join(key)}: {counts}")  # type: ignore[arg-type]
    total = sum(went.values())
    red = sum(count for (a, b), count in went.items() if (a in RED) != (b in RED))
    other = sum(count for (a, b), count in went.items() if a != b) - red
    failed = [seed for seed, code in codes.items() if code]
    print(f"\ncheck fails from {len(failed)} of {len(codes)} starts {failed or ''}")
    print(f"to or from red: {red}; between others: {other} of {total}")
    return int(bool(red) or other > total / 100 or bool(failed))


if __name__ == "__main__":
    sys.exit(main())
