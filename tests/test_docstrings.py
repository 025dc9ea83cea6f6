"""The public library: its names, its docstrings, and what importing it takes."""

import doctest
import inspect
import subprocess
import sys

import pytest

import newmark_cli as newmark

PUBLIC = [name for name in newmark.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_of_docstrings_are_true(name):
    """Every public name has a docstring with an example, which prints what it says."""
    subject = getattr(newmark, name)
    tests = [test for test in doctest.DocTestFinder().find(subject, name) if test.examples]
    assert any(test.name == name for test in tests), "no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in tests:
        assert runner.run(test).failed == 0
