"""Static elimination: like partial pivoting, or left to it, and counted."""

import json

import numpy as np
import pytest
import yaml
from marching import scheme_of
from numba import njit

import newmark_cli as newmark
from newmark_cli.mechanisms.registry import problem
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import BDF2, GeneralizedAlpha, Newmark
from newmark_cli.newmark.linear.choice import AUTO, DENSE, SPARSE, STATIC, choose
from newmark_cli.newmark.linear.ordering import order_by_size
from newmark_cli.newmark.linear.written import static_elimination
from newmark_cli.newmark.linear.written.static import StaticSystem
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import PIVOTING

SIZES = {"chain": ("random-chain", "links", 20), "bars": ("four-bars", "windows", 20)}


def subject_of(name):
    """A shipped problem, or a member of a family: small ones are written out, others not."""
    if name not in SIZES:
        return problem(name)
    family, size, count = SIZES[name]
    return Sized(family, ((size, count),)).load()


@pytest.mark.parametrize(
    ("name", "form", "variant", "integrator", "evaluation", "h"),
    [
        ("andrews", "u-v-a-lambda", "optimal", GeneralizedAlpha(0.9), "compensated", 1e-4),
        ("shaken-pendulum", "a-lambda", "right", GeneralizedAlpha(0.5), "direct", 1e-4),
        ("chain", "u-v-lambda", "optimal", BDF2(), "direct", 1e-6),
        ("bars", "u-a-lambda", "optimal", Newmark(), "compensated", 1e-4),
        ("bricard", "u-lambda", "optimal", GeneralizedAlpha(0.9), "direct", 1e-6),
    ],
)
def test_marches_like_partial_pivoting(name, form, variant, integrator, evaluation, h):
    """Positions agree to rounding, corrections saturate at the same size."""
    subject = subject_of(name)
    scheme = scheme_of(form, variant, h, integrator, evaluation=evaluation)
    marches = [March(subject, scheme, solver) for solver in (STATIC, DENSE)]
    norms = [one.advance(30).norms for one in marches]
    difference = marches[0].state.fields[0] - marches[1].state.fields[0]
    assert np.linalg.norm(difference) < 2e-13 * np.linalg.norm(subject.u0)
    sizes = [np.sqrt(np.mean(one**2, axis=0)) for one in norms]
    assert np.all(sizes[0] < 5 * sizes[1])
    assert np.all(sizes[1] < 5 * sizes[0])


# -- what it refuses --------------------------------------------------------------------------

#: Two links upside down under a weight that makes X outweigh M/(βh²).
TOPPLING = {
    "title": "Two links upside down",
    "points": {
        "O": {"fixed": [0, 0]},
        "A": {"at": [0, 1], "velocity": [1e-4, 0], "mass": 1},
        "B": {"at": [0, 2], "velocity": [-1e-4, 0], "mass": 1},
    },
    "bars": {
        "one": {"from": "O", "to": "A", "length": 1},
        "two": {"from": "A", "to": "B", "length": 1},
    },
    "gravity": [0, -1e4],
}


@pytest.fixture
def toppling():
    """The mechanism."""
    return newmark.problem(TOPPLING)


@pytest.mark.parametrize(
    ("form", "h"), [("u-lambda", 0.02), ("a-lambda", 0.03), ("u-v-a-lambda", 0.02)]
)
def test_what_needs_pivoting_is_pivoted(toppling, form, h):
    """Where X makes pivots vanish or negative, the march is that of partial pivoting."""
    scheme = scheme_of(form, "optimal", h)
    static, dense = (March(toppling, scheme, solver) for solver in (STATIC, DENSE))
    stretch = static.advance(6)
    dense.advance(6)
    assert stretch.pivoted >= 5
    for ours, theirs in zip(static.state.fields, dense.state.fields, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())
    # In a small step M/(βh²) outweighs the same X.
    assert March(toppling, scheme_of(form, "none", 1e-4), STATIC).advance(50).pivoted == 0


@pytest.mark.parametrize(
    ("solve", "tables"),
    [
        (static_elimination.solve_generated, "tables"),
        (static_elimination.solve_in_order, "entries"),
    ],
)
def test_large_multipliers_are_refused(solve, tables):
    """One link upside down: λ cancels the pivot 4 m/h² but for a part of it, which stays positive.

    The elimination's multiplier is its reciprocal; at most 1e4 is allowed.
    """
    one = {**TOPPLING, "points": {**TOPPLING["points"]}, "bars": {"one": TOPPLING["bars"]["one"]}}
    del one["points"]["B"]
    subject = newmark.problem(one)
    system = StaticSystem(subject, scheme_of("u-lambda", "optimal", 0.02)).elimination
    for part, code in ((1e-2, 0), (3e-4, 0), (3e-5, PIVOTING), (1e-9, PIVOTING)):
        load = np.array([(1 - part) * 4 / 0.02**2])
        values = subject.values(0.0, subject.u0, subject.v0, load)
        rhs = np.ones(system.size)
        assert solve(system.sources(values), rhs, *getattr(system, tables)) == code, part


@njit(nogil=True, error_model="numpy")
def refuse(sources, rhs, constant, places, origins, coefficients, structure, room, work):
    """An elimination that finds no pivot."""
    return PIVOTING


def test_large_matrices_are_pivoted_by_a_sparse_solver():
    """Too large for a dense matrix, a correction that is refused is that of the sparse march."""
    subject = Sized("random-chain", (("links", 120),)).load()
    scheme = scheme_of("u-lambda", "optimal", 1e-3)
    static, sparse = (March(subject, scheme, solver) for solver in (STATIC, SPARSE))
    before = static.advance(2)
    static._engine._solve = refuse
    refused = static.advance(4, [3, 6])
    assert (before.pivoted, refused.pivoted) == (0, 4)
    expected = sparse.advance(6, [3, 6])
    np.testing.assert_allclose(
        refused.record.fields[:, 0], expected.record.fields[:, 0], rtol=0, atol=1e-11
    )
    assert np.all(refused.iterations > 0)


def test_pivoted_steps_are_in_the_provenance(tmp_path):
    """A study says of every cell how many steps were left to partial pivoting."""
    (tmp_path / "toppling.yaml").write_text(yaml.safe_dump(TOPPLING), encoding="utf-8")
    study = {
        "study": "upside-down", "problem": str(tmp_path / "toppling.yaml"), "form": "u-lambda",
        "preconditioning": "optimal", "linear_solver": [STATIC, DENSE], "h": [0.02, 1e-4],
        "steps": 6,
    }  # fmt: skip
    newmark.run(study, results=tmp_path)
    cells = json.loads((tmp_path / "upside-down.json").read_text(encoding="utf-8"))["cells"]
    counts = {(cell["linear_solver"], cell["h"]): cell.get("pivoted_steps") for cell in cells}
    assert len(counts) == 4
    assert counts.pop((STATIC, 0.02)) >= 5
    assert not any(counts.values())


# -- which one is taken -----------------------------------------------------------------------


def test_auto_takes_it_where_it_is_much_faster():
    """Of more than 40 unknowns, index 3 and float64; elsewhere dense matrices up to 300."""
    form = FORMS["u-lambda"]
    sizes = 13, 14, 100, 101
    small, middle, dense, large = (Sized("chain", (("links", size),)).load() for size in sizes)
    assert choose(AUTO, small, form) == DENSE
    assert choose(AUTO, middle, form) == STATIC
    assert choose(AUTO, middle, form, precision="float32") == DENSE
    assert choose(AUTO, dense, form, formulated=True) == DENSE
    assert choose(AUTO, large, form) == STATIC
    assert choose(AUTO, large, form, formulated=True) == SPARSE


@pytest.mark.parametrize(
    ("name", "most"), [("governor", 2_000), ("bricard", 3_000), ("spatial-slider-crank", 700)]
)
def test_pivots_by_size_in_space(name, most):
    """They take few operations, and last for the whole motion but for a few steps."""
    subject = problem(name)
    scheme = scheme_of("u-lambda", "optimal", 1e-3, GeneralizedAlpha(0.8))
    lists = StaticSystem(subject, scheme).elimination.lists
    assert (lists.operations < most, lists.signed) == (True, False)
    static, dense = (March(subject, scheme, solver) for solver in (STATIC, DENSE))
    assert static.advance(500).pivoted < 50
    dense.advance(500)
    for ours, theirs in zip(static.state.fields[:2], dense.state.fields[:2], strict=True):
        assert np.linalg.norm(ours - theirs) < 1e-7 * np.linalg.norm(theirs)


def test_no_order_of_a_singular_matrix():
    """No pivot is left; zeros of a regular one are none."""
    rows, columns = np.indices((3, 3)).reshape(2, -1)
    assert order_by_size(np.ones((3, 3)), rows, columns) is None
    found = order_by_size(np.array([[0.0, 1, 0], [1, 0, 0], [0, 1, 1]]), rows, columns)
    assert sorted(zip(*map(np.ndarray.tolist, found), strict=True)) == [(0, 1), (1, 0), (2, 2)]
