"""The page and the pictures of the test set, from its data.

python docs/site/testset.py

A new member is a mechanism file, a table of reference values and an entry in `testset.yaml`
of the package; this script then writes its block and its picture.
"""

import io
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from newmark_cli.library import testset
from newmark_cli.mechanisms import registry
from newmark_cli.report.drawing import draw, draw_mechanism

DOCS = Path(__file__).parents[1]
PAGE, FIGURES = DOCS / "testset.md", DOCS / "figures"
#: What stands before the blocks of the members.
_BEGIN = "<!-- members: written by docs/site/testset.py -->\n"
#: Of pictures: inches, dots per inch, colours.
_SIZE, _DPI, _COLOURS = (4.5, 3.0), 110, 32


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
    yield f"\n## {member.name}\n"
    yield f"![{member.title}, at its start](figures/testset-{member.name}.png)\n"
    errors = member.errors or {}
    stated = ", ".join(f"{sign} {errors[part]:.0e}" for part, sign in _SIGNS.items())
    for label, text in (
        (member.title, member.description),
        ("Tests", member.tests),
        ("Source", member.source),
        ("Size", f"degrees of freedom {member.degrees_of_freedom}, n = {member.n}, m = {member.m}"),
        ("Reference", f"at t = {', '.join(f'{t:g}' for t in member.times)} s; errors {stated}"),
        ("Confirmed by", member.second),
        ("Published", member.published),
    ):
        yield f"- **{label}**: {text}."
    row = testset.references(member.name)[-1]
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


_SIGNS = {"u": "u", "v": "v", "lambda": "λ"}


def picture(name: str) -> bytes:
    """A small PNG of the mechanism at its start."""
    subject = registry.problem(name)
    sheet = draw_mechanism.mechanism_sheet(testset.member(name).title, subject, subject.u0)
    large, small = io.BytesIO(), io.BytesIO()
    draw.drawn(sheet, _SIZE).savefig(large, format="png", dpi=_DPI)
    Image.open(large).convert("RGB").quantize(_COLOURS).save(small, format="png", optimize=True)
    return small.getvalue()


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    for name in registry.TESTSET:
        (FIGURES / f"testset-{name}.png").write_bytes(picture(name))
