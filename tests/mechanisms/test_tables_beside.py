"""Tables of laws and springs in files beside a mechanism, and what is between their values."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline

from newmark_cli.mechanisms import loading
from newmark_cli.support.documents import DocumentError

TIMES = np.linspace(0.0, 2.0, 9)
VALUES = 1 + 0.2 * np.sin(3 * TIMES) - 0.2 * np.sin(6.0) * TIMES / 2
VALUES[-1] = VALUES[0]
DRIVEN = """\
points:
  A: {at: [1, 0], mass: 1}
  B: {at: [1, -1], mass: 2}
bars: {rod: {from: A, to: B, length: 1}}
motions: {along: {point: A, x: {table: {file: motion.csv, MORE}}}}
project_velocities: true
"""


def driven(folder, more, text=None):
    lines = [f"{t!r},{x!r}" for t, x in zip(TIMES.tolist(), VALUES.tolist(), strict=True)]
    (folder / "motion.csv").write_text(text or "\n".join(["t,value", *lines, ""]))
    path = folder / "driven.yaml"
    path.write_text(DRIVEN.replace("MORE", more))
    return loading.load(path, "driven", "driven.yaml")


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("interpolation: cubic", CubicSpline(TIMES, VALUES)),
        ("interpolation: pchip", PchipInterpolator(TIMES, VALUES)),
        ("interpolation: quintic", make_interp_spline(TIMES, VALUES, k=5)),
        (
            "interpolation: quintic, ends: periodic",
            make_interp_spline(TIMES, VALUES, k=5, bc_type="periodic"),
        ),
        (
            "interpolation: quintic, ends: natural",
            make_interp_spline(TIMES, VALUES, k=5, bc_type=([(3, 0.0), (4, 0.0)],) * 2),
        ),
    ],
)
def test_motions_from_a_file(tmp_path, more, expected):
    """The law of time, its rate and its second derivative are those of SciPy's splines."""
    subject, at_rest = driven(tmp_path, more), np.zeros(4)
    place = list(subject.constraint_names).index("motions.along.x")
    times = [0.0, 0.1, 0.25, 0.9, 1.6, 2.0] + ([2.3] if "periodic" in more else [])
    for t in times:
        law = [float(expected(np.clip(t % 2.0 if t > 2 else t, 0, 2), k)) for k in range(3)]
        phi = subject.constraint_values(t, subject.u0)[place]
        rate, curvature = subject.constraint_derivatives(t, subject.u0, at_rest)
        found = [subject.u0[0] - phi, -rate[place], -curvature[place]]
        np.testing.assert_allclose(found, law, rtol=1e-10, atol=1e-10)
    assert set(subject.sources) == {"driven.yaml", "motion.csv"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("time,value\n0,1\n", "motion.csv, line 1: no column 't'; the first line must be t,value"),
        ("t,value\n0,1\n1,abc\n", "motion.csv, line 3: value: must be a number, given 'abc'"),
        ("t,value\n0,1\n1\n", "motion.csv, line 3: value: must be a number, given ''"),
        ("t,value\n0,1\n1,2\n1,3\n", "motion.csv, line 4: t: must increase: 1 follows 1"),
        ("t,value\n0,1\n", "table.times: must be 2 at least, given 1"),
    ],
)
def test_mistakes_in_a_file(tmp_path, text, told):
    with pytest.raises(DocumentError) as error:
        driven(tmp_path, "ends: natural", text)
    assert str(error.value).startswith("driven.yaml, line 5: motions.along.x.table")
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("values: [0, 1]", "table.values: stands in the file; leave it out"),
        ("interpolation: pchip, ends: natural", "table.ends: is of splines"),
        ("interpolation: linear", "table.interpolation: must be"),
    ],
)
def test_mistakes_beside_a_file(tmp_path, more, told):
    with pytest.raises(DocumentError, match=told):
        driven(tmp_path, more)


def test_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "driven.yaml"
    path.write_text(DRIVEN.replace("MORE", "ends: natural"))
    with pytest.raises(DocumentError, match=r"driven.yaml, line 5: .*file: motion.csv: cannot be"):
        loading.load(path, "driven", "driven.yaml")


def test_forces_of_a_spring_from_a_file(tmp_path):
    (tmp_path / "spring.csv").write_text("length,force\n1,0\n2,30\n")
    path = tmp_path / "sprung.yaml"
    path.write_text("""\
points: {O: {fixed: [0, 0]}, A: {at: [1.5, 0], mass: 2}, B: {at: [1.5, 1], mass: 2}}
bars: {rod: {from: A, to: B, length: 1}}
springs: {s: {from: O, to: A, force: {table: {file: spring.csv}}}}
""")
    subject = loading.load(path, "sprung")
    found = subject.evaluate(0.0, subject.u0, np.zeros(4), np.zeros(1)).force
    np.testing.assert_allclose(found, [-15, 0, 0, 0], rtol=1e-13)
