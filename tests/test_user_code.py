"""Python problems that import modules beside their file: what runs is what the files say."""

import os
import sys
from dataclasses import replace

import pytest
from conftest import SWING

from newmark_cli.problems.problem import ProblemError
from newmark_cli.problems.spec import PythonFactory, pinned, portable

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
    "module": {"sizes.py": "LENGTH = 2.0\n"},
    "module-of-modules": {"sizes.py": "from more import LENGTH\n", "more.py": "LENGTH = 2.0\n"},
    "package": {"sizes/__init__.py": "from .one import LENGTH\n", "sizes/one.py": "LENGTH = 2.0\n"},
    "folder": {
        "sizes.py": "from parts.one import LENGTH\n",
        "parts/one.py": "from parts import two\nLENGTH = two.LENGTH\n",
        "parts/two.py": "LENGTH = 2.0\n",
        "parts/three.py": "what is not imported may be broken\n",
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_imports(tmp_path, kind):
    """From beside the file, whatever the current folder; nothing is left behind."""
    made = folder(tmp_path, "here", KINDS[kind])
    paths, finders = [*sys.path], [*sys.meta_path]
    assert length(factory(made)) == 2.0
    assert (sys.path, sys.meta_path) == (paths, finders)
    assert not {name.partition(".")[0] for name in sys.modules} & {"sizes", "more", "parts"}
    assert not list(made.rglob("__pycache__"))


@pytest.mark.parametrize("kind", KINDS)
def test_travelling(tmp_path, kind):
    """To where the files are not: the same problem, by its content."""
    made = folder(tmp_path, "here", KINDS[kind])
    carried = portable(factory(made))
    content = factory(made).load().content
    made.rename(tmp_path / "away")
    assert length(carried) == 2.0
    assert carried.load().content == content


def test_each_its_own(tmp_path):
    """Two problems whose modules have the same names."""
    for name, size in (("a", 2.0), ("b", 3.0)):
        assert length(factory(folder(tmp_path, name, {"sizes.py": f"LENGTH = {size}\n"}))) == size


def test_file_times_do_not_matter(tmp_path):
    """A text of the same length and time as one before it; Python's bytecode would be stale."""
    made = folder(tmp_path, "here", KINDS["module"])
    found = []
    for size in ("2.0", "3.0"):
        (made / "sizes.py").write_text(f"LENGTH = {size}\n")
        (made / "mine.py").write_text(MINE.replace("[LENGTH,", f"[LENGTH + 0 * {size},"))
        for file in made.glob("*.py"):
            os.utime(file, (1e9, 1e9))
        found.append(length(replace(factory(made), spelled=size)))
    assert found == [2.0, 3.0]


def test_a_folder_hides_no_module(tmp_path):
    """A folder beside the file that happens to have the name of a library."""
    made = folder(tmp_path, "here", {"sizes.py": "import this_is_none as _\n"})
    (made / "colorsys").mkdir()
    sys.modules.pop("colorsys", None)
    (made / "sizes.py").write_text(
        "import colorsys\nLENGTH = 2 * colorsys.ONE_THIRD / colorsys.ONE_THIRD\n"
    )
    assert length(factory(made)) == 2.0


def test_string_annotations(tmp_path):
    """Dataclasses of a file with annotations that are evaluated late."""
    made = folder(tmp_path, "here", {"sizes.py": "LENGTH = 2.0\n"})
    text = "from __future__ import annotations\nfrom dataclasses import dataclass\n"
    text += f"@dataclass\nclass Size:\n    length: float = 1.0\n{MINE}"
    (made / "mine.py").write_text(text)
    assert length(factory(made)) == 2.0


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ({}, "line 5: ModuleNotFoundError: No module named 'sizes'"),
        ({"sizes.py": "LENGTH =\n"}, "line 5: SyntaxError: invalid syntax (sizes.py, line 1)"),
        ({"sizes.py": "LENGTH = 1 / 0\n"}, "line 5: ZeroDivisionError"),
        ({"sizes.py": "LENGTH = 2.0\n", "mine.py": "\0"}, "null bytes"),
    ],
)
def test_mistakes(tmp_path, sizes, words):
    """The line of the problem's own file that imports what cannot be imported."""
    with pytest.raises(ProblemError) as caught:
        factory(folder(tmp_path, "here", sizes)).load()
    assert "mine.py" in str(caught.value)
    assert words in str(caught.value)


def test_pinned(tmp_path):
    """Another process does not take a problem whose file or import has changed."""
    made = folder(tmp_path, "here", KINDS["module"])
    sent = pinned(factory(made))
    assert (sent.label, sent.given) == (factory(made).label, factory(made).given)
    assert length(sent) == 2.0
    (made / "sizes.py").write_text("LENGTH = 3.0\n")
    for spec in (replace(sent, spelled="m"), portable(sent)):
        with pytest.raises(ProblemError, match="has changed since the run began"):
            spec.load()


def test_a_problem_that_changes_in_mid_run(cli):
    """The run ends in one line; what it had read at first is not what its processes would."""
    cli.write("sizes.py", "LENGTH = 2.0\n")
    grows = 'with open(__file__, "a") as file:\n    file.write("#")\n'
    cli.write("mine.py", grows + MINE)
    cli.write(
        "mine.yaml",
        'study: mine\nproblem: {python: "mine.py:swing"}\nform: u-lambda\n'
        "preconditioning: none\nh: 0.1\nt_end: 1.0\n",
    )
    said = cli.refused("run", "mine.yaml", "--allow-code")
    assert said.endswith("mine.py:swing: has changed since the run began")
    cli.write("mine.py", MINE)
    assert "1 ok" in cli("run", "mine.yaml", "--allow-code").stdout
