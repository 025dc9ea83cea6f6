"""Files of the size that is allowed take bounded memory and time, whatever they say."""

import os
import subprocess

import pytest
from command_line import SCRIPT

#: Most memory beyond that of a small config (bytes).
MOST = 300e6
SMALL = """\
study: small
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 1
expect: [{measure: correction, at_least: 1.0e-99}]
"""
TEXT = "z" * 300_000


def validated(folder, text):
    """Lines on stderr, and peak memory (bytes), of `validate`."""
    (folder / "given.yaml").write_text(text)
    with (folder / "errors").open("w+") as errors:
        process = subprocess.Popen(
            [SCRIPT, "validate", "given.yaml"], cwd=folder, stdout=subprocess.DEVNULL, stderr=errors
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        lines = errors.read().splitlines()
    assert process.returncode == (2 if lines else 0)
    return lines, 1024 * used.ru_maxrss


def flow(items):
    return "{" + ", ".join(items) + "}"


@pytest.fixture(scope="module")
def least(tmp_path_factory):
    """Peak memory (bytes) that a small config takes."""
    return validated(tmp_path_factory.mktemp("small"), SMALL)[1]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            f"title: &t {TEXT}\npoints: {{P: {{fixed: [0, 0]}}}}\nbars: "
            + flow(f"b{i}: {{from: *t, to: *t, length: 1}}" for i in range(9_000)),
            "given.yaml, line 1: more than 4000000 characters with what aliases stand for",
        ),
        (
            f"cases:\n  - &c {flow(f'k{i}: &a{i} {TEXT[:30_000]}' for i in range(99))}\n"
            + "  - *c\n" * 490,
            "given.yaml, line 2: more than 4000000 characters with what aliases stand for",
        ),
    ],
)
def test_memory_of_mistakes(tmp_path, least, text, line):
    """Long texts that are referred to often, in messages and in what pydantic keeps."""
    lines, most = validated(tmp_path, text)
    assert f"newmark-study: {line}" in lines
    assert most - least < MOST
    assert len(lines) <= 51
