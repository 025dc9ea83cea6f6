"""Advice for other people's codes: numbers against mpmath, refusals, and the mistakes they made."""

import json
import runpy
from dataclasses import replace
from functools import partial
from pathlib import Path

import exact_orders
import mpmath
import numpy as np
import oracles
import own_mechanisms
import pytest
import scipy.io
import scipy.sparse
from conftest import SWING
from covering import covering

import newmark_cli as newmark
from newmark_cli.advice import advising, linearised
from newmark_cli.library.scalings import read, scheme_of
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.jacobian import scaling_factors
from newmark_cli.newmark.noise import carried
from newmark_cli.support import matrices

pytestmark = pytest.mark.usefixtures("of_float64")

EXAMPLE = Path(__file__).parents[2] / "docs/examples/matrices.py"
#: Of β and γ, far from those of the trapezoidal rule.
BETA, GAMMA = 0.3, 0.6
FORMS = [form for form in oracles.FORMS if form not in ("u-a-lambda", "v-a-lambda")]


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Folder that the script of the docs has written into."""
    folder = tmp_path_factory.mktemp("example")
    runpy.run_path(str(EXAMPLE))["main"](folder)
    return folder


@pytest.fixture
def without_noise(monkeypatch):
    """Advice without the noise of λ, which takes two thirds of its time and has its own tests."""
    monkeypatch.setattr(advising, "_noise", lambda about, schemes: None)


@pytest.fixture
def without_floors(monkeypatch):
    """Advice without noise and tolerances, for what J alone tells."""
    monkeypatch.setattr(linearised.Subject, "floors", lambda *given, **options: [])


@pytest.fixture
def advise_cli(cli, few_draws):
    """The command `advise` that draws less often, too."""

    def run(*arguments):
        done = cli("advise", *arguments)
        assert done.stderr == ""
        return done.stdout

    return run


@pytest.fixture(scope="module")
def double(example):
    """Its matrices."""
    with np.load(example / "double.npz", allow_pickle=False) as found:
        return dict(found)


def exact_blocks(found, form, h, beta=BETA, gamma=GAMMA):
    """J of a form in mpmath, and the block of each row and column."""
    matrices = (mpmath.matrix(found[name].tolist()) for name in ("X", "Y", "M", "G"))
    return exact_orders.form_jacobian(form, *matrices, h, beta, gamma)


@pytest.mark.usefixtures("without_floors")
@pytest.mark.parametrize(("form", "h"), [
    ("u-lambda", 1e-8), ("v-lambda", 1e-7), ("u-v-a-lambda", 1e-7),
])  # fmt: skip
def test_condition_numbers_are_those_of_mpmath(example, double, form, h):
    """Every variant within 1e-9 of 70 digits, up to C = 1e32, from a file that NumPy wrote.

    Factors, as numbers and as the lines to paste give them, are those of Table 2.
    """
    advice = newmark.advise(example / "double.npz", h=h, form=form, beta=BETA, gamma=GAMMA)
    pasted = {"np": np, "h": h}
    exec("\n".join(advice.code["numpy"][:3]), pasted)
    sizes = [4] * (len(advice.factors[h].left) - 1) + [2]
    for side, table in zip(("left", "right"), oracles.TABLE_2[form], strict=True):
        factors = getattr(advice.factors[h], side)
        expected = [table[name](BETA, GAMMA, h) if name in table else 1.0 for name in factors]
        assert [*factors.values()] == pytest.approx(expected, rel=1e-14)
        np.testing.assert_allclose(pasted[side], np.repeat(expected, sizes), rtol=1e-14)
    with mpmath.workdps(70):
        blocks = exact_blocks(double, form, h)
        for variant in ("none", "left", "right", "optimal"):
            scaled = oracles.scale(form, variant, *blocks, h, BETA, GAMMA)
            expected = float(oracles.condition_number(scaled))
            assert advice.condition[h][variant] == pytest.approx(expected, rel=1e-9), variant


def test_file_folder_and_dict_say_the_same(example, double, advise_cli):
    """An .npz file, Matrix Market files and arrays give the same numbers; so does --json."""
    for path in (example / "double.npz", example / "double"):
        read = matrices.read(path, tuple(double))
        assert read.keys() == double.keys()
        for name, matrix in double.items():
            np.testing.assert_array_equal(np.squeeze(read[name]), np.squeeze(matrix), err_msg=name)
    of_arrays = newmark.advise(double, h=1e-4).to_dict()
    printed = json.loads(advise_cli("--matrices", example / "double.npz", "--h", "1e-4", "--json"))
    for key in ("condition", "tolerances", "noise", "code", "findings", "factors"):
        assert json.loads(json.dumps(of_arrays[key])) == json.loads(json.dumps(printed[key])), key


@pytest.mark.usefixtures("without_noise")
def test_a_problem_gives_the_numbers_of_its_own_matrices():
    """Advice on the same mechanism as a document of this package: the same condition numbers."""
    problem = newmark.problem("andrews")
    start = newmark.march(problem, h=1e-6, steps=1)
    at = problem.evaluate(0.0, problem.u0, problem.v0, start.multipliers[0])
    own = newmark.advise("andrews", h=1e-5, form="v-lambda")
    given = {"M": problem.M, "G": at.G, "X": at.X, "Y": at.Y}
    theirs = newmark.advise(given, h=1e-5, form="v-lambda")
    assert theirs.condition[1e-5]["none"] == pytest.approx(own.condition[1e-5]["none"], rel=1e-6)
    assert theirs.tolerances == ()
    assert own.tolerances != ()
    assert own.orders == {"none": -3, "left": -1, "right": -2, "optimal": 0}
    assert own.best_form == "u-lambda"


@pytest.mark.usefixtures("without_noise")
def test_what_is_not_given_is_said():
    """Without X, Y and a state the advice says what it leaves out."""
    advice = newmark.advise({"M": np.eye(2), "G": [[1.0], [0.0]]}, h=1e-3)
    notes = " ".join(advice.findings)
    assert "X is not given" in notes
    assert "Y is not given" in notes
    assert "no state" in notes
    # [[4e6, 0, −1], [0, 4e6, 0], [1, 0, 0]], by hand: σ = 4e6 and about 2.5e-7.
    assert advice.condition[1e-3]["none"] == pytest.approx(1.6e13, rel=1e-3)
    assert advice.condition[1e-3]["optimal"] == pytest.approx((3 + 5**0.5) / 2, rel=1e-12)
    with pytest.raises(newmark.NewmarkError, match="only where a state"):
        newmark.advise({"M": np.eye(2), "G": [[1.0], [0.0]]}, h=1e-3, tolerance=1e-8)
    # M may be singular where the constraints hold what has no mass.
    mass, gradient = np.diag([2.0, 0.0, 1.0]), np.array([[0.0], [1.0], [0.5]])
    advice = newmark.advise({"M": mass, "G": gradient}, h=1e-4)
    full = np.block([[mass * 4e8, -gradient], [gradient.T, np.zeros((1, 1))]])
    assert advice.condition[1e-4]["none"] == pytest.approx(np.linalg.cond(full), rel=1e-6)
    assert advice.condition[1e-4]["optimal"] < 10


def npz(path, **arrays):
    np.savez(path, **arrays)
    return path


class Evil:
    """Its pickle writes a file."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return (Path.touch, (self.marker,))


EYE, COLUMN = np.eye(3), np.ones((3, 1))
BAD = {
    "not square": (lambda p: npz(p, M=np.ones((3, 2)), G=COLUMN), "M must be square, given 3 by 2"),
    "transposed": (lambda p: npz(p, M=EYE, G=np.ones((1, 3))), "by 3; give its transpose"),
    "sizes": (lambda p: npz(p, M=EYE, G=np.ones((4, 1))), "G must be 3 by 1, given 4 by 1"),
    "part of a state": (lambda p: npz(p, M=EYE, G=COLUMN, u=np.ones(3)), "v, a, lambda is missing"),
    "NaN": (lambda p: npz(p, M=EYE * np.nan, G=COLUMN), "M has nan at (1, 1); must be finite"),
    "complex": (lambda p: npz(p, M=EYE * 1j, G=COLUMN), "M is complex; must be real"),
    "rank": (lambda p: npz(p, M=EYE, G=np.ones((3, 2))), "G has rank below 2"),
    "saddle": (lambda p: npz(p, M=np.diag([1.0, 0, 0]), G=COLUMN), "[M −G; Gᵀ 0] is singular"),
    "missing": (lambda p: npz(p, M=EYE), "G is missing; needed: M, G"),
    "none": (lambda p: npz(p, A=EYE), "the file has none of M, G"),
    "large": (lambda p: npz(p, M=np.ones((1, 5000)), G=COLUMN), "1 by 5000; at most 4000"),
    "empty": (lambda p: p.write_bytes(b"") or p, "not an .npz file"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_matrices_that_cannot_be_used_are_refused_in_one_line(cli):
    for name, (make, message) in BAD.items():
        make(cli.folder / "bad.npz")
        with pytest.raises(newmark.NewmarkError) as caught:
            newmark.advise(cli.folder / "bad.npz", h=1e-3)
        assert message in str(caught.value), name
        assert str(caught.value).isprintable()
    line = cli.refused("advise", "--matrices", "bad.npz", "--h", "1e-3")
    assert line.startswith(f"newmark-study: bad.npz: {message}")


def test_nothing_is_unpickled(cli, tmp_path):
    """An object array is refused, by its name, and its code does not run."""
    marker = tmp_path / "ran"
    evil = np.array([Evil(marker)], object)
    npz(cli.folder / "evil.npz", M=evil, G=evil)
    line = cli.refused("advise", "--matrices", "evil.npz", "--h", "1e-3")
    assert "M: not an array, or cut off: Object arrays cannot be loaded" in line
    assert not marker.exists()
    np.load(cli.folder / "evil.npz", allow_pickle=True)["M"]  # it would have
    assert marker.exists()


@pytest.mark.parametrize(("form", "variant"), covering(FORMS, ("none", "left", "right", "optimal")))
def test_the_scaling_in_a_jacobian_is_found(double, form, variant):
    """From two step sizes always; multiplied by the factors, it is the optimal one."""
    steps, several, optimal = [1e-3, 1e-4], [], []
    for h in steps:
        jacobian = np.array(exact_blocks(double, form, h)[0].tolist(), float)
        factors = newmark.scaling(form, h=h, beta=BETA, gamma=GAMMA)
        sizes = [4] * (len(factors.left) - 1) + [2]
        left, right = (np.repeat([*side.values()], sizes) for side in (factors.left, factors.right))
        optimal.append(left[:, None] * jacobian * right)
        several.append(
            (left[:, None] if variant in ("left", "optimal") else 1.0)
            * jacobian
            * (right if variant in ("right", "optimal") else 1.0)
        )
    blocks = dict(zip(factors.right, sizes, strict=True))
    known = {"blocks": blocks, "beta": BETA, "gamma": GAMMA}
    advice = newmark.advise_jacobian(several, h=steps, **known)
    assert (advice.found, advice.measured) == (variant, True)
    assert advice.balanced[1] == pytest.approx(np.linalg.cond(optimal[1]), rel=1e-9)
    # From one: what the blocks cannot tell is between two that are said, and one is right.
    single = newmark.advise_jacobian(several[1], h=1e-4, **known)
    assert not single.measured
    assert variant in single.implied
    assert single.found in single.implied
    assert len(single.implied) == (2 if (form, variant) in AMBIGUOUS else 1)
    assert single.balanced[0] == pytest.approx(np.linalg.cond(optimal[1]), rel=1e-9)
    # Signs of rows and of G are a matter of taste.
    flipped = several[1] * np.where(np.arange(len(several[1])) < 4, -1, 1)[:, None]
    assert newmark.advise_jacobian(flipped, h=1e-4, **known).implied.keys() == single.implied.keys()


#: Pairs that differ by a factor in the block of M only, or in all blocks.
AMBIGUOUS = {("u-lambda", "none"), ("u-lambda", "optimal")} | {
    ("a-lambda", variant) for variant in ("none", "left", "right", "optimal")
}


def test_the_scaling_half_way_is_told_by_its_powers(double):
    """Row D scaled by h and λ by 1/h: none of the four, and the factors that remain."""
    several = []
    for h in (1e-3, 1e-5):
        exact = exact_blocks(double, "u-lambda", h, 0.25, 0.5)[0]
        jacobian = np.array(exact.tolist(), float)
        jacobian[:4] *= h
        jacobian[:, 4:] /= h
        several.append(jacobian)
    advice = newmark.advise_jacobian(several, blocks="u=4,lambda=2", h=[1e-3, 1e-5])
    assert advice.found == "none of the four"
    assert dict(advice.left) == {"D": "beta*h", "C": "1"}
    assert dict(advice.right) == {"u": "1", "lambda": "1/(beta*h)"}
    assert advice.condition[1] > 1e8
    assert advice.balanced[1] < 10
    single = newmark.advise_jacobian(several[1], blocks="u=4,lambda=2", h=1e-5)
    # One Jacobian has the blocks of G and Gᵀ as it would have them unscaled: sizes tell.
    assert "of very different size all the same" in single.findings[-1]
    assert float(single.findings[-1].rpartition("= ")[2]) < 10


def test_what_the_command_reads_and_refuses(example, cli, advise_cli):
    """Files with and without names of blocks; studies have problems; mistakes take a line."""
    found = json.loads(advise_cli("--jacobian", example / "jacobians.npz", "--json"))
    assert (found["found"], found["right"]["lambda"]) == ("left", "1/(beta*h^2)")
    assert found["orders"]["D"]["lambda"] == pytest.approx(2.0, abs=1e-9)
    with np.load(example / "jacobians.npz") as several:
        scipy.io.mmwrite(cli.folder / "one.mtx", several["J"][1])
    one = ("--jacobian", "one.mtx", "--h", "1e-4")
    text = advise_cli(*one, "--blocks", "u=4,lambda=2")
    assert "inferred from one Jacobian: its blocks fit no other" in text
    npz(cli.folder / "fine.npz", M=EYE, G=COLUMN)
    cli.write("mine.py", SWING)
    for arguments, said in (
        (one, "such as u=8,lambda=7"),
        ((*one, "--blocks", "lambda=2,u=4"), "no form has lambda,u"),
        ((*one, "--blocks", "u=4,lambda=3"), "must be 7 by 7"),
        ((*one, "--blocks", "u=4,lambda=2", "--tolerance", "1"), "--tolerance does not go"),
        (("--matrices", "no.npz", "--h", "1e-3"), "No such file"),
        (("--matrices", "mine.py", "--h", "1"), "an .npz file or a folder"),
        (("--matrices", "fine.npz", "--h", "1e-3", "--formulation", "ggl"), "index-3"),
        (("--h", "1e-3"), "give one of SUBJECT"),
        (("pendulum",), "--h: give a step size"),
        (("mine.py:swing", "--h", "1e-3"), "--allow-code"),
        (("pendulm", "--h", "1e-3"), "did you mean 'pendulum'?"),
    ):
        assert said in cli.refused("advise", *arguments)


def finding(advice, word):
    """The one finding that has a word."""
    (text,) = [text for text in advice.findings if word in text]
    return text


@pytest.mark.usefixtures("without_noise", "few_draws")
def test_tolerances_and_scalings_are_judged():
    """Where they are tested, and what one side leaves: C of order −2, at two step sizes."""
    advise = partial(newmark.advise, newmark.problem("random-chain", links=5))
    tested = {"h": 1e-5, "tolerance": 1e-8, "residual_tolerance": 1e-9}
    advice = advise(**tested, tested="physical", residual_tested="before")
    for word, said in (
        ("tolerance 1e-08", ("cannot be met at h = 1e-05", "test beta*h^2 · λ instead")),
        ("residual, tested", ("before scaling: cannot be met", "test D_L b instead")),
    ):
        for text in said:
            assert text in finding(advice, word)
    advice = advise(**tested)
    assert "on the scaled correction of all unknowns: can be met" in finding(
        advice, "tolerance 1e-08"
    )
    assert "after scaling: can be met" in finding(advice, "residual, tested")
    for variant, word in (("left", "unknowns"), ("right", "equations")):
        advice = advise(h=[1e-4, 1e-5], scaling=variant, tolerance=1e-8)
        growth = advice.condition[1e-5][variant] / advice.condition[1e-4][variant]
        assert growth == pytest.approx(100, rel=1e-2)
        text = finding(advice, "both sides of Table 2")
        assert f"scale the {word}, too. C still grows like h^-2" in text
        assert ("λ is not scaled under left" in finding(advice, "tolerance 1e-08")) == (
            variant == "left"
        )


@pytest.mark.usefixtures("without_noise")
def test_units_that_rule_the_conditioning_are_told_and_mended(double):
    """G in millimetres and M in tonnes: a factor for each block brings C back."""
    told = {**{name: double[name] for name in ("X", "Y")}, "M": double["M"] * 1e-6,
            "G": double["G"] * 1e3}  # fmt: skip
    told["X"], told["Y"] = told["X"] * 1e-6, told["Y"] * 1e-6
    advice = newmark.advise(told, h=1e-4)
    (found,) = advice.equilibrations
    assert found.optimal > 1e8
    assert found.with_fields < 100
    assert found.cause.startswith("units")
    assert f"C = {found.with_fields:.3g}" in finding(advice, "not h's doing")
    plain = newmark.advise({name: double[name] for name in ("M", "G", "X", "Y")}, h=1e-4)
    assert plain.equilibrations == ()
    left, right = (np.array(side) for side in (found.left, found.right))
    factors = newmark.scaling("u-lambda", h=1e-4)
    rows = left * np.repeat([*factors.left.values()], [4, 2])
    columns = right * np.repeat([*factors.right.values()], [4, 2])
    jacobian = told["X"] + 2e4 * told["Y"] + 4e8 * told["M"]
    full = np.block([[jacobian, -told["G"]], [told["G"].T, np.zeros((2, 2))]])
    assert np.linalg.cond(rows[:, None] * full * columns) == pytest.approx(found.with_all, rel=1e-6)
    # A spring whose frequency the step does not resolve: that is no question of units.
    stiff = {"M": np.eye(3), "G": np.array([[1.0], [0.0], [1.0]]), "X": np.diag([0.0, 1e16, 1.0])}
    (found,) = newmark.advise(stiff, h=1e-3).equilibrations
    assert found.cause.startswith("stiffness")
    assert found.with_all < 10


@pytest.mark.usefixtures("without_noise")
@pytest.mark.parametrize(("name", "sizes", "h"), [
    ("andrews", {}, 1e-5), ("shaken-pendulum", {}, 1e-4), ("random-chain", {"links": 8}, 1e-4),
])  # fmt: skip
def test_three_times_the_smallest_tolerance_is_met_and_a_thirtieth_is_not(name, sizes, h):
    """At every step of a march, and at most steps, on the norm that the march tests."""
    problem, steps = newmark.problem(name, **sizes), 200
    how = {"h": h, "integrator": "generalized-alpha rho=0.9"}
    advice = newmark.advise(problem, t_end=steps * h, **how)
    (smallest,) = [one.scaled for one in advice.tolerances
                   if (one.unknown, one.precision) == ("all", "float64")]  # fmt: skip
    missed = [
        newmark.march(problem, steps=steps, every=0, stop={"absolute": part * smallest}, **how)
        for part in (3, 1 / 30)
    ]
    assert missed[0].status == "ok"
    assert missed[1].not_converged > 0.8 * steps


def schemes_of(form, integrator="newmark", scaling="optimal"):
    """What advice is about, but for the step size."""
    return partial(
        scheme_of, form=form, integrator=read("integrator", integrator), formulation=INDEX_3,
        scaling=scaling, evaluation="direct", precision="float64",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("integrator", "factor"), [("generalized-alpha rho=0.5", 8 * 2**0.5), ("hht alpha=0.1", 30.25)]
)
def test_noise_that_is_carried_on(integrator, factor):
    """Independent roundings of u add up to this multiple in λ; a march of them agrees."""
    found = carried(read("integrator", integrator))
    assert found == pytest.approx(factor, rel=1e-3)
    assert carried(read("integrator", "trapezoidal")) == np.inf
    relations = read("integrator", integrator).relations(1.0)
    random, past, seen = np.random.default_rng(3), np.zeros(len(relations.u_past)), []
    for u in random.normal(size=8_000):
        a = (u - relations.u_past @ past) / relations.u_from_a
        v = relations.v_from_a * a + relations.v_past @ past
        true = relations.acceleration @ [a, *past]
        new = [u, v, a, true, u - past[0] - past[1], v - past[1]]
        past = np.array([new[k] for k in relations.advance])
        seen.append(true)
    alone = relations.acceleration[0] / relations.u_from_a
    assert np.std(seen[500:]) / alone == pytest.approx(factor, rel=0.1)


UNSCALED = np.array([[4e6, 0, -1], [0, 4e6, 0], [1, 0, 0]])


@pytest.mark.parametrize(("given", "blocks", "h", "said"), [
    (UNSCALED, "u=2,lambda=1", 1e-300, "h must be between 1e-12 and 1e3 seconds, given 1e-300"),
    (UNSCALED, "u=1,lambda=2", 1e-3, "lambda must be at most 1, the number of coordinates, given"),
    (UNSCALED, "u=2,u=2,lambda=1", 1e-3, "a name is there twice"),
    (5, "u=2,lambda=1", 1e-3, "jacobian must be a matrix, several of them"),
    (np.zeros((0, 3, 3)), "u=2,lambda=1", 1e-3, "jacobian: no matrix"),
])  # fmt: skip
def test_jacobians_that_cannot_be_used(given, blocks, h, said):
    """Step sizes out of range, blocks that no mechanism has, what is no matrix and no path."""
    with pytest.raises(newmark.NewmarkError, match=said):
        newmark.advise_jacobian(given, blocks=blocks, h=h)


@pytest.mark.parametrize(
    ("scaling", "form", "mechanism"),
    covering(
        ("none", "left", "optimal"),
        [*FORMS[::2], "u-a-lambda"],
        [own_mechanisms.slider_crank, own_mechanisms.heavy_top],
    ),
)
def test_an_inverse_is_not_taken_for_a_jacobian(scaling, form, mechanism):
    """As a code returns it that keeps J⁻¹; real ones pass, whatever the order of their rows."""
    random = np.random.default_rng(11)
    problem = newmark.problem(mechanism())
    about = linearised.Subject(problem, [problem], "", [])
    for h in (1e-1, 1e-5):
        scheme = schemes_of(form, scaling=scaling)(h=h)
        counts = scheme.form.sizes(problem.n, problem.m)
        left, right = scaling_factors(scheme, problem.n, problem.m)
        jacobian = left[:, None] * about.jacobian(scheme) * right
        blocks = dict(zip(scheme.form.unknowns, counts, strict=True))
        orders = [np.arange(len(jacobian)), random.permutation(len(jacobian))]
        orders.append(np.roll(orders[0], problem.m))
        for rows in orders:
            newmark.advise_jacobian(jacobian[rows], blocks=blocks, h=h)
        if np.linalg.cond(jacobian) > 1e14:  # its computed inverse is another matrix's
            continue
        with pytest.raises(newmark.NewmarkError, match="is the inverse of a Jacobian"):
            newmark.advise_jacobian(np.linalg.inv(jacobian), blocks=blocks, h=h)


@pytest.mark.usefixtures("few_draws")
def test_where_no_floor_is_predicted_a_tolerance_cannot_be_judged(cli):
    """Steps that do not converge, and formulations with a penalty, are said to have no floors."""
    coarse = newmark.advise("andrews", h=0.1, t_end=0.03, tolerance=1e-8)
    assert "cannot be judged: no floor is predicted at these step sizes" in coarse.findings[0]
    assert any("at h = 0.1: Newton's iteration does not conv" in one for one in coarse.findings)
    assert "nan" not in str(coarse)
    with pytest.raises(newmark.NewmarkError, match="cannot be judged: with a penalty"):
        newmark.advise(
            "double-pendulum", h=1e-3, formulation="augmented-lagrangian", tolerance=1e-8
        )
    twice = ("--tolerance", "1e-8", "--tolerance", "1e-9")
    refused = cli("advise", "pendulum", "--h", "1e-3", *twice, code=2)
    assert "all unknowns: given twice" in refused.stderr


@pytest.mark.usefixtures("few_draws")
def test_noise_of_the_scheme_as_it_is():
    """Carried on at any h by the trapezoidal rule, down to some h with dissipation."""
    undamped, damped, ggl = (
        newmark.advise("pendulum", h=1e-4, **how)
        for how in ({}, {"integrator": "generalized-alpha rho=0.9"}, {"formulation": "ggl"})
    )
    assert undamped.noise.carried == {0.01: None, 1.0: None}
    assert 1e-9 < damped.noise.carried[0.01] < 1e-5
    assert damped.noise.one_step[0.01] < damped.noise.carried[0.01]
    assert ggl.noise.carried == {}
    assert "not predicted" in str(replace(ggl, tolerances=()))
    no_state = newmark.advise({"M": np.eye(2), "G": [[1.0], [0.0]]}, h=1e-3)
    assert no_state.noise is None
