"""Verdicts of `newmark-study check` beside the truth: a confusion table and what is wrong.

    python judge.py RESULTS [--run]

With --run the studies are run into RESULTS first, and the given series are written there.

Prints how often each truth met each verdict, then

  (a) right series (order, floor) that are called a miss or not converging,
  (b) wrong series that pass,
  (c) series of which nothing can be said (preasymptotic, too few) that miss, and that pass,
  (d) wrong series that no verdict names.

Exits with 1 when there is anything under (a) or (b).
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import named
import pandas as pd

HERE = Path(__file__).resolve().parent
KEY = [
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "quantity",
    "measure", "row_block",
]  # fmt: skip
#: Verdicts with which `check` fails, by which it is satisfied, and which say neither; the last
#: two of them are what results before 0.3 call it.
RED, GREEN = ("miss", "not converging"), ("pass",)
UNDECIDED = ("undecided", "not asymptotic", "too few points")
#: Rows of a list that are printed.
MOST = 40


def options(description: str) -> argparse.ArgumentParser:
    """A parser with the folder that every driver writes to."""
    parser = argparse.ArgumentParser(description=description.partition("\n")[0])
    parser.add_argument("results", type=Path, help="folder that is written to")
    return parser


def decided(verdict: str) -> str:
    """A verdict, under one name where it says neither yes nor no."""
    return "undecided" if verdict in UNDECIDED else verdict


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command of the environment of this interpreter."""
    script = Path(sys.executable).with_name("newmark-study")
    return subprocess.run([script, *map(str, arguments)], capture_output=True, text=True)


def run(results: Path, studies: Path = HERE / "studies") -> None:
    """Run every study of a folder; some cells do not end well on purpose."""
    results.mkdir(parents=True, exist_ok=True)
    for study in sorted(studies.glob("*.yaml")):
        done = command("run", study, "--results", results, "--allow-code", "--quiet")
        if done.returncode not in (0, 1):
            sys.exit(f"{study.name}: exit code {done.returncode}: {done.stderr.strip()}")


def verdicts(results: Path) -> pd.DataFrame:
    """What `check` says of every series that was measured."""
    done = command("check", "--json", "--all", "--results", results)
    try:
        found = json.loads(done.stdout)
    except json.JSONDecodeError:
        sys.exit(f"check: no JSON, exit code {done.returncode}: {done.stderr.strip()}")
    rows = found if isinstance(found, list) else found["slopes"]
    frame = pd.DataFrame(rows).rename(columns={"reason": "said"})
    for column in KEY:
        frame[column] = frame[column].fillna("").astype(str)
    return frame[frame["measure"] != ""].drop_duplicates(KEY)


def truths() -> pd.DataFrame:
    """What is true of every series."""
    return pd.read_csv(HERE / "truth.csv", dtype=str, keep_default_na=False)


def listed(title: str, rows: pd.DataFrame) -> None:
    """Print series with their truth and what is said of them."""
    print(f"\n{title}: {len(rows)}")
    for _, row in rows.head(MOST).iterrows():
        name = " ".join(str(row[key]) for key in (*KEY[:6], "measure", "quantity", "row_block"))
        slope = row.get("slope")
        fitted = "" if slope is None or pd.isna(slope) else f", slope {slope:.3f}"
        print(f"  {row['label']} called {row['verdict']}: {name}{fitted}\n      {row['reason']}")
        if isinstance(row.get("said"), str) and row["said"]:
            print(f"      said: {row['said']}")
    if len(rows) > MOST:
        print(f"  … and {len(rows) - MOST} more")


def main() -> int:
    parser = options(__doc__)
    parser.add_argument("--run", action="store_true", help="run the studies first")
    given = parser.parse_args()
    if given.run:
        run(given.results)
        named.write(given.results)
    both = truths().merge(verdicts(given.results), on=KEY, how="outer")
    both["verdict"] = both["verdict"].fillna("(none)")
    both["label"] = both["label"].fillna("(no truth)")
    print(pd.crosstab(both["label"], both["verdict"], margins=True).to_string())
    pairs = zip(both["verdict"], both["accept"], strict=True)
    others = both[[verdict not in str(accept).split("|") for verdict, accept in pairs]]

    def those(labels: tuple[str, ...], words: tuple[str, ...]) -> pd.DataFrame:
        return others[others["label"].isin(labels) & others["verdict"].isin(words)]

    right, unsure = ("order", "floor"), ("preasymptotic", "too few")
    right_red, wrong_green = those(right, RED), those(("wrong",), GREEN)
    listed("(a) right series called miss or not converging", right_red)
    listed("(b) wrong series that pass", wrong_green)
    listed("(c) series of which nothing can be said, called miss", those(unsure, RED))
    listed("(c) series of which nothing can be said, that pass", those(unsure, GREEN))
    listed("(d) wrong series that no verdict names", those(("wrong",), ("shown", *UNDECIDED)))
    neither = both[both["verdict"].isin(UNDECIDED)]
    of_right = neither["label"].isin(right).sum()
    shown = (both["verdict"] == "shown").sum()
    print(f"\nundecided {len(neither)}, of them {of_right} right; shown {shown}")
    print(f"{len(both)} series: (a) {len(right_red)}, (b) {len(wrong_green)}")
    return int(len(right_red) + len(wrong_green) > 0)


if __name__ == "__main__":
    sys.exit(main())
