"""What `check` notices of a CSV that somebody has changed, with its record and without."""

import functools
import json
import shutil

import pytest
import tampering
from each import each
from tampering import STATISTICS, given, swapped, times, without

from newmark_cli.report import records
from newmark_cli.report.contradictions import contradictions
from newmark_cli.study.reading import read_rows, read_texts, study_files

committed = functools.cache(tampering.read)


def found(path):
    """Contradictions in a CSV that can be read, and its record if there is one."""
    read_rows(path)
    return contradictions(path, read_texts(path), records.known(path))


@pytest.fixture
def tampered(committed_folder, tmp_path):
    """Tampers with a committed study; what is found in a copy without or with a record."""

    def tamper(study, change, record=None):
        columns, rows = committed(committed_folder / f"{study}.csv")
        rows = change(rows)
        path = tmp_path / f"{study}.csv"
        tampering.write(path, columns, rows)
        path.with_suffix(".json").unlink(missing_ok=True)
        if record is not None:
            given = json.loads((committed_folder / f"{study}.json").read_text())
            record(given)
            given["rows"] = len(rows)
            path.with_suffix(".json").write_text(json.dumps(given))
        return [f"{entry.line}: {entry.text}" for entry in found(path)]

    return tamper


def test_nothing_is_said_of_what_a_run_has_written(committed_folder):
    """Of no committed study, with its record or without."""
    for path in study_files(committed_folder):
        texts = read_texts(path)
        assert contradictions(path, texts, records.known(path)) == []
        # Without it less is looked at: of long ones that is enough.
        assert len(texts.lines) > 1000 or contradictions(path, texts, {}) == []


def test_nothing_is_said_of_older_files(tampered, tmp_path):
    """Columns that came later may be missing."""
    assert tampered("pendulum-u", lambda rows: rows) == []
    path = tmp_path / "pendulum-u.csv"
    columns, rows = tampering.read(path)
    for column in ("met", "stop", "row_block"):
        columns.remove(column)
        tampering.write(path, columns, rows)
        assert found(path) == []


#: Change → what is said of it first, of a CSV that stands alone.
ALONE = {
    "drawn values times 10": (
        "pendulum-u", lambda rows: times(rows, 10),
        "2: rms 4.84575e-16 is above 9.66731e-17, the most that max and median allow",
    ),
    "one drawn value times 10": (
        "multipliers", lambda rows: times(rows, 10, lambda row: row is rows[300]),
        "302: rms 1.70348e-19 is above 7.6291e-20, the most that max and median allow",
    ),
    "drawn values over 10": (
        "andrews-u", lambda rows: times(rows, 0.1),
        "2: rms 6.77746e-19 is below 4.48244e-18, the least that max and median allow",
    ),
    "scaled corrections without the physical ones": (
        "andrews-u",
        lambda rows: times(rows, 10, lambda row: row["measure"] == "correction", STATISTICS),
        "4: rms of the physical correction of u is 6.77746e-18, where line 2 and the scaling say "
        "6.77746e-17",
    ),
    "recovered corrections": (
        "pendulum-v",
        lambda rows: times(rows, 1 + 1e-6, lambda row: row["role"] == "recovered", STATISTICS),
        "4: rms of the physical correction of u is",
    ),
    "condition numbers times 1.1": (
        "pendulum-u", lambda rows: times(rows, 1.1, lambda row: row["measure"] == "condition"),
        "8: median 177514 is above max 162406",
    ),
    "conditions at the initial state times 1.1": (
        "all-forms", lambda rows: times(rows, 1.1, lambda row: row["measure"] == "condition"),
        "1694: median 1.24451e+17 is above max 1.13137e+17",
    ),
    "condition numbers below 1": (
        "pendulum-u",
        lambda rows: times(rows, 1e-9, lambda row: row["measure"] == "condition", STATISTICS),
        "8: a condition number of 0.000160642 is below 1",
    ),
    "sensitivities of one scaling": (
        "all-forms",
        lambda rows: times(
            rows, 1.1,
            lambda row: row["measure"] == "sensitivity" and row["preconditioning"] == "left",
            STATISTICS,
        ),
        "the sensitivity is 1.1 times that of other series",
    ),
    "errors": (
        "error", lambda rows: times(rows, 10, lambda row: row["measure"] == "error"),
        "2: last 0.0637475 is above max 0.00637475",
    ),
    "steps that met a tolerance": (
        "tolerance", lambda rows: given(rows, lambda row: row["met"] == "298", met="299"),
        "2: met is '299', where 298 of 300 steps converged",
    ),
    "iterations": (
        "krylov",
        lambda rows: times(rows, 1.001, lambda row: row["measure"] == "krylov_iterations",
                           STATISTICS),
        "2: iterations are not whole numbers",
    ),
    "neighbours swapped": (
        "andrews-u", lambda rows: swapped(rows, 1, 2), "3: rows of correction are in another order",
    ),
    "rows swapped": (
        "pendulum-u", lambda rows: swapped(rows, 3, 10),
        "6: rows of the cell of line 2 stand apart from it",
    ),
    "a series removed": (
        "pendulum-u",
        lambda rows: without(rows, quantity="lambda", measure="correction", preconditioning="left"),
        "30: the cell has correction, but no row correction lambda",
    ),
    "the smallest h of a series removed": (
        "error", lambda rows: without(rows, quantity="v", measure="error", h="1e-07"),
        "the cell has error, but no row error v",
    ),
    "a row that is not there": (
        "pendulum-u", lambda rows: given(rows, lambda row: row is rows[0], quantity="v"),
        "2: the cell has correction, but no row correction u",
    ),
    "steps": (
        "pendulum-u", lambda rows: given(rows, lambda row: row["h"] == "0.1", steps="31"),
        "2: 31 steps of h = 0.1 do not end at t_end = 3",
    ),
    "t_end": (
        "andrews-u", lambda rows: given(rows, t_end="0.03"),
        "2: 20 steps of h = 0.001 do not end at t_end = 0.03",
    ),
    "t_end and steps": (
        "andrews-u", lambda rows: given(rows, lambda row: row["h"] == "0.001", t_end="0.021",
                                        steps="21"),
        "2: newton_iterations is",
    ),
    "h": (
        "pendulum-u", lambda rows: given(rows, lambda row: row["h"] == "0.1", h="0.2"),
        "2: 30 steps of h = 0.2 do not end at t_end = 3",
    ),
    "iterations on average": (
        "pendulum-u", lambda rows: given(rows, newton_iterations="4.97"),
        "2: newton_iterations is '4.97', which is not a mean over 30 steps",
    ),
    "zeros": (
        "pendulum-u", lambda rows: given(rows, lambda row: row["zeros"] == "21", zeros="11"),
        "2: 11 of 30 values are zeros, and the median is 0",
    ),
    "a status": (
        "tolerance", lambda rows: given(rows, lambda row: row is rows[0], status="ok"),
        "2: status is 'ok', and 2 steps did not converge",
    ),
    "an outcome that differs within a cell": (
        "pendulum-u",
        lambda rows: given(rows, lambda row: row is rows[0], newton_iterations="5.0"),
        "3: newton_iterations is '4.966666666666667', and '5.0' in line 2 of the same cell",
    ),
    "a spreadsheet's numbers": (
        "pendulum-u", lambda rows: given(rows, lambda row: row["h"] == "0.0001", h="1E-04"),
        "h is '1E-04', which would be '0.0001'",
    ),
}  # fmt: skip


@each("name", ALONE)
def test_what_a_csv_alone_tells(tampered, name):
    """With no record, or one of other contents: the line, and what is wrong there."""
    study, change, said = ALONE[name]
    texts = tampered(study, change)
    assert any(said in text for text in texts), texts[:3]


def by(factor, *columns):
    return lambda rows: times(rows, factor, columns=columns)


#: Change that a CSV alone cannot tell from another study's results → what its record says.
RECORDED = {
    "the smallest h removed": (
        "pendulum-u", lambda rows: without(rows, h="0.0001"),
        "lacks 4 cells of the config in its record: pendulum u-lambda none h=0.0001 steps=30000; ",
    ),
    "a variant removed": (
        "andrews-u", lambda rows: without(rows, preconditioning="left"),
        "lacks 5 cells of the config in its record: andrews u-lambda left h=0.001 steps=20; ",
    ),
    "t_end and steps": (
        "andrews-u", lambda rows: by(2, "t_end")([row | {"steps": str(2 * int(row["steps"]))}
                                                  for row in rows]),
        "the config in its record has no cell andrews u-lambda none h=0.001 steps=40",
    ),
    "cells in another order": (
        "history", lambda rows: swapped(rows, 0, 1),
        "2: cells are in another order than in the config in its record",
    ),
    "a measure removed": (
        "pendulum-u", lambda rows: without(rows, measure="condition"),
        "2: the cell lacks its rows of condition",
    ),
}  # fmt: skip


@each("name", RECORDED)
def test_what_the_record_tells(tampered, name):
    """Nothing without it; with it, also where its list of cells was made to fit, or its config."""
    study, change, said = RECORDED[name]
    assert tampered(study, change) == []
    for forget in (lambda record: None, lambda record: record.pop("cells")):
        assert any(said in text for text in tampered(study, change, forget))
    if name != "a measure removed":
        texts = tampered(study, change, lambda record: record.pop("config"))
        assert any("the list of cells in its record" in text for text in texts)


def test_a_config_that_was_changed(tampered):
    """Its checksum tells."""
    for change, said in (
        (lambda record: None, []),
        (
            lambda record: record["config"].update(description="mine"),
            ["1: the config in its record is not the one that config_sha256 is of"],
        ),
    ):
        assert tampered("pendulum-u", lambda rows: rows, change) == said


def test_what_cannot_be_known(tampered):
    """A factor on all that is said of a series, and what the record says as the CSV does."""
    for change in (
        by(10, *STATISTICS),
        lambda rows: times(rows, 1.1, lambda row: row["measure"] == "condition", STATISTICS),
    ):
        assert tampered("andrews-u", change) == tampered("andrews-u", change, lambda r: None) == []


@each(
    "record",
    [
        {},
        {"config": 3, "cells": 4},
        {"config": {"cases": [{}]}},
        {"config": {"cases": [None]}},
        {"cells": [{"h": "x"}]},
    ],
)
def test_records_that_say_nothing(committed_folder, tmp_path, record):
    """Of other versions, or damaged: the CSV is as good as alone."""
    path = tmp_path / "pendulum-u.csv"
    shutil.copy(committed_folder / path.name, path)
    assert contradictions(path, read_texts(path), record) == []


def test_check_and_report_say_it(cli, committed_folder):
    """A line for each with file and line, the number in the summary, and exit code 1."""
    columns, rows = tampering.read(committed_folder / "pendulum-u.csv")
    path = cli.folder / "results" / "pendulum-u.csv"
    tampering.write(path, columns, rows)
    assert cli("check").stdout.endswith("\n28 of 28 slopes as predicted\n")
    tampering.write(path, columns, swapped(rows, 1, 2))
    done = cli("check", code=1)
    said = "results/pendulum-u.csv, line 3: not what the tool writes: rows of correction are in"
    assert said in " ".join(done.stdout.split())
    assert done.stdout.rstrip().endswith(", 1 not what the tool writes")
    (entry,) = [e for e in json.loads(cli("check", "--json", code=1).stdout) if "line" in e]
    assert entry == {
        "study": "pendulum-u",
        "line": 3,
        "contradiction": "rows of correction are in another order",
    }
    cli("report")
    assert said in (cli.folder / "results" / "report.html").read_text()


def test_cells_that_did_not_end_well(cli):
    """Failed, diverged, stagnated and unconverged cells, accepted or not, contradict nothing."""
    cli.write(
        "bad.yaml",
        """\
study: bad
problem: pendulum
form: [u-lambda, u-v-a-lambda]
preconditioning: [none, {name: mine, left: {D: h^2*beta}}]
accept: [not_converged, diverged]
cases:
  - {h: [0.5, 0.25, 0.125], t_end: 1.0, iteration_cap: 2, measure: [correction, history]}
  - {h: [0.5, 0.3], t_end: 2, stop: {absolute: 1e-8}, measure: [tolerance, invariant, error]}
  - {h: [1e-3], steps: 0, measure: [condition, sensitivity]}
  - {h: [1e+3, 1e+30, 1e+100], steps: 3, measure: [correction, condition, invariant]}
""".replace("2, stop", "1.5, stop").replace("0.5, 0.3]", "0.5, 0.25]"),
    )
    done = cli.warm.run(["run", "bad.yaml"], cli.folder)
    assert done.returncode in (0, 1), done.stderr
    path = cli.folder / "results" / "bad.csv"
    assert len(set(read_rows(path)["status"])) > 1
    assert found(path) == []
    path.with_suffix(".json").unlink()
    assert found(path) == []
