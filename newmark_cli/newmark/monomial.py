"""Monomials c · Π symbolᵏ: the factors of a scaling, read from text.

A factor such as ``gamma/(beta*h)`` is data.  Its value comes from the numbers
of β, γ and h, its order from the exponent of h.
"""

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from newmark_cli.support.errors import InputError

SYMBOLS = ("beta", "gamma", "h")
LONGEST = 200
_ALPHABET = re.compile(r"[a-zA-Z0-9.+*/^() -]*", re.ASCII)
#: A number that runs into a word, as in 0x1: Python reads some of them, and warns.
_RUN_TOGETHER = re.compile(r"[0-9]\.?([A-DF-Za-df-z]|[eE](?![-+]?[0-9]))")


class MonomialError(InputError):
    """The text is not a positive monomial in the allowed symbols."""


@dataclass(frozen=True)
class Monomial:
    """c · Π symbolᵏ with c > 0 and whole k."""

    coefficient: float = 1.0  #: c
    #: (symbol, k) pairs with k ≠ 0, in order of the symbols' names
    powers: tuple[tuple[str, int], ...] = ()

    @classmethod
    def parse(cls, text: str | float) -> "Monomial":
        """Read a monomial such as ``1/(beta*h^2)``; the text is never evaluated as code.

        It has numbers and the symbols joined by ``*``, ``/`` and ``^`` (or ``**``) with whole
        exponents, and parentheses.

        Raises:
            MonomialError: On anything else, and if the coefficient is not positive and finite.
        """
        source = str(text)
        if len(source) > LONGEST:
            raise MonomialError(f"longer than {LONGEST} characters")
        if not _ALPHABET.fullmatch(source):
            raise MonomialError(f"{source!r}: only numbers, symbols, * / ^ and parentheses")
        if _RUN_TOGETHER.search(source):
            raise MonomialError(f"{source!r} is not a product of powers")
        try:
            tree = ast.parse(source.replace("^", "**").strip(), mode="eval")
            monomial = _read(tree.body)
        except ZeroDivisionError:
            raise MonomialError(f"{source!r}: division by zero") from None
        except (SyntaxError, RecursionError, MemoryError, ArithmeticError, ValueError) as error:
            if isinstance(error, MonomialError):
                raise
            raise MonomialError(f"{source!r} is not a product of powers") from None
        if not (math.isfinite(monomial.coefficient) and monomial.coefficient > 0):
            raise MonomialError(f"{source!r} is not positive")
        return monomial

    def __call__(self, values: Mapping[str, float]) -> float:
        """Value for numbers given to the symbols."""
        # Numerator and denominator apart: γ/(βh) is then rounded as one writes it.
        above, below = self.coefficient, 1.0
        for symbol, power in self.powers:
            if power > 0:
                above *= values[symbol] ** power
            else:
                below *= values[symbol] ** -power
        return above / below

    def order(self) -> int:
        """The order of the factor in h: the exponent of h."""
        return dict(self.powers).get("h", 0)

    def __mul__(self, other: "Monomial") -> "Monomial":
        powers = dict(self.powers)
        for symbol, power in other.powers:
            powers[symbol] = powers.get(symbol, 0) + power
        return Monomial(self.coefficient * other.coefficient, _ordered(powers))

    def __pow__(self, exponent: int) -> "Monomial":
        return Monomial(
            self.coefficient**exponent,
            _ordered({symbol: power * exponent for symbol, power in self.powers}),
        )

    def __str__(self) -> str:
        def product(sign: int) -> list[str]:
            return [
                symbol if abs(power) == 1 else f"{symbol}^{abs(power)}"
                for symbol, power in self.powers
                if power * sign > 0
            ]

        above, below = product(1), product(-1)
        if self.coefficient != 1 or not above:
            above.insert(0, f"{self.coefficient:.17g}")
        text = "*".join(above)
        if below:
            text += "/" + (below[0] if len(below) == 1 else f"({'*'.join(below)})")
        return text


def _ordered(powers: Mapping[str, int]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted((symbol, power) for symbol, power in powers.items() if power))


def _read(node: ast.expr) -> Monomial:
    match node:
        case ast.Constant(value=value) if isinstance(value, int | float) and value is not True:
            return Monomial(float(value))
        case ast.Name(id=name):
            if name not in SYMBOLS:
                raise MonomialError(f"unknown symbol {name!r}; allowed: {', '.join(SYMBOLS)}")
            return Monomial(1.0, ((name, 1),))
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _read(left) * _read(right)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _read(left) * _read(right) ** -1
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            try:
                exponent = ast.literal_eval(right)
            except ValueError:
                exponent = None
            if type(exponent) is not int or abs(exponent) > 16:
                raise MonomialError("exponents are whole numbers up to 16")
            return _read(left) ** exponent
        case ast.UnaryOp(op=ast.USub()):
            raise MonomialError("a factor must be positive")
    raise MonomialError("only numbers, symbols, * / ^ and parentheses are allowed")
