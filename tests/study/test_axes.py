"""One declaration of what tells cells, rows and series apart."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import command_line
import pytest
from conftest import QUICK, rows_in

from newmark_cli.newmark.scaling import Preconditioning, canonical
from newmark_cli.report.judging import slopes
from newmark_cli.study import axes, config, csv_files

#: The columns of CSVs as they have always been, by hand.
STUDY_COLUMNS = (
    "study,problem,integrator,form,preconditioning,evaluation,precision,linear_solver,h,t_end,"
    "steps,quantity,measure,role,rms,max,median,last,zeros,not_converged,newton_iterations,status,"
    "row_block,stop,met,formulation,projection,multipliers,start,rounding,h_sequence,auxiliary,"
    "code"
)


def test_columns_are_appended():
    """What older programs read stands where it stood."""
    assert ",".join(csv_files.COLUMNS) == STUDY_COLUMNS


def test_cells_come_in_the_order_of_the_csv():
    """Form, scaling and step size vary fastest, in the order given."""
    study = config.load_shipped("integrators")
    found = [(c.integrator.label, c.form, c.preconditioning.label, c.h) for c in study.cells()]
    (case,) = study.cases[:1]
    scalings = case.axes()["preconditioning"]
    expected = [
        (i.label, form, scaling, h)
        for i in case.integrator for form in case.form for scaling in scalings for h in case.h
    ]  # fmt: skip
    assert found[: len(expected)] == expected
    assert case.count == len(expected)


def strip(path, *columns):
    """A CSV as a version wrote it that did not know some columns."""
    rows = rows_in(path)
    kept = [name for name in rows[0] if name not in columns]
    path.write_text(
        "\n".join([",".join(kept), *(",".join(row[name] for name in kept) for row in rows)]) + "\n"
    )


@pytest.mark.parametrize(
    "missing", [("row_block", "stop", "met"), ("evaluation",), ("precision", "linear_solver")]
)
def test_older_csvs_are_read_with_defaults(cli, committed_folder, missing):
    """A column that did not exist has the value that went without saying; verdicts stay."""
    path = cli.folder / "pendulum-u.csv"
    path.write_text((committed_folder / path.name).read_text())
    now = [slope.row() for slope in slopes.of_csv(path)]
    strip(path, *missing)
    then = [slope.row() for slope in slopes.of_csv(path)]
    assert json.dumps(then) == json.dumps(now)


def test_two_spellings_of_a_scaling_are_one():
    """In configs, in CSVs and in what is kept."""
    one = Preconditioning("x", (("C", "1"), ("D", "beta*h^2")), (("lambda", "1/h"),), own=True)
    other = Preconditioning("x", (("D", "h*beta * h"), ("C", "1")), (("lambda", "h^-1"),), own=True)
    assert one == other
    assert one.label == "x[left D=beta*h^2 C=1; right lambda=1/h]"
    assert canonical("x[left C=1 D=h^2*beta; right lambda=h^-1]") == one.label
    assert canonical("no label[") == "no label["


def test_a_series_at_the_start_is_another():
    """Condition numbers at the initial state and along a run differ in their key."""
    row = {"study": "s", "problem": "p", "form": "u-lambda", "preconditioning": "none",
           "quantity": "jacobian", "measure": "condition"}  # fmt: skip
    start, run = (axes.SeriesKey.of(row | {"steps": steps}) for steps in (0, 30))
    assert start != run
    assert (start.initial, run.initial) == ("start", "")
    # What goes without saying need not be said.
    assert run == axes.SeriesKey.of(row | {"steps": 30, "evaluation": "direct", "row_block": ""})


#: Runs commands with files of the package changed, and prints what each printed.
CHANGED = """\
import importlib.util
import json
import sys

changes, commands = json.loads(sys.argv[1])
for name, old, new in changes:
    spec = importlib.util.find_spec(name)
    source = open(spec.origin).read()
    assert source.count(old) == 1
    assert name not in sys.modules
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    exec(compile(source.replace(old, new), spec.origin, "exec"), module.__dict__)
    parent, _, child = name.rpartition(".")
    setattr(sys.modules[parent], child, module)
from command_line import invoke

printed = []
for arguments in commands:
    done = invoke(arguments, ".")
    assert done.returncode == 0, done.stderr
    printed.append([done.stdout, done.stderr])
print(json.dumps(printed))
"""

#: A new axis, how often a cell is repeated; a new measure, the largest speed along the way; and a
#: new column, how far the values of a row spread. These entries are the whole of them.
ENTRIES = [
    (
        "newmark_cli.study.axes",
        "    stop: Tolerance | None = axis(\n",
        """\
    repeat: str = axis(
        usual="1", initial="1", since=(6, 6), names=("1", "second"), about="names of repetitions",
    )
    stop: Tolerance | None = axis(
""",
    ),
    (
        "newmark_cli.study.measures",
        "_MEASURES = (\n",
        """\
_MEASURES = (
    Measure(
        "speed",
        "largest speed along the way",
        (Record("speed", lambda key: "max |v|", lambda key: "largest speed (m/s)", "max",
                lambda key: 0.0, 0.1),),
    ),
""",
    ),
    (
        "newmark_cli.study.observers",
        "#: Measure → its observer.\n",
        """\
class _Speed(_Sampler):
    def sample(self, march):
        return float(np.abs(march.state.fields[1]).max())

    def measured(self):
        return [Measurement("v", "speed", "primary", statistics(np.array(self.samples)))]


MappingProxyType = lambda table: {**table, "speed": _Speed}
""",
    ),
    (
        "newmark_cli.study.csv_files",
        "AXES = (\n",
        """\
Statistics.spread = property(lambda found: found.max / found.median)
MEASURED = (*MEASURED, Column("spread", "largest value over the median", since=6))
AXES = (
""",
    ),
]


def test_an_axis_a_measure_and_a_column_are_an_entry_each(cli, tmp_path, committed_folder):
    """Configs, cells, CSVs, records, predictions and verdicts follow from the entries."""
    text = QUICK.replace("h: [1e-1, 1e-2]", "h: [1e-2, 5e-3, 2e-3]").replace("t_end: 1", "t_end: 2")
    (tmp_path / "new.yaml").write_text(text + 'measure: speed\nrepeat: ["1", second]\n')
    (tmp_path / "old").mkdir()
    shutil.copy(committed_folder / "pendulum-u.csv", tmp_path / "old")
    commands = (
        ("run", "new.yaml", "-v"), ("run", "new.yaml"), ("check", "--json"), ("check", "--all"),
        ("check", "--json", "--results", "old"),
    )  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", CHANGED, json.dumps([ENTRIES, commands])],
        cwd=tmp_path, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(Path(command_line.__file__).parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    ran, again, checked, every, older = json.loads(done.stdout)
    assert "pendulum u-lambda optimal second h=0.005 steps=400" in ran[1]
    assert "12 cached" in again[0]
    rows = rows_in(tmp_path / "results/quick.csv")
    # Columns of what seldom varies are there where it does.
    seldom = ",h_sequence,auxiliary,code"
    assert ",".join(rows[0]) == STUDY_COLUMNS.removesuffix(seldom) + ",repeat,spread"
    assert {(row["measure"], row["repeat"]) for row in rows} == {
        ("speed", "1"),
        ("speed", "second"),
    }
    for row in rows:
        assert float(row["spread"]) == float(row["max"]) / float(row["median"])
        # The pendulum falls by 1 at most: |v| <= √2, and one component by that at the bottom.
        assert 1.3 < float(row["max"]) < 1.4143
    record = json.loads((tmp_path / "results/quick.json").read_text())
    assert {cell["repeat"] for cell in record["cells"]} == {"1", "second"}
    found = [(s["repeat"], s["verdict"], s["expected"]) for s in json.loads(checked[0])]
    assert found == [(repeat, "pass", 0.0) for repeat in ("1", "1", "second", "second")]
    assert "max |v|" in every[0]
    # A CSV that lacks the columns has the values that go without saying.
    assert {row["repeat"] for row in json.loads(older[0])} == {"1"}
    # Without the entries names are refused.
    done = cli("validate", tmp_path / "new.yaml", code=2)
    assert "repeat: unknown key" in done.stderr
    assert "unknown measure 'speed'" in done.stderr
