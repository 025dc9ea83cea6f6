"""Colours on their way to a terminal, which no text from a file can imitate.

Control characters are escaped in the last moment, when a table has its colours already.
So tables carry marks in place of the escape character.  The marks are drawn by lot in
each process: nobody can have written one into a file.
"""

import os

_ESCAPE = "\x1b"
_MARK = f"<{os.urandom(16).hex()}>"


def marked(text: str) -> str:
    """Text with a mark in place of each escape character."""
    return text.replace(_ESCAPE, _MARK)


def coloured(text: str) -> str:
    """Text with an escape character in place of each mark."""
    return text.replace(_MARK, _ESCAPE)
