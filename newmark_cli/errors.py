"""Errors that say what to mend: the base of what the package raises on purpose."""


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
        newmark_cli.errors.ArgumentError: h must be positive, given -0.001
    """


class ArgumentError(InputError):
    """An argument of a function of the library cannot be used: type, shape, unit or name.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.march("pendulum", h=1e-3)
        Traceback (most recent call last):
        ...
        newmark_cli.errors.ArgumentError: t_end or steps: give one of them
    """


class ResultsError(InputError):
    """The results folder or a file in it cannot be used."""


class ExecutorError(Exception):
    """What runs the cells is gone; what had finished is kept."""


_LONGEST = 1_000


def one_line(text: str) -> str:
    """Text as a terminal may show it: one line, not long, no control characters."""
    text = " ".join(text[: 2 * _LONGEST].split())
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"
