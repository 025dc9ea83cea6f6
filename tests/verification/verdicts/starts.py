"""A study from starts one unit in the last place apart: do its verdicts stay?

    python starts.py OUT [--config ../../../configs/cures.yaml] [--starts 40] [--problems andrews]
                         [--points 3] [--cases 0 4 7]

Each start has a folder of its own in OUT, and the first is the start as it is.  A start that is
done is not run again, and one that was interrupted goes on: run the driver again.  References are
those of the start as it is.  Prints the exit code of `check` for each start, how many verdicts went
from which to which, and every series whose verdict is not the same from all starts.  Exits with 1
if a `check` fails, if any verdict goes to or from red, or if more than one in a hundred goes
between others.

--points, --problems and --cases take a part of the study; claims about its figures may then lack
what they are about, so that the exit code of `check` does not count.
"""

import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import judge
import numpy as np
import pandas as pd
import running
import yaml
from running import RED, decided

HERE = Path(__file__).resolve().parent
CURES = HERE.parents[2] / "configs/cures.yaml"


@contextmanager
def started(seed: int) -> Iterator[None]:
    """Marches whose u₀ and v₀ are one unit in the last place away, by signs that a seed gives.

    Every start of a problem has the same signs.  Seed 0 leaves all as it is.
    """
    from newmark_cli.newmark.march import initial_state as begin

    import_module("newmark_cli.study.compute")  # and with it all that starts a march

    def changed(problem: Any, scheme: Any) -> Any:
        of_problem = sum(ord(letter) for letter in problem.name)
        signs = np.random.default_rng([seed, of_problem]).choice([-1.0, 1.0], (2, problem.n))
        ulp = float(np.finfo(float).eps) if seed else 0.0
        u0, v0 = problem.u0 * (1 + ulp * signs[0]), problem.v0 * (1 + ulp * signs[1])
        return begin(replace(problem, u0=u0, v0=v0), scheme)

    with ExitStack() as stack:
        for name, module in list(sys.modules.items()):
            own = name.startswith("newmark_cli.")
            if own and vars(module).get("initial_state") is begin:
                stack.enter_context(patch.object(module, "initial_state", changed))
        yield


def part_of(study: Any, points: int, problems: list[str], cases: list[int]) -> Any:
    """Some cases of a study, and some step sizes of each, the first and the last among them."""
    chosen = []
    for number, case in enumerate(study.get("cases", [{}])):
        every = study | case
        if (cases and number not in cases) or (problems and every["problem"] not in problems):
            continue
        if points and len(every["h"]) > points:
            kept = np.round(np.linspace(0, len(every["h"]) - 1, points)).astype(int)
            case = case | {"h": [every["h"][k] for k in kept]}
        chosen.append(case)
    return study | {"cases": chosen}


def check(results: Path, study: str) -> tuple[int, pd.DataFrame]:
    """Exit code of `check`, and verdicts."""
    code = subprocess.run(
        [running.command(), "check", study, "--results", str(results)],
        capture_output=True,
        check=False,
    ).returncode
    return code, judge.verdicts(running.command(), results)


def main() -> int:
    parser = running.options(__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CURES)
    parser.add_argument("--starts", type=int, default=40)
    parser.add_argument("--points", type=int, default=0, help="step sizes of each case; all if 0")
    parser.add_argument("--problems", nargs="+", default=[])
    parser.add_argument("--cases", nargs="+", type=int, default=[], help="counted from 0")
    given = running.parsed(parser)
    given.results.mkdir(parents=True, exist_ok=True)
    study = part_of(
        yaml.safe_load(given.config.read_text()), given.points, given.problems, given.cases
    )
    whole = not (given.points or given.problems or given.cases)

    import newmark_cli as newmark

    config = given.results / given.config.name
    text = given.config.read_text() if whole else yaml.safe_dump(study, sort_keys=False)
    if config.exists() and config.read_text() != text:
        sys.exit(f"{config}: is of another part of the study; take another folder")
    config.write_text(text)
    codes, found = {}, {}
    for seed in range(given.starts + 1):
        folder = given.results / f"start-{seed:02}"
        done = folder / "done.json"
        if not done.exists():
            folder.mkdir(exist_ok=True)
            known = given.results / "start-00/references"
            if known.exists() and not (folder / "references").exists():
                shutil.copytree(known, folder / "references")
            with started(seed):
                newmark.run(config, results=folder, jobs=1)
            shutil.rmtree(folder / "cells", ignore_errors=True)
            done.write_text(json.dumps({"seed": seed}) + "\n")
        codes[seed], found[seed] = check(folder, study["study"])
        print(f"start {seed}: check {codes[seed]}", flush=True)
    return report(codes, found, whole)


def report(codes: dict[int, int], found: dict[int, pd.DataFrame], whole: bool) -> int:
    """Print what differs."""
    table = {}
    for seed, frame in found.items():
        frame = frame[frame["measure"] != ""]
        keys = [*judge.KEY, "formulation", "projection", "multipliers", "start"]
        named = frame[[key for key in keys if key in frame]].astype(str)
        table[seed] = pd.Series(
            frame["verdict"].map(decided).to_numpy(), index=pd.MultiIndex.from_frame(named)
        )
    verdicts = pd.DataFrame(table)
    first = verdicts[0]
    went: Counter[tuple[str, str]] = Counter()
    for seed in list(verdicts)[1:]:
        went.update(zip(first, verdicts[seed], strict=True))
    pairs = pd.Series(went).unstack(fill_value=0)
    print(f"\n{len(verdicts)} series; verdicts as it is (rows), one unit apart (columns)")
    print(pairs.to_string())
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
    return int(bool(red) or other > total / 100 or (whole and bool(failed)))


if __name__ == "__main__":
    sys.exit(main())
