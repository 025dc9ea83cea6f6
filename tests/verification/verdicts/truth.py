"""What is true of every series in a results folder: writes truth.csv.

Nothing here comes from the package.  What each judgement rests on:

error         the same scheme at the same step sizes in numbers of 33 digits (exact.py):
              its errors are truncation alone, their local orders are the truth, and what
              the run in double precision has besides is rounding, point by point
condition     the Jacobian written out from the form's rows, at states of the 33-digit run
              and at the start with much smaller step sizes (conditions.py)
sensitivity   blocks of the same inverse
correction    rounding by definition: the orders of Section 3 of the paper, unless exact
              zeros, cells that did not converge, or steps that do not resolve the motion
              make a series that has none
invariant     no order is predicted; the 33-digit run says whether it converges

    python truth.py RESULTS [--out truth.csv]
"""

import argparse
import functools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import conditions
import levels
import named
import numpy as np
import pandas as pd
from exact import HERE, RUNS, SOURCE

ORDER, FLOOR, WRONG = "order", "floor", "wrong"
EARLY, FEW, NONE = "preasymptotic", "too few", "nothing predicted"
KEY = [
    "study", "problem", "integrator", "form", "preconditioning", "evaluation", "quantity",
    "measure", "row_block", "start",
]  # fmt: skip
COLUMNS = [*KEY, "label", "true_order", "h_low", "h_high", "accept", "reason"]

#: Numbers in a row, of whatever kind.
Numbers = Sequence[Any] | np.ndarray[Any, Any]
#: Studies whose constraints lose rank on the way: orders of rounding there are another matter.
SINGULAR = ("parallelogram", "folding-slider")
#: What is drawn of each measure.
STATISTIC = {
    "correction": "rms", "physical_correction": "rms", "condition": "median",
    "sensitivity": "median", "error": "last", "invariant": "max", "tolerance": "met",
}  # fmt: skip
UNDECIDED = "undecided"
#: Verdicts that a label allows.
ACCEPT = {
    ORDER: "pass", FLOOR: "pass", WRONG: "not converging|miss",
    EARLY: "not asymptotic|too few points", FEW: "too few points|not asymptotic", NONE: "shown",
}  # fmt: skip
#: Table 1 of the paper, two columns continued.
CONDITION = {
    "none": dict(zip(conditions.FORMS, (-2, -3, -4, -3, -2, -2, -2), strict=True)),
    "left": dict(zip(conditions.FORMS, (-2, -2, -2, -1, 0, -2, -1), strict=True)),
    "right": dict.fromkeys(conditions.FORMS, -2),
    "optimal": dict.fromkeys(conditions.FORMS, 0),
}
DIRECT = {"u": 0, "v": -1, "a": -2, "lambda": -2}
COMPENSATED = {"u": 1, "v": 0, "a": -1, "lambda": -1}
SCALE = {"u": 0, "v": -1, "a": -2, "lambda": -2}


class Series:
    """One series: step sizes from large to small, and the statistic at each."""

    def __init__(self, key: dict[str, Any], rows: pd.DataFrame) -> None:
        self.key = key
        rows = rows.sort_values("h", ascending=False)
        columns = ("h", STATISTIC[key["measure"]], "zeros", "steps")
        self.h, self.values, self.zeros, self.steps = (
            rows[name].to_numpy(float) for name in columns
        )
        self.ok = (rows["status"] == "ok").to_numpy()
        self.orders = local(self.h, self.values)


def local(h: Numbers, values: Numbers) -> np.ndarray:
    with np.errstate(all="ignore"):
        rise, run = (np.diff(np.log(np.asarray(x, float))) for x in (values, h))
        return np.asarray(rise / run)


def nothing(reason: str, also: str = "") -> dict[str, Any]:
    """The verdict on a series of which nothing is predicted."""
    return judged(NONE, math.nan, [], reason, also)


def judged(label: str, order: float, h: Numbers, reason: str, also: str = "") -> dict[str, Any]:
    words = [*ACCEPT[label].split("|"), *filter(None, also.split("|"))]
    # One word for both reasons why nothing can be said.
    words += [UNDECIDED] if {"not asymptotic", "too few points"} & set(words) else []
    low, high = (min(h), max(h)) if len(h) else (math.nan, math.nan)
    return {
        "label": label, "true_order": order, "h_low": low, "h_high": high,
        "accept": "|".join(dict.fromkeys(words)), "reason": reason,
    }  # fmt: skip


@functools.cache
def exact_run(study: str) -> dict[str, Any] | None:
    path = RUNS / f"{study}.json"
    found: dict[str, Any] | None = json.loads(path.read_text()) if path.exists() else None
    return found


def twin(study: str, integrator: str) -> list[dict[str, Any]]:
    """The 33-digit runs of a study and an integrator, large steps first."""
    found = exact_run(study)
    runs = [run for run in found["runs"] if run["integrator"] == integrator] if found else []
    return sorted(runs, key=lambda run: -run["h"])


def same(run: dict[str, Any], h: float) -> bool:
    """Whether a run has this step size."""
    return abs(run["h"] / h - 1) < 1e-9


def longest(flags: Numbers) -> slice:
    """The longest stretch of True."""
    best, start = slice(0, 0), 0
    for i, flag in enumerate([*flags, False]):
        if not flag:
            if i - start > best.stop - best.start:
                best = slice(start, i)
            start = i + 1
    return best


@functools.cache
def at_rest(study: str) -> bool:
    """Whether nothing moves but by rounding."""
    found = exact_run(study)
    return bool(found and found.get("v") and max(map(abs, found["v"])) < 1e-20)


def order_of(integrator: str) -> int:
    """Order that theory gives to u, v and, where damped, λ."""
    method, *values = integrator.split()
    return 1 if method == "bdf1" or (method == "newmark" and values[1] != "gamma=0.5") else 2


def error(series: Series) -> dict[str, Any]:
    key = series.key
    p = order_of(key["integrator"])
    runs = twin(key["study"], key["integrator"])
    exact_h = np.array([run["h"] for run in runs])
    exact_e = np.array([run.get("error", {}).get(key["quantity"], math.nan) for run in runs])
    h, e = series.h, series.values
    if not np.isfinite(exact_e).any():
        also = "incomplete|not asymptotic|too few points"
        return nothing("no 33-digit run to compare with", also)
    truth = np.array([exact_e[np.argmin(abs(exact_h - x))] for x in h])
    if at_rest(key["study"]) or (e == 0).all():
        return judged(FEW, p, [], "nothing moves: rounding, or zero", "shown|incomplete")
    q = local(exact_h, exact_e)
    also = "" if series.ok.all() else "incomplete|shown"
    if key["quantity"] == "lambda" and key["integrator"] == "newmark beta=0.25 gamma=0.5":
        # Nothing damps an error of λ here: theory does not promise what truncation gives.
        also += "|shown"
    if not np.isfinite(e).any():
        return judged(FEW, p, [], "no values: the reference could not be computed", "incomplete")
    values = " ".join(f"{x:.3g}/{y:.3g}" for x, y in zip(e, truth, strict=True))
    final = q[-1] if len(q) else math.nan
    reason = f"measured/truncation {values}; last local order of truncation {final:.3f}"
    if np.nanmax(truth) < 1e-15 and np.nanmax(e) < 1e-3:
        return judged(FEW, p, [], f"all rounding; {reason}", "shown")
    if np.isfinite(final) and final < 0.4 and exact_e[-1] > 1e-12:
        return judged(WRONG, final, h, f"truncation does not converge; {reason}")
    if abs(final - p) > 0.1:
        # Not yet settled: another order, or steps too large?
        if len(q) > 2 and abs(q[-2] - final) < 0.05 and abs(final - round(final)) < 0.05:
            return judged(WRONG, final, h, f"another order; {reason}", also)
        return judged(EARLY, p, [], f"truncation is not asymptotic; {reason}", f"shown|{also}")
    # Points at which truncation is asymptotic, and points that show it.
    good = np.zeros(len(h), bool)
    for i, x in enumerate(h):
        k = int(np.argmin(abs(exact_h - x)))
        near = [q[j] for j in (k - 1, k) if 0 <= j < len(q)]
        # The next smaller step counts more than the larger one: a head may end here.
        good[i] = abs((q[k] if k < len(q) else near[-1]) - p) <= 0.1
    clean = abs(e - truth) <= 0.12 * truth
    # Where the tail of the list is within 0.2 of the order and near truncation, a pass is fair.
    close = np.abs(local(h, e) - p) <= 0.2
    if len(h) >= 3 and close[-2:].all() and (abs(e - truth) <= 0.3 * truth)[-3:].all():
        also += "|pass"
    # A step that missed its tolerance may still be right: what counts is the error.
    stretch = longest(good & clean)
    points = h[stretch]
    if len(points) >= 3:
        at_end = stretch.stop == len(h)
        return judged(ORDER if at_end else FLOOR, p, points, reason, also)
    with np.errstate(invalid="ignore"):
        last, first, least = e[-1], e[0], np.nanmin(e)
    grows = np.isfinite(last) and (last >= 0.5 * first or last > 1)
    if grows and len(h) >= 3 and last > 3 * least:
        reason = f"rounding: ends above where it starts; {reason}"
        return judged(WRONG, math.nan, h, reason, "too few points|not asymptotic")
    if len(h) < 3:
        return judged(FEW, p, points, reason, also)
    if clean.all() or (stretch.stop == len(h) and not good.all()):
        return judged(EARLY, p, points, reason, also)
    growing = "|not converging" if last > 3 * least else ""
    return judged(FEW, p, points, f"{len(points)} points before rounding; {reason}", also + growing)


def physical(key: dict[str, Any]) -> dict[str, int]:
    return COMPENSATED if key["evaluation"] == "compensated" else DIRECT


def correction(series: Series) -> dict[str, Any]:
    key = series.key
    p = physical(key)[key["quantity"]]
    if key["measure"] == "correction" and key["preconditioning"] in ("right", "optimal"):
        p -= SCALE[key["quantity"]]
    h, values, q = series.h, series.values, series.orders
    also = "" if series.ok.all() else "incomplete"
    text = "local orders " + " ".join(f"{x:.2f}" for x in q)
    if (values == 0).all():
        return judged(FEW, p, [], "exact zeros at every h", "incomplete|shown")
    share = series.zeros / np.maximum(series.steps, 1)
    if (share > 0.9).any():
        reason = f"exact zeros at {share.max():.0%} of the steps; {text}"
        return judged(FEW, p, [], reason, "incomplete|shown")
    if len(h) < 3:
        return judged(FEW, p, h, text, also)
    if at_rest(key["study"]):
        return judged(FEW, p, [], f"nothing moves; {text}", "shown|incomplete|miss")
    model, ratio = expected_level(series)
    typical = float(np.median(ratio[-2:])) if np.isfinite(ratio).all() else math.nan
    if 0.05 <= typical <= 20:
        m = local(h, model)
        text += "; measured/model " + " ".join(f"{x:.2g}" for x in ratio)
        # A point counts where the level itself has its order towards the next smaller step.
        good = np.append(np.abs(m - p) <= 0.1, abs(m[-1] - p) <= 0.1)
        best = float(np.median(ratio[good])) if good.any() else typical
        clean = np.abs(np.log(ratio / best)) <= math.log(2)
        stretch = longest(good & clean & series.ok)
        points = h[stretch]
        if len(points) >= 3:
            if stretch.stop == len(h):
                return judged(ORDER, p, points, text, also)
            reason = f"tail is above rounding; {text}"
            return judged(FLOOR, p, points, reason, also + "|miss|not asymptotic")
        singular = key["study"] in SINGULAR
        if not singular and (not good[-1] or (clean[-1] and not good.all())):
            return judged(EARLY, p, points, text, also)
        why = "passes a singular position" if singular else "not the rounding of a step"
        return judged(WRONG, math.nan, h, f"{why}; {text}", also + "|not asymptotic")
    # No level to compare with: nothing moves, or the run is not the same one.
    fine = np.abs(q - p) <= 0.25
    if fine.all():
        return judged(ORDER, p, h, text, also)
    quiet = "nothing moves; " if np.nanmax(ratio) < 0.05 or not np.isfinite(ratio).all() else ""
    reason = f"not the rounding of a step; {quiet}{text}"
    return judged(WRONG, math.nan, h, reason, also + "|not asymptotic|too few points|incomplete")


def expected_level(series: Series) -> tuple[np.ndarray, np.ndarray]:
    """The level of rounding at each step size, in the units of the series, and measured over it."""
    key = series.key
    found = []
    for h in series.h:
        squares = []
        for state in run_matrices(key["study"], key["integrator"], h):
            try:
                level = levels.corrections(
                    key["form"], key["integrator"], h, key["evaluation"] == "compensated", state
                )
            except np.linalg.LinAlgError:
                continue
            squares.append(level[key["quantity"]] ** 2)
        found.append(math.sqrt(float(np.mean(squares))) if squares else math.nan)
    model = np.array(found)
    if key["measure"] == "correction":
        names = [*conditions.FORMS[key["form"]][0], "lambda"]
        how, place = (key["form"], key["preconditioning"], key["integrator"]), key["quantity"]
        model /= [conditions.factors(*how, h)[1][names.index(place)] for h in series.h]
    with np.errstate(all="ignore"):
        return model, series.values / model


def four(state: dict[str, np.ndarray]) -> list[np.ndarray]:
    """M, X, Y, G."""
    return [state[name] for name in "MXYG"]


@functools.cache
def start_matrices(study: str) -> dict[str, np.ndarray] | None:
    found = exact_run(study)
    if found is None:
        return None
    state = [0.0, *found["u0"], *found["v0"], *found["lambda0"]]
    return conditions.matrices(SOURCE.with_suffix(""), RUNS / f"{study}.txt", [state])[0]


@functools.cache
def run_matrices(study: str, integrator: str, h: float) -> list[dict[str, np.ndarray]]:
    for run in twin(study, integrator):
        if same(run, h) and run["states"]:
            return conditions.matrices(SOURCE.with_suffix(""), RUNS / f"{study}.txt", run["states"])
    return []


def smooth(series: Series, p: float, truth: np.ndarray, far: float) -> dict[str, Any]:
    """Judge a series without scatter.

    Args:
        series: The series.
        p: Order by theory.
        truth: Values without rounding at the same step sizes, NaN where unknown.
        far: Order found at much smaller step sizes.
    """
    h, values, q = series.h, series.values, series.orders
    also = "" if series.ok.all() else "incomplete"
    ratio = values / truth
    reason = (
        "local orders " + " ".join(f"{x:.3f}" for x in q) + f"; at much smaller h {far:.4f}"
        + "; measured/true " + " ".join(f"{x:.3g}" for x in ratio)
    )  # fmt: skip
    if abs(far - p) > 0.02:
        return judged(WRONG, far, h, f"the asymptotic order is another; {reason}", also)
    if len(h) < 3:
        return judged(FEW, p, h, reason, also)
    fine = np.abs(q - p) <= 0.1
    flags = np.zeros(len(h), bool)
    stretch = longest(fine)
    if stretch.stop > stretch.start:
        flags[stretch.start : stretch.stop + 1] = True
    points = h[flags]
    if len(points) >= 3:
        return judged(ORDER if flags[-1] else FLOOR, p, points, reason, also)
    off = np.isfinite(truth) & (np.abs(ratio - 1) > 0.2)
    if off.any():
        reason = f"states of the run are rounding; {reason}"
        return judged(WRONG, math.nan, h, reason, also + "|not asymptotic|too few points")
    return judged(EARLY, p, points, reason, also)


def far_order(function: Any) -> float:
    steps = (1e-7, 1e-8, 1e-9)
    return float(local(steps, [function(h) for h in steps])[-1])


def condition(series: Series) -> dict[str, Any]:
    key = series.key
    form, scaling, integrator = key["form"], key["preconditioning"], key["integrator"]
    p = CONDITION[scaling][form]
    start = start_matrices(key["study"])
    if start is None:
        return nothing("no 33-digit run")
    far = far_order(lambda h: conditions.condition(form, scaling, integrator, h, *four(start)))
    truth = []
    for h in series.h:
        states = [start] if key["start"] == "yes" else run_matrices(key["study"], integrator, h)
        how = (form, scaling, integrator, h)
        found = [conditions.condition(*how, *four(state)) for state in states]
        truth.append(float(np.median(found)) if found else math.nan)
    return smooth(series, p, np.array(truth), far)


def sensitivity(series: Series) -> dict[str, Any]:
    key = series.key
    start = start_matrices(key["study"])
    if start is None:
        return nothing("no 33-digit run")

    how = (key["form"], key["preconditioning"], key["integrator"])

    def at(h: float) -> float:
        return conditions.block(*how, h, key["quantity"], key["row_block"], *four(start))

    far = far_order(at)
    return smooth(series, float(round(far)), np.array([at(h) for h in series.h]), far)


def invariant(series: Series) -> dict[str, Any]:
    key = series.key
    runs = twin(key["study"], key["integrator"])
    h, values = series.h, series.values
    known = [[run["invariant"][key["quantity"]] for run in runs if same(run, x)] for x in h]
    truth = [found[0] if found else math.nan for found in known]
    pairs = " ".join(f"{x:.3g}/{y:.3g}" for x, y in zip(values, truth, strict=True))
    reason = f"measured/truncation {pairs}"
    also = "" if series.ok.all() else "incomplete"
    if key["quantity"] == "position" or not np.isfinite(values).any():
        return nothing(f"rounding; {reason}", also)
    last, first = values[-1], values[0]
    if key["quantity"] == "multiplier" and len(h) > 2 and (last > 0.5 * first) and last > 1e-6:
        why = "truncation" if truth[-1] > 0.5 * truth[0] else "rounding"
        reason = f"multipliers miss what u and v imply, by {why}; {reason}"
        return judged(WRONG, math.nan, h, reason, "shown")
    if last > 0.5 * first and last > 1e-6:
        return nothing(f"does not fall; {reason}", "not converging")
    return nothing(reason, f"pass|{also}|not asymptotic|too few points|not converging")


JUDGES = {
    "error": error, "correction": correction, "physical_correction": correction,
    "condition": condition, "sensitivity": sensitivity, "invariant": invariant,
}  # fmt: skip


def all_series(folder: Path) -> list[Series]:
    """Every series of a results folder."""
    found = []
    for file in sorted(folder.glob("*.csv")):
        if file.stem == "slopes":
            continue
        frame = pd.read_csv(file, dtype={"row_block": str})
        if frame["measure"].isna().all():
            frame = unmeasured(frame)
        frame = frame[frame["measure"].notna()].copy()
        frame["row_block"] = frame["row_block"].astype(object).fillna("")
        frame["start"] = np.where(frame["steps"] == 0, "yes", "no")
        for values, rows in frame.groupby(KEY, sort=False):
            found.append(Series(dict(zip(KEY, values, strict=True)), rows))
    return found


def unmeasured(frame: pd.DataFrame) -> pd.DataFrame:
    """A study of errors whose reference could not be computed, with the errors it would have."""
    found: list[dict[Any, Any]] = []
    for row in frame.to_dict("records"):
        for run in twin(row["study"], row["integrator"]):
            if same(run, row["h"]):
                for quantity, value in run.get("error", {}).items():
                    new = {"quantity": quantity, "measure": "error", "last": value, "zeros": 0}
                    found.append(dict(row) | new)
    return pd.DataFrame(found, columns=frame.columns) if found else frame


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="?", default=HERE / "results")
    parser.add_argument("--out", type=Path, default=HERE / "truth.csv")
    given = parser.parse_args()
    rows = []
    known = {entry.problem: entry for entry in named.NAMED}
    for series in all_series(given.results):
        if series.key["study"] == named.STUDY:
            given_one = known[series.key["problem"]]
            h = given_one.span or given_one.h
            verdict = judged(
                given_one.label, given_one.order, h, given_one.reason, given_one.accept
            )
        else:
            judge = JUDGES.get(series.key["measure"])
            verdict = judge(series) if judge else nothing("no order in h")
        rows.append({**series.key, **verdict})
    frame = pd.DataFrame(rows)[COLUMNS]
    frame.to_csv(given.out, index=False)
    print(pd.crosstab(frame["measure"], frame["label"]).to_string())


if __name__ == "__main__":
    main()
