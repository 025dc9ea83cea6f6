"""Verdicts of `newmark-study check` beside the truth: a confusion table and what is wrong.

    python judge.py RESULTS [--run] [--command newmark-study] [--truth truth.csv] [--all]
                    [--kernel Haswell]

With --run the studies are run into RESULTS first, and the given series are written there.

Prints how often each truth met each verdict, then

  (a) right series (order, floor) that are called a miss or not converging,
  (b) wrong series that pass,
  (c) series of which nothing can be said (preasymptotic, too few) that miss, and that pass,
  (d) wrong series that no verdict names,
  (e) any other verdict that the truth does not accept (with --all).

Exits with 1 when there is anything under (a) or (b).
"""

import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import named
import pandas as pd
import running
from running import GREEN, RED, UNDECIDED

HERE = Path(__file__).resolve().parent
KEY = [
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "quantity",
    "measure", "row_block",
]  # fmt: skip
RIGHT, WRONG = ("order", "floor"), ("wrong",)
UNSURE = ("preasymptotic", "too few")
QUIET = ("shown", *UNDECIDED)


def run(command: str, results: Path, studies: Path = HERE / "studies") -> None:
    """Run every study of a folder; some cells do not end well on purpose."""
    results.mkdir(parents=True, exist_ok=True)
    for study in sorted(studies.glob("*.yaml")):
        arguments = ["run", str(study), "--results", str(results), "--allow-code", "--quiet"]
        done = subprocess.run(
            [*shlex.split(command), *arguments], capture_output=True, text=True, check=False
        )
        if done.returncode not in (0, 1):
            sys.exit(f"{study.name}: exit code {done.returncode}: {done.stderr.strip()}")


def verdicts(command: str, results: Path) -> pd.DataFrame:
    """What `check` says of every series."""
    done = subprocess.run(
        [*shlex.split(command), "check", "--json", "--all", "--results", str(results)],
        capture_output=True,
        text=True,
        check=False,
    )
    try:
        found: Any = json.loads(done.stdout)
    except json.JSONDecodeError:
        sys.exit(f"{command}: no JSON, exit code {done.returncode}: {done.stderr.strip()}")
    rows = found if isinstance(found, list) else found["slopes"]
    frame = pd.DataFrame(rows).rename(columns={"reason": "said"})
    for column in KEY:
        frame[column] = frame[column].fillna("").astype(str)
    return frame


def truths(path: Path = HERE / "truth.csv") -> pd.DataFrame:
    """What is true of every series."""
    return pd.read_csv(path, dtype=str, keep_default_na=False)


def joined(frame: pd.DataFrame, truth: pd.DataFrame) -> pd.DataFrame:
    """Each judged series with its truth, by identity."""
    frame = frame[frame["measure"] != ""].drop_duplicates(KEY)
    both = truth.merge(frame, on=KEY, how="outer", indicator=True)
    both["verdict"] = both["verdict"].fillna("(none)")
    both["label"] = both["label"].fillna("(no truth)")
    return both


def listed(title: str, rows: pd.DataFrame, most: int = 40) -> None:
    """Print series with their truth and what is said of them."""
    print(f"\n{title}: {len(rows)}")
    for _, row in rows.head(most).iterrows():
        where = (row[k] for k in KEY[:6])
        name = " ".join(
            str(part) for part in (*where, row["measure"], row["quantity"], row["row_block"])
        )
        slope = row.get("slope")
        fitted = "" if slope is None or pd.isna(slope) else f", slope {slope:.3f}"
        print(f"  {row['label']} called {row['verdict']}: {name}{fitted}\n      {row['reason']}")
        if "said" in row and isinstance(row["said"], str) and row["said"]:
            print(f"      said: {row['said']}")
    if len(rows) > most:
        print(f"  … and {len(rows) - most} more")


def main() -> int:
    parser = running.options(__doc__.splitlines()[0])
    parser.add_argument("--command", default=running.command(), help="what to judge")
    parser.add_argument("--run", action="store_true", help="run the studies first")
    parser.add_argument("--truth", type=Path, default=HERE / "truth.csv")
    parser.add_argument("--most", type=int, default=40, help="rows to print of each list")
    parser.add_argument("--all", action="store_true", help="print list (e) too")
    given = running.parsed(parser)
    if given.run:
        run(given.command, given.results)
        named.write(given.results)
    truth = truths(given.truth)
    both = joined(verdicts(given.command, given.results), truth)
    label, verdict = both["label"], both["verdict"]
    print(pd.crosstab(label, verdict, margins=True).to_string())
    accepted = pd.Series(
        [v in str(a).split("|") for v, a in zip(verdict, both["accept"], strict=True)]
    )
    right_red = both[label.isin(RIGHT) & verdict.isin(RED) & ~accepted]
    wrong_green = both[label.isin(WRONG) & verdict.isin(GREEN) & ~accepted]
    unsure = both[label.isin(UNSURE) & ~accepted]
    unsure_red, unsure_green = (unsure[unsure["verdict"].isin(words)] for words in (RED, GREEN))
    unnamed = both[label.isin(WRONG) & verdict.isin(QUIET) & ~accepted]
    listed("(a) right series called miss or not converging", right_red, given.most)
    listed("(b) wrong series that pass", wrong_green, given.most)
    listed("(c) series of which nothing can be said, called miss", unsure_red, given.most)
    listed("(c) series of which nothing can be said, that pass", unsure_green, given.most)
    listed("(d) wrong series that no verdict names", unnamed, given.most)
    if given.all:
        seen = pd.concat([right_red, wrong_green, unsure_red, unsure_green, unnamed]).index
        rest = both[~accepted & ~both.index.isin(seen)]
        listed("(e) other verdicts that the truth does not accept", rest, given.most)
    neither = verdict.isin(UNDECIDED)
    of_right = int((neither & label.isin(RIGHT)).sum())
    shown = int((verdict == "shown").sum())
    print(
        f"\nundecided {neither.sum()}, of them {of_right} right; shown {shown}; "
        f"together {neither.sum() + shown}"
    )
    print(f"{len(both)} series: (a) {len(right_red)}, (b) {len(wrong_green)}")
    return 1 if len(right_red) or len(wrong_green) else 0


if __name__ == "__main__":
    sys.exit(main())
