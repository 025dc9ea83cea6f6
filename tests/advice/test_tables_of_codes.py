"""Tables as codes write them: separators, shapes, formulas, and references from a table."""

import gzip

import numpy as np
import pandas as pd
import pytest
from pages import ROOT
from scipy.io import savemat

import newmark_cli as newmark
from newmark_cli.codes.given_references import reference_at
from newmark_cli.codes.reading import read
from newmark_cli.library.judge_options import columns as columns_of
from newmark_cli.library.judging import template
from newmark_cli.problems.multipliers import relative_error
from newmark_cli.problems.reference import solution

THROWN = str(ROOT / "docs/examples/thrown-pendulum.yaml")
HEADER = ("h", "t", "u[P.x]", "u[P.y]", "lambda[bars.rod]")
#: Numbers with 17 digits, which no other double has; not of any motion.
ROWS = [
    ("0.1", "0", "1", "0", "-1.25"),
    ("0.1", "0.1", "0.99500416527802582", "0.0998334166468281", "-1.3000000000000003"),
    ("0.05", "0.1", "-2.5000000000000004e-05", "0.10000000000000002", "1.5e+100"),
]


@pytest.fixture(scope="module")
def thrown():
    return newmark.problem(THROWN)


@pytest.fixture
def reading(thrown, tmp_path):
    """A function that reads a file of lines."""

    def read_lines(written, mapping=None):
        (tmp_path / "mine.txt").write_text("\n".join(written))
        return read(tmp_path / "mine.txt", thrown, mapping)

    return read_lines


def lines(separator=",", header=HEADER, change=lambda text: text):
    return [separator.join(header), *(separator.join(map(change, row)) for row in ROWS)]


def fortran(text):
    """As Fortran writes a double: D, and no letter where the exponent has three digits."""
    return text.replace("e+100", "+100").replace("e", "D") if "e" in text else f"{text}D+00"


def assert_read(runs):
    """The three rows, in runs by descending h, to the last bit."""
    first, second = runs.runs
    assert (first.size, second.size) == (0.1, 0.05)
    np.testing.assert_array_equal(first.t, [0.0, 0.1])
    for place, row in ((0, ROWS[0]), (1, ROWS[1])):
        assert first.state["u"][place].tolist() == [float(row[2]), float(row[3])]
        assert first.state["lambda"][place].tolist() == [float(row[4])]
    assert second.state["u"].tolist() == [[float(ROWS[2][2]), float(ROWS[2][3])]]
    assert second.state["lambda"].tolist() == [[float(ROWS[2][4])]]


def refusal(function, *arguments):
    """The line with which it refuses its arguments."""
    with pytest.raises(newmark.NewmarkError) as caught:
        function(*arguments)
    assert str(caught.value).isprintable()
    return str(caught.value)


WRITTEN = {
    "commas": lines(),
    "blanks after commas": lines(", "),
    "semicolons": lines(";"),
    "decimal commas": [lines(";")[0], *(line.replace(".", ",") for line in lines(";")[1:])],
    "tabs": lines("\t"),
    "blanks": lines("   "),
    "blanks before": [f"  {line}" for line in lines(" ")],
    "comments": ["# a code, 1.0", "#", *lines()[:2], "", "% of MATLAB", *lines()[2:], "  "],
    "commented header": ["# my code", f"# {lines()[0]}", *lines()[1:]],
    "header of blanks over commas": [f"# {lines('  ')[0]}", *lines()[1:]],
    "empty cells of a spreadsheet": [f"{line},," for line in lines()] + [",,,,,,"],
    "Fortran": lines(" ", change=fortran),
    "units": lines(header=("h (s)", "t [s]", "u[P.x] (m)", "u[P.y][m]", "lambda[bars.rod] (N/m)")),
    "units and blanks": lines("  ", ("h (s)", "t [s]", "u[P.x] (m)", "u[P.y] [m]", HEADER[4])),
    "quotation marks": lines(header=[f'"{name}"' for name in HEADER]),
}


@pytest.mark.parametrize("written", WRITTEN.values(), ids=WRITTEN)
def test_text_is_read_however_it_is_laid_out(written, reading):
    assert_read(reading([*written, ""]))


def test_other_encodings_ends_of_lines_and_compression(thrown, tmp_path):
    text = "\r\n".join(lines())
    for name, content in (
        ("bom.csv", text.encode("utf-8-sig")),
        ("shell.csv", text.encode("utf-16")),
        ("mine.csv.gz", gzip.compress(text.encode())),
    ):
        (tmp_path / name).write_bytes(content)
        assert_read(read(tmp_path / name, thrown))


def test_arrays_of_numpy_matlab_and_parquet(thrown, tmp_path):
    """A matrix by numbers of columns; fields or variables by name; matrices of u are numbered."""
    values = np.array([[float(text) for text in row] for row in ROWS])
    frame = pd.DataFrame(values, columns=HEADER)
    by_number = {name: f"#{number}" for number, name in enumerate(HEADER, 1)}
    np.save(tmp_path / "matrix.npy", values)
    assert_read(read(tmp_path / "matrix.npy", thrown, by_number))
    np.save(tmp_path / "named.npy", frame.to_records(index=False))
    assert_read(read(tmp_path / "named.npy", thrown))
    frame.to_parquet(tmp_path / "mine.parquet")
    assert_read(read(tmp_path / "mine.parquet", thrown))
    variables = {"h": values[:, 0], "t": values[:, 1], "u": values[:, 2:4], "lam1": values[:, 4:]}
    lam = {"lambda[bars.rod]": "lam11"}
    savemat(tmp_path / "mine.mat", variables | {"lam1": values[:, 4]})
    assert_read(read(tmp_path / "mine.mat", thrown))
    savemat(tmp_path / "one.mat", {"runs": variables | {"lam11": variables.pop("lam1")[:, 0]}})
    assert_read(read(tmp_path / "one.mat", thrown, lam))
    savemat(tmp_path / "uneven.mat", {"h": values[:2, 0], "t": values[:, 1]})
    said = refusal(read, tmp_path / "uneven.mat", thrown)
    assert said.endswith("uneven.mat: not a table: ValueError: arrays of 2, 3 rows")
    for name in ("matrix.npy", "named.npy", "mine.parquet", "mine.mat", "one.mat"):
        content = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(content[: 2 * len(content) // 3])
        assert f"{name}: " in refusal(read, tmp_path / name, thrown)


@pytest.mark.parametrize("quantity", ["quantity", "name", "variable", "what"])
def test_a_long_table_has_a_row_for_each_number(quantity, reading):
    mapping = {"quantity": "what"} if quantity == "what" else None
    written = [f"h,t,{quantity},value"]
    for h, t, *row in ROWS:
        written += [f"{h},{t},{name},{value}" for name, value in zip(HEADER[2:], row, strict=True)]
    assert_read(reading(written, mapping))
    for last, said in (
        ("0.1,0.1,u[P.x],1", "line 11: a second value of u[P.x]"),
        ("0.1,0.2,u[P.x],big", "value, line 11: not a number, given 'big'"),
        ("0.1,0.2,t,1", "column t is there twice"),
    ):
        assert said in refusal(reading, [*written, last], mapping)
    said = refusal(reading, written, {"quantity": "vlaue"})
    assert said.startswith("columns: quantity: ")
    assert "has no column 'vlaue'; did you mean 'value'?" in said


SENSOR = ["# sensor of P", "# values: time, x, y", "0,1,0", "0.002,0.5,0.25"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("#2", 0.5),
        ("x", 0.5),
        ("2e-3", 0.002),
        ("-2 * x", -1.0),
        ("-x", -0.5),
        ("+x - -x", 1.0),
        ("0.001*x", 0.0005),
        ("2 * `values: time` - 'y'", 0.004 - 0.25),
        ("0.15 * cos(x) + 0.3 * cos(-y) - 1", 0.15 * np.cos(0.5) + 0.3 * np.cos(0.25) - 1),
        ("-(0.15 * sin(x) * y / 4) - -x", 0.5 - 0.15 * np.sin(0.5) * 0.0625),
    ],
)
def test_a_mapping_is_a_number_or_a_formula_of_columns(text, expected, reading):
    (run,) = reading(SENSOR, {"h": 0.002, "t": "#1", "u[P.x]": text}).runs
    assert run.size == 0.002
    assert run.state["u"][-1, 0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    ["__import__('os').getcwd()", "x.real", "x**9", "[x][0]", "x if y else 1", "lambda: x",
     "tan(x)", "cos(x, y)", "x @ y", "f'{x}'", "1e999", "True * x", "x y", "", "#9", "#0", "z",
     "(" * 1500, "cos", "9" * 3000, "x := 1", "cos(x=1)", "1j * x"],
)  # fmt: skip
def test_a_mapping_runs_no_code(text, reading):
    said = refusal(reading, SENSOR, {"h": 0.002, "t": "#1", "u[P.x]": text})
    assert said.startswith("columns: u[P.x]: ")
    assert len(said) < 400


def test_files_of_mappings_have_numbers(tmp_path):
    (tmp_path / "good.yaml").write_text("h: 0.002\nt: '#1'\n'u[P.x]': 2 * x\n")
    assert columns_of(tmp_path / "good.yaml") == {"h": 0.002, "t": "#1", "u[P.x]": "2 * x"}
    (tmp_path / "bad.yaml").write_text("h: 0.002\nt: #1\n")  # a comment of YAML
    assert "bad.yaml, line 2: t: must be a number" in refusal(columns_of, tmp_path / "bad.yaml")


def test_units_are_taken_for_what_they_are(reading):
    runs = reading(lines(header=("h (ms)", "t", "u[P.x] (mm)", "u[P.y] (m)", "force")))
    assert [run.size for run in runs.runs] == pytest.approx([1e-4, 5e-5], rel=1e-15)
    assert runs.runs[0].state["u"][1].tolist() == [1e-3 * float(ROWS[1][2]), float(ROWS[1][3])]
    assert runs.notes == [
        "h (ms): taken for h, times 0.001", "u[P.x] (mm): taken for u[P.x], times 0.001",
        "u[P.y] (m): taken for u[P.y]", "not read: column force",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (lines(header=(*HEADER[:4], "lamda[bars.rod]")), "has no lamda[bars.rod]; did you mean"),
        (lines(header=(*HEADER[:3], "u[Q.y]", "force")), "has no u[Q.y]; did you mean 'u[P.y]'?"),
        (lines(header=(*HEADER[:3], "U[P.y]", "force")), "has no U[P.y]; did you mean 'u[P.y]'?"),
        (lines(header=(*HEADER[:3], "u[P.y]/m", "force")), "has no u[P.y]/m; did you mean"),
        (lines(header=(*HEADER[:4], "lambda_rod")), "has no lambda_rod; did you mean"),
        (lines(header=(*HEADER[:3], "u[P.x] (m)", "force")), "column u[P.x] is there twice"),
        (["# a comment", "", *lines(), "0.1,0.2,big,0,0"], "line 7: not a number, given 'big'"),
        (["# a comment", *lines(), "0.1,0.2,1,0,0,7"], "line 6: 6 columns, and 5 in the first"),
        (["# a comment", *lines(), "-0.1,0.2,1,0,0"], "line 6: h must be positive, given -0.1"),
        (lines()[1:], "has #1, #2, #3, #4, #5; --columns FILE says which are meant, such as"),
        (["# nothing", ""], "not a table: no line"),
        (["\0\1"], "not a table: it is no text"),
    ],
)  # fmt: skip
def test_what_is_meant_for_the_problem_is_never_left_unread(written, said, reading):
    line = refusal(reading, written)
    assert said in line
    assert "mine.txt" in line


def test_a_template_in_space_has_the_reactions_of_the_start():
    problem = newmark.problem("spatial-slider-crank")
    header, row = (line.split(",") for line in template(problem).split("\n"))
    start = newmark.march("spatial-slider-crank", h=1e-3, steps=1).to_frame().iloc[0]
    found = {name: float(value) for name, value in zip(header, row, strict=True)}
    outputs = [name for name in header if name.startswith("output[")]
    assert outputs == [f"output[{name}]" for name in problem.outputs.names]
    size = max(abs(start[name]) for name in outputs)
    for name in outputs:
        assert found[name] == pytest.approx(start[name], abs=1e-12 * size), name


@pytest.fixture(scope="module")
def double():
    """A problem, its solution at a time, and the row of a table that says so."""
    problem = newmark.problem("double-pendulum")
    found = solution(problem, 0.2)
    parts = {"u": (problem.coordinate_names, found.u), "v": (problem.coordinate_names, found.v),
             "lambda": (problem.constraint_names, found.multipliers)}  # fmt: skip
    row = {f"{part}[{name}]": f"{value:.17g}" for part, (names, values) in parts.items()
           for name, value in zip(names, values, strict=True)}  # fmt: skip
    return problem, found, {"t": "0.2", **row}


@pytest.mark.parametrize(
    ("further", "without", "errors"),
    [
        ({"tolerance": "1e-9"}, "", (1e-9, 1e-9, 1e-9)),
        ({"error[u]": "1e-9", "error[v]": "2e-9", "error[lambda]": "3e-9"}, "", (1e-9, 2e-9, 3e-9)),
        ({"error[v]": "2e-9", "tolerance": "1e-8"}, "", (1e-8, 2e-9, 1e-8)),
        ({}, "", (1e-15, 1e-15, 1e-15)),
        ({"tolerance": "1e-9"}, "lambda", (1e-9, 1e-9, None)),
    ],
)
def test_a_reference_is_what_the_table_says(further, without, errors, double, tmp_path):
    problem, known, row = double
    kept = {name: value for name, value in (row | further).items()
            if not (without and name.startswith(without))}  # fmt: skip
    path = tmp_path / "known.csv"
    path.write_text(f"{','.join(kept)}\n{','.join(kept.values())}\n")
    found = reference_at(path, problem)(0.2)
    assert (found.u.tolist(), found.v.tolist()) == (known.u.tolist(), known.v.tolist())
    assert relative_error(found.multipliers, known.multipliers, known.scales) < 1e-11
    np.testing.assert_allclose(found.scales, known.scales, rtol=1e-10)
    assert (found.u_error, found.v_error) == pytest.approx(errors[:2], rel=0.5)
    if errors[2] is not None:
        assert found.multipliers_error == pytest.approx(errors[2], rel=0.5)
    else:  # larger than those of u and v that it follows from, by what the motion makes of it
        assert 1e-9 < found.multipliers_error < 1e-6
    line = refusal(reference_at(path, problem), 0.3)
    assert line.endswith("known.csv: no reference at t = 0.3; has t = 0.2")
    assert reference_at(path, problem)(0.0).u.tolist() == problem.u0.tolist()


def test_bad_references_are_refused_in_a_line(double, tmp_path):
    problem, _, row = double
    path, first = tmp_path / "known.csv", next(name for name in row if name[0] == "v")
    for table, said in (
        ([{k: v for k, v in row.items() if k != first}], f"all of t, u and v: lacks {first}"),
        ([row | {first: ""}], f"line 2: no number for {first}"),
        ([row, row], "a time is there twice"),
        ([row | {one: "1e3" for one in row if one[0] == "u"}], "it is of another problem or unit"),
        ([row | {"tolerance": "-1"}], "line 2: tolerance must be at least 0 and below 1, given -1"),
        ([row | {"error[v]": "nan"}], "line 2: error[v] must be at least 0 and below 1, given nan"),
    ):
        pd.DataFrame(table).to_csv(path, index=False)
        line = refusal(lambda: reference_at(path, problem)(0.2))
        assert said in line
        assert str(path) in line


def test_the_command_takes_the_reference_of_a_table(cli, thrown):
    """Errors are those against the table: 1e-3 with a reference that is as far off."""
    frames = [newmark.march(THROWN, h=h, t_end=0.5, every=0).to_frame().assign(h=h)
              for h in (0.01, 0.005, 0.0025)]  # fmt: skip
    table = pd.concat(frames)
    table[["h", "t", "u[P.x]", "u[P.y]"]].to_csv(cli.folder / "mine.csv", index=False)
    known = solution(thrown, 0.5)
    names = [f"{part}[P.{axis}]" for part in "uv" for axis in "xy"]
    row = [0.5, known.u[0] + 1e-3, known.u[1], *known.v, 1e-3]
    row = pd.DataFrame([row], columns=["t", *names, "tolerance"])
    row.to_csv(cli.folder / "known.csv", index=False)
    judged = newmark.judge(cli.folder / "mine.csv", THROWN, reference=cli.folder / "known.csv")
    (u,) = [slope for slope in judged.slopes if slope.key.quantity == "u"]
    expected = 1e-3 / np.abs(known.u).max()
    assert u.values[-1] == pytest.approx(expected, rel=0.05)
    row.assign(t=0.4).to_csv(cli.folder / "known.csv", index=False)
    said = cli.refused("judge", "mine.csv", "--problem", THROWN, "--reference", "known.csv")
    assert said.endswith("known.csv: no reference at t = 0.5; has t = 0.4")
