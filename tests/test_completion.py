"""Completion in shells, through the console script and the protocol of click."""

import json
import os
import re

import pytest
from each import each
from warm import SCRIPT

from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.newmark.scaling import VARIANTS
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config


@pytest.fixture
def complete(tmp_path, warm):
    """Offered for a line that ends at the cursor, in a folder with a few files."""
    for name in ("mine.yaml", "other.yml", "notes.txt", ".hidden.yaml", "more/own.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()

    def run(line, shell="bash"):
        words = line.split(" ")
        if shell == "fish":
            variables = {"COMP_WORDS": line, "COMP_CWORD": words[-1]}
        else:
            variables = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
        asked = {**variables, "_NEWMARK_STUDY_COMPLETE": f"{shell}_complete"}
        run = warm.start([SCRIPT], tmp_path, env=os.environ | asked)
        output, errors = run.communicate(timeout=60)
        assert (run.returncode, errors) == (0, "")
        return output

    return run


def offered(text):
    """Words that bash is given."""
    return [line.removeprefix("plain,") for line in text.splitlines()]


@each(
    "line, words",
    [
        ("newmark-study val", ["validate"]),
        ("newmark-study run ", [*config.shipped(), "mine.yaml", "other.yml"]),
        ("newmark-study run pendulum-u mi", ["mine.yaml"]),
        ("newmark-study run more/", ["more/own.yaml"]),
        ("newmark-study run .h", [".hidden.yaml"]),
        ("newmark-study validate ", ["mine.yaml", "other.yml"]),
        ("newmark-study plot ", list(dict.fromkeys((*FIGURES, *config.shipped())))),
        ("newmark-study plot 1 sens", ["sensitivity"]),
        ("newmark-study draw ", [*PROBLEMS, "mine.yaml", "other.yml"]),
        ("newmark-study orders --preconditioning ", list(VARIANTS)),
        ("newmark-study orders --config pendulum-a", ["pendulum-a"]),
        ("newmark-study schema ", ["config", "mechanism", "spatial"]),
    ],
)
def test_arguments(complete, line, words):
    """Names from the registries, and YAML files."""
    assert offered(complete(line)) == words


@each("shell", ["zsh", "fish"])
def test_other_shells_show_what_a_name_means(complete, shell):
    """With the text of `list`."""
    text = complete("newmark-study run pendulum-v", shell)
    assert "pendulum-v" in text
    assert config.load_shipped("pendulum-v").description in text


def test_list_as_json(cli):
    """The same names and texts as `list` prints."""
    found = json.loads(cli("list", "--json").stdout)
    text = cli("list").stdout
    for section, entries in found.items():
        assert re.search(rf"^{re.escape(section)}\b.*:$", text, re.MULTILINE), section
        for name, words in entries.items():
            line = rf"^  {re.escape(name)} *{re.escape(words)}$"
            assert re.search(line, text, re.MULTILINE), name
