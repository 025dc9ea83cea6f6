"""Evaluation, assembly and elimination of one mechanism as straight-line code.

A loop over elements asks of each what it is and where it belongs; the assembly asks which
fields are kept and where the mass matrix has entries.  In a march nothing of that changes.
Where it is constant, LLVM unrolls the loops, folds what they read, and leaves the
arithmetic.  The code comes from the same compiled functions as the loops, operation by
operation, and gives the same bits.  It is kept on disk under a digest of these functions
and of what is constant in it; step size, scaling, parameters of the mechanism and the
state stay arguments.
"""

from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from itertools import pairwise
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
from newmark_cli.support import machine_code
from newmark_cli.support.arrays import IndexArray
from newmark_cli.support.cached_code import bitcode, cached_njit
from newmark_cli.support.machine_code import generate_call

#: Most elements of a mechanism that code is made for: 20 ms of compilation each, 0.1 s in space.
ELEMENTS_AT_MOST = 64

#: Arguments of a problem's function, of the verbs of the kernel, and of the code for evaluation
#: and for a correction, in their orders.
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
    parts = _Parts(problem, problem.starts.tolist(), scheme, tables, elimination)
    evaluate, correct = machine_code.addresses(
        specialised, ("evaluate", "correct"), parts.digest(), parts.module
    )
    return Specialised(call, np.array([[evaluate]], np.int64), np.array([correct], np.uint64))


def unspecialised(problem: Problem) -> Specialised:
    """A problem's own function."""
    return Specialised(problem.function, problem.ints, np.zeros(1, np.uint64))


class _Parts:
    """What a module is made of: arrays that are written into the code, and shapes of all arrays."""

    def __init__(
        self,
        problem: Problem,
        starts: list[int],
        scheme: Scheme,
        tables: ProblemTables,
        elimination: Written | None,
    ) -> None:
        self.function: Any = problem.function
        self.starts, self.elimination = starts, elimination
        self.compensated = scheme.compensated
        self.dtype = np.dtype(scheme.dtype)
        step, n, m = scheme.tables, problem.n, problem.m
        self.constants: Mapping[str, IndexArray] = {
            "ints": problem.ints,
            "mass_rows": tables.mass_rows,
            "mass_columns": tables.mass_columns,
            "g_rows": tables.g_rows,
            "g_columns": tables.g_columns,
            "kept": step.kept,
        }
        x, y, g = len(tables.x_rows), len(tables.y_rows), len(tables.g_rows)
        unknowns = len(step.kept) * n + m
        self.shapes: dict[str, tuple[int, ...]] = {
            **{name: array.shape for name, array in self.constants.items()},
            "u": (n,), "v": (n,), "multipliers": (m,), "reals": tables.reals.shape,
            "force": (n,), "phi": (m,), "x": (x,), "y": (y,), "g": (g,),
            "sources": (x + y + g,), "mass_values": tables.mass_values.shape,
            "left": step.left.shape, "dynamic_weights": step.dynamic_weights.shape,
            "row_weights": step.row_weights.shape, "dynamics": (n,),
            "rows": (len(step.row_weights), n), "moving": (3, n), "rhs": (unknowns,),
            "phi_old": (m,), "g_old": (g,), "shift": (n,),
        }  # fmt: skip

    def digest(self) -> str:
        solving = self.elimination.digest() if self.elimination else ""
        digest = sha256(
            f"{machine_code.identity()} {numba.__version__} {self.dtype} {self.compensated} "
            f"{solving} {self.shapes} {self.starts} ".encode()
        )
        for function in (self.function, kernel.assemble_residual):
            digest.update(machine_code.source(function.py_func.__code__.co_filename))
        digest.update(machine_code.source(__file__))
        for array in self.constants.values():
            digest.update(f"{array.dtype} ".encode() + array.tobytes())
        return digest.hexdigest()[:32]

    def module(self) -> Any:
        """The optimised module."""
        evaluate, module = self._linked(self.function, _EVALUATED, None)
        assemble, module = self._linked(kernel.assemble_residual, _ASSEMBLED, module)
        names = [evaluate, assemble]
        if self.compensated:
            increase, module = self._linked(kernel.increase_phi, _INCREASED, module)
            names.append(increase)
        if self.elimination:
            solving = llvm.parse_assembly(self.elimination.text())
            module.link_in(solving)
            names.append(generated.NAME)
        module.link_in(llvm.parse_assembly(self._text(names)))
        # Internal functions that nothing calls are dropped.
        for function in module.functions:
            if not function.is_declaration and function.name not in ("evaluate", "correct"):
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

    def _linked(self, function: Any, names: Sequence[str], module: Any) -> tuple[str, Any]:
        """Link a compiled function into a module, where its helpers become internal."""
        kinds = (self._type(name) for name in names)
        name, code = bitcode(function, tuple(kinds))
        parsed = llvm.parse_bitcode(code)
        for other in parsed.functions:
            if not other.is_declaration:
                # Linking would drop what nothing calls yet.
                other.linkage = "external" if other.name == name else "internal"
        if module is None:
            return name, parsed
        module.link_in(parsed)
        return name, module

    def _type(self, name: str) -> Any:
        """Type of an argument, as numba knows it."""
        constant = name in self.constants
        scalar: Any = from_dtype(self.constants[name].dtype if constant else self.dtype)
        if name == "t":
            return scalar
        return scalar[::1] if len(self.shapes[name]) == 1 else scalar[:, ::1]

    def _text(self, names: Sequence[str]) -> str:
        """Both functions, in the language of LLVM."""
        number = {4: "float", 8: "double"}[self.dtype.itemsize]
        room = ["%result = alloca ptr", "%exception = alloca ptr"]
        # Each element is a table of its own.  The force begins at zero with the first: that of
        # the others has no entries that could be set.
        evaluated: list[str] = []
        for first, last in pairwise([*self.starts, self.constants["ints"].size]):
            row = f"getelementptr (i64, ptr @ints, i64 {first})"
            parts = {"ints": self._array("ints", (1, last - first), row)}
            if evaluated:
                parts["force"] = self._array("force", (0,))
            evaluated.append(self._call(names[0], _EVALUATED, number, parts))
        corrected = [
            f"%x = getelementptr {number}, ptr %sources, i64 0",
            f"%y = getelementptr {number}, ptr %sources, i64 {self.shapes['x'][0]}",
            f"%g = getelementptr {number}, ptr %y, i64 {self.shapes['y'][0]}",
            *evaluated,
        ]
        if self.compensated:
            corrected.append(self._call(names[2], _INCREASED, number))
        corrected.append(self._call(names[1], _ASSEMBLED, number))
        if self.elimination:
            pointers = ", ".join(f"ptr %{name}" for name in _SOLVED)
            corrected += [
                f"%ending = call i64 @{generated.NAME}({pointers}) alwaysinline",
                "ret i64 %ending",
            ]
        else:
            corrected.append(f"ret i64 {UNSOLVED}")
        declared = [
            f"declare i32 @{name}({', '.join(self._kinds(arguments))})"
            for name, arguments in zip(names, (_EVALUATED, _ASSEMBLED, _INCREASED), strict=False)
            if name != generated.NAME
        ]
        if self.elimination:
            declared.append(f"declare i64 @{generated.NAME}({', '.join(['ptr'] * len(_SOLVED))})")

        def function(kind: str, name: str, arrays: Sequence[str], body: Sequence[str]) -> list[str]:
            pointers = ", ".join(f"ptr noalias %{argument}" for argument in arrays)
            return [f"define {kind} @{name}({number} %t, {pointers}) {{", *room, *body, "}"]

        lines = [
            *declared,
            *(self._constant(name) for name in self.constants),
            *function("void", "evaluate", _EVALUATE, [*evaluated, "ret void"]),
            *function("i64", "correct", _CORRECT, corrected),
        ]
        return "\n".join([*lines, ""])

    def _call(
        self, function: str, names: Sequence[str], number: str, parts: Mapping[str, str] = {}
    ) -> str:
        arguments = [
            f"{number} %t" if name == "t" else parts.get(name, self._array(name)) for name in names
        ]
        listed = ", ".join(["ptr %result", "ptr %exception", *arguments])
        return f"call i32 @{function}({listed}) alwaysinline"

    def _kinds(self, names: Sequence[str]) -> list[str]:
        """Types of arguments, after those for the result and an exception."""
        number = {4: "float", 8: "double"}[self.dtype.itemsize]
        kinds = ["ptr", "ptr"]
        for name in names:
            array = [] if name == "t" else self._array(name).split(", ")
            kinds += [part.split()[0] for part in array] or [number]
        return kinds

    def _array(self, name: str, shape: tuple[int, ...] = (), data: str = "") -> str:
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


@intrinsic
def _call(typing, address, t, u, v, multipliers, reals, force, phi, x, y, g):  # type: ignore[no-untyped-def]
    """Call the code of an evaluation."""
    arguments = (address, t, u, v, multipliers, reals, force, phi, x, y, g)
    return types.void(*arguments), generate_call


@cached_njit(nogil=True, error_model="numpy")
def call(t, u, v, multipliers, ints, reals, force, phi, x_values, y_values, g_values):  # type: ignore[no-untyped-def]
    """Evaluate by the code whose address is in ``ints``; of `kernel.evaluate_type`."""
    _call(ints[0, 0], t, u, v, multipliers, reals, force, phi, x_values, y_values, g_values)  # type: ignore[call-arg]
