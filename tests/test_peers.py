"""The codes of docs/comparison.md: their studies, their results, and the page."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import newmark_cli as newmark
from newmark_cli.problems import reference

TOP = Path(__file__).parents[1]
PEERS = TOP / "benchmarks" / "peers"
PROBLEMS = ("thrown-pendulum", "slider-crank", "andrews", "heavy-top")
STUDIES = [f"peers-{name}" for name in PROBLEMS]


def test_page_has_tables_that_the_command_prints(cli):
    """To the letter, from the committed results; the page leaves some out."""
    page = (TOP / "docs" / "comparison.md").read_text(encoding="utf-8")
    shown = page.partition("<!-- peers: begin -->\n")[2].partition("<!-- peers: end -->")[0]
    printed = cli("tables", *STUDIES, "--results", PEERS / "results").stdout
    tables, all_of_them = (
        [table.strip() for table in text.split("### ")[1:]] for text in (shown, printed)
    )
    assert len(tables) == 1
    assert set(tables) <= set(all_of_them)


@pytest.mark.parametrize("name", PROBLEMS)
def test_results_are_those_of_the_config(cli, name):
    """Cells that fail are those that may."""
    study = PEERS / f"{name}-study.yaml"
    told = cli("validate", study, "--allow-code").stdout
    cells = int(told.rpartition(", ")[2].split()[0])
    rows = pd.read_csv(PEERS / "results" / f"peers-{name}.csv")
    axes = ["code", "integrator", "formulation", "evaluation", "h"]
    assert len(rows[axes].drop_duplicates()) == cells
    failed = rows[rows["status"] != "ok"]
    assert set(failed["status"]) == {"failed"}
    assert failed["code"].str.match("IDA, 1e|scipy_dae|solve_dae BDF").all()
    assert "newmark-study" in set(rows["code"])


def test_results_have_the_errors_of_their_last_states():
    """The reference of the results is the solution of the equations, whoever computes it."""
    rows = pd.read_csv(PEERS / "results" / "peers-thrown-pendulum.csv")
    problem = newmark.problem(str(PEERS / "mechanisms" / "thrown-pendulum.yaml"))
    there = reference.solution(problem, 0.5)
    march = newmark.march(
        problem, h=1e-3, t_end=0.5, form="a-lambda", integrator="newmark", formulation="index-2"
    )
    chosen = (
        (rows["code"] == "newmark-study") & (rows["formulation"] == "index-2")
        & (rows["h"] == 1e-3) & (rows["quantity"] == "u")
    )  # fmt: skip
    off = np.abs(march.u[-1] - there.u).max() / np.abs(there.u).max()
    assert rows[chosen]["last"].to_numpy() == pytest.approx([off], rel=1e-6)
