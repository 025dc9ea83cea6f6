"""The blocks of code in the documentation, and the commands in them."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

_FENCE = re.compile(r"^```(\w*)(?: title=\"([^\"]+)\")?$")
_NOT_RUN = re.compile(r"^<!-- not run: (.+) -->$")
_INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")


@dataclass(frozen=True)
class Block:
    """A fenced or an indented block."""

    line: int  #: of the page, where it begins
    language: str  #: as the fence says
    title: str  #: name of the file that it shows; empty where it is none
    text: str  #: what is in it
    not_run: str  #: why it is not run; empty where it is


def pages():
    """The README and every page of the docs, by name."""
    found = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return {path.name: path for path in found}


def blocks(path):
    """Blocks of a page: fenced ones, and indented ones, whose language their first line tells."""
    found, begin, lines, reason = [], None, [], ""
    indented, before = [], ""

    def end_indented():
        text = "".join(f"{line[4:]}\n" for line in indented).rstrip("\n") + "\n"
        if indented:
            found.append(Block(number - len(indented), _guessed(text), "", text, reason))
        indented.clear()

    for number, line in enumerate([*path.read_text(encoding="utf-8").splitlines(), "."], start=1):
        if begin is not None and line != "```":
            lines.append(line)
        elif begin is not None:
            found.append(Block(*begin, "".join(f"{each}\n" for each in lines), reason))
            begin, reason = None, ""
        elif (line.startswith("    ") and (indented or not before.strip())) or (
            indented and not line
        ):
            indented.append(line)
        else:
            end_indented()
            if marked := _NOT_RUN.match(line):
                reason = marked[1]
            elif line.startswith("```"):
                fence = _FENCE.match(line)
                assert fence, f"{path.name}, line {number}: {line}"
                begin, lines = (number, fence[1], fence[2] or ""), []
            elif line:
                reason = ""
        before = line
    assert begin is None, f"{path.name}: a block does not end"
    return found


def _guessed(text):
    """Language of an indented block."""
    if text.startswith("$ "):
        return "console"
    if text.startswith(("newmark-study ", "python ")):
        return "bash"
    return "yaml" if "…" in text else "text"


def inline(path):
    """What stands between single backticks outside of blocks."""
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    return _INLINE.findall(text)


@dataclass(frozen=True)
class Command:
    """One command of a block."""

    words: list[str]
    may_fail: bool = False  #: whether ``|| true`` follows
    into: str | None = None  #: file that its output goes to; None where it is printed
    shown: list[str] | None = None  #: what the page shows of its output; None where it shows none


def _command(text, shown=None):
    text = re.sub(r"(^|\s)#\s.*$", "", text).strip()
    may_fail = text.endswith("|| true")
    text, _, into = text.removesuffix("|| true").strip().partition(" > ")
    return Command(shlex.split(text), may_fail, into.strip() or None, shown)


def commands(block):
    """Commands of a block of bash, or of a console with prompts and what is printed."""
    if block.language == "console":
        found = []
        for part in re.split(r"^\$ ", block.text, flags=re.M)[1:]:
            first, *shown = part.splitlines()
            found.append(_command(first, [line for line in shown if line]))
        return found
    text = re.sub(r"\\\n\s*", "", block.text)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [_command(part) for line in lines for part in line.split(" && ")]
