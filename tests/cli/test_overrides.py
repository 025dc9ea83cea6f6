"""Keys of a study that the command line sets, and what a run says of coarse step sizes."""

import json

import pandas as pd
import pytest

LIFT = """\
study: lift
problem: pendulum
form: u-lambda
preconditioning: optimal
measure: error
h: [2e-3, 1e-3]
t_end: 0.02
expect:
  - {measure: error, quantity: u, slope: 2}
"""
CASES = """\
study: cases
form: u-lambda
preconditioning: optimal
h: [2e-3, 1e-3]
steps: 10
cases:
  - {problem: pendulum, integrator: {method: hht, alpha: 0.1}}
  - {problem: pendulum, h: 1e-2, form: v-lambda}
"""


def values_of(folder, study, *columns):
    """Distinct values of columns of a study's CSV."""
    table = pd.read_csv(folder / f"results/{study}.csv")
    return [sorted(set(table[column])) for column in columns]


def test_a_changed_study_is_another_one(cli):
    """It has a name and a CSV of its own, records what was run, and shares cached cells."""
    cli.write("lift.yaml", LIFT)
    cli("run", "lift")
    before = (cli.folder / "results/lift.csv").read_bytes()
    name = "lift-h-1e-3-5e-4"
    done = cli("run", "lift", "h=[1e-3, 5e-4]").stdout
    assert done == f"{name}: 2 ok (1 cached) -> results/{name}.csv\n"
    assert values_of(cli.folder, name, "h", "study") == [[5e-4, 1e-3], [name]]
    (case,) = json.loads((cli.folder / f"results/{name}.json").read_text())["config"]["cases"]
    assert case["h"] == [1e-3, 5e-4]
    assert (cli.folder / "results/lift.csv").read_bytes() == before
    cli("run", "lift", "form=v-lambda", "scaling=none", "steps=3", "study=short")
    columns = "form", "preconditioning", "steps"
    assert values_of(cli.folder, "short", *columns) == [["v-lambda"], ["none"], [3]]
    found = {file.name for file in (cli.folder / "results").glob("*.csv")}
    assert found == {"lift.csv", f"{name}.csv", "short.csv"}


def test_of_all_cases_and_of_shipped_studies(cli):
    cli.write("cases.yaml", CASES)
    listed = cli("run", "--dry-run", "cases", "t_end=0.04", "form=a-lambda").stdout.splitlines()
    assert len(listed) == 4
    assert all("(a, λ)" in line or "a-lambda" in line for line in listed[:3])
    listed = cli("run", "--dry-run", "pendulum-u", "h=1e-2", "form=a-lambda").stdout
    assert listed.endswith("\n4 of 4 cells to run\n")
    assert listed.startswith("pendulum-u-h-1e-2-form-a-lambda: ")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["hh=3"], "hh: unknown key; did you mean 'h'? allowed: study, "),
        (["h=abc"], "h[1]: must be a number, given 'abc'"),
        (["h=[1e-3, -1]"], "h[2]: must be greater than 0, given -1"),
        (["form=w-lambda"], "form: unknown form 'w-lambda'; did you mean 'v-lambda'? allowed: u-v"),
        (["integrator={method: nwmark}"], "integrator.method: unknown method 'nwmark'; did you "),
        (["h=[1e-3"], "h, line 2: not YAML: "),
        (["h="], "h: needs a value, such as h=1e-3"),
        (["scaling=none", "preconditioning=none"], "preconditioning: given twice"),
        (["cases=3"], "cases: can be set in the study's file only; "),
        (["study=lift"], "study: must be another name than that of the file, 'lift'"),
        (["h=[3e-3, 2e-3]"], "h: errors need a whole number of steps to t_end = 0.02, given 0.003; "
         "the nearest is 0.00285714286, or t_end = 0.018 fits"),
    ],
)  # fmt: skip
def test_mistakes_name_the_command_line(cli, settings, told):
    cli.write("lift.yaml", LIFT)
    assert cli.refused("run", "lift", *settings).startswith(f"newmark-study: command line: {told}")


@pytest.mark.parametrize(
    ("sizes", "told"),
    [
        ("[0.5, 1e-3]", "1 of 2 cells ended with status not_converged, at h = 0.5; all converged "
         "at h = 0.001: a smaller h helps"),
        ("[0.5, 0.4]", "2 of 2 cells ended with status not_converged, at h = 0.5, 0.4; a smaller "
         "h may help"),
    ],
)  # fmt: skip
def test_step_sizes_that_converge(cli, sizes, told):
    """Half a second is too long a step for the crank of the four-bar linkage."""
    cli.write("lift.yaml", LIFT.partition("expect")[0])
    done = cli("run", "lift", f"h={sizes}", "steps=5", "measure=correction",
               "problem=four-bar", "study=coarse", code=1)  # fmt: skip
    assert done.stderr == f"newmark-study: coarse: {told}\n"
