"""Rounding as twins tell it beside the true one, from the same marches in 33 digits.

    python exact.py [STUDY…]; python judge.py OUT --run; python twins.py OUT

Of every error, invariant and drift in OUT with a run in ``exact/runs``: the true rounding is
|value − value of the march without rounding|.  Prints its quotient by the column `rounding`,
and the points at which it is more than ten times as large.  Exits with 1 if these are more
than 1 in 200.  What twins share they do not see: `thrown-pendulum` at h = 1e-5 drifts by a
bias of rounding that is the same in all of them.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from truth import STATISTIC, exact_run, twin

#: Quotients beyond which `check` would take rounding for something else.
MOST, SHARE = 10.0, 1 / 200
#: Numbers of the exact side have so many digits.
DIGITS = 1e-9


def compared(folder: Path) -> pd.DataFrame:
    """Rows of the CSVs with what the exact march has in their place."""
    found = []
    for file in sorted(folder.glob("*.csv")):
        run = exact_run(file.stem)
        if run is None:
            continue
        frame = pd.read_csv(file)
        frame = frame[frame["measure"].isin(["error", "invariant"]) & (frame["status"] == "ok")]
        for row in frame.to_dict("records"):
            # Norms of λ weigh constraints, which the exact side does not.
            if row["quantity"] in ("lambda", "multiplier") and len(run["lambda"]) > 1:
                continue
            for exact in twin(file.stem, row["integrator"]):
                if abs(exact["h"] / row["h"] - 1) < 1e-9:
                    value = row[STATISTIC[row["measure"]]]
                    true = exact.get(row["measure"], {}).get(row["quantity"], np.nan)
                    found.append(row | {"value": value, "true": true})
    rows = pd.DataFrame(found)
    return rows[np.isfinite(rows[["value", "true", "rounding"]]).all(axis=1)]


def main() -> int:
    rows = compared(Path(sys.argv[1]))
    off = (rows["value"] - rows["true"]).abs()
    rest = (off - DIGITS * rows["value"]).clip(lower=0)
    rows["quotient"] = (rest / rows["rounding"]).where(rest > 0, 0.0)
    told = rows.groupby(["measure", "quantity"])["quotient"]
    print(told.describe(percentiles=[0.5, 0.9, 0.99]).round(3).to_string())
    beyond = rows[~(rows["quotient"] <= MOST)]
    names = ["study", "integrator", "form", "preconditioning", "evaluation", "measure", "quantity"]
    columns = [*names, "h", "value", "true", "rounding", "quotient"]
    print(beyond.sort_values("quotient", ascending=False)[columns].head(40).to_string(index=False))
    share = len(beyond) / len(rows)
    print(f"{len(beyond)} of {len(rows)} points beyond {MOST:g} times their rounding")
    return int(share > SHARE)


if __name__ == "__main__":
    sys.exit(main())
