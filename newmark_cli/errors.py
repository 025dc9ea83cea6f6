"""The one kind of error that is the user's to mend."""


class InputError(ValueError):
    """Input cannot be used; the text is one line that says what and where.

    The command line prints it and exits with code 2.
    """


class ExecutorError(Exception):
    """What runs the cells is gone; what had finished is kept."""


_LONGEST = 1_000


def one_line(text: str) -> str:
    """Text as a terminal may show it: one line, not long, no control characters."""
    text = " ".join(text[: 2 * _LONGEST].split())
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def described(error: BaseException) -> str:
    """Kind and text of an error in one line, whatever its text does when it is asked for."""
    try:
        text = "".join(("", str(error)))  # no subclass of str
    except BaseException as failure:
        text = f"(its text cannot be shown: {type(failure).__name__})"
    return one_line(f"{type(error).__name__}: {text}".rstrip(": "))
