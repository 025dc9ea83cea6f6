"""CSVs: whatever a name has in it, what is written reads back, and is no formula elsewhere."""

import csv
import io
import json

import numpy as np
import pandas as pd
import pytest
from conftest import SWING
from hypothesis import example, given
from hypothesis import strategies as st

from newmark_cli.report.judging import slopes
from newmark_cli.study.csv_files import NUMBERS, csv_text, parse_csv
from newmark_cli.study.csv_rows import SERIES, read_record, read_rows, read_study

#: Names that a spreadsheet would compute, or begin a cell in.
FORMULAS = (
    "=1+1", "+1+cmd", "-1+1", "@SUM(1)", "\t=1", "=cmd|' /C calc'!A1.yaml", '="x"',
    " =1", '"=1"', "'=1", "''=1",
)  # fmt: skip

#: Any characters, those that mean something to CSVs or spreadsheets more often.
names = st.text(
    st.characters(exclude_categories=["Cs"], exclude_characters="\r")
    | st.sampled_from([*"=+-@'\";, \t|\n"]),
    max_size=30,
)


def written(rows):
    """The rows as `csv_text` writes them, under columns a, b, …"""
    columns = [chr(ord("a") + k) for k in range(len(rows[0]))]
    return csv_text(columns, [dict(zip(columns, row, strict=True)) for row in rows])


@given(st.lists(st.tuples(names, names, names), min_size=1, max_size=5))
@example([(name, "'", "x") for name in FORMULAS])
def test_any_name_reads_back(rows):
    """To the character, next to any others; each row begins in the line that is said."""
    text = written(rows)
    found, begins = parse_csv(text)
    assert found == [["a", "b", "c"], *map(list, rows)]
    lines = text.split("\n")
    for row, line in zip(found, begins, strict=True):
        assert parse_csv("\n".join(lines[line - 1 :]))[0][0] == row


@pytest.mark.parametrize("name", FORMULAS)
def test_no_name_is_a_formula(name):
    """At the beginning of a cell."""
    text = written([(name, "x")])
    guarded, _ = list(csv.reader(io.StringIO(text)))[1]
    assert guarded.startswith("'")
    assert parse_csv(text)[0][1] == [name, "x"]


def test_numbers_stay_numbers():
    """A minus before a number is no formula; nor are orders, one after the other."""
    text = csv_text(["x", "orders"], [{"x": -1.5, "orders": "-0.0975 0.0547 nan -1e+20"}])
    assert text == "x,orders\n-1.5,-0.0975 0.0547 nan -1e+20\n"
    assert csv_text(["x"], [{"x": "-2"}]) == "x\n-2\n"
    assert csv_text(["x"], [{"x": "-2-2"}]) == "x\n'-2-2\n"


@pytest.mark.parametrize("file", ["pendulum-u", "all-forms", "slopes", "trajectory/history"])
def test_committed_files_are_written_the_same(committed_folder, file):
    """Byte for byte, from what is read of them."""
    text = (committed_folder / f"{file}.csv").read_bytes().decode()
    (header, *rows), _ = parse_csv(text)
    assert csv_text(header, [dict(zip(header, row, strict=True)) for row in rows]) == text


@pytest.mark.parametrize("study", ["pendulum-u", "andrews-u", "krylov", "sensitivity"])
def test_rows_and_series_are_those_that_pandas_finds(committed_folder, study):
    """Numbers to the last bit; series in the order of their first rows, each with its own."""
    path = committed_folder / f"{study}.csv"
    frame = pd.read_csv(path, keep_default_na=False, dtype=object)
    for column in NUMBERS:
        frame[column] = frame[column].replace("", "nan").astype(float)
    table = read_rows(path)
    for column in NUMBERS:
        np.testing.assert_array_equal(table[column], frame[column].to_numpy(float), column)
    axes = [name for name in SERIES if name in frame]  # others have one value only
    groups = frame.groupby([*axes, frame["steps"] == 0], sort=False)
    found = slopes.of_csv(path)
    assert len(found) == len(groups) > 3
    for slope, (_, rows) in zip(found, groups, strict=True):
        assert (slope.measure, slope.quantity) == tuple(rows.iloc[0][["measure", "quantity"]])
        assert slope.h.tolist() == rows["h"].tolist()
        assert slope.statuses == tuple(rows["status"])
        np.testing.assert_array_equal(slope.values, slope.record.drawn(rows))
    texts = [
        csv_text(slopes.COLUMNS, [slope.row() for slope in each])
        for each in (found, slopes.study_slopes(read_study(path), path, read_record(path)))
    ]
    assert texts[0] == texts[1]


def test_a_run_with_any_name_can_be_read(cli):
    """Every command takes what `run` writes; errors name the line that an editor shows."""
    name = "=1\u2028\u2029\x85\v\f\x1c\n;=2"
    cli.write("mine.py", SWING)
    config = {
        "study": "odd", "problem": {"python": "mine.py:swing", "args": {"what": name}},
        "form": "u-lambda", "preconditioning": "none", "h": [0.1, 0.05, 0.02], "t_end": 1.0,
        "measure": ["condition", "trajectory"],
    }  # fmt: skip
    cli.write("odd.yaml", json.dumps(config))
    cli("run", "odd.yaml", "--allow-code")
    label = f"mine.py:swing(what={name})".replace(",", "_")
    path = cli.folder / "results" / "odd.csv"
    assert read_study(path)["problem"].unique().tolist() == [label]
    for command in (("check",), ("show", "odd"), ("show", "--record")):
        cli(*command)
    cli("plot", "odd", "--measure", "condition", "--format", "svg")
    cli("compare", "results", "results")
    # The name has one line feed, so that a row takes two lines.
    before, *rest = path.read_bytes().split(b",ok,")
    path.write_bytes(b",ok,".join([before, rest[0]]) + b",fine," + b",ok,".join(rest[1:]))
    assert "odd.csv, line 4: status is 'fine'" in cli.refused("check")
    # An ending that marches no longer have.
    path.write_bytes(path.read_bytes().replace(b",fine,", b",missed,"))
    assert "missed" in set(read_study(path)["status"])
