"""Unexpected errors end in one line, a kept traceback, and an exit code of their own."""

import os
import re
import stat
import subprocess
import sys
from unittest import mock

from each import each
from warm import SCRIPT

LINE = re.compile(
    r"newmark-study: internal error: (.*); please report this, with the traceback in (.*)\n"
)

#: The command line, where a function does something else first.
SCRIPT_OF_BROKEN = """
import os
from newmark_cli.console import main
from newmark_cli.report.tables import theory

kept = theory.predict

def deep():
    deep()

def broken(*args, **options):
    exec(os.environ["CODE"])
    return kept(*args, **options)

theory.predict = broken
main()
"""


def broken(cli, code, *arguments, **variables):
    """Run `orders` with one of its functions broken, in a process that has imported them."""
    script = cli.write("broken.py", SCRIPT_OF_BROKEN)
    variables = {"CODE": code, "TMPDIR": str(cli.folder)} | variables
    with mock.patch.dict(os.environ, variables):
        return cli.warm.run(["orders", *arguments], cli.folder, script)


@each(
    ("code", "said", "traced"),
    [
        (r"raise ZeroDivisionError('a\nb')", "ZeroDivisionError: a b", "ZeroDivisionError: a\nb"),
        ("deep()", "RecursionError: maximum recursion depth exceeded", "RecursionError"),
        ("raise SystemExit(1)", "RuntimeError: SystemExit: 1", "SystemExit: 1"),
        ("raise BrokenPipeError(32, 'x')", "RuntimeError: BrokenPipeError: [Errno 32] x", "Broken"),
        # Not even the text of the error can be made.
        (
            "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()",
            "Odd: (its text cannot be shown: ZeroDivisionError)",
            "Odd",
        ),
    ],
)
def test_an_unexpected_error_is_one_line_and_70(cli, code, said, traced):
    """Never 1, which means a failed check; the traceback is in a file of the user only."""
    done = broken(cli, code)
    found = LINE.fullmatch(done.stderr)
    assert found, done.stderr
    assert (done.returncode, done.stdout, found[1]) == (70, "", said.strip().rstrip(":"))
    (kept,) = cli.folder.glob("newmark-study-traceback-*.txt")
    assert found[2] == str(kept)
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    text = kept.read_text()
    assert "['orders']" in text
    assert "Traceback (most recent call last):" in text
    assert traced in text


def test_an_import_that_fails_is_no_failed_check(tmp_path):
    """A damaged installation too: the commands cannot be imported."""
    (tmp_path / "click.py").write_text("raise ImportError('torn')\n")
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path)}
    done = subprocess.run([SCRIPT, "orders"], env=environment, text=True, capture_output=True)
    found = LINE.fullmatch(done.stderr)
    assert found, done.stderr
    assert (done.returncode, found[1]) == (70, "ImportError: torn")


def test_developers_get_the_traceback(cli):
    """With NEWMARK_STUDY_DEBUG=1 it is on stderr, before the same line and the same code."""
    done = broken(cli, "1 / 0", NEWMARK_STUDY_DEBUG="1")
    *trace, line = done.stderr.splitlines(keepends=True)
    assert "ZeroDivisionError: division by zero\n" in trace
    assert LINE.fullmatch(line)
    assert done.returncode == 70


@each(("code", "said"), [
    (r"import warnings; warnings.warn('two\nlines')", "two lines"),
    ("import logging; logging.getLogger('matplotlib.font').warning('no %s', 'font')",
     "matplotlib: no font"),
])  # fmt: skip
def test_what_libraries_print_is_a_line(cli, code, said):
    """Warnings and log messages; the command goes on."""
    done = broken(cli, code, "--form", "u-lambda")
    assert done.returncode == 0
    assert done.stdout.startswith("(u, λ) form, preconditioning none")
    assert done.stderr == f"newmark-study: warning: {said}\n"


def test_python_callers_keep_their_hooks(tmp_path):
    """`main` with arguments leaves warnings and streams as they were."""
    code = (
        "import logging, sys, warnings\n"
        "from newmark_cli.cli import main\n"
        "def state():\n"
        "    return warnings.showwarning, logging.lastResort, sys.stdout, sys.stderr\n"
        "before = state()\n"
        "try:\n    main(['orders', '--form', 'nothing'])\n"
        "except SystemExit as end:\n    print(end.code, state() == before)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "2 True\n"
