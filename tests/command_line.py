"""The command line: in this process, or started in one of its own."""

import contextlib
import io
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from newmark_cli.cli import commands, main

#: The console script of the environment that runs the tests.
SCRIPT = Path(sys.executable).with_name("newmark-study")


def invoke(arguments, folder, stdout=None, stderr=None):
    """Run a command in this process, in a folder; what it did, like `subprocess.run` with text.

    Args:
        arguments: Of the command line.
        folder: Where it runs.
        stdout: A text stream that it writes to, which is not read then.
        stderr: The same.
    """
    arguments = [*map(str, arguments)]
    kept = [io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2)]
    out, err = stdout or kept[0], stderr or kept[1]
    with (
        contextlib.chdir(folder),
        mock.patch.multiple(sys, stdout=out, stderr=err, __stdout__=out),
        mock.patch.object(sys, "argv", [str(SCRIPT), *arguments]),
        warnings.catch_warnings(),
    ):
        # As `main` does in a process of its own.
        commands.prepare()
        warnings.resetwarnings()
        for category in (DeprecationWarning, PendingDeprecationWarning, ResourceWarning):
            warnings.simplefilter("ignore", category)
        try:
            code = main(arguments)
        except SystemExit as ending:
            code = ending.code
    told = [stream.buffer.getvalue().decode() for stream in kept]
    return subprocess.CompletedProcess(arguments, code, *told)


@dataclass
class CommandLine:
    """Runs newmark-study in a folder of its own."""

    folder: Path

    def __call__(self, *arguments, code=0):
        """Run it, assert the exit code, and return what it printed."""
        done = self.run(*arguments)
        assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done

    def run(self, *arguments, **streams):
        """Run it, whatever its exit code; the streams are those of `invoke`."""
        return invoke(arguments, self.folder, **streams)

    def start(self, *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options):
        """Start it in a process of its own, and do not wait for it."""
        return subprocess.Popen(
            [SCRIPT, *map(str, arguments)], cwd=self.folder, text=True,
            stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, **options,
        )  # fmt: skip

    def python(self, script, *arguments):
        """Run a script of Python in a process of its own, whatever its exit code."""
        return subprocess.run(
            [sys.executable, script, *map(str, arguments)], cwd=self.folder, text=True,
            capture_output=True, timeout=200,
        )  # fmt: skip

    def refused(self, *arguments):
        """Run it, assert that it refuses in one line with exit code 2; return the line."""
        done = self(*arguments, code=2)
        lines = done.stderr.splitlines()
        assert len(lines) == 1, done.stderr
        assert lines[0].startswith("newmark-study: ")
        assert done.stdout == ""
        return lines[0]

    def write(self, name, text):
        """Write a file in the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path
