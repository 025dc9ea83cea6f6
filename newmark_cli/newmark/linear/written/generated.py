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
from typing import NamedTuple

import llvmlite.ir as ir
import numpy as np

from newmark_cli.newmark.linear.written.static_elimination import (
    LARGEST_MULTIPLIER,
    SECTIONS,
    SIGNED,
)
from newmark_cli.newmark.march_data import COMPLETED, PIVOTING, MatrixTables
from newmark_cli.support import machine_code
from newmark_cli.support.arrays import IndexArray

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
        """Digest of all that the code depends on, 32 characters."""
        tables = self.tables
        found = sha256(
            f"{self.pivoting} {LARGEST_MULTIPLIER} {machine_code.identity()} "
            f"{tables.work.dtype} ".encode()
        )
        found.update(machine_code.source(__file__))
        for array in (tables.structure, tables.room[SIGNED:], tables.places, tables.origins):
            found.update(f"{len(array)} ".encode() + array.tobytes())
        return found.hexdigest()[:32]

    def text(self) -> str:
        """The code, in the language of LLVM; its function is `NAME`.

        The function takes sources, right-hand side, constants, coefficients and work space,
        as `static_elimination.solve_in_order` does, and returns what that does; where it
        gives up, it leaves all of them as they are.
        """
        return str(_module(self))

    def address(self) -> int:
        """Where the code stands; compiled, or read from disk, when first asked for."""
        return machine_code.addresses(_module, [NAME], self.digest(), self.text)[0]

    def is_made(self) -> bool:
        """Whether it has been compiled, here or before."""
        return machine_code.is_made(_module, [NAME], self.digest())


def _sections(tables: MatrixTables) -> dict[str, IndexArray]:
    """Contents of ``structure``, by name."""
    begins = tables.room[: len(SECTIONS)].astype(int)
    parts = np.split(tables.structure, begins[1:])
    return dict(zip(SECTIONS, parts, strict=True))


def _came_before(rows: Sequence[int]) -> list[set[int]]:
    """At each column of partial pivoting, the rows that stand above its pivot's.

    Among rows with equally large entries partial pivoting takes the first.
    """
    place = {row: k for k, row in enumerate(rows)}
    standing, found = sorted(rows), []
    for k, row in enumerate(rows):
        at = standing.index(row)
        found.append({place[other] for other in standing[k:at]})
        standing[k], standing[at] = standing[at], standing[k]
    return found


def _module(written: Written) -> ir.Module:
    """The function, as `static_elimination` or `kernel.solve_in_place` reads the same tables."""
    tables, pivoting = written
    signed = not pivoting and bool(tables.room[SIGNED])
    module = ir.Module()
    number = ir.FloatType() if tables.work.dtype == np.float32 else ir.DoubleType()
    index = ir.IntType(64)
    kind = ir.FunctionType(index, [number.as_pointer()] * 5)
    function = ir.Function(module, kind, NAME)
    for argument in function.args:
        argument.add_attribute("noalias")
    sources, rhs, constant, coefficients, work = function.args
    blocks = [function.append_basic_block(name) for name in ("eliminate", "solved", "refused")]
    build = ir.IRBuilder(blocks[0])
    magnitude = module.declare_intrinsic("llvm.fabs", [number])

    def at(array: ir.Argument, place: int) -> ir.Value:
        return build.gep(array, [ir.Constant(index, int(place))])

    def value(array: ir.Argument, place: int) -> ir.Value:
        return build.load(at(array, place))

    of = {name: part.tolist() for name, part in _sections(tables).items()}
    places, origins = tables.places.tolist(), tables.origins.tolist()
    size = int(tables.room[-1])

    def entries(kind: str, j: int) -> range:
        starts = of[f"{kind}_starts"]
        return range(starts[j], starts[j + 1])

    def largest_of(entries: Iterable[ir.Value]) -> ir.Value:
        found = ir.Constant(number, 0.0)
        for entry in entries:
            size_of = build.call(magnitude, [entry])
            found = build.select(build.fcmp_ordered(">", size_of, found), size_of, found)
        return found

    source = [value(sources, k) for k in range(max(origins, default=-1) + 1)]
    solution = [value(rhs, row) for row in of["row_order"]]
    if pivoting:
        before = _came_before(of["row_order"])
    else:
        solution = [build.fmul(b, value(work, j)) for j, b in enumerate(solution)]
    lower: dict[int, ir.Value] = {}
    upper: dict[int, ir.Value] = {}
    inverse: list[ir.Value] = []
    good = ir.Constant(ir.IntType(1), 1)
    for j in range(size):
        column: dict[int, ir.Value] = {}
        for e in entries("constant", j):
            column[of["constant_rows"][e]] = value(constant, e)
        for e in entries("term", j):
            term = build.fmul(value(coefficients, e), source[origins[e]])
            so_far = column.get(places[e])
            column[places[e]] = term if so_far is None else build.fadd(so_far, term)
        for e in entries("upper", j):
            k = of["upper_rows"][e]
            upper[e] = column[k]
            for i in entries("lower", k):
                row, product = of["lower_rows"][i], build.fmul(lower[i], upper[e])
                so_far = column.get(row, ir.Constant(number, 0.0))
                column[row] = build.fsub(so_far, product)
        below = [of["lower_rows"][e] for e in entries("lower", j)]
        pivot = column[j]
        if not signed:
            pivot = build.call(magnitude, [pivot])
        if pivoting:
            above = largest_of(column[row] for row in below if row in before[j])
            rest = largest_of(column[row] for row in below if row not in before[j])
            good = build.and_(good, build.fcmp_ordered(">=", pivot, rest))
        else:
            above = ir.Constant(number, 0.0)
        good = build.and_(good, build.fcmp_ordered(">", pivot, above))
        inverse.append(build.fdiv(ir.Constant(number, 1.0), column[j]))
        for e, row in zip(entries("lower", j), below, strict=True):
            lower[e] = build.fmul(column[row], inverse[j])
            solution[row] = build.fsub(solution[row], build.fmul(lower[e], solution[j]))
    if not pivoting:
        limit = ir.Constant(number, LARGEST_MULTIPLIER)
        good = build.and_(good, build.fcmp_ordered("<=", largest_of(lower.values()), limit))
    build.cbranch(good, *blocks[1:])

    build.position_at_end(blocks[1])
    for j in range(size - 1, -1, -1):
        solved = build.fmul(solution[j], inverse[j])
        found = solved if pivoting else build.fmul(solved, value(work, size + j))
        build.store(found, at(rhs, of["column_order"][j]))
        for e in entries("upper", j):
            row = of["upper_rows"][e]
            solution[row] = build.fsub(solution[row], build.fmul(upper[e], solved))
    build.ret(ir.Constant(index, COMPLETED))
    build.position_at_end(blocks[2])
    build.ret(ir.Constant(index, PIVOTING))
    return module
