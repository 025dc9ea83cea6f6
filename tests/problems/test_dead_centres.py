"""Driven mechanisms at and next to singular positions: an error of one line that names where."""

import re

import numpy as np
import pytest
from each import each

from newmark_cli.mechanisms import loading
from newmark_cli.support.documents import DocumentError, parse

#: A slider-crank whose slider is driven away from where the linkage is nearly straight.
DRIVEN = """\
points: {{A: {{fixed: [0, 0]}}, B: {{at: [2, {off!r}]}}, C: {{at: [4, 0], mass: 1}}}}
bodies:
  crank: {{from: A, to: B, length: 2, mass: 1, centre: [0.1, 0], inertia: 0.1}}
  rod: {{from: B, to: C, length: 2, mass: 1, centre: [0.1, 0], inertia: 0.1}}
sliders: {{rail: {{point: C, through: [0, 0], direction: [1, 0]}}}}
motions: {{push: {{point: C, x: {{rate: {rate}}}}}}}
{options}
"""
#: A four-bar that is folded flat, its rocker driven.
FOLDED = """\
points: {{A: {{fixed: [0, 0]}}, D: {{fixed: [2, 0]}}, B: {{at: [1, {off!r}]}}, C: {{at: [3, 0]}}}}
bodies:
  crank: {{from: A, to: B, length: 1, mass: 1, centre: [0.1, 0], inertia: 0.1}}
  link: {{from: B, to: C, length: 2, mass: 1, centre: [0.1, 0], inertia: 0.1}}
  rocker: {{from: D, to: C, length: 1, mass: 1, centre: [0.1, 0], inertia: 0.1}}
motions: {{push: {{body: crank, angle: {{rate: {rate}}}}}}}
{options}
"""
BOTH = "assemble: true\nproject_velocities: true"


@each("options", ["project_velocities: true", BOTH])
@each("off", [0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7])
@each("text", [DRIVEN, FOLDED])
def test_driven_at_a_dead_centre(text, off, options):
    """Refused with the line of a constraint, or started with velocities that fit it."""
    document = parse(text.format(off=off, rate=1, options=options), "m.yaml")
    problem, refusal = None, ""
    try:
        problem = loading.built("m.yaml", document)
    except DocumentError as error:
        refusal = str(error)
    if problem is None:
        assert re.fullmatch(r"m\.yaml, line [3-8]: [\w.]+: .*", refusal)
        return
    rate, _ = problem.constraint_derivatives(problem.t0, problem.u0, problem.v0)
    values = problem.values(problem.t0, problem.u0, problem.v0, np.zeros(problem.m))
    gradient = np.zeros((problem.n, problem.m))
    np.add.at(gradient, (problem.pattern.g_rows, problem.pattern.g_columns), values.g)
    assert abs(rate).max() == pytest.approx(1, rel=1e-12)
    size = np.linalg.norm(gradient, axis=0) * max(abs(problem.v0).max(), 1)
    assert np.all(abs(gradient.T @ problem.v0 + rate) <= 2e-9 * size)
