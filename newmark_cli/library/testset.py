"""The test set: what each member is, and its files for those who use another language."""

import csv
import json
from pathlib import Path
from typing import TypedDict

from newmark_cli.library.judging import template
from newmark_cli.mechanisms import registry
from newmark_cli.support import documents, files
from newmark_cli.support.errors import InputError

_DATA = registry.TESTSET_FOLDER.with_suffix(".yaml")
#: What reference values state errors of.
PARTS = ("u", "v", "lambda")


class Member(TypedDict):
    """A mechanism of the test set, or one of the project's own problems."""

    name: str  #: as configs name it
    title: str  #: of the mechanism
    description: str  #: what it is made of
    n: int  #: coordinates
    m: int  #: constraints
    source: str  #: where the mechanism comes from
    tests: str  #: what makes integrators fail there; empty for the project's own problems
    t_end: float | None  #: time to which it is meant to run (s); None for the project's own
    times: list[float]  #: times of the reference values (s)
    #: u, v, lambda → the largest stated error of the reference values, relative
    errors: dict[str, float] | None
    second: str  #: how these values were confirmed
    published: str  #: what others have published, and how well it agrees
    degrees_of_freedom: int  #: coordinates less constraints; redundant rows do not count


def member(name: str) -> Member:
    """The member, or the project's own problem, of a name; nothing is built."""
    data = documents.read(registry.file(name)).data
    n, m = registry.size(data)
    rows = references(name) if name in registry.TESTSET else []
    said = documents.read(_DATA).data.get(name, {})
    worst = {p: max(float(row[f"error[{p}]"]) for row in rows) for p in PARTS} if rows else None
    return {
        "name": name, "title": data["title"], "description": data["description"], "n": n, "m": m,
        "source": data.get("source", "this project"), "tests": said.get("tests", ""),
        "t_end": float(said["t_end"]) if said else None,
        "times": [float(row["t"]) for row in rows], "errors": worst,
        "second": said.get("second", ""), "published": said.get("published", ""),
        "degrees_of_freedom": n - m,
    }  # fmt: skip


def references(name: str) -> list[dict[str, str]]:
    """Rows of the reference values of a member, as text that keeps all digits."""
    with (registry.TESTSET_FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(folder: Path) -> list[Path]:
    """Write the test set: mechanisms as YAML and JSON, templates, references, pins, a README.

    Args:
        folder: Where to; made if it is missing.

    Returns:
        The files.

    Raises:
        InputError: A file of that name is there and says something else; nothing is written.
        ResultsError: A file cannot be written.
    """
    own = registry.TESTSET_FOLDER
    contents = {"README.md": (own / "README.md").read_text(encoding="utf-8")}
    for name in registry.TESTSET:
        path = registry.file(name)
        text = path.read_text(encoding="utf-8")
        # The comment for editors points into the package.
        contents[path.name] = text.partition("\n")[2]
        contents[f"{name}.json"] = json.dumps(documents.read(path).data, indent=1) + "\n"
        contents[f"{name}-template.csv"] = template(registry.problem(name)) + "\n"
        contents[f"{name}-reference.csv"] = (own / f"{name}.csv").read_text(encoding="utf-8")
        if (pins := own / f"{name}-pins.csv").exists():
            contents[pins.name] = pins.read_text(encoding="utf-8")
    written = {folder / name: text for name, text in contents.items()}
    for path, text in written.items():
        if path.is_file() and path.read_bytes() != text.encode():
            raise InputError(
                f"--testset: {path} is not as the test set has it, and is not overwritten; "
                "remove it or name another folder"
            )
    files.make_folder(folder, folder.parent, parents=True)
    files.replace_together(written, folder)
    return list(written)
