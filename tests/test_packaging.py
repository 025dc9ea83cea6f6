"""What surrounds the package says the same: versions, requirements, systems, contents."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from conftest import QUICK

from newmark_cli import __version__

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
#: Names of packages that conda-forge spells otherwise.
CONDA = {"matplotlib": "matplotlib-base", "pyyaml": "pyyaml"}


def read_yaml(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def requirement(text):
    """Name in small letters and bounds of a requirement of pip or conda."""
    match = re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])? *(.*)", text)
    return match[1].lower(), match[2]


def test_versions():
    """The package, the citation, the recipe and the newest release of the changelog agree."""
    released = re.findall(
        r"^## (\d+\.\d+\.\d+) \(([\d-]+)\)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M
    )
    citation = read_yaml("CITATION.cff")
    assert released[0] == (__version__, citation["date-released"])
    assert citation["version"] == __version__
    assert read_yaml("packaging/conda/recipe.yaml")["context"]["version"] == __version__


def test_conda_requires_what_pip_does():
    """The recipe names each dependency with its bound, and no other."""
    recipe = read_yaml("packaging/conda/recipe.yaml")
    wanted = dict(map(requirement, PROJECT["project"]["dependencies"]))
    wanted = {CONDA.get(name, name): bound for name, bound in wanted.items()}
    given = dict(map(requirement, recipe["requirements"]["run"]))
    lowest = PROJECT["project"]["requires-python"]
    assert given.pop("python") == ">=${{ python_min }}"
    assert f">={recipe['context']['python_min']}" == lowest
    assert given == wanted
    assert (
        dict(map(requirement, PROJECT["build-system"]["requires"])).items()
        <= dict(map(requirement, recipe["requirements"]["host"])).items()
    )
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert PROJECT["project"]["scripts"] == dict([entry.split(" = ")])


def test_the_sdist_leaves_nothing_out():
    """Every top-level name of the project is in the sdist's list."""
    listed = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    assert all(name.startswith("/") for name in listed)
    try:
        asked = subprocess.run(
            ["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a checkout")
    tracked = {name.split("/")[0] for name in asked.stdout.split("\0") if name}
    # Hatchling adds these two itself.
    assert tracked - {name[1:] for name in listed} == {".gitignore", "pyproject.toml"}


#: What Windows lacks, and the libraries that know it are imported before it is taken away.
ELSEWHERE = """\
import sys
import click, concurrent.futures, ctypes, hashlib, importlib.metadata, json, multiprocessing
import multiprocessing.connection, multiprocessing.resource_tracker, numba, numpy, os, pandas
import pathlib, portalocker, pydantic, rich, shutil, signal, _signal, socket, subprocess, tempfile
import scipy.linalg, scipy.sparse.linalg, threadpoolctl, yaml
from concurrent.futures import ThreadPoolExecutor
for name in ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp"):
    sys.modules[name] = None
lacking = {
    os: (
        "fork", "getuid", "geteuid", "sched_getaffinity", "fchmod", "fchdir", "O_CLOEXEC",
        "O_NOFOLLOW", "O_NONBLOCK", "O_NOCTTY", "O_DIRECTORY",
        "set_blocking", "getpgid", "killpg", "setsid", "uname",
    ),
    socket: ("send_fds", "recv_fds", "AF_UNIX"),
}
lacking[signal] = lacking[_signal] = (
    "SIGHUP", "SIGALRM", "SIGCHLD", "SIGUSR1", "SIGUSR2", "ITIMER_REAL", "setitimer",
    "pthread_sigmask",
)
for module, names in lacking.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
from newmark_cli import cli
*others, last = json.loads(sys.argv[1])
for command in others:
    try:
        cli.main(command)
    except SystemExit as end:
        print(command[0], "ends with", end.code)
sys.argv = ["newmark-study", *last]
from newmark_cli.console import main
main()
"""


def test_without_what_windows_lacks(cli):
    """Data are run, locked, written and verified; the CSV is the same; links are refused.

    Nothing is marched, as compiled code is not kept there.
    """
    cli.write("quick.yaml", QUICK.replace("t_end: 1.0", "steps: 0\nmeasure: condition"))
    cli("run", "quick.yaml", "--results", "here")
    shutil.copytree(cli.folder / "here", cli.folder / "linked")
    (cli.folder / "linked/quick.csv").unlink()
    (cli.folder / "linked/quick.csv").symlink_to(cli.folder / "here/quick.csv")
    commands = [
        ["show", "quick", "--results", "linked"],
        ["run", "quick.yaml"],
    ]
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, json.dumps(commands)],
        cwd=cli.folder, capture_output=True, text=True, env=os.environ | {"COLUMNS": "120"},
        check=False,
    )  # fmt: skip
    link = "newmark-study: linked/quick.csv: cannot be read: it is a symbolic link\n"
    assert done.stderr == link
    assert done.stdout.splitlines() == [
        "show ends with 2",
        "quick: 4 ok -> results/quick.csv",
    ]
    assert done.returncode == 0
    there, here = (cli.folder / name / "quick.csv" for name in ("results", "here"))
    assert there.read_bytes() == here.read_bytes()
    assert json.loads((cli.folder / "results/.lock").read_text())["what"] == "run quick"
