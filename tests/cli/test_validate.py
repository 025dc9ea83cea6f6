"""`validate`: every mistake of a file in a line of its own, and nothing that only follows."""

import pytest
from conftest import QUICK
from each import each
from test_own_problems import EXAMPLES

import newmark_cli as newmark
from newmark_cli.newmark.integrator import INTEGRATORS, parse
from newmark_cli.study import config, keys
from newmark_cli.support import documents
from newmark_cli.support.documents import DocumentError

MISTAKEN = """\
studdy: quick
problem: [pendulm, nowhere.yaml, pendulum]
form: bogus
preconditioning: [none, optimal, besst]
h: 1e-2, 1e-3
t_end: -1
measure: [correction, colour]
tend: 3
"""

HOIST = (EXAMPLES / "hoist.yaml").read_text()


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


def test_every_mistake_of_a_config(cli):
    found = complaints(cli, "c.yaml", MISTAKEN)
    assert [(line, key) for line, key, _ in found] == [
        (1, "studdy"), (2, "problem[1]"), (2, "problem[2]"), (3, "form"), (4, "preconditioning[3]"),
        (5, "h"), (6, "t_end"), (7, "measure[2]"), (8, "tend"),
    ]  # fmt: skip
    said = {key: message for _, key, message in found}
    assert said["studdy"].startswith("unknown key; did you mean 'study'? allowed: study, ")
    assert said["problem[2]"].startswith("nowhere.yaml: cannot be read")
    assert said["t_end"] == "must be greater than 0, given -1"
    assert said["h"] == "write a list in brackets: h: [1e-2, 1e-3]"
    line = cli.refused("run", "c.yaml")
    assert line.startswith("newmark-study: c.yaml, line 1: studdy: unknown key")


def test_every_case_is_looked_at(cli):
    """A mistake at the top is reported once, whichever cases inherit it."""
    found = complaints(
        cli,
        "c.yaml",
        "study: x\nproblem: pendulum\nform: bogus\nh: [1e-2, 1e-3]\ncases:\n"
        "  - {preconditioning: none, t_end: 1, h: -1}\n"
        "  - {preconditioning: best, t_end: 1}\n"
        "  - {t_end: 1}\n"
        "  - {preconditoning: none, t_end: 1}\n"
        "  - 3\n",
    )
    assert [(line, key) for line, key, _ in found] == [
        (3, "form"), (6, "cases[1].h"), (7, "cases[2].preconditioning"),
        (8, "cases[3].preconditioning"), (9, "cases[4].preconditoning"), (10, "cases[5]"),
    ]  # fmt: skip
    assert found[3][2] == "missing"


def test_rules_between_keys_are_all_reported(cli):
    found = complaints(
        cli,
        "c.yaml",
        QUICK.replace("t_end: 1.0", "measure: [condition, tolerance]")
        + "cases:\n  - {t_end: 0.05}\n  - {}\n"
        "  - {steps: 4, measure: condition}\n  - {steps: 4, measure: condition}\n",
    )
    assert [(line, key) for line, key, _ in found] == [
        (6, "measure"), (7, "cases"), (8, "cases[1].t_end"), (9, "cases[2].t_end"),
    ]  # fmt: skip
    assert [message for _, _, message in found] == [
        "tolerance needs 'stop'",
        "two cases have pendulum, u-lambda, none, h = 0.1, condition",
        "shorter than the step h = 0.1, given 0.05",
        "needs either t_end or steps, given neither",
    ]


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


def test_every_mistake_of_a_mechanism(cli):
    """Keys, values and references, also of parts next to wrong ones; nothing that follows."""
    text = HOIST
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
        assert old in text
        text = text.replace(old, new)
    found = complaints(cli, "m.yaml", text)
    assert [(line, key) for line, key, _ in found] == [
        (11, "points.B.at[2]"), (15, "bodies.lever.from"), (15, "bodies.lever.to"),
        (21, "bars.link.lenght"), (24, "sliders.rail.point"),
        (27, "springs.counterweight.rest_length"), (30, "dampers.brake"), (33, "torques.motor.on"),
        (35, "gravity"),
    ]  # fmt: skip
    assert found[-1][2] == "write a list in brackets: gravity: [0, -9.81]"
    assert found[6][2] == "joins W with itself"


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


def test_the_start_of_a_mechanism_is_checked_in_all_its_parts(cli):
    """Massless points, lengths and velocities, each by its own line."""
    text = (
        "points:\n  A: {fixed: [0, 0]}\n  B: {at: [1, 0]}\n  C: {at: [2, 0]}\n"
        "  D: {at: [0, 1], mass: 1, velocity: [0, 1]}\n  E: {at: [0, 2], mass: 1}\n"
        "bars:\n  ab: {from: A, to: B, length: LENGTH}\n  bc: {from: B, to: C, length: LENGTH}\n"
        "  ad: {from: A, to: D, length: 1}\n  de: {from: D, to: E, length: 1}\n"
    )
    found = complaints(cli, "m.yaml", text.replace("LENGTH", "1.5"))
    assert [(line, key) for line, key, _ in found] == [(8, "bars.ab"), (9, "bars.bc")]
    assert found[1][2].startswith("B and C start 1 m apart, given length 1.5; correct")
    found = complaints(cli, "m.yaml", text.replace("LENGTH", "1"))
    assert [(line, key) for line, key, _ in found] == [
        (3, "points.B"), (4, "points.C"), (10, "bars.ad"), (11, "bars.de"),
    ]  # fmt: skip
    assert found[0][2] == "B carries no mass of its own; the mass matrix is singular"
    assert found[2][2].startswith("initial velocities violate this constraint by 1 m/s")


def test_a_thousand_mistakes_are_counted(cli):
    """Fifty are printed, then the number of the others; at once, for both kinds of file."""
    bars = "".join(f"  b{i}: {{from: A, to: Z{i}, length: 1}}\n" for i in range(1000))
    mechanism = "points: {A: {fixed: [0, 0]}, B: {at: [1, 0], mass: 1}}\nbars:\n" + bars
    study = QUICK.replace("[1e-1, 1e-2]", str([-1 - i for i in range(1000)]))
    for name, text in (("m.yaml", mechanism), ("c.yaml", study)):
        cli.write(name, text)
        with pytest.raises(DocumentError) as caught:
            config.describe(str(cli.folder / name), False)
        assert (len(caught.value.mistakes), caught.value.more) == (50, 950)
        *lines, last = cli("validate", name, code=2).stderr.splitlines()
        assert len(lines) == len(set(lines)) == documents.MOST_REPORTED == 50
        assert last == f"newmark-study: {name}: … and 950 more"


@each("given, said", [
        (
            "{method: generalized_alpha, rho_inf: 0.9}",
            ["method: unknown method 'generalized_alpha'; did you mean 'generalized-alpha'?",
             "rho_inf: unknown key; did you mean 'rho'? allowed: method, beta, gamma, rho, alpha; "
             "for example {method: generalized-alpha, rho: 0.9}"],
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


@each("method", INTEGRATORS)
def test_examples_of_integrators_are_right(method):
    """The spelling that errors offer is one that a config accepts."""
    text = QUICK + f"integrator: {keys.IntegratorConfig.example(method)}\n"
    cell = config.parse(documents.parse(text, "c.yaml")).cells()[0]
    assert cell.integrator.label.split()[0] == method
    assert parse(cell.integrator.label) == cell.integrator
    assert keys.read("integrator", cell.integrator.label, keys.IntegratorConfig) == cell.integrator
