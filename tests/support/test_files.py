"""Files of which nobody knows where they come from."""

import json
import os
import stat
import threading
from pathlib import Path

import pytest
from each import each

from newmark_cli.report.reading import records
from newmark_cli.support import files
from newmark_cli.support.errors import ResultsError

SECRET = "a secret of somebody's"
STUDY = """\
study: quick
cases:
  - {problem: pendulum, form: u-lambda, preconditioning: optimal, h: [1e-2, 5e-3], t_end: 0.1}
measure: condition
"""


@pytest.fixture
def outside(tmp_path):
    """A file that is not the results folder's."""
    file = tmp_path / "outside.txt"
    file.write_text(SECRET)
    return file


def ended(cli, *words):
    """Run a command, whatever its exit code; it answers in at most a line."""
    done = cli.run(*words)
    assert "Traceback" not in done.stderr, (words, done.stderr)
    assert done.stderr.count("\n") <= 1, (words, done.stderr)
    return done


def special(kind: str, path: Path, outside: Path) -> None:
    """Put what is no regular file in a place."""
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    match kind:
        case "fifo":
            os.mkfifo(path)
        case "link":
            path.symlink_to(outside)
        case "other name":
            os.link(outside, path)
        case "endless":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
        case "dangling":
            path.symlink_to("nowhere")
        case "socket":
            os.mknod(path, stat.S_IFSOCK | 0o600)


KINDS = ("fifo", "link", "endless", "folder")


@each("kind", KINDS)
def test_only_regular_files_are_read(tmp_path, outside, kind):
    """Reading ends at once, with a reason in words."""
    path = tmp_path / "a"
    special(kind, path, outside)
    with pytest.raises(OSError, match=r"link|not a regular|directory"):
        files.read(path)


def test_reading_is_bounded(tmp_path):
    """A file that is too large is refused, not read; at the bound it is read whole."""
    path = tmp_path / "a"
    path.write_bytes(bytes(100))
    assert files.read(path, 100) == bytes(100)
    with pytest.raises(OSError, match="larger than 99 bytes"):
        files.read(path, 99)


@each(
    "text, words",
    [
        ("[" * 100_000, "nested too deeply"),
        ("1" * 5000, "digits"),
        ("[" + "1" * 401 + "]", "a number of 401 digits"),
        ("{", "Expecting"),
        ("\xff", "UTF-8"),
    ],
)
def test_what_is_not_json(text, words):
    """What could not be worked with is a ValueError that says why."""
    with pytest.raises(ValueError, match=words):
        files.parse_json(text.encode("latin-1"))
    assert files.parse_json(b'{"a": [1, "\\u00e9", null]}') == {"a": [1, "é", None]}


@each(
    "kind, name, replaced",
    [
        ("fifo", ".lock", False),
        ("link", ".lock", False),
        ("other name", ".lock", False),
        ("fifo", "quick.csv", True),
        ("folder", "quick.json", False),
        ("link", "quick.csv", True),
        ("endless", "quick.json", True),
        ("link", "cells", False),
    ],
)
def test_runs_write_no_further_than_the_folder(cli, outside, kind, name, replaced):
    """Whatever stands in the place of a file of the results, nothing outside changes.

    The run takes its place or ends in a line.
    """
    cli.write("quick.yaml", STUDY)
    place = cli.folder / "results" / name
    special(kind, place, outside)
    done = ended(cli, "run", "quick.yaml")
    assert outside.read_text() == SECRET
    if replaced:
        assert done.returncode == 0, done.stderr
        assert place.is_file()
        assert not place.is_symlink()
    else:
        assert done.returncode == 2
        assert str(Path("results", name)) in done.stderr


def test_what_stands_in_the_place_of_a_cell(cli, outside):
    """It is replaced; a folder, which may hold anything, is refused."""
    cli.write("quick.yaml", STUDY.replace("5e-3", "5e-3, 2e-2, 2.5e-2"))
    cli("run", "quick.yaml")
    before = (cli.folder / "results/quick.csv").read_bytes()
    cells = sorted((cli.folder / "results/cells").iterdir())
    for place, kind in zip(cells, ("fifo", "link", "dangling", "socket"), strict=True):
        special(kind, place, outside)
    assert cli("run", "quick.yaml").stdout == "quick: 4 ok -> results/quick.csv\n"
    assert (cli.folder / "results/quick.csv").read_bytes() == before
    assert all(place.is_file() and not place.is_symlink() for place in cells)
    assert outside.read_text() == SECRET
    special("folder", cells[0], outside)
    assert cli.refused("run", "quick.yaml") == (
        f"newmark-study: results/cells/{cells[0].name}: cannot be written: "
        "it is a folder; remove it"
    )


def test_no_folder_outside_is_written(cli, tmp_path):
    """A link in the place of a folder of the results is refused, or replaced."""
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for name in ("cells", "figures", "tables", "references", "trajectory"):
        place = cli.folder / "results" / name
        if place.exists():
            place.rename(place.with_name(f"{name}-before"))
        place.symlink_to(elsewhere)
    for words in (("run", "quick.yaml"), ("plot", "quick"), ("draw", "pendulum")):
        done = ended(cli, *words)
        assert done.returncode == 2, (words, done.stdout)
        assert "symbolic link" in done.stderr
    assert list(elsewhere.iterdir()) == []


@each("name", ["quick.csv", "quick.json"])
def test_what_cannot_be_read_ends_in_a_line(cli, outside, name):
    """CSV and record: each command answers at once, and quotes nothing of what a link leads to."""
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    for kind, commands in {
        "fifo": ("check", "show"), "link": ("report", "check"), "endless": ("show",),
    }.items():  # fmt: skip
        special(kind, cli.folder / "results" / name, outside)
        for command in commands:
            done = ended(cli, command)
            assert SECRET not in done.stdout + done.stderr


def test_a_record_names_only_its_own_files(cli, outside):
    """`check` reads nothing outside of the folder, whatever a record names."""
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    file = cli.folder / "results/quick.json"
    record = json.loads(file.read_text())
    record["sha256"]["../../outside.txt"] = "0" * 64
    record["sha256"]["/etc/passwd"] = "0" * 64
    file.write_text(json.dumps(record))
    found = json.loads(cli("check", "--json", code=1).stdout)
    assert found[-2:] == [
        {
            "file": "results/quick.json",
            "finding": f"names {name!r}, which is not a file of this study",
        }
        for name in ("../../outside.txt", "/etc/passwd")
    ]


def test_cells_of_wrong_types_are_computed_again(cli):
    cli.write("quick.yaml", STUDY.replace("5e-3", "5e-3, 2e-2"))
    cli("run", "quick.yaml")
    before = (cli.folder / "results/quick.csv").read_bytes()
    wrong = ({"seconds": "1e400 s"}, {"key": []}, {"outcome": [], "seconds": {}, "versions": 3})
    for file, record in zip((cli.folder / "results/cells").iterdir(), wrong, strict=True):
        files.write_sealed(file, files.read_sealed(file) | record, file.parent)
    assert ended(cli, "run", "--dry-run", "quick.yaml").returncode == 0
    assert cli("run", "quick.yaml").stdout == "quick: 3 ok -> results/quick.csv\n"
    assert (cli.folder / "results/quick.csv").read_bytes() == before


def test_outputs_that_are_no_files(tmp_path):
    """What is written goes into a device or a pipe or through a link; a file keeps its mode."""
    files.write_output(Path("/dev/null"), "new")
    assert Path("/dev/null").is_char_device()
    target, link, pipe = (tmp_path / name for name in ("kept", "link", "pipe"))
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to("kept")
    files.write_output(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o640
    os.mkfifo(pipe)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    files.write_output(pipe, "new")
    reader.join(30)
    assert got == ["new"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_pages_go_where_they_are_sent(cli):
    """A link is followed where the user has named it, and replaced in a results folder."""
    pytest.importorskip("jinja2")
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    (cli.folder / "link.html").symlink_to("page.html")
    cli("report", "--output", "link.html")
    assert (cli.folder / "page.html").read_text().startswith("<!DOCTYPE html>")
    (cli.folder / "results/report.html").symlink_to(cli.folder / "page.html")
    line = cli.refused("report", "--output", "lost/page.html")
    assert "lost/page.html: cannot be written: there is no folder" in line
    assert not (cli.folder / "lost").exists()
    before = (cli.folder / "page.html").stat().st_mtime_ns
    cli("report")
    assert not (cli.folder / "results/report.html").is_symlink()
    assert (cli.folder / "page.html").stat().st_mtime_ns == before


def test_a_full_disk_leaves_files_that_belong_together(tmp_path, monkeypatch):
    """All of them as they were, and nothing under a temporary name."""
    paths = [tmp_path / name for name in "abc"]
    files.replace_together(dict.fromkeys(paths, "old"), tmp_path)
    calls = []

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResultsError, match="c: cannot be written: No space left on device"):
        files.replace_together(dict.fromkeys(paths, "new"), tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(
        "abc", "old"
    )
    monkeypatch.undo()
    files.replace_together({paths[0]: "new", paths[1]: None}, tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "new", "c": "old"}


def test_places_where_no_file_can_be(tmp_path):
    """A name too long for a temporary one, a folder that is a file or is not there."""
    (tmp_path / "file").touch()
    for place in ("n" * 250, "file/a", "none/a"):
        for write in (files.write, files.write_output):
            with pytest.raises(ResultsError, match=r"cannot be written: (File|Not|No such|there)"):
                write(tmp_path / place, "new")
    assert [*tmp_path.iterdir()] == [tmp_path / "file"]


def test_a_run_that_was_killed_between_two_files_is_mended(cli):
    """`check` says that the CSV is not that of its record; the next run writes both."""
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    path = cli.folder / "results/quick.csv"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"optimal", b"left", 1))
    assert "quick.csv: differs from its record" in " ".join(cli("check", code=1).stdout.split())
    assert "(2 cached)" in cli("run", "quick.yaml").stdout
    assert path.read_bytes() == whole
    assert records.changed(cli.folder / "results", ["quick"]) == []


def test_what_is_no_more_goes_with_the_rest(cli):
    """A study that records no time series any more loses its old one, and the record agrees."""
    config = STUDY.replace("t_end: 0.1}", "t_end: 0.1, measure: [trajectory]}")
    cli.write("quick.yaml", config)
    cli("run", "quick.yaml")
    assert (cli.folder / "results/trajectory/quick.csv").exists()
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    assert not (cli.folder / "results/trajectory/quick.csv").exists()
    assert records.changed(cli.folder / "results", ["quick"]) == []
