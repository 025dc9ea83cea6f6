"""Cases that are tried together."""

import pytest
from each import each


def test_every_case_is_tried_and_each_failure_named():
    """One that fails keeps no other from being tried, however the cases are nested."""
    tried = []

    @each("one", [1, 2])
    @each("two, three", [(1.5, "a"), (2.5, each)])
    def case(one, two, three, fixture):
        tried.append((one, two, three, fixture))
        assert two < 2 or one < 2

    with pytest.raises(ExceptionGroup, match=r"^1 of 2: case 2") as caught:
        case(fixture="given")
    assert tried == [(i, *two, "given") for i in (1, 2) for two in ((1.5, "a"), (2.5, each))]
    (inner,) = caught.value.exceptions
    assert inner.message == "1 of 2: case 2.5-each"
    (error,) = inner.exceptions
    assert isinstance(error, AssertionError)


def test_nothing_to_try_is_a_mistake():
    """As is an argument that the test does not take."""
    for names, cases in (("one", []), ("other", [1])):
        with pytest.raises(AssertionError):
            each(names, cases)(lambda one: None)


@each("number", range(3))
def test_fixtures_are_given(number, tmp_path):
    """All cases of a test share them."""
    made = sorted(file.name for file in tmp_path.iterdir())
    assert made == [str(i) for i in range(number)]
    (tmp_path / str(number)).touch()
