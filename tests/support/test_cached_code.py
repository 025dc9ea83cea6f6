"""Compiled code that is kept on disk, and where it cannot be kept."""

import importlib.util
import os
import subprocess
import sys

import numba
import pytest
from damaging import damaged

from newmark_cli.support import cached_code, sources

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


def test_damaged_code_is_compiled_anew(tmp_path, monkeypatch):
    """One flipped bit, cut, or empty: never loaded, and replaced; so is that of another source."""
    folder = kept_in(tmp_path, monkeypatch)
    assert [tripled(tmp_path, 2), tripled(tmp_path, 2)] == [(6, 0), (6, 1)]
    (file,) = (path for path in folder.rglob("*") if path.is_file())
    for content in damaged(file.read_bytes(), flips=4):
        file.write_bytes(content)
        assert tripled(tmp_path, 2) == (6, 0)
        assert tripled(tmp_path, 2) == (6, 1)
    assert [path for path in folder.rglob("*") if path.is_file()] == [file]
    (tmp_path / "tripled.py").write_text(TRIPLE.replace("3 * x", "30 * x"))
    assert tripled(tmp_path, 2) == (60, 0)


def test_damaged_bytes_are_made_anew(tmp_path, monkeypatch):
    """So is machine code beside a function's that was made from something else."""
    folder = kept_in(tmp_path, monkeypatch)
    tripled(tmp_path, 2)
    owner = sys.modules["tripled"].triple.py_func
    made = []

    def kept(made_from="sources"):
        def make():
            made.append(made_from)
            return b"made from " + made_from.encode()

        return cached_code.kept_bytes(owner, "code-0123", make, made_from)

    assert cached_code.kept_bytes(owner, "code-0123", None) is None
    assert kept() == b"made from sources"
    (file,) = folder.rglob("code-0123*")
    for content in damaged(file.read_bytes()):
        file.write_bytes(content)
        made.clear()
        assert cached_code.kept_bytes(owner, "code-0123", None, "sources") is None
        assert [kept(), kept()] == [b"made from sources"] * 2
        assert made == ["sources"]
    assert kept("others") == b"made from others"
    assert [*folder.rglob("code-0123*")] == [file]


def test_changes_of_other_files_are_noticed(tmp_path, monkeypatch):
    """Code is made from all files of the core that its own imports, directly or not."""
    for name, text in {
        "laws": "from newmark_cli.mechanisms.timed import at\n",
        "timed": "from newmark_cli.mechanisms import (\n    sines,\n)\n",
        "sines": "sine = 1\n",
        "other": "",
    }.items():
        (tmp_path / "mechanisms").mkdir(exist_ok=True)
        (tmp_path / f"mechanisms/{name}.py").write_text(text)
    monkeypatch.setattr(sources, "PACKAGE", tmp_path)
    stamps = []
    for changed in ("none", "other", "sines", "timed", "laws"):
        with (tmp_path / f"mechanisms/{changed}.py").open("a") as file:
            file.write("# changed\n")
        for kept in (sources._read, sources.stamp):
            kept.cache_clear()
        stamps.append(sources.stamp(tmp_path / "mechanisms/laws.py"))
    assert stamps[0] == stamps[1]
    assert len({*stamps}) == 4
    # What is kept depends on that.
    kept_in(tmp_path, monkeypatch)
    found = []
    for stamp in ("one", "one", "two", "two"):
        monkeypatch.setattr(sources, "stamp", lambda path, stamp=stamp: stamp)
        found.append(tripled(tmp_path, 2))
    assert found == [(6, 0), (6, 1)] * 2


def test_two_processes_compile_it_once(tmp_path):
    """The second waits for what the first saves, and nothing of that is left."""
    (tmp_path / "tripled.py").write_text(TRIPLE)
    text = "import tripled; tripled.triple(2); print(*tripled.triple.stats.cache_hits.values())"
    kept = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": str(tmp_path)}
    both = [
        subprocess.Popen([sys.executable, "-c", text], env=kept, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    assert sorted(one.communicate()[0].strip() for one in both) == ["", "1"]
    assert not [*(tmp_path / "kept").rglob("*.lock")]


def test_folders_that_cannot_be_written(tmp_path, monkeypatch):
    """A warning that names the folder, once."""
    kept_in(tmp_path, monkeypatch)

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.warns(UserWarning, match="compiled code cannot be kept: .*kept.*denied"):
        assert tripled(tmp_path, 2) == (6, 0)
    assert tripled(tmp_path, 2) == (6, 0)  # another warning would be an error
