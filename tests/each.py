"""Cases of a test: `pytest.mark.parametrize` under a short name."""

import pytest


def each(names, cases):
    """One test for each case, which may come from a generator."""
    return pytest.mark.parametrize(names, [*cases])
