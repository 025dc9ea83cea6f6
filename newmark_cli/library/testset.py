"""The test set: what each member is, and its files for those who use another language."""

import csv
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from newmark_cli.library.judging import template
from newmark_cli.mechanisms import registry
from newmark_cli.support import documents, files
from newmark_cli.support.errors import InputError

_DATA = registry.TESTSET_FOLDER.with_suffix(".yaml")
#: What reference values state errors of.
PARTS = ("u", "v", "lambda")


@dataclass(frozen=True)
class Member:
    """A mechanism of the test set, or one of the project's own problems.

    Attributes:
        name: As configs name it.
        title: Of the mechanism.
        description: What it is made of.
        n: Coordinates.
        m: Constraints.
        tests: What makes integrators fail there; empty for the project's own problems.
        source: Where the mechanism comes from.
        t_end: Time to which it is meant to run (s); None for the project's own.
        times: Times of the reference values (s).
        errors: u, v, lambda → the largest stated error of the reference values, relative.
        second: How these values were confirmed.
        published: What others have published, and how well it agrees.
    """

    name: str
    title: str
    description: str
    n: int
    m: int
    source: str
    tests: str = ""
    t_end: float | None = None
    times: tuple[float, ...] = ()
    errors: dict[str, float] | None = None
    second: str = ""
    published: str = ""

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates less constraints; redundant rows do not count."""
        return self.n - self.m


@cache
def member(name: str) -> Member:
    """The member, or the project's own problem, of a name; nothing is built."""
    data = documents.read(registry.file(name)).data
    source = data.get("source", "this project")
    about = name, data["title"], data["description"], *registry.size(data), source
    if name not in registry.TESTSET:
        return Member(*about)
    rows = references(name)
    said = documents.read(_DATA).data[name]
    return Member(
        *about,
        said["tests"],
        float(said["t_end"]),
        tuple(float(row["t"]) for row in rows),
        {part: max(float(row[f"error[{part}]"]) for row in rows) for part in PARTS},
        said["second"],
        said["published"],
    )


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
