"""The console script in forks of a process that has imported what its commands import.

A command takes a second or two to start, most of it imports; the suite runs hundreds.  Every
command still has a process of its own, from the script's first line to its exit code.  So has
user code that it runs: a fork, too, unless the command leads a session.  What
Python and libraries read from the environment as they start is that of the one process: the
seed of hashes, Numba's folder of compiled code, the kernel of the BLAS.  Only the last of a
process is left out, in which Python takes its modules apart; and no file waits for the disk,
as nobody pulls the plug.
"""

import atexit
import contextlib
import gc
import importlib
import json
import multiprocessing
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

from compiled import is_kept

from newmark_cli.support import apart, interrupts

#: The console script of the environment that runs the tests.
SCRIPT = Path(sys.executable).with_name("newmark-study")
#: The same without what no test looks at.
QUICKER = Path(__file__).with_name("quicker.py")

#: What many commands import, with what these import in turn.
MODULES = (
    "cli.commands",
    "cli.terminal",
    "advice.advising",
    "advice.jacobians",
    "newmark.engine",
    "problems.python_problem",
    "report.tables.check",
    "report.tables.compare",
    "report.drawing.draw_mechanism",
    "report.page",
    "report.tables.paper_tables",
    "report.drawing.plot",
    "report.tables.showing",
    "report.tables.theory",
    "running.runner",
    "study.catalogue",
    "study.compute",
    "study.motion",
    "study.schema",
)

#: A study that the process runs itself, of what most studies measure.
STUDY = """\
study: warm
problem: pendulum
form: u-lambda
preconditioning: none
h: 0.1
steps: 2
measure: [correction, condition, error]
"""

#: Seconds after which a command is ended.
LIMIT = 200


class Started:
    """A command that was started; used like `subprocess.Popen`.

    Attributes:
        pid: Of its process.
        returncode: None until it is known.
        stdout: Stream of what it prints; None where that goes elsewhere.
        stderr: The same.
    """

    def __init__(self, report, stdout, stderr):
        """Take what the process that forks reports, and the streams."""
        self._report, self.stdout, self.stderr = report, stdout, stderr
        self.pid = int(report.readline())
        self.returncode = None

    @property
    def report(self):
        """Descriptor that can be read once it has ended."""
        return self._report.fileno()

    def poll(self):
        """The exit code, or None while it runs."""
        if self.returncode is None and select.select([self._report], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout=None):
        """The exit code, once there is one."""
        if self.returncode is None:
            if not select.select([self._report], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("newmark-study", timeout)
            self.returncode = int(self._report.readline())
            self._report.close()
        return self.returncode

    def send_signal(self, number):
        """Unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout=None):
        """What it prints until both streams end, and wait for it."""
        until = None if timeout is None else time.monotonic() + timeout
        found = {stream: [] for stream in (self.stdout, self.stderr) if stream}
        readers = [
            threading.Thread(target=lambda to=to, s=stream: to.append(s.read()), daemon=True)
            for stream, to in found.items()
        ]
        for reader in readers:
            reader.start()
        for reader in readers:
            reader.join(None if until is None else max(until - time.monotonic(), 0))
            if reader.is_alive():
                raise subprocess.TimeoutExpired("newmark-study", timeout)
        self.wait(None if until is None else max(until - time.monotonic(), 0))
        for stream in found:
            stream.close()
        return tuple(found[s][0] if s else None for s in (self.stdout, self.stderr))


class Warm:
    """The process that is forked.

    Attributes:
        address: Where other processes reach it.
    """

    def __init__(self, address=None):
        """Reach that of another process, or start one, which imports `MODULES`."""
        self.address, self._folder = address, None
        if address:
            self._control = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self._control.connect(address)
            return
        self._folder = tempfile.TemporaryDirectory()
        self.address = str(Path(self._folder.name) / "warm")
        self._control, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
        with theirs, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as entrance:
            entrance.bind(self.address)
            entrance.listen()
            given = [theirs.fileno(), entrance.fileno()]
            self._process = subprocess.Popen(
                [sys.executable, __file__, *map(str, given)], pass_fds=given
            )

    def imports(self, *modules):
        """Have it import more, for all that it forks from now on."""
        self._control.send(json.dumps({"modules": modules}).encode())

    def run(self, arguments, folder, script=SCRIPT):
        """Run a script in a folder; what it did, like `subprocess.run` with text."""
        out, err = folder.with_suffix(".out"), folder.with_suffix(".err")
        with out.open("wb") as to_out, err.open("wb") as to_err:
            started = self.start([script, *arguments], folder, to_out.fileno(), to_err.fileno())
            code = started.wait(2 * LIMIT)
        return subprocess.CompletedProcess(arguments, code, out.read_text(), err.read_text())

    def start(
        self, command, folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=None,
        start_new_session=False, ignored=(),
    ):  # fmt: skip
        """Start a script of Python in a folder, and do not wait for it.

        Args:
            command: The script and its arguments.
            folder: Where it runs.
            stdout: A descriptor that it writes to, or a pipe.
            stderr: The same.
            env: Its environment; that of this process if omitted.
            start_new_session: Whether it leads a session of its own.
            ignored: Signals that it ignores.
        """
        asked = {
            "command": [*map(str, command)], "folder": str(folder),
            "environment": dict(os.environ if env is None else env),
            "session": start_new_session, "ignored": [*map(int, ignored)],
            "address": self.address,
        }  # fmt: skip
        report, reports = os.pipe()
        given, streams = [reports], []
        for target in (stdout, stderr):
            if target == subprocess.PIPE:
                ours, theirs = os.pipe()
                streams.append(os.fdopen(ours))
                given.append(theirs)
            else:
                streams.append(None)
                given.append(target)
        socket.send_fds(self._control, [json.dumps(asked).encode()], given)
        for descriptor, target in zip(given, (subprocess.PIPE, stdout, stderr), strict=True):
            if target == subprocess.PIPE:
                os.close(descriptor)
        return Started(os.fdopen(report), *streams)

    def serve_code(self, descriptor, environment):
        """Start a process for user code (`apart`), with this process's streams."""
        asked = {
            "path": sys.path, "folder": os.getcwd(), "group": os.getpgrp(),
            "environment": environment,
        }  # fmt: skip
        report, reports = os.pipe()
        given = [reports, 1, 2, descriptor]
        socket.send_fds(self._control, [json.dumps(asked).encode()], given)
        os.close(reports)
        return Started(os.fdopen(report), None, None)

    def close(self):
        """End the process, if it was started here."""
        self._control.close()
        if self._folder:
            self._process.wait()
            self._folder.cleanup()


def serve(control, entrance):
    """Fork for everyone who asks; tell the number of the process, and its exit code.

    Args:
        control: Socket of who has started this process, which ends with it.
        entrance: Listens for others.
    """
    woken, wakes = os.pipe()
    for end in (woken, wakes):
        os.set_blocking(end, False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    interrupted = signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with who has started it
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    running, clients = {}, [control]
    while True:
        ready, _, _ = select.select([*clients, entrance, woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
            for pid in [*running]:
                ended, status = os.waitpid(pid, os.WNOHANG)
                if ended:
                    tell(running.pop(pid), os.waitstatus_to_exitcode(status))
        if entrance in ready:
            clients.append(entrance.accept()[0])
        for client in [client for client in clients if client in ready]:
            asked, given, _, _ = socket.recv_fds(client, 1 << 20, 4)
            if not asked:
                if client is control:
                    return
                clients.remove(client)
                client.close()
                continue
            if not given:
                with contextlib.suppress(ImportError):  # who needs it will say so
                    load(json.loads(asked)["modules"])
                continue
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                signal.signal(signal.SIGINT, interrupted)
                for one in (*clients, entrance):
                    one.close()
                for descriptor in (woken, wakes, given[0], *running.values()):
                    os.close(descriptor)
                redirect(*given[1:3])
                if given[3:]:
                    become_worker(given[3], **json.loads(asked))
                become(**json.loads(asked))
            running[pid] = given[0]
            for descriptor in given[1:]:
                os.close(descriptor)
            with contextlib.suppress(BrokenPipeError):
                os.write(given[0], b"%d\n" % pid)


def tell(descriptor, code):
    """Report an exit code, to nobody if nobody waits for it."""
    with contextlib.suppress(BrokenPipeError):
        os.write(descriptor, b"%d\n" % code)
    os.close(descriptor)


def redirect(stdout, stderr):
    """Take these for the standard streams."""
    null = os.open(os.devnull, os.O_RDONLY)
    for number, descriptor in enumerate((null, stdout, stderr)):
        os.dup2(descriptor, number)
        os.close(descriptor)


def take(environment):
    """Have this environment, in which no file waits for the disk."""
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = None  # as found in another environment
    if "dask.config" in sys.modules:  # has read another
        sys.modules["dask.config"].refresh()
    os.fsync = lambda descriptor: None


class Forking:
    """What `apart` uses of `multiprocessing`, with forks of the process at an address."""

    Pipe = staticmethod(multiprocessing.Pipe)

    def __init__(self, address):
        """Of the process that forks."""
        self._address = address

    def Process(self, target, args):
        """As `multiprocessing.Process`."""
        return Forked(self._address, *args)


class Forked:
    """A process for user code; used like `multiprocessing.Process`."""

    def __init__(self, address, connection, environment):
        """What `start` needs."""
        self._given = address, connection, environment

    def start(self):
        """Have it forked."""
        address, connection, environment = self._given
        self._started = Warm(address).serve_code(connection.fileno(), environment)
        self.sentinel = os.dup(self._started.report)

    @property
    def exitcode(self):
        """None while it runs."""
        return self._started.poll()

    def is_alive(self):
        """Whether it runs."""
        return self.exitcode is None

    def kill(self):
        """End it at once."""
        self._started.kill()

    def join(self, timeout=None):
        """Wait for its end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._started.wait(timeout)


def become_worker(descriptor, path, folder, group, environment):
    """Be a process for user code, in the process group of its command, with which it ends."""
    with contextlib.suppress(PermissionError, ProcessLookupError):
        os.setpgid(0, group)
    signal.alarm(LIMIT)
    signal.pthread_sigmask(signal.SIG_BLOCK, interrupts.NAMES)
    take(environment)
    os.chdir(folder)
    sys.path[:] = path
    hangup = select.poll()
    hangup.register(descriptor, 0)
    threading.Thread(target=lambda: (hangup.poll(), os._exit(0)), daemon=True).start()
    apart._work(Connection(descriptor), environment)


def become(command, folder, environment, session, ignored, address):
    """Be the process of a command: its arguments, folder and environment."""
    signal.alarm(LIMIT)
    if session:
        os.setsid()
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
    take(environment)
    os.chdir(folder)
    if not session:  # which a fork of another process cannot join
        apart._context = Forking(address)
    # As Python does when it starts, of what this process has now.
    encoding = environment.get("PYTHONIOENCODING") or sys.stdout.encoding
    sys.stdout = open(1, "w", encoding=encoding, closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", 1, encoding=sys.stderr.encoding, closefd=False)  # noqa: SIM115
    sys.argv = command
    paths = environment.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[0:1] = [str(Path(command[0]).parent), *filter(None, paths)]
    try:
        runpy.run_path(command[0], run_name="__main__")
    except SystemExit as ending:
        leave(ending.code)
    leave(0)


def leave(code):
    """End as Python does, but for taking its modules apart, which takes longer than most do."""
    threading._shutdown()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code or 0)


def load(modules):
    """Import modules, and keep collections in forks from copying every page."""
    for module in modules:
        importlib.import_module(module)
    gc.collect()
    gc.freeze()


def prepare():
    """Import, and do once what every command that does it would do for itself."""
    # What all commands set before they import anything: a fork wants no threads of BLAS.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    load(["portalocker", *(f"newmark_cli.{name}" for name in MODULES)])
    import numpy as np

    from newmark_cli.mechanisms.registry import problem
    from newmark_cli.problems import python_problem
    from newmark_cli.report.drawing import draw, panels, style
    from newmark_cli.report.judging import text
    from newmark_cli.running import runner
    from newmark_cli.study import config

    problem("pendulum")  # has Numba load its registries
    python_problem.from_definition(
        python_problem.Definition(
            mass_matrix=np.eye(2),
            u0=np.array([1.0, 0.0]),
            v0=np.zeros(2),
            force=lambda u, v, t: np.zeros(2),
            constraints=lambda u, t: np.array([(u @ u - 1) / 2]),
            gradient=lambda u, t: u[:, None],
        ),
        "rod",
    )
    if is_kept():
        # Has the libraries' versions, the commit and the core's digest found out, too.
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "study.yaml"
            file.write_text(STUDY)
            runner.run_studies([config.load(file)], Path(folder), runner.Options(1))
    text.text_table([("a", "b"), ("1", "2")])
    # Matplotlib makes its parser of formulas when it meets the first.
    drawing = draw.drawn(panels.Sheet("", (panels.Panel((), "$h^{-1}$"),)))
    for kind in ("png", "svg"):
        style.rendered(drawing, kind)
    if "colorama" in sys.modules:
        # Numba, as it compiles, has it write to the terminal of every process that ends.
        atexit.unregister(importlib.import_module("colorama.initialise").reset_all)
    gc.collect()
    gc.freeze()


if __name__ == "__main__":
    warnings.filterwarnings("ignore", "This process", DeprecationWarning)  # has threads of NumPy
    prepare()
    serve(*(socket.socket(fileno=int(descriptor)) for descriptor in sys.argv[1:]))
