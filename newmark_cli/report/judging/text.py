"""Tables of text, as wide as the terminal: every table that a command prints.

A table that is too wide is folded, never cut: its longest columns wrap, or its columns
go into several tables one below the other.
"""

import math
import re
import shutil
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from newmark_cli.report.judging.verdicts import FAILING, UNDECIDED
from newmark_cli.study.cell import STATUSES
from newmark_cli.support.errors import visible

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope

#: Least width of a table, however narrow the terminal.
_LEAST = 40
#: Longest word for which other columns give way; longer ones are broken.
_WORD = 20
#: Spaces between two columns.
_GAP = 2
#: Colours of words on a terminal.
_COLOURS = {UNDECIDED: "yellow", **dict.fromkeys((*STATUSES[1:], *FAILING), "red")}


def width() -> int:
    """Columns that a line may have: those of the terminal, or of COLUMNS; 80 in a pipe."""
    return max(shutil.get_terminal_size((80, 24)).columns, _LEAST)


#: What a cell of a table says: one line, or several.
Entry = str | tuple[str, ...]


def _shown(entry: Entry) -> str:
    """An entry as a terminal shows it, its lines separated by line feeds."""
    return visible(entry) if isinstance(entry, str) else "\n".join(map(visible, entry))


def colour(entry: str) -> str:
    """Colour of an entry on a terminal; empty for most."""
    if entry.endswith(" !"):  # an entry of Tables 1 and 2 that is not as predicted
        return "red"
    return _COLOURS.get(entry.rpartition("\n")[2], "")


def wrapped(line: str, indent: int = 0) -> str:
    """A line of text, folded between words; its further lines are indented."""
    before = " " * indent
    return textwrap.fill(
        visible(line), width(), initial_indent=before, subsequent_indent=before + "  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def text_table(rows: Sequence[Sequence[Entry]], *, blocks: bool = False, indent: int = 0) -> str:
    """Columns for a terminal, under headings; coloured on a terminal.

    Args:
        rows: The headings first; a row of one entry is a heading of the rows below it.
            What is not printed is escaped: an entry of several lines has them in a tuple.
        blocks: Whether columns that do not fit go into further tables, each with the first
            column; otherwise the longest columns wrap.
    """
    room = width() - indent
    shown = [list(map(_shown, row)) for row in rows]
    groups = list(_blocks(shown, room)) if blocks else [list(range(len(rows[0])))]
    tables = [
        _laid_out([[row[i] for i in group] if len(row) > 1 else row for row in shown], room)
        for group in groups
    ]
    lines = "\n\n".join(tables).splitlines()
    return "\n".join(" " * indent + line if line else "" for line in lines)


#: What Markdown would take for more than text, and HTML for a tag.
_MARKDOWN = re.compile(r"[\\`*<>\[\]|&]|(?<!\w)_|_(?!\w)")


def markdown(text: str) -> str:
    """A text in Markdown that reads as it is, in a cell of a table too."""
    return _MARKDOWN.sub(r"\\\g<0>", visible(text))


def _blocks(rows: Sequence[Sequence[str]], room: int) -> Iterator[list[int]]:
    """Columns of each table: as many as fit, always with the first."""
    widths = [most for _, most in _widths(rows)]
    group, used = [0], widths[0]
    for column in range(1, len(widths)):
        if len(group) > 1 and used + _GAP + widths[column] > room:
            yield group
            group, used = [0], widths[0]
        group.append(column)
        used += _GAP + widths[column]
    yield group


def _widths(rows: Sequence[Sequence[str]]) -> list[tuple[int, int]]:
    """(least, natural) width of each column, from its longest word and line."""
    from rich.cells import cell_len

    columns = zip(*(row for row in rows if len(row) > 1 or len(rows[0]) == 1), strict=True)
    widths = []
    for entries in map("\n".join, columns):
        word, line = (
            max(map(cell_len, parts), default=0) or 1
            for parts in (entries.split(), entries.splitlines())
        )
        widths.append((min(word, _WORD), line))
    return widths


def fitted(rows: Sequence[Sequence[str]], room: int) -> list[int]:
    """Widths of columns that fit: the widest give way first, and break words last."""
    widths = _widths(rows)
    fitting = [most for _, most in widths]
    while sum(fitting) + _GAP * (len(fitting) - 1) > room:
        above = [i for i, (least, _) in enumerate(widths) if fitting[i] > least]
        widest = max(above or range(len(fitting)), key=fitting.__getitem__)
        if fitting[widest] == 1:
            break
        fitting[widest] -= 1
    return fitting


def _laid_out(rows: Sequence[Sequence[str]], room: int) -> str:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    widths = fitted(rows, room)
    # Rich knows whether the output is a terminal, and which colours that shows.
    console = Console(width=room, highlight=False)
    headings, *entries = rows
    under: list[Sequence[str]] = [headings, ["-" * column for column in widths]]
    lines: list[str] = []

    def close() -> None:
        grid = Table.grid(padding=(0, _GAP, 0, 0), pad_edge=False)
        for column in widths:
            grid.add_column(width=column, overflow="fold")
        for row in under:
            grid.add_row(*(Text(entry, style=colour(entry)) for entry in row))
        with console.capture() as captured:
            console.print(grid)
        lines.extend(line.rstrip() for line in captured.get().splitlines() if under)

    for row in entries:
        if len(row) == len(widths):
            under.append(row)
        else:
            close()
            under = []
            lines.extend(textwrap.wrap(row[0], room) or [""])
    close()
    return "\n".join(lines)


def gathered(headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Headings, and rows without their first entry, which stands once above those it is of."""
    below: dict[str, list[tuple[str, ...]]] = {}
    for above, *row in rows:
        below.setdefault(above, []).append(tuple(row))
    lines = [headings]
    for above, gathered in below.items():
        lines += [("",), (above,), *gathered]
    return lines


def format_orders(slope: "Slope") -> str:
    """Local orders from the largest step size to the smallest, for people."""
    return " ".join(
        "–" if math.isnan(order) else f"{round(order, 2) + 0:.2f}".replace("-", "−")
        for order in slope.local_orders
    )


#: Letters that mean something to LaTeX.
_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': r"\char34{}",
    "`": r"\textasciigrave{}",
}  # fmt: skip


def latex_text(text: str) -> str:
    """Text that LaTeX prints as it is."""
    return "".join(_SPECIAL.get(letter, letter) for letter in visible(text))
