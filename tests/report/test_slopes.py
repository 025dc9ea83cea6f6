"""Verdicts on series: predicted, shown, incomplete; synthetic CSVs with known slopes."""

import json
import math
from decimal import Decimal

import numpy as np
import pytest
import synthetic
from conftest import rows_in

from newmark_cli.report.judging.fits import log10
from newmark_cli.report.judging.slopes import COLUMNS, collect, of_csv, write
from newmark_cli.report.judging.verdicts import (
    INCOMPLETE,
    MISS,
    NOT_CONVERGING,
    PASS,
    SHOWN,
    UNDECIDED,
)
from newmark_cli.report.tables import check, outcomes
from newmark_cli.study import csv_files

STEPS = (1e-2, 1e-3, 1e-4, 1e-5)


def series(values, **columns):
    """Rows of one series: values against step sizes; every statistic is the value.

    Rounding is what columns say, or 1e-13.
    """
    values = values if isinstance(values, dict) else dict(zip(STEPS, values, strict=False))
    columns = {"rounding": 1e-13} | columns
    return [synthetic.row(value, h=h) | columns for h, value in values.items()]


def power(order, steps=STEPS):
    """Values of an exact power law."""
    return {h: 1e-9 * h**order for h in steps}


def found(folder, table, accept=None):
    """Slopes of a study's rows."""
    path = folder / "own.csv"
    path.write_text(csv_files.csv_text(csv_files.COLUMNS, table))
    if accept is not None:
        record = {"rows": len(table), "config": {"cases": [{"h": [1]}, {"accept": accept}]}}
        path.with_suffix(".json").write_text(json.dumps(record))
    return of_csv(path)


@pytest.mark.parametrize(
    ("label", "order", "damped"),
    [
        ("newmark beta=0.25 gamma=0.5", 2, False),
        ("newmark beta=0.3025 gamma=0.6", 1, True),
        ("generalized-alpha rho=0.9", 2, True),
        ("generalized-alpha rho=1.0", 2, False),
        ("hht alpha=0.1", 2, True),
        ("bdf1", 1, True),
        ("bdf2", 2, True),
    ],
)
def test_integrators(tmp_path, label, order, damped):
    """Errors converge with the integrator's order, λ only if it damps; corrections alike."""
    table = series(power(-2), integrator=label)
    for quantity in ("u", "v", "lambda"):
        values = {h: h**order for h in STEPS}
        table += series(values, integrator=label, measure="error", quantity=quantity)
    correction, *errors = found(tmp_path, table)
    assert (correction.expected, correction.verdict) == (-2, PASS)
    assert [s.verdict for s in errors] == [PASS, PASS, PASS if damped else SHOWN]
    assert [s.expected for s in errors[:2]] == [order, order]
    assert {s.tolerance for s in errors[:2]} == {0.2}


@pytest.mark.parametrize("accept", [None, ["not_converging"]])
def test_a_study_may_be_about_what_does_not_converge(tmp_path, accept):
    """Where theory predicts no order: the trapezoidal λ, not u, which has order 2."""
    table = series((2.1, 2.1, 2.1), measure="error", quantity="lambda")
    table += series((1e-2, 1e-4, 1e-6), measure="error", quantity="v")
    slopes = found(tmp_path, table, accept)
    assert [s.verdict for s in slopes] == [NOT_CONVERGING, PASS]
    assert [s.fails for s in slopes] == [accept is None, False]
    assert outcomes.hold(outcomes.of(slopes)) == (accept is not None)
    table = series((2.1, 2.1, 2.1), measure="error", quantity="u")
    assert [s.fails for s in found(tmp_path, table, accept)] == [True]


@pytest.mark.parametrize("quantity", ["position", "velocity", "multiplier", "energy"])
def test_invariants(tmp_path, quantity):
    """Nothing is predicted; what falls with h, or is rounding, is shown; what does not, fails."""
    for values, verdict in (
        ((1e-2, 1e-4, 1e-6), SHOWN),
        ((1e-16, 2e-16, 4e-16), SHOWN),
        ((1e-2, 1e-2, 1e-2), NOT_CONVERGING),
        ((1e-4, 1e-2, 1e-1), NOT_CONVERGING),
    ):
        (slope,) = found(tmp_path, series(values, measure="invariant", quantity=quantity))
        assert (slope.verdict, slope.fails) == (verdict, verdict == NOT_CONVERGING)
        assert np.isnan([slope.expected, slope.tolerance]).all()


def test_nothing_to_judge_is_no_success(tmp_path):
    """Two step sizes, or only what theory says nothing of: the check fails, and says why."""
    for table in (series((1e-2, 1e-4), measure="error", quantity="u"),
                  series(power(0), measure="history")):  # fmt: skip
        slopes = found(tmp_path, table)
        assert not any(slope.fails for slope in slopes)
        assert not outcomes.hold(outcomes.of(slopes))
        assert check.summary(slopes, []).endswith("nothing could be judged")


def test_a_miss_has_its_local_orders_and_its_reason(tmp_path):
    """A line for each series that is not as predicted."""
    table = series((1e-1, 1e-2, 1e-3, 1e-4), measure="error", quantity="u")
    (line,) = check.remarks(found(tmp_path, table))
    assert line == (
        "miss: own andrews u-lambda trapezoidal none, error of u: local orders 1.00 1.00 1.00; "
        "slope 1 (interval 0.98 to 1.02) over h = 0.01 … 1e-05"
    )
    assert check.remarks(found(tmp_path, series(power(-2)))) == []


def test_an_order_that_ends_is_told(tmp_path):
    """Nothing is predicted of λ, and the check passes; that it gets worse again is said."""
    table = series((1e-2, 1e-4, 1e-6, 1e-3), measure="error", quantity="lambda")
    table[-1]["rounding"] = 2e-3
    slopes = found(tmp_path, table)
    (line,) = check.remarks(slopes)
    assert line == (
        "shown: own andrews u-lambda trapezoidal none, error of λ: local orders 2.00 2.00 −3.00; "
        "rounding rules below h = 0.0001"
    )
    assert (slopes[0].verdict, slopes[0].fails) == (SHOWN, False)
    table = series((1e-2, 1e-4, 1e-6, 1e-8), measure="error", quantity="lambda")
    assert check.remarks(found(tmp_path, table)) == []


@pytest.mark.parametrize(("facts", "verdict", "reason"), [
    ({"driven": True}, SHOWN, "only rounding: the constraints alone determine it"),
    ({}, UNDECIDED, "larger h would decide"),
])  # fmt: skip
def test_positions_that_constraints_determine_have_no_order(tmp_path, facts, verdict, reason):
    """No step size would decide: each error of u is rounding, whatever the integrator."""
    (tmp_path / "own.json").write_text(json.dumps({"motions": {"andrews": facts}}))
    rounding = {"measure": "error", "quantity": "u", "rounding": 1e-16}
    (slope,) = found(tmp_path, series((1e-16, 2e-16, 1e-16), **rounding))
    assert slope.verdict == verdict
    assert reason in slope.reason


def test_singular_positions_and_rest_are_told(tmp_path):
    """What the record says of the motion is part of the verdict; theory is for regular ones."""
    path = tmp_path / "own.json"
    missing, rising = series(power(-3.1)), series((1e-2, 3e-2, 9e-2), measure="error", quantity="u")
    for facts, verdicts in (
        ({"singular": [0.25]}, [UNDECIDED, NOT_CONVERGING]),
        ({"still": True}, [UNDECIDED, UNDECIDED]),
        ({}, [MISS, NOT_CONVERGING]),
    ):
        path.write_text(json.dumps({"motions": {"andrews": facts}}))
        slopes = found(tmp_path, missing + rising)
        assert [s.verdict for s in slopes] == verdicts
        told = "passes a singular position near t = 0.25" in slopes[0].reason
        assert told == ("singular" in facts)


def test_multipliers_that_alternate_from_the_start_are_told(tmp_path):
    """By what the integrator leaves of them after the steps of a run."""
    rest = {"measure": "error", "quantity": "lambda", "integrator": "generalized-alpha rho=0.9"}
    (slope,) = found(tmp_path, series((1e-2, 1e-3, 1e-4), steps=20, **rest))
    assert slope.verdict == UNDECIDED
    assert "λ still alternates from the start at h = 0.01: ρ∞ = 0.9 leaves" in slope.reason
    rest |= {"measure": "physical_correction"}  # where it is no cause
    (slope,) = found(tmp_path, series((1e-2, 1e-3, 1e-4), steps=20, **rest))
    assert (slope.verdict, "alternates" in slope.reason) == (MISS, False)


@pytest.mark.parametrize(("measure", "quantity"), [
    ("krylov_iterations", "jacobian"), ("krylov_residual", "jacobian"), ("history", "lambda"),
    ("tolerance", "newton"),
])  # fmt: skip
@pytest.mark.parametrize("status", ["ok", "not_converged", "diverged"])
def test_shown(tmp_path, measure, quantity, status):
    """No prediction, no tolerance; neither counted nor failed, whatever the cells' status."""
    table = series(
        power(-0.3), measure=measure, quantity=quantity, linear_solver="gmres", status=status,
        met=999,
    )  # fmt: skip
    (shown,) = found(tmp_path, table)
    assert shown.verdict == SHOWN
    assert np.isnan([shown.expected, shown.tolerance]).all()
    predicted, _ = slopes = found(tmp_path, series(power(-2)) + table)
    assert check.summary(slopes, []) == "1 of 1 slopes as predicted"
    assert outcomes.hold(outcomes.of(slopes))
    assert check.chosen(slopes, everything=False) == []
    assert check.chosen(slopes, everything=True) == slopes
    assert predicted.verdict == PASS


def test_corrections_at_a_tolerance_are_shown(tmp_path):
    """Newton stops where it is told to, not where rounding ends it; J̄ is what it was."""
    table = []
    for measure in ("correction", "physical_correction"):
        table += series(power(-0.7), measure=measure, stop="absolute 1e-08")
    table += series(power(-4), measure="condition", quantity="jacobian", stop="absolute 1e-08")
    assert [s.verdict for s in found(tmp_path, table)] == [SHOWN, SHOWN, PASS]


@pytest.mark.parametrize(
    ("accept", "verdicts"),
    [
        (None, [PASS, INCOMPLETE, INCOMPLETE]),
        ([], [PASS, INCOMPLETE, INCOMPLETE]),
        (["not_converged"], [PASS, INCOMPLETE, INCOMPLETE]),
        (["stagnated"], [PASS, SHOWN, INCOMPLETE]),
        (["stagnated", "singular"], [PASS, SHOWN]),
    ],
)
def test_accepted_statuses(tmp_path, accept, verdicts):
    """Cells that end as the study's config says are findings; others are failures."""
    stagnated = series(power(-3.1), preconditioning="left")
    stagnated[2]["status"] = "stagnated"
    nothing = dict.fromkeys(("quantity", "measure", "role"), "")
    singular = [synthetic.row(**nothing, h=1e-3, preconditioning="right", status="singular")]
    slopes = found(tmp_path, series(power(-2)) + stagnated + singular, accept)
    assert [s.verdict for s in slopes] == verdicts


def test_records_of_all_kinds_are_read(tmp_path):
    """What stands beside a CSV may be anything; then nothing is accepted."""
    table = series(power(-2))
    for text in ("", "[]", "{}", '{"config": 3}', '{"config": {"cases": [1, {"accept": null}]}}'):
        (tmp_path / "own.json").write_text(text)
        assert [s.verdict for s in found(tmp_path, table)] == [PASS]


@pytest.mark.parametrize(
    ("column", "value", "order", "verdict"),
    [
        # Another case of the study: two points fit any line, but nothing was cut off.
        ("integrator", "bdf2", -2, UNDECIDED),
        ("evaluation", "compensated", -1, UNDECIDED),
        ("precision", "float32", -2, UNDECIDED),
        ("linear_solver", "sparse-lu", -2, UNDECIDED),
        ("problem", "pendulum", -2, UNDECIDED),
        # Fewer step sizes than others of its case have.
        ("form", "v-lambda", -2, INCOMPLETE),
        ("preconditioning", "right", 0, INCOMPLETE),
        ("quantity", "u", 0, INCOMPLETE),
    ],
)
def test_cases_may_have_step_sizes_of_their_own(tmp_path, column, value, order, verdict):
    """Forms, variants and quantities of a case have the same, or a series was cut."""
    short = series(power(order, STEPS[:2]), **{column: value})
    assert [s.verdict for s in found(tmp_path, series(power(-2)) + short)] == [PASS, verdict]


def test_errors_may_have_fewer_step_sizes_and_need_one_end(tmp_path):
    """They cost a reference; corrections along the way are not those of an end."""
    values, error = {h: h**2 for h in STEPS}, {"measure": "error", "rounding": 1e-30}
    table = series(values, quantity="u", **error) + series(power(-2))
    table += series(dict([*values.items()][:3]), quantity="v", **error)
    assert [s.verdict for s in found(tmp_path, table)] == [PASS] * 3
    for row in table:
        row["t_end"] = 1.0 if row["h"] > 1e-4 else 2.0
    slopes = found(tmp_path, table)
    assert [s.verdict for s in slopes] == [SHOWN, PASS, SHOWN]
    assert slopes[0].reason == "taken at different times"


def test_slopes_csv(tmp_path):
    """Columns appended, none renamed; empty where theory says nothing."""
    assert COLUMNS == (
        "figure", "study", "form", "preconditioning", "quantity", "measure", "slope", "stderr",
        "points", "expected", "tolerance", "verdict", "problem", "integrator", "row_block",
        "evaluation", "precision", "linear_solver", "stop", "h_from", "h_to", "local_orders",
        "reason", "formulation", "projection", "multipliers", "start", "h_sequence", "auxiliary",
        "code",
    )  # fmt: skip
    kinds = {"evaluation": "compensated", "precision": "float32", "linear_solver": "sparse-lu"}
    table = series(power(-1), **kinds)
    table += series(power(0), measure="tolerance", quantity="newton", stop="absolute 1e-08", met=7)
    write(tmp_path, found(tmp_path, table))
    first, second = rows_in(tmp_path / "slopes.csv")
    assert {column: first[column] for column in kinds} == kinds
    assert (first["stop"], first["expected"], first["verdict"]) == ("saturation", "-1.0", PASS)
    assert float(first["slope"]) == pytest.approx(-1)
    assert (second["expected"], second["tolerance"], second["verdict"]) == ("", "", SHOWN)
    assert second["stop"] == "absolute 1e-08"


def test_fits_have_the_same_bits_whatever_the_logarithm(committed_folder, tmp_path, monkeypatch):
    """The rows that travel with the project, where logarithms are an ulp off.

    NumPy's depend on AVX-512, and those of a C library on fused multiply-adds.
    """
    studies = ("cures-krylov", "drift", "pendulum-u")
    for module, name in ((np, "log"), (np, "log10"), (np, "log2"), (np, "hypot"), (math, "log10")):
        exact = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda *x, exact=exact: exact(*x) * (1 + np.finfo(float).eps)
        )
    write(tmp_path, collect(committed_folder, studies))
    shipped = rows_in(committed_folder / "slopes.csv")
    for row in rows_in(tmp_path / "slopes.csv"):
        assert any(row.items() <= other.items() for other in shipped), row


@pytest.mark.parametrize(
    "x", [1e-300, 3e-7, 0.7, 1.0, 1.4142135623730951, 1e-3, 10.0, 1e22, 1.7e308, 5e-324]
)
def test_logarithms_are_as_exact_as_they_need_be(x):
    """Within three units in the last place of the logarithm, or of 1 near x = 1."""
    exact = Decimal(x).log10()
    assert abs(Decimal(float(log10(x))) - exact) <= 3 * Decimal(
        float(np.spacing(max(abs(float(exact)), 0.1)))
    )


def test_misses_are_named_in_full(tmp_path):
    """A row of the table says which integrator, evaluation, precision and solver it is."""
    kinds = {"evaluation": "compensated", "precision": "float32", "linear_solver": "sparse-lu"}
    slopes = found(tmp_path, series(power(-3), integrator="bdf2", **kinds))
    _, row = check.slope_rows(check.chosen(slopes, everything=False))
    assert row[1] == "own andrews u-lambda bdf2"
    assert row[3] == "none, compensated, float32, sparse-lu"
    assert row[-1] == MISS
