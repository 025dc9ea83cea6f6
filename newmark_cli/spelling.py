"""Names that were meant: what an error offers in place of a name that is unknown."""

import difflib
from collections.abc import Iterable
from itertools import islice

#: Names that an error compares with what was given, and that it lists.
_MOST_COMPARED = 2_000
_MOST_LISTED = 40


def nearest(given: object, allowed: Iterable[str]) -> str:
    """Text that offers the nearest allowed name and lists all of them, if they are not many."""
    allowed = [_short_name(name) for name in islice(allowed, _MOST_COMPARED)]
    word = _short_name(given) if isinstance(given, str) else ""
    close = difflib.get_close_matches(word, allowed, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    listed = [*allowed[:_MOST_LISTED], *(["…"] if len(allowed) > _MOST_LISTED else [])]
    return f"{hint} allowed: {', '.join(listed) or 'none'}"


def _short_name(name: str) -> str:
    return name if len(name) <= 60 else name[:59] + "…"
