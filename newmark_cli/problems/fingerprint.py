"""A digest of functions that were defined in Python, without a file behind them."""

import hashlib
import uuid
from collections.abc import Mapping
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

#: Objects from these are known by their names; versions are part of every record.
_LIBRARIES = frozenset(("builtins", "math", "cmath", "numpy", "scipy", "numba"))
_FUNCTIONS = ("force", "constraints", "gradient", "stiffness", "damping", "energy")
#: Left out where they are None, so that digests of older definitions stay the same.
_OPTIONAL = ("constraint_rate", "curvature", "rate_gradient", "acceleration_gradient")


def of_definition(definition: Any) -> str:
    """Hexadecimal digest of the functions of a `Definition`.

    It covers their code, and the numbers, text, arrays and functions that they refer to.
    Where they refer to anything else it is one that no other definition has: two problems
    that differ never have the same digest.
    """
    digest = hashlib.sha256()
    # Keeps the objects, lest another gets the id of one that is gone.
    seen: dict[int, tuple[int, Any]] = {}
    try:
        optional = [key for key in _OPTIONAL if getattr(definition, key, None) is not None]
        for key in (*_FUNCTIONS, *optional):
            digest.update(f"|{key}".encode())
            _take(getattr(definition, key, None), digest, seen)
    except _Unknown:
        digest.update(uuid.uuid4().bytes)
    return digest.hexdigest()


class _Unknown(Exception):
    """A value whose content cannot be read."""


def _root(value: Any) -> str:
    """Top package of a module, or of what was defined in one; empty if unknown."""
    if isinstance(value, np.ufunc):
        return "numpy"
    name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return name.partition(".")[0] if isinstance(name, str) else ""


def _known(value: Any) -> str:
    """Module of a library's object, whose name says what it is."""
    if _root(value) not in _LIBRARIES:
        raise _Unknown
    return str(getattr(value, "__module__", None) or "")


def _take(value: Any, digest: Any, seen: dict[int, tuple[int, Any]]) -> None:
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        digest.update(f"{type(value).__name__}{value!r};".encode())
    elif isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufc":
        digest.update(f"{value.dtype.str}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, ModuleType | BuiltinFunctionType | np.ufunc | type):
        digest.update(f"{_known(value)}.{value.__name__};".encode())
    elif id(value) in seen:
        digest.update(f"again {seen[id(value)][0]};".encode())
    elif isinstance(value, list | tuple):
        seen[id(value)] = len(seen), value
        digest.update(f"{type(value).__name__}{len(value)}".encode())
        for item in value:
            _take(item, digest, seen)
    elif isinstance(value, Mapping):
        seen[id(value)] = len(seen), value
        _take([part for pair in value.items() for part in pair], digest, seen)
    else:
        seen[id(value)] = len(seen), value
        _take_function(value, digest, seen)


def _take_function(value: Any, digest: Any, seen: dict[int, tuple[int, Any]]) -> None:
    """A plain function, one that numba compiled, a partial one, or a method of a module."""
    if hasattr(value, "py_func"):
        digest.update(b"compiled")
        return _take(value.py_func, digest, seen)
    if hasattr(value, "func") and hasattr(value, "keywords"):
        return _take([value.func, list(value.args), dict(value.keywords)], digest, seen)
    if not isinstance(value, FunctionType) or _root(value) in _LIBRARIES:
        digest.update(f"{_known(value)}.{getattr(value, '__qualname__', '')};".encode())
        return None
    _take_code(value.__code__, digest)
    try:
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
    except ValueError:  # not filled yet
        raise _Unknown from None
    named = {
        name: value.__globals__[name]
        for name in sorted(_names(value.__code__))
        if name in value.__globals__
    }
    return _take([value.__defaults__, dict(value.__kwdefaults__ or {}), cells, named], digest, seen)


def _take_code(code: CodeType, digest: Any) -> None:
    digest.update(code.co_code + repr((code.co_names, code.co_varnames)).encode())
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _take_code(constant, digest)
        else:
            # A set of constants has no order.
            fixed = sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant
            digest.update(repr(fixed).encode())


def _names(code: CodeType) -> set[str]:
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, CodeType)]
    return set(code.co_names).union(*inner)
