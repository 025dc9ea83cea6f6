"""Damaged configs, mechanism files and results: what reads them stays calm."""

from pathlib import Path

from each import each

FOLDER = Path(__file__).parents[1] / "tests/verification"


@each("script, inputs", [("fuzz", 30), ("fuzz_results", 10)])
def test_readers_stay_calm(warm, tmp_path, script, inputs):
    """Some inputs of the fuzzers: documented exit codes, lines for complaints, no code run."""
    arguments = [FOLDER / f"{script}.py", inputs, "--seed", 20, "--processes", 0]
    run = warm.start(arguments, tmp_path)
    told, errors = run.communicate(timeout=180)
    assert run.returncode == 0, told + errors
    assert told.startswith(f"{inputs} inputs")
    assert "findings: 0" in told
    if script == "fuzz":
        assert "Python files loaded: 0" in told
