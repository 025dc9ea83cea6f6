"""Finds the units, signs and order in which another code writes its state, and undoes them.

A change is undone only if one change fits the rows of small step sizes and what is given does not.
λ is looked at only where u is right: of another motion it says nothing.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import linear_sum_assignment

from newmark_cli.codes.reading import Run, Runs, names_of
from newmark_cli.codes.truth import Truth
from newmark_cli.mechanisms.spatial_outputs import SpatialOutputs
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, IndexArray

#: How many of a unit that people use a metre, a radian or a radian per second is.
_LENGTHS = {1e3: "mm", 1e2: "cm", 1e-3: "km", 39.37007874: "inches", 3.280839895: "feet"}
_UNITS = {**_LENGTHS, 180 / np.pi: "degrees"}
_RATES = {30 / np.pi: "revolutions per minute"}
#: Runs of the smallest step sizes that are compared, at so many rows after the first steps.
_RUNS, _ROWS = 2, 8
#: Part of the largest value from which on a component tells something; how well a factor fits.
_TELLING, _FITS = 0.02, 0.05
#: Part of the largest value that columns in another order are off by, at least.
_SWAPPED = 1e-3
#: Error of u with which λ may be looked at, and that of columns in another order.
_RIGHT = 0.1
#: Parts of the state in the order in which they are looked at, and what sentences call them.
_WORDS = {"u": "coordinates", "v": "velocities", "lambda": "multipliers", "output": "outputs"}


@dataclass(frozen=True, eq=False)
class Undone:
    """A change of columns that a series has, with the change that undoes it."""

    part: str
    text: str
    #: (rows, size) values and the (rows, n) u beside them → what the mechanism calls them.
    change: Callable[[Array, Array], Array]


def undone(runs: Runs, truth: Truth) -> Runs:
    """The runs in the mechanism's units, signs and order, which is noted.

    Args:
        runs: What a table holds.
        truth: The solution, until after the last row.
    """
    notes, done, problem = [*runs.notes], [*runs.runs], truth.problem
    for series, part in itertools.product(dict.fromkeys(run.series for run in done), _WORDS):
        own = [run for run in done if run.series == series]
        ended = [run for run in own if run.ended][-_RUNS:]
        if not ended or not own[0].state[part].shape[1]:
            continue
        rows = [_rows(run, problem.t0) for run in ended]
        there = [_values(truth, problem, run.t[at]) for run, at in zip(ended, rows, strict=True)]
        if part in ("lambda", "output") and not _right(ended, there):
            continue
        mine = np.concatenate([run.state[part][at] for run, at in zip(ended, rows, strict=True)])
        ours = np.concatenate([values[part] for values in there])
        u = np.concatenate([run.state["u"][at] for run, at in zip(ended, rows, strict=True)])
        for found in (*_changes(part, mine, ours, problem), *_axes(part, mine, ours, u, problem)):
            if not _fits_start(part, own, problem, found):
                continue
            notes.append(f"{series}: {found.text}")
            for k, run in enumerate(done):
                if run.series == series:
                    changed = found.change(run.state[part], run.state["u"])
                    done[k] = replace(run, state={**run.state, part: changed})
            break
    return replace(runs, runs=done, notes=notes, differs=len(notes) > len(runs.notes))


def _fits_start(part: str, runs: Sequence[Run], problem: Problem, found: Undone) -> bool:
    """Whether rows at the start are no worse with a change undone: those of another motion are."""
    if part not in ("u", "v"):
        return True
    start = problem.u0 if part == "u" else problem.v0
    given = np.concatenate([run.state[part][run.t == problem.t0] for run in runs])
    undone = found.change(given, given)
    off = [np.nanmax(np.abs(rows - start), initial=0.0) for rows in (given, undone)]
    return bool(off[1] <= off[0] + 1e-9 * np.abs(start).max(initial=0.0))


def _rows(run: Run, t0: float) -> IndexArray:
    rows = np.flatnonzero(run.t > t0 + 0.1 * (run.t[-1] - t0))
    return np.asarray(rows[np.unique(np.round(np.linspace(0, len(rows) - 1, _ROWS)).astype(int))])


def _values(truth: Truth, problem: Problem, times: Array) -> dict[str, Array]:
    values = truth.at(times)
    if problem.outputs is not None:
        rows = zip(times, values["u"], values["v"], values["lambda"], strict=True)
        values["output"] = np.array([
            problem.outputs.values(problem, float(t), u, v, forces) for t, u, v, forces in rows
        ])  # fmt: skip
    return values


def _right(runs: Sequence[Run], there: Sequence[Mapping[str, Array]]) -> bool:
    off = np.nanmax(np.abs(runs[-1].state["u"][-1] - there[-1]["u"][-1]), initial=0.0)
    return bool(off < _RIGHT * np.abs(there[-1]["u"]).max())


def _changes(part: str, mine: Array, there: Array, problem: Problem) -> Iterator[Undone]:
    """Changes that fit, the plainest first."""
    known = np.isfinite(mine).all(axis=0)
    if not known.any():
        return
    mine = np.where(known, mine, 0.0)
    names = names_of(problem)[part]
    size = np.abs(there).max(axis=0)
    if part == "output":  # forces and moments have sizes of their own
        kinds = [name.rpartition(".")[0] for name in names]
        size = np.array([size[[k == kind for k in kinds]].max() for kind in kinds])
    elif part != "lambda":
        size = np.full(len(size), size.max())
    size = np.maximum(size, 1e-300)
    telling = known & (np.abs(there).max(axis=0) > _TELLING * size)
    factor = (mine * there).sum(axis=0) / np.maximum((there**2).sum(axis=0), 1e-300)
    left = np.abs(mine - factor * there).max(axis=0) / np.maximum(np.abs(mine).max(axis=0), 1e-300)
    fits = telling & (left < _FITS)
    units = {"u": _UNITS, "v": {of: f"{unit}/s" for of, unit in _UNITS.items()} | _RATES}
    for value, unit in units.get(part, {}).items():
        hit = fits & (np.abs(factor / value - 1) < 0.03)
        if not hit.any() or (np.abs(factor - 1)[telling & ~hit] > 0.1).any():
            continue
        said = f"taken to be in {unit}"
        if (hit == telling).all() and value in _LENGTHS:
            hit = known  # what tells nothing goes with the others
            text = f"{part} is {value:g} times as large, and {said}"
        else:
            text = f"{part} of {', '.join(np.array(names)[hit])} is {said}"
        yield Undone(part, text, partial(_times, np.where(hit, 1 / value, 1.0)))
    turned = fits & (np.abs(factor + 1) < _FITS)
    others = telling & ~turned
    # Of coordinates all others must be right: else the motion is another one.
    if turned.any() and (part in ("lambda", "output") or (np.abs(factor - 1)[others] < 0.1).all()):
        if turned.sum() == telling.sum():
            turned |= known & ~telling  # what tells nothing goes with the others
        text = _turned(part, [name for name, it in zip(names, turned, strict=True) if it])
        yield Undone(part, text, partial(_times, np.where(turned, -1.0, 1.0)))
    if part == "output":
        return
    cost = np.abs(mine[:, :, None] - there[:, None, :]).max(axis=0) / size
    order_of, place = linear_sum_assignment(cost)
    given, best = np.diag(cost).max(), cost[order_of, place].max()
    better = given > _SWAPPED and best < min(_FITS * given, _RIGHT)
    if known.all() and better and (place != order_of).any():
        order, listed = np.argsort(place), ", ".join(names[k] for k in place)
        text = f"{_WORDS[part]} are in the order {listed}"
        yield Undone(part, text, lambda x, u: x[:, order])


def _times(factor: Array, x: Array, u: Array) -> Array:
    return np.asarray(factor * x)


def _axes(part: str, mine: Array, there: Array, u: Array, problem: Problem) -> Iterator[Undone]:
    """Outputs that are vectors in space, given along the axes of a body."""
    outputs = problem.outputs
    if part != "output" or not isinstance(outputs, SpatialOutputs) or not np.isfinite(u).all():
        return
    found: dict[str, tuple[IndexArray, int]] = {}
    for k, first in enumerate(outputs.names):
        if not first.endswith((".omega.x", ".force.x", ".moment.x")):
            continue
        place, name = np.arange(k, k + 3), first.removesuffix(".x")
        given, right = mine[:, place], there[:, place]
        left = [np.abs(given - _along(right, u, body)).max() for body in range(len(u[0]) // 12)]
        # An angular velocity is along the axes of its own body, if that fits at all.
        own = name.removesuffix(".omega")
        body = outputs.bodies.index(own) if own in outputs.bodies else int(np.argmin(left))
        if left[body] < _FITS * np.abs(given - right).max() > _SWAPPED * np.abs(right).max():
            found[name] = place, body
    if not found:
        return

    def back(x: Array, u: Array) -> Array:
        turned = x.copy()
        for place, body in found.values():
            turned[:, place] = np.einsum("ri,rij->rj", x[:, place], _directors(u, body))
        return turned

    said = ", ".join(f"{name} along those of {outputs.bodies[k]}" for name, (_, k) in found.items())
    yield Undone(part, f"vectors are taken to be in axes of bodies: {said}", back)


def _directors(u: Array, body: int) -> Array:
    """(rows, 3, 3) of a body."""
    return u.reshape(len(u), -1, 4, 3)[:, body, 1:]


def _along(vectors: Array, u: Array, body: int) -> Array:
    """(rows, 3) components of vectors along the directors of a body."""
    return np.asarray(np.einsum("rij,rj->ri", _directors(u, body), vectors))


def _turned(part: str, names: Sequence[str]) -> str:
    if part != "output":
        return f"the sign of {'λ' if part == 'lambda' else part} is turned, of {', '.join(names)}"
    of = ", ".join(dict.fromkeys(name.rpartition(".")[0] or name for name in names))
    return f"the sign of {of} is turned: it is what acts on the other body"
