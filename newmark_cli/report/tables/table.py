"""A table as data, and how it is written: as text, Markdown, LaTeX or CSV."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from newmark_cli.report.judging.text import fitted, latex_text, markdown, text_table, wrapped
from newmark_cli.study import csv_files
from newmark_cli.support import files

#: Size of letters in LaTeX, how many of them the text of an article has in a line, and how many a
#: table may have: wide ones stand out into both margins, and columns of wider ones wrap.
_SIZES = (("footnotesize", 80, 90), ("scriptsize", 90, 118), ("tiny", 86, 140))
#: Letters that a column of a two-column article has in a line, of the first size.
_COLUMN = 40
#: Lines of a table on a page.
_PAGE = 45
#: What LaTeX writes itself.
_NUMBER = re.compile(r"^Table \d+: ")
#: Words of a label in LaTeX.
_SLUG = re.compile(r"\w+", re.ASCII)
#: What there is no entry of.
MISSING = "–"
#: What ends an entry that is not as predicted, and what says so.
MARK, MARKED = " !", "! marks what is not as predicted."


@dataclass(frozen=True)
class Table:
    """A table of texts."""

    title: str  #: what it shows
    headings: tuple[str, ...]  #: of the columns
    rows: tuple[tuple[str, ...], ...]  #: an entry for each column
    explained: bool = True  #: whether the legend is about it
    of: str = ""  #: title that it shares with alternatives; its own has theirs in parentheses

    @property
    def part(self) -> str:
        """Which of several alternatives it is; empty where there are no others."""
        if self.title.startswith(f"{self.of} ("):
            return self.title[len(self.of) + 2 : -1]
        return self.title if self.of not in ("", self.title) else ""

    @property
    def lines(self) -> list[tuple[str, ...]]:
        """Headings and rows."""
        return [self.headings, *self.rows]


#: What a table does not say itself: a term, or nothing, and a sentence.
Legend = Sequence[tuple[str, str]]
#: a row of a CSV: entry by column.
Record = Mapping[str, Any]


def pivoted(
    title: str,
    records: Iterable[Record],
    rows: Mapping[str, Callable[[Any], str]],
    column: str,
    entry: Callable[[Any], str],
    first: Iterable[Any] = (),
) -> Table:
    """A table of records, each an entry in the row and column that its values say.

    Args:
        records: Its entries.
        rows: Key that tells rows apart → how its values are written; the names head columns.
        column: Key of which the values head the other columns.
        entry: What is written of a record.
        first: Values of that key whose columns stand before others.
    """
    cells: dict[tuple[Any, ...], dict[Any, str]] = {}
    across = dict.fromkeys(first)
    for record in records:
        across[record[column]] = None
        cells.setdefault(tuple(record[key] for key in rows), {})[record[column]] = entry(record)
    body = (
        (
            *(spell(value) for spell, value in zip(rows.values(), where, strict=True)),
            *(entries.get(value, MISSING) for value in across),
        )
        for where, entries in cells.items()
    )
    return Table(title, (*rows, *map(str, across)), tuple(body))


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Rows, headings first, as a table in Markdown."""
    lines = ["| " + " | ".join(map(markdown, row)) + " |" for row in rows]
    return "\n".join([lines[0], "|" + " --- |" * len(rows[0]), *lines[1:]])


def _latex(tables: Sequence[Table], title: str, label: str, legend: Legend) -> str:
    """A table of alternatives, each under a line that says which, on as many pages as it takes."""
    headings = tables[0].headings
    # What stays in one line: a formula, and a number with its error.
    bound = [
        [e.replace(" ", "_") if _FORMULA.fullmatch(e) else e.replace(" ± ", "_±_") for e in row]
        for row in (headings, *(row for table in tables for row in table.rows))
    ]
    natural = [max(map(len, column)) for column in zip(*bound, strict=True)]
    fits = [(size, letters, fitted(bound, room)) for size, letters, room in _SIZES]
    size, letters, widths = next((fit for fit in fits if fit[2] == natural), fits[-1])
    wraps = [width < most for width, most in zip(widths, natural, strict=True)]
    columns = "".join(
        rf"p{{{width / letters:.3f}\linewidth}}" if wrap else "l"
        for width, wrap in zip(widths, wraps, strict=True)
    )

    def row(entries: Iterable[str]) -> str:
        ragged = (
            r"\raggedright\hspace{0pt}" * wrap + latex(entry)
            for entry, wrap in zip(entries, wraps, strict=True)
        )
        return "    " + " & ".join(ragged) + r" \tabularnewline"

    pages: list[list[str]] = [[]]
    room = _PAGE
    for table in tables:
        if len(tables) > 1:
            which = rf"\multicolumn{{{len(headings)}}}{{l}}{{\itshape {latex(table.part)}}}"
            pages[-1] += [r"    \hline"] * bool(pages[-1]) + [rf"    {which} \tabularnewline"]
            room -= 1
        for entries in table.rows:
            room -= max(-(-len(e) // width) for e, width in zip(entries, widths, strict=True))
            if room < 0:
                pages.append([])
                room = _PAGE
            pages[-1].append(row(entries))
    ours = [line for line in legend if not line[0] or line[0] in headings]
    caption = " ".join([f"{title}.", *_sentences(ours if tables[0].explained else ())])
    above = [rf"  \caption{{{latex(caption)}}}", rf"  \label{{tab:{label}}}"]
    # A wide one takes both columns of an article that has two.
    kind = "table*" if sum(widths) > _COLUMN else "table"
    lines = []
    for page in pages:
        lines += [
            rf"\begin{{{kind}}}",
            *above,
            rf"  \{size}",
            r"  \setlength{\tabcolsep}{3pt}\smallskip",
            rf"  \makebox[\linewidth]{{\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
            r"    \hline",
            row(headings),
            r"    \hline",
            *page,
            r"    \hline",
            r"  \end{tabular}}",
            rf"\end{{{kind}}}",
            "",
        ]
        above = [r"  \addtocounter{table}{-1}", rf"  \caption{{{latex(title)}, continued.}}"]
    return "\n".join(lines)


#: Symbols of entries in math mode.
_SYMBOLS = {
    "α": r"\alpha ", "β": r"\beta ", "γ": r"\gamma ", "η": r"\eta ", "λ": r"\lambda ",
    "ρ": r"\rho ", "ω": r"\omega ", "κ": r"\kappa ", "Φ": r"\Phi ", "Δ": r"\Delta ",
    "∂": r"\partial ", "∞": r"_\infty ", "−": "-", "±": r"\pm ", "≥": r"\ge ", "→": r"\to ",
    "ᵀ": "^T", "₀": "_0", "′": "'", "×": r"\times ", "·": r"\cdot ", "‖": r"\|",
    "ε": r"\varepsilon ",
}  # fmt: skip
_POWERS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_MATH = re.compile("([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)|([" + "".join(_SYMBOLS) + "])")


#: What is a formula as a whole: symbols and single letters, each with one subscript at most.
_FORMULA = re.compile(
    r"(?!n/a)(?!.*[A-Za-z]{2})(?!.*_(?:_|\W|$|._))(?=.*[^\W\d])"
    r"[A-Za-z()/, _0-9′⁻⁰¹²³⁴⁵⁶⁷⁸⁹Ͱ-Ͽ]+"
)


def latex(text: str) -> str:
    """Text with the field's symbols that any LaTeX prints as it is."""

    def math(match: re.Match[str]) -> str:
        powers, symbol = match.groups()
        return f"^{{{powers.translate(_POWERS)}}}" if powers else _SYMBOLS[symbol]

    if _FORMULA.fullmatch(text):
        return f"${_MATH.sub(math, text)}$"
    text = re.sub(r"(?<=\d) ± (?=\d)", "~±~", latex_text(text))
    text = _MATH.sub(lambda match: f"${math(match).strip()}$", text)
    return re.sub(r"(?<!\\)\$\$", "", text).replace("–", "--").replace("…", r"\dots{}")


@dataclass(frozen=True)
class Report:
    """Tables that belong together."""

    name: str  #: of their files
    tables: tuple[Table, ...]  #: the tables
    legend: Legend = ()  #: how to read them
    #: Rows of a CSV with numbers, for programs; those of the tables when omitted.
    records: Sequence[Record] = ()
    columns: tuple[str, ...] = ()  #: columns of the records
    study: str = ""  #: study that they are of

    def written(self, form: str) -> str:
        """Them as text for a terminal, ``markdown``, ``latex``, or ``csv``."""
        return {
            "text": self._text, "markdown": self._markdown, "latex": self._latex, "csv": self._csv,
        }[form]()  # fmt: skip

    def write(self, folder: Path) -> list[Path]:
        """Write them as Markdown, LaTeX and CSV below ``tables``; returns the files."""
        files.make_folder(folder / "tables", folder, parents=True)
        paths = []
        for suffix, form in ((".md", "markdown"), (".csv", "csv"), (".tex", "latex")):
            paths.append(folder / "tables" / f"{self.name}{suffix}")
            files.write(paths[-1], self.written(form), folder)
        return paths

    def _text(self) -> str:
        """What is too wide goes into several tables, one below the other."""
        parts = [
            f"{wrapped(table.title)}\n\n{text_table(table.lines, blocks=True)}\n"
            for table in self.tables
        ]
        return "\n".join([*parts, *map(wrapped, _sentences(self.legend))]).rstrip()

    def _markdown(self) -> str:
        """With headings, and the legend as a list."""
        parts = []
        for table in self.tables:
            parts += [f"### {markdown(table.title)}", "", markdown_table(table.lines), ""]
        parts += [
            f"- **{markdown(term)}**: {markdown(text)}" if term else f"- {markdown(text)}"
            for term, text in self.legend
        ]
        return "\n".join([*parts, ""])

    def _latex(self) -> str:
        """As a journal takes them, without any package: alternatives in one table."""
        groups: dict[tuple[str, tuple[str, ...]], list[Table]] = {}
        for table in self.tables:
            groups.setdefault((table.of or table.title, table.headings), []).append(table)
        titled, labels = [], []
        for (of, _), tables in groups.items():
            title = of if len(tables) > 1 else tables[0].title
            title = _NUMBER.sub("", title)
            own = title.removeprefix(self.study)
            labels.append("-".join((self.study or self.name, *_SLUG.findall(own))))
            if self.study and self.study in (of, title):
                title = f"study {self.study}" + (f": {title}" if title != self.study else "")
            titled.append((f"{title[:1].upper()}{title[1:]}", tables))
        return "\n".join(
            _latex(tables, title, f"{label}-{i}" if labels.count(label) > 1 else label, self.legend)
            for i, (label, (title, tables)) in enumerate(zip(labels, titled, strict=True), 1)
        )

    def _csv(self) -> str:
        """The records, or the rows of all tables, each with the title of its table."""
        if self.columns:
            return csv_files.csv_text(self.columns, self.records)
        headings = dict.fromkeys(name for table in self.tables for name in table.headings)
        entries = (
            {"table": table.title, **dict(zip(table.headings, row, strict=True))}
            for table in self.tables
            for row in table.rows
        )
        return csv_files.csv_text(("table", *headings), entries)


def _sentences(legend: Legend) -> list[str]:
    return [f"{term}: {text}" if term else text for term, text in legend]
