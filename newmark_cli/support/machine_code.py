"""Machine code that LLVM makes for one pattern, kept on disk and loaded into the process."""

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from numba import types

from newmark_cli.support.cached_code import kept_bytes

_lock = threading.Lock()
#: File → what keeps its code alive, and knows where its function stands.
_loaded: dict[str, Any] = {}


@cache
def identity() -> str:
    """Dependencies of code besides its source: LLVM and the processor."""
    return (
        f"{llvm.llvm_version_info} {llvm.get_host_cpu_name()} "
        f"{llvm.get_host_cpu_features().flatten()}"
    )


def address(
    owner: Any, function: str, key: str, made_from: str, make: Callable[[], str] | None
) -> int:
    """Where a function stands; compiled, or read from disk, when first asked for.

    Args:
        owner: Function whose folder of compiled code has the file.
        function: Its name in the module.
        key: What tells the module from others, with `identity` in it, fit for the name of a
            file.
        made_from: Digest of the sources of ``make``.
        make: Makes the text of the module; None for 0 where it is to be compiled.
    """
    name = f"{function}-{key}"
    with _lock:
        if name not in _loaded:
            machine = _target()
            compiled = make and (lambda: machine.emit_object(_verified(make())))
            code = kept_bytes(owner, name, compiled, made_from)
            if code is None:
                return 0
            engine = llvm.create_mcjit_compiler(_verified(""), machine)
            engine.add_object_file(llvm.ObjectFileRef.from_data(code))
            engine.finalize_object()
            _loaded[name] = engine
        return int(_loaded[name].get_function_address(function))


def generate_call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Code generator of a numba intrinsic that calls what stands at its first argument.

    Arrays are handed on as where their data stand.
    """
    values = [
        context.make_array(kind)(context, builder, value).data
        if isinstance(kind, types.Array)
        else value
        for kind, value in zip(signature.args[1:], arguments[1:], strict=True)
    ]
    result = context.get_value_type(signature.return_type)
    kind = type(builder.function.ftype)(result, [value.type for value in values])
    call = builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), values)
    return context.get_dummy_value() if signature.return_type == types.void else call


def _target() -> Any:
    """This machine, as LLVM compiles for it."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=1,
        reloc="pic",
        codemodel="jitdefault",
    )


def _verified(text: str) -> Any:
    module = llvm.parse_assembly(text)
    module.triple = llvm.get_default_triple()
    module.verify()
    return module
