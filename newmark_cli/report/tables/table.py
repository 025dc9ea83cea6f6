"""A table as data, and how it is written: as text, Markdown, LaTeX or CSV."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from newmark_cli.report.judging.text import fitted, latex_text, markdown, text_table, wrapped
from newmark_cli.study import csv_files
from newmark_cli.support import files

#: Letters in a line of a page in LaTeX; columns of longer tables wrap.
_LINE = 100
#: What LaTeX writes itself.
_NUMBER = re.compile(r"^Table \d+: ")
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


def _latex(table: Table, label: str, legend: Legend) -> str:
    ours = [line for line in legend if not line[0] or line[0] in table.headings]
    title = _NUMBER.sub("", table.title)
    caption = [f"{title[:1].upper()}{title[1:]}.", *_sentences(ours if table.explained else ())]
    narrow, wide = fitted(table.lines, _LINE), fitted(table.lines, 10 * _LINE)
    wraps = [width < most for width, most in zip(narrow, wide, strict=True)]
    columns = "".join(
        rf"p{{{width / _LINE:.2f}\linewidth}}" if wrap else "l"
        for width, wrap in zip(narrow, wraps, strict=True)
    )

    def row(entries: Iterable[str]) -> str:
        ragged = (
            r"\raggedright " * wrap + latex(e) for e, wrap in zip(entries, wraps, strict=True)
        )
        return "    " + " & ".join(ragged) + r" \tabularnewline"

    return "\n".join(
        [
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{latex(' '.join(caption))}}}",
            rf"  \label{{tab:{label}}}",
            r"  \footnotesize",
            r"  \setlength{\tabcolsep}{4pt}\smallskip",
            rf"  \begin{{tabular}}{{@{{}}{columns}@{{}}}}",
            r"    \hline",
            row(table.headings),
            r"    \hline",
            *map(row, table.rows),
            r"    \hline",
            r"  \end{tabular}",
            r"\end{table}",
            "",
        ]
    )


#: Symbols of entries in math mode.
_SYMBOLS = {
    "α": r"\alpha ", "β": r"\beta ", "γ": r"\gamma ", "η": r"\eta ", "λ": r"\lambda ",
    "ρ": r"\rho ", "ω": r"\omega ", "κ": r"\kappa ", "Φ": r"\Phi ", "Δ": r"\Delta ",
    "∂": r"\partial ", "∞": r"_\infty ", "−": "-", "±": r"\pm ", "≥": r"\ge ", "→": r"\to ",
    "ᵀ": "^T", "₀": "_0", "′": "'", "×": r"\times ", "‖": r"\|", "ε": r"\varepsilon ",
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
    text = _MATH.sub(lambda match: f"${math(match).strip()}$", latex_text(text))
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
        """As a journal takes them, without any package; the legend is the last caption's."""
        titles = [_NUMBER.sub("", table.title) for table in self.tables]
        labels = [re.sub(r"\W+", "-", title, flags=re.ASCII).strip("-") for title in titles]
        return "\n".join(
            _latex(table, f"{label}-{i}" if labels.count(label) > 1 else label, self.legend)
            for i, (table, label) in enumerate(zip(self.tables, labels, strict=True), 1)
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
