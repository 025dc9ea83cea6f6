"""Two results folders side by side: what differs, what agrees but for rounding, exit codes."""

import json
import math
import re

import pytest
import synthetic
from conftest import rows_in

from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.report.tables import compare as comparing
from newmark_cli.study.csv_files import csv_text

MULTIPLIERS = FIGURES["10"]
KRYLOV = FIGURES["13"]


@pytest.fixture
def folders(tmp_path):
    """Two folders with the same two studies."""
    for name in ("a", "b"):
        synthetic.write(tmp_path / name, MULTIPLIERS)
        synthetic.write(tmp_path / name, KRYLOV)
    return tmp_path / "a", tmp_path / "b"


@pytest.fixture
def compared(folders, monkeypatch):
    """Text of a comparison, one line for each difference, and whether there is one."""
    monkeypatch.setenv("COLUMNS", "400")

    def compare(most=None):
        text, _, differs = comparing.compare(*folders, 1e-6, most)
        return [re.sub("  +", " | ", line.strip()) for line in text.splitlines()], differs

    return compare


def rewrite(folder, figure, where, change):
    """Change rows of one folder."""
    table = synthetic.spoilt(synthetic.rows(figure), where, change)
    synthetic.write(folder, figure, table)


def test_the_same_results(folders, compared):
    """Nothing differs; everything was compared.  A study in one folder only is no difference."""
    found, differs = compared()
    assert not differs
    assert list(filter(None, found)) == [
        "cells in both: 36",
        "cells that ended differently: 0",
        "values beyond tolerance: 0 of 36 (condition, sensitivity, krylov_iterations: 1e-06; "
        "others: a factor of 10)",
        "no slope differs",
        "no difference in what was recorded of code and machine",
        "verdicts changed: 0, of 9 slopes and 9 claims",
    ]
    (folders[0] / "krylov.csv").unlink()
    found, differs = compared()
    assert f"only in {folders[1]}: study krylov, 16 cells" in found
    assert not differs


@pytest.mark.parametrize(
    ("measure", "a", "b", "expected"),
    [
        ("condition", 1.0, 1.0 + 0.9e-6, True),
        ("condition", 1.0, 1.0 + 1.1e-6, False),
        ("sensitivity", 0.0, 0.0, True),
        ("sensitivity", 0.0, 1e-300, False),
        ("krylov_iterations", 79.0, 80.0, False),
        ("correction", 1e-17, 9.9e-17, True),
        ("correction", 1.01e-16, 1e-17, False),
        ("physical_correction", 0.0, 1e-17, False),
        ("error", 0.0, 0.0, True),
        ("history", math.inf, 1.0, False),
        ("correction", math.nan, math.nan, True),
        ("correction", math.nan, 1.0, False),
        ("condition", 1.0, math.nan, False),
    ],
)
def test_values_agree(measure, a, b, expected):
    """To a relative tolerance, or within a factor of ten where rounding rules; both ways."""
    assert comparing.agree(measure, a, b, 1e-6) == expected
    assert comparing.agree(measure, b, a, 1e-6) == expected


def test_another_verdict(folders, compared):
    """A series with another slope: values, slope and both verdicts."""
    where = {"evaluation": "compensated"}
    rewrite(folders[1], MULTIPLIERS, where, lambda row: {"rms": row["rms"] / row["h"]})
    found, differs = compared()
    assert differs
    assert found[4].startswith("values beyond tolerance: 4 of 36")
    name = "multipliers andrews u-lambda optimal compensated, physical_correction lambda"
    at = found.index("slope farthest apart:")
    assert found[at + 3] == f"{name} | −1.00 ± 0.05 | −2.00 ± 0.05"
    changed = " | −1.00 ± 0.05 pass | −2.00 ± 0.05 miss"
    assert {name + changed, "figure 10: optimal, compensated: slope −1 ± 0.15" + changed} <= {
        *found
    }


def test_cells_that_are_not_in_both(folders, compared):
    """Of a study in both folders each cell, of another the study; statuses that differ."""
    a, b = folders
    (b / "multipliers.csv").unlink()
    rewrite(a, KRYLOV, {"preconditioning": "left", "h": 1e-3}, lambda row: {"h": 2e-3})
    rewrite(
        b, KRYLOV, {"preconditioning": "right", "h": 1e-5}, lambda row: {"status": "not_converged"}
    )
    found, differs = compared()
    assert differs
    where = "krylov random-chain(links=1000) u-lambda"
    assert found[1:4] == [
        f"only in {a}: study multipliers, 20 cells",
        f"only in {a}: {where} left gmres, h = 0.002, 30 steps",
        f"only in {b}: {where} left gmres, h = 0.001, 30 steps",
    ]
    assert f"{where} right gmres, h = 1e-05, 30 steps | stagnated | not_converged" in found


def test_series_and_rows_that_are_not_in_both(cli, committed_folder):
    """Of cells in both folders: each row, or the whole series where nothing of it is there."""
    rows = rows_in(committed_folder / "pendulum-u.csv")
    series = {"quantity": "lambda", "measure": "correction", "preconditioning": "left"}
    single = {"measure": "condition", "h": "0.1", "preconditioning": "none"}
    fewer = [r for r in rows if not (series.items() <= r.items() or single.items() <= r.items())]
    for folder, kept in (("a", rows), ("b", fewer)):
        cli.write(f"{folder}/pendulum-u.csv", csv_text([*rows[0]], kept))
    where = "pendulum-u pendulum u-lambda"
    lines = [
        f"only in a: {where} left, correction lambda, 4 rows",
        f"only in a: {where} none, condition jacobian, h = 0.1, 30 steps",
    ]
    shown = cli("compare", "a", "b", code=1).stdout
    assert shown.splitlines()[:3] == ["cells in both: 16", *lines]
    shown = cli("compare", "b", "a", code=1).stdout
    assert shown.splitlines()[:3] == ["cells in both: 16", *lines]
    found = json.loads(cli("compare", "b", "a", "--json", code=1).stdout)
    assert [f"only in a: {entry}" for entry in found["only_in_second"]] == lines
    assert (found["cells_in_both"], found["only_in_first"]) == (16, [])
    assert found["verdicts"] == [
        [f"{where} none, condition jacobian", "−4.00 incomplete", "−4.00 pass"]
    ]
    cli("compare", "a", "a")


def test_environments(folders, compared):
    """What records say differently, what one says alone, and nothing of what agrees."""
    for folder, numpy, more in zip(
        folders, ("2.1.0", "2.2.0"), ({}, {"processor": "x"}), strict=True
    ):
        for study in ("multipliers", "krylov"):
            record = {
                "study": study,
                "versions": {"python": "3.11.7", "numpy": numpy},
                "platform": {"machine": "x86_64", **more},
                "config_sha256": numpy if study == "krylov" else "same",
            }
            (folder / f"{study}.json").write_text(json.dumps(record))
    found, _ = compared()
    at = found.index("computed with something else:") + 3
    assert found[at : at + 4] == [
        "numpy | 2.1.0 | 2.2.0",
        "config of krylov | 2.1.0 | 2.2.0",
        "processor | not recorded | x",
        "",
    ]
    for study in ("multipliers", "krylov"):
        (folders[0] / f"{study}.json").write_text(
            json.dumps({"study": study, "config_sha256": "same"})
        )
    found, _ = compared()
    at = found.index("computed with something else:") + 3
    assert found[at : at + 2] == ["config of krylov | same | 2.2.0", ""]


def test_long_lists_are_cut(folders, compared):
    """With how many more there are."""
    rewrite(folders[1], MULTIPLIERS, {}, lambda row: {"rms": 100 * row["rms"]})
    assert "10 more (--all)" in compared(10)[0]
    assert not any("--all" in line for line in compared()[0])


def test_bad_input(cli):
    cli.write("a/quick.csv", "a,b\n")
    cli.write("b/x", "")
    assert "a/quick.csv, line 1" in cli.refused("compare", "a", "b")
    assert "b: no results" in cli.refused("compare", "b", "a")
    assert "--rtol" in cli.refused("compare", "a", "b", "--rtol", "nan")
