"""The one place where commands print.

Names, descriptions and records come from files that anybody may have written.  Whatever
they hold, a terminal is shown text: no escape sequence, no text that runs backwards, and
no line that only looks like one of the command's.
"""

import os
import re
import sys

import click

from newmark_cli.support.errors import one_line, visible, visible_lines

_COLOUR = re.compile(r"(\x1b\[[0-9;]*m)")


def line(text: object = "") -> None:
    """Print one line; whatever would end it is escaped."""
    click.echo(visible(str(text)))


def lines(text: str) -> None:
    """Print several lines; the fields in them have gone through `visible`.

    Tables keep the colours that `newmark_cli.report.judging.text.text_table` gave them.
    """
    parts = _COLOUR.split(text)
    parts[::2] = map(visible_lines, parts[::2])
    click.echo("".join(parts))


def note(text: str) -> None:
    """Print one line to stderr; whatever would end it is escaped."""
    _aside(visible(text))


def complain(message: str) -> None:
    """Print one line of error, not longer than anybody reads."""
    _aside(f"newmark-study: {one_line(message)}")


def drop(stream: str) -> None:
    """Print no more to ``"stdout"`` or ``"stderr"``; nor does Python try again as it ends."""
    # The next file that is opened would be in the place of one that is closed.
    setattr(sys, stream, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115


def _aside(text: str) -> None:
    try:
        click.echo(text, err=True)
    except OSError:  # unread, or its disk is full: a run goes on without its messages
        drop("stderr")
