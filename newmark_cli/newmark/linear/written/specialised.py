"""Evaluation, assembly and elimination of one mechanism as straight-line code.

A loop over elements asks of each what it is and where it belongs; the assembly asks which
fields are kept and where the mass matrix has entries.  In a march nothing of that changes.
Where it is constant, LLVM unrolls the loops, folds what they read, and leaves the
arithmetic.  The code comes from the same compiled functions as the loops, operation by
operation, and gives the same bits.  It is kept on disk under a digest of these functions
and of what is constant in it; step size, scaling, parameters of the mechanism and the
state stay arguments.

The evaluation, which takes longest to compile, is a module of its own, and so is the
elimination (`generated`): all forms of a mechanism share the one, and a correction calls both.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
import numpy as np
from numba import from_dtype, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from newmark_cli.newmark import kernel
from newmark_cli.newmark.linear.written import generated
from newmark_cli.newmark.linear.written.generated import Written
from newmark_cli.newmark.march_data import UNSOLVED, ProblemTables
from newmark_cli.newmark.scheme import Scheme
from newmark_cli.problems.problem import Problem
from newmark_cli.support import machine_code, sources
from newmark_cli.support.arrays import IndexArray
from newmark_cli.support.cached_code import bitcode, cached_njit
from newmark_cli.support.machine_code import generate_call

#: Most elements of a mechanism that code is made for: 20 to 30 ms of compilation each.
ELEMENTS_AT_MOST = 64

#: Arguments of a problem's function, of the verbs of the kernel, and of the code for evaluation,
#: elimination and a correction, in their orders.
_EVALUATED = (
    "t", "u", "v", "multipliers", "ints", "reals", "force", "phi", "x", "y", "g",
)  # fmt: skip
_INCREASED = "phi_old", "g_old", "g", "g_rows", "g_columns", "shift", "phi"
_ASSEMBLED = (
    "mass_rows", "mass_columns", "mass_values", "kept", "left", "dynamic_weights",
    "row_weights", "dynamics", "rows", "moving", "force", "phi", "rhs",
)  # fmt: skip
_SOLVED = "sources", "rhs", "constant", "coefficients", "work"
_EVALUATE = "u", "v", "multipliers", "reals", "force", "phi", "x", "y", "g"
_CORRECT = (
    "u", "v", "multipliers", "reals", "force", "phi", "sources", "mass_values", "left",
    "dynamic_weights", "row_weights", "dynamics", "rows", "moving", "rhs", "phi_old", "g_old",
    "shift", "constant", "coefficients", "work",
)  # fmt: skip


class Specialised(NamedTuple):
    """What the kernel is given in place of a problem's function and its table of integers."""

    function: Callable[..., None]
    ints: IndexArray
    code: NDArray[np.uint64]  #: (1,) address of the code of a correction, or 0


def specialised(
    problem: Problem, scheme: Scheme, tables: ProblemTables, elimination: Written | None
) -> Specialised:
    """Code of a problem and a form of index 3, where it is a mechanism with few elements.

    It includes the elimination, if there is one.
    """
    if problem.starts is None or not 0 < len(problem.starts) <= ELEMENTS_AT_MOST:
        return unspecialised(problem)
    evaluation = _evaluation(problem, scheme, tables)
    correct = _correction(evaluation, scheme, tables, elimination).address()
    evaluate = evaluation.address()
    return Specialised(call, np.array([[evaluate]], np.int64), np.array([correct], np.uint64))


def unspecialised(problem: Problem) -> Specialised:
    """A problem's own function."""
    return Specialised(problem.function, problem.ints, np.zeros(1, np.uint64))


@dataclass(frozen=True, eq=False)
class _Module:
    """A module with one function.

    Attributes:
        name: Of the function.
        dtype: Of its numbers.
        functions: Compiled functions that it is made of, with the names of their arguments.
        constants: Arrays that are written into the code.
        shapes: Shapes of all arrays.
        variant: What else tells its code from that of others.
        write: Its text, in the language of LLVM, from the module and the names of ``functions``.
    """

    name: str
    dtype: np.dtype[Any]
    functions: Sequence[tuple[Any, Sequence[str]]]
    constants: Mapping[str, IndexArray]
    shapes: Mapping[str, tuple[int, ...]]
    variant: str
    write: Callable[["_Module", Sequence[str]], str]

    @property
    def number(self) -> str:
        """Type of a number."""
        return {4: "float", 8: "double"}[self.dtype.itemsize]

    @cached_property
    def key(self) -> str:
        """Digest of what the code is for, 32 characters."""
        digest = sha256(
            f"{machine_code.identity()} {numba.__version__} {self.dtype} {self.shapes} "
            f"{self.variant} ".encode()
        )
        for array in self.constants.values():
            digest.update(f"{array.dtype} ".encode() + array.tobytes())
        return digest.hexdigest()[:32]

    def address(self) -> int:
        """Where its function stands."""
        made_from = [sources.digest([Path(__file__)]), generated.made_from()]
        for function, _ in self.functions:
            made_from.append(sources.stamp(Path(function.py_func.__code__.co_filename)))
        return machine_code.address(
            specialised, self.name, self.key, " ".join(made_from), self._made
        )

    def symbol(self) -> str:
        """The name by which other modules call it; loads it first."""
        self.address()
        return machine_code.symbol(self.name, self.key)

    def _made(self) -> Any:
        """The optimised module."""
        names, module = [], llvm.parse_assembly("")
        for function, arguments in self.functions:
            names.append(self._link(module, function, arguments))
        module.link_in(llvm.parse_assembly(self.write(self, names)))
        # Internal functions that nothing calls are dropped.
        for function in module.functions:
            if not function.is_declaration and function.name != self.name:
                function.linkage = "internal"
        # Vectorised sums would be rounded differently.
        tuning = llvm.create_pipeline_tuning_options(speed_level=3)
        tuning.loop_vectorization = False
        tuning.slp_vectorization = False
        passes = llvm.create_pass_builder(machine_code.target(), tuning)
        # Constants first: most of each copy of a function is dropped before passes that take
        # ten times as long.
        first = llvm.create_new_module_pass_manager()
        first.add_always_inliner_pass()
        first.add_global_dead_code_eliminate_pass()
        first.add_sroa_pass()
        for _ in range(2):
            first.add_sccp_pass()
            first.add_simplify_cfg_pass()
        first.run(module, passes)
        passes.getModulePassManager().run(module, passes)
        return module

    def _link(self, module: Any, function: Any, arguments: Sequence[str]) -> str:
        """Link a compiled function into a module, where its helpers become internal; its name."""
        name, code = bitcode(function, tuple(map(self._type, arguments)))
        parsed = llvm.parse_bitcode(code)
        for other in parsed.functions:
            if not other.is_declaration:
                # Linking would drop what nothing calls yet.
                other.linkage = "external" if other.name == name else "internal"
        module.link_in(parsed)
        return name

    def _type(self, name: str) -> Any:
        """Type of an argument, as numba knows it."""
        constant = name in self.constants
        scalar: Any = from_dtype(self.constants[name].dtype if constant else self.dtype)
        if name == "t":
            return scalar
        return scalar[::1] if len(self.shapes[name]) == 1 else scalar[:, ::1]

    def definition(
        self, kind: str, arrays: Sequence[str], names: Sequence[str], body: Sequence[str]
    ) -> str:
        """Text of the module, given the types and arguments of its function and its body."""
        pointers = ", ".join(f"ptr noalias %{argument}" for argument in arrays)
        lines = [
            *(
                f"declare i32 @{name}({', '.join(self._kinds(arguments))})"
                for name, (_, arguments) in zip(names, self.functions, strict=True)
            ),
            *(self._constant(name) for name in self.constants),
            f"define {kind} @{self.name}({self.number} %t, {pointers}) {{",
            "%result = alloca ptr",
            "%exception = alloca ptr",
            *body,
            "}",
        ]
        return "\n".join([*lines, ""])

    def call(self, function: str, names: Sequence[str], parts: Mapping[str, str] = {}) -> str:
        """A call of one of ``functions``; in place of some arguments, others."""
        arguments = [
            f"{self.number} %t" if name == "t" else parts.get(name, self.array(name))
            for name in names
        ]
        listed = ", ".join(["ptr %result", "ptr %exception", *arguments])
        return f"call i32 @{function}({listed}) alwaysinline"

    def _kinds(self, names: Sequence[str]) -> list[str]:
        """Types of arguments, after those for the result and an exception."""
        kinds = ["ptr", "ptr"]
        for name in names:
            array = [] if name == "t" else self.array(name).split(", ")
            kinds += [part.split()[0] for part in array] or [self.number]
        return kinds

    def array(self, name: str, shape: tuple[int, ...] = (), data: str = "") -> str:
        """An array as numba passes it: two owners, size, item size, data, shape, strides."""
        shape, constant = shape or self.shapes[name], name in self.constants
        item = (self.constants[name].dtype if constant else self.dtype).itemsize
        strides = [item * int(np.prod(shape[k + 1 :])) for k in range(len(shape))]
        numbers = [f"i64 {number}" for number in (*shape, *strides)]
        data = data or f"{'@' if constant else '%'}{name}"
        size = int(np.prod(shape))
        return ", ".join(
            ["ptr null", "ptr null", f"i64 {size}", f"i64 {item}", f"ptr {data}", *numbers]
        )

    def _constant(self, name: str) -> str:
        entries = self.constants[name].ravel().tolist()
        values = ", ".join(f"i64 {entry}" for entry in entries)
        return f"@{name} = internal constant [{len(entries)} x i64] [{values}]"


def _evaluation(problem: Problem, scheme: Scheme, tables: ProblemTables) -> _Module:
    """The evaluation of a problem, for all forms."""
    assert problem.starts is not None
    starts, n, m = [*problem.starts.tolist(), problem.ints.size], problem.n, problem.m

    def write(module: _Module, names: Sequence[str]) -> str:
        # Each element is a table of its own.  The force begins at zero with the first: that of
        # the others has no entries that could be set.
        body: list[str] = []
        for first, last in pairwise(starts):
            row = f"getelementptr (i64, ptr @ints, i64 {first})"
            parts = {"ints": module.array("ints", (1, last - first), row)}
            if body:
                parts["force"] = module.array("force", (0,))
            body.append(module.call(names[0], _EVALUATED, parts))
        return module.definition("void", _EVALUATE, names, [*body, "ret void"])

    shapes = {
        "ints": problem.ints.shape, "u": (n,), "v": (n,), "multipliers": (m,),
        "reals": tables.reals.shape, "force": (n,), "phi": (m,), "x": tables.x_rows.shape,
        "y": tables.y_rows.shape, "g": tables.g_rows.shape,
    }  # fmt: skip
    functions = [(problem.function, _EVALUATED)]
    constants = {"ints": problem.ints}
    return _Module(
        "evaluate", np.dtype(scheme.dtype), functions, constants, shapes, str(starts), write
    )


def _correction(
    evaluation: _Module, scheme: Scheme, tables: ProblemTables, elimination: Written | None
) -> _Module:
    """A correction of one form: evaluation, assembly and, perhaps, elimination."""
    step, of_problem = scheme.tables, evaluation.shapes
    (n,), (m,), (g,) = of_problem["u"], of_problem["phi"], of_problem["g"]
    (x,), (y,) = of_problem["x"], of_problem["y"]
    evaluate, solve = evaluation.symbol(), elimination.symbol() if elimination else ""

    def write(module: _Module, names: Sequence[str]) -> str:
        number = module.number
        declared = [f"declare void @{evaluate}({number}, {', '.join(['ptr'] * len(_EVALUATE))})"]
        evaluated = ", ".join([f"{number} %t", *(f"ptr %{name}" for name in _EVALUATE)])
        body = [
            f"%x = getelementptr {number}, ptr %sources, i64 0",
            f"%y = getelementptr {number}, ptr %sources, i64 {x}",
            f"%g = getelementptr {number}, ptr %y, i64 {y}",
            f"call void @{evaluate}({evaluated})",
            *(
                module.call(name, arguments)
                for name, (_, arguments) in zip(names, module.functions, strict=True)
            ),
        ]
        if solve:
            declared.append(f"declare i64 @{solve}({', '.join(['ptr'] * len(_SOLVED))})")
            pointers = ", ".join(f"ptr %{name}" for name in _SOLVED)
            body += [f"%ending = call i64 @{solve}({pointers})", "ret i64 %ending"]
        else:
            body.append(f"ret i64 {UNSOLVED}")
        return "\n".join([*declared, module.definition("i64", _CORRECT, names, body)])

    constants = {
        "mass_rows": tables.mass_rows, "mass_columns": tables.mass_columns,
        "g_rows": tables.g_rows, "g_columns": tables.g_columns, "kept": step.kept,
    }  # fmt: skip
    shapes = {
        **of_problem, **{name: array.shape for name, array in constants.items()},
        "mass_values": tables.mass_values.shape, "left": step.left.shape,
        "dynamic_weights": step.dynamic_weights.shape, "row_weights": step.row_weights.shape,
        "dynamics": (n,), "rows": (len(step.row_weights), n), "moving": (3, n),
        "rhs": (len(step.kept) * n + m,), "phi_old": (m,), "g_old": (g,), "shift": (n,),
    }  # fmt: skip
    functions = [
        *[(kernel.increase_phi, _INCREASED)] * scheme.compensated,
        (kernel.assemble_residual, _ASSEMBLED),
    ]
    return _Module(
        "correct", evaluation.dtype, functions, constants, shapes,
        f"{evaluate} {solve} {scheme.compensated}", write,
    )  # fmt: skip


@intrinsic
def _call(typing, address, t, u, v, multipliers, reals, force, phi, x, y, g):  # type: ignore[no-untyped-def]
    """Call the code of an evaluation."""
    arguments = (address, t, u, v, multipliers, reals, force, phi, x, y, g)
    return types.void(*arguments), generate_call


@cached_njit(nogil=True, error_model="numpy")
def call(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):  # type: ignore[no-untyped-def]
    """Evaluate by the code whose address is in ``ints``; of `kernel.evaluate_type`."""
    _call(ints[0, 0], t, u, v, multipliers, reals, force, phi, x_values, y_values, g_values)  # type: ignore[call-arg]
