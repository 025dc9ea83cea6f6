"""The table of other codes: its files, its errors, its words; without any of the codes."""

import importlib
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.problems import reference

PEERS = Path(__file__).parents[1] / "benchmarks" / "peers"


@pytest.fixture
def peers(monkeypatch):
    """The modules `common` and `report`."""
    monkeypatch.syspath_prepend(str(PEERS))
    return importlib.import_module("common"), importlib.import_module("report")


def written(common, problem, results):
    """A frame of runs as a script writes them, at h = 1e-2, 1e-3, …; t_end 0.5 s."""
    rows = [
        common.row(common.Run("A code", "h", 10.0 ** -(k + 2), None), 0.5, result, 0.25, problem)
        for k, result in enumerate(results)
    ]
    frame = pd.DataFrame(rows, columns=common.columns(problem)).replace("", np.nan)
    return frame.astype({name: float for name in frame if name[1:2] == "[" or name == "h"})


def test_files_have_the_names_of_a_march(peers):
    common, _ = peers
    for name in common.PROBLEMS:
        problem, _ = common.load(name)
        marched = newmark.march(problem, h=1e-4, steps=0).to_frame().columns
        inside = [column for column in common.columns(problem) if "[" in column]
        assert [
            column for column in marched if column.startswith(("u[", "v[", "lambda["))
        ] == inside


def test_errors_and_words_of_a_table(peers):
    common, report = peers
    problem, t_end = common.load("thrown-pendulum")
    at = reference.solution(problem, t_end)
    off = [
        common.Result(at.u + 1e-3 * np.abs(at.u).max(), at.v, at.multipliers * (1 + error))
        for error in (1e-4, 1e-3, 1e-1, 10.0)
    ]
    runs = report.measured(written(common, problem, off), problem, t_end)
    assert runs["u"].to_list() == pytest.approx([1e-3] * 4)
    assert runs["lambda"].to_list() == pytest.approx([1e-4, 1e-3, 1e-1, 10.0])
    ((label, u, _, multipliers, wrong, advised, _, beyond),) = report.rows(runs, str.upper)
    assert (label, advised, u) == ("A code", "A CODE", "1.0e-3 at 1e-2")
    assert (multipliers, wrong) == ("1.0e-4 at 1e-2", "3.2e-4, 3.2e-5")
    assert beyond == "silence: λ wrong by 1.0e1"
    failed = [off[0], common.Result(message="It | failed at t = 0.1: because")]
    runs = report.measured(written(common, problem, failed), problem, t_end)
    ((*_, beyond),) = report.rows(runs, str.upper)
    assert beyond == "“It ∣ failed”"
    assert math.isinf(report.crossed([1e-2, 1e-3], [2.0, 3.0], 1.0))


def test_page_shows_the_recorded_runs(peers):
    """But for what `advise` says, which is computed anew."""
    common, report = peers
    page = report.PAGE.read_text(encoding="utf-8")
    runs = report.read(common.HERE / "results", "thrown-pendulum")
    for *measured, _, _, _ in report.rows(runs, lambda label: ""):
        assert "| " + " | ".join(measured) + " |" in page
