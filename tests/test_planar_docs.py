"""docs/planar.md: its example, and its tables of parts and of laws."""

import re
import shutil
from pathlib import Path

from newmark_cli.mechanisms.models import Law, Mechanism, Table
from newmark_cli.mechanisms.planar import Builder

ROOT = Path(__file__).parents[1]
DOCS = (ROOT / "docs/planar.md").read_text(encoding="utf-8")


def printed(command):
    """What the page says that a command prints."""
    begin = DOCS.index(f"    $ {command}\n") + len(command) + 7
    return "".join(line[4:] + "\n" for line in DOCS[begin:].split("\n\n")[0].split("\n"))


def test_the_example_prints_what_the_page_says(cli):
    """`validate` counts 14 coordinates; `check` finds every slope as predicted."""
    shutil.copytree(ROOT / "docs/examples", cli.folder / "docs/examples")
    command = "newmark-study validate docs/examples/shaper.yaml"
    assert cli(*command.split()[1:]).stdout == printed(command)
    cli("run", "docs/examples/shaper-study.yaml")
    assert cli("check", "shaper").stdout.splitlines()[-1] == printed(
        "newmark-study check shaper"
    ).rstrip("\n")


def test_the_page_quotes_the_example():
    """Its lines stand in the file."""
    example = (ROOT / "docs/examples/shaper.yaml").read_text(encoding="utf-8")
    quoted = DOCS[DOCS.index("    bodies:\n") :].split("\n\n")[0].splitlines()
    assert len(quoted) > 15
    for line in quoted:
        assert line[4:] in example or "…" in line, line


def test_tables_name_every_part_and_law():
    """Each part with its equation, each key of a law and of a table."""
    rows = re.findall(r"^\| `([a-z_]+)` \| .+ \|$", DOCS, re.M)
    parts = set(Builder.parts) - {"points", "body_points", "bodies"}
    assert parts <= set(rows)
    assert parts <= Mechanism.model_fields.keys()
    for model in (Law, Table):
        for key in model.model_fields:
            assert f"`{key}`" in DOCS or f"{key}`" in DOCS or f", {key}" in DOCS, key
