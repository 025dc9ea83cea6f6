"""The page and the pictures of the test set, from its data.

python docs/site/testset.py

A new member is a mechanism file, a table of reference values, an entry in `testset.yaml` of the
package, and a study in `benchmarks/testset` that was run; this script then writes its block, its
picture and the figure of its errors.
"""

import io
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from PIL import Image

from newmark_cli.library import testset
from newmark_cli.mechanisms import registry
from newmark_cli.report.drawing import draw, draw_mechanism
from newmark_cli.study import csv_rows

DOCS = Path(__file__).parents[1]
PAGE, FIGURES = DOCS / "testset.md", DOCS / "figures"
#: Of the studies `benchmarks/testset/NAME.yaml`.
RESULTS = DOCS.parent / "benchmarks" / "testset" / "results"
#: What stands before the blocks of the members.
_BEGIN = "<!-- members: written by docs/site/testset.py -->\n"
#: Coordinates that only say how a body in space has turned.
_DIRECTOR = re.compile(r"\.d[123]\.[xyz]\]$")
#: Values below it are rounding of zeros.
_ZERO = 1e-16
#: Of pictures: inches, dots per inch, colours.
_SIZE, _DPI, _COLOURS = (4.5, 3.0), 110, 32
#: Pixels of a figure of errors, from edge to edge.
_WIDTH = 1000


def page(text: str) -> str:
    """The page with its blocks written anew.

    Args:
        text: The page as it is, whose beginning is written by hand.
    """
    blocks = "".join(map(block, registry.TESTSET))
    return text.partition(_BEGIN)[0] + _BEGIN + "\n" + lowest_errors() + blocks


def lowest_errors() -> str:
    """The lowest error of λ that each code reaches on each member; – where it always fails."""
    found = pd.concat([pd.read_csv(path) for path in csv_rows.study_files(RESULTS)])
    rows = found[(found["measure"] == "error") & (found["quantity"] == "lambda")]
    codes = rows["code"].str.partition(",")[0]
    least = rows.groupby([rows["problem"], codes])["last"].min().unstack()
    lines = [f"| member | {' | '.join(least)} |", f"| --- {'| --- ' * least.shape[1]}|"]
    for name, values in least.iterrows():
        entries = ("–" if value != value else f"{value:.1e}" for value in values)
        lines.append(f"| [`{name}`](#{name}) | {' | '.join(entries)} |")
    return "\n".join(lines) + "\n"


def block(name: str) -> str:
    """The block of a member."""
    return "\n".join(_lines(testset.member(name))) + "\n"


def _lines(member: testset.Member) -> Iterator[str]:
    name, errors = member["name"], member["errors"] or {}
    yield f"\n## {name}\n"
    yield f"![{name}, at its start](figures/testset-{name}.png)\n"
    times = ", ".join(f"{t:g}" for t in member["times"])
    stated = ", ".join(f"{sign} {errors[part]:.0e}" for part, sign in _SIGNS.items())
    free, n, m = (member[key] for key in ("degrees_of_freedom", "n", "m"))
    for label, text in (
        (
            member["title"],
            f"{member['description']}; degrees of freedom {free}, n = {n}, m = {m}",
        ),
        ("Tests", member["tests"]),
        ("Source", member["source"]),
        ("Reference", f"at t = {times} s; errors {stated}; second method: {member['second']}"),
        ("Published", member["published"]),
    ):
        yield f"- **{label}**: {text}."
    row = testset.references(name)[-1]
    values = {key: _shown(value) for key, value in row.items()}
    yield f"\n| t = {values['t']} s | u | v |\n| --- | --- | --- |"
    for key in values:
        pair = values[key], values.get("v" + key[1:])
        if key.startswith("u[") and not _DIRECTOR.search(key) and pair != ("0", "0"):
            yield f"| `{key[2:-1]}` | {pair[0]} | {pair[1]} |"
    yield f"\n| t = {values['t']} s | λ, or output |\n| --- | --- |"
    for key, value in values.items():
        if key.startswith(("lambda[", "output[")) and value != "0":
            yield f"| `{key.partition('[')[2][:-1]}` | {value} |"
    yield f"\n![{name}, errors over h](figures/testset-{name}-errors.png)"


def _shown(value: str) -> str:
    """Eight digits of a value; 0 where it is below the errors of all references."""
    return "0" if abs(float(value)) < _ZERO else f"{float(value):.8g}"


def _run(*words: str) -> None:
    """Run a command on the results."""
    command = [sys.executable, "-m", "newmark_cli", *words, "--results", str(RESULTS)]
    subprocess.run(command, check=True, capture_output=True)


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
    _run("plot", f"testset-{name}", "--size", "7")
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
