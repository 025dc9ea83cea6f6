"""The page and the pictures of the test set, from its data.

python docs/site/testset.py

A new member is a mechanism file, a table of reference values, an entry in `testset.yaml` of the
package, and a study in `benchmarks/testset` that was run; this script then writes its block, its
picture and the figure of its errors.
"""

import io
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from PIL import Image

from newmark_cli.library import testset
from newmark_cli.mechanisms import registry
from newmark_cli.report.drawing import draw, draw_mechanism

DOCS = Path(__file__).parents[1]
PAGE, FIGURES = DOCS / "testset.md", DOCS / "figures"
#: Of the studies `benchmarks/testset/NAME.yaml`.
RESULTS = DOCS.parent / "benchmarks" / "testset" / "results"
#: What stands before the blocks of the members.
_BEGIN = "<!-- members: written by docs/site/testset.py -->\n"
#: Of pictures: inches, dots per inch, colours.
_SIZE, _DPI, _COLOURS = (4.5, 3.0), 110, 32
#: Pixels of a figure of errors, from edge to edge.
_WIDTH = 1000


def page(text: str) -> str:
    """The page with its blocks written anew.

    Args:
        text: The page as it is, whose beginning is written by hand.
    """
    return text.partition(_BEGIN)[0] + _BEGIN + "".join(map(block, registry.TESTSET))


def block(name: str) -> str:
    """The block of a member."""
    return "\n".join(_lines(testset.member(name))) + "\n"


def _lines(member: testset.Member) -> Iterator[str]:
    name, title, errors = member["name"], member["title"], member["errors"] or {}
    size = (
        f"degrees of freedom {member['degrees_of_freedom']}, n = {member['n']}, m = {member['m']}"
    )
    yield f"\n## {name}\n"
    yield f"![{title}, at its start](figures/testset-{name}.png)\n"
    stated = ", ".join(f"{sign} {errors[part]:.0e}" for part, sign in _SIGNS.items())
    for label, text in (
        (title, member["description"]),
        ("Tests", member["tests"]),
        ("Source", member["source"]),
        ("Size", size),
        ("Reference", f"at t = {', '.join(f'{t:g}' for t in member['times'])} s; errors {stated}"),
        ("Confirmed by", member["second"]),
        ("Published", member["published"]),
    ):
        yield f"- **{label}**: {text}."
    row = testset.references(name)[-1]
    yield f"\nValues at t = {float(row['t']):g} s:\n"
    yield "| | u | v |\n| --- | --- | --- |"
    values = {key: f"{float(value):.12g}" for key, value in row.items()}
    for key in values:
        if key.startswith("u["):
            yield f"| `{key[2:-1]}` | {values[key]} | {values['v' + key[1:]]} |"
    rest = [key for key in values if key.startswith(("lambda[", "output["))]
    yield "\n| λ, or output | |\n| --- | --- |"
    for key in rest:
        yield f"| `{key.partition('[')[2][:-1]}` | {values[key]} |"
    yield f"\n![{title}, errors over h](figures/testset-{name}-errors.png)"
    for table in _tables():
        if table.startswith(f"{name}, "):
            yield "\n" + table


@cache
def _tables() -> list[str]:
    """Tables of all studies of members, with their titles for first lines."""
    studies = [f"testset-{name}" for name in registry.TESTSET]
    parts = _told("tables", *studies).split("### ")[1:]
    return [part.partition("\n\n- Entries")[0].strip() for part in parts]


def _told(*words: str) -> str:
    """What a command says about the results."""
    command = [sys.executable, "-m", "newmark_cli", *words, "--results", str(RESULTS)]
    return subprocess.run(command, check=True, capture_output=True, encoding="utf-8").stdout


_SIGNS = {"u": "u", "v": "v", "lambda": "λ"}


def picture(name: str) -> bytes:
    """A small PNG of the mechanism at its start."""
    subject = registry.problem(name)
    sheet = draw_mechanism.mechanism_sheet(testset.member(name)["title"], subject, subject.u0)
    large = io.BytesIO()
    draw.drawn(sheet, _SIZE).savefig(large, format="png", dpi=_DPI)
    return _small(Image.open(large))


def errors(name: str) -> bytes:
    """A small PNG of the errors of all codes with fixed steps."""
    _told("plot", f"testset-{name}", "--size", "7")
    figure = Image.open(RESULTS / "figures" / f"testset-{name}-errors.png").convert("RGB")
    return _small(figure.resize((_WIDTH, figure.height * _WIDTH // figure.width)))


def _small(image: Image.Image) -> bytes:
    small = io.BytesIO()
    image.convert("RGB").quantize(_COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    for name in registry.TESTSET:
        (FIGURES / f"testset-{name}.png").write_bytes(picture(name))
        (FIGURES / f"testset-{name}-errors.png").write_bytes(errors(name))
