"""Claims of the figures past the paper: true of good results, false of spoilt ones."""

import json
import math

import numpy as np
import pytest
import synthetic
from click.testing import CliRunner
from each import each

from newmark_cli.cli.commands import cli as command_line
from newmark_cli.report import check
from newmark_cli.report.claims import (
    BoundClaim,
    RatioClaim,
    SlopeClaim,
    SpreadClaim,
    StatusClaim,
    evaluate,
)
from newmark_cli.report.curves import Curve
from newmark_cli.report.figures import FIGURES
from newmark_cli.report.slopes import study_slopes
from newmark_cli.report.verdicts import INCOMPLETE, MISS, PASS
from newmark_cli.study.reading import read_rows

EVERY_FIGURE = each("figure", synthetic.CLAIMING)


def judged(folder, figure, table=None):
    """Findings of a figure's claims on its study's CSV."""
    path = synthetic.write(folder, figure, table)
    entries = check.judge(study_slopes(read_rows(path), path))
    assert all(entry.figure is figure for entry in entries)
    assert [entry.claim.text for entry in entries] == [claim.text for claim in figure.claims]
    return [entry.finding for entry in entries]


def where(curve):
    """Columns of the CSV that pick a curve's rows."""
    return {name: given for name, given in curve.key.named().items() if name != "initial"}


def scaled(factor):
    """Change of a row: every statistic times a factor, which may depend on the row."""

    def change(row):
        by = factor(row) if callable(factor) else factor
        found = {k: row[k] * by for k in ("rms", "max", "median", "last") if row[k] != ""}
        return found | ({"met": int(row["met"] * by)} if row["met"] != "" else {})

    return change


def rows_of(claim):
    """Rows of its curves: whether other series are there changes nothing, where these are."""
    curves = dict.fromkeys(synthetic.curves_of(claim))
    return [row for curve in curves for row in synthetic.rows_of(curve)]


def spoil(claim, table):
    """Rows that a claim is false of, and nothing else is wrong with."""
    if isinstance(claim, SlopeClaim):
        change = scaled(lambda row: row["h"] ** 0.5)
        return synthetic.spoilt(table, where(claim.curve), change)
    if isinstance(claim, StatusClaim):
        return synthetic.spoilt(table, where(claim.curve), lambda row: {"status": "ok"})
    if isinstance(claim, SpreadClaim):
        change = scaled(lambda row: 3 if row["h"] == 1e-3 else 1)
        return synthetic.spoilt(table, where(claim.curve), change)
    if isinstance(claim, BoundClaim):
        if claim.high == 0.5:  # steps that must not meet the tolerance all do
            return synthetic.spoilt(table, where(claim.curve), lambda row: {"met": row["steps"]})
        up = math.isfinite(claim.high) and claim.high != claim.low
        return synthetic.spoilt(table, where(claim.curve), scaled(1e6 if up else 1e-6))
    above = claim.pairs[-1][0]
    at = claim.at or (None, None)
    change = scaled(lambda row: 1e-9 if at[0] in (None, row["h"]) else 1)
    return synthetic.spoilt(table, where(above), change)


@EVERY_FIGURE
def test_claims_hold_on_good_results(tmp_path, figure):
    """Every claim, with a number or words for what was measured."""
    for finding in judged(tmp_path, figure):
        assert finding.verdict == PASS, finding
        assert finding.measured


@EVERY_FIGURE
def test_claims_fail_on_spoilt_results(tmp_path, figure):
    """Each claim is false of numbers that say otherwise, though all cells are as before."""
    fail = {
        claim.text: judged(tmp_path, figure, spoil(claim, rows_of(claim)))[i].verdict
        for i, claim in enumerate(figure.claims)
    }
    assert fail == dict.fromkeys(fail, MISS)
    assert len(fail) == len(figure.claims) > 0


@EVERY_FIGURE
def test_claims_need_their_data(tmp_path, figure):
    """Without the series, and with cells that failed, a claim is incomplete."""
    wrong = []

    def require(claim, table, verdict, why):
        index = figure.claims.index(claim)
        found = judged(tmp_path, figure, table)[index].verdict
        if found != verdict:
            wrong.append((claim.text, why, found))

    every = synthetic.rows(figure)
    for claim in figure.claims:
        needed, table = synthetic.curves_of(claim), rows_of(claim)
        given = table if len(needed) > 1 else every
        for curve in needed[:: max(len(needed) - 1, 1)]:
            picked = where(curve)
            rest = [r for r in given if not all(r[k] == v for k, v in picked.items())]
            assert len(rest) < len(given), "the study has what is claimed"
            # What is left must not be empty, or it would be no study at all.
            rest = rest or synthetic.spoilt(table, picked, lambda row: {"quantity": "v"})
            require(claim, rest, INCOMPLETE, f"without {picked}")
            broken = synthetic.spoilt(table, picked, lambda row: {"status": "diverged"})
            status = isinstance(claim, StatusClaim)
            require(claim, broken, MISS if status else INCOMPLETE, f"{picked} diverged")
            if not status:
                empty = synthetic.spoilt(
                    table, picked,
                    lambda row: dict.fromkeys(("rms", "max", "median", "last", "met")),
                )  # fmt: skip
                require(claim, empty, INCOMPLETE, f"{picked} without values")
    assert not wrong


def test_claims_of_the_figures():
    """What the figures are held to, as check prints it."""
    assert {f.name: [claim.text for claim in f.claims] for f in synthetic.CLAIMING} == {
        "10": [
            "none: slope −2 ± 0.15",
            "left: slope −2 ± 0.15",
            "right: slope −2 ± 0.15",
            "optimal: slope −2 ± 0.15",
            "optimal, compensated: slope −1 ± 0.15",
            "optimal / none, every h: 0.5 to 2",
            "optimal, direct / compensated, h = 1e-07: at least 10000",
        ],
        "11": [
            "generalized-α, compensated: slope 2 ± 0.1",
            "generalized-α, compensated, h = 1e-07: at most 2e-08",
            "generalized-α, direct, h = 1e-07: at least 1e-06",
            "generalized-α, direct, h = 1e-07 / h = 1e-06: at least 1",
            "trapezoidal, none, h = 1e-06: at least 10",
            "trapezoidal, left, h = 1e-06: at least 10",
            "trapezoidal, right, h = 1e-06: at least 10",
            "trapezoidal, optimal, h = 1e-06: at least 10",
        ],
        "12": [
            "right, every h: 1",
            "optimal, every h: 1",
            "none, h = 1e-07: at most 0.5",
            "left, h = 1e-07: at most 0.5",
        ],
        "13": [
            "optimal: (max − min)/min over h at most 0.3",
            "none, smallest h: stagnated",
        ],
        "14": ["float32 / float64 / 2²⁹, every form, unknown, variant and h: 0.25 to 4"],
        "15": ["max |λ|, trapezoidal, direct / generalized-α, direct: at least 10"],
        "16": [
            *(
                f"{name}{claimed}"
                for name in ("index 2", "index 1", "GGL", "GGL + dissipation")
                for claimed in (": slope 2 ± 0.15", ", h = 1e-06: at most 1e-06")
            ),
            "velocity projection: slope 2 ± 0.15",
            "velocity projection, h = 1e-06: at most 1e-06",
            "index 3, h = 1e-06: at least 10",
            "slider-crank, index 3, every h: at least 1",
            "slider-crank, corrected start: slope 2 ± 0.15",
            "slider-crank, index 3 / corrected start, h = 0.0001: at least 1000",
            "shaken pendulum, GGL: slope 2 ± 0.15",
            "shaken pendulum, velocity projection: slope 2 ± 0.15",
        ],
        "18": [
            *(
                f"{problem}, {which}, every h: at most 1e-12"
                for problem in ("andrews", "shaken-pendulum")
                for which in (
                    "position, index 3",
                    "velocity, index 2",
                    "position, GGL",
                    "velocity, GGL",
                    "velocity, velocity projection",
                )
            ),
            "andrews, position, index 1, every h: at least 1e-10",
            "shaken-pendulum, position, index 1, every h: at least 1e-10",
        ],
    }


# -- the kinds, by numbers ------------------------------------------------------------------


class Series:
    """Values against h, all of cells that are ok."""

    def __init__(self, **points):
        self.h = np.array([10.0 ** -int(name[1:]) for name in points])
        self.values = np.array(list(points.values()), float)
        self.statuses = ("ok",) * len(points)


ONE, OTHER = (Curve(label, "s", "pendulum", "u", "correction") for label in ("one", "other"))


def finding(claim, **series):
    """What a claim comes to on series of the two curves."""
    return evaluate(claim, lambda curve: series.get(curve.label))


@each(
    ("claim", "value", "verdict"),
    [
        (SlopeClaim(ONE, 2, 0.05), 2.0, PASS),
        (SlopeClaim(ONE, 1.9, 0.05), 2.0, MISS),
        (BoundClaim(ONE, high=1), 1.0, PASS),
        (BoundClaim(ONE, high=0.5), 1.0, MISS),
        (BoundClaim(ONE, low=1e-4), 1e-4, PASS),
        (BoundClaim(ONE, low=2e-4), 1e-4, MISS),
        (BoundClaim(ONE, low=1e-3, high=0.9), 1e-4, MISS),
        (BoundClaim(ONE, high=0.5, h=1e-1), 1e-2, PASS),
        (BoundClaim(ONE, high=0.5, h=1e-3), np.nan, INCOMPLETE),
        (RatioClaim("q", ((ONE, OTHER),), 0.005, 0.5), 0.5, PASS),
        (RatioClaim("q", ((ONE, OTHER),), 0.02, 10), 0.01, MISS),
        (RatioClaim("q", ((ONE, OTHER),), 0.1, 0.5), 0.01, MISS),
        (RatioClaim("q", ((ONE, OTHER),), 0.01, 0.2), 0.5, MISS),
        (RatioClaim("q", ((ONE, OTHER),), 0.9, 50, unit=0.01), 50.0, PASS),
        (RatioClaim("q", ((ONE, ONE),), 1, at=(1.0, 1e-2)), 1e4, PASS),
        (RatioClaim("q", ((ONE, ONE),), 1, at=(1e-2, 1.0)), 1e-4, MISS),
        (RatioClaim("q", ((ONE, ONE), (OTHER, ONE)), high=5), 100.0, MISS),
        (SpreadClaim(OTHER, 199), 199.0, PASS),
        (SpreadClaim(OTHER, 198), 199.0, MISS),
        (StatusClaim(ONE, "ok"), np.nan, PASS),
    ],
)
def test_kinds(claim, value, verdict):
    """The value that is farthest beyond a bound, or nearest to one, decides."""
    found = finding(claim, one=Series(e0=1, e1=1e-2, e2=1e-4), other=Series(e0=2, e1=1, e2=1e-2))
    assert found.verdict == verdict
    assert found.value == pytest.approx(value, rel=1e-12, nan_ok=True)


def test_quotients_need_the_same_step_sizes():
    """One step size more in the denominator is a hole, not a detail."""
    claim = RatioClaim("q", ((ONE, OTHER),), 0, 10)
    found = finding(claim, one=Series(e0=1, e1=1), other=Series(e0=1, e1=1, e2=1))
    assert (found.verdict, found.measured) == (INCOMPLETE, "one, other: at different step sizes")
    found = finding(claim, one=Series(e0=1), other=Series(e0=0))
    assert (found.verdict, found.measured) == (INCOMPLETE, "other: zero")


# -- the command line -----------------------------------------------------------------------


def checked(folder, *options):
    """Exit code and output of `check` in this process."""
    done = CliRunner().invoke(
        command_line, ["check", "--results", str(folder), *options], standalone_mode=False
    )
    assert done.exception is None, done.exception
    return done.return_value, done.stdout


def test_check_prints_claims(tmp_path):
    """Below the slopes, in three formats; only of studies that are there."""
    synthetic.write(tmp_path, FIGURES["12"])
    synthetic.write(tmp_path, FIGURES["10"])
    code, text = checked(tmp_path)
    assert code == 0
    lines = text.splitlines()
    (start,) = (i for i, line in enumerate(lines) if line.startswith("claim  "))
    first, second = (i for i, line in enumerate(lines) if line.startswith("figure "))
    assert lines[first] == "figure 10, multipliers: Δλ (physical)"
    assert lines[second] == "figure 12, tolerance: share of steps"
    assert start < first < second
    assert [line.endswith("pass") for line in lines[first + 1 : second - 1]] == [True] * 7
    assert [line.endswith("pass") for line in lines[second + 1 : -2]] == [True] * 4
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "5 of 5 slopes as predicted, 11 of 11 claims hold"
    markdown = checked(tmp_path, "--markdown")[1]
    row = "| 12 | tolerance | share of steps | none, h = 1e-07: at most 0.5 | 0 | pass |"
    assert row in markdown.splitlines()
    found = json.loads(checked(tmp_path, "--json")[1])
    assert len(found) == 5 + 4 + 11
    assert found[-1] == {
        "figure": "12",
        "study": "tolerance",
        "claim": "left, h = 1e-07: at most 0.5",
        "measured": "0",
        "value": 0.0,
        "verdict": "pass",
    }


@each(
    "change, said",
    [
        (lambda row: {"met": 999 if row["h"] == 1e-5 else row["met"]}, "0.999"),
        (lambda row: {"preconditioning": "none[left:]"}, "no optimal"),
    ],
)
def test_check_fails_on_a_claim(tmp_path, change, said):
    """Exit 1 when a claim is false, or its data are missing in a study that is there."""
    figure = FIGURES["12"]
    table = synthetic.spoilt(synthetic.rows(figure), {"preconditioning": "optimal"}, change)
    synthetic.write(tmp_path, figure, table)
    code, text = checked(tmp_path)
    assert code == 1
    (line,) = (line for line in text.splitlines() if line.startswith("optimal, every h: 1 "))
    assert said in line
    assert text.splitlines()[-1] == "0 of 0 slopes as predicted, 3 of 4 claims hold"
