"""Work of a march: its linear systems by a formula in their size; wall times next to it."""

import json

from conftest import QUICK, rows_in
from each import each
from test_formulations import scheme_of, subject_of

from newmark_cli.newmark import operations
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.march import March


@each("size", [1, 2, 7, 300])
def test_full_matrices_take_what_textbooks_say(size):
    """(2/3) N³ for the factors and 2 N² for the substitutions (Golub & Van Loan, §3.2)."""
    found = operations.direct(size, size**2)
    assert abs(found - 2 / 3 * size**3 - 2 * size**2) < 1


def test_work_follows_what_a_march_solves():
    """Systems of its corrections, of projections and of recovered λ; the same by each solver."""
    subject = subject_of("andrews")
    n, m, pattern = subject.n, subject.m, subject.pattern
    saddle = operations.direct(n + m, len(pattern.mass_rows) + 2 * len(pattern.g_rows))
    pivoting = ("dense-lu", "sparse-lu")
    for formulation, options, solvers, in_step in (
        ("index-3", {}, (*pivoting, "static-lu"), 0),
        ("index-3", {"reported": "recovered"}, (*pivoting, "static-lu"), 1),
        ("ggl", {}, pivoting, 0),
        ("index-2", {"projection": "position-velocity accelerations"}, pivoting, 2),
    ):
        scheme = scheme_of(formulation, "a-lambda", h=1e-5, **options)
        matrix = SparseSystem(subject, scheme)
        solved = operations.direct(matrix.size, len(matrix.rows))
        for solver in solvers:
            march = March(subject, scheme, solver)
            march.advance(5)
            assert (march.positions >= 5) == (formulation == "index-2")
            systems = march.positions + 5 * in_step
            expected = march.corrections * solved + systems * saddle
            assert operations.of_march(march) == expected > 0
    march = March(subject, scheme_of("index-3", "a-lambda", h=1e-5), "gmres")
    march.advance(5)
    assert operations.of_march(march) > 2 * len(march.system.rows) * sum(march.system.iterations)


def test_a_study_records_its_work(cli, quick):
    """Corrections times those of one, whatever the scaling; the same again."""
    cli("run", "quick.yaml")
    first = (cli.folder / "results/quick.json").read_bytes()
    # Of 3 unknowns and 6 entries: M and X on two places, and G twice.
    of_correction = 2 * 6 * 6 // (3 * 3) + 2 * 6
    cells = json.loads(first)["cells"]
    rows = {
        (row["preconditioning"], float(row["h"])): row
        for row in rows_in(cli.folder / "results/quick.csv")
    }
    for cell in cells:
        row = rows[cell["preconditioning"], cell["h"]]
        corrections = round(float(row["newton_iterations"]) * int(row["steps"]))
        assert cell["operations"] == corrections * of_correction
    cli("run", "quick.yaml", "--force", "--jobs", "2")
    assert (cli.folder / "results/quick.json").read_bytes() == first


def test_marches_are_timed_when_asked_for(cli):
    """By themselves, beside the record that is the same everywhere; a cell keeps its time."""
    cli.write("quick.yaml", QUICK.replace("[none, optimal]", "optimal") + "measure: error\n")
    run = cli.folder / "results/runs/quick.json"

    def seconds():
        return [cell.get("march_seconds") for cell in json.loads(run.read_text())["cells"]]

    cli("run", "quick.yaml")
    record = (cli.folder / "results/quick.json").read_bytes()
    assert seconds() == [None] * 2
    line = cli.refused("plot", "quick", "--measure", "work-precision", "--cost", "wall-time")
    assert "no march was timed; run the study again with --timed --force" in line
    cli("run", "quick.yaml", "--timed", "--force")
    timed = seconds()
    assert all(0 < each_of < 0.1 for each_of in timed)
    assert (cli.folder / "results/quick.json").read_bytes() == record
    cli("run", "quick.yaml")
    assert seconds() == timed
    done = cli(
        "plot", "quick", "--measure", "work-precision", "--cost", "wall-time", "--format", "svg"
    )
    assert "quick-pendulum-u-lambda-work-precision-u.svg" in done.stdout
