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


#: What the cases of the next test have seen.
seen = []


@each("outer", "ab")
@each("number", range(3))
def test_folders_and_patches_are_those_of_a_case(outer, number, tmp_path, cli, monkeypatch):
    """No case finds what another has left, in files or in modules."""
    assert cli.folder == tmp_path
    assert tmp_path not in seen
    assert not list(tmp_path.iterdir())
    cli.write("left", "")
    assert not hasattr(seen_by_all, "patched")
    monkeypatch.setattr(seen_by_all, "patched", number, raising=False)
    seen.append(tmp_path)


def seen_by_all():
    """Something that a test may patch."""


def test_other_fixtures_are_shared(committed_folder):
    """They are handed on as they are."""
    given = []
    each("one", [1, 2])(lambda one, committed_folder: given.append(committed_folder))(
        committed_folder=committed_folder
    )
    assert given == [committed_folder] * 2
    assert not hasattr(seen_by_all, "patched")
