"""docs/spatial.md: its example, its tables of joints, and what it says of the shipped study."""

import re
import shutil
from pathlib import Path

from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spatial_model import SpatialMechanism

ROOT = Path(__file__).parents[1]
DOCS = (ROOT / "docs/spatial.md").read_text(encoding="utf-8")


def printed(command):
    """What the page says that a command prints."""
    begin = DOCS.index(f"    $ {command}\n") + len(command) + 7
    return "".join(line[4:] + "\n" for line in DOCS[begin:].split("\n\n")[0].split("\n"))


def test_validate_prints_what_the_page_says(cli):
    """Coordinates, freedoms and inertia of the worked example."""
    shutil.copytree(ROOT / "docs/examples", cli.folder / "docs/examples")
    command = "newmark-study validate docs/examples/space-linkage.yaml"
    assert cli(*command.split()[1:]).stdout == printed(command)


def test_check_says_what_the_page_says(cli):
    """Six errors of the worked example fall with h²."""
    shutil.copytree(ROOT / "docs/examples", cli.folder / "docs/examples")
    cli("run", "docs/examples/space-study.yaml")
    assert cli("check", "space").stdout.splitlines()[-1] == printed(
        "newmark-study check space"
    ).rstrip("\n")


def test_tables_name_every_joint_and_key():
    """With the rows of each joint, in their order."""
    rows = dict(re.findall(r"^\| `([a-z-]+)` \| ([a-zA-Z0-9, ]+) \| ", DOCS, re.M))
    assert {name: ", ".join(joint.rows) for name, joint in JOINTS.items()} == {
        name: rows[name] for name in JOINTS
    }
    allowed = SpatialMechanism.keys()
    for key in allowed:
        if key not in ("title", "description", "source", "gravity"):
            assert f"`{key}" in DOCS, key
    for name in ("heavy-top", "bricard", "governor", "spatial-slider-crank"):
        assert name in PROBLEMS
        assert f"`{name}`" in DOCS


def test_slopes_of_the_shipped_study_are_those_of_the_page(cli):
    """The number of slopes, from the committed results."""
    for file in ("spatial.csv", "spatial.json"):
        (cli.folder / "results").mkdir(exist_ok=True)
        shutil.copy(ROOT / "results" / file, cli.folder / "results")
    said = re.search(r"all (\d+) slopes are as predicted", DOCS)[1]
    assert (
        cli("check", "spatial").stdout.splitlines()[-1] == f"{said} of {said} slopes as predicted"
    )
