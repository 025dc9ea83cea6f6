"""The command line through its real entry point, in an empty folder."""

import json
import os
import re
import shutil
import subprocess
import sys

import click
import pytest
from command_line import SCRIPT, CommandLine
from conftest import QUICK, rows_in
from each import each

from newmark_cli import __version__
from newmark_cli.cli.commands import cli as command_line
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config, csv_files

COMMANDS = tuple(command_line.commands)


@pytest.fixture(scope="module")
def quick_results(tmp_path_factory):
    """Results of the small study."""
    cli = CommandLine(tmp_path_factory.mktemp("quick"))
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    return cli.folder / "results"


@pytest.fixture(scope="module")
def pendulum_results(tmp_path_factory):
    """Results of `pendulum-u`, with a figure."""
    cli = CommandLine(tmp_path_factory.mktemp("pendulum"))
    cli("run", "pendulum-u")
    cli.write("results/figures/figure-1.png", "drawn before")
    return cli.folder / "results"


def snapshot(folder):
    """Every file below a folder with its bytes."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_run_writes_the_contract(cli, quick):
    """Columns, order of rows, values and provenance of a small study."""
    done = cli("run", "quick.yaml")
    assert done.stdout == "quick: 4 ok -> results/quick.csv\n"
    assert done.stderr == ""
    table = rows_in(cli.folder / "results/quick.csv")
    seldom = ("h_sequence", "auxiliary")  # they are there where they vary
    assert tuple(table[0]) == tuple(name for name in csv_files.COLUMNS if name not in seldom)
    keys = [(r["preconditioning"], r["h"], r["quantity"], r["measure"], r["role"]) for r in table]
    per_cell = [
        ("u", "correction", "primary"),
        ("lambda", "correction", "primary"),
        ("u", "physical_correction", "primary"),
        ("v", "physical_correction", "recovered"),
        ("a", "physical_correction", "recovered"),
        ("lambda", "physical_correction", "primary"),
        ("jacobian", "condition", "primary"),
    ]
    assert keys == [
        (v, h, *q) for v in ("none", "optimal") for h in ("0.1", "0.01") for q in per_cell
    ]
    first = table[0]
    assert first["study"] == "quick"
    assert first["integrator"] == "newmark beta=0.25 gamma=0.5"
    assert (first["steps"], first["t_end"], first["status"]) == ("10", "1.0", "ok")
    assert 0 < float(first["rms"]) <= float(first["max"]) < 1e-15
    # Corrections of the unscaled run are those in physical units.
    assert first["rms"] == table[2]["rms"]
    record = json.loads((cli.folder / "results/quick.json").read_text())
    assert record["config"]["cases"][0]["h"] == [0.1, 0.01]
    assert [c["status"] for c in record["cells"]] == ["ok"] * 4
    run = json.loads((cli.folder / "results/runs/quick.json").read_text())
    assert run["versions"]["newmark-study"] == __version__
    assert all(c["wall_seconds"] > 0 for c in run["cells"])


def test_shipped_configs_work_from_any_folder(cli):
    """A name in place of a file; a folder that is called like a config is in nobody's way."""
    for name in config.shipped():
        (cli.folder / name).mkdir()
    cli("list")
    cli("run", "pendulum-v", "--results", "pendulum-u")
    assert len(rows_in(cli.folder / "pendulum-u/pendulum-v.csv")) == 16 * 7


def test_plot_and_check_read_the_csv_alone(cli, pendulum_results):
    """Figures that it is enough for, slopes.csv, the table and its JSON; the same bytes twice.

    The other figures are named in one line, with what to run for them.
    """
    (cli.folder / "results").mkdir()
    shutil.copy(pendulum_results / "pendulum-u.csv", cli.folder / "results")
    # A study of one's own under a shipped one's name is not enough for Figure 14.
    text = (pendulum_results / "pendulum-u.csv").read_text()
    other = cli.write("results/precision.csv", text.replace("pendulum-u,", "precision,"))
    done = cli("plot")
    drawn = [f"results/figures/figure-{n}.png" for n in (1, 2, 3)]
    assert done.stdout.split() == drawn
    rest = [name for name in FIGURES if name not in ("1", "2", "3")]
    studies = dict.fromkeys(FIGURES[name].study for name in rest)
    assert done.stderr == (
        f"newmark-study: not drawn: figures {', '.join(rest)}; "
        f"run 'newmark-study run {' '.join(studies)}' first\n"
    )
    assert "figure 14 needs none, float32, " in cli.refused("plot", "14")
    assert "trajectory/history.csv: no trajectories" in cli.refused("plot", "15")
    other.unlink()
    first = snapshot(cli.folder / "results/figures")
    assert [f"results/figures/{name}" for name in sorted(map(str, first))] == drawn
    assert cli("plot", "2").stdout.split() == drawn[1:2]
    assert snapshot(cli.folder / "results/figures") == first
    slopes = (cli.folder / "results/slopes.csv").read_bytes()
    done = cli("check")
    assert (cli.folder / "results/slopes.csv").read_bytes() == slopes
    assert "12 of 12 slopes as predicted" in done.stdout
    found = json.loads(cli("check", "--json").stdout)
    assert {row["verdict"] for row in found} == {"pass"}
    in_file = rows_in(cli.folder / "results/slopes.csv")
    assert len(in_file) == len(found)
    key = ("preconditioning", "quantity", "measure")
    by_key = {tuple(r[k] for k in key): r for r in found}
    for row in in_file:
        assert float(row["slope"]) == by_key[tuple(row[k] for k in key)]["slope"]


def test_own_scaling_is_predicted_and_measured(cli):
    """λ scaled by 1/h only, a partial cure: orders predicted and fitted without code."""
    cli.write(
        "own.yaml",
        QUICK.replace("[none, optimal]", "{name: mine, right: {lambda: 1/h}}").replace(
            "[1e-1, 1e-2]", "[1e-1, 1e-2, 1e-3]"
        ),
    )
    cli("run", "own.yaml")
    found = {(r["quantity"], r["measure"]): r for r in json.loads(cli("check", "--json").stdout)}
    assert found["lambda", "correction"]["expected"] == -1
    assert found["lambda", "correction"]["slope"] == pytest.approx(-1, abs=0.15)
    assert found["jacobian", "condition"]["expected"] == -3
    assert found["jacobian", "condition"]["slope"] == pytest.approx(-3, abs=0.05)


def test_check_prints_what_is_asked_for(cli, pendulum_results):
    """Figures by default, every slope with --all, Markdown with --markdown."""
    shutil.copytree(pendulum_results, cli.folder / "results")
    plain = cli("check").stdout
    assert plain.splitlines()[1].startswith("------")
    assert "(physical)" not in plain
    everything = cli("check", "--all").stdout
    assert everything.count("(physical)") == 16
    markdown = cli("check", "--markdown").stdout.splitlines()
    assert markdown[0].startswith("| figure | config |")
    assert len(markdown) >= 2 + 12


@pytest.mark.bits("the fits are the shipped ones to the last digit")
def test_reproduce_keeps_the_slopes_of_other_studies(
    tmp_path, committed_folder, monkeypatch, capsys
):
    """slopes.csv is about all that is there; output and exit code about what was reproduced.

    Two of the studies are marched, drawn and fitted; the tables are of another.
    """
    reproduced = ("pendulum-v", "pendulum-a")
    monkeypatch.setattr(config, "REPRODUCED", reproduced)
    monkeypatch.setattr("newmark_cli.cli.launching.show_tables", lambda *_: 0)  # of all-forms
    for kind in ("csv", "json"):
        shutil.copy(committed_folder / f"multipliers.{kind}", tmp_path)
    # A study that would fail the check.
    text = (tmp_path / "multipliers.csv").read_text()
    (tmp_path / "multipliers.csv").write_text(text.replace(",ok,", ",not_converged,"))

    def called(command):
        code = command_line.main([command, "--results", str(tmp_path)], standalone_mode=False)
        return code, capsys.readouterr().out

    code, told = called("reproduce")
    assert code == 0
    summary = told[told.index("Summary of 2 studies") :].splitlines()
    assert len(summary) <= 10
    assert "slopes as predicted" in told
    assert "multipliers" not in told
    drawn = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert drawn == [f"figure-{n}.png" for n in (4, 5)]
    written = (tmp_path / "slopes.csv").read_bytes()
    ours, shipped = (rows_in(folder / "slopes.csv") for folder in (tmp_path, committed_folder))
    for study in reproduced:
        same = [{k: v for k, v in row.items() if v} for row in ours if row["study"] == study]
        theirs = [row for row in shipped if row["study"] == study]
        assert len(same) == len(theirs) > 0
        assert all(row.items() <= other.items() for row, other in zip(same, theirs, strict=True))
    assert {row["study"] for row in ours} == {*reproduced, "multipliers"}
    code, told = called("check")
    assert code == 1
    assert "incomplete" in told
    assert (tmp_path / "slopes.csv").read_bytes() == written


def test_failed_cells_fail_the_check(cli):
    """A step of 1e300 measures nothing; neither run nor check says that all is well."""
    cli.write(
        "s.yaml", QUICK.replace("[1e-1, 1e-2]", "[1e300, 1e299]").replace("t_end: 1.0", "steps: 2")
    )
    done = cli("run", "s.yaml", code=1)
    assert done.stderr.startswith("newmark-study: quick: 4 of 4 cells failed: OverflowError: ")
    assert len(done.stderr.splitlines()) == 1
    assert "ok" not in done.stdout
    assert "incomplete" in cli("check", code=1).stdout


@each("command", COMMANDS)
def test_help_has_an_example(cli, command):
    """Every command explains itself; its examples are lines of their own, to be copied."""
    text = cli(command, "--help").stdout
    assert re.search(rf"\n\n  Example:\n(    newmark-study {command}\b.*\n)+\nOptions:", text)
    assert r"\b" not in text
    # Every option says what it does.
    for option in command_line.commands[command].params:
        assert isinstance(option, click.Argument) or option.help, option.name


def test_help_is_light():
    """--help imports neither numpy nor pandas, nor anything else that is heavy."""
    code = (
        "import sys\nfrom newmark_cli.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'pandas', 'scipy', 'numba', 'matplotlib', 'pydantic', 'yaml'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "HEAVY []" in done.stdout, done.stdout + done.stderr


@pytest.fixture
def before(cli, quick, quick_results):
    """A folder with results that no refusal may touch."""
    shutil.copytree(quick_results, cli.folder / "results")
    return snapshot(cli.folder / "results")


#: One of each layer; `test_config` has them all.
REFUSED = {
    "problem": ("problem: pendulum", "problem: pendulm", "line 2: problem"),
    "key": ("t_end:", "tend:", "line 6: tend: unknown key; did you mean 't_end'"),
    "h zero": ("1e-2]", "0]", "line 5: h[2]"),
    "t_end": ("t_end: 1.0", "t_end: 1e-3", "line 6: t_end: shorter"),
    "not YAML": ("t_end: 1.0", "t_end: {", "not YAML"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_bad_configs(cli, before, kind):
    """A bad config is refused before anything runs, the good one beside it included."""
    old, new, words = REFUSED[kind]
    cli.write("bad.yaml", QUICK.replace(old, new))
    line = cli.refused("run", "quick.yaml", "bad.yaml")
    assert line.startswith("newmark-study: bad.yaml, line ")
    assert words in line
    assert snapshot(cli.folder / "results") == before


def test_missing_files(cli, before):
    """A missing file, a name that is nearly one, and a folder."""
    assert "missing.yaml: cannot be read" in cli.refused("run", "missing.yaml")
    assert "did you mean 'pendulum-u'" in cli.refused("run", "pendulum-uu")
    (cli.folder / "folder.yaml").mkdir()
    assert "folder.yaml: cannot be read" in cli.refused("run", "folder.yaml")
    assert snapshot(cli.folder / "results") == before


def test_two_studies_with_one_name(cli, before):
    """They would write one CSV."""
    cli.write("other.yaml", QUICK)
    assert "two studies are named 'quick'" in cli.refused("run", "quick.yaml", "other.yaml")
    assert snapshot(cli.folder / "results") == before


def test_unknown_figures_and_options(cli, before):
    assert "unknown figure or study '99'" in cli.refused("plot", "99")
    assert "unknown figure or study 'x'" in cli.refused("plot", "x")
    assert "No such option" in cli.refused("plot", "--resluts", "x")
    assert "No such command 'polt'; did you mean 'plot'? allowed: run" in cli.refused("polt")
    assert "Missing argument" in cli.refused("run")
    assert "--jobs" in cli.refused("run", "quick.yaml", "--jobs", "0")
    assert "--results" in cli.refused("run", "quick.yaml", "--results", "")
    assert "File name too long" in cli.refused("check", "--results", "x" * 300)
    assert snapshot(cli.folder / "results") == before


def test_results_that_cannot_be_written(cli, quick):
    """A file in the folder's place, and a folder that does not take files."""
    (cli.folder / "taken").write_text("mine")
    assert "cannot be written" in cli.refused("run", "quick.yaml", "--results", "taken")
    assert (cli.folder / "taken").read_text() == "mine"
    line = cli.refused("run", "quick.yaml", "--results", "/proc/here")
    assert "/proc/here: results cannot be written" in line


@each("command", ["plot", "check"])
def test_no_results(cli, command):
    assert "no results; run 'newmark-study" in cli.refused(command)
    assert not (cli.folder / "results").exists()


#: What may be wrong with a CSV of `pendulum-u`: name, and the text made of its text and lines.
DAMAGED = {
    "cut in a row": lambda text, lines: text[: len(text) // 2].rstrip("\n"),
    "cut at a line": lambda text, lines: "".join(lines[:57]),
    "no rows": lambda text, lines: lines[0],
    "schema": lambda text, lines: text.replace("preconditioning", "scaling", 1),
    "words": lambda text, lines: (
        lines[0] + lines[1].replace(",0.1,", ",wide,", 1) + "".join(lines[2:])
    ),
}


@each(
    "command, kind",
    [*(("check", kind) for kind in DAMAGED), ("plot", "cut in a row"), ("plot", "schema")],
)
def test_damaged_csv(cli, pendulum_results, command, kind):
    """A truncated CSV and one of another schema: one line, figures as they were."""
    shutil.copytree(pendulum_results, cli.folder / "results")
    path = cli.folder / "results/pendulum-u.csv"
    text = path.read_text()
    path.write_text(DAMAGED[kind](text, text.splitlines(keepends=True)))
    before = snapshot(cli.folder / "results")
    line = cli.refused(command, *(["1"] if command == "plot" else []))
    assert "results/pendulum-u.csv" in line
    assert snapshot(cli.folder / "results") == before


def test_missing_series(cli):
    """A study of the right name that lacks what a figure needs."""
    cli.write("s.yaml", QUICK.replace("study: quick", "study: pendulum-u"))
    cli("run", "s.yaml")
    assert "figure 1 needs left, right" in cli.refused("plot", "1")


def test_nothing_is_drawn_when_a_csv_is_bad(cli, pendulum_results):
    """A stray CSV in the folder stops `plot` before it writes."""
    shutil.copytree(pendulum_results, cli.folder / "results")
    cli.write("results/notes.csv", "a,b\n1,2\n")
    before = snapshot(cli.folder / "results")
    assert "notes.csv, line 1" in cli.refused("plot", "2")
    assert snapshot(cli.folder / "results") == before


def test_commands_from_cold(cli):
    """A process of its own prints and writes what a call of `main` does.

    Whatever --jobs is and in whatever order sets are; progress is quiet in a pipe.
    """
    cli.write("s.yaml", QUICK.replace("u-lambda", "[u-lambda, v-a-lambda]"))
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    cold = subprocess.run(
        [SCRIPT, "run", "s.yaml", "--jobs", "1"],
        cwd=cli.folder, capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONHASHSEED": seed},
    )  # fmt: skip
    warm = cli("run", "s.yaml", "--jobs", 4, "--results", "warm")
    assert cold.stdout == warm.stdout.replace("warm", "results")
    assert (cold.stderr, warm.stderr) == ("", "")
    there, here = (cli.folder / name / "quick.csv" for name in ("results", "warm"))
    assert there.read_bytes() == here.read_bytes()
