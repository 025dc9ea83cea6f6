"""The public library: its names, its docstrings, and what importing it takes."""

import doctest
import re
from pathlib import Path

import pytest
from each import each

import newmark_cli as newmark

PUBLIC = [name for name in newmark.__all__ if name != "__version__"]


@each("name", PUBLIC)
def test_examples_of_docstrings_are_true(name):
    """Every public name has a docstring with an example, which prints what it says."""
    subject = getattr(newmark, name)
    tests = [test for test in doctest.DocTestFinder().find(subject, name) if test.examples]
    assert any(test.name == name for test in tests), "no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in tests:
        assert runner.run(test).failed == 0


DOCS = Path(__file__).parents[1] / "docs/python.md"


def test_the_code_of_the_docs_runs(capsys):
    """Every block of docs/python.md, from the first to the last."""
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(DOCS), "exec"), names)
    assert len(blocks) == 7
    assert names["later"].t[-1] == pytest.approx(5.0)
    assert names["factors"].right["lambda"] == pytest.approx(1 / (0.3025 * 1e-6))
    assert names["swing"].m == 1
    assert names["kept"]["t"].round(9).tolist() == [0.01, 0.02, 0.03] * 4


def test_the_docs_name_all_that_is_public():
    """And the README leads to them."""
    text = DOCS.read_text(encoding="utf-8")
    for name in PUBLIC:
        assert re.search(rf"`{name}\b", text), name
    readme = (DOCS.parents[1] / "README.md").read_text(encoding="utf-8")
    assert "import newmark_cli as newmark" in readme
    assert "docs/python.md" in readme


def test_nothing_public_is_said_to_be_private():
    """What `dir` shows includes `__all__`, in order, each name from the module that it names."""
    assert sorted(newmark.__all__) == [*newmark.__all__]
    assert set(newmark.__all__) <= set(dir(newmark))
    assert set(newmark._HOMES) == set(PUBLIC)
