"""The one kind of error that is the user's to mend."""


class InputError(ValueError):
    """Input cannot be used; the text is one line that says what and where.

    The command line prints it and exits with code 2.
    """


class ExecutorError(Exception):
    """What runs the cells is gone; what had finished is kept."""
