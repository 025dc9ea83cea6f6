"""Compiled code that is kept on disk: damage is noticed, and nothing depends on the folder."""

import hashlib
import importlib.util
import itertools
import os
import pickle
import sys
import warnings

import numba
import pytest
from each import each

from newmark_cli import cached_code

TRIPLE = """
from newmark_cli.cached_code import cached_njit

@cached_njit(nogil=True)
def triple(x):
    return 3 * x
"""


class Fails:
    """Fails in its own way when it is unpickled."""

    def __reduce__(self):
        return (exec, ("raise EOFError",))


class Runs:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return (os.mkdir, (str(self.folder),))


def random_bytes(content):
    return bytes((7 * i) % 256 for i in range(len(content)))


def flipped(content):
    return content[:-100] + bytes([content[-100] ^ 1]) + content[-99:]


DAMAGES = {
    "empty": lambda content: b"",
    "cut": lambda content: content[: len(content) // 2],
    "zeros": lambda content: bytes(len(content)),
    "garbage": random_bytes,
    "flipped": flipped,
    "another pickle": lambda content: pickle.dumps((numba.__version__, {1: 2})),
    "evil pickle": lambda content: pickle.dumps(Fails()),
}


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


def test_damaged_code_is_compiled_again(tmp_path, monkeypatch):
    """Whatever a file holds: right results, no exception, and good files from then on."""
    folder = kept_in(tmp_path, monkeypatch)
    assert tripled(tmp_path, 2) == (6, 0)
    assert tripled(tmp_path, 2) == (6, 1)
    for ending, damage in itertools.product(["nbi", "nbc"], DAMAGES):
        (file,) = folder.rglob(f"*.{ending}")
        file.write_bytes(DAMAGES[damage](file.read_bytes()))
        assert tripled(tmp_path, 2) == (6, 0), (ending, damage)
        assert tripled(tmp_path, 2) == (6, 1), (ending, damage)


def test_code_of_others_is_not_run(tmp_path, monkeypatch):
    """Who may write to the folder may put a pickle there, with the digest that belongs to it."""
    folder = kept_in(tmp_path, monkeypatch)
    assert tripled(tmp_path, 2) == (6, 0)
    (index,) = folder.rglob("*.nbi")
    evil = pickle.dumps(Runs(tmp_path / "ran"))
    index.write_bytes(hashlib.sha256(evil).digest() + evil)
    if os.geteuid() == 0:
        os.chown(index, 4321, -1)
    else:
        monkeypatch.setattr(cached_code, "_TRUSTED", set())
    assert tripled(tmp_path, 2) == (6, 0)
    assert not (tmp_path / "ran").exists()


@each("ending", ["nbi", "nbc"])
def test_folders_in_the_place_of_files(tmp_path, monkeypatch, ending):
    """Nothing can be kept: one warning, and right results."""
    folder = kept_in(tmp_path, monkeypatch)
    tripled(tmp_path, 2)
    (file,) = folder.rglob(f"*.{ending}")
    file.unlink()
    file.mkdir()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert tripled(tmp_path, 2) == (6, 0)
        assert tripled(tmp_path, 2.5) == (7.5, 0)


def test_folders_that_cannot_be_written(tmp_path, monkeypatch):
    """A warning that names the folder, once."""
    kept_in(tmp_path, monkeypatch)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(cached_code._Files, "_save_index", refuse)
    with pytest.warns(UserWarning, match="compiled code cannot be kept: .*kept.*denied"):
        assert tripled(tmp_path, 2) == (6, 0)
    assert tripled(tmp_path, 2) == (6, 0)  # another warning would be an error


def test_no_folder_at_all(tmp_path, monkeypatch):
    """As in some containers: a warning that says what to set."""
    kept_in(tmp_path, monkeypatch)
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(cached_code, "_warned", set())
    with pytest.warns(UserWarning, match="set NUMBA_CACHE_DIR to one"):
        assert tripled(tmp_path, 2) == (6, 0)
