"""Static elimination as straight-line code, made for one pattern.

For a small matrix the loops and lists of `static_elimination` cost more than the
arithmetic.  Here the arithmetic alone is written out, in the intermediate language of
LLVM: assembly, elimination and both substitutions of one pattern in one order.  All
numbers are arguments, so that one function serves every step size, scaling and problem of
its pattern.  Its machine code is kept on disk under a digest of the pattern.
"""

from functools import partial
from hashlib import sha256

import llvmlite.ir as ir
import numpy as np

from newmark_cli import machine_code
from newmark_cli.arrays import IndexArray
from newmark_cli.newmark.march_data import COMPLETED, PIVOTING, MatrixTables
from newmark_cli.newmark.static_elimination import LARGEST_MULTIPLIER, SECTIONS

#: Most multiplications and subtractions of an elimination that is written out.  Compiling
#: takes 0.1 s for so many, and from there on longer than in proportion.
OPERATIONS_AT_MOST = 500
#: The function.
NAME = "solve"


def address(tables: MatrixTables) -> int:
    """Where the code for a pattern stands; compiled, or read from disk, when first asked for.

    The function takes sources, right-hand side, constants, coefficients and work space, as
    `static_elimination.solve_in_order` does, and returns what that does.

    Args:
        tables: Of the pattern; of the numbers only their type matters.
    """
    return machine_code.addresses(address, [NAME], digest(tables), partial(text, tables))[0]


def text(tables: MatrixTables) -> str:
    """The code for a pattern, in the language of LLVM; its function is `NAME`."""
    return str(_module(tables))


def digest(tables: MatrixTables) -> str:
    """What the code for a pattern depends on, in 32 characters."""
    found = sha256(f"{LARGEST_MULTIPLIER} {machine_code.identity()} {tables.work.dtype} ".encode())
    found.update(machine_code.source(__file__))
    for array in (tables.structure, tables.room[-1:], tables.places, tables.origins):
        found.update(f"{len(array)} ".encode() + array.tobytes())
    return found.hexdigest()[:32]


def _sections(tables: MatrixTables) -> dict[str, IndexArray]:
    """What ``structure`` holds, by name."""
    begins = tables.room[: len(SECTIONS)].astype(int)
    parts = np.split(tables.structure, begins[1:])
    return dict(zip(SECTIONS, parts, strict=True))


def _module(tables: MatrixTables) -> ir.Module:
    """The function, as `static_elimination` reads the same tables."""
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

    source = [value(sources, k) for k in range(max(origins, default=-1) + 1)]
    solution = [
        build.fmul(value(rhs, row), value(work, j)) for j, row in enumerate(of["row_order"])
    ]
    lower: dict[int, ir.Value] = {}
    upper: dict[int, ir.Value] = {}
    inverse: list[ir.Value] = []
    good, largest = ir.Constant(ir.IntType(1), 1), ir.Constant(number, 0.0)
    for j in range(size):
        column: dict[int, ir.Value] = {}
        for e in entries("constant", j):
            column[of["constant_rows"][e]] = value(constant, e)
        for e in entries("term", j):
            term = build.fmul(value(coefficients, e), source[origins[e]])
            before = column.get(places[e])
            column[places[e]] = term if before is None else build.fadd(before, term)
        for e in entries("upper", j):
            k = of["upper_rows"][e]
            upper[e] = column[k]
            for i in entries("lower", k):
                row, product = of["lower_rows"][i], build.fmul(lower[i], upper[e])
                before = column.get(row, ir.Constant(number, 0.0))
                column[row] = build.fsub(before, product)
        positive = build.fcmp_ordered(">", column[j], ir.Constant(number, 0.0))
        good = build.and_(good, positive)
        inverse.append(build.fdiv(ir.Constant(number, 1.0), column[j]))
        for e in entries("lower", j):
            row = of["lower_rows"][e]
            lower[e] = build.fmul(column[row], inverse[j])
            multiplier = build.call(magnitude, [lower[e]])
            larger = build.fcmp_ordered(">", multiplier, largest)
            largest = build.select(larger, multiplier, largest)
            solution[row] = build.fsub(solution[row], build.fmul(lower[e], solution[j]))
    limit = ir.Constant(number, LARGEST_MULTIPLIER)
    build.cbranch(build.and_(good, build.fcmp_ordered("<=", largest, limit)), *blocks[1:])

    build.position_at_end(blocks[1])
    for j in range(size - 1, -1, -1):
        solved = build.fmul(solution[j], inverse[j])
        found = build.fmul(solved, value(work, size + j))
        build.store(found, at(rhs, of["column_order"][j]))
        for e in entries("upper", j):
            row = of["upper_rows"][e]
            solution[row] = build.fsub(solution[row], build.fmul(upper[e], solved))
    build.ret(ir.Constant(index, COMPLETED))
    build.position_at_end(blocks[2])
    build.ret(ir.Constant(index, PIVOTING))
    return module
