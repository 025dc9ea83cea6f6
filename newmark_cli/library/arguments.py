"""Arguments of public functions, checked: one clear sentence for each mistake."""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import wraps
from numbers import Integral, Real
from typing import Any, TypeVar, cast

import numpy as np

from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.arrays import shown as shown
from newmark_cli.support.errors import ArgumentError
from newmark_cli.support.spelling import nearest

#: Least step size of a march (s), and the inverse of its largest: 1/h⁴ is a number.
_LEAST_H = 1e-60


_Function = TypeVar("_Function", bound=Callable[..., Any])


def scaling_by_either_name(function: _Function) -> _Function:
    """Let a function take ``preconditioning`` for its argument ``scaling``, as configs write it."""

    @wraps(function)
    def called(*positional: Any, **named: Any) -> Any:
        if "preconditioning" in named:
            if "scaling" in named:
                raise ArgumentError(
                    "scaling and preconditioning are one argument: give one of them"
                )
            named["scaling"] = named.pop("preconditioning")
        return function(*positional, **named)

    return cast(_Function, called)


def number(name: str, value: Any, unit: str = "") -> float:
    """A finite number."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        raise ArgumentError(f"{name} must be a number{unit}, given {shown(value)}")
    if not np.isfinite(x := float(value)):
        raise ArgumentError(f"{name} must be finite, given {shown(value)}")
    return x


def positive(name: str, value: Any, unit: str = "") -> float:
    """A finite number above 0."""
    x = number(name, value, unit)
    if x <= 0:
        raise ArgumentError(f"{name} must be positive, given {shown(value)}")
    return x


def step_size(h: Any) -> float:
    """A step size (s) of which factors and floors are finite numbers."""
    size = positive("h", h, " of seconds")
    if not 1e-12 <= size <= 1e3:
        raise ArgumentError(f"h must be between 1e-12 and 1e3 seconds, given {size:g}")
    return size


def step_sizes(h: Any) -> Array:
    """(steps,) positive step sizes (s); (1,) of a number."""
    sizes = vector("h", h) if np.ndim(h) else np.array([positive("h", h, " of seconds")])
    if len(sizes) == 0 or not np.all(sizes > 0):
        raise ArgumentError(f"h: every step size must be positive, given {shown(h)}")
    for size in (sizes.min(), sizes.max()):
        if not _LEAST_H <= size <= 1 / _LEAST_H:
            raise ArgumentError(
                f"h is too large or too small, given {size:g}; allowed are {_LEAST_H:g} to "
                f"{1 / _LEAST_H:g} seconds"
            )
    return sizes


def count(name: str, value: Any, least: int = 0) -> int:
    """A whole number."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, Integral):
        raise ArgumentError(f"{name} must be a whole number, given {shown(value)}")
    if value < least:
        raise ArgumentError(f"{name} must be at least {least}, given {shown(value)}")
    return int(value)


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name} must be True or False, given {shown(value)}")
    return bool(value)


def one_of(name: str, value: Any, allowed: Collection[str]) -> str:
    """One of some names."""
    if not isinstance(value, str) or value not in allowed:
        raise ArgumentError(f"unknown {name} {shown(value)}{nearest(value, allowed)}")
    return value


def some_of(name: str, values: Any, allowed: Collection[str]) -> tuple[str, ...]:
    """Some of some names, as a list or a tuple."""
    if isinstance(values, str) or not isinstance(values, Collection):
        raise ArgumentError(f"{name} must be a list of names, given {shown(values)}")
    return tuple(one_of(f"name in {name}", item, allowed) for item in values)


def vector(name: str, values: Any, length: int | None = None) -> Array:
    """Finite numbers, of a length if there is one."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.empty(0, object)
    kind = array.dtype.kind
    if isinstance(values, list | tuple) and any(isinstance(x, bool | np.bool_) for x in values):
        kind = "b"  # NumPy takes True among numbers for 1
    if array.ndim != 1 or kind not in "iuf" or length not in (None, len(array)):
        wanted = f"an array of {length} numbers" if length is not None else "a list of numbers"
        raise ArgumentError(f"{name} must be {wanted}, given {shown(values)}")
    if not np.all(np.isfinite(array)):
        place = int(np.argmin(np.isfinite(array)))
        raise ArgumentError(f"{name} must be finite: component {place + 1} is {array[place]}")
    return array.astype(float)


def coordinates(name: str, entries: Any, problem: Problem, usual: Array) -> Array:
    """(n,) numbers, one for each coordinate, from an array or a mapping.

    A mapping has a number for each axis of a point, and one for a coordinate, by their names; what
    it does not name keeps its usual value.
    """
    if not isinstance(entries, Mapping):
        return vector(name, entries, problem.n)
    values = usual.copy()
    for key, value in entries.items():
        if key in problem.points:
            width = len(problem.axes)
            place = width * problem.points.index(key)
            values[place : place + width] = vector(f"{name}[{key!r}]", value, width)
        elif key in problem.coordinate_names:
            values[problem.coordinate_names.index(key)] = number(f"{name}[{key!r}]", value)
        else:
            known: Sequence[str] = (*problem.points, *problem.coordinate_names)
            raise ArgumentError(
                f"{name}: unknown point or coordinate {shown(key)}{nearest(key, known)}"
            )
    return values
