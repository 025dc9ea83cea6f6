"""Files of the size that is allowed take bounded memory and time, whatever they say."""

import os
import subprocess

from command_line import SCRIPT
from conftest import QUICK

#: Most memory beyond that of a small config (bytes).
MOST = 300e6
TEXT = "z" * 300_000


def validated(folder, *texts):
    """Lines on stderr, and peak memory (bytes), of `validate` of files 1.yaml, 2.yaml, …"""
    names = [f"{number}.yaml" for number in range(1, 1 + len(texts))]
    for name, text in zip(names, texts, strict=True):
        (folder / name).write_text(text)
    with (folder / "errors").open("w+") as errors:
        process = subprocess.Popen([SCRIPT, "validate", *names], cwd=folder, stderr=errors)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        lines = errors.read().splitlines()
    assert process.returncode == (2 if lines else 0)
    return lines, 1024 * used.ru_maxrss


def flow(items):
    return "{" + ", ".join(items) + "}"


def test_memory_of_mistakes(tmp_path):
    """Long texts that are referred to often, in messages and in what pydantic keeps."""
    least = validated(tmp_path, QUICK)[1]
    lines, most = validated(
        tmp_path,
        f"title: &t {TEXT}\npoints: {{P: {{fixed: [0, 0]}}}}\nbars: "
        + flow(f"b{i}: {{from: *t, to: *t, length: 1}}" for i in range(900)),
        f"cases:\n  - &c {flow(f'k{i}: &a{i} {TEXT[:30_000]}' for i in range(30))}\n"
        + "  - *c\n" * 490,
    )
    for place in ("1.yaml, line 1", "2.yaml, line 2"):
        said = f"newmark-study: {place}: more than 4000000 characters with what aliases stand for"
        assert said in lines
    assert most - least < MOST
    assert len(lines) <= 2 * 51
