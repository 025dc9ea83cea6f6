"""Results folders that cannot be locked, or written in part."""

import errno
import fcntl
import os
import tempfile

import pytest
from each import each

from newmark_cli.running import lock
from newmark_cli.study.results import ResultsError


@each("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL])
def test_a_file_system_without_locks(tmp_path, monkeypatch, number):
    """A warning that says so, once, and the run goes on; nobody else holds the folder."""

    def refuse(file, kind):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
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

    monkeypatch.setattr(fcntl, "flock", refuse)
    with (
        pytest.raises(ResultsError, match="in use by 'run a', process 7 on there since now"),
        lock.locked(tmp_path, "run quick"),
    ):
        pass


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
