"""Damaged configs and mechanism files: `validate` stays calm.

pytest tests/test_fuzz.py -n 0 --hypothesis-profile fuzz    # 2,000 inputs; .ci/release: 300
"""

import contextlib
import io
import re
import shutil
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from newmark_cli.cli import main
from newmark_cli.problems import python_problem
from newmark_cli.support.documents import MOST_REPORTED

ROOT = Path(__file__).parents[1]
FILES = [
    file
    for place in ("configs", "newmark_cli/mechanisms/shipped", "docs/examples")
    for file in sorted((ROOT / place).glob("*.yaml"))
]
#: What no shipped file has: scalings of one's own, families, code, references.
EVERYTHING = """\
study: everything
form: [u-lambda, u-v-a-lambda]
preconditioning: [none, {name: mine, left: {D: beta*h^2, C: 1}, right: {u: 2, lambda: 1/(h*h)}}]
h: [1e-1, 1e-2, 1e-3]
t_end: 3
integrator: [{}, {method: hht, alpha: 0.1}, {method: newmark, beta: 0.3025, gamma: 0.6}]
evaluation: [direct, compensated]
cases:
  - problem: [pendulum, hoist.yaml, {chain: {links: 7}}, {python: "trap.py:trap", args: {x: 1}}]
    precision: [float64, float32]
  - {problem: four-bar, form: u-lambda, preconditioning: optimal, linear_solver: gmres,
     evaluation: direct, krylov: {tolerance: 1e-6, limit: 99}, measure: krylov}
  - {problem: andrews, steps: 3, stop: {absolute: 1e-8, relative: 1e-6}, measure: tolerance}
expect:
  - {measure: condition, problem: [pendulum, hoist.yaml], slope: -4, within: 0.1}
  - {measure: krylov_iterations, integrator: {method: hht, alpha: 0.1}, linear_solver: gmres,
     preconditioning: optimal, h: 1e-2, at_most: 99, at_least: 1}
"""
CORPUS = [*(file.read_text() for file in FILES), EVERYTHING]
NUMBERS = (
    0, -1, 0.5, 1e-400, 5e-324, 1e-155, 1e154, 1e308, float("inf"), float("nan"), 20_000_001,
    2**63, 10**400,
)  # fmt: skip
WORDS = (
    "", "none", "pendulum", "missing.yaml", "m.yaml", "/dev/null.yaml", "../x.yaml", "trap.py:trap",
    "a b", "a,b", "日本語", "\u202eevil", "\ufeff", "\u2028", "\x85", "\x07", "\x1b[31m", "a\r\nb",
    "%s", "{0}", "${HOME}", "__class__", "h^-16", "(2^16)^16", "1 if h", "h(1)", "1/0", "x" * 9999,
)  # fmt: skip

CHANGES = (
    "delete", "atom", "list", "nest", "rename", "repeat", "swap", "graft", "alias", "bomb",
)  # fmt: skip
atoms = st.sampled_from([None, True, [], {}, *NUMBERS, *WORDS]) | st.floats() | st.text(max_size=9)


def spots(tree):
    """Every (container, key or index) of a tree; shared containers once."""
    found, stack, seen = [], [tree], set()
    while stack:
        node = stack.pop()
        if not isinstance(node, dict | list) or id(node) in seen:
            continue
        seen.add(id(node))
        keys = list(node if isinstance(node, dict) else range(len(node)))
        found += [(node, key) for key in keys]
        stack += [node[key] for key in keys]
    return found


@st.composite
def damaged_trees(draw):
    """A file of the project with one to four changes to its data."""
    tree = yaml.safe_load(draw(st.sampled_from(CORPUS)))
    for _ in range(draw(st.integers(1, 4))):
        places = spots(tree)
        if not places:
            break
        node, key = draw(st.sampled_from(places))
        other, of_other = draw(st.sampled_from(places))
        value = node[key]
        change = draw(st.sampled_from(CHANGES))
        if change == "delete":
            del node[key]
        elif change == "rename" and isinstance(node, dict):
            node[draw(st.sampled_from([f"{key}x", f"{key}"[1:], *WORDS]))] = node.pop(key)
        elif change == "repeat" and isinstance(node, list):
            node[key:key] = [value] * draw(st.sampled_from([1, 10, 3000]))
        elif change == "swap":
            node[key], other[of_other] = other[of_other], value
        elif change == "graft":
            grafted, at = draw(st.sampled_from(spots(yaml.safe_load(EVERYTHING))))
            node[key] = grafted[at]
        elif change == "alias":  # perhaps of what it stands in
            node[key] = draw(st.sampled_from([tree, other[of_other]]))
        elif change == "bomb":
            for _ in range(draw(st.integers(2, 30))):
                value = [value] * 10
            node[key] = value
        else:
            new = draw(atoms)
            node[key] = {"list": [value, new], "nest": {str(new): value}}.get(change, new)
    return yaml.dump(tree, Dumper=yaml.CSafeDumper, allow_unicode=True).encode()


#: An example here takes as long as ten of another property.
few = settings(max_examples=settings().max_examples // 10)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that commands run in: the files that configs name, and no Python file loads."""
    folder = tmp_path_factory.mktemp("damaged")
    for file in FILES:
        shutil.copy(file, folder)
    (folder / "trap.py").write_text("raise SystemExit('code was run')\n")

    def load(*_):
        raise AssertionError("a Python file was about to be loaded")

    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.setattr(python_problem, "load", load)
        yield folder


def ran(*words):
    """Exit code of a command in this process, and the lines that it prints."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words)
        except SystemExit as ending:
            code = ending.code or 0
    printed, complaints = out.getvalue().splitlines(), err.getvalue().splitlines()
    for line in printed + complaints:
        assert line.isprintable(), repr(line)
        assert len(line) <= 2000
    return code, printed, complaints


@pytest.mark.filterwarnings("ignore::newmark_cli.NewmarkWarning")  # a study that can be run
@few
@given(damaged_trees())
def test_validate(folder, data):
    (folder / "m.yaml").write_bytes(data)
    before = {path.name for path in folder.iterdir()}
    code, printed, complaints = ran("validate", "m.yaml")
    assert code in (0, 2)
    # What there is to know of a spatial mechanism stands below its line, indented.
    assert len([line for line in printed if line[:2] != "  "]) == (code == 0)
    assert bool(complaints) == (code == 2)
    assert len({*complaints}) == len(complaints) <= MOST_REPORTED + 1
    assert all(line.startswith("newmark-study: m.yaml") for line in complaints)
    lines = [int(n) for line in complaints for n in re.findall(r"^\S+ m\.yaml, line (\d+)", line)]
    assert lines == sorted(lines)
    assert before == {path.name for path in folder.iterdir()}
