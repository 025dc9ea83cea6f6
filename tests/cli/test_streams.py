"""Standard streams that are closed, full, unread, or of an encoding without λ."""

import contextlib
import json
import os
import subprocess

from command_line import SCRIPT
from each import each

A = """\
study: a
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 1
"""

FULL = "newmark-study: standard output: No space left on device\n"


@contextlib.contextmanager
def unread():
    """A pipe that nobody reads any more."""
    reads, writes = os.pipe()
    os.close(reads)
    yield writes
    os.close(writes)


def shell(folder, command, **environment):
    """A command line in bash; its exit code is that of newmark-study."""
    return subprocess.run(
        ["bash", "-c", f"{SCRIPT} {command}; exit ${{PIPESTATUS[0]}}"], cwd=folder, text=True,
        capture_output=True, timeout=60, env=os.environ | environment,
    )  # fmt: skip


@each("command", ["list", "--help"])
def test_a_full_disk_is_one_line(cli, command):
    """Stdout on a device without space."""
    with open("/dev/full", "wb") as full:
        run = cli.start(*command.split(), stdout=full.fileno())
    assert run.communicate(timeout=60)[1] == FULL
    assert run.returncode == 2


@each("command", ["orders", "--help"])
def test_output_that_nobody_reads_ends_a_command_silently(cli, command):
    """As other tools end in a pipe: with 141, and never 1."""
    with unread() as pipe:
        run = cli.start(*command.split(), stdout=pipe)
    assert run.communicate(timeout=60)[1] == ""
    assert run.returncode == 141


@each("stream", ["/dev/full", "unread"])
def test_a_run_goes_on_without_its_messages(cli, stream):
    """Where stderr cannot be written."""
    cli.write("a.yaml", A)
    with open("/dev/full", "wb") if stream == "/dev/full" else unread() as lost:
        descriptor = lost if stream == "unread" else lost.fileno()
        run = cli.start("run", "a.yaml", "-v", stderr=descriptor)
    assert run.communicate(timeout=60)[0] == "a: 1 ok -> results/a.csv\n"
    assert run.returncode == 0


@each("closed", [">&-", "2>&-"])
def test_closed_streams_change_nothing(cli, closed):
    """What cannot be printed is not."""
    done = shell(cli.folder, f"orders --form nothing {closed}")
    assert done.returncode == 2
    for command in ("orders", "list"):
        done = shell(cli.folder, f"{command} {closed}")
        assert (done.returncode, done.stderr) == (0, "")


@each("encoding", ["latin-1", "cp1252"])
def test_encodings_without_greek(cli, encoding):
    """λ is escaped; JSON stays JSON of the same values."""
    environment = os.environ | {"PYTHONIOENCODING": encoding}

    def printed(*command):
        with (cli.folder / "printed").open("w+b") as file:
            run = cli.start(*command, stdout=file.fileno(), env=environment)
            assert (run.communicate(timeout=60)[1], run.returncode) == ("", 0)
            file.seek(0)
            return file.read()

    orders = ("orders", "--form", "u-lambda", "--preconditioning", "none")
    text = printed(*orders)
    assert text.decode(encoding).startswith("(u, \\u03bb) form, preconditioning none\n")
    if encoding == "latin-1":
        done = subprocess.run([SCRIPT, *orders], capture_output=True, env=environment, timeout=60)
        assert (done.returncode, done.stdout, done.stderr) == (0, text, b"")
    listed = cli("list", "--json").stdout
    assert "λ" in listed
    assert json.loads(printed("list", "--json").decode(encoding)) == json.loads(listed)
