"""Who is told that code is being compiled, which takes a minute the first time."""

from collections.abc import Callable

_listeners: list[Callable[[str], None]] = []


def tell(listener: Callable[[str], None]) -> None:
    """Hand the next announcement to a listener, in place of the one before."""
    _listeners[:] = [listener]


def begins() -> None:
    """Announce, once, that something is compiled."""
    if _listeners:
        _listeners.pop()("compiling; this is needed once, and takes up to a minute")
