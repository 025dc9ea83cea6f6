"""Claims about figures: expectations of a config that name one, in the shipped configs too."""

import json
import shutil

import numpy as np
import pytest
import synthetic
from command_line import invoke

from newmark_cli.report.judging import expectations
from newmark_cli.report.judging.slopes import of_csv
from newmark_cli.report.judging.verdicts import INCOMPLETE, MISS, PASS, UNDECIDED
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config, csv_files, shipped
from newmark_cli.study.entries import expectations as plain

EVERY_FIGURE = pytest.mark.parametrize("figure", synthetic.CLAIMING)


def judged(path):
    """Claims of a study by its CSV."""
    return expectations.claims(expectations.judge(path.parent, of_csv(path)))


@EVERY_FIGURE
def test_claims_hold_on_good_results(tmp_path, figure):
    """Every claim, with a number or words for what was measured."""
    found = judged(synthetic.write(tmp_path, figure))
    assert figure.name in {each_.figure for each_ in found}
    for each_ in found:
        assert FIGURES[each_.figure].study == each_.study == figure.study
        assert each_.verdict == PASS, each_
        assert each_.measured


@EVERY_FIGURE
def test_claims_fail_on_other_numbers(tmp_path, figure):
    """Values that neither fall nor stay alike, in cells that end otherwise, hold nothing."""

    def other(row):
        wild = 10.0 ** (-3 + 2.7 * np.sin(1e5 * row["h"] + len(row["preconditioning"])))
        return dict.fromkeys(("rms", "max", "median", "last"), wild) | {
            "met": 700 if row["met"] != "" else "", "status": "ok",
        }  # fmt: skip

    table = synthetic.spoilt(synthetic.rows(figure), {}, other)
    found = judged(synthetic.write(tmp_path, figure, table))
    assert MISS in {each_.verdict for each_ in found}


@EVERY_FIGURE
def test_claims_need_their_data(tmp_path, figure):
    """Without values, of whatever series, no claim is judged, but for one of a status."""
    empty = dict.fromkeys(("rms", "max", "median", "last", "met"), "")
    table = synthetic.spoilt(synthetic.rows(figure), {}, lambda row: empty)
    for one in judged(synthetic.write(tmp_path, figure, table)):
        holds = (PASS,) if "smallest h" in one.said else (INCOMPLETE, UNDECIDED)
        assert one.verdict in holds, one


def test_shipped_configs_read_alike_as_data():
    """What is read without pydantic is what a run puts into the record; files have their names."""
    for name, data in shipped.configs().items():
        study = config.load_shipped(name)
        assert study.study == name
        assert study.cells()
        assert plain(data) == plain(study.model_dump(mode="json", exclude_none=True)), name
    assert {name for name, data in shipped.configs().items() if plain(data)} == {
        "cures", "drift", "error", "floor", "history", "krylov", "multipliers", "precision",
        "over-motion", "step-changes", "tolerance",
    }  # fmt: skip


#: Values at h = 1, 0.1, 0.01 by unknown.
VALUES = {"u": (1, 1e-2, 1e-4), "lambda": (2, 1, 1e-2), "v": (1.0, 0.0, 1.0)}


def written(folder, *entries, drop=()):
    """A study of three series with these expectations in its record."""
    rows = []
    for quantity, values in VALUES.items():
        for h, value in zip((1.0, 0.1, 0.01), values, strict=True):
            where = {"problem": "pendulum", "form": "u-v-lambda", "quantity": quantity}
            if (quantity, h) not in drop:
                rows.append(synthetic.row(value, h=h, steps=100, **where))
    path = folder / "own.csv"
    path.write_text(csv_files.csv_text(csv_files.COLUMNS, rows))
    record = {
        "study": "own",
        "config": {"expect": [{"measure": "correction", **entry} for entry in entries]},
    }
    path.with_suffix(".json").write_text(json.dumps(record))
    return path


U = {"quantity": ["u"], "figure": "7", "label": "u"}
TO_LAMBDA = {"over": {"quantity": ["lambda"]}}


@pytest.mark.parametrize(
    ("given", "text", "value", "verdict"),
    [
        ({"at_most": 1}, "u, every h: at most 1", 1.0, PASS),
        ({"at_most": 0.5}, "u, every h: at most 0.5", 1.0, MISS),
        ({"at_least": 1e-4}, "u, every h: at least 0.0001", 1e-4, PASS),
        ({"at_least": 1e-3, "at_most": 0.9}, "u, every h: 0.001 to 0.9", 1e-4, MISS),
        ({"at_most": 0.5, "h": 0.1}, "u, h = 0.1: at most 0.5", 1e-2, PASS),
        ({"at_most": 0.5, "h": 1e-3}, "u, h = 0.001: at most 0.5", np.nan, INCOMPLETE),
        ({"at_most": 0.5, "at_least": 0.005, **TO_LAMBDA}, "u: 0.005 to 0.5", 0.5, PASS),
        ({"at_most": 0.2, **TO_LAMBDA}, "u: at most 0.2", 0.5, MISS),
        ({"at_least": 1, "h": 1.0, "over": {"h": 0.01}}, "u: at least 1", 1e4, PASS),
        ({"at_least": 1, "h": 0.01, "over": {"h": 1.0}}, "u: at least 1", 1e-4, MISS),
        ({"at_most": 9, "over": {"quantity": ["v"]}}, "u: at most 9", np.nan, INCOMPLETE),
        ({"at_most": 9, "over": {"quantity": ["a"]}}, "u: at most 9", np.nan, INCOMPLETE),
        ({"spread": 9999}, "u: (max − min)/min over h at most 9999", 9999.0, PASS),
        ({"spread": 9998}, "u: (max − min)/min over h at most 9998", 9999.0, MISS),
        ({"status": "ok"}, "u, smallest h: ok", np.nan, PASS),
        ({"status": "stagnated"}, "u, smallest h: stagnated", np.nan, MISS),
        ({"slope": 2, "within": 0.4}, "u: slope 2 ± 0.4", 2.0, PASS),
        # Faster than written is not as written.
        ({"slope": 1, "within": 0.1}, "u: slope 1 ± 0.1", 2.0, MISS),
    ],
)
def test_kinds(tmp_path, given, text, value, verdict):
    """The value that is farthest beyond a bound, or nearest to one, decides."""
    (found,) = judged(written(tmp_path, U | given))
    assert (found.text, found.verdict) == (text, verdict)
    assert found.value == pytest.approx(value, rel=1e-9, nan_ok=True)


def test_quotients_need_the_same_step_sizes(tmp_path):
    """One step size more in the denominator is a hole, not a detail."""
    given = U | TO_LAMBDA | {"at_most": 10}
    (found,) = judged(written(tmp_path, given, drop=[("u", 0.01)]))
    assert (found.verdict, found.reason) == (
        INCOMPLETE, "Δu, pendulum u-v-lambda none, and its divisor: at different step sizes",
    )  # fmt: skip


def checked(folder, *options):
    """Exit code and output of `check` in this process."""
    done = invoke(["check", "--results", folder, *options], folder)
    return done.returncode, done.stdout


def test_check_prints_claims(tmp_path):
    """Below the slopes, in three formats; only of studies that are there."""
    synthetic.write(tmp_path, FIGURES["12"])
    synthetic.write(tmp_path, FIGURES["10"])
    code, text = checked(tmp_path)
    assert code == 0
    lines = text.splitlines()
    (start,) = (i for i, line in enumerate(lines) if line.startswith("claim  "))
    first, second = (i for i, line in enumerate(lines) if line.startswith("figure "))
    assert lines[first] == "figure 10, multipliers: Δλ (physical)"
    assert lines[second] == "figure 12, tolerance: share of steps"
    assert start < first < second
    assert [line.endswith("pass") for line in lines[first + 1 : second - 1]] == [True] * 7
    assert [line.endswith("pass") for line in lines[second + 1 : -2]] == [True] * 4
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "5 of 5 slopes as predicted, 11 of 11 claims hold"
    markdown = checked(tmp_path, "--markdown")[1]
    row = "| 12 | tolerance | share of steps | none, h = 1e-07: at most 0.5 | 0 | pass |"
    assert row in markdown.splitlines()
    found = json.loads(checked(tmp_path, "--json")[1])
    assert len(found) == 5 + 4 + 11
    assert found[-1] == {
        "figure": "12", "study": "tolerance", "claim": "left, h = 1e-07: at most 0.5",
        "measured": "0", "value": 0.0, "verdict": "pass",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda row: {"met": 999 if row["h"] == 1e-5 else row["met"]}, "every h: 1 "),
        (lambda row: {"preconditioning": "other[left:]"}, "no optimal"),
    ],
)
def test_check_fails_on_a_claim(tmp_path, change, said):
    """Exit 1 when a claim is false, or its data are missing in a study that is there."""
    figure = FIGURES["12"]
    table = synthetic.spoilt(synthetic.rows(figure), {"preconditioning": "optimal"}, change)
    synthetic.write(tmp_path, figure, table)
    code, text = checked(tmp_path)
    assert code == 1
    lines = [line for line in text.splitlines() if line.startswith("optimal")]
    assert any(said in line for line in lines)
    assert text.splitlines()[-1] == "0 of 0 slopes as predicted, 3 of 4 claims hold"


NAMESAKES = {
    "history": """\
problem: pendulum
form: u-lambda
preconditioning: optimal
measure: condition
h: [1e-2, 1e-3, 1e-4]
steps: 0
""",
    "all-forms": """\
problem: pendulum
form: u-lambda
preconditioning: [none, optimal]
measure: [condition, correction, floor]
h: [1e-2, 1e-3, 1e-4]
steps: 20
figures:
  - {figure: 1, title: mine, measure: condition, quantity: jacobian, problem: pendulum,
     form: u-lambda, preconditioning: [none, optimal], series: preconditioning, within: 0.04}
""",
}


def test_a_study_named_like_a_shipped_one_is_the_users(cli):
    """No claim, figure or table of the shipped study is asked of it; its own are."""
    for name, rest in NAMESAKES.items():
        cli.write(f"{name}.yaml", f"study: {name}\n{rest}")
        cli("run", f"{name}.yaml")
    done = cli("check", "--json")
    assert not [row for row in json.loads(done.stdout) if "claim" in row]
    drawn = {row["preconditioning"]: row for row in json.loads(done.stdout) if row["figure"]}
    assert set(drawn) == {"none", "optimal"}
    assert {(row["figure"], row["tolerance"], row["study"]) for row in drawn.values()} == {
        ("1", 0.04, "all-forms")
    }
    assert "figure 1, all-forms" in cli("check").stdout
    assert "no results of the shipped all-forms" in cli.refused("tables")
    assert "| none | " in cli("tables", "all-forms").stdout
    done = cli("plot", "--format", "png")
    assert done.stdout.split() == [
        f"results/figures/{name}.png"
        for name in ("figure-1", "history-pendulum-u-lambda-condition-start")
    ]
    assert done.stderr == ""


def test_a_shipped_study_stays_one_whatever_its_record_lacks(committed_folder, tmp_path):
    """Records of older versions have no claims and fewer keys; without a record the name counts."""
    path = tmp_path / "history.csv"
    shutil.copy(committed_folder / path.name, path)
    record = json.loads((committed_folder / "history.json").read_text())
    del record["config"]["expect"], record["config"]["figures"]
    del record["config"]["cases"][0]["twins"]
    for kept in (None, record):
        if kept:
            path.with_suffix(".json").write_text(json.dumps(kept))
        assert [claim.figure for claim in judged(path)] == ["15"]
    record["config"]["cases"][0]["problem"] = ["pendulum"]
    path.with_suffix(".json").write_text(json.dumps(record))
    assert judged(path) == []
