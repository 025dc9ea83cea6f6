"""Cells: which states are sampled, and what is told while they run."""

from dataclasses import replace

import numpy as np
import pytest

from newmark_cli.newmark import perturbation
from newmark_cli.newmark.linear.dense import DenseSystem
from newmark_cli.study import config
from newmark_cli.study.axes import Cell
from newmark_cli.study.compute import compute


@pytest.mark.parametrize(("samples", "steps"), [(32, 10_000), (3, 10_000), (32, 5), (1, 12_000)])
def test_sampled_states(monkeypatch, samples, steps):
    """As many as asked for, evenly spread, each at its own time, the last at the end."""
    times = []

    class Balanced:
        def condition(self):
            return 1.0

    def record(system, time, state):
        times.append(time)
        return Balanced()

    monkeypatch.setattr(DenseSystem, "balanced", record)
    (first, *_) = config.find("pendulum-u").cells()
    told = []
    chosen = Cell(**{**vars(first), "h": 1e-4, "steps": steps, "samples": samples})
    outcome = compute(chosen, on_steps=told.append)
    assert outcome.status == "ok"
    assert len(times) == min(samples, steps)
    assert times[-1] == pytest.approx(steps * 1e-4)
    gaps = [b - a for a, b in zip([0, *times], times, strict=False)]
    assert max(gaps) - min(gaps) < 1.5e-4
    assert sum(told) == steps
    assert max(told) <= 5_000, "an interrupt waits for no longer"


def test_initial_state_is_measured_without_steps(monkeypatch):
    """steps: 0 samples once, at the initial time."""
    times = []

    def record(subject, scheme, time, state, system):
        times.append(time)
        return {}

    monkeypatch.setattr(perturbation, "sensitivities", record)
    (first, *_) = config.find("sensitivity").cells()
    assert compute(first).measurements == []
    assert times == [0.0, 0.0]  # and beside it


def test_without_a_reference_errors_are_empty():
    """There is a row for each quantity all the same."""
    (first, *_) = config.find("error").cells()
    rows = compute(replace(first, steps=3, twins=1, measure=("error",))).measurements
    assert [row.quantity for row in rows] == ["u", "v", "lambda"]
    assert all(np.isnan([row.statistics.last, row.statistics.rounding]).all() for row in rows)
