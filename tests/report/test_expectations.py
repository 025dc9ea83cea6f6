"""Slopes and levels that a config expects: judged by `check`, reported to servers, refused."""

import json
import re
import shutil
import xml.etree.ElementTree as ElementTree

import pytest
from command_line import invoke
from conftest import rows_in

import newmark_cli as newmark
from newmark_cli.report.reading import records
from newmark_cli.report.tables import outcomes
from newmark_cli.study import config

#: Errors of an integrator of order 2, conditions, and |λ|, of which theory predicts no order.
STUDY = """\
study: swing
problem: pendulum
form: u-lambda
preconditioning: [none, {name: mine, left: {D: beta*h^2}, right: {lambda: 1/(beta*h^2)}}]
integrator: {method: generalized-alpha, rho: 0.9}
measure: [condition, error, trajectory]
samples: 4
h: [1e-2, 5e-3, 2e-3, 1e-3]
t_end: 1.0
"""
#: Order 2, measured.
MEASURED = r"measured (1\.99|2\.0)"
EXPECT = STUDY.count("\n") + 1


def written(cli, *entries, text=STUDY):
    """The study with these expectations, one to a line from `EXPECT` + 1 on."""
    lines = "".join(f"  - {entry}\n" for entry in entries)
    return cli.write("swing.yaml", text + (f"expect:\n{lines}" if entries else ""))


@pytest.fixture(scope="module")
def marched(tmp_path_factory):
    """A results folder of the study without expectations, and what it printed."""
    folder = tmp_path_factory.mktemp("marched")
    (folder / "swing.yaml").write_text(STUDY)
    done = invoke(["run", "swing.yaml"], folder)
    assert done.returncode == 0, done.stderr
    return folder / "results"


@pytest.fixture
def expecting(cli, marched):
    """Runs the study with expectations, whose cells are all kept, and returns the command line."""

    def run(*entries):
        shutil.copytree(marched, cli.folder / "results", dirs_exist_ok=True)
        written(cli, *entries)
        assert "8 ok (8 cached)" in cli("run", "swing.yaml").stdout
        return cli

    return run


def rows(done):
    """Rows of `check --json` that are of expectations."""
    return [row for row in json.loads(done.stdout) if "expect" in row]


def value(folder, measure, quantity, h, column, scaling="none"):
    """A number of the CSV."""
    (row,) = [
        row
        for row in rows_in(folder / "swing.csv")
        if (row["measure"], row["quantity"], float(row["h"])) == (measure, quantity, h)
        and row["preconditioning"].partition("[")[0] == scaling
    ]
    return float(row[column])


def test_orders_and_levels(expecting, marched):
    """Each for every series that it matches; theory need not predict anything.

    `check` ends with 1 where one does not hold, and says what was measured.
    """
    cli = expecting(
        "{measure: error, quantity: u, slope: 2, within: 0.1}",
        "{measure: error, quantity: [u, v], preconditioning: mine, h: 1e-3, at_most: 1e-5}",
        "{measure: condition, preconditioning: none, slope: -4}",
        "{measure: trajectory, quantity: lambda, slope: 0, within: 0.05, at_least: 1, at_most: 3}",
        "{measure: error, quantity: u, preconditioning: none, slope: 3}",
        "{measure: condition, preconditioning: none, at_most: 10}",
        "{measure: condition, preconditioning: none, slope: -3}",
        "{measure: error, quantity: u, preconditioning: none, slope: 1}",
    )
    everything = cli("check", "--json", code=1)
    found = rows(everything)
    told = [(row["expect"], row["quantity"], row["expected"], row["verdict"]) for row in found]
    assert told == [
        (1, "u", "slope 2 ± 0.1", "pass"),
        (1, "u", "slope 2 ± 0.1", "pass"),
        (2, "u", "h = 0.001: at most 1e-05", "pass"),
        (2, "v", "h = 0.001: at most 1e-05", "pass"),
        (3, "jacobian", "slope −4 ± 0.05", "pass"),
        (4, "lambda", "slope 0 ± 0.05", "pass"),
        (4, "lambda", "every h: 1 to 3", "pass"),
        (4, "lambda", "slope 0 ± 0.05", "pass"),
        (4, "lambda", "every h: 1 to 3", "pass"),
        (5, "u", "slope 3 ± 0.2", "miss"),
        (6, "jacobian", "every h: at most 10", "miss"),
        (7, "jacobian", "slope −3 ± 0.05", "miss"),
        (8, "u", "slope 1 ± 0.2", "miss"),
    ]  # fmt: skip
    for place in (0, 9):
        assert found[place]["value"] == pytest.approx(2, abs=0.02)
    assert {row["preconditioning"] for row in found[:2]} == {
        "none", "mine[left D=beta*h^2; right lambda=1/(beta*h^2)]",
    }  # fmt: skip
    assert found[2]["value"] == value(marched, "error", "u", 1e-3, "last", "mine")
    assert found[10]["value"] == value(marched, "condition", "jacobian", 1e-3, "median")
    # Theory's orders may show at smaller h; what is written holds at these or does not.
    assert "slope 2 (interval 1.94 to 2.06) over h = 0.01 … 0.001" in found[-1]["reason"]
    printed = cli("check", code=1).stdout
    assert "swing, expect[1]: slope 2 ± 0.1\n" in printed
    assert "miss: swing, expect[5], error of u, pendulum generalized-alpha" in printed
    assert printed.endswith("9 of 13 expectations hold\n")
    assert "expectation" in cli("check", "--markdown", code=1).stdout
    # Predicted orders are judged as before.
    assert json.loads(everything.stdout)[0]["verdict"] == "pass"
    assert (cli.folder / "results/swing.csv").read_bytes() == (marched / "swing.csv").read_bytes()


def test_what_is_undecided_fails_if_strict(cli):
    """Two step sizes are no order; a level holds anyway."""
    text = STUDY.replace("[1e-2, 5e-3, 2e-3, 1e-3]", "[1e-2, 5e-3]")
    written(
        cli,
        "{measure: error, quantity: u, slope: 2}",
        "{measure: error, quantity: u, at_most: 1}",
        text=text.replace("condition, error, trajectory", "error"),
    )
    cli("run", "swing.yaml")
    done = cli("check")
    assert "warning: not judged: " in done.stderr
    assert "2 of 4 expectations hold (2 undecided)" in " ".join(done.stdout.split())
    for strict in ("--strict", "--strict-expectations"):
        done = cli("check", strict, "--junit", f"{strict}.xml", code=1)
        assert done.stderr.startswith("newmark-study: not judged: ")
    cli("check", "--junit", "lenient.xml")
    strict, of_expectations, lenient = (
        ElementTree.parse(cli.folder / f"{name}.xml").getroot()
        for name in ("--strict", "--strict-expectations", "lenient")
    )
    # Three series and two expectations, each for two scalings; and two levels.
    assert (strict.get("tests"), strict.get("failures"), strict.get("skipped")) == ("10", "8", "0")
    assert (of_expectations.get("failures"), of_expectations.get("skipped")) == ("2", "6")
    assert (lenient.get("failures"), lenient.get("skipped")) == ("0", "8")


def test_an_expectation_that_matches_no_series(expecting):
    """A planar mechanism has no reaction forces by name: told in a line, and in the table."""
    cli = expecting(
        "{measure: error, quantity: force, slope: 2}", "{measure: error, quantity: u, slope: 2}"
    )
    cli("validate", "swing.yaml")
    done = cli("check", "--junit", "out.xml", code=1)
    assert done.stderr == (
        "newmark-study: swing: expect[1]: results/swing.csv has no series with measure error, "
        "quantity force\n"
    )
    assert "2 of 3 expectations hold" in done.stdout
    root = ElementTree.parse(cli.folder / "out.xml").getroot()
    assert (root.get("errors"), root.get("failures")) == ("1", "0")
    (error,) = root.iter("error")
    assert error.get("message").startswith("incomplete: results/swing.csv has no series with")


def test_cells_that_fail_decide_no_expectation(cli):
    """Of a march that does not converge there is no order."""
    text = STUDY.replace("t_end: 1.0", "t_end: 1.0\niteration_cap: 1\naccept: not_converged")
    entries = "{measure: error, quantity: u, slope: 2}", "{measure: error, at_most: 1e9}"
    written(cli, *entries, text=text)
    cli("run", "swing.yaml")
    found = rows(cli("check", "--json", code=1))
    assert {row["verdict"] for row in found} == {"incomplete"}
    assert all("not_converged" in row["reason"] for row in found)


def test_the_record_has_them(expecting, marched):
    """A folder is checked without the config; after an edit of it `run` rewrites the record."""
    cli = expecting("{measure: error, quantity: u, slope: 2}")
    (cli.folder / "swing.yaml").unlink()
    shutil.copytree(cli.folder / "results", cli.folder / "other")
    assert "2 of 2 expectations hold" in cli("check", "--results", "other").stdout
    # An edit is not looked at before the next run, which computes nothing.
    written(cli, "{measure: error, quantity: u, slope: 3}")
    assert "2 of 2 expectations hold" in cli("check").stdout
    assert "8 ok (8 cached)" in cli("run", "swing.yaml").stdout
    assert "0 of 2 expectations hold" in cli("check", code=1).stdout
    for name in ("swing.csv", "trajectory/swing.csv"):
        same = {(cli.folder / at / name).read_bytes() for at in ("results", "other")}
        assert same == {(marched / name).read_bytes()}, name
    assert records.changed(cli.folder / "results", ["swing"]) == []


#: Expectations of error, and how many series each chooses.
SPELLED = {
    "slope: 2, integrator: {method: generalized-alpha, rho: 0.9}": 6,
    "slope: 2, integrator: generalized-alpha rho=0.9, problem: pendulum": 6,
    "slope: 2, quantity: u, stop: saturation, formulation: index-3": 2,
    "slope: 2, quantity: u, projection: {method: none}, start: consistent": 2,
    "slope: 2, quantity: u, multipliers: newton, evaluation: direct": 2,
    "slope: 2, quantity: u, linear_solver: dense-lu, precision: float64": 2,
    "slope: 2, quantity: u, linear_solver: auto, multipliers: auto": 2,
    "slope: 2, quantity: u, preconditioning: [none, mine]": 2,
    'slope: 2, quantity: u, preconditioning: "mine[left D=h^2*beta; right lambda=1/(beta*h^2)]"': 1,
    "slope: 2, quantity: u, preconditioning: "
    "{name: mine, left: {D: h*beta*h}, right: {lambda: 1/(beta*h^2)}}": 1,
}


def test_axes_are_spelled_as_in_cases_or_as_in_the_csv(expecting):
    """All spellings of a value choose the same series."""
    cli = expecting(*(f"{{measure: error, {entry}}}" for entry in SPELLED))
    found = rows(cli("check", "--json"))
    assert {row["verdict"] for row in found} == {"pass"}
    counts = [sum(row["expect"] == k for row in found) for k in range(1, len(SPELLED) + 1)]
    assert counts == [*SPELLED.values()]


@pytest.mark.parametrize(("entry", "words"), [
    ("{measure: eror, slope: 2}", "measure: unknown measure 'eror'; did you mean 'error'?"),
    ("{measure: error, slop: 2}", "slop: unknown key; did you mean 'slope'?"),
    ("{measure: error}", "slope: missing: give slope, at_most, at_least, spread or status"),
    ("{measure: error, quantity: a, slope: 2}", "quantity: error has no 'a'; allowed: u, v, lam"),
    ("{measure: error, slope: two}", "slope: must be a number, given 'two'"),
    ("{measure: error, slope: 2, within: 0}", "within: must be greater than 0, given 0"),
    ("{measure: error, slope: 2, h: 1e-3}", "h: is where at_most or at_least hold"),
    ("{measure: error, at_most: 1, at_least: 2}", "at_least: must not exceed at_most = 1, given 2"),
    ("{measure: error, at_most: 1, within: 2}", "within: is the tolerance of a slope"),
    ("{measure: trajectory, slope: 0}", "within: missing: trajectory has no tolerance of its own"),
    ("{measure: error, slope: 2, form: v-lamda}", "form: unknown form 'v-lamda'; did you mean"),
    ("{measure: error, slope: 2, integrator: bdf3}", "integrator: unknown"),
    ("{measure: error, slope: 2, integrator: {method: hht}}", "integrator.method: hht needs alpha"),
    ("{measure: error, slope: 2, linear_solver: gmre}", "did you mean 'gmres'?"),
    ("3", "must be a mapping of keys such as measure, quantity, problem, given 3"),
])  # fmt: skip
def test_mistakes(tmp_path, entry, words):
    text = f"{STUDY}expect:\n  - {{measure: error, quantity: u, slope: 2}}\n  - {entry}\n"
    (tmp_path / "swing.yaml").write_text(text)
    with pytest.raises(newmark.InputError) as caught:
        config.load(tmp_path / "swing.yaml", "swing.yaml")
    assert str(caught.value).startswith(f"swing.yaml, line {EXPECT + 2}: expect[2]")
    assert words in str(caught.value)


def test_junit(expecting):
    """A suite for each study, a case for each series that is predicted and each expectation."""
    cli = expecting(
        "{measure: error, quantity: u, preconditioning: none, slope: 3}",
        "{measure: error, quantity: v, at_most: 1}",
    )
    done = cli("check", "--junit", "reports/slopes.xml", code=2)
    assert "reports/slopes.xml: cannot be written: there is no folder" in done.stderr
    assert not (cli.folder / "reports").exists()
    printed = cli("check", "--junit", "slopes.xml", code=1).stdout
    assert "xml" not in printed
    root = ElementTree.parse(cli.folder / "slopes.xml").getroot()
    (suite,) = root
    assert (root.tag, suite.tag, suite.get("name")) == ("testsuites", "testsuite", "swing")
    cases = suite.findall("testcase")
    # Two conditions, six errors; and three of expectations.  |λ| is shown, not judged.
    for one in (root, suite):
        counts = [one.get(key) for key in ("tests", "failures", "errors", "skipped")]
        assert counts == ["11", "1", "0", "0"]
    assert {case.get("classname") for case in cases} == {"swing"}
    assert len({case.get("name") for case in cases}) == 11
    first, *others = cases
    assert first.get("name").startswith("expect[1], error of u, pendulum generalized-alpha rho=0.9")
    assert (first.get("file"), first.get("line")) == ("swing.yaml", str(EXPECT + 1))
    assert first.find("failure").get("type") == "miss"
    assert re.match(MEASURED, first.find("failure").get("message").removeprefix("miss: "))
    assert all(len(case) == 0 for case in others)


def test_annotations(expecting, monkeypatch):
    """In GitHub's workflows an error points at the line of the expectation."""
    cli = expecting("{measure: error, quantity: u, preconditioning: none, slope: 3, within: 0.1}")
    assert "::" not in cli("check", code=1).stdout
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_WORKSPACE", str(cli.folder.parent))
    (line,) = [s for s in cli("check", code=1).stdout.splitlines() if s.startswith("::")]
    named = (
        f"::error file={cli.folder.name}/swing.yaml,line={EXPECT + 1},title=swing%3A miss::"
        "expect[1], error of u, pendulum generalized-alpha rho=0.9 u-lambda none, slope 3 ± 0.1; "
    )
    assert line.startswith(named)
    assert re.match(MEASURED, line.removeprefix(named))
    # What a program reads stays what it was.
    done = cli("check", "--json", code=1)
    assert len(rows(done)) == 1
    assert done.stderr == line + "\n"
    # A file that is not there, or not in the repository, is not named.
    monkeypatch.setenv("GITHUB_WORKSPACE", str(cli.folder / "elsewhere"))
    assert "::error title=swing%3A miss::expect[1]" in cli("check", code=1).stdout
    # What holds is not worth a word.
    expecting("{measure: error, quantity: u, slope: 2}")
    assert "::" not in cli("check").stdout


def test_annotations_are_one_line_each_and_no_more_than_github_shows():
    """Names may have what ends a command; undecided ones are warnings, or errors."""
    found = [outcomes.Outcome("a,b", f"50%\nno: {i}", "miss", "x, y") for i in range(12)]
    lines = outcomes.annotations(found, outcomes.LENIENT)
    assert lines == [f"::error title=a%2Cb%3A miss::50%25%0Ano: {i}; x, y" for i in range(10)]
    word = outcomes.UNDECIDED
    undecided = [outcomes.Outcome("s", "n", word, "")]
    assert outcomes.annotations(undecided, outcomes.LENIENT) == [f"::warning title=s%3A {word}::n"]
    assert outcomes.annotations(undecided, outcomes.ALL) == [f"::error title=s%3A {word}::n"]
