"""Work of a march: its linear systems by a formula in their size; wall times next to it."""

import json

import pytest
from conftest import QUICK, rows_in
from marching import formulated
from test_formulations import subject_of

from newmark_cli.newmark import operations
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.march import March


@pytest.mark.parametrize(
    ("formulation", "options", "solver", "in_step"),
    [
        ("index-3", {}, "dense-lu", 0),
        ("index-3", {}, "static-lu", 0),
        ("index-3", {"reported": "recovered"}, "sparse-lu", 1),
        ("ggl", {}, "dense-lu", 0),
        ("index-2", {"projection": "position-velocity accelerations"}, "sparse-lu", 2),
    ],
)
def test_work_follows_what_a_march_solves(formulation, options, solver, in_step):
    """Systems of its corrections, of projections and of recovered λ; the same by each solver.

    Full matrices take (2/3) N³ for the factors and 2 N² for the substitutions (Golub & Van Loan,
    §3.2).
    """
    assert abs(operations.direct(300, 300**2) - 2 / 3 * 300**3 - 2 * 300**2) < 1
    subject = subject_of("andrews")
    n, m, pattern = subject.n, subject.m, subject.pattern
    saddle = operations.direct(n + m, len(pattern.mass_rows) + 2 * len(pattern.g_rows))
    scheme = formulated(formulation, h=1e-5, **options)
    matrix, march = SparseSystem(subject, scheme), March(subject, scheme, solver)
    march.advance(5)
    assert (march.positions >= 5) == (formulation == "index-2")
    expected = march.corrections * operations.direct(matrix.size, len(matrix.rows))
    expected += (march.positions + 5 * in_step) * saddle
    assert operations.of_march(march) == expected > 0


def test_a_study_records_its_work(cli):
    """Corrections times those of one, whatever the scaling; the same again; times if asked for."""
    cli.write("quick.yaml", QUICK + "measure: error\n")
    record, run = (cli.folder / "results" / name for name in ("quick.json", "runs/quick.json"))

    def seconds():
        return [cell.get("march_seconds") for cell in json.loads(run.read_text())["cells"]]

    cli("run", "quick.yaml")
    first, rows = record.read_bytes(), rows_in(cli.folder / "results/quick.csv")
    # Of 3 unknowns and 6 entries: M and X on two places, and G twice.
    of_correction = 2 * 6 * 6 // (3 * 3) + 2 * 6
    cells = json.loads(first)["cells"]
    corrections = {
        (row["preconditioning"], row["h"]): float(row["newton_iterations"]) * int(row["steps"])
        for row in rows
    }
    for cell in cells:
        work = round(corrections[cell["preconditioning"], repr(cell["h"])]) * of_correction
        assert cell["operations"] == work
    assert seconds() == [None] * 4
    cli("run", "quick.yaml", "--timed", "--force")
    timed = seconds()
    assert all(0 < each_of < 0.1 for each_of in timed)
    assert record.read_bytes() == first
    cli("run", "quick.yaml")
    assert seconds() == timed
