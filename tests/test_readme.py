"""The README's table and keys against the committed results and the code."""

from pathlib import Path

import pytest

from newmark_cli.report import check
from newmark_cli.report.figures import FIGURES
from newmark_cli.report.slopes import collect
from newmark_cli.report.verdicts import NOT_CONVERGING, PASS, SHOWN, TOO_FEW
from newmark_cli.study import config, keys, results
from newmark_cli.study.axes import TRAPEZOIDAL

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.fixture(scope="module")
def committed():
    """Slopes of the committed CSVs."""
    return collect(ROOT / "results")


def test_claims_table_is_that_of_the_results(committed):
    """What `check --markdown` prints is what stands in the README."""
    table = check.markdown_table(check.slope_rows(check.in_paper(committed)))
    begin, end = "<!-- claims: begin -->\n", "<!-- claims: end -->"
    assert README.split(begin)[1].split(end)[0].strip() == table
    table = check.markdown_table(check.claim_rows(check.judge(committed)))
    begin, end = "<!-- past the paper: begin -->\n", "<!-- past the paper: end -->"
    assert README.split(begin)[1].split(end)[0].strip() == table


def test_committed_results_are_complete(committed):
    """All studies of `reproduce --all`, all figures, every slope as predicted, every claim true."""
    assert {s.study for s in committed} >= {*config.REPRODUCED, *config.BEYOND}
    others = [s for s in committed if s.verdict not in (PASS, SHOWN)]
    assert not any(slope.fails for slope in others)
    # The trapezoidal rule, which studies of errors are about, single step sizes, and a floor.
    assert {s.study for s in others} == {"error", "cures"}
    damped = {
        (s.problem, s.formulation.partition(" ")[0]) for s in others if s.integrator != TRAPEZOIDAL
    }
    assert damped <= {("shaken-pendulum", "index-3"), ("shaken-pendulum", "augmented-lagrangian")}
    assert {s.verdict for s in others} == {NOT_CONVERGING, TOO_FEW}
    judged = check.judge(committed)
    assert {entry.finding.verdict for entry in judged} == {PASS}
    assert {entry.figure.study for entry in judged} == {*config.BEYOND} - {
        "integrators",
        "cures-tolerance",
        "cures-krylov",
        "spatial",
    }
    for number in FIGURES:
        for suffix in ("png", "svg"):
            assert (ROOT / f"results/figures/figure-{number}.{suffix}").stat().st_size > 5000


def test_every_column_and_key_is_explained():
    """No column of the CSV and no key of a config without a word about it."""
    figure = keys.FigureConfig.model_fields
    for name in (*results.COLUMNS, *config.Case.model_fields, *config.Study.model_fields, *figure):
        assert f"`{name}`" in README or f"\n{name}:" in README, name
