"""`measure: trajectory`: the rows of the library, in one file that goes the way of all results."""

import csv
import io
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from conftest import rows_in

import newmark_cli as newmark
from newmark_cli.report.reading import records
from newmark_cli.running import runner
from newmark_cli.study import compute, config, trajectories

STUDY = """\
study: swing
problem: pendulum
form: [u-lambda, v-lambda]
preconditioning: optimal
h: [1e-2, 5e-3]
t_end: 1.0
measure: [condition, trajectory]
trajectory: {every: 30}
"""


def columns_of(row):
    """Components and energy, without what a problem lacks."""
    return {
        name: float(text)
        for name, text in row.items()
        if text and ("[" in name or name == "energy") and name != "preconditioning"
    }


def same_rows(rows, frame):
    """Rows of a CSV are those of a frame to the last bit."""
    assert len(rows) == len(frame)
    for row, expected in zip(rows, frame.to_dict("records"), strict=True):
        found = {"t": float(row["t"]), **columns_of(row)}
        assert list(found) == list(expected)
        assert [v.hex() for v in found.values()] == [v.hex() for v in expected.values()]


@pytest.mark.parametrize("name", ["pendulum", "shaken-pendulum", "heavy-top"])
def test_rows_are_the_librarys_and_end_where_errors_are_judged(cli, name, monkeypatch):
    """Of every shipped problem, to the bit: what `run` writes, `march` returns, `error` judges."""
    h = {"andrews": 1e-4, "pendulum": 1e-2}.get(name, 1e-3)
    study = (
        f"study: one\nproblem: {name}\nform: v-lambda\npreconditioning: left\nh: {h}\nsteps: 40\n"
        "integrator: {method: generalized-alpha, rho: 0.9}\nmeasure: [trajectory, error]\n"
        "trajectory: {every: 7}\n"
    )
    path = cli.write("one.yaml", study)
    judged = []

    def errors(problem, t, here, reference):
        judged.append(here)
        return {}

    monkeypatch.setattr("newmark_cli.study.observers.errors", errors)
    (cell,) = config.load(path).cells()
    outcome = compute.compute(cell, SimpleNamespace())
    table = trajectories.csv(trajectories.table("one", [cell], [outcome]))
    rows = list(csv.DictReader(io.StringIO(table)))
    how = {"form": "v-lambda", "scaling": "left", "integrator": "generalized-alpha rho=0.9"}
    whole = newmark.march(name, h=h, steps=40, every=7, **how)
    assert [int(row["step"]) for row in rows] == [0, 7, 14, 21, 28, 35, 40]
    same_rows(rows, whole.to_frame())
    end, *_ = judged  # the others are twins
    last = columns_of(rows[-1])
    fields = [*end["u"][0], *end["v"][0], *whole.a[-1], *end["lambda"][0]]
    follows = ("energy", "output[")
    assert [value for name, value in last.items() if not name.startswith(follows)] == fields
    cli.write("one.yaml", study.replace("[trajectory, error]", "trajectory"))
    cli("run", "one.yaml")
    assert (cli.folder / "results/trajectory/one.csv").read_text() == table


@pytest.mark.parametrize(("given", "how", "keep"), [
        ("{every: 30}", {"every": 30}, None),
        ("{every: 1000, keep: lambda}", {"every": 1000}, ["lambda["]),
        ("{at: [0.998, 0, 0.504, 0.5], keep: [u, energy]}",
         {"at": [0, 0.5, 0.504, 0.998]}, ["u[", "energy"]),
        ("{keep: energy}", {}, ["energy"]),
    ])  # fmt: skip
def test_what_is_kept_is_what_the_library_keeps(cli, given, how, keep):
    """Every so many steps and the last, or the nearest to times; whole columns or few."""
    cli.write("swing.yaml", STUDY.replace("{every: 30}", given))
    cli("run", "swing.yaml")
    rows = rows_in(cli.folder / "results/trajectory/swing.csv")
    for form in ("u-lambda", "v-lambda"):
        for h in ("0.01", "0.005"):
            ours = [row for row in rows if (row["form"], row["h"]) == (form, h)]
            march = newmark.march("pendulum", h=float(h), t_end=1.0, form=form, **how)
            assert [int(row["step"]) for row in ours] == march.numbers.tolist()
            frame = march.to_frame()
            names = [n for n in frame if n == "t" or keep is None or n.startswith(tuple(keep))]
            same_rows(ours, frame[names])


def test_rows_of_the_study_are_the_largest_along_the_way(cli):
    """One for each quantity that is kept; `check` finds nothing to object to in them."""
    cli.write("swing.yaml", STUDY.replace("{every: 30}", "{keep: [v, lambda]}"))
    cli("run", "swing.yaml")
    rows = [r for r in rows_in(cli.folder / "results/swing.csv") if r["measure"] == "trajectory"]
    assert [row["quantity"] for row in rows] == ["v", "lambda"] * 4
    march = newmark.march("pendulum", h=1e-2, t_end=1.0)
    for row, field in zip(rows[:2], (march.v, march.multipliers), strict=True):
        sizes = np.abs(field[1:]).max(axis=1)
        assert (float(row["max"]), float(row["last"])) == (sizes.max(), sizes[-1])
        assert int(row["zeros"]) == 0
    assert "not what the tool writes" not in cli("check", code=1).stdout


def test_problems_of_one_study_share_a_file(cli):
    """Columns are those of all, empty where a problem lacks one."""
    cli.write("swing.yaml", STUDY.replace("pendulum", "[pendulum, double-pendulum]"))
    cli("run", "swing.yaml")
    frame = newmark.trajectories(cli.folder / "results", "swing")
    double, pendulum = (frame[frame["problem"] == name] for name in ("double-pendulum", "pendulum"))
    components = [name for name in frame if "[" in name]
    kinds = [name.partition("[")[0] for name in components]
    assert kinds == sorted(kinds, key=["u", "v", "a", "lambda"].index)
    assert pendulum["u[Q.x]"].isna().all()
    assert not double["u[Q.x]"].isna().any()
    for name, part in (("pendulum", pendulum), ("double-pendulum", double)):
        there = part.dropna(axis=1, how="all")
        march = newmark.march(name, h=1e-2, t_end=1.0, every=30)
        assert {c for c in there if "[" in c} == {c for c in march.to_frame() if "[" in c}
        first = there[(there["form"] == "u-lambda") & (there["h"] == 1e-2)]
        for column in march.to_frame():
            assert first[column].tolist() == march.to_frame()[column].tolist()


def test_a_problem_in_python_is_kept_from_its_own_process(cli):
    shutil.copy(Path(__file__).parents[2] / "docs/examples/car_axis.py", cli.folder)
    config = STUDY.replace("pendulum", '{python: "car_axis.py:car_axis", args: {compiled: false}}')
    config = config.replace("[1e-2, 5e-3]", "1e-2").replace("t_end: 1.0", "steps: 20")
    cli.write("swing.yaml", config.replace("every: 30", "at: [0.1, 0.2]"))
    cli("run", "swing.yaml", "--allow-code")
    rows = rows_in(cli.folder / "results/trajectory/swing.csv")
    subject = newmark.problem(f"{cli.folder}/car_axis.py:car_axis", compiled=False)
    march = newmark.march(subject, h=1e-2, at=[0.1, 0.2])
    assert march.numbers.tolist() == [10, 20]
    same_rows(rows[:2], march.to_frame())
    cli.write("swing.yaml", config.replace("every: 30", "at: 0.3"))
    line = cli.refused("validate", "swing.yaml", "--allow-code")
    assert "trajectory: 0.3 s is outside the march with h = 0.01, 0 to 0.2 s" in line


@pytest.fixture
def ran(cli):
    """The command line, after a run of the study."""
    cli.write("swing.yaml", STUDY)
    cli("run", "swing.yaml")
    return cli


def test_parquet_has_the_same_bits(ran):
    """The rows of the CSV, which it replaces, until a run writes a CSV again."""
    pytest.importorskip("pyarrow")
    folder = ran.folder / "results"
    before = newmark.trajectories(folder, "swing")
    ran("run", "swing.yaml", "--trajectories", "parquet")
    assert [path.name for path in (folder / "trajectory").iterdir()] == ["swing.parquet"]
    assert records.changed(folder, ["swing"]) == []
    found = newmark.trajectories(folder, "swing")
    assert found.columns.tolist() == before.columns.tolist()
    assert (found["step"].dtype, found["t"].dtype) == (np.int64, np.float64)
    for column in before:
        assert found[column].tolist() == before[column].tolist()
    other = pd.read_parquet(folder / "trajectory/swing.parquet")
    assert other["lambda[bars.rod]"].tolist() == before["lambda[bars.rod]"].tolist()
    (folder / "trajectory/swing.parquet").write_bytes(b"PAR1" + bytes(40) + b"PAR1")
    with pytest.raises(newmark.InputError, match=r"swing\.parquet: not Parquet: .+$"):
        newmark.trajectories(folder, "swing")
    ran("run", "swing.yaml")
    assert [path.name for path in (folder / "trajectory").iterdir()] == ["swing.csv"]


def test_parquet_without_pyarrow_is_refused_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(newmark.InputError, match=r"pip install 'newmark-study\[parquet\]'$"):
        runner.run_studies([], tmp_path / "r", runner.Options(1, parquet=True))
    assert not (tmp_path / "r").exists()


def test_the_frame_of_a_run_has_its_trajectories(ran):
    """The same as the file of the command line, whether a folder is kept or not."""
    expected = newmark.trajectories(ran.folder / "results", "swing")
    frame = newmark.run(ran.folder / "swing.yaml")
    part = frame[frame["form"] == "u-lambda"]
    for found in (newmark.trajectories(frame), newmark.trajectories(part, "swing")):
        pd.testing.assert_frame_equal(found, expected, check_exact=True)
    assert newmark.slopes(frame)["measure"].tolist().count("trajectory") == 10


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: newmark.trajectories(pd.DataFrame()), "frame has no trajectories"),
        (lambda: newmark.trajectories(3), "give rows of run or a results folder, given 3"),
        (lambda: newmark.trajectories("results"), "study must be the name of one, given None"),
        (lambda: newmark.trajectories("nowhere", "swing"), "no trajectories of 'swing'"),
    ],
)
def test_mistakes_of_callers(tmp_path, monkeypatch, call, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(newmark.InputError, match=words):
        call()


def test_trajectories_that_no_memory_holds_are_refused(cli):
    """With what they would be and what is allowed; of one case, and of all."""
    text = STUDY.replace("[1e-2, 5e-3]", "1e-6").replace("[u-lambda, v-lambda]", "u-lambda")
    cli.write("swing.yaml", text.replace("{every: 30}", "{every: 1}"))
    # Step, time, two components of u, v and a, one of λ, the energy; both ends.
    count = (1_000_000 + 1) * (2 + 3 * 2 + 1 + 1)
    assert cli.refused("validate", "swing.yaml") == (
        f"newmark-study: swing.yaml, line 8: trajectory: trajectory of {count} numbers in all "
        "cases, at most 5000000; keep fewer steps, or less of each"
    )
    cases = "".join(f"  - {{h: {h}, trajectory: {{keep: lambda}}}}\n" for h in ("1e-6", "9e-7"))
    lines = [line for line in text.splitlines(True) if line[:2] not in ("h:", "tr")]
    cli.write("swing.yaml", "".join(lines) + "cases:\n" + cases)
    line = cli.refused("validate", "swing.yaml")
    assert "trajectory of 6333339 numbers in all cases, at most 5000000" in line
