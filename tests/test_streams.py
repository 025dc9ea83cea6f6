"""Standard streams that are closed, full, unread, or of an encoding without λ."""

import json
import os
import subprocess

from each import each
from warm import SCRIPT

A = """\
study: a
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 1
"""


def shell(folder, command, **environment):
    """A command line in bash; its exit code is that of newmark-study."""
    return subprocess.run(
        ["bash", "-c", f"{SCRIPT} {command}; exit ${{PIPESTATUS[0]}}"], cwd=folder, text=True,
        capture_output=True, timeout=60, env=os.environ | environment,
    )  # fmt: skip


@each("command", ["list", "orders", "schema", "--help", "validate a.yaml"])
def test_a_full_disk_is_one_line(tmp_path, command):
    """Stdout on a device without space."""
    (tmp_path / "a.yaml").write_text(A)
    done = shell(tmp_path, f"{command} > /dev/full")
    assert done.stderr == "newmark-study: standard output: No space left on device\n"
    assert done.returncode == 2


@each("command", ["list", "orders", "schema", "--help"])
def test_output_that_nobody_reads_ends_a_command_silently(tmp_path, command):
    """As other tools end in a pipe: with 141, and never 1."""
    done = shell(tmp_path, f"{command} | (exec <&-)")
    assert (done.returncode, done.stderr) == (141, "")


@each("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing(tmp_path, closed):
    """What cannot be printed is not; files that are written do not take the streams' places."""
    done = shell(tmp_path, f"list {closed}")
    assert done.returncode == 0
    assert done.stderr == ""
    done = shell(tmp_path, f"orders --form nothing {closed}")
    assert done.returncode == 2
    if closed in (">&-", "2>&-"):
        return  # both together are harder
    done = shell(tmp_path, f"draw pendulum {closed}")
    assert done.returncode == 0
    svg = (tmp_path / "results/figures/pendulum.svg").read_text()
    assert svg.startswith("<?xml")
    assert "newmark-study" not in svg
    assert "figures/pendulum" not in svg


def test_messages_that_nobody_reads_do_not_end_a_run(cli, quick):
    """A run of hours goes on when what reads its stderr has gone."""
    done = shell(cli.folder, "run quick.yaml -v 2> /dev/full")
    assert (done.returncode, done.stdout) == (0, "quick: 4 ok -> results/quick.csv\n")
    done = shell(cli.folder, "run quick.yaml -v --force 2>&1 >/dev/null | (exec <&-)")
    assert done.returncode == 0


@each("encoding", ["latin-1", "cp1252", "iso8859-15"])
def test_encodings_without_greek(cli, encoding):
    """λ is spelled; JSON stays JSON of the same values."""
    done = subprocess.run(
        [SCRIPT, "orders", "--form", "u-lambda", "--preconditioning", "none"],
        capture_output=True, env=os.environ | {"PYTHONIOENCODING": encoding}, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode(encoding).startswith("(u, lambda) form, preconditioning none\n")

    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run([SCRIPT, "list", "--json"], capture_output=True, env=environment)
    assert done.returncode == 0
    listed = cli("list", "--json").stdout
    assert "λ" in listed
    assert json.loads(done.stdout.decode(encoding)) == json.loads(listed)
