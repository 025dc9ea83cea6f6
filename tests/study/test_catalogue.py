"""What `list` says of problems, integrators, scalings and measures, against the code."""

import pytest

from newmark_cli.mechanisms import registry
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.study import catalogue


@pytest.fixture(scope="module")
def sections():
    return catalogue.sections()


def test_sizes_of_shipped_problems_are_those_of_the_built(sections):
    """n and m, and the title and the description of the file."""
    for name in registry.PROBLEMS:
        built = registry.problem(name)
        mechanism = built.drawing
        text = f"{mechanism.title}: {mechanism.description}; n = {built.n}, m = {built.m}"
        assert sections["problems"][name] == text
        assert mechanism.description


@pytest.mark.parametrize("name", FAMILIES)
def test_sizes_of_families_are_those_of_their_members(sections, name):
    family = FAMILIES[name]
    built = family.problem(name, dict.fromkeys(family.parameters, 3))
    *_, n, m = sections["families of problems"][name].replace("; n", ", n").split(", ")
    for formula, count in ((n, built.n), (m, built.m)):
        right = formula.partition("= ")[2]
        for parameter in family.parameters:
            assert parameter in right
            right = right.replace(f" {parameter}", "*3").replace(parameter, "3")
        assert eval(right) == count, formula
