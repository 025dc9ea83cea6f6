"""Names that were meant: what an error offers in place of a name that is unknown."""

import difflib
from collections.abc import Iterable
from itertools import islice

from newmark_cli.support.retired import RETIRED

#: Names that an error compares with what was given, and that it lists.
_MOST_COMPARED = 2_000
_MOST_LISTED = 40


def nearest(name: object, allowed: Iterable[str]) -> str:
    """Text that offers the nearest allowed name and lists all of them, if they are not many."""
    allowed = [_short_name(n) for n in islice(allowed, _MOST_COMPARED)]
    beside, instead = RETIRED.get(name, ("", "")) if isinstance(name, str) else ("", "")
    if beside in allowed:
        return f"; it is gone: {instead}"
    close = closest(name, allowed)
    hint = f"; did you mean {close!r}?" if close else ";"
    listed = [*allowed[:_MOST_LISTED], *(["…"] if len(allowed) > _MOST_LISTED else [])]
    return f"{hint} allowed: {', '.join(listed) or 'none'}"


def closest(name: object, allowed: Iterable[str]) -> str | None:
    """The allowed name that was probably meant, if any; case and kind of hyphen do not matter."""
    if not isinstance(name, str):
        return None
    names = {_folded(n): n for n in islice(allowed, _MOST_COMPARED)}
    close = difflib.get_close_matches(_folded(_short_name(name)), names, n=1)
    return names[close[0]] if close else None


def degrees_of_freedom(number: int) -> str:
    """So many of them, in words."""
    return f"{number} degree{'s' * (number != 1)} of freedom"


def _folded(name: str) -> str:
    return name.casefold().replace("_", "-").replace(" ", "-")


def _short_name(name: str) -> str:
    return name if len(name) <= 60 else name[:59] + "…"
