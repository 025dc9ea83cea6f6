"""Pruning: what is needed stays, whatever else is in the folder."""

import json
import os
import re
import shutil
import signal

import pytest
from conftest import LONG, QUICK, CommandLine, wait_for_cells

from newmark_cli.support import files

OTHER = QUICK.replace("study: quick", "study: other").replace("u-lambda", "a-lambda")


@pytest.fixture(scope="module")
def ran(tmp_path_factory, warm):
    """Results of two studies of four cells each."""
    cli = CommandLine(tmp_path_factory.mktemp("ran"), warm)
    cli.write("quick.yaml", QUICK)
    cli.write("other.yaml", OTHER)
    cli("run", "quick.yaml", "other.yaml")
    return cli.folder


@pytest.fixture
def two(cli, ran):
    """The same in a folder of its own: the names of each study's files."""
    shutil.copytree(ran, cli.folder, dirs_exist_ok=True)
    return {study: files_of(cli, study) for study in ("quick", "other")}


def files_of(cli, study):
    """Files of the cells that a study's CSV was made from."""
    record = json.loads((cli.folder / f"results/runs/{study}.json").read_text())
    return {cell["kept_as"] for cell in record["cells"]}


def cells(cli):
    """Names of all kept cells."""
    return {file.name for file in (cli.folder / "results/cells").glob("*.json")}


def snapshot(cli):
    """Every file of the results with its bytes, but that which holds the lock."""
    folder = cli.folder / "results"
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file() and file.name != ".lock"
    }


def other_core(cli, name):
    """Make a kept cell one of another numerical core; its name."""
    file = cli.folder / "results/cells" / name
    record = files.read_sealed(file)
    record["key"]["core"] = "0" * 64
    new = file.with_name("-".join([*file.stem.split("-")[:2], "0" * 16]) + ".json")
    file.unlink()
    files.write_sealed(new, record, file.parent)
    return new.name


def sizes(text):
    """Lines of output without their sizes."""
    return [re.sub(r" \([0-9.]+ [a-zA-Z]+\)", "", line) for line in text.splitlines()]


def test_what_studies_need_stays(cli, two):
    """Nothing is removed, nothing changes, and a run computes nothing."""
    assert two["quick"] | two["other"] == cells(cli)
    before = snapshot(cli)
    assert sizes(cli("prune").stdout) == ["nothing to remove", "8 cells stay"]
    assert snapshot(cli) == before
    assert "(4 cached)" in cli("run", "quick.yaml").stdout


def test_what_no_study_needs_goes(cli, two):
    """A study that is taken away, and step sizes that a config no longer has."""
    for suffix in ("csv", "json"):
        (cli.folder / f"results/other.{suffix}").unlink()
    cli.write("quick.yaml", QUICK.replace("[1e-1, 1e-2]", "[1e-2]"))
    cli("run", "quick.yaml")
    gone = sum((cli.folder / "results/cells" / n).stat().st_size for n in cells(cli)) - sum(
        (cli.folder / "results/cells" / n).stat().st_size for n in files_of(cli, "quick")
    )
    before = snapshot(cli)
    told = cli("prune", "--dry-run").stdout.splitlines()
    assert told[0] == f"would remove 6 cells that no study needs ({gone / 1000:,.1f} kB)"
    assert snapshot(cli) == before
    assert sizes(cli("prune").stdout) == ["removed 6 cells that no study needs", "2 cells stay"]
    assert cells(cli) == files_of(cli, "quick")
    assert len(cells(cli)) == 2
    after = snapshot(cli)
    assert {name for name in before if name not in after} == {
        f"cells/{name}" for name in two["quick"] | two["other"] if name not in cells(cli)
    }
    assert all(before[name] == after[name] for name in after)


def test_configs_take_the_place_of_records(cli, two):
    """What the config needs now stays, whoever computed it; other studies keep theirs."""
    cli.write("quick.yaml", QUICK.replace("[1e-1, 1e-2]", "[1e-2, 1e-3]"))
    assert sizes(cli("prune", "quick.yaml").stdout) == [
        "removed 2 cells that no study needs",
        "6 cells stay",
    ]
    assert two["other"] < cells(cli)
    assert cli("run", "quick.yaml", "--dry-run").stdout.endswith("2 of 4 cells to run\n")


def test_cells_of_another_core(cli, two):
    """Those that a CSV was made from stay until its study has run again; others go."""
    first, second = sorted(two["quick"])[:2]
    stays = other_core(cli, first)
    run = json.loads((cli.folder / "results/runs/quick.json").read_text())
    for cell in run["cells"]:
        cell["kept_as"] = {first: stays}.get(cell["kept_as"], cell["kept_as"])
    (cli.folder / "results/runs/quick.json").write_text(json.dumps(run))
    goes = other_core(cli, second)
    assert sizes(cli("prune").stdout) == [
        "removed 1 cell of another numerical core",
        "7 cells stay",
        "1 of them is of another numerical core: run their studies again and prune again, "
        "or name their configs",
    ]
    assert stays in cells(cli)
    assert goes not in cells(cli)
    cli("run", "quick.yaml")
    assert sizes(cli("prune").stdout)[0] == "removed 1 cell of another numerical core"
    assert cells(cli) == two["quick"] | two["other"]


def test_damaged_cells_go(cli, two):
    """Cut, altered, or under another's name: they would be computed again anyway."""
    folder = cli.folder / "results/cells"
    cut, altered, renamed, *_ = sorted(two["quick"])
    (folder / cut).write_text((folder / cut).read_text()[:100])
    (folder / altered).write_text((folder / altered).read_text().replace("outcome", "out"))
    (folder / renamed).rename(folder / ("f" * 16 + renamed[16:]))
    (folder / "notes.json").write_text("mine")
    assert sizes(cli("prune").stdout) == ["removed 3 damaged cells", "5 cells stay"]
    assert "notes.json" in cells(cli)
    assert cli("run", "quick.yaml", "--dry-run").stdout.endswith("3 of 4 cells to run\n")


def test_records_without_a_run(cli, two):
    """Those that came with the folder name no cells of it: only what other studies need stays."""
    (cli.folder / "results/runs/quick.json").unlink()
    cli("prune")
    assert cells(cli) == two["other"]


@pytest.mark.parametrize("text", [None, "{", "{}", '{"study": "quick", "cells": 3}'])
def test_a_csv_whose_cells_nobody_knows(cli, two, text):
    """Refused, and nothing is removed; a config says what it needs."""
    record = cli.folder / "results/quick.json"
    if text is None:
        record.unlink()
    else:
        record.write_text(text)
    (cli.folder / "results/other.csv").unlink()
    (cli.folder / "results/other.json").unlink()
    before = snapshot(cli)
    assert "results/quick.json: " in cli.refused("prune")
    assert snapshot(cli) == before
    cli("prune", "quick.yaml")
    assert cells(cli) == two["quick"]


def test_unfinished_studies_keep_their_cells(cli):
    """An interrupted run, and a part of a study, have no CSV yet."""
    cli.write("long.yaml", LONG)
    run = cli.start("run", "long.yaml")
    wait_for_cells(cli.folder / "results", 2)
    assert "in use by 'run long'" in cli.refused("prune")
    run.send_signal(signal.SIGTERM)
    run.communicate(timeout=60)
    before = cells(cli)
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml", "--shard", "1/2")
    assert len(cells(cli)) == len(before) + 2
    *_, told = cli("prune").stdout.splitlines()
    assert told == "not finished, so that their cells stay: long, quick"
    assert len(cells(cli)) == len(before) + 2
    cli("run", "quick.yaml")
    *_, told = cli("prune").stdout.splitlines()
    assert told == "not finished, so that their cells stay: long"
    assert before < cells(cli)
    cli.write("long.yaml", LONG.replace("[1e-2, 1e-3, 1e-4, 1e-5]", "[2e-1]"))
    cli("run", "long.yaml")
    cli("prune")
    assert cells(cli) == files_of(cli, "long") | files_of(cli, "quick")
    assert len(cells(cli)) == 10


#: Files that killed runs and commands leave, and what looks like them and is none.
LITTER = (
    "cells/.0a-1b-2c.json.k2_x9abc", "history/.series.csv.abcdefgh", ".quick.json.abcdefgh",
    "..unfinished-long.abcdefgh", ".probe.abcdefgh", "figures/.figure-1.png.abcdefgh",
)  # fmt: skip
MINE = (".lock-1-of-2", ".quick.csv.backup", ".gitignore", "figures/.mine.settings", ".a.csv.ABC")


def test_litter_of_killed_runs(cli, two):
    """It goes when it is old: what is new somebody may be writing."""
    for name in (*LITTER, *MINE):
        path = cli.folder / "results" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("x" * 100)
    assert "temporary" not in cli("prune").stdout
    for name in (*LITTER[1:], *MINE):
        os.utime(cli.folder / "results" / name, (1, 1))
    told = cli("prune", "--dry-run").stdout.splitlines()
    assert told[0] == "would remove 5 temporary files (500 bytes)"
    assert sizes(cli("prune").stdout)[0] == "removed 5 temporary files"
    left = [name for name in (*LITTER, *MINE) if (cli.folder / "results" / name).exists()]
    assert left == [LITTER[0], *MINE]


def test_folders_without_cells(cli):
    """None is refused; one without cells has nothing to remove."""
    assert "results: no such folder" in cli.refused("prune")
    (cli.folder / "results").mkdir()
    assert cli("prune").stdout == "nothing to remove\n0 cells stay (0 bytes)\n"
