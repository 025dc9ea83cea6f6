"""References: against exact and published motions, their own estimates, and their storage."""

import json

import numpy as np
import oracles
import pytest
from damaging import damaged
from mechanisms import built
from mpmath import ellipfun, mp, mpf

from newmark_cli.mechanisms.known import KNOWN
from newmark_cli.mechanisms.registry import problem
from newmark_cli.mechanisms.spec import Shipped
from newmark_cli.problems import multipliers, python_problem, reference
from newmark_cli.problems.reference import NoReference, relative_error, solution
from newmark_cli.running import references
from newmark_cli.running.references import References

PARTS = ("u", "v", "multipliers")
TIMES = [1e-3, 3.7, 20.0]


def true_errors(found, exact):
    """Relative errors of u, v and λ, and their estimates."""
    true = [
        *(
            relative_error(getattr(found, part), given)
            for part, given in zip("uv", exact[:2], strict=True)
        ),
        multipliers.relative_error(found.multipliers, exact[2], found.scales),
    ]
    return np.array(true), np.array([getattr(found, f"{part}_error") for part in PARTS])


def pendulum(t):
    """Exact u, v, λ of the pendulum from mpmath's elliptic functions."""
    with mp.workdps(40):
        sn, cn, dn = (ellipfun(kind, mpf(t), m=mpf("0.5")) for kind in ("sn", "cn", "dn"))
        rate = -sn / dn
        x, y = cn / dn**2, -(rate**2) / 2
        return [np.array(part, float) for part in ([x, y], [-rate * y, rate * x], [3 * y])]


@pytest.mark.parametrize("t", TIMES)
def test_known_pendulum_is_exact(t):
    """Against mpmath: as good as it says, and that is very good unless v or λ vanish."""
    found = KNOWN["pendulum"](t)
    assert (found.t, found.source) == (t, "exact")
    true, estimated = true_errors(found, pendulum(t))
    assert np.all(true <= 3 * estimated)
    assert estimated[0] < 1e-13
    assert np.all(estimated < 1e-12)


def test_converged_pendulum_is_as_good_as_it_says():
    """True errors stay below the estimates, which are not far above them."""
    found = solution(problem("pendulum"), 3.7)
    assert (found.t, found.source) == (3.7, "converged")
    true, estimated = true_errors(found, pendulum(3.7))
    assert np.all(true <= estimated)
    assert np.all(estimated <= 500 * true + 3e-12)
    assert true[0] < 1e-13


#: Andrews' mechanism at t = 0.03 from the data as doubles: E, F, G, H, their velocities,
#: and λ of K1 to K7.  Gragg's extrapolation of order 16 in numbers with 64 bits of
#: mantissa; 200 and 300 steps agree to 6e-17, 4e-16 and 8e-17 of the largest.
ANDREWS = (
    (-3.492161839530312325e-02, -2.240841082126743745e-03, -6.963039427046851391e-03,
     -7.183884307191066514e-04, -3.471521904988390603e-02, 1.775809387227046630e-02,
     -3.468133356442837459e-02, -2.223939761003773977e-02),
    (3.858302090993528741e-01, 1.575920841936894774e-02, 8.189055570847690252e-01,
     -7.937310008321320469e+00, -1.148751209651568690e-02, 1.985973266054867375e-02,
     6.453692930629691416e-03, 1.120095833275756153e-02),
    (-9.936648291592917047e+04, -9.34010039283226212e+03, -1.373837850305649684e+03,
     1.524773453348435728e+03, -3.796373962799206513e+02, -5.333876582438622337e+02,
     1.443965864263523008e+02),
)  # fmt: skip


def published():
    """Points and velocities of the published table, and λ by a system of its own."""
    with mp.workdps(oracles.DIGITS):
        points = oracles.andrews_points(oracles.REFERENCE_ANGLES, oracles.REFERENCE_RATES)
    u, v = (np.array(part, float) for part in points)
    multipliers = oracles.index_1(problem("andrews"), 0.03, u, v)[1]
    return [u, v, multipliers]


def test_andrews():
    """Converged: 1e-12 or so, against more digits; the published table is good for 1e-9 or so."""
    converged, known = solution(problem("andrews"), 0.03), KNOWN["andrews"](0.03)
    exact, table = [np.array(part) for part in ANDREWS], published()
    true, estimated = true_errors(converged, exact)
    assert np.all(true <= estimated)
    assert np.all(true <= [1e-12, 5e-12, 5e-13])
    assert np.all(estimated <= [1.5e-11, 9e-11, 9e-12])
    # 8e-12 m, 1.1e-8 m/s, 2.6e-10 in λ.
    assert np.all(true_errors(converged, table)[0] <= [2.4e-10, 1.5e-9, 2.7e-10])
    assert known.source == "published"
    assert np.all(true_errors(known, table)[0] <= [1e-14, 1e-14, 1e-12])
    true, estimated = true_errors(known, exact)
    assert np.all(true <= estimated)
    assert np.all(estimated <= 1.3 * true)
    assert KNOWN["andrews"](0.02) is None


def bead(t):
    """On a rod that turns at 3 rad/s it flies outwards, r = cosh 3t: Φ is linear in u."""
    rate, mass = 3.0, 2.0
    definition = {
        "mass_matrix": mass * np.eye(2),
        "u0": [1.0, 0.0],
        "v0": [0.0, rate],
        "force": lambda u, v, t: np.zeros(2),
        "constraints": lambda u, t: np.array([u[1] * np.cos(rate * t) - u[0] * np.sin(rate * t)]),
        "gradient": lambda u, t: np.array([[-np.sin(rate * t)], [np.cos(rate * t)]]),
    }
    radius, speed = mp.cosh(rate * t), rate * mp.sinh(rate * t)
    along, across = (mp.cos(rate * t), mp.sin(rate * t)), (-mp.sin(rate * t), mp.cos(rate * t))
    return definition, (
        [radius * c for c in along],
        [speed * c + radius * rate * s for c, s in zip(along, across, strict=True)],
        [2 * mass * rate * speed],
    )


def test_references_by_differences_are_as_good_as_they_say():
    """Φ_t and Φ'' are found by differences, whose errors are alike in all solutions."""
    t = 0.37
    with mp.workdps(30):
        definition, exact = bead(mpf(t))
    subject = python_problem.from_definition(python_problem.Definition(**definition), "moved")
    assert subject.rows_given == "differences"
    found = solution(subject, t)
    true, estimated = true_errors(found, [np.array(part, float) for part in exact])
    assert np.all(true <= estimated)
    assert np.all(estimated <= 3e-11)


def test_a_fast_motor_has_its_rounding_stated():
    """sin ωt of ωt = 300 is known to 300 roundings, though all solutions agree on it."""
    subject = built(
        "points: {P: {at: [0, 0], mass: 1, velocity: [300, 0]}}\n"
        "sliders: {rail: {point: P, through: [0, 0], direction: [1, 0]}}\n"
        "motions: {drive: {point: P, x: {amplitude: 1, frequency: 300}}}\n"
    )
    found = solution(subject, 0.1234)
    with mp.workdps(30):
        sine, cosine = (float(part(300 * mpf(0.1234))) for part in (mp.sin, mp.cos))
    exact = [np.array(part) for part in ([sine, 0], [300 * cosine, 0], [0, -9e4 * sine])]
    true, estimated = true_errors(found, exact)
    assert np.all(true <= estimated)
    assert np.all(estimated <= 5e-14)


@pytest.mark.parametrize(("limit", "value", "words"), [
    ("_MOST_STEPS", 20, r"no reference beyond t = 0\.\d+, which 20 steps"),
    ("_WORST", 1e-13, r"so sensitive that its solutions .* are .* apart"),
])  # fmt: skip
def test_motions_without_a_reference(monkeypatch, limit, value, words):
    """Work is bounded, and how far it came is said; two solutions that differ are none."""
    monkeypatch.setattr(reference, limit, value)
    with pytest.raises(NoReference, match=words):
        solution(problem("double-pendulum"), 3.0)


@pytest.fixture
def counted(monkeypatch):
    """Times for which a reference was computed."""
    times = []

    def count(subject, t, on_work):
        times.append(t)
        return solution(subject, t, on_work)

    monkeypatch.setattr(reference, "solution", count)
    return times


SPEC = Shipped("double-pendulum")


def files(folder):
    return sorted((folder / "references").glob("*"))


def same(one, other):
    return all(
        np.array_equal(a, b) and type(a) is type(b)
        for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
    )


def stored_in(folder):
    """References of a folder, computed in this process."""
    return References(folder, lambda spec, t: reference.solution(spec.load(), t, lambda: None))


def test_known_solutions_come_first(tmp_path, counted):
    """Nothing is computed or stored for them, but at other times."""
    stored = stored_in(tmp_path)
    assert stored.of(Shipped("pendulum"), 12.5).source == "exact"
    assert stored.of(Shipped("andrews"), 0.03).source == "published"
    assert counted == []
    assert not (tmp_path / "references").exists()
    assert stored.of(Shipped("andrews"), 0.003).source == "converged"
    assert counted == [0.003]


def test_stored_reference_reads_back_to_the_same_bits(tmp_path, counted):
    """Another run reads the file; its name says what it is."""
    first = stored_in(tmp_path).of(SPEC, 0.2)
    second = stored_in(tmp_path).of(SPEC, 0.2)
    assert counted == [0.2]
    assert same(first, second)
    (path,) = files(tmp_path)
    assert path.name.startswith("double-pendulum-0.2-")
    record = json.loads(path.read_text())
    assert record["estimated_error"]["lambda"] == first.multipliers_error
    assert record["lambda_scale"] == first.scales.tolist()


def test_damaged_files_are_never_read(tmp_path):
    """One flipped bit, cut, empty, of another shape or problem: computed again, and mended."""
    first = stored_in(tmp_path).of(SPEC, 0.2)
    (path,) = files(tmp_path)
    whole, times = path.read_bytes(), []

    def solve(spec, t):
        times.append(t)
        return first

    others = (
        whole.replace(b'"v": [', b'"v": [NaN,', 1).replace(b",\n", b",", 1),
        whole.replace(b'"content": "', b'"content": "0'),
    )
    for content in (*damaged(whole, flips=10), *others):
        path.write_bytes(content)
        times.clear()
        assert same(References(tmp_path, solve).of(SPEC, 0.2), first)
        assert times == [0.2]
        assert path.read_bytes() == whole


SWING = """\
points: {O: {fixed: [0, 0]}, P: {at: [0.6, 0.8], mass: 1}}
bars: {rod: {from: O, to: P, length: 1}}
springs: {s: {from: O, to: P, stiffness: 2, rest_length: 1}}
gravity: [0, -1]
"""


@pytest.mark.parametrize(("old", "new"), [
    ("stiffness: 2", "stiffness: 2.0000000000000004"),
    ("mass: 1}", "mass: 1, velocity: [-0.8, 0.6]}"),
    ("gravity: [0, -1]", "gravity: [0, -2]"),
])  # fmt: skip
def test_changed_mechanism_has_another_reference(monkeypatch, old, new):
    """Every number of a mechanism counts, to the last bit; its name does not."""
    problems = [built(SWING), built(SWING, "other"), built(SWING.replace(old, new))]
    one, two, three = (references.digest(subject, 0.5) for subject in problems)
    assert one == two != three
    assert references.digest(problems[0], 0.25) != one
    # Nor is a reference of another version taken.
    monkeypatch.setattr(reference, "VERSION", reference.VERSION + 1)
    assert references.digest(problems[0], 0.5) != one


def test_the_last_time_of_a_table_has_an_error_of_the_multipliers():
    """No value lies beyond it, so that how λ changes in time is seen from before."""
    driven = built(
        "project_velocities: true\n"
        "points: {O: {fixed: [0, 0]}, A: {at: [1, 0]}}\n"
        "bodies: {arm: {from: O, to: A, length: 1, mass: 1, inertia: 0.1}}\n"
        "motions: {m: {body: arm, angle: {table: {times: [0, 0.1, 0.2, 0.3, 0.4],"
        " values: [0, 0.1, 0.15, 0.3, 0.2]}}}}\n"
    )
    before, last = (solution(driven, t).multipliers_error for t in (0.39, 0.4))
    assert 0 < last < 10 * before < 1e-12
