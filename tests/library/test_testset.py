"""The test set: members against their references, what `list` says, and the written files."""

import csv
import json
import math

import numpy as np
import pytest

import newmark_cli as newmark
from newmark_cli.codes.given_references import of_testset, reference_at
from newmark_cli.codes.solutions import Solutions
from newmark_cli.library import testset
from newmark_cli.mechanisms import registry
from newmark_cli.mechanisms.spec import Shipped
from newmark_cli.newmark.invariants import misfits
from newmark_cli.problems import multipliers
from newmark_cli.problems.reference import solution
from newmark_cli.running.references import References

#: A time to which the project's own solution is quick, before singular positions.
EARLY = {
    "bathe-noh": 0.02, "disc-in-bowl": 1, "double-four-bar": 0.5, "gyroscopic-effects": 0.09,
    "hooke-shaft": 0.1, "knee-table": 0.2, "segment-beam": 0.25, "stephenson-sixbar": 0.12,
    "sundials-slider-crank": 4,
}  # fmt: skip
#: Degrees of freedom by hand.
FREE = {
    "bathe-noh": 2, "disc-in-bowl": 1, "double-four-bar": 1, "gyroscopic-effects": 4,
    "hooke-shaft": 0, "knee-table": 1, "segment-beam": 8, "stephenson-sixbar": 1,
    "sundials-slider-crank": 1,
}  # fmt: skip


def test_members_are_those_that_are_described():
    """A mechanism, a table and an entry each."""
    assert set(registry.TESTSET) == set(FREE) == set(EARLY)
    assert set(registry.PROBLEMS) == {*registry.SHIPPED, *registry.TESTSET}
    assert len(registry.SHIPPED) == 10


@pytest.mark.parametrize("name", registry.TESTSET)
def test_references_are_those_of_the_motion(name):
    """The project's own solution agrees within both errors; u lies on the constraints."""
    subject, t = registry.problem(name), EARLY[name]
    given, own = of_testset(subject, t), solution(subject, t)
    assert given is not None
    assert given.source == "published"
    for part in ("u", "v"):
        a, b = getattr(given, part), getattr(own, part)
        allowed = getattr(given, f"{part}_error") + getattr(own, f"{part}_error")
        assert np.abs(a - b).max() <= allowed * np.abs(b).max()
    off = multipliers.relative_error(given.multipliers, own.multipliers, own.scales)
    assert off <= given.multipliers_error + own.multipliers_error


@pytest.mark.parametrize("name", registry.TESTSET)
def test_members_march(name):
    """Five steps from the start, on the constraints."""
    member = testset.member(name)
    assert member["degrees_of_freedom"] == FREE[name]
    assert member["t_end"] == member["times"][-1]
    h = member["t_end"] / 20_000
    run = newmark.march(name, h=h, t_end=5 * h, integrator="generalized-alpha rho=0.9")
    subject = registry.problem(name)
    missed = misfits(subject, run.t[-1], run.u[-1], run.v[-1])["position"]
    assert missed.error <= 1e-13 * missed.sizes[0]


def test_second_order_past_singular_positions():
    """Errors against the shipped reference at t = 10, past ten dead centres."""
    reference = of_testset(registry.problem("double-four-bar"), 10)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        run = newmark.march(
            "double-four-bar", h=h, t_end=10, integrator="generalized-alpha rho=0.9",
            evaluation="compensated",
        )  # fmt: skip
        errors.append(np.abs(run.v[-1] - reference.v).max())
    assert np.diff(np.log2(errors)) == pytest.approx([-2, -2], abs=0.05)


def test_published_position_past_singular_positions():
    """B0 at t = 10, extrapolated from EXUDYN's convergence table."""
    assert values("double-four-bar", 10, "u[B0.x]")[0] == pytest.approx(0.328458099, abs=2e-8)


def test_published_values_of_the_gyroscopic_model():
    """Dymola's rate of the bearing at t = 0.09, Multibody.jl's end of the rotor at t = 5."""

    def vector(t, part):
        return values("gyroscopic-effects", t, *(f"{part}.{axis}]" for axis in "xyz"))

    turning = vector(0.09, "output[rotor.omega") - vector(0.09, "output[arm.omega")
    assert turning @ vector(0.09, "u[rotor.d1") == pytest.approx(4.96879389491, abs=1.5e-9)
    end = vector(5, "u[rotor.origin") - 0.1 * vector(5, "u[rotor.d1")
    assert end == pytest.approx([-0.0357364, -0.188245, 0.02076935], abs=4e-7)


@pytest.mark.parametrize(
    ("t", "published"), [(1, 1.3154), (4, -1.2064), (7, -0.31828), (10, 1.2757)]
)
def test_published_angles_of_the_slider_crank(t, published):
    """SUNDIALS prints the crank's angle with five digits."""
    x, y = values("sundials-slider-crank", t, "u[A.x]", "u[A.y]")
    assert math.atan2(y, x) == pytest.approx(published, abs=6e-5)


def values(name, t, *columns):
    (row,) = [row for row in testset.references(name) if float(row["t"]) == t]
    return np.array([float(row[column]) for column in columns])


def test_other_problems_and_times_have_no_reference_of_the_test_set():
    """Neither a time between the rows nor a changed mechanism of the same name."""
    subject = registry.problem("sundials-slider-crank")
    assert of_testset(subject, 2.5) is None
    assert of_testset(registry.problem("pendulum"), 1.0) is None


def test_studies_and_judge_find_the_reference(tmp_path):
    """Past singular positions, where none can be computed; nothing is stored."""

    def none(spec, t):
        raise AssertionError

    reference = of_testset(registry.problem("double-four-bar"), 10)
    found = References(tmp_path, none).of(Shipped("double-four-bar"), 10.0)
    np.testing.assert_array_equal(found.u, reference.u)
    assert not [*tmp_path.iterdir()]
    motion = Solutions(registry.problem("double-four-bar"), {})
    np.testing.assert_array_equal(motion.at(10.0).multipliers, reference.multipliers)


def test_list_of_problems(cli):
    """A row for each problem, for people and for programs."""
    table = cli("list", "--problems").stdout
    assert all(name[:12] in table for name in registry.PROBLEMS)
    listed = {one["name"]: one for one in json.loads(cli("list", "--problems", "--json").stdout)}
    assert [*listed] == [*registry.PROBLEMS]
    sixbar = listed["stephenson-sixbar"]
    assert (sixbar["degrees_of_freedom"], sixbar["t_end"]) == (1, 0.3)
    assert sixbar["errors"] == {"u": 1e-13, "v": 1e-13, "lambda": 6e-13}
    assert listed["pendulum"]["errors"] is None


def test_written_files_are_read_again(cli):
    """JSON says what YAML says, templates have the columns of references, nothing is lost."""
    cli("list", "--testset", "set")
    folder = cli.folder / "set"
    for name in registry.TESTSET:
        subject = newmark.problem(folder / f"{name}.yaml")
        again = newmark.problem(json.loads((folder / f"{name}.json").read_text()))
        np.testing.assert_array_equal(subject.u0, again.u0)
        assert subject.coordinate_names == again.coordinate_names
        reference = reference_at(folder / f"{name}-reference.csv", subject)
        t_end = testset.member(name)["t_end"]
        np.testing.assert_array_equal(
            reference(t_end).u, of_testset(registry.problem(name), t_end).u
        )
        with (folder / f"{name}-template.csv").open() as file:
            (start,) = csv.DictReader(file)
        at = [float(start[f"u[{one}]"]) for one in subject.coordinate_names]
        np.testing.assert_array_equal(at, subject.u0)


def test_files_of_others_are_not_overwritten(cli):
    """Written twice is fine; a changed file is named, and nothing is written then."""
    cli("list", "--testset", "set")
    cli("list", "--testset", "set")
    (cli.folder / "set/knee-table.json").write_text("{}")
    (cli.folder / "set/README.md").unlink()
    failed = cli("list", "--testset", "set", code=2)
    assert "set/knee-table.json is not as the test set has it" in failed.stderr
    assert not (cli.folder / "set/README.md").exists()
    cli("list", "--testset", "set", "--problems", code=2)
