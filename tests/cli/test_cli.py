"""What the commands write, print and refuse, in an empty folder."""

import json
import re
import shlex
import shutil

import click
import pytest
from command_line import CommandLine
from conftest import QUICK, rows_in

from newmark_cli import __version__
from newmark_cli.cli.commands import cli as command_line
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config, csv_files, shipped


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """Results of `quick` and of `pendulum-u`, and a figure that was drawn before."""
    cli = CommandLine(tmp_path_factory.mktemp("computed"))
    cli.write("quick.yaml", QUICK)
    done = cli("run", "quick.yaml", "pendulum-u")
    assert done.stdout.startswith("quick: 4 ok -> results/quick.csv\n")
    assert done.stderr == ""
    cli.write("results/figures/figure-1.png", "drawn before")
    return cli.folder / "results"


def snapshot(folder):
    """Every file below a folder with its bytes."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_run_writes_the_contract(computed):
    """Columns, order of rows, values and provenance of a small study."""
    table = rows_in(computed / "quick.csv")
    seldom = ("h_sequence", "auxiliary", "code")  # they are there where they vary
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
    record = json.loads((computed / "quick.json").read_text())
    assert record["config"]["cases"][0]["h"] == [0.1, 0.01]
    assert [c["status"] for c in record["cells"]] == ["ok"] * 4
    run = json.loads((computed / "runs/quick.json").read_text())
    assert run["versions"]["newmark-study"] == __version__
    assert all(c["wall_seconds"] > 0 for c in run["cells"])


def test_shipped_configs_work_from_any_folder(cli):
    """A name in place of a file; a folder that is called like a config is in nobody's way."""
    for name in shipped.names():
        (cli.folder / name).mkdir()
    cli("list")
    cli("run", "pendulum-v", "--results", "pendulum-u")
    assert len(rows_in(cli.folder / "pendulum-u/pendulum-v.csv")) == 16 * 7


def test_plot_and_check_read_the_csv_alone(cli, computed):
    """Figures that it is enough for, slopes.csv, the table and its JSON; the same bytes twice.

    The other figures are named in one line, with what to run for them.
    """
    (cli.folder / "results").mkdir()
    shutil.copy(computed / "pendulum-u.csv", cli.folder / "results")
    # A study of one's own under a shipped one's name is not enough for Figure 14.
    text = (computed / "pendulum-u.csv").read_text()
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
    assert "figure 14 needs none, left, right, optimal" in cli.refused("plot", "14")
    assert "trajectory/history.csv: no trajectories" in cli.refused("plot", "15")
    other.unlink()
    first = snapshot(cli.folder / "results/figures")
    assert cli("plot", "2").stdout.split() == drawn[1:2]
    assert snapshot(cli.folder / "results/figures") == first
    slopes = (cli.folder / "results/slopes.csv").read_bytes()
    assert "12 of 12 slopes as predicted" in cli("check").stdout
    assert (cli.folder / "results/slopes.csv").read_bytes() == slopes
    found = json.loads(cli("check", "--json").stdout)
    assert {row["verdict"] for row in found} == {"pass"}
    in_file = rows_in(cli.folder / "results/slopes.csv")
    assert len(in_file) == len(found)
    key = ("preconditioning", "quantity", "measure")
    by_key = {tuple(r[k] for k in key): r for r in found}
    for row in in_file:
        assert float(row["slope"]) == by_key[tuple(row[k] for k in key)]["slope"]


@pytest.mark.bits("the fits are the shipped ones to the last digit")
def test_reproduce_keeps_the_slopes_of_other_studies(cli, committed_folder, monkeypatch):
    """slopes.csv is about all that is there; output and exit code about what was reproduced.

    Two of the studies are marched, drawn and fitted; the tables are of another.
    """
    reproduced = ("pendulum-v", "pendulum-a")
    monkeypatch.setattr(config, "REPRODUCED", reproduced)
    monkeypatch.setattr("newmark_cli.cli.launching.show_tables", lambda *_: 0)  # of all-forms
    folder = cli.folder / "results"
    folder.mkdir()
    # A study that would fail the check.
    text = (committed_folder / "multipliers.csv").read_text()
    (folder / "multipliers.csv").write_text(text.replace(",ok,", ",not_converged,"))
    shutil.copy(committed_folder / "multipliers.json", folder)
    told = cli("reproduce").stdout
    summary = told[told.index("Summary of 2 studies") :].splitlines()
    assert len(summary) <= 10
    assert "slopes as predicted" in told
    assert "multipliers" not in told
    drawn = sorted(path.name for path in (folder / "figures").iterdir())
    assert drawn == [f"figure-{n}.png" for n in (4, 5)]
    written = (folder / "slopes.csv").read_bytes()
    ours, shipped = (rows_in(place / "slopes.csv") for place in (folder, committed_folder))
    for study in reproduced:
        same = [{k: v for k, v in row.items() if v} for row in ours if row["study"] == study]
        theirs = [row for row in shipped if row["study"] == study]
        assert len(same) == len(theirs) > 0
        assert all(row.items() <= other.items() for row, other in zip(same, theirs, strict=True))
    assert {row["study"] for row in ours} == {*reproduced, "multipliers"}
    assert "incomplete" in cli("check", code=1).stdout
    assert (folder / "slopes.csv").read_bytes() == written


def test_failed_cells_fail_the_check(cli):
    """A step of 1e300 measures nothing; neither run nor check says that all is well."""
    text = QUICK.replace("[1e-1, 1e-2]", "[1e300, 1e299]").replace("t_end: 1.0", "steps: 2")
    cli.write("s.yaml", text)
    done = cli("run", "s.yaml", code=1)
    assert done.stderr.startswith("newmark-study: quick: 4 of 4 cells failed: OverflowError: ")
    assert len(done.stderr.splitlines()) == 1
    assert "ok" not in done.stdout
    assert "incomplete" in cli("check", code=1).stdout


def test_help_has_an_example(cli):
    """Every command and option explains itself; examples are lines of their own, to be copied."""
    for name, command in command_line.commands.items():
        text = cli(name, "--help").stdout
        assert re.search(rf"\n\n  Example:\n(    newmark-study {name}\b.*\n)+\nOptions:", text)
        assert r"\b" not in text
        for option in command.params:
            assert isinstance(option, click.Argument) or option.help, option.name


#: What may be wrong with the CSV of `pendulum-u`: name → its text from that and its lines.
DAMAGES = {
    "cut in a row": lambda text, lines: text[: len(text) // 2].rstrip("\n"),
    "cut at a line": lambda text, lines: "".join(lines[:57]),
    "no rows": lambda text, lines: lines[0],
    "schema": lambda text, lines: text.replace("preconditioning", "scaling", 1),
    "words": lambda text, lines: text.replace(",0.1,", ",wide,", 1),
}
#: Command → what it says, beside `quick.yaml` and other files of `refusals`.
REFUSED = {
    "run quick.yaml problem.yaml": "problem.yaml, line 2: problem",
    "run quick.yaml broken.yaml": "broken.yaml, line 7: not YAML",
    "run quick.yaml other.yaml": "two studies are named 'quick'",
    "run missing.yaml": "missing.yaml: cannot be read",
    "run pendulum-uu": "did you mean 'pendulum-u'",
    "run stray/notes.csv": "stray/notes.csv: is not a study; give a YAML file, or a shipped study",
    "run stopping": "no shipped study; it is gone: the page on studies says what",
    "run folder.yaml": "folder.yaml: cannot be read",
    "run": "Missing argument",
    "run quick.yaml --jobs 0": "--jobs",
    "run quick.yaml --results=": "--results",
    "run quick.yaml --results quick.yaml": "must name a folder, and 'quick.yaml' is a file",
    "run quick.yaml --results /proc/here": "/proc/here: results cannot be written",
    "plot 99": "unknown figure or study '99'",
    "plot --resluts x": "No such option",
    "polt": "No such command 'polt'; did you mean 'plot'? allowed: run",
    "plot 1 --results lacking": "figure 1 needs left, right",
    "plot 2 --results stray": "notes.csv, line 1",
    f"check --results {'x' * 300}": "File name too long",
    "check --results none": "no results; run 'newmark-study",
    "plot --results none": "no results; run 'newmark-study",
    **{f"check --results '{kind}'": f"{kind}/pendulum-u.csv" for kind in DAMAGES},
    "plot 1 --results schema": "schema/pendulum-u.csv",
}


@pytest.fixture(scope="module")
def refusals(tmp_path_factory, computed):
    """A folder with results, and with much that is wrong."""
    cli = CommandLine(tmp_path_factory.mktemp("refused"))
    shutil.copytree(computed, cli.folder / "results")
    for name, old, new in (
        ("quick", "", ""),
        ("other", "", ""),
        ("problem", "problem: pendulum", "problem: pendulm"),
        ("broken", "t_end: 1.0", "t_end: {"),
    ):
        cli.write(f"{name}.yaml", QUICK.replace(old, new))
    (cli.folder / "folder.yaml").mkdir()
    text = (computed / "pendulum-u.csv").read_text()
    for kind, change in DAMAGES.items():
        cli.write(f"{kind}/pendulum-u.csv", change(text, text.splitlines(keepends=True)))
        shutil.copy(computed / "pendulum-u.json", cli.folder / kind)
    lines = text.splitlines(keepends=True)
    whole = [line for line in lines if ",left," not in line and ",right," not in line]
    cli.write("lacking/pendulum-u.csv", "".join(whole))
    cli.write("stray/pendulum-u.csv", text)
    cli.write("stray/notes.csv", "a,b\n1,2\n")
    return cli, snapshot(cli.folder)


@pytest.mark.parametrize("command", REFUSED)
def test_refusals(refusals, command):
    """One line, exit code 2, and no file is touched: what is wrong is found before."""
    cli, before = refusals
    assert REFUSED[command] in cli.refused(*shlex.split(command))
    assert snapshot(cli.folder) == before
