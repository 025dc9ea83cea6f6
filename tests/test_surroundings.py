"""What surrounds a command changes no result unseen: kernels of the BLAS, drawing settings."""

import json
import os
import re
import shutil
import subprocess
import sys

import pytest
from conftest import QUICK, CommandLine

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


def started(cli, *arguments, code=0, **environment):
    """Run the command in a process that loads its libraries itself; its output and errors."""
    run = cli.start_cold(*arguments, env=os.environ | environment)
    output, errors = run.communicate(timeout=120)
    assert run.returncode == code, errors
    return output, errors


def test_the_kernel_is_recorded(cli, other_kernel):
    """What ran, not what the libraries were built with."""
    cli.write("quick.yaml", QUICK)
    for kernel in (provenance.blas_kernel(), other_kernel):
        if kernel == other_kernel:
            started(cli, "run", "quick.yaml", OPENBLAS_CORETYPE=kernel)
        else:
            cli("run", "quick.yaml")
        record = json.loads((cli.folder / "results/quick.json").read_text())
        assert record["blas"]["kernel"] == kernel
        assert re.search(r"\d+\.\d+", record["blas"]["loaded"])
        assert re.search(rf"BLAS kernel +{kernel}\n", cli("info", "quick").stdout)


def test_another_kernel_computes_anew(cli, other_kernel):
    """Kept cells are of the kernel that computed them; a dry run says so in words."""
    cli.write("quick.yaml", QUICK)
    here = provenance.blas_kernel()
    cli("run", "quick.yaml")
    dry, _ = started(cli, "run", "quick.yaml", "--dry-run", OPENBLAS_CORETYPE=other_kernel)
    *lines, last = dry.splitlines()
    assert [line.split(": ", 2)[2] for line in lines] == [
        f"to run: BLAS kernel {here} -> {other_kernel}"
    ] * 4
    assert last == "4 of 4 cells to run"
    output, _ = started(cli, "run", "quick.yaml", OPENBLAS_CORETYPE=other_kernel)
    assert output == "quick: 4 ok -> results/quick.csv\n"
    assert cli("run", "quick.yaml").stdout == "quick: 4 ok (4 cached) -> results/quick.csv\n"


def test_merging_says_why_cells_do_not_count(cli, other_kernel):
    """A shard of another kernel is no part of this study, and no riddle."""
    cli.write("quick.yaml", QUICK)
    shard = ("run", "quick.yaml", "--shard")
    cli(*shard, "1/2", "--results", "one")
    started(cli, *shard, "2/2", "--results", "two", OPENBLAS_CORETYPE=other_kernel)
    merge = ("merge", "quick.yaml", "--from", "one", "--from", "two", "--results", "all")
    assert cli(*merge, code=1).stderr == (
        "newmark-study: quick: 2 of 4 cells are missing; 2 cached otherwise: "
        f"BLAS kernel {other_kernel} -> {provenance.blas_kernel()}\n"
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


def write_settings(path, kind):
    """A file of settings, or what one may find in its place."""
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.write_bytes({
            "ugly": b"figure.facecolor: red\nfont.size: 20\nlines.linewidth: 9\nsavefig.dpi: 30\n",
            "broken": b"figure.facecolor: red\nno.such: key\nfont.size\n\xff\xfe: 3\n",
        }[kind])  # fmt: skip


#: Commands that draw a study, and a mechanism.
DRAWING = (("plot", "quick", "--measure", "condition"), ("draw", "four-bar"))


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


@pytest.mark.parametrize(
    ("where", "kind", "backend"),
    [
        ("current folder", "ugly", "svg"),
        ("current folder", "pipe", None),
        ("variable", "broken", "module://absent"),
    ],
)
def test_settings_change_no_figure(cli, plain, kind, where, backend):
    """Nor does a file that is no settings, or none that ends, nor a backend, there or not."""
    environment = {"MPLBACKEND": backend} if backend else {}
    file = cli.folder / "matplotlibrc"
    if where == "variable":
        file = cli.folder / "settings"
        environment["MATPLOTLIBRC"] = str(file)
    write_settings(file, kind)
    copy_results(cli, plain)
    # In a process that imports matplotlib itself.
    code = (
        "from newmark_cli.cli import main\n"
        f"for command in {DRAWING}:\n"
        "    try:\n"
        "        main(command)\n"
        "    except SystemExit as ending:\n"
        "        assert ending.code == 0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=cli.folder, env=os.environ | environment, text=True,
        capture_output=True, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert figures(cli) == figures(plain)


def test_settings_of_a_program_change_no_figure(cli, plain):
    """Nor do those of a program that uses this package as a library."""
    copy_results(cli, plain)
    code = """
    import matplotlib
    matplotlib.rcParams.update({"font.size": 20, "axes.facecolor": "red", "savefig.dpi": 20})
    from newmark_cli.cli import main
    main(["plot", "quick", "--measure", "condition"])
    """
    lines = "\n".join(line.strip() for line in code.splitlines())
    done = subprocess.run([sys.executable, "-c", lines], cwd=cli.folder, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    found = figures(cli)
    assert found
    assert found == {name: content for name, content in figures(plain).items() if name in found}
