"""Compiled code that is kept on disk, and where it cannot be kept."""

import importlib.util
import sys

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from newmark_cli.support import cached_code

TRIPLE = """
from newmark_cli.support.cached_code import cached_njit

@cached_njit(nogil=True)
def triple(x):
    return 3 * x
"""


def kept_in(tmp_path, monkeypatch):
    """The folder in which code is kept from now on."""
    folder = tmp_path / "kept"
    folder.mkdir()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
    (tmp_path / "tripled.py").write_text(TRIPLE)
    return folder


def tripled(tmp_path, value):
    """Three times a value by a newly imported function, and how often it was found on disk."""
    spec = importlib.util.spec_from_file_location("tripled", tmp_path / "tripled.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["tripled"] = module
    spec.loader.exec_module(module)
    result = module.triple(value)
    return result, sum(module.triple.stats.cache_hits.values())


def test_code_is_found_again(tmp_path, monkeypatch):
    """The second process takes what the first has compiled; a change of the source does not."""
    kept_in(tmp_path, monkeypatch)
    assert tripled(tmp_path, 2) == (6, 0)
    assert tripled(tmp_path, 2) == (6, 1)
    (tmp_path / "tripled.py").write_text(TRIPLE.replace("3 * x", "30 * x"))
    assert tripled(tmp_path, 2) == (60, 0)


def test_bytes_are_made_once(tmp_path, monkeypatch):
    """Those of machine code, beside the compiled code of a function."""
    kept_in(tmp_path, monkeypatch)
    tripled(tmp_path, 2)
    owner = sys.modules["tripled"].triple.py_func
    assert not cached_code.are_kept(owner, "code-0123")
    assert cached_code.kept_bytes(owner, "code-0123", lambda: b"made") == b"made"
    assert cached_code.are_kept(owner, "code-0123")
    assert cached_code.kept_bytes(owner, "code-0123", lambda: b"other") == b"made"


def test_folders_that_cannot_be_written(tmp_path, monkeypatch):
    """A warning that names the folder, once."""
    kept_in(tmp_path, monkeypatch)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(IndexDataCacheFile, "_save_index", refuse)
    with pytest.warns(UserWarning, match="compiled code cannot be kept: .*kept.*denied"):
        assert tripled(tmp_path, 2) == (6, 0)
    assert tripled(tmp_path, 2) == (6, 0)  # another warning would be an error
