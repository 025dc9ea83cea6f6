"""Work of a march, counted: by hand, by formulas, and next to the kernel as it runs."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
from conftest import QUICK, rows_in
from each import each
from marching import in_python, interpreted_march
from test_formulations import PROJECTIONS, scheme_of, subject_of

from newmark_cli.mechanisms.registry import problem
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.newmark import kernel, operations
from newmark_cli.newmark.formulation import NEWTON
from newmark_cli.newmark.integrator import Newmark
from newmark_cli.newmark.linear.ordering import Order
from newmark_cli.newmark.linear.sparse import SparseSystem
from newmark_cli.newmark.linear.written.lists import EliminationLists
from newmark_cli.newmark.march import March, initial_state


def test_a_pendulum_by_hand():
    """Its bar and its weight, operation by operation.

    Δ = a u: 4; Φ = (Δ_x² + Δ_y² − L²)/2: 5; G = aΔ: 2; λ a Δ added to the force: 6; X: 2; the
    weight: 2.
    """
    assert operations.evaluation(problem("pendulum")).values == 4 + 5 + 2 + 6 + 2 + 2


def test_elements_add_up():
    """A chain of links has as many operations for each link that is added."""
    counts = [
        operations.evaluation(Sized("chain", (("links", links),)).load()) for links in (4, 5, 6)
    ]
    assert counts[2].values - counts[1].values == counts[1].values - counts[0].values > 30
    assert counts[2].derivatives - counts[1].derivatives == (
        counts[1].derivatives - counts[0].derivatives
    )


class Counted(float):
    """A number that counts in the class; zeros by pattern are plain zeros."""

    operations = 0

    def _count(self, value):
        Counted.operations += 1
        return Counted(value)

    def __mul__(self, other):
        return self._count(float(self) * float(other))

    def __sub__(self, other):
        return self._count(float(self) - float(other))

    __rsub__ = lambda self, other: self._count(float(other) - float(self))  # noqa: E731

    def __truediv__(self, other):
        return self._count(float(self) / float(other))


def solved(matrix, rhs):
    """Operations of an elimination without row exchanges that skips zeros of the pattern."""
    size = len(rhs)
    entries = [[Counted(x) if x else 0 for x in row] for row in matrix.tolist()]
    x = [Counted(b) for b in rhs]
    Counted.operations = 0
    for k in range(size):
        pivot = Counted(1.0) / entries[k][k]
        for i in range(k + 1, size):
            if isinstance(entries[i][k], Counted):
                factor = entries[i][k] * pivot
                for j in range(k + 1, size):
                    if isinstance(entries[k][j], Counted):
                        entries[i][j] = entries[i][j] - factor * entries[k][j]
                x[i] = x[i] - factor * x[k]
        entries[k][k] = pivot
    for k in range(size - 1, -1, -1):
        x[k] = x[k] * entries[k][k]
        for i in range(k):
            if isinstance(entries[i][k], Counted):
                x[i] = x[i] - entries[i][k] * x[k]
    np.testing.assert_allclose(np.array(x, float), np.linalg.solve(matrix, rhs), rtol=1e-9)
    return Counted.operations


@each("size", [1, 2, 7, 20])
def test_full_matrices(size):
    """(2/3) N³ + … for the factors, 2 N² − N for the substitutions (Golub & Van Loan, §3.2)."""
    order = Order(np.arange(size), np.arange(size))
    rows, columns = (places.ravel() for places in np.indices((size, size)))
    factors = (4 * size**3 - 3 * size**2 - size) // 6 + size  # and N reciprocals
    assert operations.elimination(EliminationLists(order, rows, columns)) == (
        factors + 2 * size**2 - size
    )


@each("name, formulation, form", [
    ("pendulum", "index-3", "u-v-a-lambda"),
    ("andrews", "index-3", "a-lambda"),
    ("andrews", "augmented-lagrangian factor=10", "a-lambda"),
    ("slider-crank", "ggl", "a-lambda"),
])  # fmt: skip
def test_eliminations_of_mechanisms(name, formulation, form):
    """As a plain elimination counts on random numbers at the places of the matrix."""
    subject = subject_of(name)
    system = SparseSystem(subject, scheme_of(formulation, form))
    random = np.random.default_rng(5)
    matrix = np.zeros((system.size, system.size))
    matrix[system.rows, system.columns] = random.normal(size=len(system.rows))
    ordered = matrix[np.ix_(*system.order)]
    lists = EliminationLists(system.order, system.rows, system.columns)
    assert operations.elimination(lists) == solved(ordered, random.normal(size=system.size))


def counted(function):
    """A function that the interpreted kernel calls, and how often it was called."""

    def called(*arguments):
        called.calls += 1
        return function(*arguments)

    called.calls, called.py_func = 0, called
    return called


@each("evaluation", ["direct", "compensated"])
@each("formulation, projection", [
    *((name, "none") for name in ("index-3", "index-2", "index-1", "baumgarte rate_h=1")),
    ("ggl", "none"),
    ("augmented-lagrangian factor=10", "none"),
    *(("index-3", projection) for projection in PROJECTIONS[1:]),
    ("ggl", "velocity"),
    ("index-1", "position-velocity accelerations"),
])  # fmt: skip
def test_calls_of_the_kernel(formulation, projection, evaluation, monkeypatch):
    """Functions of the mechanism and systems of projections, as often as the kernel takes them.

    In place of their operations stand powers of ten, which tell them apart in the sum.
    """
    subject = subject_of("thrown")
    scheme = scheme_of(
        formulation, h=0.02, projection=projection, evaluation=evaluation, reported=NEWTON
    )
    values, derivatives, saddle = 10**7, 10**11, 10**15
    with monkeypatch.context() as patch:
        patch.setattr(
            operations, "evaluation", lambda _: operations.Evaluation(values, derivatives)
        )
        patch.setattr(operations, "_saddle", lambda _: saddle)
        system = March(subject, scheme, "dense-lu").system
        parts = operations.work(subject, scheme, system)
    counts = []
    for steps in (1, 4):  # what comes before the first step is in both
        evaluate, derive = counted(subject.function), counted(subject.derivatives)
        plain = replace(subject, function=evaluate, derivatives=derive)
        state, norms = initial_state(subject, scheme), np.zeros((steps, len(scheme.recorded)))
        evaluate.calls = derive.calls = 0
        iterations, positions = np.zeros((2, steps), np.int64)
        with monkeypatch.context() as patch:
            solve = counted(kernel.solve_in_place)
            patch.setattr(kernel, "solve_in_place", solve)
            march = partial(interpreted_march, plain, scheme, state.copy(), 0, norms, iterations)
            assert march(positions=positions) == (0, steps)
        corrections = int(np.abs(iterations).sum())
        found = (
            corrections * parts.correction + steps * parts.step + positions.sum() * parts.position
        )
        counts.append((found, evaluate.calls, derive.calls, solve.calls - corrections))
    found, *called = (b - a for a, b in zip(*counts, strict=True))
    expected = [found // values % 10**4, found // derivatives % 10**4, found // saddle]
    assert called == expected, (called, expected)


def test_corrections_of_positions_are_counted_by_each_engine():
    """One or more in every step, whether the kernel solves or Python."""
    subject = subject_of("thrown")
    scheme = scheme_of("index-2", h=0.1, projection="position-velocity")
    kernel_march, other = (March(subject, scheme, "dense-lu") for _ in range(2))
    other._engine = in_python(subject, scheme, other.system)
    for march in (kernel_march, other):
        march.advance(5)
        march.advance(5)
    assert kernel_march.positions == other.positions > 10
    # Rounding ends Newton a correction earlier or later.
    assert abs(kernel_march.corrections - other.corrections) <= 10


def test_a_study_records_its_work(cli, quick):
    """Corrections times those of one, whatever the scaling; the same again."""
    cli("run", "quick.yaml")
    first = (cli.folder / "results/quick.json").read_bytes()
    parts = operations.work(*_of_pendulum())
    cells = json.loads(first)["cells"]
    rows = {
        (row["preconditioning"], float(row["h"])): row
        for row in rows_in(cli.folder / "results/quick.csv")
    }
    for cell in cells:
        row = rows[cell["preconditioning"], cell["h"]]
        corrections = round(float(row["newton_iterations"]) * int(row["steps"]))
        assert cell["operations"] == corrections * parts.correction
    cli("run", "quick.yaml", "--force", "--jobs", "2")
    assert (cli.folder / "results/quick.json").read_bytes() == first


def _of_pendulum():
    subject, scheme = problem("pendulum"), scheme_of("index-3", "u-lambda", integrator=Newmark())
    return subject, scheme, March(subject, scheme, "dense-lu").system


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
    assert "march (s)" in cli("info", "quick", "--cells").stdout
