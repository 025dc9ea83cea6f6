"""What surrounds a command changes no result unseen: kernels of the BLAS, drawing settings."""

import json
import os
import re
import shutil
import subprocess
import sys

import matplotlib as mpl
import pytest
from conftest import QUICK, SWING, CommandLine
from warm import SCRIPT

from newmark_cli.cli import main
from newmark_cli.running import store
from newmark_cli.study import provenance

# -- the kernel of the BLAS -------------------------------------------------------------------


@pytest.fixture(scope="module")
def other_kernel():
    """A kernel that the BLAS can be told to take, besides the one that it takes here."""
    here = provenance.blas_kernel()
    code = "from newmark_cli.study import provenance; print(provenance.blas_kernel())"
    for name in ("Haswell", "Sandybridge", "Nehalem"):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True,
            env=os.environ | {"OPENBLAS_CORETYPE": name},
        )  # fmt: skip
        if done.stdout.strip() not in (here, "unknown"):
            return done.stdout.strip()
    pytest.skip("the BLAS of this machine has one kernel, or does not tell")


#: Runs commands, each with its arguments, in a process that loads its libraries itself.
IN_TURN = """
import sys
from newmark_cli.cli import main
for command in {}:
    try:
        main(command)
    except SystemExit as ending:
        if ending.code:
            raise
"""


def in_turn(folder, commands, **environment):
    """Run commands in one process of their own, which must end well; what it printed."""
    done = subprocess.run(
        [sys.executable, "-c", IN_TURN.format(commands)], cwd=folder, text=True,
        capture_output=True, env=os.environ | environment, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


#: Runs half of a study into a folder of its own.
SHARD = ("run", "quick.yaml", "--shard")


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory, warm, other_kernel):
    """A study run with the kernel of this process, then half of it and all with another."""
    cli = CommandLine(tmp_path_factory.mktemp("kernels"), warm)
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    commands = ([*SHARD, "2/2", "--results", "two"], ["run", "quick.yaml"])
    printed = in_turn(cli.folder, commands, OPENBLAS_CORETYPE=other_kernel)
    # Cells of this process's kernel are there, and none of them counts.
    assert printed.splitlines()[-1] == "quick: 4 ok -> results/quick.csv"
    return cli


def test_another_kernel_computes_anew(elsewhere, other_kernel):
    """Cells are kept of every kernel, and the record names the one that ran."""
    cells = elsewhere.folder / "results"
    for kernel, told in ((other_kernel, None), (provenance.blas_kernel(), " (4 cached)")):
        if told:
            done = elsewhere("run", "quick.yaml")
            assert done.stdout == f"quick: 4 ok{told} -> results/quick.csv\n"
        record = json.loads((cells / "quick.json").read_text())
        assert record["blas"]["kernel"] == kernel
        assert re.search(r"\d+\.\d+", record["blas"]["loaded"])
        assert re.search(rf"BLAS kernel +{kernel}\n", elsewhere("info", "quick").stdout)


def test_cells_of_another_kernel_are_told_in_words(elsewhere, other_kernel):
    """Why a dry run would run them, and why a merge lacks them."""
    change = f"BLAS kernel {other_kernel} -> {provenance.blas_kernel()}"
    dry = elsewhere("run", "quick.yaml", "--dry-run", "--results", "two").stdout
    *lines, last = dry.splitlines()
    assert [line.split(": ", 2)[2] for line in lines].count(f"to run: {change}") == 2
    assert last == "4 of 4 cells to run"
    elsewhere(*SHARD, "1/2", "--results", "one")
    merge = ("merge", "quick.yaml", "--from", "one", "--from", "two", "--results", "all")
    assert elsewhere(*merge, code=1).stderr == (
        f"newmark-study: quick: 2 of 4 cells are missing; 2 cached otherwise: {change}\n"
    )


def test_kernels_are_versions():
    """Of what the numbers come from, by which workers of dask are refused."""
    versions = store.versions()
    assert versions["BLAS kernel"] == provenance.blas_kernel() != ""
    assert versions["BLAS"] == provenance.blas_loaded()
    assert store.unlike({**versions, "BLAS kernel": "other"}, versions) == ["BLAS kernel"]


def test_commands_that_run_nothing_do_not_look():
    """It takes SciPy's linear algebra, which takes time."""
    code = """
    import sys
    import newmark_cli.cli.commands, newmark_cli.study.config, newmark_cli.report.check
    sys.exit("threadpoolctl" in sys.modules)
    """
    lines = "\n".join(line.strip() for line in code.splitlines())
    assert subprocess.run([sys.executable, "-c", lines]).returncode == 0


# -- matplotlib's settings --------------------------------------------------------------------


def figures(cli):
    """Every figure in the results folder: name → bytes."""
    return {file.name: file.read_bytes() for file in (cli.folder / "results/figures").iterdir()}


def require_as_plain(cli, plain):
    """The figures that were drawn are those that nobody's settings have touched."""
    found = figures(cli)
    assert found
    assert found == {name: content for name, content in figures(plain).items() if name in found}


UGLY = "figure.facecolor: red\nfont.size: 20\nlines.linewidth: 9\nsavefig.dpi: 30\n"
BROKEN = b"figure.facecolor: red\nno.such: key\nfont.size\n\xff\xfe: 3\n"

#: Commands that draw a mechanism, and a study, each with imports of its own.
DRAWING = (("draw", "four-bar"), ("plot", "quick", "--measure", "condition"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory, warm):
    """A study's results, and figures that nobody's settings have touched."""
    cli = CommandLine(tmp_path_factory.mktemp("plain"), warm)
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    for command in DRAWING:
        cli(*command)
    assert len(figures(cli)) >= 4
    return cli


def copy_results(cli, plain):
    """All but the figures."""
    ignored = shutil.ignore_patterns("figures")
    shutil.copytree(plain.folder / "results", cli.folder / "results", ignore=ignored)


def test_settings_change_no_figure(cli, plain):
    """Those of a file that matplotlib would read as it is imported."""
    (cli.folder / "matplotlibrc").write_text(UGLY)
    in_turn(cli.folder, DRAWING[:1], MPLBACKEND="svg")
    require_as_plain(cli, plain)


def test_what_is_no_settings_changes_no_figure(cli, plain):
    """A pipe that nobody writes to, a file that is not of settings, a backend that is not there."""
    copy_results(cli, plain)
    os.mkfifo(cli.folder / "matplotlibrc")
    (cli.folder / "settings").write_bytes(BROKEN)
    given = {"MATPLOTLIBRC": str(cli.folder / "settings"), "MPLBACKEND": "module://absent"}
    in_turn(cli.folder, DRAWING[1:], **given)
    require_as_plain(cli, plain)


def test_settings_of_a_program_change_no_figure(cli, plain):
    """Nor do those of a program that uses this package as a library."""
    copy_results(cli, plain)
    ugly = {"font.size": 20, "axes.facecolor": "red", "savefig.dpi": 20}
    command = [*DRAWING[1], "--results", str(cli.folder / "results")]
    with mpl.rc_context(ugly), pytest.raises(SystemExit) as ending:
        main(command)
    assert not ending.value.code
    require_as_plain(cli, plain)


#: A study of a problem that a process of its own describes.
OWN = """\
study: own
problem: {python: "own.py:swing"}
form: u-lambda
preconditioning: none
h: 0.1
t_end: 1.0
"""


def test_modules_of_the_current_folder_are_not_imported(cli):
    """Nor by `python -m`, which has it on its path, once it is this package that runs."""
    for name in ("threading", "subprocess", "numpy", "yaml", "click", "rich"):
        cli.write(f"{name}.py", 'raise SystemExit("planted")\n')
    cli.write("own.py", SWING)
    cli.write("own.yaml", OWN)
    for command in ([SCRIPT], [sys.executable, "-m", "newmark_cli"]):
        done = subprocess.run(
            [*command, "validate", "own.yaml", "--allow-code"], cwd=cli.folder,
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
