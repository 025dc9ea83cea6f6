"""Series whose truth is known by construction, judged from a CSV as `check` judges them."""

import csv

import pytest
from bench import VERDICTS, bench

from newmark_cli.report.judging.slopes import of_csv
from newmark_cli.report.judging.verdicts import FAILING, MISS, NOT_CONVERGING, PASS

NAMED = bench("named")
with (VERDICTS / "truth.csv").open() as file:
    TRUTH = {row["problem"]: row for row in csv.DictReader(file) if row["study"] == NAMED.STUDY}


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("named")
    NAMED.write(folder)
    path = folder / f"{NAMED.STUDY}.csv"
    return {slope.problem: slope for slope in of_csv(path)}


@pytest.mark.parametrize("series", NAMED.NAMED)
def test_named_series(judged, series):
    """No right series is a miss, no wrong one passes, and of too few points nothing is said."""
    slope, label = judged[series.problem], TRUTH[series.problem]["label"]
    told = f"{slope.verdict}: {slope.reason}"
    if label in ("order", "floor"):
        assert slope.verdict == PASS, told
    elif label == "wrong":
        assert slope.verdict != PASS, told
    else:
        assert slope.verdict not in (PASS, MISS), told
        assert slope.verdict not in FAILING or slope.verdict == NOT_CONVERGING, told
