"""`show`, and how tables fit a terminal: values as in the CSV, nothing lost, colour for people."""

import contextlib
import fcntl
import json
import math
import os
import pty
import re
import struct
import termios
import threading
from unittest import mock

import pytest
from conftest import rows_in
from test_slopes import power, series

from newmark_cli.report.judging import text
from newmark_cli.study import csv_files

#: A series with an order of its own between every two step sizes: 1e-9 h² and so on.
BENT = {1e-2: 8e-5, 1e-3: 8e-7, 1e-4: 2e-8, 1e-5: 2e-10}
DAMPED = "generalized-alpha rho=0.9"


def write(cli, table, study="own"):
    """A study's CSV in the results folder."""
    table = [row | {"study": study} for row in table]
    return cli.write(f"results/{study}.csv", csv_files.csv_text(csv_files.COLUMNS, table))


def tables(printed):
    """Rows of the printed tables, entry by entry, in the order of the lines."""
    return [re.split(r"\s{2,}", line.strip()) for line in printed.splitlines()]


def test_values_and_local_orders(cli):
    """Values as in the CSV, largest h first, with the order between each two in closed form."""
    path = write(cli, series(BENT, measure="error", quantity="u", integrator=DAMPED))
    lines = tables(cli("show", "own").stdout)
    start = lines.index(["h", "value"])
    printed = lines[start + 2 : start + 6]
    by_h = sorted((float(row["h"]), float(row["last"])) for row in rows_in(path))[::-1]
    for place, ((h, value), line) in enumerate(zip(by_h, printed, strict=True)):
        assert line[:2] == [f"{h:g}", f"{value:.3g}"]
        if place:
            order = math.log10(by_h[place - 1][1] / value)
            assert line[2] == f"{order:.2f}"
    assert [line[2] for line in printed[1:]] == ["2.00", "1.60", "2.00"]


def test_fits_are_those_of_slopes_csv(cli, committed_folder, monkeypatch):
    """Slope, range, prediction, verdict below each series; the JSON has the same."""
    monkeypatch.setenv("COLUMNS", "120")
    for name in ("pendulum-u.csv", "pendulum-u.json"):
        cli.write(f"results/{name}", (committed_folder / name).read_text())
    cli("plot", "1")
    rows = rows_in(cli.folder / "results/slopes.csv")
    fits = {(row["measure"], row["quantity"], row["preconditioning"]): row for row in rows}
    lines = tables(cli("show", "pendulum-u", "--quantity", "jacobian").stdout)
    assert ["h", "none", "left", "right", "optimal"] in lines
    (slopes,) = (line for line in lines if line[0].startswith("slope"))
    for name, printed in zip(("none", "left", "right", "optimal"), slopes[1:], strict=True):
        given = float(fits["condition", "jacobian", name]["slope"])
        assert float(printed.partition(" ")[0].replace("−", "-")) == pytest.approx(given, abs=5e-3)
    assert ["fitted", *["0.1 … 0.0001"] * 4] in lines
    assert ["predicted", "−4 ± 0.02", "−2 ± 0.02", "−2 ± 0.02", "0 ± 0.02"] in lines
    assert ["verdict", *["pass"] * 4] in lines
    (study,) = json.loads(cli("show", "pendulum-u", "--json", "--measure", "condition").stdout)
    assert (study["cells"], study["statuses"]) == (16, {"ok": 16})
    assert len(study["series"]) == 4
    rows = rows_in(cli.folder / "results/pendulum-u.csv")
    rows = [row for row in rows if row["measure"] == "condition"]
    for found in study["series"]:
        ours = [r for r in rows if r["preconditioning"] == found["preconditioning"]]
        points = {p["h"]: p["value"] for p in found["values"]}
        assert points == {float(r["h"]): float(r["median"]) for r in ours}
        assert found["slope"] == float(
            fits["condition", "jacobian", found["preconditioning"]]["slope"]
        )
        assert found["values"][0]["local_order"] is None


def test_zeros_statuses_and_holes(cli):
    """A zero is 0, what is not there –, and a cell that is not ok says so under its value."""
    values = {1e-1: 1e-9, 1e-2: 0.0, 1e-3: 3e-9}
    table = series(values, preconditioning="none")
    table += series({1e-1: 1e-9, 1e-2: 2e-9}, preconditioning="optimal")
    table[-1] |= {"status": "not_converged"}
    table += series({1e-2: ""}, preconditioning="left", status="diverged")
    lines = tables(write(cli, table) and cli("show", "own").stdout)
    start = lines.index(["h", "none", "optimal", "left"])
    assert lines[start + 2 : start + 6] == [
        ["0.1", "1e-09", "1e-09", "–"],
        ["0.01", "0", "2e-09", "−0.30", "diverged"],
        ["not_converged"],
        ["0.001", "3e-09", "–", "–"],
    ]


def test_recovered_fields_only_when_asked_for(cli, quick):
    """By default the unknowns of the form; --quantity a shows what was recovered."""
    cli("run", "quick.yaml")
    shown = cli("show", "quick").stdout
    assert "Δu (physical)" in shown
    assert "Δa (physical)" not in shown
    assert "4 series of recovered fields are not shown" in shown
    shown = cli("show", "quick", "--quantity", "a").stdout
    assert "Δa (physical)" in shown
    assert "Δu" not in shown


def test_studies_of_a_folder(cli):
    """Without a study: cells by status, measures, verdicts of each."""
    write(cli, series(power(-2)))
    write(cli, series({1e-1: ""}, status="failed", measure="", quantity="", role=""), "broken")
    found = {study["study"]: study for study in json.loads(cli("show", "--json").stdout)}
    assert found == {
        "broken": {"study": "broken", "cells": 1, "statuses": {"failed": 1}, "measures": [],
                   "verdicts": {"incomplete": 1}},
        "own": {"study": "own", "cells": 4, "statuses": {"ok": 4}, "measures": ["correction"],
                "verdicts": {"pass": 1}},
    }  # fmt: skip
    assert ["own", "4 ok", "correction", "1 pass"] in tables(cli("show").stdout)
    assert "andrews, u-lambda: incomplete, cells failed: none" in cli("show", "broken").stdout


def conditions(steps=(1e-2, 1e-3, 1e-4, 1e-5)):
    """Rows of a study that is as predicted: a whole cell each, at the initial state."""
    return series(
        {h: h**-4 for h in steps}, quantity="jacobian", measure="condition", t_end=0.0, steps=0,
        newton_iterations="",
    )  # fmt: skip


def test_check_of_one_study(cli):
    """Only it is judged and printed, and nothing is written."""
    write(cli, conditions(), "good")
    write(cli, series(power(-3)), "bad")
    before = sorted(cli.folder.rglob("*"))
    whole = cli("check", code=1)
    everything = json.loads(cli("check", "--json", code=1).stdout)
    assert {row["study"] for row in everything} == {"good", "bad"}
    done = cli("check", "good")
    assert done.stdout == "1 of 1 slopes as predicted\n"
    assert [r["study"] for r in json.loads(cli("check", "good", "--json").stdout)] == ["good"]
    assert cli("check", "bad", code=1).stdout == whole.stdout.replace("1 of 2", "0 of 1")
    assert (
        "miss: bad andrews u-lambda trapezoidal none, Δλ: local orders −3.00 −3.00 −3.00"
        in whole.stdout
    )
    assert sorted(cli.folder.rglob("*")) == before


def test_remarks_are_not_endless(cli):
    """Twenty series are explained, all of them with --all; Markdown and JSON have none."""
    write(cli, [row for n in range(23) for row in series(power(-3), problem=f"p{n}")])
    lines = cli("check", code=1).stdout.splitlines()
    assert sum(line.startswith("miss: ") for line in lines) == 20
    assert "… and 3 more (--all)" in lines
    lines = cli("check", "--all", code=1).stdout.splitlines()
    assert sum(line.startswith("miss: ") for line in lines) == 23
    assert "miss: " not in cli("check", "--markdown", code=1).stdout


WIDE = [
    ("name", "number", "said"),
    ("first", "−2.05 ± 0.05", "one two three four five six seven " * 4),
    ("a heading of what is below",),
    ("second", "0", "unbreakable" * 12),
]


@pytest.mark.parametrize("columns", ["40", "80", "120", "400"])
def test_tables_are_folded_not_cut(monkeypatch, columns):
    """No line is wider than the terminal, and every character of every entry is there."""
    monkeypatch.setenv("COLUMNS", columns)
    printed = text.text_table(WIDE)
    assert max(map(len, printed.splitlines())) <= int(columns)
    letters = sorted("".join("".join(row) for row in WIDE).replace(" ", ""))
    assert sorted(re.sub(r"[\s-]", "", printed)) == letters
    assert columns == "40" or "−2.05 ± 0.05" in printed
    assert "a heading of what is below" in printed.splitlines()


def on_a_terminal(cli, *arguments, columns=100, stream="stdout", **environment):
    """What a command writes to a terminal, of its streams on this one."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    given = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR", "TERM")}
    given |= {"TERM": "xterm-256color"} | environment
    found = []

    def read():
        with contextlib.suppress(OSError):  # the other end is closed
            while part := os.read(ours, 65536):
                found.append(part)

    reader = threading.Thread(target=read)
    reader.start()
    with mock.patch.dict(os.environ, given, clear=True), os.fdopen(theirs, "w") as terminal:
        cli.run(*arguments, **{stream: terminal})
    reader.join()
    os.close(ours)
    return b"".join(found).decode().replace("\r\n", "\n")


def test_colour_on_a_terminal(cli):
    """A miss is red on a terminal; not with NO_COLOR, on a dumb one, or in a pipe."""
    write(cli, series(power(-3)) + series(power(0), preconditioning="optimal"))
    coloured = on_a_terminal(cli, "check", "--all")
    assert re.search(r"\x1b\[31mmiss\s*\x1b\[0m", coloured)
    assert not re.search(r"\x1b\[[0-9;]*mpass", coloured)
    plain = re.sub(r"\s*\x1b\[[0-9;]*m", "", coloured.replace("\x1b[31m", ""))
    for environment in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
        found = on_a_terminal(cli, "check", "--all", **environment)
        assert "\x1b" not in found
        assert found == plain
    assert "\x1b" not in cli("check", "--all", code=1).stdout
