"""The table of other codes: its files, its errors, its words; without any of the codes."""

import importlib
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.problems import reference


@pytest.fixture
def peers(monkeypatch):
    """The modules `common` and `report`."""
    folder = Path(__file__).parents[1] / "benchmarks" / "peers"
    monkeypatch.syspath_prepend(str(folder))
    return importlib.import_module("common"), importlib.import_module("report")


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

    def table(*results):
        runs = [common.Run("A code", "h", 10.0**-k, None) for k in range(2, 2 + len(results))]
        rows = [common.row(a, t_end, b, 0.1, problem) for a, b in zip(runs, results, strict=True)]
        frame = pd.DataFrame(rows, columns=common.columns(problem)).replace("", np.nan)
        numbers = [name for name in frame if "[" in name or name == "h"]
        runs = report.measured(frame.astype(dict.fromkeys(numbers, float)), problem, t_end)
        return report.rows(runs, str.upper)[0]

    size = np.abs(at.u).max()
    off = [
        common.Result(at.u + 1e-3 * size, at.v, at.multipliers * (1 + error))
        for error in (1e-4, 1e-3, 1e-1, 10.0)
    ]
    label, u, _, *row = table(*off)
    assert (label, u) == ("A code", "1.0e-3 at 1e-2")
    silent = "silence: λ wrong by 1.0e1"
    assert row == ["1.0e-4 at 1e-2", "3.2e-4, 3.2e-5", "A CODE", "–", silent]
    failed = common.Result(message="It | failed at t = 0.1: because")
    assert table(off[0], failed)[-1] == "“It ∣ failed”"
    assert math.isinf(report.crossed([1e-2, 1e-3], [2.0, 3.0], 1.0))


def test_page_shows_the_recorded_runs(peers):
    """But for what `advise` says, which is computed anew."""
    common, report = peers
    page = report.PAGE.read_text(encoding="utf-8")
    for *measured, _, _, _ in report.rows(
        report.read(common.HERE / "results", "thrown-pendulum"), lambda label: ""
    ):
        assert "| " + " | ".join(measured) + " |" in page
