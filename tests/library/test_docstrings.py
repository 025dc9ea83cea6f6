"""The public library: its names, its docstrings, and what importing it takes."""

import doctest

import pytest

import newmark_cli as newmark

PUBLIC = [name for name in newmark.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_of_docstrings_are_true(request, name):
    """Every public name has a docstring with an example, which prints what it says."""
    if name == "Advice":  # its example prints nothing of what is drawn
        request.getfixturevalue("few_draws")
    subject = getattr(newmark, name)
    tests = [test for test in doctest.DocTestFinder().find(subject, name) if test.examples]
    assert any(test.name == name for test in tests), "no example"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    for test in tests:
        assert runner.run(test).failed == 0


def test_nothing_public_is_said_to_be_private():
    """What `dir` shows includes `__all__`, in order, each name from the module that it names."""
    assert sorted(newmark.__all__) == [*newmark.__all__]
    assert set(newmark.__all__) <= set(dir(newmark))
    assert set(newmark._HOMES) == set(PUBLIC)
