"""Files of the size that is allowed take bounded memory and time, whatever they say."""

import os
import subprocess
import time

import pytest
from warm import SCRIPT

#: Most memory beyond that of a small config (bytes).
MOST = 300e6
SMALL = """\
study: small
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 1
"""
TEXT = "z" * 300_000


def validated(folder, text):
    """Lines on stderr, peak memory (bytes) and processor time (s) of `validate`."""
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
    return lines, 1024 * used.ru_maxrss, used.ru_utime + used.ru_stime


def flow(items):
    return "{" + ", ".join(items) + "}"


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
        (
            "points: " + flow(f"P{i}: {'q' * 300}" for i in range(9_000)),
            "given.yaml, line 1: bars: missing",
        ),
    ],
    ids=["names", "cases", "points"],
)
def test_memory_of_mistakes(tmp_path, text, line):
    """Long texts that are referred to often, in messages and in what pydantic keeps."""
    _, least, _ = validated(tmp_path, SMALL)
    lines, most, _ = validated(tmp_path, text)
    assert f"newmark-study: {line}" in lines or "bars" in line
    assert most - least < MOST
    assert len(lines) <= 51


def test_mistakes_that_nobody_reads_are_not_looked_for(tmp_path):
    """99 cases with 990 mistakes each: about as fast as one of them, and the line says so."""
    names = ", ".join(f"y{i}" for i in range(990))
    case = "  - {form: q, h: 1, problem: *p}\n"
    text = f"study: many\npreconditioning: none\nsteps: 1\nproblem: &p [{names}]\ncases:\n"
    _, _, one = validated(tmp_path, text + case)
    lines, _, many = validated(tmp_path, text + 99 * case)
    assert len(lines) == 51
    assert lines[-1].startswith("newmark-study: given.yaml: … and at least ")
    assert many < 4 * one


def test_grids_are_compared_quickly(tmp_path):
    """499 cases of 40 step sizes, each pair of which could have a cell in common."""
    from newmark_cli.study import config

    def text(cases):
        sizes = (
            ", ".join(repr(0.1 + (40 * i + j) * 1e-6) for j in range(40)) for i in range(cases)
        )
        head = SMALL.replace("h: 0.1\n", "").replace("steps: 1", "steps: 1\ncases:")
        return head + "".join(f"  - {{h: [{each}]}}\n" for each in sizes)

    (tmp_path / "grid.yaml").write_text(text(499))
    begin = time.process_time()
    study = config.load(tmp_path / "grid.yaml")
    assert time.process_time() - begin < 20
    assert study.count == 499 * 40
    (tmp_path / "grid.yaml").write_text(text(3) + "  - {h: [0.5, 0.100041]}\n")
    with pytest.raises(config.DocumentError, match=r"two cases have pendulum.*h = 0.100041"):
        config.load(tmp_path / "grid.yaml")
