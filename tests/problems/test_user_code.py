"""Python problems that import modules beside their file: what runs is what the files say."""

import csv
import os
import sys
from dataclasses import replace

import pytest
from conftest import SWING
from each import each

import newmark_cli as newmark
from newmark_cli.mechanisms.spec import PythonFactory, portable
from newmark_cli.problems.problem import ProblemError

#: A problem whose pendulum's length is imported.
MINE = (
    SWING.replace("import numpy as np\n", "import numpy as np\nfrom sizes import LENGTH\n")
    .replace("np.array([1.0, 0.0])", "np.array([LENGTH, 0.0])")
    .replace("(u @ u - 1)", "(u @ u - LENGTH**2)")
)

STUDY = """\
study: mine
problem: {python: "mine.py:swing"}
form: u-lambda
preconditioning: none
h: 0.1
t_end: 1.0
expect: [{measure: correction, at_least: 1.0e-99}]
"""


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
    "module": {"sizes.py": "LENGTH = 2.0\n"},
    "module-of-modules": {"sizes.py": "from more import LENGTH\n", "more.py": "LENGTH = 2.0\n"},
    "lazy-module": {
        "sizes.py": "import importlib\nLENGTH = importlib.import_module('more').LENGTH\n",
        "more.py": "LENGTH = 2.0\n",
    },
    "nested-folders": {
        "sizes.py": "from parts.of.one import LENGTH\n",
        "parts/of/one.py": "LENGTH = 2.0\n",
    },
    "package": {"sizes/__init__.py": "from .one import LENGTH\n", "sizes/one.py": "LENGTH = 2.0\n"},
    "folder": {
        "sizes.py": "from parts.one import LENGTH\n",
        "parts/one.py": "from parts import two\nLENGTH = two.LENGTH\n",
        "parts/two.py": "LENGTH = 2.0\n",
        "parts/three.py": "what is not imported may be broken\n",
    },
}


@each("kind", KINDS)
def test_imports(tmp_path, kind):
    """From beside the file, whatever the current folder; nothing is left behind."""
    made = folder(tmp_path, "here", KINDS[kind])
    paths, finders = [*sys.path], [*sys.meta_path]
    assert length(factory(made)) == 2.0
    assert (sys.path, sys.meta_path) == (paths, finders)
    assert not {name.partition(".")[0] for name in sys.modules} & {"sizes", "more", "parts"}
    assert not list(made.rglob("__pycache__"))


@each("kind", ["lazy-module", "package", "folder"])
def test_travelling(tmp_path, kind):
    """To where the files are not: the same problem, by its content."""
    made = folder(tmp_path, "here", KINDS[kind])
    carried = portable(factory(made))
    content = factory(made).load().content
    made.rename(tmp_path / "away")
    assert length(carried) == 2.0
    assert carried.load().content == content


@each("kind", ["lazy-module", "package", "folder"])
def test_each_its_own(tmp_path, kind):
    """Two problems whose modules have the same names."""
    for name, size in (("a", "2.0"), ("b", "3.0")):
        files = {file: text.replace("2.0", size) for file, text in KINDS[kind].items()}
        assert length(factory(folder(tmp_path, name, files))) == float(size)


@each("kind", ["lazy-module", "package", "folder"])
def test_file_times_do_not_matter(tmp_path, monkeypatch, kind):
    """A text of the same length and time as one before it; Python's bytecode would be stale."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    found = []
    for size in ("2.0", "3.0"):
        files = {file: text.replace("2.0", size) for file, text in KINDS[kind].items()}
        made = folder(tmp_path, "here", files)
        (made / "mine.py").write_text(MINE.replace("[LENGTH,", f"[LENGTH + 0 * {size},"))
        for file in made.rglob("*.py"):
            os.utime(file, (1e9, 1e9))
        found.append(length(replace(factory(made), spelled=size)))
    assert found == [2.0, 3.0]


#: What numba compiles and would keep on disk: in the problem's file, beside it, in both.
COMPILED = """\
import numba
import numpy as np
from newmark_cli.problems.python_problem import Definition
from sizes import GRAVITY, drag


@numba.njit(cache=True)
def force(u, v, t):
    return drag(t), -GRAVITY


# Plain, so that nothing else has to be compiled: the march calls the force from Python.
def constraints(u, t):
    return np.array([(u[0] * u[0] + u[1] * u[1] - 1) / 2])


def gradient(u, t):
    return u.copy().reshape(-1, 1)


def swing():
    u0, v0 = np.array([1.0, 0.0]), np.zeros(2)
    return Definition(np.eye(2), u0, v0, force, constraints, gradient, quadratic=True)
"""


KEPT = "measure: trajectory\ntrajectory: {at: 0.1}\n"


def test_machine_code_is_not_kept(cli):
    """Numba's own cache goes by file times and by no imports; each process compiles anew."""
    sizes = "import numba\nGRAVITY = 1.0\n@numba.njit(cache=True)\ndef drag(t):\n    return 0 * t\n"
    cli.write("mine.py", COMPILED)
    cli.write("sizes.py", sizes)
    study = STUDY.replace("h: 0.1\nt_end: 1.0", "h: 0.01\nt_end: 0.1")
    cli.write("mine.yaml", study[: study.index("expect")] + KEPT)
    multipliers = []
    for gravity in ("1.0", "9.0"):
        cli.write("sizes.py", sizes.replace("1.0", gravity))
        cli("run", "mine.yaml", "--allow-code", "--force", "--jobs", 1)
        with (cli.folder / "results/trajectory/mine.csv").open() as file:
            multipliers.append(float(next(csv.DictReader(file))["lambda[1]"]))
    # From rest it goes by the square of gravity.
    assert multipliers[1] / multipliers[0] == pytest.approx(81, rel=0.01)
    assert not list(cli.folder.rglob("__pycache__"))


def test_python_and_what_is_installed_go_first(tmp_path):
    """Others rely on them, and a process may have imported them already, or not."""
    names = ("colorsys", "queue", "yaml", "newmark_cli")
    files = {"sizes.py": f"import {', '.join(names)}\nLENGTH = 6 * colorsys.ONE_THIRD\n"}
    files |= {f"{name}.py": "1 / 0\n" for name in names}
    sys.modules.pop("colorsys", None)
    assert length(factory(folder(tmp_path, "here", files))) == 2.0


def test_string_annotations(tmp_path):
    """Dataclasses of a file with annotations that are evaluated late."""
    made = folder(tmp_path, "here", {"sizes.py": "LENGTH = 2.0\n"})
    text = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    text += f"@dataclass\nclass Size:\n    length: float = 1.0\n{MINE}"
    (made / "mine.py").write_text(text)
    assert length(factory(made)) == 2.0


@each(
    "sizes, words",
    [
        ({}, "mine.py, line 5: ModuleNotFoundError: No module named 'sizes'"),
        ({"sizes.py": "LENGTH =\n"}, "mine.py, line 5: sizes.py, line 1: SyntaxError"),
        ({"sizes.py": "\n\nLENGTH = 1 / 0\n"}, "line 5: sizes.py, line 3: ZeroDivisionError"),
        ({"sizes.py": "from a.b import c\n", "a/b.py": "1 / 0"}, "a/b.py, line 1: ZeroDivision"),
        ({"sizes.py": "raise SystemExit(0)\n"}, "sizes.py, line 1: SystemExit: 0"),
        ({"sizes.py": "raise GeneratorExit\n"}, "sizes.py, line 1: GeneratorExit"),
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


def matrix(u, v, t):
    return np.linalg.solve((t < 0.5) * np.eye(2), np.array([0.0, -1.0]))


@numba.njit
def compiled(u, v, t):
    if t > 0.5:
        raise ValueError("no more")
    return np.array([0.0, -1.0])


@numba.njit
def implicit(u, v, t):
    return np.array([0.0, -1.0 / (1.0 if t < 0.5 else 0.0)])


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
    forces = ["plain", "beside", "matrix", "compiled", "implicit"]
    cases = [f'  - problem: {{python: "own/mine.py:swing", args: {{force: {f}}}}}' for f in forces]
    cli.write(
        "mine.yaml",
        "study: mine\nform: u-lambda\npreconditioning: [none, optimal]\nh: 0.1\nt_end: 1.0\n"
        "cases:\n" + "\n".join(cases),
    )
    done = cli("run", "mine.yaml", "--allow-code", "-q", "--jobs", 1, code=1)
    first, *others = done.stderr.splitlines()
    said = f"newmark-study: mine: 2 of {2 * len(forces)} cells "
    start = f"{said}failed: own/mine.py, line 9: KeyError: 'no\\nmoreno"
    assert first.startswith(start)
    assert first.endswith("…")
    assert len(first) == len(f"{said}failed: ") + 300
    expected = [
        f"{said}failed: own/parts/one.py, line 4: ZeroDivisionError: float division by zero",
        f"{said}ended with status singular: own/mine.py, line 18: LinAlgError: Singular matrix",
        f"{said}failed: own/mine.py, line 24: ValueError: no more",
        f"{said}failed: mine.py:swing(force=implicit): ZeroDivisionError: division by zero",
    ]
    assert others == expected


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
    """A module that hangs where it is imported, and forces in Python that do."""
    cli.write("mine.py", "import time\ntime.sleep(120)\n")
    cli.write("slow.yaml", STUDY)
    cli.write("forced.yaml", STUDY.replace('{python: "mine.py:swing"}', "mechanism.yaml"))
    cli.write(
        "mechanism.yaml",
        "points: {O: {fixed: [0, 0]}, P: {at: [1, 0], mass: 1}}\n"
        "bars: {rod: {from: O, to: P, length: 1}}\n"
        'python_forces: {air: {python: "mine.py:pull", on: [P]}}\n',
    )
    for study in ("slow.yaml", "forced.yaml"):
        line = cli.refused("run", study, "--allow-code", "--timeout", "0.5")
        assert line.endswith("cannot be loaded: took longer than 0.5 s")
    with pytest.raises(newmark.NewmarkError, match=r"cannot be loaded: took longer than 0\.5 s$"):
        newmark.run(str(cli.folder / "slow.yaml"), allow_code=True, timeout=0.5)
