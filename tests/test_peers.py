"""The codes of docs/comparison.md: their studies, their results, and the page."""

import shutil
from importlib import util
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
#: Package → a code with fast settings, and the largest error of u and λ that they should have.
CODES = {
    "sksundae": ("with_ida", "{formulation: ggl, tolerance: 1e-8, integrals: true}", 1e-6),
    "scipy_dae": (
        "with_solve_dae",
        "{package: scipy_dae, method: Radau, formulation: ggl, tolerance: 1e-8, integrals: true}",
        1e-7,
    ),
    "solve_dae": (
        "with_solve_dae",
        "{package: solve_dae, method: BDF, formulation: ggl, tolerance: 1e-8, integrals: true}",
        1e-6,
    ),
    "exudyn": ("with_exudyn", "{trapezoidal: true, index_2: true}", 1e-2),
    "mujoco": ("with_mujoco", "{hard: true}", 1e-1),
    "openseespy": ("with_opensees", "{stiffness: 1e6}", 1e-1),
}
STUDY = """\
study: one
problem: mechanisms/thrown-pendulum.yaml
measure: error
twins: 0
h: 1e-2
t_end: 0.5
code:
"""


@pytest.fixture
def codes(cli):
    """A folder with the codes and the pendulum."""
    for path in PEERS.glob("*.py"):
        shutil.copy(path, cli.folder)
    shutil.copytree(PEERS / "mechanisms", cli.folder / "mechanisms")
    return cli.folder


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


@pytest.mark.parametrize("name", PROBLEMS)
def test_an_end_is_a_row_with_the_names_of_a_march(monkeypatch, name):
    """λ may be that of the last constraints only, as of a body without directors."""
    monkeypatch.syspath_prepend(str(PEERS))
    last_row = pytest.importorskip("rows").last_row
    path = PEERS / "mechanisms" / f"{name}.yaml"
    problem = newmark.problem(str(path) if path.exists() else name)
    u, v = problem.u0.reshape(-1, 2), problem.v0
    row = last_row(problem, 0.5, u, v, np.arange(problem.m), iterations=2.5)
    named = newmark.march(problem, h=1e-4, steps=0).to_frame().columns
    wanted = [column for column in named if column.startswith(("u[", "v[", "lambda["))]
    assert [*row] == ["t", *wanted, "iterations"]
    assert [row[column][0] for column in wanted] == [*problem.u0, *v, *range(problem.m)]
    if problem.m > 3:
        of_joint = last_row(problem, 0.5, u, v, [1.0, 2.0, 3.0])
        last = [f"lambda[{each}]" for each in problem.constraint_names[-3:]]
        assert [column for column in of_joint if column.startswith("lambda[")] == last


def test_codes_that_are_installed_come_to_the_end(cli, codes):
    """With the errors that their settings allow, and no more."""
    there = [name for name in CODES if util.find_spec(name)]
    if not there:
        pytest.skip("needs the extra peers")
    lines = [
        f'  - {{name: {name}, python: "{CODES[name][0]}.py:solve", args: {CODES[name][1]}}}\n'
        for name in there
    ]
    (codes / "one.yaml").write_text(STUDY + "".join(lines))
    cli("run", "one.yaml", "--allow-code")
    rows = pd.read_csv(codes / "results" / "one.csv").set_index(["code", "quantity"])
    for name in there:
        for quantity in ("u", "lambda"):
            assert 0 < rows.loc[(name, quantity), "last"] < CODES[name][2], (name, quantity)


def test_a_code_that_is_not_installed_is_a_failed_cell(cli, codes):
    """With one line that says what is missing."""
    settings = "{package: not_there, method: BDF, formulation: ggl, tolerance: 1e-8}"
    entry = f'  - {{name: none, python: "with_solve_dae.py:solve", args: {settings}}}\n'
    (codes / "one.yaml").write_text(STUDY + entry)
    told = cli("run", "one.yaml", "--allow-code", code=1).stderr
    (line,) = [line for line in told.splitlines() if "failed" in line]
    assert line.endswith("ModuleNotFoundError: No module named 'not_there'")


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
