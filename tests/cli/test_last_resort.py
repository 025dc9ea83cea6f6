"""Unexpected errors end in a traceback, one line, and an exit code of their own."""

import os
import re
import subprocess
import sys
from unittest import mock

from command_line import SCRIPT
from each import each

from newmark_cli.report.tables import theory

LINE = re.compile(
    r"newmark-study: internal error: (.*); please report this, with the lines above\n"
)


def deep():
    deep()


def broken(cli, code, *arguments, **variables):
    """Run `orders`, where one of its functions does something else first."""
    kept = theory.predict

    def predict(*given, **options):
        exec(code, {"__name__": "broken", "deep": deep})
        return kept(*given, **options)

    with (
        mock.patch.dict(os.environ, variables),
        mock.patch.object(theory, "predict", predict),
    ):
        return cli.run("orders", *arguments)


@each(
    ("code", "said", "traced"),
    [
        (r"raise ZeroDivisionError('a\nb')", "ZeroDivisionError: a b", "ZeroDivisionError: a\nb"),
        ("deep()", "RecursionError: maximum recursion depth exceeded", "RecursionError"),
        ("raise SystemExit(1)", "SystemExit: 1", "SystemExit: 1"),
        ("raise EOFError", "EOFError", "EOFError"),
        # Not even the text of the error can be made.
        (
            "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()",
            "Odd: (its text cannot be shown: ZeroDivisionError)",
            "Odd",
        ),
    ],
)
def test_an_unexpected_error_has_its_traceback_and_70(cli, code, said, traced):
    """Never 1, which means a failed check."""
    done = broken(cli, code)
    *trace, line = done.stderr.splitlines(keepends=True)
    found = LINE.fullmatch(line)
    assert found, done.stderr
    assert (done.returncode, done.stdout, found[1]) == (70, "", said)
    assert trace[0] == "Traceback (most recent call last):\n"
    assert traced in "".join(trace)


def test_an_import_that_fails_is_no_failed_check(tmp_path):
    """A damaged installation too: the commands cannot be imported."""
    (tmp_path / "click.py").write_text("raise ImportError('torn')\n")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run([SCRIPT, "orders"], env=environment, text=True, capture_output=True)
    found = LINE.search(done.stderr)
    assert found, done.stderr
    assert (done.returncode, found[1]) == (70, "ImportError: torn")


def test_what_libraries_warn_of_is_a_line(cli):
    """The command goes on."""
    script = cli.write(
        "warned.py",
        "import warnings\n"
        "from newmark_cli.console import main\n"
        "from newmark_cli.report.tables import theory\n"
        "kept = theory.predict\n"
        "def predict(*given, **options):\n"
        "    warnings.warn('two\\nlines')\n"
        "    return kept(*given, **options)\n"
        "theory.predict = predict\n"
        "main()\n",
    )
    done = cli.python(script, "orders", "--form", "u-lambda")
    assert done.returncode == 0
    assert done.stdout.startswith("(u, λ) form, preconditioning none")
    assert done.stderr == "newmark-study: warning: two lines\n"


def test_python_callers_keep_their_hooks(tmp_path):
    """`main` with arguments leaves warnings and streams as they were."""
    code = (
        "import sys, warnings\n"
        "from newmark_cli.cli import main\n"
        "def state():\n"
        "    return warnings.showwarning, sys.stdout, sys.stderr\n"
        "before = state()\n"
        "try:\n    main(['orders', '--form', 'nothing'])\n"
        "except SystemExit as end:\n    print(end.code, state() == before)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "2 True\n"
