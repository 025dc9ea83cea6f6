"""What surrounds a command changes no result unseen: kernels of the BLAS, drawing settings."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from command_line import SCRIPT, CommandLine
from conftest import QUICK, SWING

from newmark_cli.cli import main
from newmark_cli.study import provenance

EXAMPLES = Path(__file__).parents[2] / "docs/examples"


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
    told = [line for line in done.stderr.splitlines() if "does not see a scaling" not in line]
    assert (done.returncode, told) == (0, [])
    return done.stdout


#: What its cells record passes through everything that computes: starts that are assembled and
#: projected, dense and static elimination, condition numbers, references, formulations.
BITS = """\
study: bits
expect: [{measure: correction, at_least: 1.0e-99}]
cases:
  - problem: [andrews, spatial-slider-crank, {chain: {links: 3}}]
    form: u-v-a-lambda
    preconditioning: [none, optimal]
    h: 1e-3
    t_end: 0.002
    measure: [correction, condition, sensitivity, error, invariant, floor]
  - problem: governor
    form: u-lambda
    preconditioning: optimal
    formulation: [{method: ggl}, {method: index-1}]
    h: 1e-3
    t_end: 0.01
    measure: [correction, condition, trajectory]
  - problem: hoist.yaml
    form: v-lambda
    preconditioning: left
    linear_solver: gmres
    h: 1e-3
    t_end: 0.01
    measure: [condition, krylov]
"""


def test_results_are_the_same_with_every_kernel(cli, other_kernel):
    """To the bit; cells computed with one serve the other, and the run's record names its own."""
    cli.write("bits.yaml", BITS)
    shutil.copy(EXAMPLES / "hoist.yaml", cli.folder)
    ended, _ = cli("run", "bits.yaml").stdout.split(" -> ")
    assert re.fullmatch(r"bits: \d+ ok", ended)
    commands = (["run", "bits.yaml", "--results", "two"], ["run", "bits.yaml"])
    printed = in_turn(cli.folder, commands, OPENBLAS_CORETYPE=other_kernel)
    count = ended.split()[1]
    assert printed.splitlines() == [
        f"{ended} -> two/bits.csv", f"{ended} ({count} cached) -> results/bits.csv"
    ]  # fmt: skip
    one, two = cli.folder / "results", cli.folder / "two"
    for name in ("bits.csv", "trajectory/bits.csv", "bits.json"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    assert all(
        cell["operations"] > 0 for cell in json.loads((two / "bits.json").read_text())["cells"]
    )
    run = json.loads((two / "runs/bits.json").read_text())
    assert run["blas"]["kernel"] == other_kernel
    assert re.search(r"\d+\.\d+", run["blas"]["loaded"])
    assert re.search(
        rf"BLAS kernel +{other_kernel}\n", cli("show", "--record", "--results", "two").stdout
    )


def figures(cli):
    """Every figure in the results folder: name → bytes."""
    return {file.name: file.read_bytes() for file in (cli.folder / "results/figures").iterdir()}


def require_as_plain(cli, plain):
    """The figures that were drawn are those that nobody's settings have touched."""
    found = figures(cli)
    assert found
    assert found == {name: content for name, content in figures(plain).items() if name in found}


UGLY = "figure.facecolor: red\nfont.size: 20\nlines.linewidth: 9\nsavefig.dpi: 30\n"

#: Commands that draw a mechanism, and a study, each with imports of its own.
DRAWING = (("draw", "four-bar"), ("plot", "quick", "--measure", "condition"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """A study's results, and figures that nobody's settings have touched."""
    cli = CommandLine(tmp_path_factory.mktemp("plain"))
    cli.write("quick.yaml", QUICK)
    cli("run", "quick.yaml")
    for command in DRAWING:
        cli(*command)
    assert len(figures(cli)) >= 3
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
expect: [{measure: correction, at_least: 1.0e-99}]
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
