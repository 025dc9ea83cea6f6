"""Other codes as cells of a study: programs, Python functions, and tables of runs."""

import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import newmark_cli as newmark

G = 9.81
MECHANISM = """\
points:
  O: {fixed: [0, 0]}
  P: {at: [1, 0], mass: 1, velocity: [0, -1]}
bars:
  rod: {from: O, to: P, length: 1}
gravity: [0, -9.81]
"""
#: The trapezoidal rule on the angle of that pendulum, with the multiplier that follows from it.
C = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
int main(int argc, char **argv) {
  double h = atof(argv[1]), end = atof(argv[2]), x, y, vx, vy, g = 9.81;
  sscanf(argv[3], "%lf,%lf", &x, &y);
  sscanf(argv[4], "%lf,%lf", &vx, &vy);
  double q = atan2(y, x), w = x * vy - y * vx;
  long n = lround(end / h);
  printf("t,u[P.x],u[P.y],v[P.x],v[P.y],lambda[bars.rod],iterations\n");
  for (long k = 0; k <= n; k++) {
    if (k < 3 || k > n - 3)
      printf("%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,4\n", k * h, cos(q), sin(q), -w * sin(q),
             w * cos(q), -w * w + g * sin(q));
    double next = q + h * w, rate = w;
    for (int i = 0; i < 60; i++) {
      rate = w - h / 2 * g * (cos(q) + cos(next));
      next = q + h / 2 * (w + rate);
    }
    q = next, w = rate;
  }
}
"""
#: Velocity Verlet; rows of t, u, v and λ.
PYTHON = """\
import numpy as np

def solve(problem, h, t_end, u0, v0, g=9.81):
    q, w = np.arctan2(u0[1], u0[0]), u0[0] * v0[1] - u0[1] * v0[0]
    rows = []
    for k in range(round(t_end / h) + 1):
        c, s = np.cos(q), np.sin(q)
        rows.append([k * h, c, s, -w * s, w * c, -w * w + g * s])
        after = q + h * w - h * h / 2 * g * c
        w -= h / 2 * g * (c + np.cos(after))
        q = after
    return rows

def named(problem, h, t_end, u0, v0):
    rows = np.array(solve(problem, h, t_end, u0, v0))
    names = [f"{p}[{n}]" for p in "uv" for n in problem.coordinate_names]
    return dict(zip(["t", *names], rows.T))

def fails(problem, h, t_end, u0, v0):
    return 1 / 0

def picky(problem, h, t_end, u0, v0):
    if h < 6e-3:
        raise ValueError(f"h = {h:g} | too small")
    return solve(problem, h, t_end, u0, v0)

def shapeless(problem, h, t_end, u0, v0):
    return [1.0, 2.0]
"""
STUDY = """\
study: mine
problem: pendulum.yaml
integrator: generalized-alpha rho=0.9
code:
CODES
h: [1e-2, 5e-3, 2e-3, 1e-3]
t_end: 1.0
measure: [error, invariant]
"""
COMPILER = shutil.which("cc") or shutil.which("gcc")


@pytest.fixture
def study(cli):
    """Writes the study with some codes, beside the pendulum and the Python code."""
    (cli.folder / "pendulum.yaml").write_text(MECHANISM)
    (cli.folder / "mine.py").write_text(PYTHON)

    def write(*codes, **changes):
        text = STUDY.replace("CODES", "\n".join(f"  - {code}" for code in codes))
        for key, value in changes.items():
            text = "".join(line for line in text.splitlines(True) if not line.startswith(f"{key}:"))
            text += f"{key}: {value}\n"
        (cli.folder / "study.yaml").write_text(text)
        return "study.yaml"

    return write


def table(cli, study="mine"):
    """Rows of the CSV of a study, by code, measure, quantity and h."""
    frame = pd.read_csv(cli.folder / "results" / f"{study}.csv")
    return frame.set_index(["code", "measure", "quantity", "h"]).sort_index()


def solution():
    """u, v and λ of the pendulum at t = 1, from its angle."""
    found = solve_ivp(
        lambda t, y: [y[1], -G * np.cos(y[0])],
        (0, 1),
        [0.0, -1.0],
        "DOP853",
        rtol=1e-13,
        atol=1e-14,
    )
    q, w = found.y[:, -1]
    return (
        np.array([np.cos(q), np.sin(q)]),
        w * np.array([-np.sin(q), np.cos(q)]),
        G * np.sin(q) - w * w,
    )


def written(h, rows=slice(-3, None)):
    """Rows of the Verlet code, as a table of runs has them."""
    space = {}
    exec(PYTHON, space)
    names = ["t", "u[P.x]", "u[P.y]", "v[P.x]", "v[P.y]", "lambda[bars.rod]"]
    solved = space["solve"](None, h, 1.0, np.array([1.0, 0.0]), np.array([0.0, -1.0]))
    return pd.DataFrame(solved[rows], columns=names).assign(h=h)


@pytest.mark.skipif(COMPILER is None, reason="needs a compiler of C")
def test_a_program_a_function_and_a_table_are_cells(cli, study):
    """Errors are those of their rows, orders are judged, and only what is new is run."""
    source, program = cli.folder / "pendulum.c", cli.folder / "pendulum"
    source.write_text(C)
    subprocess.run([COMPILER, "-O2", source, "-o", program, "-lm"], check=True)
    sizes = (1e-2, 5e-3, 2e-3, 1e-3)
    pd.concat([written(h) for h in sizes]).to_csv(cli.folder / "runs.csv", index=False)
    config = study(
        "newmark-study",
        '{name: C, command: [./pendulum, "{h}", "{t_end}", "{u0}", "{v0}"]}',
        "{name: Python, python: mine.py:solve}",
        "{name: last year, table: runs.csv}",
    )
    line = cli.refused("run", config)
    assert line.endswith("./pendulum is code, which runs only with --allow-code"), line
    assert not (cli.folder / "results").exists()
    cli("run", config, "--allow-code")
    rows = table(cli)
    here = subprocess.run(
        [program, "0.001", "1", "1,0", "0,-1"], capture_output=True, text=True, check=True
    )
    last = np.array(here.stdout.splitlines()[-1].split(","), float)
    u, v, multiplier = solution()
    for quantity, ours, there in (("u", last[1:3], u), ("v", last[3:5], v)):
        wanted = np.abs(ours - there).max() / np.abs(there).max()
        assert rows.loc["C", "error", quantity, 1e-3]["last"] == pytest.approx(wanted, rel=1e-5)
    assert rows.loc["C", "error", "lambda", 1e-3]["last"] == pytest.approx(
        abs(last[5] / multiplier - 1), rel=1e-4
    )
    assert (rows.loc["C", "newton_iterations"] == 4).all()
    of_python, of_table = (rows.loc[name, "error"]["last"] for name in ("Python", "last year"))
    assert of_python.to_numpy() == pytest.approx(of_table.to_numpy(), rel=1e-9)
    # Twins tell rounding of the program and the function; a table has that of our own march.
    rounding = rows["rounding"].xs("error", level="measure").xs("u", level="quantity")
    for name in ("C", "Python", "last year", "newmark-study"):
        assert ((rounding[name] > 1e-16) & (rounding[name] < 1e-11)).all(), name
    told = cli("check", "--all").stdout
    assert "12 of 12 slopes as predicted" in told, told
    assert "16 cached" in cli("run", config, "--allow-code").stdout
    (cli.folder / "mine.py").write_text(PYTHON.replace("h / 2 * g * (c", "h / 2 * 1.01 * g * (c"))
    assert "12 cached" in cli("run", config, "--allow-code").stdout
    again = table(cli)["last"]
    assert again["Python", "error", "v", 1e-3] > 1e-3
    assert again["C", "error", "v", 1e-3] == rows.loc["C", "error", "v", 1e-3]["last"]


def test_codes_are_shown_chosen_and_expected(cli, study):
    """In tables, figures and expectations a code is a value like any other."""
    config = study(
        "newmark-study", "{name: Verlet, python: mine.py:named}",
        "{name: light, python: mine.py:solve, args: {g: 9.0}}",
        expect="[{measure: error, code: Verlet, quantity: u, slope: 2, within: 0.05}]",
        tables="[{measure: error, rows: code, columns: quantity}]",
        figures="[{name: both, measure: error, quantity: u}]", form="[u-lambda, v-lambda]",
        measure="[error, trajectory]", trajectory="{every: 500}",
    )  # fmt: skip
    cli("run", config, "--allow-code")
    # Another code has no forms: its cells stand once.
    assert table(cli).groupby("code")["form"].nunique().to_dict() == {
        "newmark-study": 2, "Verlet": 1, "light": 1,
    }  # fmt: skip
    # Gravity is another: that code has the order of nothing.
    told = cli("check", code=1).stdout
    assert "1 of 1 expectations hold" in told
    assert "light" in told
    assert "| Verlet | 2: 2.00 ±" in cli("tables", "mine").stdout
    assert "Verlet" in cli("show", "mine", "--code", "Verlet", "--quantity", "u").stdout
    cli("plot", "mine")
    assert (cli.folder / "results/figures/mine-both-u-lambda.png").stat().st_size > 10_000
    kept = pd.read_csv(cli.folder / "results/trajectory/mine.csv")
    kept = kept[(kept["code"] == "Verlet") & (kept["h"] == 1e-3)]
    assert kept["step"].tolist() == [0, 500, 1000]
    wanted = written(1e-3, slice(None)).iloc[[0, 500, 1000]]
    for name in ("t", "u[P.x]", "v[P.y]"):
        np.testing.assert_allclose(kept[name], wanted[name], rtol=1e-12, atol=1e-15)


def test_a_table_says_which_cells_failed_and_what_the_smallest_h_gives(cli, study):
    """In the order of the config, with the code's own words."""
    config = study(
        "{name: none, python: mine.py:fails}", "{name: picky, python: mine.py:picky}",
        "{name: bad, python: mine.py:solve, args: {g: 9.0}}", "{name: C, python: mine.py:solve}",
        h="[2e-2, 1e-2, 5e-3, 2e-3]", twins=0, accept="failed", measure="[error]",
        tables="[{rows: code, columns: quantity, values: [least, finest, failed]}]",
    )  # fmt: skip
    cli("run", config, "--allow-code")
    lines = [line for line in cli("tables", "mine").stdout.splitlines() if line.startswith("|")]
    names, _, *rows = ([cell.strip() for cell in re.split(r"(?<!\\)\|", x)[1:-1]] for x in lines)
    assert names == ["code", "u", "v", "λ", "failed"]
    none, picky, bad, verlet = rows
    assert none == ["none", *"–––", "at 0.02, 0.01, 0.005, 0.002: "
                    "ZeroDivisionError: division by zero"]  # fmt: skip
    small = "ValueError: h = {0} \\| too small"
    assert picky[-1] == f"at 0.005: {small.format(0.005)}; at 0.002: {small.format(0.002)}"
    end = solution()[1]
    off = {}
    for h in (1e-2, 2e-3):
        found = written(h)[["v[P.x]", "v[P.y]"]].to_numpy()[-1]
        off[h] = f"{np.abs(found - end).max() / np.abs(end).max():.2g} at {h:g}"
    assert (picky[2], verlet[2]) == (off[1e-2], off[2e-3])
    assert re.fullmatch(r"\S+ at \S+: \S+ at 0\.002|\S+ at 0\.002", bad[1])
    listed = cli("tables", "mine", "--list", "--values", "finest,failed", "--format", "csv")
    frame = pd.read_csv(io.StringIO(listed.stdout)).set_index(["code", "quantity"])
    last = table(cli)["last"].xs("error", level="measure")
    assert frame.loc[("C", "u"), "finest"] == last["C", "u", 2e-3]
    assert frame.loc[("none", "failed"), "failed"] == none[-1]


PRINTS = f"command: [{sys.executable}, -c, "


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("command: [./none, '{h}']", "cannot be run: ./none: No such file or directory"),
        (PRINTS + "'import os; os.kill(os.getpid(), 9)']", "ended with signal 9"),
        (PRINTS + "'import sys; sys.exit(\"no luck\")']", "ended with exit code 1: no luck"),
        (PRINTS + "'print(\"h,t,u[P.x]\")']", "its table: no row"),
        (PRINTS + "'print(\"t,u[P.x]\"); print(\"0.5,abc\")']", "not a number, given 'abc'"),
        (PRINTS + "'print(\"t,u[P.x]\"); print(\"0.5,1\")']", "ended at t = 0.5, before t_end = 1"),
        ("python: mine.py:fails", "ZeroDivisionError: division by zero"),
        ("python: mine.py:none", "mine.py has no none"),
        ("python: mine.py:shapeless", "6 numbers each, given shape (2,)"),
        ("table: runs.csv", "runs.csv has no run with h = 0.001; it has 0.01"),
        (PRINTS + "'import time; time.sleep(60)']", "took longer than 2 s"),
    ],
)  # fmt: skip
def test_a_code_that_fails_is_a_cell_that_says_so(cli, study, code, message):
    """In one line, beside cells that are well."""
    written(1e-2).to_csv(cli.folder / "runs.csv", index=False)
    config = study("newmark-study", f"{{name: bad, {code}}}", h="[1e-3]", twins=0)
    # Only what never ends is to meet it: a process takes seconds to start on a busy machine.
    limit = "2" if "time.sleep" in code else "60"
    told = cli("run", config, "--allow-code", "--timeout", limit, code=1).stderr
    complaint = "mine: 1 of 2 cells failed: "
    lines = [line for line in told.splitlines() if complaint in line]
    assert len(lines) == 1, told
    assert message in lines[0]
    assert table(cli)["status"]["newmark-study"].eq("ok").all()


@pytest.mark.parametrize(
    ("codes", "changes", "message"),
    [
        (("exudyn",), {}, "unknown code 'exudyn'; allowed: newmark-study"),
        (("{name: x}",), {}, "needs one of command, python, table, given none"),
        (("{name: x, table: a.csv, python: a.py:f}",), {}, "given python and table"),
        (("{name: x, table: none.csv}",), {}, "table: none.csv: no such file"),
        (("{name: x, python: mine.py}",), {}, 'must be "file.py:function"'),
        (("{name: newmark-study, python: mine.py:solve}",), {}, "take another name"),
        (("{name: x, python: mine.py:solve, series: a}",), {}, "belongs to a table"),
        (("{name: x, pyhton: mine.py:solve}",), {}, "unknown key; did you mean 'python'"),
        (("{name: x, python: mine.py:solve}",) * 2, {}, "given twice"),
        (("{name: x, python: mine.py:solve}", "{name: x, python: mine.py:named}"), {},
         "two codes are named x"),
        (("{name: x, python: mine.py:solve}",), {"measure": "[correction]"},
         "other codes can be measured by error, invariant, trajectory"),
    ],
)  # fmt: skip
def test_mistakes_in_a_code_are_told(cli, study, codes, changes, message):
    """With file, line and key."""
    line = cli.refused("validate", study(*codes, **changes), "--allow-code")
    assert line.startswith("newmark-study: study.yaml, line "), line
    assert message in line


def test_codes_of_one_file_share_a_process_and_no_variables(cli, study):
    """What they import is loaded once; what the file computes is computed anew in each call."""
    counting = """\
import os
from mine import named
made = []

def solve(problem, h, t_end, u0, v0, label):
    made.append(label)
    with open("calls", "a") as file:
        print(os.getpid(), label, len(made), file=file)
    return named(problem, h, t_end, u0, v0)
"""
    (cli.folder / "counting.py").write_text(counting)
    codes = [f"{{name: {k}, python: counting.py:solve, args: {{label: {k}}}}}" for k in "abc"]
    cli("run", study(*codes, h="[1e-2, 5e-3]", twins=0), "--allow-code", "--jobs", "1")
    lines = (cli.folder / "calls").read_text().splitlines()
    pids, labels, counts = zip(*map(str.split, lines), strict=True)
    assert len({*pids}) == 1
    assert sorted(labels) == ["a", "a", "b", "b", "c", "c"]
    assert {*counts} == {"1"}


def test_what_needs_newtons_inside_is_only_of_newmark_study(cli, study):
    """A case may measure both; other codes have no rows of it, which is said."""
    config = study(
        "newmark-study", "{name: Verlet, python: mine.py:solve}", h="[1e-2]",
        measure="[correction, error]",
    )  # fmt: skip
    told = cli("run", config, "--allow-code").stderr
    assert "correction: not of Verlet; only newmark-study shows it" in told
    measures = table(cli).reset_index().groupby("code")["measure"].unique()
    assert measures["Verlet"].tolist() == ["error"]
    assert "correction" in measures["newmark-study"].tolist()


def test_a_table_of_our_own_marches_has_their_errors(cli, study):
    """To the bit: what is measured of a table is what is measured of a march."""
    frames = []
    for h in (1e-2, 5e-3, 2e-3, 1e-3):
        march = newmark.march(
            newmark.problem(Path(cli.folder, "pendulum.yaml")), h=h, t_end=1.0,
            integrator="generalized-alpha rho=0.9",
        )  # fmt: skip
        frames.append(march.to_frame().assign(h=h))
    pd.concat(frames).to_csv(cli.folder / "runs.csv", index=False)
    config = study(
        "newmark-study", "{name: table, table: runs.csv}",
        integrator="generalized-alpha rho=0.9", measure="[error]",
    )  # fmt: skip
    cli("run", config)
    rows = table(cli)
    for column in ("last", "rounding"):
        pd.testing.assert_series_equal(rows.loc["table", column], rows.loc["newmark-study", column])
    assert "6 of 6 slopes as predicted" in cli("check").stdout


def test_a_killed_program_leaves_nothing_behind(cli, study):
    """What a program has started ends with its cell."""
    script = """\
import subprocess
import time
child = subprocess.Popen(["sleep", "50"])
open("pid", "w").write(str(child.pid))
time.sleep(50)
"""
    (cli.folder / "script.py").write_text(script)
    config = study(f"{{name: x, command: [{sys.executable}, script.py]}}", h="[1e-2]")
    cli("run", config, "--allow-code", "--timeout", "1.5", code=1)
    pid = int((cli.folder / "pid").read_text())
    state = Path(f"/proc/{pid}/stat")
    assert not state.exists() or state.read_text().split()[2] == "Z", os.kill(pid, 9)
