"""Studies in notebooks: the rows, fits and figures of the command line."""

import pandas as pd
import pytest
from command_line import CommandLine
from conftest import rows_in

import newmark_cli as newmark

STUDY = {
    "study": "swing",
    "problem": "pendulum",
    "form": ["u-lambda", "v-lambda"],
    "preconditioning": ["none", "optimal"],
    "h": [1e-2, 1e-3, 1e-4],
    "t_end": 0.5,
}
YAML = """\
study: swing
problem: pendulum
form: [u-lambda, v-lambda]
preconditioning: [none, optimal]
h: [1e-2, 1e-3, 1e-4]
t_end: 0.5
"""


@pytest.fixture(scope="module")
def frame():
    """The study's rows, from a dict."""
    return newmark.run(STUDY)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Where the command line has run it."""
    cli = CommandLine(tmp_path_factory.mktemp("swing"))
    cli.write("swing.yaml", YAML)
    cli("run", "swing.yaml")
    return cli


def test_a_dict_a_file_and_the_command_line_agree(ran, frame):
    """Identical rows, whoever runs the study; what is kept in a folder is the CSV of `run`."""
    cli, path = ran, ran.folder / "swing.yaml"
    ours = cli.folder / "ours"
    pd.testing.assert_frame_equal(newmark.run(path, results=ours), frame)
    written = (cli.folder / "results/swing.csv").read_bytes()
    assert (ours / "swing.csv").read_bytes() == written
    read = pd.read_csv(cli.folder / "results/swing.csv", keep_default_na=False)
    for column in ("h", "rms", "max", "last", "zeros"):
        assert pd.to_numeric(read[column]).tolist() == frame[column].tolist()
    assert read["quantity"].tolist() == frame["quantity"].tolist()


def test_fits_are_those_of_check(ran, frame):
    """Slopes, expected orders and verdicts of the command line, to the last digit."""
    ran("plot")
    expected = rows_in(ran.folder / "results/slopes.csv")
    found = newmark.slopes(frame)
    assert list(found.columns) == list(expected[0])
    for column in ("form", "preconditioning", "quantity", "measure", "verdict"):
        assert found[column].tolist() == [row[column] for row in expected]
    assert [repr(float(s)) for s in found["slope"]] == [row["slope"] for row in expected]


#: A parallelogram that passes a singular position, where all links lie in one line, at 0.714 s.
PARALLELOGRAM = {
    "points": {
        "A": {"fixed": [0, 0]}, "B": {"fixed": [1, 0]},
        "C": {"at": [0, 1], "velocity": [1, 0], "mass": 1},
        "D": {"at": [1, 1], "velocity": [1, 0], "mass": 1},
    },
    "bars": {
        "a": {"from": "A", "to": "C", "length": 1}, "b": {"from": "B", "to": "D", "length": 1},
        "c": {"from": "C", "to": "D", "length": 1},
    },
    "gravity": [0, -9.81],
}  # fmt: skip


def test_frames_of_studies_keep_what_their_records_say(frame):
    """Slopes of studies that stand in one frame are those of each, with every reason."""
    passing = newmark.run(
        {**STUDY, "study": "passing", "problem": PARALLELOGRAM, "form": "u-lambda",
         "measure": ["correction", "error"], "h": [1e-2, 3e-3, 1e-3, 3e-4], "t_end": 1.5}
    )  # fmt: skip
    alone = newmark.slopes(passing)
    named = alone[alone["reason"].str.contains("singular position near t = ")]
    assert set(named["verdict"]) == {"undecided"}
    assert not alone["reason"].str.contains("smaller h would decide").any()
    for both in (pd.concat([passing, frame]), pd.concat([frame, passing])):
        found = newmark.slopes(both)
        pd.testing.assert_frame_equal(
            found[found["study"] == "passing"].reset_index(drop=True), alone
        )


def test_part_of_a_frame(frame):
    """Rows that are left out are not missed, and several studies may stand in one frame."""
    part = frame[frame["form"] == "u-lambda"]
    assert set(newmark.slopes(part)["form"]) == {"u-lambda"}
    both = pd.concat([frame, frame.assign(study="again")])
    found = newmark.slopes(both)
    assert found.groupby("study").size().tolist() == [len(found) // 2] * 2
    assert set(found["verdict"]) == {"pass"}


def test_figures_draw_the_rows(frame):
    """The points of a figure are the values of the frame; the axes say what they are."""
    figure = newmark.plot(frame, measure="condition", form="u-lambda")
    (axes,) = figure.axes
    rows = frame[(frame["measure"] == "condition") & (frame["form"] == "u-lambda")]
    drawn = {
        tuple(map(float, point))
        for line in axes.lines
        if line.get_marker() not in ("", "None", None)
        for point in line.get_xydata()
    }
    assert set(zip(rows["h"], rows["median"], strict=True)) <= drawn
    assert axes.get_xscale() == axes.get_yscale() == "log"
    second = newmark.plot(frame, 1, size=(5, 4))
    assert second.get_size_inches().tolist() == [5, 4]
    for size in (5, (5, None), [5, None]):
        assert newmark.plot(frame, 1, size=size).get_size_inches()[0] == 5
    assert newmark.plot(frame, code="newmark-study", form="u-lambda", scaling="none").axes


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda frame: newmark.run(3), "a study must be a file, a name or a dict, given 3"),
        (lambda frame: newmark.run("nope"), "nope: no such file and no shipped study"),
        (lambda frame: newmark.run({"study": "a", "form": "u"}), "study: "),
        (lambda frame: newmark.run(STUDY | {"h": -1}), "study: h"),
        (lambda frame: newmark.run(STUDY, jobs=0), "jobs must be at least 1, given 0"),
        (lambda frame: newmark.run(STUDY, results=1), "results must be a folder, given 1"),
        (lambda frame: newmark.slopes([1]), "frame must be a DataFrame"),
        (lambda frame: newmark.slopes(frame.drop(columns="h")), "but lacks h"),
        (lambda frame: newmark.slopes(frame[:0]), "but is empty"),
        (lambda frame: newmark.slopes(frame.assign(h="x")), "frame/swing.csv, line 2: h: not"),
        (lambda frame: newmark.slopes(frame.assign(study="../x")), "study is '../x'"),
        (lambda frame: newmark.plot(frame, 99), "figure must be below 14, given 99"),
        (lambda frame: newmark.plot(frame, "mine"), "unknown figure 'mine'"),
        (lambda frame: newmark.plot(frame, measure="x"), "measure: unknown measure 'x'"),
        (lambda frame: newmark.plot(frame, colour="red"), "unknown argument 'colour'"),
        (
            lambda frame: newmark.plot(frame, code="mine"),
            "code: no series of 'mine' in the results",
        ),
        (lambda frame: newmark.plot(frame, size="3.3x2"), "from 1 to 40 inches, given '3.3x2'"),
        (lambda frame: newmark.plot(frame, size=(3, 99)), "from 1 to 40 inches, given (3, 99)"),
        (lambda frame: newmark.plot(frame, size=float("nan")), "from 1 to 40 inches, given nan"),
    ],
)
def test_mistakes(frame, call, words):
    with pytest.raises(newmark.NewmarkError, match=r"(?s).*") as caught:
        call(frame)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "/tmp" not in str(caught.value)


def test_a_driven_crank_has_no_order_of_u_but_one_of_v_and_the_torque():
    """Positions follow from Φ(u, t) = 0 alone; accelerations, and λ, come from the integrator."""
    crank = {
        "points": {"O": {"fixed": (0, 0)}, "A": {"at": (0.3, 0), "mass": 1}},
        "bodies": {"crank": {"from": "O", "to": "A", "length": 0.3, "mass": 0, "inertia": 0}},
        "motions": {
            "drive": {"body": "crank", "angle": {"rate": 1, "amplitude": 1, "frequency": 2}}
        },
        "project_velocities": True,
        "gravity": (0, -9.81),
    }
    frame = newmark.run(
        {
            "study": "driven", "problem": crank, "form": "u-lambda", "measure": "error",
            "preconditioning": "optimal",
            "integrator": "generalized-alpha rho=0.5", "h": [1e-2, 5e-3, 2e-3, 1e-3], "t_end": 0.5,
        }
    )  # fmt: skip
    found = {slope.quantity: slope.verdict for slope in newmark.slopes(frame).itertuples()}
    assert found == {"u": "shown", "v": "pass", "lambda": "pass"}
