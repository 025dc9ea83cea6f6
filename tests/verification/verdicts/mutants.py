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
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Any
from unittest.mock import patch

import judge
import numpy as np
import pandas as pd
import running
import strangers
from running import decided
from strangers import LISTS
from truth import STATISTIC

ERRORS = {("error", "u"), ("error", "v"), ("error", "lambda")}
OF_MULTIPLIERS = {("error", "lambda"), ("invariant", "multiplier")}
CORRECTIONS = {
    (measure, quantity)
    for measure in ("correction", "physical_correction")
    for quantity in ("u", "v", "a", "lambda")
}


@dataclass(frozen=True)
class Mutation:
    """A change of the core.

    Attributes:
        reaches: Measures and quantities that it makes wrong; others may change in size only.
        applied: Context in which marches are wrong.
    """

    reaches: set[tuple[str, str]]
    applied: Callable[[], Any]


# -- what a march gives -------------------------------------------------------------------------


@contextmanager
def _reported(change: Callable[[Any, Any], Any]) -> Iterator[None]:
    """Multipliers as a march reports them, changed."""
    from newmark_cli.newmark.march import March

    given = March.multipliers.fget  # type: ignore[attr-defined]
    with patch.object(March, "multipliers", property(lambda march: change(march, given(march)))):
        yield


@contextmanager
def _recorded(power: float) -> Iterator[None]:
    """Recorded corrections times a power of h."""
    from newmark_cli.newmark.march import March

    advance = March.advance

    def changed(march: Any, *arguments: Any) -> Any:
        stretch = advance(march, *arguments)
        return replace(stretch, norms=stretch.norms * march.scheme.h**power)

    with patch.object(March, "advance", changed):
        yield


@contextmanager
def _conditions(power: float) -> Iterator[None]:
    """Condition numbers times a power of h."""
    from newmark_cli.study import compute, observers

    observe = observers.OBSERVERS["condition"]

    class Changed:
        def __init__(self, cell: Any, inner: Any) -> None:
            self._h, self._inner = cell.h, inner

        def __getattr__(self, name: str) -> Any:
            return getattr(self._inner, name)

        def measured(self) -> Any:
            return [
                replace(
                    one,
                    statistics=replace(
                        one.statistics, median=self._h**power * one.statistics.median
                    ),
                )
                for one in self._inner.measured()
            ]

    def changed(cell: Any, *arguments: Any) -> Any:
        return Changed(cell, observe(cell, *arguments))

    with patch.object(compute, "OBSERVERS", {**observers.OBSERVERS, "condition": changed}):
        yield


# -- what a march is given ----------------------------------------------------------------------


@contextmanager
def _given(problem: Any = None, scheme: Any = None, state: Any = None) -> Iterator[None]:
    """Marches of another problem, with another scheme, or from another state."""
    from newmark_cli.newmark.march import March

    begin = March.__init__

    def changed(march: Any, of: Any, by: Any, *arguments: Any, **others: Any) -> None:
        begin(
            march,
            problem(of) if problem else of,
            scheme(by) if scheme else by,
            *arguments,
            **others,
        )
        if state:
            state(march.state)

    with patch.object(March, "__init__", changed):
        yield


def _order_1(scheme: Any) -> Any:
    """The same scheme with γ too large by 0.1, and β by 0.06, which keeps it stable."""
    relations, found, h = scheme.relations, replace(scheme), scheme.h
    v_past, u_past = relations.v_past.copy(), relations.u_past.copy()
    v_past[2] -= 0.1 * h
    u_past[2] -= 0.06 * h**2
    found.__dict__["relations"] = replace(
        relations,
        v_from_a=relations.v_from_a + 0.1 * h,
        u_from_a=relations.u_from_a + 0.06 * h**2,
        v_past=v_past,
        u_past=u_past,
    )
    return found


def _without_a(state: Any) -> None:
    """A start that has forgotten the acceleration."""
    state.past[2:] = 0


@cache
def _function(base: Any, kind: str, row: int, column: int) -> Any:
    """A problem's function with a mistake in it."""
    from numba import njit

    tangent_x = kind == "tangent-X"
    tangent_y = kind == "tangent-Y"
    tangent_g = kind == "tangent-G"
    all_of_g = kind == "G"
    force_only = kind == "force"

    @njit(error_model="numpy")
    def changed(t, u, v, multipliers, ints, reals, force, phi, x, y, g):
        base(t, u, v, multipliers, ints, reals, force, phi, x, y, g)
        if tangent_x:
            for k in range(len(x)):
                x[k] = -x[k]
        if tangent_y:
            for k in range(len(y)):
                y[k] = -y[k]
        if tangent_g:
            for k in range(len(g)):
                g[k] = -g[k]
        if all_of_g:
            force[row] += 0.1 * g[0] * multipliers[column]
            g[0] *= 1.1
        if force_only:
            force[row] *= 1.01

    return changed


_changed: dict[tuple[int, str], tuple[Any, Any]] = {}


def _with(kind: str) -> Callable[[], Any]:
    """Marches of a problem whose function has a mistake."""

    def changed(problem: Any) -> Any:
        if (id(problem), kind) not in _changed:
            row, column = (int(at[0]) for at in (problem.pattern.g_rows, problem.pattern.g_columns))
            if kind == "force":
                row = int(np.argmax(np.abs(problem.evaluate(
                    problem.t0, problem.u0, problem.v0, np.zeros(problem.m)).force)))  # fmt: skip
            function = _function(problem.function, kind, row, column)
            found = replace(problem, function=function, code=kind)
            _changed[id(problem), kind] = problem, found
        return _changed[id(problem), kind][1]

    return lambda: _given(problem=changed)


def _size(march: Any) -> float:
    """Size of the multipliers at the start."""
    from newmark_cli.problems.index_1 import Index1

    problem = march.problem
    _, at_start = Index1(problem).accelerations(problem.t0, problem.u0, problem.v0)
    return float(np.abs(at_start).max(initial=0.0)) or 1.0


MUTATIONS = {
    "lambda-plus-1": Mutation(OF_MULTIPLIERS, lambda: _reported(lambda march, x: x + 1.0)),
    "lambda-plus-its-size": Mutation(
        OF_MULTIPLIERS, lambda: _reported(lambda march, x: x + _size(march))
    ),
    "lambda-negative": Mutation(OF_MULTIPLIERS, lambda: _reported(lambda march, x: -x)),
    "lambda-times-1-plus-h": Mutation(
        OF_MULTIPLIERS, lambda: _reported(lambda march, x: x * (1 + march.scheme.h))
    ),
    "gamma": Mutation(ERRORS, lambda: _given(scheme=_order_1)),
    "start-without-a": Mutation(ERRORS, lambda: _given(state=_without_a)),
    "tangent-X": Mutation(ERRORS | CORRECTIONS, _with("tangent-X")),
    "tangent-Y": Mutation(ERRORS | CORRECTIONS, _with("tangent-Y")),
    "tangent-G": Mutation(ERRORS | CORRECTIONS, _with("tangent-G")),
    "wrong-G": Mutation(ERRORS | CORRECTIONS, _with("G")),
    "wrong-force": Mutation(ERRORS, _with("force")),
    "corrections-times-h": Mutation(CORRECTIONS, lambda: _recorded(1.0)),
    "corrections-over-h": Mutation(CORRECTIONS, lambda: _recorded(-1.0)),
    "condition-times-h": Mutation({("condition", "jacobian")}, lambda: _conditions(1.0)),
    "condition-over-root-h": Mutation({("condition", "jacobian")}, lambda: _conditions(-0.5)),
}

# -- series with and without ----------------------------------------------------------------------


def judged(rows: pd.DataFrame, alike: str) -> dict[tuple[str, ...], tuple[Any, Any, Any]]:
    """Series → h and values, large steps first, and what is said of it; `alike` names a problem."""
    import newmark_cli as newmark

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
    if not np.isfinite(ratio).all():
        return np.nan
    return float(np.polyfit(np.log(h), ratio, 1)[0])


def compared(name: str, mutation: Mutation, clean: Any, wrong: Any) -> Iterator[dict[str, Any]]:
    """What became of each series that a mutation reaches."""
    for key, (h, values, fit) in wrong.items():
        if (fit["measure"], fit["quantity"]) not in mutation.reaches or key not in clean:
            continue
        _, before, fit_before = clean[key]
        changed = shift(h, values, before)
        tolerance = fit["tolerance"] if np.isfinite(fit["tolerance"]) else 0.2
        # Who takes a series that noise bends to what theory says has made nothing wrong.
        off = fit_before["slope"] - fit["expected"]
        mended = abs(off + changed) < abs(off)
        yield {
            "mutation": name,
            "series": " ".join(filter(None, map(str, key))),
            "wrong": abs(changed) > 2 * tolerance and not mended,
            "verdict": decided(fit["verdict"]),
            "without": decided(fit_before["verdict"]),
            "shift": changed,
            "slope": fit["slope"],
            "expected": fit["expected"],
            "h": h,
            "values": values,
            "before": before,
            "said": fit["reason"],
        }


def main() -> int:
    parser = running.options(__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50, help="mechanisms of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="+", choices=strangers.KINDS, default=[*strangers.KINDS])
    parser.add_argument("--mutations", nargs="+", choices=MUTATIONS, default=[*MUTATIONS])
    given = running.parsed(parser)
    import newmark_cli as newmark

    found: list[dict[str, Any]] = []
    every = strangers.strangers(given.count, given.seed, given.kinds)
    for number, stranger in enumerate(every):
        # Every mutation meets every kind and every list.
        name = given.mutations[number % len(given.mutations)]
        mutation = MUTATIONS[name]
        steps = list(LISTS)[(number // len(given.mutations) + number) % len(LISTS)]
        paths = strangers.write(given.results, stranger)
        path = next(path for path in paths if path.stem == f"{stranger.name}-{steps}")
        try:
            clean = newmark.run(path, results=given.results / "results", jobs=1)
            with ExitStack() as stack:
                stack.enter_context(mutation.applied())
                wrong = newmark.run(path, jobs=1)
        except newmark.InputError as error:
            print(f"{path.name}, {name}: {error}")
            continue
        pair = (judged(rows, stranger.name) for rows in (clean, wrong))
        found += compared(name, mutation, *pair)
        print(f"{stranger.name}, {name}, {steps}", file=sys.stderr, flush=True)
    return report(pd.DataFrame(found))


def report(frame: pd.DataFrame) -> int:
    """Print verdicts by mutation, and what passes."""
    frame["kind"] = np.where(frame["wrong"], "wrong", "as good")
    print(pd.crosstab([frame["mutation"], frame["kind"]], frame["verdict"]).to_string())
    passed = frame[frame["wrong"] & (frame["verdict"] == "pass")]
    print(f"\nwrong series: {int(frame['wrong'].sum())}; of them pass: {len(passed)}")
    for _, row in passed.iterrows():
        print(f"{row['mutation']}: {row['series']}")
        print(
            f"    slope {row['slope']:.3f} for {row['expected']}, moved by {row['shift']:.2f}; "
            f"without the mutation {row['without']}; said: {row['said']}"
        )
        for what in ("h", "values", "before"):
            print(f"    {what:7}" + " ".join(f"{x:.3g}" for x in row[what]))
    return 1 if len(passed) else 0


if __name__ == "__main__":
    sys.exit(main())
