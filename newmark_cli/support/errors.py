"""Errors that say what to mend, and text that a terminal may show."""

import sys
import warnings
from unicodedata import category


class NewmarkError(Exception):
    """Base of every error that the library raises on purpose.

    Its text is one line that says what is wrong, and what is allowed.

    Examples:
        >>> import newmark_cli as newmark
        >>> try:
        ...     newmark.problem("pendulm")
        ... except newmark.NewmarkError as error:
        ...     print(str(error).split(";")[0])
        unknown problem 'pendulm'
    """


class InputError(NewmarkError, ValueError):
    """Input cannot be used; the text is one line that says what and where.

    The command line prints it and exits with code 2.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.march("pendulum", h=-1e-3, t_end=1.0)
        Traceback (most recent call last):
        ...
        newmark_cli.support.errors.ArgumentError: h must be positive, given -0.001
    """


class ArgumentError(InputError):
    """An argument of a function of the library cannot be used: type, shape, unit or name.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.march("pendulum", h=1e-3)
        Traceback (most recent call last):
        ...
        newmark_cli.support.errors.ArgumentError: t_end or steps: give one of them
    """


class NewmarkWarning(UserWarning):
    """What is computed is as asked, but can hardly be what was meant.

    Its text is one line that says why.  The command line prints it once.

    Examples:
        To be silent where it is meant:

        >>> import warnings
        >>> import newmark_cli as newmark
        >>> half = newmark.march("pendulum", h=1e-2, t_end=1.0)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", newmark.NewmarkWarning)
        ...     rest = newmark.march("pendulum", h=1e-3, t_end=2.0, state=half.state)
    """


def warn(*messages: str) -> None:
    """Warn, at the line of whoever called the library."""
    level, frame = 1, sys._getframe()
    package = __name__.partition(".")[0]
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        level, frame = level + 1, frame.f_back
    for message in messages:
        warnings.warn(message, NewmarkWarning, stacklevel=level)


class ResultsError(InputError):
    """The results folder or a file in it cannot be used."""


class ExecutorError(Exception):
    """The executor is lost; finished cells are cached."""


_LONGEST = 1_000


def visible(text: str) -> str:
    """Text as a terminal may show it, in one line: what is not printed is escaped.

    That is control characters, line ends and separators, characters that change the
    direction of writing or have no width, and halves of surrogate pairs.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or category(c) == "Zs" else ascii(c)[1:-1] for c in text)


def visible_lines(text: str) -> str:
    """The same of several lines, between line feeds."""
    return "\n".join(map(visible, text.split("\n")))


def one_line(text: str) -> str:
    """The same, not long, blanks and line ends of any length as one blank."""
    text = visible(" ".join(text[: 2 * _LONGEST].split()))
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def described(error: BaseException) -> str:
    """Kind and text of an error in one line, whatever its text does when it is asked for."""
    try:
        text = "".join(("", str(error)))  # no subclass of str
    except BaseException as failure:
        text = f"(its text cannot be shown: {type(failure).__name__})"
    return one_line(f"{type(error).__name__}: {text}".rstrip(": "))
