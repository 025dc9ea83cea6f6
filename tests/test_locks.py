"""Results folders that cannot be locked, or written in part."""

import errno
import os
import tempfile

import pytest
from each import each
from portalocker import portalocker

from newmark_cli import files
from newmark_cli.running import lock
from newmark_cli.study.results import ResultsError


@each("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL])
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


@each("number", [errno.EAGAIN, errno.EACCES])
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


def _tried(folder, shard):
    """What somebody else finds who tries to hold a folder: locks are of descriptors."""
    try:
        with lock.locked(folder, "run other", shard):
            return "held"
    except ResultsError as error:
        return str(error)


def test_who_may_hold_a_folder_together(tmp_path):
    """A run excludes every other; a shard excludes runs and itself, not other shards."""
    with lock.locked(tmp_path, "run whole"):
        for shard in ("", "1/2"):
            assert f"{tmp_path}: in use by 'run whole', process {os.getpid()}" in _tried(
                tmp_path, shard
            )
    with lock.locked(tmp_path, "run part", "1/2"):
        assert _tried(tmp_path, "2/2") == "held"
        for shard in ("", "1/2"):
            assert f"{tmp_path}: in use by 'run " in _tried(tmp_path, shard)
    assert _tried(tmp_path, "") == "held"


def test_what_a_lock_says(tmp_path):
    """A file that another descriptor holds is told from one that cannot be locked."""
    path = tmp_path / "file"
    with path.open("w") as first, path.open() as second:
        files.lock(first.fileno())
        with pytest.raises(BlockingIOError):
            files.lock(second.fileno(), shared=True)
    with pytest.raises(OSError, match="Bad file descriptor") as found:
        files.lock(1_000_000)
    assert found.value.errno == errno.EBADF


@each("part", ["cells", "history", "references"])
def test_parts_that_cannot_be_written_are_found_first(tmp_path, monkeypatch, part):
    """Before hours of work rather than after."""
    from newmark_cli.running import runner
    from newmark_cli.study import config

    (tmp_path / part).mkdir()
    make = tempfile.mkstemp

    def refuse(*arguments, **options):
        if str(options["dir"]).endswith(part):
            raise PermissionError(errno.EACCES, "Permission denied")
        return make(*arguments, **options)

    monkeypatch.setattr(tempfile, "mkstemp", refuse)
    monkeypatch.setattr(runner, "_execution", None)  # nothing runs
    study = config.load_shipped("pendulum-u")
    with pytest.raises(ResultsError, match=rf"{part}: results cannot be written: Permission de"):
        runner.run_studies([study], tmp_path, runner.Options(jobs=1))
