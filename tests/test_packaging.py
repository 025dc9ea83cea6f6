"""What surrounds the package says the same: versions, requirements, systems, contents."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
import yaml

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


def test_addresses():
    """One address of the repository stands everywhere."""
    urls = PROJECT["project"]["urls"]
    recipe = read_yaml("packaging/conda/recipe.yaml")["about"]
    assert read_yaml("CITATION.cff")["repository-code"] == urls["Source"]
    assert recipe["repository"] == urls["Source"]
    assert all(url.startswith(urls["Source"]) for url in urls.values())


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


def test_pythons():
    """Classifiers begin at the lowest version that may be installed, and CI tries them all."""
    prefix = "Programming Language :: Python :: 3."
    named = [c.removeprefix(prefix) for c in PROJECT["project"]["classifiers"] if prefix in c]
    matrix = read_yaml(".github/workflows/ci.yml")["jobs"]["tests"]["strategy"]["matrix"]
    assert named == sorted(named, key=int)
    assert PROJECT["project"]["requires-python"] == f">=3.{named[0]}"
    assert {f"3.{minor}" for minor in named} <= set(matrix["python"])
    assert PROJECT["tool"]["mypy"]["python_version"] == f"3.{named[0]}"
    assert PROJECT["tool"]["ruff"]["target-version"] == f"py3{named[0]}"


def test_workflows():
    """They may only read, do not keep the token, and name their actions by major version."""
    files = sorted((ROOT / ".github/workflows").glob("*.yml"))
    assert files
    for file in files:
        workflow = read_yaml(file)
        assert workflow["permissions"] == {"contents": "read"}
        for job in workflow["jobs"].values():
            assert job["timeout-minutes"] <= 45
            used = [step for step in job["steps"] if "uses" in step]
            assert used
            for step in used:
                assert re.fullmatch(r"actions/[\w-]+@v\d+", step["uses"])
                if step["uses"].startswith("actions/checkout@"):
                    assert step["with"] == {"persist-credentials": False}


def test_ci_runs_what_a_developer_runs():
    """Commands of the workflow install extras that there are."""
    jobs = read_yaml(".github/workflows/ci.yml")["jobs"]
    runs = {name: [s["run"] for s in job["steps"] if "run" in s] for name, job in jobs.items()}
    assert {"ruff check --output-format=github .", "ruff format --check .", "mypy"} <= {
        *runs["lint"]
    }
    assert "pytest" in runs["tests"]
    extras = {extra for run in chain(*runs.values()) for extra in re.findall(r"\.\[(\w+)\]", run)}
    assert extras - {"docs"} <= set(PROJECT["project"]["optional-dependencies"])


def test_hooks_before_commits():
    """Every hook is of this file: none is fetched from another repository."""
    hooks = read_yaml(".pre-commit-config.yaml")["repos"]
    assert [repo["repo"] for repo in hooks] == ["local"]
    entries = {hook["id"]: hook["entry"] for hook in hooks[0]["hooks"]}
    assert {"ruff-check", "ruff-format", "mypy", "end-of-file-fixer", "check-yaml"} <= set(entries)


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


def test_the_paper_cites_what_it_lists():
    """Every key that the text cites is in the bibliography, and every entry is cited."""
    text = (ROOT / "paper/paper.md").read_text(encoding="utf-8")
    entries = re.findall(r"^@\w+\{(\w+),$", (ROOT / "paper/paper.bib").read_text("utf-8"), re.M)
    assert len(entries) == len(set(entries))
    assert set(re.findall(r"@([a-z]+\d{0,4})\b", text)) == set(entries)
    body = text.split("---", 2)[2]
    assert 750 <= len(body.split()) <= 1750


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

OWN = """\
study: own
problem: {python: "own.py:swing"}
form: u-lambda
preconditioning: none
h: 0.1
t_end: 1.0
"""


def test_without_what_windows_lacks(cli, quick):
    """Data are run, locked, written and verified; the CSV is the same; links are refused.

    Code of the user's needs fork: one line says so, with what to do.
    """
    cli("run", "quick.yaml", "--results", "here")
    shutil.copytree(cli.folder / "here", cli.folder / "linked")
    (cli.folder / "linked/quick.csv").unlink()
    (cli.folder / "linked/quick.csv").symlink_to(cli.folder / "here/quick.csv")
    cli.write("own.yaml", OWN)
    cli.write("own.py", "def swing():\n    pass\n")
    commands = [
        ["verify", "--results", "linked"],
        ["run", "own.yaml", "--allow-code", "--results", "own"],
        ["run", "quick.yaml"],
    ]
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, json.dumps(commands)],
        cwd=cli.folder, capture_output=True, text=True, env=os.environ | {"COLUMNS": "120"},
        check=False,
    )  # fmt: skip
    (line,) = done.stderr.splitlines()
    assert "processes that are forked, which this system cannot; use Linux or macOS" in line
    assert done.stdout.splitlines() == [
        "linked/quick.csv: cannot be read: it is a symbolic link",
        "verify ends with 1",
        "run ends with 1",
        "quick: 4 ok -> results/quick.csv",
    ]
    assert done.returncode == 0
    there, here = (cli.folder / name / "quick.csv" for name in ("results", "here"))
    assert there.read_bytes() == here.read_bytes()
    assert json.loads((cli.folder / "results/.lock").read_text())["what"] == "run quick"
