"""Damaged configs and mechanism files: `validate` stays calm."""

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "tests/verification/fuzz.py"


def test_validate_stays_calm():
    """A hundred inputs of the fuzzer: code 0 or 2, complaints by line, at once, no code run."""
    done = subprocess.run(
        [sys.executable, SCRIPT, "100", "--seed", "20"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("100 inputs")
    assert "Python files loaded: 0" in done.stdout
    assert "findings: 0" in done.stdout


def test_readers_of_results_stay_calm():
    """Some results folders of the fuzzer: documented exit codes, at once, nothing else touched."""
    script = SCRIPT.with_name("fuzz_results.py")
    done = subprocess.run(
        [sys.executable, script, "24", "--seed", "20"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("24 inputs")
    assert "findings: 0" in done.stdout
