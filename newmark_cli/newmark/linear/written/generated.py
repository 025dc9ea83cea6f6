"""Elimination as straight-line code, made for one pattern and one order.

For a small matrix loops and lists cost more than the arithmetic.  Here the arithmetic
alone is written out, in the intermediate language of LLVM: assembly, elimination and both
substitutions of one pattern in one order.  All numbers are arguments, so that one function
serves every step size, scaling and problem of its pattern.  Its machine code is kept on
disk under a digest of the pattern.

The order is that of `static_elimination`, or one in which partial pivoting exchanged the
rows before; the code then gives up where partial pivoting would exchange others.
"""

from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.ir as ir
import numpy as np

from newmark_cli.newmark.linear.written.static_elimination import (
    LARGEST_MULTIPLIER,
    SECTIONS,
    SIGNED,
)
from newmark_cli.newmark.march_data import COMPLETED, PIVOTING, MatrixTables
from newmark_cli.support import machine_code, sources

#: Most multiplications and subtractions of an elimination that is written out.  Compiling
#: takes 0.1 s for so many, and from there on longer than in proportion.
OPERATIONS_AT_MOST = 800
#: The function.
NAME = "solve"


class Written(NamedTuple):
    """An elimination that is written out."""

    tables: MatrixTables  #: its lists; of the numbers only their type matters
    #: whether its order is one of partial pivoting, `MatrixTables.work` empty
    pivoting: bool = False

    def digest(self) -> str:
        """Digest of the pattern and the order, 32 characters."""
        tables = self.tables
        digest = sha256(f"{self.pivoting} {machine_code.identity()} {tables.work.dtype} ".encode())
        for array in (tables.structure, tables.room[SIGNED:], tables.places, tables.origins):
            digest.update(f"{len(array)} ".encode() + array.tobytes())
        return digest.hexdigest()[:32]

    def text(self) -> str:
        """The code, in the language of LLVM; its function is `NAME`.

        The function takes sources, right-hand side, constants, coefficients and work space,
        as `static_elimination.solve_in_order` does, and returns what that does; where it
        gives up, it leaves all of them as they are.
        """
        return str(_module(self))

    def address(self, compiling: bool = True) -> int:
        """Where the code stands; compiled, or read from disk, when first asked for.

        Args:
            compiling: Whether to compile it where it never was; it is at 0 otherwise.
        """
        make = self.text if compiling else None
        return machine_code.address(_module, NAME, self.digest(), made_from(), make)


def made_from() -> str:
    """Digest of the sources of all such code."""
    return sources.stamp(Path(__file__))


def _came_before(rows: Sequence[int]) -> list[set[int]]:
    """At each column of partial pivoting, the rows that stand above its pivot's.

    Among rows with equally large entries partial pivoting takes the first.
    """
    place = {row: k for k, row in enumerate(rows)}
    standing, before = sorted(rows), []
    for k, row in enumerate(rows):
        at = standing.index(row)
        before.append({place[other] for other in standing[k:at]})
        standing[k], standing[at] = standing[at], standing[k]
    return before


_INDEX = ir.IntType(64)


def _module(written: Written) -> ir.Module:
    """The function, as `static_elimination` or `newton.solve_in_place` reads the same tables."""
    number = ir.FloatType() if written.tables.work.dtype == np.float32 else ir.DoubleType()
    module = ir.Module()
    kind = ir.FunctionType(_INDEX, [number.as_pointer()] * 5)
    function = ir.Function(module, kind, NAME)
    for argument in function.args:
        argument.add_attribute("noalias")
    start, solved, refused = (
        function.append_basic_block(name) for name in ("eliminate", "solved", "refused")
    )
    build = ir.IRBuilder(start)
    code = _Code(written, build, number, module.declare_intrinsic("llvm.fabs", [number]))
    build.cbranch(code.eliminated(), solved, refused)
    build.position_at_end(solved)
    code.substitute_back()
    build.ret(ir.Constant(_INDEX, COMPLETED))
    build.position_at_end(refused)
    build.ret(ir.Constant(_INDEX, PIVOTING))
    return module


class _Code:
    """Elimination and substitutions as instructions of a builder; values by their places."""

    def __init__(self, written: Written, build: ir.IRBuilder, number: Any, magnitude: Any) -> None:
        tables, self.pivoting = written
        self.build, self.number, self.magnitude = build, number, magnitude
        sources, self.rhs, self.constant, self.coefficients, self.work = build.function.args
        self.signed = not self.pivoting and bool(tables.room[SIGNED])
        parts = np.split(tables.structure, tables.room[1 : len(SECTIONS)].astype(int))
        self.of = {name: part.tolist() for name, part in zip(SECTIONS, parts, strict=True)}
        self.places, self.origins = tables.places.tolist(), tables.origins.tolist()
        self.size = int(tables.room[-1])
        self.source = [self._value(sources, k) for k in range(max(self.origins, default=-1) + 1)]
        self.solution = [self._value(self.rhs, row) for row in self.of["row_order"]]
        self.before = _came_before(self.of["row_order"]) if self.pivoting else []
        self.lower: dict[int, ir.Value] = {}
        self.upper: dict[int, ir.Value] = {}
        self.inverse: list[ir.Value] = []

    def eliminated(self) -> ir.Value:
        """Factorise, and substitute forward; whether all pivots are good."""
        build, work = self.build, self.work
        if not self.pivoting:
            units = (self._value(work, j) for j in range(self.size))
            self.solution = [
                build.fmul(b, unit) for b, unit in zip(self.solution, units, strict=True)
            ]
        good = ir.Constant(ir.IntType(1), 1)
        for j in range(self.size):
            column = self._column(j)
            below = [self.of["lower_rows"][e] for e in self._entries("lower", j)]
            good = self._is_good(j, column, below, good)
            self.inverse.append(build.fdiv(ir.Constant(self.number, 1.0), column[j]))
            for e, row in zip(self._entries("lower", j), below, strict=True):
                self.lower[e] = build.fmul(column[row], self.inverse[j])
                product = build.fmul(self.lower[e], self.solution[j])
                self.solution[row] = build.fsub(self.solution[row], product)
        if not self.pivoting:
            limit = ir.Constant(self.number, LARGEST_MULTIPLIER)
            largest = self._largest_of(self.lower.values())
            good = build.and_(good, build.fcmp_ordered("<=", largest, limit))
        return good

    def substitute_back(self) -> None:
        """Overwrite the right-hand side with the solution."""
        build = self.build
        for j in range(self.size - 1, -1, -1):
            value = solved = build.fmul(self.solution[j], self.inverse[j])
            if not self.pivoting:
                value = build.fmul(solved, self._value(self.work, self.size + j))
            build.store(value, self._at(self.rhs, self.of["column_order"][j]))
            for e in self._entries("upper", j):
                row, product = self.of["upper_rows"][e], build.fmul(self.upper[e], solved)
                self.solution[row] = build.fsub(self.solution[row], product)

    def _column(self, j: int) -> dict[int, ir.Value]:
        """Row → entry of a column: assembled, less what the columns before it eliminate."""
        build, column = self.build, {}
        for e in self._entries("constant", j):
            column[self.of["constant_rows"][e]] = self._value(self.constant, e)
        for e in self._entries("term", j):
            term = build.fmul(self._value(self.coefficients, e), self.source[self.origins[e]])
            so_far = column.get(self.places[e])
            column[self.places[e]] = term if so_far is None else build.fadd(so_far, term)
        for e in self._entries("upper", j):
            k = self.of["upper_rows"][e]
            self.upper[e] = column[k]
            for i in self._entries("lower", k):
                row, product = self.of["lower_rows"][i], build.fmul(self.lower[i], self.upper[e])
                so_far = column.get(row, ir.Constant(self.number, 0.0))
                column[row] = build.fsub(so_far, product)
        return column

    def _is_good(
        self, j: int, column: dict[int, ir.Value], below: Sequence[int], good: ir.Value
    ) -> ir.Value:
        """Whether all pivots so far are positive, or those of partial pivoting."""
        build, pivot, above = self.build, column[j], ir.Constant(self.number, 0.0)
        if not self.signed:
            pivot = build.call(self.magnitude, [pivot])
        if self.pivoting:
            above = self._largest_of(column[row] for row in below if row in self.before[j])
            rest = self._largest_of(column[row] for row in below if row not in self.before[j])
            good = build.and_(good, build.fcmp_ordered(">=", pivot, rest))
        return build.and_(good, build.fcmp_ordered(">", pivot, above))

    def _largest_of(self, entries: Iterable[ir.Value]) -> ir.Value:
        build, largest = self.build, ir.Constant(self.number, 0.0)
        for entry in entries:
            size = build.call(self.magnitude, [entry])
            largest = build.select(build.fcmp_ordered(">", size, largest), size, largest)
        return largest

    def _entries(self, kind: str, j: int) -> range:
        starts = self.of[f"{kind}_starts"]
        return range(starts[j], starts[j + 1])

    def _at(self, array: ir.Argument, place: int) -> ir.Value:
        return self.build.gep(array, [ir.Constant(_INDEX, int(place))])

    def _value(self, array: ir.Argument, place: int) -> ir.Value:
        return self.build.load(self._at(array, place))
