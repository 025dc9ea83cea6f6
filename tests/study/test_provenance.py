"""Provenance: what a run notes beside its CSVs, and what `info` and `verify` say of it."""

import hashlib
import json
import os
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy
from command_line import CommandLine
from conftest import QUICK

import newmark_cli
from newmark_cli.report.reading import records
from newmark_cli.study import checkout as checkout_of_code
from newmark_cli.study import config, provenance, shipped
from newmark_cli.support.processors import usable

HISTORY = """\
study: series
problem: pendulum
form: u-lambda
preconditioning: none
h: [1e-1]
t_end: 1.0
measure: [correction, trajectory]
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Results of a small study and of one with a time series."""
    cli = CommandLine(tmp_path_factory.mktemp("ran"))
    cli.write("quick.yaml", QUICK)
    cli.write("series.yaml", HISTORY)
    cli("run", "quick.yaml", "series.yaml")
    return cli.folder / "results"


@pytest.fixture
def copied(cli, ran):
    """The same, to be spoilt."""
    shutil.copytree(ran, cli.folder / "results")
    return cli.folder / "results"


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_run_notes_where_it_comes_from(ran):
    """Checksums of the files, a hash of the config, BLAS and its threads, the processor."""
    record, run = (
        json.loads((ran / f"{name}.json").read_text()) for name in ("quick", "runs/quick")
    )
    assert record["sha256"] == run["sha256"] == {"quick.csv": digest(ran / "quick.csv")}
    spelt = json.dumps(record["config"], sort_keys=True, separators=(",", ":"))
    assert record["config_sha256"] == hashlib.sha256(spelt.encode()).hexdigest()
    assert run["versions"]["numpy"] == np.__version__
    assert run["versions"]["scipy"] == scipy.__version__
    assert {"python", "numba", "newmark-study"} <= set(run["versions"])
    built = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    assert run["blas"]["numpy"] == f"{built['name']} {built['version']}"
    assert run["blas"]["threads"] == {
        name: os.environ.get(name, "1") for name in provenance.THREAD_VARIABLES
    }
    assert run["platform"]["processor"]
    assert run["platform"]["processors"] == usable()
    assert set(record).isdisjoint({"finished", "versions", "source", "blas", "platform", "jobs"})
    assert [set(cell) for cell in run["cells"]] == [{"wall_seconds"}] * 4
    told = [(c["preconditioning"], c["h"], c["integrator"], c["stop"]) for c in record["cells"]]
    assert told == [
        (variant, h, "newmark beta=0.25 gamma=0.5", "saturation")
        for variant in ("none", "optimal")
        for h in (0.1, 0.01)
    ]


def git(folder, *arguments):
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", folder, *arguments]
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    return subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment
    ).stdout.strip()


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout whose folder `code` takes the package's place."""
    package = tmp_path / "checkout/code"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package.parent / "results.csv").write_text("1\n")
    git(package.parent, "init", "-q")
    git(package.parent, "add", ".")
    git(package, "commit", "-q", "-m", "first")
    monkeypatch.setattr(newmark_cli, "__file__", str(package / "__init__.py"))
    return package


def source():
    """Not the answer that is kept for the process."""
    return provenance.source.__wrapped__()


def test_commit_of_a_checkout(checkout, monkeypatch):
    """With a mark where the code differs; changed results are no change of the code."""
    commit = git(checkout, "rev-parse", "HEAD")
    (checkout.parent / "results.csv").write_text("2\n")
    assert source() == {"commit": commit, "modified": False}
    # As in a hook of another repository.
    monkeypatch.setenv("GIT_DIR", str(checkout.parent / "elsewhere"))
    assert source() == {"commit": commit, "modified": False}
    (checkout / "more.py").write_text("")
    assert source() == {"commit": commit, "modified": True}


@pytest.fixture
def installed(checkout, monkeypatch):
    """A folder below somebody's checkout, not tracked there, that takes the package's place."""
    package = checkout.parent / "venv/newmark_cli"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    monkeypatch.setattr(newmark_cli, "__file__", str(package / "__init__.py"))
    return package


@pytest.mark.parametrize(
    ("noted", "commit"),
    [
        ('{"url": "https://a/b", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}}', "c0ffee"),
        ('{"url": "file:///a", "dir_info": {}}', None),
        ("{", None),
        (None, None),
    ],
)
def test_commit_of_an_installed_package(installed, monkeypatch, noted, commit):
    """What the installer noted, if anything; never that of somebody's checkout above it."""

    class Installed:
        def read_text(self, name):
            return noted if name == "direct_url.json" else None

    monkeypatch.setattr(provenance, "distribution", lambda name: Installed())
    assert source() == {"commit": commit, "modified": None}


def test_stamped_commit_of_an_installed_package(installed, monkeypatch):
    """The stamp says more than the installer, who does not know of changes; git is not needed."""
    monkeypatch.setenv("PATH", "")
    stamp = {"commit": "c0ffee", "modified": True}
    (installed / checkout_of_code.STAMP).write_text(json.dumps(stamp))
    monkeypatch.setattr(provenance, "_installed_commit", lambda: "decaf")
    assert source() == stamp


def change(path):
    """One digit."""
    text = path.read_text()
    place = text.rindex("0")
    path.write_text(text[:place] + "1" + text[place + 1 :])


def forget(path):
    """A record from before there were checksums."""
    record = json.loads(path.read_text())
    path.write_text(json.dumps({k: v for k, v in record.items() if k != "sha256"}))


SPOILT = {
    "changed": ("quick.csv", change, "quick.csv", "differs from its record"),
    "changed series": ("trajectory/series.csv", change, "trajectory/series.csv", "differs"),
    "series gone": ("trajectory/series.csv", Path.unlink, "trajectory/series.csv", "missing"),
    "no checksum": ("quick.json", forget, "quick.csv", "not in quick.json"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_spoilt_results(copied, kind):
    """What is wrong with which file; other files are as they were."""
    name, spoil, blamed, words = SPOILT[kind]
    assert records.changed(copied, ["quick", "series"]) == []
    spoil(copied / name)
    (found,) = records.changed(copied, ["quick", "series"])
    assert found.path == copied / blamed
    assert words in found.finding


@pytest.mark.parametrize("spoil", [Path.unlink, lambda path: path.write_text("{")])
def test_a_csv_without_a_record_may_be_anything(copied, spoil):
    spoil(copied / "quick.json")
    change(copied / "quick.csv")
    assert records.changed(copied, ["quick", "series"]) == []


def test_check_notices_what_was_not_written(cli, copied):
    """A CSV that is not what was written fails the check; one without a record does not."""
    # Its step sizes are too few to be judged.
    assert "not what was written" not in cli("check", code=1).stdout
    change(copied / "quick.csv")
    told = " ".join(cli("check", code=1).stdout.split())
    assert told.endswith(", 1 not what was written")
    assert "results/quick.csv: differs from its record" in told
    found = json.loads(cli("check", "--json", code=1).stdout)
    assert found[-1] == {"file": "results/quick.csv", "finding": "differs from its record"}


def test_records_of_another_run_are_left_out(cli, copied):
    """What is said of time and machine is about the run that wrote the CSV, or not said."""
    assert "finished" in cli("show", "--record").stdout
    path = copied / "runs/quick.json"
    run = json.loads(path.read_text())
    assert records.read(copied / "quick.csv")["finished"] == run["finished"]
    path.write_text(json.dumps(run | {"sha256": {"quick.csv": "0"}}))
    assert "finished" not in records.read(copied / "quick.csv")
    path.write_text(json.dumps(run | {"cells": [3, *run["cells"][1:]]}))
    assert "finished" not in records.read(copied / "quick.csv")
    path.unlink()
    assert records.read(copied / "quick.csv") == json.loads((copied / "quick.json").read_text())
    assert "not recorded" in cli("show", "--record").stdout


def test_shipped_checksums_are_those_of_the_results():
    """`python tests/verification/shipped.py > configs/results.json` after results were computed."""
    path = Path(__file__).parents[1] / "verification/shipped.py"
    expected = runpy.run_path(str(path))["sums"]()
    assert json.loads((shipped.folder() / "results.json").read_text()) == expected
    assert set(expected) == {*config.REPRODUCED, *config.BEYOND, *config.APART}


def test_agreement_with_what_was_shipped(copied, tmp_path):
    """Studies whose CSVs, those over time included, are the same to the byte; others by name."""
    shipped = tmp_path / "shipped.json"
    names = ["quick", "series"]
    sums = {name: json.loads((copied / f"{name}.json").read_text())["sha256"] for name in names}
    ending = f"the numbers shipped with {newmark_cli.__version__}, bit for bit"
    every = f"2 of 2 studies: {ending}"
    but_one = f"1 of 2 studies: {ending}; not series"
    for changed, told in ((None, every), ("trajectory/series.csv", but_one)):
        expected = sums | ({"series": sums["series"] | {changed: "0"}} if changed else {})
        shipped.write_text(json.dumps(expected))
        assert records.agreement(copied, names, shipped) == told


def test_records_for_people_and_programs(cli, copied):
    """Every study by default; as JSON with the config and the wall time of each cell."""
    text = cli("show", "--record").stdout
    assert text.index("quick\n") < text.index("series\n")
    for words in (np.__version__, digest(copied / "quick.csv"), "OPENBLAS_NUM_THREADS="):
        assert words in text
    (record,) = json.loads(cli("show", "quick", "--record", "--json").stdout)
    assert record == records.read(copied / "quick.csv")
    assert all(cell["wall_seconds"] > 0 for cell in record["cells"])
    assert record["config"]["cases"][0]["h"] == [0.1, 0.01]


def test_results_of_another_config_are_not_overwritten(cli, quick):
    """Refused in a line, unless it is the same file, its content, or asked for; nothing is lost."""
    cli.write("other/quick.yaml", QUICK.replace("1e-2]", "1e-3]"))
    cli("run", "quick.yaml")
    before = {p: p.read_bytes() for p in (cli.folder / "results").glob("q*.*")}
    line = cli.refused("run", "other/quick.yaml")
    assert line.startswith("newmark-study: results/quick.csv: has the results of quick.yaml, ")
    assert "another config with 'study: quick'; " in line
    assert {p: p.read_bytes() for p in (cli.folder / "results").glob("q*.*")} == before
    # The same content elsewhere, the same file with other content, another folder.
    cli.write("copy.yaml", QUICK)
    cli("run", "copy.yaml")
    cli.write("copy.yaml", QUICK.replace("1e-2]", "3e-2]"))
    cli("run", "copy.yaml")
    cli("run", "other/quick.yaml", "--results", "out")
    # Where all has moved together, the file is the same; where it is gone, nobody knows another.
    (cli.folder / "moved").mkdir()
    for name in ("copy.yaml", "results"):
        (cli.folder / name).rename(cli.folder / "moved" / name)
    cli.write("moved/copy.yaml", QUICK.replace("1e-2]", "2e-2]"))
    cli("run", "moved/copy.yaml", "--results", "moved/results")
    assert "of moved/copy.yaml" in cli.refused("run", "quick.yaml", "--results", "moved/results")
    cli("run", "quick.yaml", "--results", "moved/results", "--replace")
    cli("run", "quick.yaml", "--results", "moved/results")
    (cli.folder / "quick.yaml").unlink()
    cli("run", "moved/copy.yaml", "--results", "moved/results")


def test_a_shipped_study_and_its_namesake_keep_their_results(cli, committed_folder):
    """Of whatever version, and also where a clone has them without the record of the run."""
    cli.write("mine.yaml", QUICK.replace("quick", "pendulum-v"))
    (cli.folder / "results").mkdir()
    for kind in ("csv", "json"):
        text = (committed_folder / f"pendulum-v.{kind}").read_text()
        cli.write(f"results/pendulum-v.{kind}", text)
    assert "has the results of the shipped study" in cli.refused("run", "mine.yaml")
    cli("run", "mine.yaml", "--replace")
    assert "has the results of mine.yaml" in cli.refused("run", "pendulum-v")
    cli("run", "pendulum-v", "--replace")
    # A later version may have other cases in it.
    cli("run", "pendulum-v")
    assert "has the results of the shipped study" in cli.refused("run", "mine.yaml")
