"""Formulas of a table's columns, such as ``0.15 * cos(q) - 2 * `x (m)` ``, without running code."""

import ast
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from newmark_cli.codes.table_files import is_number
from newmark_cli.support.arrays import Array, shown
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import nearest

_OPERATORS = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide}
_FUNCTIONS = {"cos": np.cos, "sin": np.sin}
#: Longest formula (characters), and what one may consist of.
_LONGEST = 2_000
_ALLOWED = "columns, numbers, + - * /, cos(), sin() and parentheses; other names in backquotes"
_Values = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Formula:
    """What a quantity is, in columns of a table.

    Attributes:
        columns: Names of the columns that it has.
        of: Column → (rows,) numbers, to (rows,) numbers, or to one of a constant.
        is_plain: Whether it is a column as it stands.
    """

    columns: tuple[str, ...]
    of: Callable[[_Values], Any]
    is_plain: bool = False


def column(name: str, factor: float = 1.0) -> Formula:
    """A column, times a factor."""
    return Formula((name,), lambda values: factor * values[name], factor == 1.0)


def formula(text: Any, known: Sequence[str], where: str) -> Formula:
    """A formula from text; only arithmetic is read, and nothing is run.

    Args:
        text: A number, the name of a column, or arithmetic with both.  A column may be named by its
            number, from ``#1`` on; where its name looks like arithmetic it stands in backquotes.
        known: Names of the columns.
        where: What errors begin with.

    Raises:
        ArgumentError: When it is something else, or names no column.
    """
    text = str(text).strip()
    if text in known:
        return column(text)
    used: list[str] = []

    def take(match: re.Match[str]) -> str:
        name = match["quoted"] or match["known"]
        if match["number"] and 0 < int(match["number"]) <= len(known):
            name = known[int(match["number"]) - 1]
        elif name is None and match[0] in _FUNCTIONS:
            return match[0]
        if name not in known:
            raise ArgumentError(
                f"{where} has no column {name or match[0]!r}{nearest(name or match[0], known)}"
            )
        used.append(name)
        return f" c{len(used) - 1} "

    try:
        if len(text) > _LONGEST:
            raise SyntaxError
        tree = ast.parse(_names(known).sub(take, text).strip(), mode="eval").body
        of = _built(tree, used)
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError):
        raise ArgumentError(f"{where}: not a formula, given {shown(text)}; allowed: {_ALLOWED}") \
            from None  # fmt: skip
    return Formula(tuple(dict.fromkeys(used)), of)


def _names(known: Sequence[str]) -> re.Pattern[str]:
    """What is a name in a formula: quoted, a number of a column, known, or like an identifier."""
    plain = [re.escape(name) for name in sorted(known, key=len, reverse=True)
             if re.search(r"[^\W\d]", name) and not is_number(name)]  # fmt: skip
    direct = "|".join(plain) or r"(?!)"
    return re.compile(
        r"(?P<quote>[`'\"])(?P<quoted>.+?)(?P=quote)|#(?P<number>\d{1,6})"
        rf"|(?<![\w.])(?:(?P<known>{direct})(?![\w.\[]|\s*\()|[^\W\d][\w.]*(?:\[[^\]]*\])?)"
    )


def _built(node: ast.expr, used: Sequence[str]) -> Callable[[_Values], Any]:
    """A function for a node of a formula; `ValueError` for what no formula has."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            value = float(number)
            if math.isfinite(value):
                return lambda values: value
        case ast.Name(id=name) if name not in _FUNCTIONS:
            theirs = used[int(name[1:])]
            return lambda values: values[theirs]
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
            inner, sign = _built(operand, used), -1 if isinstance(op, ast.USub) else 1
            return lambda values: sign * inner(values)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            first, second, combine = _built(left, used), _built(right, used), _OPERATORS[type(op)]
            return lambda values: combine(first(values), second(values))
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
            inner, function = _built(argument, used), _FUNCTIONS[name]
            return lambda values: function(inner(values))
    raise ValueError
