"""Linear systems of marches as files: those of the march, solved to 60 digits, the same twice."""

import json
import os
import signal
from hashlib import sha256

import mpmath
import numpy as np
import pytest
import scipy.io
import scipy.sparse
from conftest import SWING, wait_until
from each import each

import newmark_cli as newmark
from newmark_cli.newmark.linear import dense, exact
from newmark_cli.problems import algebra
from newmark_cli.support.errors import ArgumentError, InputError

RNG = np.random.default_rng(16)


def solved_by_mpmath(matrix, rhs, digits=200):
    """LU of the exact binary values, by somebody else."""
    with mpmath.workdps(digits):
        return list(mpmath.lu_solve(mpmath.matrix(matrix.toarray().tolist()), mpmath.matrix(rhs)))


def digits_right(found, expected):
    """Fewest right digits of a component; what is zero must be so for both, nearly."""
    with mpmath.workdps(200):
        pairs, largest = [*zip(found, expected, strict=True)], max(map(abs, expected))
        errors = [abs(mpmath.mpf(str(x)) - y) / abs(y) for x, y in pairs if x]
        zeros = [abs(y) for x, y in pairs if not x]
        assert all(y <= mpmath.mpf(10) ** -80 * largest for y in zeros)
        return float(-mpmath.log10(max([*errors, mpmath.mpf(10) ** -200])))


@each("form", ["u-lambda", "u-v-a-lambda"])
@each("h", [1e-3, 1e-8])
def test_solutions_have_sixty_digits(form, h):
    """Unscaled systems too, whose condition number is beyond 1e20, in every component."""
    for system in newmark.linear_systems("andrews", h=h, steps=[3], form=form, scaling="none"):
        found = system.solution()
        assert digits_right(found, solved_by_mpmath(system.matrix, system.rhs.tolist())) > 60
        assert system.residual([float(x) for x in found]) < 1e-15
    if form == "u-lambda":
        with mpmath.workdps(80):
            matrix = mpmath.matrix(system.matrix.toarray().tolist())
            condition = mpmath.mnorm(matrix, 1) * mpmath.mnorm(mpmath.inverse(matrix), 1)
        assert condition > (1e25 if h == 1e-8 else 1e10)


def test_factors_without_digits_are_not_needed():
    """A Hilbert matrix of 20 rows is singular in double precision, balanced or not."""
    size = 20
    places = np.arange(size)
    matrix = scipy.sparse.csc_array(1 / (1 + places[:, None] + places))
    rhs, ones = RNG.normal(size=size), np.ones(size)
    found = exact.solve(matrix, rhs, ones, ones)
    assert digits_right(found, solved_by_mpmath(matrix, rhs.tolist())) > 60


def test_what_has_no_solution_is_refused(monkeypatch):
    """A singular matrix, an empty row, and a large matrix whose factors have no digit."""
    ones = np.ones(3)
    for entries in ([[1, 2, 3], [2, 4, 6], [1, 1, 1]], [[1, 2, 3], [0, 0, 0], [1, 1, 1]]):
        matrix = scipy.sparse.csc_array(np.array(entries, float))
        with pytest.raises(np.linalg.LinAlgError, match=r"singular|zero"):
            exact.solve(matrix, ones, ones, ones)
    monkeypatch.setattr(exact, "_ELIMINATED_UP_TO", 2)
    matrix = scipy.sparse.csc_array(np.array([[1, 2, 3], [2, 4, 6], [1, 1, 1]], float))
    with pytest.raises(exact.NotSolvedError, match=r"^3 unknowns, and no digit"):
        exact.solve(matrix, ones, ones, ones)


def test_the_residual_is_that_of_its_definition():
    """Also where the numbers are too far apart for double precision."""
    matrix = scipy.sparse.csc_array(np.array([[3.0, 4e-30], [0.0, 1e200]]))
    rhs, x = np.array([3.0, 0.0]), [1.0 + 2.0**-40, 0.0]
    norm = np.hypot(3.0, 1e200)
    assert exact.backward_error(matrix, rhs, x) == pytest.approx(3 * 2.0**-40 / norm, rel=1e-12)
    assert exact.backward_error(matrix, 0 * rhs, [0.0, 0.0]) == 0.0


def swing(tmp_path):
    """A problem in plain Python, which SciPy marches."""
    (tmp_path / "mine.py").write_text(SWING)
    return newmark.problem(f"{tmp_path}/mine.py:swing")


@each("formulation", ["index-3", "ggl", "augmented-lagrangian"])
def test_systems_are_those_that_the_march_solves(tmp_path, monkeypatch, formulation):
    """Bit by bit, where SciPy marches: what its LU is given, iteration by iteration."""
    problem, solves = swing(tmp_path), []

    class Watched(algebra.Factors):
        def __init__(self, matrix):
            super().__init__(matrix)
            self.matrix = matrix.copy()

        def solve(self, rhs):
            solves.append((self.matrix, rhs.copy()))
            return super().solve(rhs)

    monkeypatch.setattr(dense, "Factors", Watched)
    how = {"h": 1e-3, "form": "u-v-lambda", "formulation": formulation, "scaling": "left"}
    newmark.march(problem, steps=3, **how, every=0)
    before, solves[:] = solves[:], []
    newmark.march(problem, steps=2, **how, every=0)
    of_step = before[len(solves) :]
    found = [*newmark.linear_systems(problem, steps=[3], every_iteration=True, **how)]
    assert [system.iteration for system in found] == list(range(1, len(of_step) + 1))
    for system, (matrix, rhs) in zip(found, of_step, strict=True):
        assert np.array_equal(system.matrix.toarray(), matrix)
        assert np.array_equal(system.rhs, rhs)
        assert sum(system.sizes) == len(rhs)
        assert len(system.unknowns) == len(system.rows) == len(system.sizes)
    ends = [*newmark.linear_systems(problem, steps=[3], **how)]
    assert [system.iteration for system in ends] == [1, len(of_step)]
    assert all(system.iterations == len(of_step) for system in ends)


def test_systems_of_steps_of_other_sizes():
    """Of a change of h, and of a state that is continued: size, time and number of the step."""
    how = {"form": "a-lambda", "scaling": "none"}
    sizes = [1e-3] * 5 + [5e-4] * 5
    first, *_ = newmark.linear_systems("pendulum", h=sizes, steps=[7], **how)
    assert (first.h, first.t, first.left["D"]) == (5e-4, pytest.approx(0.006, abs=1e-12), 1.0)
    # Row C is Gᵀ ∂u/∂a = βh² (x, y).
    passed = newmark.march("pendulum", h=sizes, **how)
    predicted = passed.u[6] + 5e-4 * passed.v[6]
    row = first.matrix.toarray()[2, :2]
    assert row == pytest.approx(5e-4**2 / 4 * predicted, rel=1e-6)
    state = newmark.march("pendulum", h=1e-3, steps=100).state
    for h in (1e-3, 5e-4, [5e-4] * 3):
        later = newmark.march("pendulum", h=h, steps=3, state=state)
        assert later.numbers.tolist() == [100, 101, 102, 103]
        first, *_ = newmark.linear_systems("pendulum", h=h, steps=[103], state=state)
        assert (first.step, first.t) == (103, pytest.approx(later.t[-1], abs=1e-12))
    for h, steps, told in (
        (5e-4, [100], "steps must be at least 101 after this state, given 100"),
        ([5e-4] * 3, [104], "h has the sizes of 3 steps, 104 is beyond them"),
    ):
        with pytest.raises(newmark.ArgumentError, match=told):
            newmark.linear_systems("pendulum", h=h, steps=steps, state=state)


def test_a_system_is_that_of_the_equations():
    """Written out again for the pendulum, eqs. 30; no code in common."""
    h, beta, gamma = 1e-3, 0.3025, 0.6
    how = {"h": h, "integrator": f"newmark beta={beta} gamma={gamma}", "scaling": "optimal"}
    march = newmark.march("pendulum", steps=9, **how)
    u, v, a, (multiplier,) = march.u[-1], march.v[-1], march.a[-1], march.multipliers[-1]
    system = next(newmark.linear_systems("pendulum", steps=[10], **how))
    u_new = u + h * v
    a_new = (u_new - u - h * v) / (beta * h**2) - (1 / (2 * beta) - 1) * a
    gravity = np.array([0.0, newmark.problem("pendulum").evaluate(0, u, v, [0.0]).force[1]])
    left, right = np.array([beta * h**2] * 2 + [1]), np.array([1, 1, 1 / (beta * h**2)])
    jacobian = np.zeros((3, 3))
    jacobian[:2, :2] = np.eye(2) * (1 / (beta * h**2) - multiplier)
    jacobian[:2, 2], jacobian[2, :2] = -u_new, u_new
    residual = [*(a_new - gravity - multiplier * u_new), (u_new @ u_new - 1) / 2]
    expected = left[:, None] * jacobian * right
    np.testing.assert_allclose(system.matrix.toarray(), expected, rtol=1e-12)
    np.testing.assert_allclose(system.rhs, -left * residual, rtol=1e-6, atol=1e-16)
    assert (system.beta, system.gamma, system.t) == (beta, gamma, pytest.approx(0.01))
    assert system.left == {"D": beta * h**2, "C": 1.0}
    assert system.right == {"u": 1.0, "lambda": pytest.approx(1 / (beta * h**2), rel=1e-15)}


@each("scaling", ["none", "optimal"])
def test_the_kernel_takes_the_same_correction(scaling):
    """Norms of the kernel's first correction are those of the first system's solution."""
    how = {"h": 1e-3, "scaling": scaling, "linear_solver": "dense-lu"}
    stepped = newmark.steps("andrews", iteration_cap=1, **how)
    step = [next(stepped) for _ in range(4)][-1]
    # Without a further iteration a step is what its first system says.
    system = next(newmark.linear_systems("andrews", steps=[4], iteration_cap=1, **how))
    found = np.array([float(x) for x in system.solution()])
    blocks = np.split(found, np.cumsum(system.sizes)[:-1])
    for name, block in zip(system.unknowns, blocks, strict=True):
        assert step.norms[name] == pytest.approx(np.linalg.norm(block), rel=1e-8)


def test_systems_of_an_iterative_solver():
    """Those of its march, in its sparse matrix; a march that stagnates leaves what it solved."""
    how = {"h": 1e-3, "steps": [1, 2], "linear_solver": "gmres"}
    found = [*newmark.linear_systems("double-pendulum", **how)]
    assert [system.step for system in found] == [1, 1, 2, 2]
    thick = next(newmark.linear_systems("double-pendulum", h=1e-3, steps=[1]))
    np.testing.assert_allclose(
        found[0].matrix.toarray(), thick.matrix.toarray(), rtol=1e-12, atol=1e-15
    )
    stuck = [*newmark.linear_systems("double-pendulum", **how, krylov={"limit": 1})]
    assert [(system.step, system.iterations) for system in stuck] == [(1, 1)]


@each("options, message", [
    ({"steps": 3}, "steps must be a list of numbers, given 3"),
    ({"steps": []}, "steps must name a step, given none"),
    ({"steps": [0]}, "steps must be at least 1, given 0"),
    ({"steps": [1], "every": 2}, "every: linear_systems keeps nothing"),
    ({"steps": [1], "every_iteration": 1}, "every_iteration must be True or False"),
    ({"steps": [1], "precision": "float32"}, "precision float32: only systems of marches in"),
])  # fmt: skip
def test_what_no_systems_are_to_be_had_of(options, message):
    with pytest.raises((ArgumentError, InputError), match=f"^{message}"):
        newmark.linear_systems("pendulum", h=1e-3, **options)


FOUR_FIELDS = ("andrews", "--form", "u-v-a-lambda", "--preconditioning", "none", "--h", "1e-7")


def contents(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def read(folder):
    """(entry, J, b, x, digits) of each system, by SciPy."""
    for entry in json.loads((folder / "index.json").read_text())["systems"]:
        own = folder / entry["name"]
        matrix = scipy.io.mmread(own / "J.mtx", spmatrix=False).tocsc()
        b, x = (scipy.io.mmread(own / f"{name}.mtx")[:, 0] for name in "bx")
        yield entry, matrix, b, x, (own / "x.txt").read_text().split()


def test_a_collection_is_read_back(cli):
    """By SciPy, to the bit; stored solutions miss by less than 1e-15, in somebody's arithmetic."""
    done = cli("export", *FOUR_FIELDS, "--steps", "40,1", "--out", "out")
    assert done.stdout == "4 systems of 1 march -> out/index.json\n"
    assert done.stderr == ""
    systems = newmark.linear_systems(
        "andrews", h=1e-7, steps=[1, 40], form="u-v-a-lambda", scaling="none"
    )
    found = [*read(cli.folder / "out")]
    for system, (entry, matrix, b, x, digits) in zip(systems, found, strict=True):
        assert np.array_equal(matrix.toarray(), system.matrix.toarray())
        assert np.array_equal(b, system.rhs)
        assert [float(text) for text in digits] == x.tolist()
        expected = solved_by_mpmath(matrix, b.tolist())
        assert digits_right(digits, expected) > 60
        assert all(len(text.split("e")[0].strip("-")) == 71 for text in digits)
        with mpmath.workdps(100):
            J, q = mpmath.matrix(matrix.toarray().tolist()), mpmath.matrix(x.tolist())
            missed = mpmath.norm(mpmath.matrix(b.tolist()) - J * q)
            size = mpmath.mnorm(J, "f") * mpmath.norm(q) + mpmath.norm(mpmath.matrix(b.tolist()))
            # Row by row, too, which ‖J̄‖ hides where it is unscaled.
            rows, rest = matrix.toarray().tolist(), b.tolist()
            for i, row in enumerate(rows):
                terms = [mpmath.mpf(a) * c for a, c in zip(row, x.tolist(), strict=True)]
                scale = mpmath.fsum(map(abs, terms)) + abs(rest[i])
                assert abs(rest[i] - mpmath.fsum(terms)) <= 2.3e-16 * scale
        assert missed / size < 1e-15
        assert entry["residual"] == pytest.approx(float(missed / size), rel=1e-12)
        assert [(block["name"], block["size"]) for block in entry["rows"]] == [
            ("D", 8), ("V", 8), ("K", 8), ("C", 7)
        ]  # fmt: skip
        assert [block["name"] for block in entry["unknowns"]] == ["u", "v", "a", "lambda"]
        assert (entry["h"], entry["beta"], entry["gamma"]) == (1e-7, 0.25, 0.5)
        assert (entry["size"], entry["nonzeros"]) == (31, matrix.nnz)
        assert (entry["step"], entry["iteration"]) == (system.step, system.iteration)
        own = cli.folder / "out" / entry["name"]
        assert json.loads((own / "system.json").read_text()) == entry
        for name, digest in entry["sha256"].items():
            assert sha256((own / name).read_bytes()).hexdigest() == digest
    assert [entry["step"] for entry, *_ in found] == [1, 1, 40, 40]


def test_factors_take_a_system_back_to_its_own_units(cli):
    """J̄ and b over their factors are those of the unscaled march, where both start alike."""
    cli("export", "pendulum", "--formulation", "ggl", "--h", "1e-3", "--steps", "1", "--out", "o")
    (plain, raw, b, *_), _, (entry, matrix, scaled_b, *_), _ = read(cli.folder / "o")
    assert (plain["preconditioning"], entry["preconditioning"]) == ("none", "optimal")
    assert [block["name"] for block in entry["rows"]] == ["D", "C", "Cv"]
    assert [block["formula"] for block in entry["unknowns"]] == ["1", "1/(beta*h^2)", "1"]
    left, right = (
        np.repeat([block["factor"] for block in side], [block["size"] for block in side])
        for side in (entry["rows"], entry["unknowns"])
    )
    unscaled = matrix.toarray() / left[:, None] / right
    np.testing.assert_allclose(unscaled, raw.toarray(), rtol=1e-12)
    np.testing.assert_allclose(scaled_b / left, b, rtol=1e-12)


STUDY = """\
study: two
problem: pendulum
form: [u-lambda, a-lambda]
preconditioning: [none, {name: half, left: {D: h}}]
h: [1e-2, 1e-3]
t_end: 0.1
cases:
  - precision: float64
    measure: correction
  - precision: float64
    measure: condition
  - precision: float32
    measure: correction
"""


def test_a_study_is_exported_twice_alike(cli):
    """Each march once, whatever is measured; options choose; what is left out is told."""
    cli.write("two.yaml", STUDY)
    chosen = ("--form", "a-lambda", "--h", "1e-3", "--steps", "1,100", "--preconditioning", "half")
    for _ in range(2):
        done = cli("export", "two.yaml", *chosen, "--out", "once")
    assert done.stdout == "4 systems of 1 march -> once/index.json\n"
    assert done.stderr == (
        "newmark-study: warning: 1 cells left out: marches in float32 are solved inside the "
        "compiled kernel, whose systems cannot be exported\n"
    )
    cli("export", "two.yaml", *chosen, "--out", "twice")
    one, other = (contents(cli.folder / name) for name in ("once", "twice"))
    assert one == other
    assert len(one) == 1 + 4 * 5
    names = [entry["name"] for entry, *_ in read(cli.folder / "once")]
    assert names[0] == "00001-pendulum-a-lambda-half-left-D=h-h0.001-step1-iteration1"
    refusals = {
        ("--h", "0.5"): "h: '0.5' is not among the study's",
        ("--form", "v-lambda"): "form: 'v-lambda' is not among the study's; did you mean 'u-lamb",
        (
            "--h",
            "1e-2",
            "--steps",
            "11",
        ): "step 11 is past the last step: the march has 10 (pendulum",
        ("--h", "1e-2", "--every", "11"): "every 11 steps leaves none: the march has 10 (pendulum",
        ("--t-end", "1"): "t_end: the study says where its marches end",
    }
    for options, message in refusals.items():
        line = cli.refused("export", "two.yaml", *options, "--out", "none")
        assert line.startswith(f"newmark-study: {message}")
    assert sorted(entry.name for entry in cli.folder.iterdir()) == ["once", "twice", "two.yaml"]


def test_systems_of_a_march_that_ends(cli):
    """What it has solved is there, and the command says where it ended, with code 1."""
    cli.write(
        "stuck.yaml",
        "study: stuck\nproblem: double-pendulum\nform: u-lambda\npreconditioning: [optimal]\n"
        "linear_solver: gmres\nkrylov: {limit: 1}\nh: 1e-3\nsteps: 3\nmeasure: correction\n",
    )
    done = cli("export", "stuck.yaml", code=1)
    assert done.stdout == "1 systems of 1 march -> systems/index.json\n"
    assert done.stderr.startswith("newmark-study: double-pendulum u-lambda optimal gmres h=0.001 ")
    assert done.stderr.endswith(": stagnated in step 1\n")


def test_problems_in_python(cli):
    """Only where they are allowed; their systems come from a process of their own."""
    cli.write("mine.py", SWING)
    how = ("export", "mine.py:swing", "--h", "1e-3", "--steps", "2", "--preconditioning", "none")
    line = cli.refused(*how)
    assert line.endswith("mine.py is code, which runs only with --allow-code")
    cli(*how, "--allow-code")
    systems = newmark.linear_systems(swing(cli.folder), h=1e-3, steps=[2], scaling="none")
    for system, (_, matrix, b, *_) in zip(systems, read(cli.folder / "systems"), strict=True):
        assert np.array_equal(matrix.toarray(), system.matrix.toarray())
        assert np.array_equal(b, system.rhs)


@each("arguments, message", [
    (("nonsense",), "nonsense: no study and no problem of this name; allowed: all-forms"),
    (("sensitivity",), "nothing to export: 10 cells left out: they measure at the initial"),
    (("pendulum", "--steps", "1,x"), "Invalid value for '--steps': must be numbers of steps"),
    (("pendulum", "--steps", "1", "--every", "1"), "--steps and --every: give one of them"),
    (("pendulum", "--h", "nan"), "Invalid value for '--h': must be positive, given nan"),
    (("pendulum", "--form", "w"), "command line: form[1]: unknown form 'w'"),
    (("pendulum", "--steps", "9", "--t-end", "1e-3"), "step 9 is past the last step: the"),
    (("pendulum", "--every", "1", "--t-end", "1"), "systems of 20202000 steps are more than"),
    (("pendulum", "--h", "1e-200"),
     "nothing to export: pendulum u-lambda none h=1e-200 steps=100"),
    (("pendulum", "--out", "file"), "file: cannot be written: it is not a folder"),
    (("pendulum", "--out", "file/new"), "file/new: cannot be written: "),
    (("pendulum", "--out", "link"), "link: cannot be written: it is a symbolic link"),
])  # fmt: skip
def test_what_cannot_be_exported_is_refused(cli, arguments, message):
    cli.write("file", "mine")
    (cli.folder / "folder").mkdir()
    (cli.folder / "link").symlink_to("folder")
    assert cli.refused("export", *arguments).startswith(f"newmark-study: {message}")
    assert sorted(entry.name for entry in cli.folder.iterdir()) == ["file", "folder", "link"]
    assert not any((cli.folder / "folder").iterdir())


QUICK = ("export", "pendulum", "--h", "1e-3", "--preconditioning", "none")


def test_other_peoples_files_stay(cli):
    """A folder that holds anything else is refused, and with --force added to."""
    out = cli.folder / "out"
    cli(*QUICK, "--steps", "1,2", "--out", "out")
    first = contents(out)
    cli.write("out/notes.txt", "mine")
    line = cli.refused(*QUICK, "--steps", "3", "--out", "out")
    assert "'notes.txt' in it is not of an export; name another folder, or give --force" in line
    assert {path: out.joinpath(path).read_bytes() for path in first} == first
    cli(*QUICK, "--steps", "3", "--out", "out", "--force")
    assert (out / "notes.txt").read_text() == "mine"
    assert [entry["step"] for entry, *_ in read(out)] == [3, 3]
    assert len([*out.iterdir()]) == 2 + 2
    # A solver's results among the files of a system are somebody's, too.
    (out / "notes.txt").unlink()
    (mine,) = (p.parent for p in out.glob("*/J.mtx") if "iteration1" in str(p))
    (mine / "my-solution.mtx").write_text("mine")
    assert f"{mine.name!r} in it is not of an export" in cli.refused(*QUICK, "--out", "out")
    line = cli.refused(*QUICK, "--steps", "3", "--out", "out", "--force")
    assert line.endswith(f"{mine.name!r} in it is not of an export")
    assert (mine / "my-solution.mtx").read_text() == "mine"
    assert len([*read(out)]) == 2


def test_an_interrupted_export_leaves_what_was(cli):
    """The old collection, and nothing under a temporary name."""
    out = cli.folder / "out"
    cli(*QUICK, "--steps", "1", "--out", "out")
    before = contents(out)
    run = cli.start(*QUICK, "--every", "1", "--t-end", "10", "--out", "out")
    wait_until(lambda: [*cli.folder.glob(".out.*/00003-*")])
    os.kill(run.pid, signal.SIGTERM)
    output, errors = run.communicate(timeout=60)
    assert (run.returncode, output) == (128 + signal.SIGTERM, "")
    assert len(errors.splitlines()) == 1
    assert contents(out) == before
    assert [entry.name for entry in cli.folder.iterdir()] == ["out"]
