"""Tables of what codes computed, and what `judge` says of them; the bench of causes."""

import importlib.util
import json
import sys
from contextlib import contextmanager
from unittest import mock

import numpy as np
import pandas as pd
from pages import ROOT

import newmark_cli as newmark
from newmark_cli.codes import changes
from newmark_cli.codes.truth import Truth

THROWN = str(ROOT / "docs/examples/thrown-pendulum.yaml")
CART = {
    "points": {
        "W": {"fixed": [-1, 0]},
        "C": {"at": [0, 0], "mass": 1.4, "velocity": [0.5, 0]},
        "P": {"at": [0.3, -0.4], "mass": 0.6, "velocity": [1.3, 0.6]},
    },
    "bars": {"rod": {"from": "C", "to": "P", "length": 0.5}},
    "sliders": {"rail": {"point": "C", "through": [0, 0], "direction": [1, 0]}},
    "springs": {"coil": {"from": "W", "to": "C", "stiffness": 30, "rest_length": 0.8}},
    "dampers": {"oil": {"from": "W", "to": "C", "damping": 0.7}},
    "gravity": [0, -9.81],
}
BDF2 = {"integrator": "bdf2"}


def bench():
    """The bench of causes, which is run as a whole by hand."""
    spec = importlib.util.spec_from_file_location(
        "bench_of_causes", ROOT / "tests/verification/causes.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


BENCH = bench()


#: Solutions of changed mechanisms: to integrate them is most of what `judge` does.
SOLVED = {}


def solved_once(problem, t_end, *, force=None, **how):
    """A solution, which all tests of one mechanism share."""
    if force is not None:
        return Truth(problem, t_end, force=force, **how)
    given = (value.tobytes() if isinstance(value, np.ndarray) else value for value in how.values())
    key = (problem.content, t_end, *how, *given)
    if key not in SOLVED:
        SOLVED[key] = Truth(problem, t_end, **how)
    return SOLVED[key]


@contextmanager
def fitted(among):
    """Where only those changes are fitted whose names have one of some words.

    To fit each of up to 70, which is to solve the mechanism anew, is most of what `judge` does.
    """
    every = changes.candidates

    def some(*given):
        return (one for one in every(*given) if any(word in one.name for word in among))

    with (
        np.errstate(all="ignore"),
        mock.patch.multiple(changes, Truth=solved_once, candidates=some),
    ):
        yield


def judged(table, problem, among=("",), **options):
    """What `judge` says where some changes are fitted; all when omitted."""
    with fitted(among):
        return newmark.judge(table, problem, **options)


#: The start, two steps, and the last three.
FEW = (0, 1, 2, -3, -2, -1)


def swings(sizes=(0.02, 0.01, 0.005, 0.0025), integrator="generalized-alpha rho=0.9", rows=FEW):
    """A table of the thrown pendulum, by this tool's own march."""
    found = []
    for h in sizes:
        march = newmark.march(THROWN, h=h, t_end=0.5, integrator=integrator)
        frame = march.to_frame().assign(h=h)
        found.append(frame[[name for name in frame if name[0] in "htuvl"]].iloc[[*rows]])
    return pd.concat(found, ignore_index=True)


def with_number(path, factor):
    """The cart with one number times a factor."""
    document = json.loads(json.dumps(CART))
    *way, last = path
    there = document
    for key in way:
        there = there[key]
    value = there[last]
    there[last] = [factor * x for x in value] if isinstance(value, list) else factor * value
    return document


def cart(document=CART, parts="tuvl", rows=FEW, integrator="bdf2", t_end=0.2):
    """A table of the cart, by this tool's own march of what may be another mechanism."""
    found = []
    for h in (0.01, 0.005, 0.0025, 0.00125):
        frame = newmark.march(document, h=h, t_end=t_end, integrator=integrator).to_frame()
        kept = [name for name in frame if name[0] in parts and name[:2] != "to"]
        found.append(frame[kept].iloc[[k for k in rows if k < len(frame)]].assign(h=h))
    return pd.concat(found, ignore_index=True)


def of_motion(mechanism, force=None):
    """What a code without errors computes of a mechanism, with a further force."""
    problem, times = newmark.problem(mechanism), np.linspace(0, 0.4, 9)
    there = Truth(problem, 0.4, force=force).at(times)
    parts = {"u": problem.coordinate_names, "v": problem.coordinate_names,
             "lambda": problem.constraint_names}  # fmt: skip
    columns = {f"{part}[{name}]": there[part][:, k]
               for part, names in parts.items() for k, name in enumerate(names)}  # fmt: skip
    table = pd.DataFrame({"t": times, **columns})
    return pd.concat([table.assign(h=h) for h in (0.01, 0.005, 0.0025)])
