"""Covering arrays cover."""

import itertools

from covering import covering
from each import each


@each("strength", [1, 2, 3])
@each("sizes", [(2, 3, 4), (7, 5, 7, 6), (3, 3, 3, 3, 2)])
def test_every_tuple_of_values_meets(sizes, strength):
    """Any values of so many axes are in one of the cases, which are far fewer than all."""
    axes = [[f"{axis}{i}" for i in range(size)] for axis, size in enumerate(sizes)]
    cases = covering(*axes, strength=strength)
    for group in itertools.combinations(range(len(axes)), strength):
        wanted = set(itertools.product(*(axes[axis] for axis in group)))
        assert {tuple(case[axis] for axis in group) for case in cases} == wanted
    assert len(cases) == len(set(cases)) <= len(list(itertools.product(*axes)))
    assert cases == covering(*axes, strength=strength)
