"""Standard streams that a command can write to, whatever they are.

A stream may be closed, a pipe that nobody reads any more, a file on a full disk, or of an
encoding that lacks λ.  None of these is an exception of the code that prints.
"""

import codecs
import io
import os
import sys
from typing import IO, Any

#: Exit code where nobody reads the output any more, like that of other tools in a pipe.
UNREAD = 141

#: What an encoding without it shows in its place; anything else as Python would write it.
_PLAIN = {
    "α": "alpha", "β": "beta", "γ": "gamma", "Δ": "Delta ", "ε": "epsilon", "λ": "lambda",
    "ρ": "rho", "σ": "sigma", "Φ": "Phi", "Γ": "Gamma", "δ": "delta", "→": "->", "←": "<-",
    "−": "-", "–": "-", "—": "-", "‖": "||", "…": "...", "≥": ">=", "≤": "<=", "≈": "~",
    "×": "x", "±": "+-", "·": ".", "∂": "d", "∞": "inf", "√": "sqrt", "⁻": "-", "²": "2",
    "‘": "'", "’": "'", "“": '"', "”": '"',
}  # fmt: skip


class OutputError(Exception):
    """What a command prints cannot be written; no `OSError`, of which click exits with 1.

    Attributes:
        unread: Whether it is a pipe that nobody reads any more.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output: {error.strerror}")
        self.unread = isinstance(error, BrokenPipeError)


class _Descriptor(io.FileIO):
    """A standard stream that discards everything after its first failed write."""

    _lost = False

    def write(self, data: Any) -> int:
        """Write bytes; raises `OutputError` where those of stdout cannot be written."""
        if not self._lost:
            try:
                return super().write(data)
            except OSError as error:
                self._lost = True
                if self.fileno() == 1:
                    raise OutputError(error) from None
        return memoryview(data).nbytes


def prepare() -> None:
    """Let the process print without exceptions but `OutputError`.

    What is wrong with stderr is nobody's loss: a run goes on without its messages.
    """
    codecs.register_error("newmark-study", _replaced)
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            # Or the next file that is opened would be taken for the stream.
            os.open(os.devnull, os.O_RDONLY if number == 0 else os.O_WRONLY)
    sys.stdout = _stream(sys.stdout, 1)
    sys.stderr = _stream(sys.stderr, 2)


def _stream(stream: IO[str] | None, number: int) -> io.TextIOWrapper:
    if stream is not None:
        stream.flush()
    if os.name == "nt" and isinstance(stream, io.TextIOWrapper) and stream.isatty():
        stream.reconfigure(errors="newmark-study")  # a console there takes text, not bytes
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(_Descriptor(number, "wb", closefd=False)),
        encoding=getattr(stream, "encoding", None) or "utf-8",
        errors="newmark-study",
        line_buffering=getattr(stream, "line_buffering", False) or number == 2,
        write_through=getattr(stream, "write_through", False),
    )


def _replaced(error: UnicodeError) -> tuple[str | bytes, int]:
    """Error handler: spell out letters that an encoding lacks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    escaped = (_PLAIN.get(c) or c.encode("ascii", "backslashreplace").decode() for c in lacking)
    return "".join(escaped), error.end
