"""Python problems that import modules beside their file: what runs is what the files say."""

import os
import sys
from dataclasses import replace

import pytest
from conftest import SWING, rows_in, write_swings

from newmark_cli.mechanisms.spec import PythonFactory, portable
from newmark_cli.problems.problem import ProblemError

#: A problem whose pendulum's length is imported.
MINE = (
    SWING.replace("import numpy as np\n", "import numpy as np\nfrom sizes import LENGTH\n")
    .replace("np.array([1.0, 0.0])", "np.array([LENGTH, 0.0])")
    .replace("(u @ u - 1)", "(u @ u - LENGTH**2)")
)


def folder(parent, name, sizes):
    """A folder with the problem, and what it imports: file → text."""
    made = parent / name
    for file, text in {"mine.py": MINE, **sizes}.items():
        (made / file).parent.mkdir(parents=True, exist_ok=True)
        (made / file).write_text(text)
    return made


def factory(made):
    """The problem of a folder."""
    return PythonFactory(made / "mine.py", "swing", (), "mine.py:swing")


def length(spec):
    """What the problem imported."""
    return spec.load().u0[0]


KINDS = {
    "module-of-modules": {"sizes.py": "from more import LENGTH\n", "more.py": "LENGTH = 2.0\n"},
    # Numba's own cache goes by file times, too: each process compiles anew.
    "machine-code": {
        "sizes.py": "import numba\n@numba.njit(cache=True)\ndef size():\n    return 2.0\n"
        "LENGTH = size()\n"
    },
    "lazy-module": {
        "sizes.py": "import importlib\nLENGTH = importlib.import_module('more').LENGTH\n",
        "more.py": "LENGTH = 2.0\n",
    },
    "package": {"sizes/__init__.py": "from .one import LENGTH\n", "sizes/one.py": "LENGTH = 2.0\n"},
    "folder": {
        "sizes.py": "from parts.of.one import LENGTH\n",
        "parts/of/one.py": "from parts import two\nLENGTH = two.LENGTH\n",
        "parts/two.py": "LENGTH = 2.0\n",
        "parts/three.py": "what is not imported may be broken\n",
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_imports(tmp_path, monkeypatch, kind):
    """From beside the file, whatever the current folder; nothing is left behind.

    Another text of the same length and time is another problem, where Python's bytecode would be
    stale; and what travels to where the files are not is the same one, by its content.
    """
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    paths, finders = [*sys.path], [*sys.meta_path]
    for size in ("2.0", "3.0"):
        files = {file: text.replace("2.0", size) for file, text in KINDS[kind].items()}
        made = folder(tmp_path, "here", files)
        (made / "mine.py").write_text(MINE.replace("[LENGTH,", f"[LENGTH + 0 * {size},"))
        for file in made.rglob("*.py"):
            os.utime(file, (1e9, 1e9))
        assert length(replace(factory(made), spelled=size)) == float(size)
    assert (sys.path, sys.meta_path) == (paths, finders)
    assert not {name.partition(".")[0] for name in sys.modules} & {"sizes", "more", "parts"}
    assert not list(made.rglob("__pycache__"))
    carried, content = portable(factory(made)), factory(made).load().content
    made.rename(tmp_path / "away")
    assert length(carried) == 3.0
    assert carried.load().content == content
    # Modules of the same names in another folder are others.
    assert length(factory(folder(tmp_path, "b", KINDS[kind]))) == 2.0


def test_python_and_what_is_installed_go_first(tmp_path):
    """Others rely on them, and a process may have imported them already, or not."""
    names = ("colorsys", "queue", "yaml", "newmark_cli")
    late = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    late += "@dataclass\nclass Size:\n    length: float = 1.0\n"
    files = {"sizes.py": f"{late}import {', '.join(names)}\nLENGTH = 6 * colorsys.ONE_THIRD\n"}
    files |= {f"{name}.py": "1 / 0\n" for name in names}
    sys.modules.pop("colorsys", None)
    assert length(factory(folder(tmp_path, "here", files))) == 2.0


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ({}, "mine.py, line 5: ModuleNotFoundError: No module named 'sizes'"),
        ({"sizes.py": "LENGTH =\n"}, "mine.py, line 5: sizes.py, line 1: SyntaxError"),
        ({"sizes.py": "from a.b import c\n", "a/b.py": "1 / 0"}, "a/b.py, line 1: ZeroDivision"),
        ({"sizes.py": "raise SystemExit(0)\n"}, "sizes.py, line 1: SystemExit: 0"),
        ({"sizes.py": "LENGTH = 2.0\n", "mine.py": "\0"}, "null bytes"),
    ],
)
def test_mistakes(tmp_path, sizes, words):
    """The line of the problem's own file that imports what cannot be imported."""
    with pytest.raises(ProblemError) as caught:
        factory(folder(tmp_path, "here", sizes)).load()
    assert "mine.py" in str(caught.value)
    assert words in str(caught.value)


#: A problem whose force fails after t = 0.5, in its own file, beside it, or compiled.
FAILS = """\
import numba
import numpy as np
from newmark_cli.problems.python_problem import Definition
from parts.one import divided


def plain(u, v, t):
    if t > 0.5:
        raise KeyError("no\\nmore" * 100)
    return np.array([0.0, -1.0])


def beside(u, v, t):
    return np.array([0.0, -divided(t)])


@numba.njit
def compiled(u, v, t):
    if t > 0.5:
        raise ValueError("no more")
    return np.array([0.0, -1.0])


def constraints(u, t):
    return np.array([(u[0] * u[0] + u[1] * u[1] - 1) / 2])


def gradient(u, t):
    return u.copy().reshape(-1, 1)


def swing(force):
    given = [globals()[force], constraints, gradient]
    if given[0] is compiled:  # so that the kernel calls it
        given[1:] = map(numba.njit, given[1:])
    u0, v0 = np.array([1.0, 0.0]), np.zeros(2)
    return Definition(np.eye(2), u0, v0, *given, quadratic=True)
"""


def test_failures_name_the_line(cli):
    """The innermost of the user's own, by the names that the user knows; in one line each."""
    cli.write("own/mine.py", FAILS)
    cli.write("own/parts/one.py", "\n\ndef divided(t):\n    return 1.0 / (t < 0.5)\n")
    forces = ["plain", "beside", "compiled"]
    cases = [f'  - problem: {{python: "own/mine.py:swing", args: {{force: {f}}}}}' for f in forces]
    cases.append(f"{cases[-1]}\n    h: 0.05\n    t_end: 0.5")
    cli.write(
        "mine.yaml",
        "study: mine\nform: u-lambda\npreconditioning: optimal\nh: 0.1\nt_end: 1.0\n"
        "cases:\n" + "\n".join(cases),
    )
    done = cli("run", "mine.yaml", "--allow-code", "-q", "--jobs", 1, code=1)
    first, *others = done.stderr.splitlines()
    said = f"newmark-study: mine: 1 of {len(cases)} cells "
    start = f"{said}failed: own/mine.py, line 9: KeyError: 'no\\nmoreno"
    assert first.startswith(start)
    assert first.endswith("…")
    assert len(first) == len(f"{said}failed: ") + 300
    expected = [
        f"{said}failed: own/parts/one.py, line 4: ZeroDivisionError: float division by zero",
        f"{said}failed: own/mine.py, line 20: ValueError: no more",
    ]
    assert others == expected
    rows = rows_in(cli.folder / "results/mine.csv")
    well = {(row["problem"], row["h"]) for row in rows if row["status"] == "ok"}
    assert well == {("mine.py:swing(force=compiled)", "0.05")}


def test_what_was_imported_counts(tmp_path):
    """Under its name, for a file that is renamed may mean something else; and nothing else."""
    text = "try:\n    from a import K\nexcept ImportError:\n    from b import K\nLENGTH = 2.0\n"
    contents = {}
    for case, files in {
        "a": {"a.py": "K = 1\n"},
        "again": {"a.py": "K = 1\n", "b.py": "K = 2\n"},
        "b": {"b.py": "K = 1\n"},
        "changed": {"a.py": "K = 2\n"},
    }.items():
        problem = factory(folder(tmp_path, case, {"sizes.py": text, **files})).load()
        assert sorted(problem.sources) == [min(files), "mine.py", "sizes.py"]
        contents[case] = problem.content
    assert contents["a"] == contents["again"]
    assert len({*contents.values()}) == 3


def test_loading_is_bounded_as_a_cell_is(cli):
    """A module that hangs where it is imported."""
    write_swings(cli, "")
    cli.write("mine.py", "import time\ntime.sleep(120)\n")
    line = cli.refused("run", "swings.yaml", "--allow-code", "--timeout", "0.5")
    assert line.endswith("cannot be loaded: took longer than 0.5 s")
