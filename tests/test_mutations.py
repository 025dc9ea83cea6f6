"""The faults that `tests/verification/mutations.py` puts into the code."""

import importlib.util
from pathlib import Path

TESTS = Path(__file__).parent
SCRIPT = TESTS / "verification/mutations.py"


def test_every_mutation_finds_its_place_and_its_tests():
    """Running them takes hours; what the code calls otherwise would be found out only then."""
    spec = importlib.util.spec_from_file_location("mutations", SCRIPT)
    mutations = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(mutations)
    found = mutations.everything()
    assert len(found) > 400
    for mutation in found:
        assert mutation.old != mutation.new, mutation.name
        file, *chosen = mutation.tests
        text = (TESTS.parent / file).read_text()
        if chosen and chosen[0] == "-k" and " " not in chosen[1]:
            assert any(chosen[1] in line for line in text.splitlines() if "def test_" in line)
