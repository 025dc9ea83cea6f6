"""`validate`: every mistake of a file in a line of its own, and nothing that only follows."""

import pytest
from conftest import QUICK
from test_own_problems import EXAMPLES

import newmark_cli as newmark
from newmark_cli.newmark.integrator import INTEGRATORS
from newmark_cli.newmark.integrator_labels import parse
from newmark_cli.study import config, keys, naming
from newmark_cli.support import documents
from newmark_cli.support.documents import DocumentError

HOIST = (EXAMPLES / "hoist.yaml").read_text()
WRONG_HOIST = HOIST
for old, new in (
    ("B: {at: [0.4, 0.3]}", "B: {at: [0.4]}"),
    ("{from: A, to: B", "{from: Z, to: Y"),
    ("to: S, length", "to: S, lenght"),
    ("{point: S", "{point: SS"),
    ("rest_length: 0.9", "rest_length: -1"),
    ("{from: W, to: S, d", "{from: W, to: W, d"),
    ("{on: lever, torque", "{on: levre, torque"),
    ("gravity: [0, -9.81]", "gravity: 0, -9.81"),
):
    assert old in WRONG_HOIST
    WRONG_HOIST = WRONG_HOIST.replace(old, new)
#: What is wrong → the text of a file, and line, key and first words of each complaint about it.
MISTAKES = {
    "keys and values of a config": (
        "studdy: quick\nproblem: [pendulm, nowhere.yaml, pendulum]\nform: bogus\n"
        "preconditioning: [none, optimal, besst]\nh: 1e-2, 1e-3\nt_end: -1\n"
        "measure: [correction, colour]\ntend: 3\n",
        [
            (1, "studdy", "unknown key; did you mean 'study'? allowed: study, "),
            (2, "problem[1]", ""),
            (2, "problem[2]", "nowhere.yaml: cannot be read"),
            (3, "form", ""),
            (4, "preconditioning[3]", ""),
            (5, "h", "write a list in brackets: h: [1e-2, 1e-3]"),
            (6, "t_end", "must be greater than 0, given -1"),
            (7, "measure[2]", ""),
            (8, "tend", ""),
        ],
    ),
    # One at the top is told once, whichever cases inherit it.
    "cases": (
        "study: x\nproblem: pendulum\nform: bogus\nh: [1e-2, 1e-3]\ncases:\n"
        "  - {preconditioning: none, t_end: 1, h: -1}\n"
        "  - {preconditioning: best, t_end: 1}\n"
        "  - {t_end: 1}\n"
        "  - {preconditoning: none, t_end: 1}\n"
        "  - 3\n",
        [
            (3, "form", ""),
            (6, "cases[1].h", ""),
            (7, "cases[2].preconditioning", ""),
            (8, "cases[3].preconditioning", "missing"),
            (9, "cases[4].preconditoning", ""),
            (10, "cases[5]", ""),
        ],
    ),
    "rules between keys": (
        QUICK.replace("t_end: 1.0", "measure: [condition, tolerance]")
        + "cases:\n  - {t_end: 0.05}\n  - {}\n"
        "  - {steps: 4, measure: condition}\n  - {steps: 4, measure: condition}\n",
        [
            (6, "measure", "tolerance needs 'stop'"),
            (7, "cases", "two cases have pendulum, u-lambda, none, h = 0.1, condition"),
            (8, "cases[1].t_end", "shorter than the step h = 0.1, given 0.05"),
            (9, "cases[2].t_end", "needs either t_end or steps, given neither"),
        ],
    ),
    # Also of parts next to wrong ones, and nothing that follows.
    "a mechanism": (
        WRONG_HOIST,
        [
            (11, "points.B.at[2]", ""),
            (15, "bodies.lever.from", ""),
            (15, "bodies.lever.to", ""),
            (21, "bars.link.lenght", ""),
            (24, "sliders.rail.point", ""),
            (27, "springs.counterweight.rest_length", ""),
            (30, "dampers.brake", "joins W with itself"),
            (33, "torques.motor.on", ""),
            (35, "gravity", "write a list in brackets: gravity: [0, -9.81]"),
        ],
    ),
}


def complaints(cli, name, text):
    """(line, key, rest) of each line that `validate` prints about a file with this text."""
    cli.write(name, text)
    done = cli("validate", name, code=2)
    assert done.stdout == ""
    found = []
    for said in done.stderr.splitlines():
        start, colon, rest = said.partition(f"newmark-study: {name}, line ")
        assert (start, colon) == ("", f"newmark-study: {name}, line "), said
        line, key, message = rest.split(": ", 2)
        found.append((int(line), key, message))
    return found


@pytest.mark.parametrize("kind", MISTAKES)
def test_every_mistake_has_its_line(cli, kind):
    text, expected = MISTAKES[kind]
    found = complaints(cli, "c.yaml", text)
    assert [entry[:2] for entry in found] == [entry[:2] for entry in expected]
    for (*_, message), (*_, words) in zip(found, expected, strict=True):
        assert message.startswith(words)


def test_mistakes_in_a_file_that_a_config_names(cli):
    """All of them, at the place that names the file, and once however often it is named."""
    cli.write(
        "bad.yaml", HOIST.replace("to: S, length", "to: T, length").replace("lever, t", "x, t")
    )
    text = QUICK.replace("problem: pendulum\n", "")
    cases = "cases: [{problem: bad.yaml}, {problem: [pendulum, bad.yaml]}]\n"
    first, second = complaints(cli, "c.yaml", text + cases)
    assert first[:2] == second[:2] == (6, "cases[1].problem")
    assert first[2].startswith("bad.yaml, line 21: bars.link.to: unknown point 'T'")
    assert second[2].startswith("bad.yaml, line 33: torques.motor.on: unknown body 'x'")


def test_a_mechanism_is_no_study(cli):
    """Who runs one is told where it belongs; also one that is no file."""
    cli.write("hoist.yaml", HOIST)
    assert cli.refused("run", "hoist.yaml") == (
        "newmark-study: hoist.yaml, line 5: is a mechanism, not a study: a study has it as its "
        "'problem'"
    )
    with pytest.raises(DocumentError, match=r"^study: is a mechanism, not a study: "):
        newmark.run({"points": {"A": {"fixed": [0, 0]}}})
    cli.write("c.yaml", QUICK.replace("pendulum", "c.yaml"))
    told = "problem: c.yaml, line 1: is a study, not a mechanism; give its problem, c.yaml, instead"
    assert told in cli.refused("validate", "c.yaml")


def test_references_to_wrong_parts_are_no_mistakes(cli):
    """What hangs on a wrong point or body is neither unknown, nor massless, nor redundant."""
    for old, new in (("{fixed: [0, 0]}", "{}"), ("{at: [1.3, 0.65], mass: 2}", "{at: [1.3, x]}")):
        assert old in HOIST
        (one,) = complaints(cli, "m.yaml", HOIST.replace(old, new))
        assert one[1] in ("points.A", "points.S.at[2]")
    (one,) = complaints(cli, "m.yaml", HOIST.replace("{from: A, to: B", "{from: P, to: B"))
    assert one[1:] == (
        "bodies.lever.from",
        "P is itself fixed on a body; a body needs two of 'points'",
    )


def test_a_thousand_mistakes_are_counted(cli):
    """Fifty are printed, then the number of the others; at once, for both kinds of file."""
    bars = "".join(f"  b{i}: {{from: A, to: Z{i}, length: 1}}\n" for i in range(1000))
    mechanism = "points: {A: {fixed: [0, 0]}, B: {at: [1, 0], mass: 1}}\nbars:\n" + bars
    study = QUICK.replace("[1e-1, 1e-2]", str([-1 - i for i in range(1000)]))
    for name, text in (("m.yaml", mechanism), ("c.yaml", study)):
        cli.write(name, text)
        with pytest.raises(DocumentError) as caught:
            naming.describe(str(cli.folder / name), False)
        assert (len(caught.value.mistakes), caught.value.more) == (50, 950)
        *lines, last = cli("validate", name, code=2).stderr.splitlines()
        assert len(lines) == len(set(lines)) == documents.MOST_REPORTED == 50
        assert last == f"newmark-study: {name}: … and 950 more"


@pytest.mark.parametrize(("given", "said"), [
        (
            "{method: generalized_alpha, rho_inf: 0.9}",
            ["method: unknown method 'generalized_alpha'; did you mean 'generalized-alpha'?",
             "rho_inf: unknown key; did you mean 'rho'? allowed: method, beta, gamma, rho, alpha, "
             "alpha_m, alpha_f; for example {method: generalized-alpha, rho: 0.9}"],
        ),
        ("generalized-alpha", ["method: generalized-alpha needs rho; for example "]),
        ("hht alpha=x", ["alpha must be a number, given 'hht alpha=x'"]),
        ("hht 0.1", ["unknown parameter '0.1'; for example {method: generalized-alpha, rho: 0.9}"]),
        ("3", ["must be the name of a method, or a mapping such as {method: generalized-alpha, "]),
        (
            "{generalized-alpha: {rho: 0.9}}",
            ["generalized-alpha: unknown key; write {method: generalized-alpha, rho: 0.9}"],
        ),
        (
            "{method: hht, rho: 0.9, beta: 0.3}",
            ["beta: is not a parameter of hht, which has alpha; it belongs to newmark: "
             "{method: newmark, beta: 0.25, gamma: 0.5}",
             "rho: is not a parameter of hht, which has alpha; it belongs to generalized-alpha: "
             "{method: generalized-alpha, rho: 0.9}"],
        ),
    ])  # fmt: skip
def test_integrators_are_spelled_in_the_answer(given, said):
    """Whatever is wrong: what was given, what was meant, and an example that is right."""
    with pytest.raises(DocumentError) as caught:
        config.parse(documents.parse(QUICK + f"integrator: {given}\n", "c.yaml"))
    texts = [mistake.text for mistake in caught.value.mistakes]
    assert len(texts) == len(said)
    for text, words in zip(texts, said, strict=True):
        place, colon, rest = text.partition("integrator")
        assert (place, colon) == ("c.yaml, line 7: ", "integrator")
        assert rest.lstrip(".: ").startswith(words), text


@pytest.mark.parametrize("method", INTEGRATORS)
def test_examples_of_integrators_are_right(method):
    """The spelling that errors offer is one that a config accepts."""
    text = QUICK + f"integrator: {keys.IntegratorConfig.example(method)}\n"
    cell = config.parse(documents.parse(text, "c.yaml")).cells()[0]
    assert cell.integrator.label.split()[0] == method
    assert parse(cell.integrator.label) == cell.integrator
    assert keys.read("integrator", cell.integrator.label, keys.IntegratorConfig) == cell.integrator
