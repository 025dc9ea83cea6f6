"""Results folders that cannot be locked, or written in part."""

import errno
import os

import pytest
from conftest import QUICK
from portalocker import portalocker

from newmark_cli.running import lock
from newmark_cli.study.csv_files import ResultsError


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL])
def test_a_file_system_without_locks(tmp_path, monkeypatch, number):
    """A warning that says so, once, and the run goes on; nobody else holds the folder."""

    def refuse(file, kind):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(portalocker, "LOCKER", refuse)
    held = False
    with (
        pytest.warns(UserWarning, match=rf"{tmp_path}: cannot be locked \(.*\); let no other run"),
        lock.locked(tmp_path, "run quick"),
    ):
        held = True
    assert held


@pytest.mark.parametrize("number", [errno.EAGAIN, errno.EACCES])
def test_a_lock_that_is_held(tmp_path, monkeypatch, number):
    """Both errors that systems have for it name who holds the folder."""
    (tmp_path / ".lock").write_text(
        '{"what": "run a", "process": 7, "host": "there", "started": "now"}'
    )

    def refuse(file, kind):
        raise OSError(number, "locked")

    monkeypatch.setattr(portalocker, "LOCKER", refuse)
    with (
        pytest.raises(ResultsError, match="in use by 'run a', process 7 on there since now"),
        lock.locked(tmp_path, "run quick"),
    ):
        pass


def _tried(folder):
    """What somebody else finds who tries to hold a folder: locks are of descriptors."""
    try:
        with lock.locked(folder, "run other"):
            return "held"
    except ResultsError as error:
        return str(error)


def test_a_run_excludes_every_other(cli):
    """Until it ends; the command says who is there, and computes nothing."""
    cli.write("quick.yaml", QUICK)
    folder = cli.folder / "results"
    folder.mkdir()
    with lock.locked(folder, "run whole"):
        held = f"in use by 'run whole', process {os.getpid()} on "
        assert _tried(folder).startswith(f"{folder}: {held}")
        assert f"results: {held}" in cli.refused("run", "quick.yaml")
        assert [path.name for path in folder.iterdir()] == [".lock"]
    assert _tried(folder) == "held"
