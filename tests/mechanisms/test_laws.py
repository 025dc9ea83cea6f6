"""Laws of time in the plane, tables of them in the file or beside it, and where tables end."""

import numpy as np
import pytest
from mechanisms import built
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline
from test_planar_parts import start_of

import newmark_cli as newmark
from newmark_cli.mechanisms import loading
from newmark_cli.support.documents import DocumentError
from newmark_cli.support.errors import ArgumentError

TIMES, VALUES = [-0.25, 0.0, 0.25, 0.4, 0.7, 1.0], [0.5, 1.0, -1.0, 2.0, 0.0, 0.5]


def table(more):
    """A law, and with what else the file says of it."""
    return f"{{table: {{times: {TIMES}, values: {VALUES}, {more}}}}}"


def sines(t, k):
    """The k-th derivative of the law without a table's curve."""
    found = 2 * 3**k * np.sin(3 * t + 1 + k * np.pi / 2)
    found += 2**k * np.sin(2 * t + 1 + k * np.pi / 2)
    return found + (2 + 4 * t, 4, 0)[k]


FREE = ([(3, 0.0), (4, 0.0)],) * 2
#: Text, and t and k → the k-th derivative of what it says.
LAWS = {
    "cubic": (table("interpolation: cubic"), CubicSpline(TIMES, VALUES)),
    "natural": (table("ends: natural"), CubicSpline(TIMES, VALUES, bc_type="natural")),
    "periodic": (table("ends: periodic"), CubicSpline(TIMES, VALUES, bc_type="periodic")),
    "pchip": (table("interpolation: pchip"), PchipInterpolator(TIMES, VALUES)),
    "quintic": (table("interpolation: quintic"), make_interp_spline(TIMES, VALUES, k=5)),
    "quintic, natural": (
        table("interpolation: quintic, ends: natural"),
        make_interp_spline(TIMES, VALUES, k=5, bc_type=FREE),
    ),
    "quintic, periodic": (
        table("interpolation: quintic, ends: periodic"),
        make_interp_spline(TIMES, VALUES, k=5, bc_type="periodic"),
    ),
    "all": (
        "{value: 1, amplitude: 2, frequency: 3, phase: 1, powers: [0, 2], "
        "sines: [{amplitude: 1, frequency: 2, phase: 1}], table: {times: [0, 2], values: [1, 5]}}",
        sines,
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_laws_of_time(name):
    """The force and the torque that a law is, and place, rate and load of what it drives."""
    law, function = LAWS[name]
    subject = built(f"""\
points:
  O: {{fixed: [0, 1]}}
  P: {{at: [0, 0], mass: 2}}
  A: {{at: [1, 1]}}
  Q: {{at: [{float(function(0.0, 0))!r}, 0], mass: 3}}
bodies: {{disc: {{from: O, to: A, length: 1, mass: 0, inertia: 2}}}}
sliders: {{rail: {{point: P, through: [0, 0], direction: [1, 0]}}}}
forces: {{push: {{at: P, force: [{law}, -3]}}}}
torques: {{motor: {{on: disc, torque: {law}}}}}
motions: {{drive: {{point: Q, x: {law}}}}}
project_velocities: true
""")
    row = subject.constraint_names.index("motions.drive.x")
    for t in (0.0, 0.17, 0.25, 0.61, 1.0, *([1.3] if "periodic" in name else [])):
        begin, here, rate, faster = (
            float(function(t - 1.25 * (t > 1), k)) if at else float(function(0.0, 0))
            for at, k in ((False, 0), (True, 0), (True, 1), (True, 2))
        )
        found = start_of(subject, t)
        assert found["P.x"] == pytest.approx(here / 2, abs=1e-12)
        assert found["λ sliders.rail"] == pytest.approx(3, abs=1e-12)
        assert found["A.y"] == pytest.approx(here / 2, abs=1e-12)
        missed = subject.constraint_values(t, subject.u0)[row]
        assert missed == pytest.approx(begin - here, abs=1e-12)
        moving, _ = subject.constraint_derivatives(t, subject.u0, subject.v0)
        assert -moving[row] == pytest.approx(rate, abs=1e-10)
        assert found["Q.x"] == pytest.approx(faster, rel=1e-10, abs=1e-10)
        assert found["λ motions.drive.x"] == pytest.approx(3 * faster, rel=1e-10, abs=1e-10)


#: A point whose motion is in a table, beside the file or in it.
DRIVEN = """\
points: {A: {at: [1, 0], mass: 1}, B: {at: [1, -1], mass: 2}}
bars: {rod: {from: A, to: B, length: 1}}
motions: {along: {point: A, x: {table: {MORE}}}}
project_velocities: true
"""
FILE = "t,value\n0,1\n0.5,0.25\n1,1\n"
INSIDE = "times: [0, 0.5, 1], values: [1, 0.25, 1]"


def driven(folder, more, text=FILE):
    (folder / "motion.csv").write_text(text)
    path = folder / "driven.yaml"
    path.write_text(DRIVEN.replace("MORE", more))
    return loading.load(path, "driven", "driven.yaml")


def test_tables_in_files(tmp_path):
    """They are what stands in the mechanism otherwise; of a spring's forces, too."""
    subject = driven(tmp_path, "file: motion.csv, ends: periodic")
    assert subject.content == built(DRIVEN.replace("MORE", f"{INSIDE}, ends: periodic")).content
    assert set(subject.sources) == {"driven.yaml", "motion.csv"}
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


BESIDE = "file: motion.csv, ends: natural"
#: What is wrong in a file, and how that is told.
FILES = {
    "time,value\n0,1\n": "motion.csv, line 1: no column 't'; the first line must be t,value",
    "t,value\n0,1\n1,abc\n": "motion.csv, line 3: value: must be a number, given 'abc'",
    "t,value\n0,1\n1\n": "motion.csv, line 3: value: must be a number, given ''",
    "t,value\n0,1\n1,2\n1,3\n": "motion.csv, line 4: t: must increase: 1 follows 1",
    "t,value\n0,1\n": "table.times: must be 2 at least, given 1",
}


@pytest.mark.parametrize(
    ("more", "text", "told"),
    [
        *((BESIDE, text, told) for text, told in FILES.items()),
        ("file: none.csv", FILE, "file: none.csv: cannot be"),
        (f"{BESIDE}, values: [0, 1]", FILE, "table.values: stands in the file; leave it out"),
        (f"interpolation: pchip, {BESIDE}", FILE, "table.ends: is of splines"),
        ("file: motion.csv, interpolation: linear", FILE, "table.interpolation: must be"),
    ],
)
def test_mistakes_in_tables(tmp_path, more, text, told):
    with pytest.raises(DocumentError) as error:
        driven(tmp_path, more, text)
    assert str(error.value).startswith("driven.yaml, line 3: motions.along.x.table")
    assert told in str(error.value)


def test_nothing_beyond_a_table(cli):
    """A march must end with the table; `validate` and the library say so, and it may repeat."""
    text = DRIVEN.replace("MORE", INSIDE)
    cli.write("cam.yaml", text)
    cli.write(
        "study.yaml",
        "study: s\nproblem: cam.yaml\nform: u-lambda\npreconditioning: optimal\nh: [1e-2]\n"
        "t_end: 1.5\n",
    )
    said = "must be at most 1 s, where a table of cam.yaml ends, given"
    assert f"line 6: t_end: {said} 1.5 s" in cli("validate", "study.yaml", code=2).stderr
    assert f"--at: {said} 2 s" in cli.refused("draw", "cam.yaml", "--at", "2")
    with pytest.raises(ArgumentError, match="t_end: must be at most 1 s, where a table of"):
        newmark.march(built(text), h=1e-2, t_end=1.5)
    ends = newmark.march(built(text), h=1e-2, t_end=1.0, every=0).u[-1]
    assert ends[0] == pytest.approx(1)
    repeated = built(text.replace(INSIDE, f"{INSIDE}, ends: periodic"))
    ends = newmark.march(repeated, h=1e-2, t_end=1.5, every=0).u[-1]
    assert ends[0] == pytest.approx(0.25, abs=1e-9)
