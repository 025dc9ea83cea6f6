"""Files of the size that is allowed take bounded memory and time, whatever they say."""

import os
import subprocess

import pytest
from command_line import SCRIPT
from each import each

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


@each(
    "text, line",
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
)
def test_memory_of_mistakes(tmp_path, least, text, line):
    """Long texts that are referred to often, in messages and in what pydantic keeps."""
    lines, most = validated(tmp_path, text)
    assert f"newmark-study: {line}" in lines or "bars" in line
    assert most - least < MOST
    assert len(lines) <= 51


def test_cells_of_many_cases_are_compared(tmp_path):
    """250 cases of 40 step sizes, each pair of which could have a cell in common."""
    from newmark_cli.study import config

    def text(cases):
        sizes = (
            ", ".join(repr(0.1 + (40 * i + j) * 1e-6) for j in range(40)) for i in range(cases)
        )
        head = SMALL.replace("h: 0.1\n", "")
        return head + "cases:\n" + "".join(f"  - {{h: [{each}]}}\n" for each in sizes)

    (tmp_path / "grid.yaml").write_text(text(250))
    study = config.load(tmp_path / "grid.yaml")
    assert study.count == 250 * 40
    (tmp_path / "grid.yaml").write_text(text(3) + "  - {h: [0.5, 0.100041]}\n")
    with pytest.raises(config.DocumentError, match=r"two cases have pendulum.*h = 0.100041"):
        config.load(tmp_path / "grid.yaml")


HISTORY = """\
study: long
problem: {chain: {links: 1000}}
form: [u-lambda, v-lambda]
preconditioning: optimal
h: [1e-5, 2e-5]
t_end: 0.1
measure: [trajectory, condition]
trajectory: {keep: lambda}
"""


def test_histories_that_no_memory_holds_are_refused(cli):
    """By file, line and key, before anything runs: with what it would be and what is allowed."""
    cli.write("long.yaml", HISTORY)
    line = cli.refused("run", "long.yaml")
    # 10000 steps, 5000 steps and two starts, 1000 links, step and time, two forms.
    assert line == (
        "newmark-study: long.yaml, line 8: trajectory: trajectory of 30064008 numbers in all "
        "cases, at most 5000000; keep fewer steps, or less of each"
    )
    assert not (cli.folder / "results").exists()
    cli.write("long.yaml", HISTORY.replace("{keep", "{every: 7, keep"))
    assert cli("validate", "long.yaml").stdout == "long.yaml: study long, 4 cells\n"
    cli.write("long.yaml", HISTORY.replace("{keep", "{every: 6, keep"))
    assert "trajectory of 5016012 numbers" in cli.refused("validate", "long.yaml")
