"""Files of which nobody knows where they come from."""

import json
import os
import stat
import threading
from pathlib import Path

import pytest

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
        case "link to a folder":
            outside.with_name("elsewhere").mkdir()
            path.symlink_to(outside.with_name("elsewhere"))
        case "dangling":
            path.symlink_to("nowhere")
        case "socket":
            os.mknod(path, stat.S_IFSOCK | 0o600)


def test_only_regular_files_of_bounded_size_are_read(tmp_path, outside):
    """Reading ends at once, with a reason in words; at the bound a file is read whole."""
    for kind in ("fifo", "link", "endless", "folder"):
        special(kind, tmp_path / kind, outside)
        with pytest.raises(OSError, match=r"link|not a regular|directory"):
            files.read(tmp_path / kind)
    for text, words in (
        ("[" * 100_000, "nested too deeply"),
        ("[" + "1" * 401 + "]", "401 digits"),
    ):
        with pytest.raises(ValueError, match=words):
            files.parse_json(text.encode())
    path = tmp_path / "a"
    path.write_bytes(bytes(100))
    assert files.read(path, 100) == bytes(100)
    with pytest.raises(OSError, match="larger than 99 bytes"):
        files.read(path, 99)


@pytest.mark.parametrize(
    ("kind", "name", "replaced"),
    [
        ("fifo", ".lock", False),
        ("other name", ".lock", False),
        ("link", "quick.csv", True),
        ("endless", "quick.json", True),
        *(("link to a folder", name, False) for name in ("cells", "trajectory")),
    ],
)
def test_runs_write_no_further_than_the_folder(cli, outside, kind, name, replaced):
    """Whatever stands in the place of a file of the results, nothing outside changes."""
    cli.write("quick.yaml", STUDY.replace("measure: condition", "measure: [condition, trajectory]"))
    place = cli.folder / "results" / name
    special(kind, place, outside)
    done = ended(cli, "run", "quick.yaml")
    assert outside.read_text() == SECRET
    assert not [*outside.parent.glob("elsewhere/*")]
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


def test_what_cannot_be_read_ends_in_a_line(cli, outside):
    """CSV and record: each command answers at once, and quotes nothing of what a link leads to."""
    cli.write("quick.yaml", STUDY)
    for name, kind, command in (
        ("quick.csv", "fifo", "check"), ("quick.csv", "link", "report"),
        ("quick.json", "link", "check"), ("quick.json", "endless", "show"),
    ):  # fmt: skip
        cli("run", "quick.yaml")
        special(kind, cli.folder / "results" / name, outside)
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
    """What is written goes into a pipe or through a link; a file keeps its mode."""
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
    series = cli.folder / "results/trajectory/quick.csv"
    cli.write("quick.yaml", STUDY.replace("t_end: 0.1}", "t_end: 0.1, measure: [trajectory]}"))
    cli("run", "quick.yaml")
    assert series.exists()
    cli.write("quick.yaml", STUDY)
    cli("run", "quick.yaml")
    assert not series.exists()
    path = cli.folder / "results/quick.csv"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"optimal", b"left", 1))
    assert "quick.csv: differs from its record" in " ".join(cli("check", code=1).stdout.split())
    assert "(2 cached)" in cli("run", "quick.yaml").stdout
    assert path.read_bytes() == whole
    assert records.changed(cli.folder / "results", ["quick"]) == []
