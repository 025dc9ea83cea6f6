"""Whatever goes wrong besides ends in one line, a kept traceback, and a code of its own."""

import os
import re
import stat
import subprocess
import sys
from unittest import mock

from each import each
from warm import SCRIPT

#: Replaces a function of a module when that is imported: FAULT is module:function:code.
BROKEN = """
import importlib.util, os, sys

module, name, code = os.environ["FAULT"].split(":", 2)

def deep():
    deep()

class Finder:
    def find_spec(found, path, target=None):
        if found != module:
            return None
        sys.meta_path.remove(Finder)
        spec = importlib.util.find_spec(found)
        execute = spec.loader.exec_module
        def broken(*args, **options):
            exec(code)
            return kept(*args, **options)
        def load(loaded):
            global kept
            execute(loaded)
            kept = getattr(loaded, name)
            setattr(loaded, name, broken)
        spec.loader.exec_module = load
        return spec

sys.meta_path.insert(0, Finder)
"""
LINE = re.compile(
    r"newmark-study: internal error: (.*); please report this, with the traceback in (.*)\n"
)


def broken_cold(folder, fault, *arguments, **environment):
    """Run a command with a function that is broken from outside, as Python imports it."""
    site = folder / "site"
    site.mkdir(exist_ok=True)
    (site / "sitecustomize.py").write_text(BROKEN)
    variables = {
        "PYTHONPATH": str(site), "FAULT": fault, "XDG_STATE_HOME": str(folder / "state"),
    }  # fmt: skip
    return subprocess.run(
        [SCRIPT, *arguments], env=os.environ | variables | environment, text=True,
        capture_output=True, cwd=folder, timeout=100,
    )  # fmt: skip


#: The command line, where a function does something else first.
SCRIPT_OF_BROKEN = """
import os
from newmark_cli.console import main
from newmark_cli.report import theory

kept = theory.predict

def deep():
    deep()

def broken(*args, **options):
    exec(os.environ["CODE"])
    return kept(*args, **options)

theory.predict = broken
main()
"""


def broken(cli, code, *arguments):
    """Run `orders` with one of its functions broken, in a process that has imported them."""
    script = cli.write("broken.py", SCRIPT_OF_BROKEN)
    variables = {"CODE": code, "XDG_STATE_HOME": str(cli.folder / "state")}
    with mock.patch.dict(os.environ, variables):
        return cli.warm.run(["orders", *arguments], cli.folder, script)


@each(
    ("code", "said", "traced"),
    [
        (r"raise ZeroDivisionError('a\nb')", "ZeroDivisionError: a b", "ZeroDivisionError: a\nb"),
        ("raise MemoryError", "MemoryError", "MemoryError"),
        ("deep()", "RecursionError: maximum recursion depth exceeded", "RecursionError"),
        ("raise SystemExit(1)", "RuntimeError: SystemExit: 1", "SystemExit: 1"),
        ("raise EOFError", "RuntimeError: EOFError: ", "EOFError"),
        ("raise BrokenPipeError(32, 'x')", "RuntimeError: BrokenPipeError: [Errno 32] x", "Broken"),
        ("raise OSError(12, 'no memory')", "OSError: [Errno 12] no memory", "no memory"),
        (r"raise KeyError('\ud800')", r"KeyError: '\ud800'", "KeyError"),
        # Not even the text of the error can be made.
        ("raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()", "Odd", "Odd"),
    ],
)
def test_an_unexpected_error_is_one_line_and_70(cli, code, said, traced):
    """Never 1, which means a failed check; the traceback is in a file of the user only."""
    done = broken(cli, code)
    found = LINE.fullmatch(done.stderr)
    assert found, done.stderr
    assert (done.returncode, done.stdout, found[1]) == (70, "", said.strip().rstrip(":"))
    (kept,) = (cli.folder / "state/newmark-study").iterdir()
    assert found[2] == str(kept)
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    assert stat.S_IMODE(kept.parent.stat().st_mode) == 0o700
    text = kept.read_text()
    assert "['orders']" in text
    assert "Traceback (most recent call last):" in text
    assert traced in text


def test_an_import_that_fails_is_no_failed_check(tmp_path):
    """A damaged installation too: the commands cannot be imported."""
    done = broken_cold(
        tmp_path, "newmark_cli.spelling:nearest:pass", "orders", PYTHONPATH=str(tmp_path / "odd")
    )
    assert done.returncode == 0
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd/click.py").write_text("raise ImportError('torn')\n")
    done = broken_cold(
        tmp_path, "newmark_cli.spelling:nearest:pass", "orders", PYTHONPATH=str(tmp_path / "odd")
    )
    found = LINE.fullmatch(done.stderr)
    assert found, done.stderr
    assert (done.returncode, found[1]) == (70, "ImportError: torn")


def test_where_nothing_can_be_kept_the_line_says_so(cli):
    """A state folder that is a file, and temporary files nowhere."""
    (cli.folder / "state").write_text("")
    everywhere = "import tempfile, os; tempfile.tempdir = '/dev/null'; raise IndexError"
    done = broken(cli, everywhere)
    assert done.stderr == (
        "newmark-study: internal error: IndexError; please report this; the traceback could not "
        "be kept, NEWMARK_STUDY_DEBUG=1 prints it\n"
    )
    assert done.returncode == 70


def test_only_the_last_tracebacks_stay(cli):
    """Where something fails again and again the folder does not grow."""
    folder = cli.folder / "state/newmark-study"
    folder.mkdir(parents=True)
    for i in range(30):
        (folder / f"traceback-{i}.txt").write_text("old")
        os.utime(folder / f"traceback-{i}.txt", (i, i))
    (folder / "mine.txt").write_text("stays")
    broken(cli, "1 / 0")
    names = {file.name for file in folder.iterdir()}
    assert len(names) == 21
    assert "mine.txt" in names
    assert "traceback-29.txt" in names
    assert "traceback-10.txt" not in names


def test_a_link_in_the_place_of_the_state_folder_is_not_written_through(tmp_path):
    """Names cannot be guessed and files are new: what links point to stays as it is."""
    target = tmp_path / "target"
    target.write_text("mine")
    (tmp_path / "state").mkdir()
    (tmp_path / "state/newmark-study").symlink_to(target)
    done = broken_cold(
        tmp_path, "newmark_cli.report.theory:predict:1 / 0", "orders", TMPDIR=str(tmp_path)
    )
    found = LINE.fullmatch(done.stderr)
    assert found, done.stderr
    assert found[2].startswith(f"{tmp_path}/traceback-")
    assert target.read_text() == "mine"


def test_developers_get_the_traceback(tmp_path):
    """With NEWMARK_STUDY_DEBUG=1 it is on stderr, before the same line and the same code."""
    done = broken_cold(
        tmp_path, "newmark_cli.report.theory:predict:1 / 0", "orders", NEWMARK_STUDY_DEBUG="1"
    )
    *trace, line = done.stderr.splitlines(keepends=True)
    assert "ZeroDivisionError: division by zero\n" in trace
    assert LINE.fullmatch(line)
    assert done.returncode == 70


@each(
    ("code", "said"),
    [
        (r"import warnings; warnings.warn('two\nlines')", "two lines"),
        (
            "import logging; logging.getLogger('matplotlib.font').warning('no %s', 'font')",
            "matplotlib: no font",
        ),
        (
            "import threading; t = threading.Thread(target=lambda: 1 / 0); t.start(); t.join()",
            "internal error: ZeroDivisionError: division by zero; please report this, with the ",
        ),
        (
            "type('Odd', (), {'__del__': lambda self: 1 / 0})()",
            "internal error: ZeroDivisionError: division by zero; please report this, with the ",
        ),
    ],
)
def test_what_libraries_print_is_a_line(cli, code, said):
    """Warnings, log messages, errors of threads and finalizers; the command goes on."""
    done = broken(cli, code, "--form", "u-lambda")
    assert done.returncode == 0
    assert done.stdout.startswith("(u, λ) form, preconditioning none")
    lines = set(re.sub(r"traceback-\w+", "", done.stderr).splitlines())
    assert len(lines) == 1, done.stderr
    assert lines.pop().startswith(f"newmark-study: warning: {said}")


def test_what_python_says_at_the_end_is_silent(tmp_path):
    """An error of a finalizer when the command has come to its end."""
    code = (
        "import sys; sys.kept = type('Odd', (), {'__del__': lambda self: 1 / 0})();"
        "import atexit; atexit.register(lambda: delattr(sys, 'kept'))"
    )
    one = ("--form", "u-lambda", "--preconditioning", "none")
    done = broken_cold(tmp_path, f"newmark_cli.report.theory:predict:{code}", "orders", *one)
    assert (done.returncode, done.stderr) == (0, "")


def test_python_callers_keep_their_hooks(tmp_path):
    """`main` with arguments leaves warnings, threads and streams as they were."""
    code = (
        "import sys, threading, warnings\n"
        "from newmark_cli.cli import main\n"
        "def state():\n"
        "    return (warnings.showwarning, threading.excepthook, sys.unraisablehook,\n"
        "            sys.stdout, sys.stderr)\n"
        "before = state()\n"
        "try:\n    main(['orders', '--form', 'nothing'])\n"
        "except SystemExit as end:\n    print(end.code, state() == before)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "2 True\n"
