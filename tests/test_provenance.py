"""Provenance: what a run notes beside its CSVs, and what `info` and `verify` say of it."""

import hashlib
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy
from conftest import QUICK, CommandLine

import newmark_cli
from newmark_cli.errors import InputError
from newmark_cli.processors import usable
from newmark_cli.report import records
from newmark_cli.study import provenance

HISTORY = """\
study: series
problem: pendulum
form: u-lambda
preconditioning: none
h: [1e-1]
t_end: 1.0
measure: [correction, history]
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory, warm):
    """Results of a small study and of one with a time series."""
    cli = CommandLine(tmp_path_factory.mktemp("ran"), warm)
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
    record = json.loads((ran / "quick.json").read_text())
    assert record["sha256"] == {"quick.csv": digest(ran / "quick.csv")}
    spelt = json.dumps(record["config"], sort_keys=True, separators=(",", ":"))
    assert record["config_sha256"] == hashlib.sha256(spelt.encode()).hexdigest()
    assert record["versions"]["numpy"] == np.__version__
    assert record["versions"]["scipy"] == scipy.__version__
    assert {"python", "numba", "newmark-study"} <= set(record["versions"])
    built = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    assert record["blas"]["numpy"] == f"{built['name']} {built['version']}"
    assert record["blas"]["threads"] == {
        name: os.environ.get(name, "1") for name in provenance.THREAD_VARIABLES
    }
    assert record["platform"]["processor"]
    assert record["platform"]["processors"] == usable()
    assert "wall_seconds" not in record
    told = [(c["preconditioning"], c["h"], c["integrator"], c["stop"]) for c in record["cells"]]
    assert told == [
        (variant, h, "newmark beta=0.25 gamma=0.5", "saturation")
        for variant in ("none", "optimal")
        for h in (0.1, 0.01)
    ]


def test_a_time_series_has_its_own_checksum(ran):
    """Beside that of the study's CSV."""
    record = json.loads((ran / "series.json").read_text())
    files = ("series.csv", "history/series.csv")
    assert record["sha256"] == {name: digest(ran / name) for name in files}


# -- the commit -----------------------------------------------------------------------------


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


def test_no_commit_of_another_project(checkout, monkeypatch):
    """A package that was installed below somebody's checkout does not have its commit."""
    installed = checkout.parent / "venv/newmark_cli"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text("")
    monkeypatch.setattr(newmark_cli, "__file__", str(installed / "__init__.py"))
    monkeypatch.setattr(provenance, "_installed_commit", lambda: None)
    assert source() == {"commit": None, "modified": None}


@pytest.mark.parametrize(
    ("noted", "commit"),
    [
        ('{"url": "https://a/b", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}}', "c0ffee"),
        ('{"url": "file:///a", "dir_info": {}}', None),
        ("[]", None),
        ("{", None),
        (None, None),
    ],
)
def test_commit_of_an_installed_package(monkeypatch, noted, commit):
    """What the installer noted, and without git on the path."""

    class Installed:
        def read_text(self, name):
            return noted if name == "direct_url.json" else None

    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(provenance, "distribution", lambda name: Installed())
    assert source() == {"commit": commit, "modified": None}


# -- verify ---------------------------------------------------------------------------------


def lines(done):
    return dict(line.split(": ", 1) for line in done.stdout.splitlines())


def test_verify_of_what_was_written(cli, copied):
    """One line for each CSV; slopes.csv and tables are not results."""
    (copied / "slopes.csv").write_text("whatever\n")
    (copied / "notes.json").write_text("[]")
    found = lines(cli("verify"))
    files = ("history/series.csv", "quick.csv", "series.csv")
    assert found == {f"results/{name}": "ok" for name in files}


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
    "changed series": ("history/series.csv", change, "history/series.csv", "differs"),
    "gone": ("quick.csv", Path.unlink, "quick.csv", "missing"),
    "series gone": ("history/series.csv", Path.unlink, "history/series.csv", "missing"),
    "no record": ("quick.json", Path.unlink, "quick.csv", "no record"),
    "no record of a series": ("series.json", Path.unlink, "history/series.csv", "no record"),
    "no checksum": ("quick.json", forget, "quick.csv", "not in quick.json"),
    "record cut": ("quick.json", lambda path: path.write_text("{"), "quick.csv", "no record"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_verify_of_spoilt_results(copied, kind):
    """What is wrong with which file; other files are as they were."""
    name, spoil, blamed, words = SPOILT[kind]
    spoil(copied / name)
    found = {entry.path: entry for entry in records.verify(copied)}
    assert words in found[copied / blamed].finding
    assert not found[copied / blamed].ok
    assert found[copied / ("quick.csv" if "series" in blamed else "series.csv")].ok


def test_verify_fails(cli, copied):
    """Exit 1 for a file that differs; one line and exit 2 without results."""
    change(copied / "quick.csv")
    assert lines(cli("verify", code=1))["results/quick.csv"] == "differs from its record"
    assert "no results" in cli.refused("verify", "--results", "nowhere")


# -- info -----------------------------------------------------------------------------------


def test_info_for_people(cli, copied):
    """Every study by default; cells with wall times and the config when asked for."""
    text = cli("info").stdout
    assert text.index("quick\n") < text.index("series\n")
    for words in (np.__version__, digest(copied / "quick.csv"), "OPENBLAS_NUM_THREADS="):
        assert words in text
    text = cli("info", "quick", "--cells", "--config").stdout
    assert "series" not in text
    assert text.count(" ok ") >= 4
    assert "h: [0.1, 0.01]" in text


def test_info_of_an_older_record():
    """It says what it does not know."""
    record = {"study": "quick"}
    assert f"config SHA-256  {records.UNKNOWN}" in records.as_text(record)
    assert records.cell_rows(record) == [("problem", "h", "steps", "status", "wall time (s)")]
    assert records.config_text(record) == "{}\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "quick.json: not JSON"),
        ("[]", "quick.json: not the record of quick.csv"),
        ('{"study": "other"}', "quick.json: not the record of quick.csv"),
        (None, "quick.json: no record of quick.csv"),
    ],
)
def test_damaged_records(tmp_path, content, words):
    """Each is named with what is wrong."""
    if content is not None:
        (tmp_path / "quick.json").write_text(content)
    with pytest.raises(InputError, match=words):
        records.read(tmp_path / "quick.csv")


def test_info_without_a_record(cli):
    """One line, exit 2."""
    assert "results/quick.json: no record of quick.csv" in cli.refused("info", "quick")
