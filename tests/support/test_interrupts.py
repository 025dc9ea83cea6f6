"""Ctrl-C, SIGTERM and SIGHUP: when they come, what they leave, and what is said of them."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import pytest
from command_line import SCRIPT
from conftest import ENDINGS, LONG, require_ended, wait_for_cells, wait_until, write_swings

from newmark_cli.support import interrupts


def python(code, **options):
    """Run a script that has `main`, `interrupts` and what it needs to signal itself."""
    head = "import os, signal, sys, time\nfrom newmark_cli.support import interrupts\n"
    return subprocess.run(
        [sys.executable, "-c", head + textwrap.dedent(code)],
        capture_output=True, text=True, timeout=60, **options,
    )  # fmt: skip


def test_interrupts_while_modules_are_imported(tmp_path):
    """From the first import of a command on: one line, and the code of the signal."""
    assert "from newmark_cli.console import main" in SCRIPT.read_text()
    code = """
    class Finder:
        def find_spec(name, path, target=None):
            if name == "click":
                os.kill(os.getpid(), signal.SIGTERM)
    sys.meta_path.insert(0, Finder)
    from newmark_cli.console import main
    assert "click" not in sys.modules and "newmark_cli.cli" not in sys.modules
    sys.argv[1:] = ["run", "pendulum-u"]
    main()
    """
    done = python(code, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (143, "newmark-study: terminated\n")
    assert not list(tmp_path.iterdir())


def test_interrupts_in_the_users_code(cli):
    """They are no fault of the code, wherever it is when they come, and do not wait for it."""
    write_swings(cli, "")
    code = "import time\ndef swing(what):\n    open('inside', 'w').close()\n    time.sleep(3600)\n"
    cli.write("mine.py", code)
    run = cli.start("run", "swings.yaml", "--allow-code", start_new_session=True)
    wait_until((cli.folder / "inside").exists)
    os.killpg(run.pid, signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert (run.returncode, errors) == (130, "newmark-study: interrupted\n")


def test_postponed_interrupts_wait():
    """What is begun is completed first, whatever is nested in it; then the process ends."""
    done = python("""
    interrupts.catch()
    interrupts.Line.after = lambda: "; 3 cells"
    try:
        with interrupts.postponed():
            with interrupts.postponed():
                signal.raise_signal(signal.SIGINT)
            print("completed")
        print("never here")
    finally:
        print("nor here")
    """)
    assert (done.returncode, done.stdout) == (130, "completed\n")
    assert done.stderr == "newmark-study: interrupted; 3 cells\n"


def test_what_must_be_closed_is():
    """Contexts of libraries are; a second signal does not wait.  A terminal is given back first."""
    done = python("""
    interrupts.catch()
    interrupts.Line.before = "restored "
    with interrupts.raising():
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            print("closed")
            signal.raise_signal(signal.SIGINT)
            print("never here")
    """)
    assert (done.returncode, done.stdout) == (130, "closed\n")
    assert done.stderr == "restored newmark-study: interrupted\n"


def test_callers_in_python_keep_their_handlers():
    """`main` with arguments leaves handlers alone, and runs in any thread."""
    handlers = [signal.getsignal(number) for number in ENDINGS]
    from newmark_cli.cli import main

    codes = []

    def call():
        with pytest.raises(SystemExit) as ending:
            main(["--version"])
        codes.append(ending.value.code)

    call()
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert codes == [0, 0]
    assert [signal.getsignal(number) for number in ENDINGS] == handlers
    assert interrupts.NAMES == ENDINGS


def test_ignored_signals_stay_ignored(cli):
    """Under nohup, or in the background of a script, only SIGTERM ends a run."""
    write_swings(cli, "hang")
    ignored = (signal.SIGINT, signal.SIGHUP)

    def ignore():
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)

    run = cli.start("run", "swings.yaml", "--allow-code", preexec_fn=ignore,
                    start_new_session=True)  # fmt: skip
    wait_until((cli.folder / "hangs").exists)
    for number in ignored:
        run.send_signal(number)
    time.sleep(0.5)
    assert run.poll() is None
    os.killpg(run.pid, signal.SIGTERM)
    _, errors = run.communicate(timeout=60)
    assert len(errors.splitlines()) == 1, errors
    require_ended(run, signal.SIGTERM, errors, 0, 1)


def test_a_forced_run_promises_nothing(cli):
    """The same command would begin again: the line tells what is kept, and not to repeat it."""
    cli.write("long.yaml", LONG)
    run = cli.start("run", "long.yaml", "--force", "--jobs", 1)
    wait_for_cells(cli.folder / "results", 2)
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    kept = len(list((cli.folder / "results/cells").glob("*.json")))
    assert errors == f"newmark-study: interrupted; {kept} of 24 cells are cached\n"
    assert run.returncode == 130
