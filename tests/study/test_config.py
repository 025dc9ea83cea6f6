"""Configs: what is accepted, and how each mistake is named."""

import contextlib
from pathlib import Path

import pytest
from conftest import QUICK
from hypothesis import given, settings
from hypothesis import strategies as st

from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.study import config
from newmark_cli.support import documents
from newmark_cli.support.documents import DocumentError
from newmark_cli.support.errors import InputError


def load(tmp_path, text):
    path = tmp_path / "c.yaml"
    path.write_text(text)
    return config.load(path, "c.yaml")


def test_cases_inherit(tmp_path):
    """Keys at the top hold for every case that does not set them."""
    text = """
study: two
form: u-lambda
preconditioning: none
h: [1e-2]
t_end: 1
cases:
  - {problem: pendulum}
  - {problem: andrews, h: 1e-4, steps: 7}
"""
    first, second = load(tmp_path, text).cells()
    assert (first.problem.label, first.h, first.steps) == ("pendulum", 1e-2, 100)
    assert (second.problem.label, second.h, second.steps) == ("andrews", 1e-4, 7)


def test_families_take_a_size(tmp_path):
    """A family stands beside shipped problems, in the CSV's spelling and in its own."""
    text = QUICK.replace("pendulum", "[pendulum, {chain: {links: 7}}, {four-bars: {windows: 2}}]")
    study = load(tmp_path, text)
    labels = list(dict.fromkeys(cell.problem.label for cell in study.cells()))
    assert labels == ["pendulum", "chain(links=7)", "four-bars(windows=2)"]
    given = study.model_dump(mode="json")["cases"][0]["problem"]
    assert given == ["pendulum", {"chain": {"links": 7}}, {"four-bars": {"windows": 2}}]


def test_size_decides_the_solver(tmp_path):
    """`auto` is dense for small problems, static for large ones; dense has its limit."""
    text = QUICK.replace("pendulum", "[{chain: {links: 13}}, {chain: {links: 14}}]")
    assert {c.problem.label: c.solver for c in load(tmp_path, text).cells()} == {
        "chain(links=13)": "dense-lu",
        "chain(links=14)": "static-lu",
    }
    text = QUICK.replace("pendulum", "{chain: {links: 7000}}") + "linear_solver: dense-lu\n"
    with pytest.raises(InputError, match="21000 unknowns, at most 20000"):
        _ = load(tmp_path, text).cells()[0].solver


MISTAKES = [
    ("study: quick\n", "", 1, "study: missing"),
    ("study: quick", "study: a/b", 1, "study: must be a name"),
    ("problem: pendulum", "problem: pendulm", 2, "did you mean 'pendulum'?"),
    ("problem: pendulum", "problem: chain", 2, "needs a size: {chain: {links: N}}"),
    ("problem: pendulum", "problem: {}", 2, "one family with its sizes"),
    ("problem: pendulum", "problem: {chain: {}}", 2, "problem.chain.links: missing"),
    ("problem: pendulum", "problem: {chain: {links: 0}}", 2, "equal to 1, given 0"),
    ("problem: pendulum", "problem: {chain: {links: 2.5}}", 2, "must be a whole number, given 2.5"),
    ("form: u-lambda", "form: u_lambda", 3, "did you mean 'u-lambda'?"),
    ("[none, optimal]", "[none, best]", 4, "preconditioning[2]: unknown preconditioning 'best'"),
    ("[none, optimal]", "[{name: none, left: {D: h}}]", 4, "take another name"),
    ("[none, optimal]", "[{name: x, left: {D: h +}}]", 4, "x: left D: 'h+' is not a product"),
    ("[none, optimal]", "[{name: x, left: {V: h}}]", 4, "form u-lambda has no 'V'"),
    ("[1e-1, 1e-2]", "[1e-1, 0]", 5, "h[2]: must be greater than 0, given 0"),
    ("[1e-1, 1e-2]", "[1e-1, nan]", 5, "finite number, given nan"),
    ("[1e-1, 1e-2]", "['1e-1']", 5, "must be a number without quotes, given '1e-1'"),
    ("[1e-1, 1e-2]", "[]", 5, "h: "),
    ("[1e-1, 1e-2]", "[1e-9]", 5, "more than 20000000 steps"),
    ("t_end: 1.0", "t_end: 0.05", 6, "t_end: shorter than the step h = 0.1, given 0.05"),
    ("t_end: 1.0", "steps: 0", 6, "no correction without steps"),
    ("t_end: 1.0", "steps: 2.5", 6, "steps: must be a whole number"),
    ("t_end: 1.0", "t_end: 1\nsteps: 4", 6, "either t_end or steps, given both"),
    ("t_end: 1.0", "", 1, "either t_end or steps, given neither"),
    ("t_end: 1.0", "t_end: 1\nt_end: 2", 7, "duplicate key 't_end', first given in line 6"),
    ("t_end: 1.0", "t_end: 1\nintegrator: {method: bdf}", 7, "unknown method 'bdf'"),
    ("t_end: 1.0", "t_end: 1\nintegrator: {gamma: 0.3}", 7, "integrator.gamma: gamma = 0.3"),
    ("t_end: 1.0", "t_end: 1\nmeasure: colour", 7, "unknown measure 'colour'"),
    ("t_end: 1.0", "t_end: 1\ncases: []", 7, "cases: must be a list of cases"),
    ("t_end: 1.0", "t_end: 1\ncases: [{}, {}]", 7, "two cases have pendulum, u-lambda, none"),
    ("t_end: 1.0", "t_end: 1\nlinear_solver: [auto, static-lu]", 7, "auto stands for dense-lu, st"),
    ("t_end: 1.0", "t_end: 1\nstop: {}", 7, "needs absolute or relative"),
    ("t_end: 1.0", "t_end: 1\nstop: {absolute: 1e-8}", 7, "ends at a tolerance, not at rounding"),
    ("t_end: 1.0", "t_end: 1\nstop: {test: residul, relative: 1}", 7, "unknown test 'residul'"),
    ("t_end: 1.0", "t_end: 1\nstop: {lambda: {}}", 7, "lambda: needs absolute or relative"),
    ("t_end: 1.0", "t_end: 1\nstop: {test: residual, a: {relative: 1}}", 7, "not with fields"),
    ("t_end: 1.0", "t_end: 1\nstop: {relative: 1, missed: stop}", 7, "it is gone: a march goes"),
    ("t_end: 1.0", "t_end: 1\nstop: {relative: 1, smallest_h: 1}", 7, "it is gone: a march"),
    ("t_end: 1.0", "t_end: 1\nstop: {relative: 1, guess: zero}", 7, "Newton starts each step from"),
    (
        "t_end: 1.0",
        "t_end: 1\nstop: {relative: 1, tangent: full}",
        7,
        "the tangent is the full one",
    ),
    (
        "t_end: 1.0",
        "t_end: 1\nstop: {test: scaled-residual, relative: 1}",
        7,
        "take test: residual",
    ),
    ("t_end: 1.0", "t_end: 1\nmeasure: history", 7, "it is gone: take measure: trajectory and"),
    ("t_end: 1.0", "t_end: 1\nmeasure: drift", 7, "trajectory: {keep: drift}"),
    ("t_end: 1.0", "t_end: 1\nmeasure: tolerance", 7, "tolerance needs 'stop'"),
    *(
        ("t_end: 1.0", f"t_end: 1\nmeasure: trajectory\ntrajectory: {given}", 8, words)
        for given, words in (
            ("{every: 0}", "trajectory.every: must be greater than or equal to 1, given 0"),
            ("{every: 2, at: 0.5}", "trajectory.at: give either every or at, not both"),
            ("{at: [0.5, 1.5]}", "trajectory: 1.5 s is outside the march with h = 0.1, 0 to 1 s"),
            ("{at: [0.5, 0.5]}", "trajectory.at: given twice"),
            ("{keep: [u, w]}", "trajectory.keep[2]: unknown name 'w'; allowed: u, v,"),
            ("{evry: 2}", "trajectory.evry: unknown key; did you mean 'every'?"),
            ("3", "trajectory: must be a mapping"),
        )
    ),
    (
        "t_end: 1.0",
        "t_end: 1\nevaluation: compensated\ncases: [{}, {problem: shaken-pendulum}]",
        7,
        "evaluation: compensated needs",
    ),
    (
        "t_end: 1.0",
        "t_end: 1\nlinear_solver: [dense-lu, auto]",
        7,
        "dense-lu, static-lu or sparse-lu, which is then given twice",
    ),
    (
        "[none, optimal]",
        "[{name: x, left: {D: h*h}}, {name: x, left: {D: h * h}}]",
        4,
        "given twice: x[left D=h^2]",
    ),
    ("[1e-1, 1e-2]", str([0.5 + i / 9000 for i in range(1001)]), 5, "at most 1000 values"),
    (
        "[1e-1, 1e-2]\nt_end: 1.0",
        f"{[0.5 + i / 9000 for i in range(1000)]}\nsteps: 1\ncases: "
        f"{[{'iteration_cap': i + 1, 'samples': i + 1} for i in range(11)]}",
        7,
        "more than 20000 cells",
    ),
    ("pendulum", '"a\\0.yaml"', 2, "a\\x00.yaml: cannot be read: it is not a file name"),
    ("study: quick", 'study: "\\e[2J"', 1, "study: must be a name"),
    ("t_end: 1.0", 't_end: 1\n"\\a\\u2028\\u202e": 2', 7, "\\x07 \\u202e: unknown key"),
    ("t_end: 1.0", "t_end: *end", 6, "not YAML: found undefined alias"),
    ("t_end: 1.0", "t_end: 1\n---\nstudy: two", 7, "expected a single document"),
    ("t_end: 1.0", "t_end: 1\n? [a, b]\n: 2", 7, "a key must be plain text"),
]


@pytest.mark.parametrize(("old", "new", "line", "words"), MISTAKES)
def test_mistakes_are_located(tmp_path, old, new, line, words):
    assert old in QUICK
    with pytest.raises(DocumentError) as caught:
        load(tmp_path, QUICK.replace(old, new))
    text = str(caught.value)
    assert text.startswith(f"c.yaml, line {line}: "), text
    assert words in text, text
    assert text.isprintable()
    assert len(text) < 1000


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"# only a comment\n", "the file is empty"),
        (b"\xff\xfe\x00binary", "not a text file"),
        (b"\x00\x01\x02", "not text"),
        (b"just words", "must be a mapping"),
        (b"[1, 2]", "must be a mapping"),
        (b"a: &x [*x, *x]", "line 1"),
        (b"a: " + b"[" * 5000, "line 1: nested too deeply"),
        (b"- " * 100_000, "line 1: nested too deeply"),
        (b"".join(b"- &a%d [*a%d]\n" % (i + 1, i) for i in range(40)), "found undefined alias"),
        (b"- &a0 x\n" + b"".join(b"- &a%d [*a%d]\n" % (i + 1, i) for i in range(40)), "too deeply"),
        (b"x: " + b"y" * 5_000_000, "larger than"),
    ],
)
def test_files_that_are_no_configs(tmp_path, content, words):
    """Empty, binary, other and hostile files."""
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(DocumentError, match=words):
        config.load(path, "c.yaml")


def test_whole_numbers(tmp_path):
    """1e2 is one, as in JSON Schema; text and truth values are none."""
    (cell, *_) = load(tmp_path, QUICK.replace("t_end: 1.0", "steps: 1e2\nsamples: 3.0")).cells()
    assert (cell.steps, cell.samples) == (100, 3)
    assert type(cell.steps) is type(cell.samples) is int


@pytest.mark.parametrize("family", FAMILIES)
def test_large_members_need_not_be_built(tmp_path, family):
    """What a config must know of them is known at once, and right."""
    names = FAMILIES[family].parameters
    most = 1_000_000 if len(names) == 1 else 1000
    spec = Sized(family, tuple((name, 9) for name in names))
    traits, problem = spec.traits(), spec.load()
    assert (traits.name, traits.n, traits.m) == (problem.name, problem.n, problem.m)
    assert traits.sample.quadratic == problem.quadratic
    assert traits.sample.single == problem.single
    sizes = ", ".join(f"{name}: {most}" for name in names)
    text = QUICK.replace("pendulum", f"{{{family}: {{{sizes}}}}}")
    assert load(tmp_path, text + "evaluation: compensated\n").count == 4
    with pytest.raises(DocumentError, match="float32 needs dense-lu"):
        load(tmp_path, text + "precision: float32\n")


def test_problems_of_one_name(tmp_path):
    """The CSV could not tell them apart: refused before anything is computed."""
    hoist = (Path(__file__).parents[2] / "docs/examples/hoist.yaml").read_text()
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "hoist.yaml").write_text(hoist)
    both = QUICK.replace("pendulum", "[a/hoist.yaml, b/hoist.yaml]")
    with pytest.raises(DocumentError, match=r"line 2: problem: two problems would be 'hoist.yaml'"):
        load(tmp_path, both)
    cases = "cases:\n  - problem: a/hoist.yaml\n  - problem: b/hoist.yaml\n    h: [1e-3]\n"
    with pytest.raises(DocumentError, match=r"line 8: cases\[2\]\.problem: two problems would be"):
        load(tmp_path, QUICK.replace("problem: pendulum\n", "") + cases)


def test_references_count_as_what_they_refer_to():
    """Keys and values, as if they were written out: 20,000 of them, each six, are too many."""
    entries = "".join(f"  k{i}: *a\n" for i in range(20_000))
    with pytest.raises(DocumentError, match="more than 100000 values"):
        documents.parse(f"a: &a {{b: 1, c: 2}}\nd:\n{entries}", "f")


@given(st.floats(1e-300, 1e300))
def test_numbers_read_back(value):
    """Every spelling of a float that Python writes is a number here."""
    for spelled in (repr(value), f"{value:e}", f"{value:.17g}", f"+{value:E}"):
        assert documents.parse(f"x: {spelled}", "f").data["x"] == float(spelled)


@settings(max_examples=settings().max_examples // 5)  # what is nearly right is in test_fuzz
@given(st.text(max_size=200))
def test_any_text_is_parsed_or_refused(text):
    """No text makes the reader fail in another way."""
    with contextlib.suppress(DocumentError):
        assert config.parse(documents.parse(text, "f")).cells()
