"""Commands in processes of their own: streams, encodings, imports, and unexpected errors."""

import contextlib
import io
import json
import os
import re
import subprocess
import sys
import warnings
from unittest import mock

import pytest
from command_line import SCRIPT
from conftest import SWING

from newmark_cli.cli import main
from newmark_cli.report.tables import theory

A = """\
study: a
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 1
expect: [{measure: correction, at_least: 1.0e-99}]
"""


@contextlib.contextmanager
def unread():
    """A pipe that nobody reads any more."""
    reads, writes = os.pipe()
    os.close(reads)
    with open(writes, "wb", buffering=0) as pipe:
        yield pipe


@contextlib.contextmanager
def full():
    """A device without space."""
    with open("/dev/full", "wb", buffering=0) as device:
        yield device


def ended(cli, *command, **streams):
    """Exit code of a process, and what it printed where that is read."""
    run = cli.start(*command, **streams)
    return run.communicate(timeout=120), run.returncode


def test_streams_that_take_nothing(cli):
    """A full disk is one line; nobody's reading ends a command as in a pipe, and never with 1."""
    with full() as out:
        told = "newmark-study: standard output: No space left on device\n"
        assert ended(cli, "--help", stdout=out) == ((None, told), 2)
    with unread() as out:
        assert ended(cli, "--help", stdout=out) == ((None, ""), 141)
    cli.write("a.yaml", A)
    with full() as device, io.TextIOWrapper(device, write_through=True) as err:
        done = cli.run("run", "a.yaml", "-v", stderr=err)
    assert done.returncode == 0
    assert done.stdout == "a: 1 ok -> results/a.csv\n", "a run goes on without its messages"


def test_closed_streams_change_nothing():
    """What cannot be printed is not; the other stream and the exit code are as usual."""
    for command, code, printed in (
        ("--version 2>&-", 0, "stdout"),
        ("polt >&-", 2, "stderr"),
    ):
        done = subprocess.run(
            ["bash", "-c", f"{SCRIPT} {command}"], capture_output=True, text=True, timeout=120
        )
        assert done.returncode == code
        assert [name for name in ("stdout", "stderr") if getattr(done, name)] == [printed]


def test_encodings_without_greek(cli):
    """λ is escaped; JSON stays JSON of the same values."""

    def in_latin(*command):
        latin = io.TextIOWrapper(io.BytesIO(), "latin-1", write_through=True)
        done = cli.run(*command, stdout=latin)
        assert (done.returncode, done.stderr) == (0, "")
        return latin.buffer.getvalue()

    told = in_latin("orders", "--form", "u-lambda", "--preconditioning", "none")
    assert told.startswith(b"(u, \\u03bb) form, preconditioning none\n")
    listed = cli("list", "--json").stdout
    assert "λ" in listed
    assert json.loads(in_latin("list", "--json")) == json.loads(listed)


def test_modules_of_the_current_folder_are_not_imported(cli):
    """Not even by `python -m`, which has it on its path, once it is this package that runs.

    Of the console script `test_nothing_of_others_is_imported` says the same.
    """
    for name in ("threading", "subprocess", "numpy", "yaml", "click", "rich"):
        cli.write(f"{name}.py", 'raise SystemExit("planted")\n')
    cli.write("own.py", SWING)
    cli.write("own.yaml", A.replace("pendulum", '{python: "own.py:swing"}'))
    done = subprocess.run(
        [sys.executable, "-m", "newmark_cli", "validate", "own.yaml", "--allow-code"],
        cwd=cli.folder, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


# -- unexpected errors end in a traceback, one line, and an exit code of their own ---------------

LINE = re.compile(
    r"newmark-study: internal error: (.*); please report this, with the lines above\n"
)


def deep(*given, **options):
    deep()


class OddError(Exception):
    """One whose text cannot be made."""

    def __str__(self):
        return 1 / 0


@pytest.mark.parametrize(
    ("broken", "said", "traced"),
    [
        (EOFError("a\nb"), "EOFError: a b", "EOFError: a\nb"),
        (deep, "RecursionError: maximum recursion depth exceeded", "RecursionError"),
        (SystemExit(1), "SystemExit: 1", "SystemExit: 1"),
        (OddError(), "OddError: (its text cannot be shown: ZeroDivisionError)", "OddError"),
    ],
)
def test_an_unexpected_error_has_its_traceback_and_70(cli, broken, said, traced):
    """Never 1, which means a failed check."""
    with mock.patch.object(theory, "predict", side_effect=broken):
        done = cli.run("orders")
    *trace, line = done.stderr.splitlines(keepends=True)
    found = LINE.fullmatch(line)
    assert found, done.stderr
    assert (done.returncode, done.stdout, found[1]) == (70, "", said)
    assert trace[0] == "Traceback (most recent call last):\n"
    assert traced in "".join(trace)


def test_an_import_that_fails_is_no_failed_check(cli):
    """A damaged installation too: the commands cannot be imported."""
    cli.write("click.py", "raise ImportError('torn')\n")
    environment = os.environ | {"PYTHONPATH": str(cli.folder)}
    done = subprocess.run([SCRIPT, "orders"], env=environment, text=True, capture_output=True)
    found = LINE.search(done.stderr)
    assert found, done.stderr
    assert (done.returncode, found[1]) == (70, "ImportError: torn")


def test_what_libraries_warn_of_is_a_line(cli):
    """The command goes on."""
    predict = theory.predict

    def warning(*given, **options):
        warnings.warn("two\nlines", stacklevel=2)
        return predict(*given, **options)

    with mock.patch.object(theory, "predict", side_effect=warning):
        done = cli("orders", "--form", "u-lambda")
    assert done.stdout.startswith("(u, λ) form, preconditioning none")
    assert done.stderr == "newmark-study: warning: two lines\n"


def test_python_callers_keep_their_hooks(capsys):
    """`main` with arguments leaves warnings and streams as they were."""
    before = warnings.showwarning, sys.stdout, sys.stderr
    with pytest.raises(SystemExit) as ending:
        main(["orders", "--form", "nothing"])
    assert ending.value.code == 2
    assert (warnings.showwarning, sys.stdout, sys.stderr) == before
