"""Cores and problems that are wrong on purpose: what of them `check` lets pass.

    python mutants.py OUT [--count 50] [--seed 1] [--kinds four-bar …] [--mutations NAME …]

Marches the mechanisms of strangers.py, each with one mutation of the core or of its problem, and
one of the lists of step sizes, with and without it.  A mutation is made in this process, in what a
march is given or gives; references stay as they are.  So the truth is known by
construction: a series that the mutation reaches, and whose order it takes away from the predicted
one by more than twice the tolerance, is wrong.  Prints verdicts of these series by mutation, and
every one that passes, with its values and those without the mutation.  Exits with 1 if any does.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import judge
import numpy as np
import pandas as pd
import strangers
from judge import decided
from numba import njit
from strangers import LISTS
from truth import STATISTIC

import newmark_cli as newmark
from newmark_cli.newmark.march import March
from newmark_cli.problems.index_1 import Index1
from newmark_cli.study import compute, observers

ERRORS = {("error", "u"), ("error", "v"), ("error", "lambda")}
OF_MULTIPLIERS = {("error", "lambda"), ("invariant", "multiplier")}
CORRECTIONS = {
    (measure, quantity)
    for measure in ("correction", "physical_correction")
    for quantity in ("u", "v", "a", "lambda")
}

# -- what a march gives -------------------------------------------------------------------------


def reported(change: Callable[[Any, Any], Any]) -> AbstractContextManager[Any]:
    """Multipliers as a march reports them, changed."""
    given = March.multipliers.fget  # type: ignore[attr-defined]
    return patch.object(March, "multipliers", property(lambda march: change(march, given(march))))


def recorded(power: float) -> AbstractContextManager[Any]:
    """Recorded corrections times a power of h."""
    advance = March.advance

    def changed(march: Any, *arguments: Any) -> Any:
        stretch = advance(march, *arguments)
        return replace(stretch, norms=stretch.norms * march.scheme.h**power)

    return patch.object(March, "advance", changed)


def conditions(power: float) -> AbstractContextManager[Any]:
    """Condition numbers times a power of h."""
    observe = observers.OBSERVERS["condition"]

    def changed(cell: Any, *arguments: Any) -> Any:
        observer = observe(cell, *arguments)
        measured = observer.measured

        def times() -> Any:
            for one in measured():
                median = cell.h**power * one.statistics.median
                yield replace(one, statistics=replace(one.statistics, median=median))

        observer.measured = lambda: [*times()]
        return observer

    return patch.object(compute, "OBSERVERS", {**observers.OBSERVERS, "condition": changed})


# -- what a march is given ----------------------------------------------------------------------


@contextmanager
def given(problem: Any = None, scheme: Any = None, state: Any = None) -> Iterator[None]:
    """Marches of another problem, with another scheme, or from another state."""
    begin = March.__init__

    def changed(march: Any, of: Any, by: Any, *arguments: Any, **others: Any) -> None:
        of, by = problem(of) if problem else of, scheme(by) if scheme else by
        begin(march, of, by, *arguments, **others)
        if state:
            state(march.state)

    with patch.object(March, "__init__", changed):
        yield


def order_1(scheme: Any) -> Any:
    """The same scheme with γ too large by 0.1, and β by 0.06, which keeps it stable."""
    relations, found, h = scheme.relations, replace(scheme), scheme.h
    v_past, u_past = relations.v_past.copy(), relations.u_past.copy()
    v_past[2] -= 0.1 * h
    u_past[2] -= 0.06 * h**2
    found.__dict__["relations"] = replace(
        relations, v_from_a=relations.v_from_a + 0.1 * h, v_past=v_past,
        u_from_a=relations.u_from_a + 0.06 * h**2, u_past=u_past,
    )  # fmt: skip
    return found


def without_a(state: Any) -> None:
    """A start that has forgotten the acceleration."""
    state.past[2:] = 0


@cache
def function(base: Any, kind: str, row: int, column: int) -> Any:
    """A problem's function with a mistake in it."""
    of_x, of_y, of_g, all_of_g = (
        kind == name for name in ("tangent-X", "tangent-Y", "tangent-G", "G")
    )

    @njit(error_model="numpy")
    def changed(t, u, v, multipliers, ints, reals, force, phi, x, y, g):
        base(t, u, v, multipliers, ints, reals, force, phi, x, y, g)
        if of_x:
            x[:] = -x
        elif of_y:
            y[:] = -y
        elif of_g:
            g[:] = -g
        elif all_of_g:
            force[row] += 0.1 * g[0] * multipliers[column]
            g[0] *= 1.1
        else:
            force[row] *= 1.01

    return changed


_changed: dict[tuple[int, str], tuple[Any, Any]] = {}


def mistaken(kind: str) -> AbstractContextManager[Any]:
    """Marches of a problem whose function has a mistake."""

    def changed(problem: Any) -> Any:
        if (id(problem), kind) not in _changed:
            row, column = (int(at[0]) for at in (problem.pattern.g_rows, problem.pattern.g_columns))
            if kind == "force":
                at_start = problem.evaluate(problem.t0, problem.u0, problem.v0, np.zeros(problem.m))
                row = int(np.argmax(np.abs(at_start.force)))
            wrong = function(problem.function, kind, row, column)
            _changed[id(problem), kind] = problem, replace(problem, function=wrong, code=kind)
        return _changed[id(problem), kind][1]

    return given(problem=changed)


def size(march: Any) -> float:
    """Size of the multipliers at the start."""
    problem = march.problem
    _, at_start = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    return float(np.abs(at_start).max(initial=0.0)) or 1.0


Mutation = tuple[set[tuple[str, str]], Callable[[], AbstractContextManager[Any]]]
#: Name → measures and quantities that a mutation makes wrong, while others may change in size
#: only, and a context in which marches are wrong.
MUTATIONS: dict[str, Mutation] = {
    "lambda-plus-1": (OF_MULTIPLIERS, lambda: reported(lambda march, x: x + 1.0)),
    "lambda-plus-its-size": (OF_MULTIPLIERS, lambda: reported(lambda march, x: x + size(march))),
    "lambda-negative": (OF_MULTIPLIERS, lambda: reported(lambda march, x: -x)),
    "lambda-times-1-plus-h": (
        OF_MULTIPLIERS, lambda: reported(lambda march, x: x * (1 + march.scheme.h)),
    ),
    "gamma": (ERRORS, lambda: given(scheme=order_1)),
    "start-without-a": (ERRORS, lambda: given(state=without_a)),
    "tangent-X": (ERRORS | CORRECTIONS, lambda: mistaken("tangent-X")),
    "tangent-Y": (ERRORS | CORRECTIONS, lambda: mistaken("tangent-Y")),
    "tangent-G": (ERRORS | CORRECTIONS, lambda: mistaken("tangent-G")),
    "wrong-G": (ERRORS | CORRECTIONS, lambda: mistaken("G")),
    "wrong-force": (ERRORS, lambda: mistaken("force")),
    "corrections-times-h": (CORRECTIONS, lambda: recorded(1.0)),
    "corrections-over-h": (CORRECTIONS, lambda: recorded(-1.0)),
    "condition-times-h": ({("condition", "jacobian")}, lambda: conditions(1.0)),
    "condition-over-root-h": ({("condition", "jacobian")}, lambda: conditions(-0.5)),
}  # fmt: skip

# -- series with and without ----------------------------------------------------------------------


def judged(rows: pd.DataFrame, alike: str) -> dict[tuple[str, ...], tuple[Any, Any, Any]]:
    """Series → h and values, large steps first, and what is said of it; `alike` names a problem."""
    fits, found = newmark.slopes(rows), {}
    named = [key for key in judge.KEY if key not in ("study", "problem")]
    for frame in (fits, rows):
        frame[named] = frame[named].astype(object).fillna("").astype(str)
    by_key = dict(iter(rows.groupby(named, sort=False)))
    for _, fit in fits.iterrows():
        key = tuple(fit[named])
        if fit["measure"] in STATISTIC and key in by_key:
            points = by_key[key].sort_values("h", ascending=False)
            values = points[STATISTIC[fit["measure"]]].to_numpy(float)
            found[alike, *key] = points["h"].to_numpy(float), values, fit
    return found


def shift(h: Any, values: Any, before: Any) -> float:
    """How much the order changes from one series to another."""
    if len(h) < 2 or len(values) != len(before):
        return np.nan
    with np.errstate(all="ignore"):
        ratio = np.log(values / before)
    return float(np.polyfit(np.log(h), ratio, 1)[0]) if np.isfinite(ratio).all() else np.nan


def compared(name: str, clean: Any, wrong: Any) -> Iterator[dict[str, Any]]:
    """What became of each series that a mutation reaches."""
    for key, (h, values, fit) in wrong.items():
        if (fit["measure"], fit["quantity"]) not in MUTATIONS[name][0] or key not in clean:
            continue
        _, before, fit_before = clean[key]
        changed = shift(h, values, before)
        tolerance = fit["tolerance"] if np.isfinite(fit["tolerance"]) else 0.2
        # Who takes a series that noise bends to what theory says has made nothing wrong.
        off = fit_before["slope"] - fit["expected"]
        mended = abs(off + changed) < abs(off)
        yield {
            "mutation": name, "series": " ".join(filter(None, map(str, key))),
            "kind": "wrong" if abs(changed) > 2 * tolerance and not mended else "as good",
            "verdict": decided(fit["verdict"]), "without": decided(fit_before["verdict"]),
            "shift": changed, "slope": fit["slope"], "expected": fit["expected"],
            "h": h, "values": values, "before": before, "said": fit["reason"],
        }  # fmt: skip


def main() -> int:
    parser = judge.options(__doc__)
    parser.add_argument("--count", type=int, default=50, help="mechanisms of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=strangers.KINDS, default=[*strangers.KINDS])
    parser.add_argument("--mutations", nargs="+", choices=MUTATIONS, default=[*MUTATIONS])
    asked = parser.parse_args()
    found: list[dict[str, Any]] = []
    every = strangers.strangers(asked.count, asked.seed, asked.kinds)
    for number, stranger in enumerate(every):
        # Every mutation meets every kind and every list.
        name = asked.mutations[number % len(asked.mutations)]
        steps = list(LISTS)[(number // len(asked.mutations) + number) % len(LISTS)]
        path = strangers.write(asked.results, stranger)[steps]
        try:
            clean = newmark.run(path, results=asked.results / "results", jobs=1)
            with MUTATIONS[name][1]():
                wrong = newmark.run(path, jobs=1)
        except newmark.InputError as error:
            print(f"{path.name}, {name}: {error}")
            continue
        found += compared(name, *(judged(rows, stranger.name) for rows in (clean, wrong)))
        print(f"{stranger.name}, {name}, {steps}", file=sys.stderr, flush=True)
    return report(pd.DataFrame(found))


def report(frame: pd.DataFrame) -> int:
    """Print verdicts by mutation, and what passes."""
    print(pd.crosstab([frame["mutation"], frame["kind"]], frame["verdict"]).to_string())
    wrong = frame[frame["kind"] == "wrong"]
    passed = wrong[wrong["verdict"] == "pass"]
    print(f"\nwrong series: {len(wrong)}; of them pass: {len(passed)}")
    for _, row in passed.iterrows():
        print(f"{row['mutation']}: {row['series']}")
        print(
            f"    slope {row['slope']:.3f} for {row['expected']}, moved by {row['shift']:.2f}; "
            f"without the mutation {row['without']}; said: {row['said']}"
        )
        for what in ("h", "values", "before"):
            print(f"    {what:7}" + " ".join(f"{x:.3g}" for x in row[what]))
    return int(len(passed) > 0)


if __name__ == "__main__":
    sys.exit(main())
