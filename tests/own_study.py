"""A made-up study `mine`: its rows, its record, and the results folder that holds them."""

import itertools
import json

import synthetic
from conftest import QUICK

from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import collect
from newmark_cli.study import csv_files

TRAPEZOIDAL, DAMPED = "newmark beta=0.25 gamma=0.5", "generalized-alpha rho=0.9"
H = (1e-1, 1e-2, 1e-3, 1e-4)


def row(h, value, **columns):
    """Row of a study `mine`, whatever the columns do not say as usual."""
    usual = {
        "study": "mine", "problem": "hoist.yaml", "preconditioning": "optimal", "quantity": "u",
        "measure": "error", "steps": round(1 / h), "rounding": 1e-16,
    }  # fmt: skip
    return synthetic.row(value, h=h, **usual | columns)


def table(order=2.0, h=H, **given):
    """Rows for every combination of the columns' values, each a power law of its own."""
    lists = {key: value if isinstance(value, list) else [value] for key, value in given.items()}
    return [
        row(step, (1 + i) * step**order, **dict(zip(lists, values, strict=True)))
        for i, values in enumerate(itertools.product(*lists.values()))
        for step in h
    ]


def written(folder, rows, record=None):
    """Results with these rows, and a record that says no more than it must."""
    studies = {}
    for one in rows:
        studies.setdefault(one["study"], []).append(one)
    folder.mkdir(parents=True, exist_ok=True)
    for study, ours in studies.items():
        text = csv_files.csv_text(csv_files.COLUMNS, ours)
        (folder / f"{study}.csv").write_text(text)
        if record is not None:
            (folder / f"{study}.json").write_text(json.dumps({"study": study} | record))
    return Results(folder, collect(folder))


def cells(rows, operations):
    """Record of the cells of rows: their operations, and a tenth of that in seconds."""
    names = (
        "problem", "integrator", "form", "preconditioning", "evaluation", "precision",
        "linear_solver", "stop", "h", "steps",
    )  # fmt: skip
    return {
        "cells": [
            {name: one[name] for name in names}
            | {"operations": operations(one), "march_seconds": operations(one) / 10}
            for one in rows
        ]
    }


STUDY = QUICK.replace("h: [1e-1, 1e-2]", "h: [1e-1, 3e-2, 1e-2]\nmeasure: [condition, error]")
STUDY = STUDY.replace("study: quick", "study: mine").replace("form: ", "description: x\nform: ")


def run(cli):
    """The command line where the study was run."""
    variants = {"problem": "pendulum", "preconditioning": ["none", "optimal"]}
    errors = table(**variants)
    written(
        cli.folder / "results",
        [*errors, *table(-4.0, measure="condition", quantity="jacobian", **variants)],
        cells(errors, lambda one: 1 / one["h"]),
    )
    return cli
