"""JSON Schemas: as committed, found by editors, and of one mind with `validate`."""

import functools
import importlib.util
import itertools
import json
import random
import re
from collections import Counter
from pathlib import Path

import pytest
import yaml
from conftest import QUICK
from each import each
from jsonschema import Draft7Validator, Draft202012Validator
from test_config import MISTAKES as CONFIG_MISTAKES
from test_problems import BODY
from test_problems import MISTAKES as MECHANISM_MISTAKES

from newmark_cli import documents
from newmark_cli.documents import DocumentError
from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.integrator import INTEGRATORS
from newmark_cli.study import config, keys, schema

ROOT = Path(__file__).parents[1]
MECHANISMS = ROOT / "newmark_cli/mechanisms/shipped"
COMMITTED = {
    ROOT / "configs/schema/config.json": ("schema", "config"),
    MECHANISMS / "schema/mechanism.json": ("schema", "mechanism"),
    MECHANISMS / "schema/spatial.json": ("schema", "spatial"),
    ROOT / "newmark_cli/cli/names.json": ("list", "--json"),
}
FILES = sorted(
    file
    for place in ("configs", "docs/examples", MECHANISMS)
    for file in (ROOT / place).glob("*.yaml")
)
VALIDATORS = {kind: Draft202012Validator(make()) for kind, make in schema.SCHEMAS.items()}

EXAMPLE = (ROOT / "docs/examples/hoist.yaml").read_text()
DRIVEN = """\
points: {A: {fixed: [0, 0]}, B: {at: [1, 0], mass: 1}}
motions: {m: {point: B, x: {rate: 1}}}
project_velocities: true
"""
HUNDREDS = [0.5 + i / 2000 for i in range(900)]
MANY = [{"beta": 0.3 + i / 100} for i in range(12)]
#: What `validate` refuses and no JSON Schema can: words of its complaint, why, examples.
BEYOND = [
    (
        "which runs only with --allow-code",
        "whether code may run is said on the command line",
        [(QUICK, "pendulum", '{python: "a.py:f"}')],
    ),
    (
        r"cannot be read|is not a file name|driven\.yaml, line|hoist\.yaml, line",
        "what a config names is in other files",
        [(QUICK, "pendulum", "nowhere.yaml"), (QUICK, "pendulum", "broken/driven.yaml")],
    ),
    (
        "shorter than the step|more than 20000000 steps|a whole number of steps",
        "two numbers are compared",
        [
            (QUICK, "t_end: 1.0", "t_end: 0.05"),
            (QUICK, "1e-2]", "1e-9]"),
            (QUICK, "1e-2]", "0.3]\nmeasure: error"),
        ],
    ),
    (
        "is outside the march|numbers to keep",
        "how far a march comes, and how many numbers it passes",
        [
            (QUICK, "1.0", "1.0\nmeasure: trajectory\ntrajectory: {at: [0.5, 1.5]}"),
            (QUICK, "1e-2]\nt_end: 1.0", "1e-6]\nt_end: 1.0\nmeasure: trajectory"),
        ],
    ),
    (
        "must not exceed at_most",
        "so are two levels",
        [
            (
                QUICK, "t_end: 1.0",
                "t_end: 1\nexpect: [{measure: condition, at_least: 9, at_most: 3}]",
            ),
        ],
    ),
    (
        "finite number",
        ".nan and .inf are no numbers of JSON",
        [(QUICK, "1.0", ".inf"), (EXAMPLE, "mass: 2", "mass: .nan")],
    ),
    (
        "is not among the study's|no series of the study has|already tells the series|"
        "the name of another figure",
        "what figures and expectations name is compared with the cases, and with other figures",
        [
            (QUICK, "t_end: 1.0", "t_end: 1\nexpect: [{measure: error, slope: 2}]"),
            (QUICK, "t_end: 1.0", "t_end: 1\nexpect: [{measure: condition, h: 0.2, at_most: 9}]"),
            (
                QUICK, "t_end: 1.0",
                "t_end: 1\nexpect: [{measure: condition, integrator: bdf1, slope: 0}]",
            ),
            (
                QUICK, "h: [1e-1, 1e-2]",
                "cases: [{h: 0.1}, {h: 0.01, form: v-lambda}]\n"
                "expect: [{measure: condition, form: v-lambda, h: 0.1, at_most: 9}]",
            ),
            (QUICK, "t_end: 1.0", "t_end: 1\nfigures: [{measure: error}]"),
            (QUICK, "t_end: 1.0", "t_end: 1\nfigures: [{measure: condition, form: v-lambda}]"),
            (
                QUICK, "t_end: 1.0",
                "t_end: 1\nfigures: [{measure: condition, series: form, panels: form}]",
            ),
            (
                QUICK, "t_end: 1.0",
                "t_end: 1\n"
                "figures: [{measure: condition, name: a}, {measure: correction, name: a}]",
            ),
        ],
    ),
    (
        "two cases have|more than 20000 cells",
        "grids are compared and multiplied",
        [
            (QUICK, "h: [1e-1, 1e-2]", "cases: [{h: [0.1, 0.2]}, {h: 0.2}]"),
            (QUICK, "[1e-1, 1e-2]", f"{HUNDREDS}\nintegrator: {MANY}"),
        ],
    ),
    (
        "given twice",
        "with defaults filled in, or without blanks, they are the same",
        [
            (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: [{}, {method: newmark}]"),
            (QUICK, "[none, optimal]", "[{name: x, left: {D: h*h}}, {name: x, left: {D: h * h}}]"),
        ],
    ),
    (
        "is not a product|is not positive",
        "a factor is more than a pattern tells",
        [
            (QUICK, "[none, optimal]", "{name: x, left: {D: (h}}"),
            (QUICK, "[none, optimal]", "{name: x, left: {D: 1e-300^2}}"),
        ],
    ),
    (
        "float32 needs|at most 20000 are allowed",
        "sizes are computed",
        [
            (QUICK, "pendulum", "{chain: {links: 500}}\nprecision: float32"),
            (QUICK, "pendulum", "{chain: {links: 7000}}\nprecision: float32\n"
             "linear_solver: dense-lu"),
        ],
    ),
    (
        "compensated needs|is not symmetric|too large or too small",
        "so are constraints and matrices",
        [
            (QUICK, "pendulum", "driven.yaml\nevaluation: compensated"),
            (QUICK, "u-lambda", "v-lambda\nlinear_solver: minres"),
            (QUICK, "[1e-1, 1e-2]\nt_end: 1.0", "1e200\nsteps: 1\nlinear_solver: minres"),
        ],
    ),
    (
        "unknown (point|body|slider)|itself fixed on a body",
        "names are defined in the file",
        [
            (EXAMPLE, "to: S, length", "to: T, length"),
            (EXAMPLE, "motor: {on: lever", "motor: {on: levre"),
            (EXAMPLE, "{from: A, to: B", "{from: P, to: B"),
        ],
    ),
    (
        "with itself|cannot move relative|is fixed|must name a point that moves|another body than",
        "and mean fixed points or moving ones",
        [
            (EXAMPLE, "to: S, length", "to: P, length"),
            (EXAMPLE, "from: W, to: S, d", "from: W, to: A, d"),
            (EXAMPLE, "{point: S", "{point: A"),
        ],
    ),
    (
        "m apart|off the line|law starts|initial velocities|no position|radius asks|rad to",
        "the start is computed",
        [
            (EXAMPLE, "assemble: true", ""),
            (EXAMPLE, "length: 1.05", "length: 105"),
            (DRIVEN, "project_velocities: true", ""),
            (DRIVEN, "rate: 1", "rate: 1, value: 3"),
        ],
    ),
    (
        "must be one for each of|must increase|must (begin|end) (at|after) 0|end as they begin|"
        "must be different bodies|less than that of the circle|where a table of",
        "numbers and names are compared",
        [
            (DRIVEN, "rate: 1", "table: {times: [0, 1], values: [0, 1, 2]}"),
            (DRIVEN, "rate: 1", "table: {times: [0, 1, 1], values: [0, 1, 2]}"),
            (DRIVEN, "rate: 1", "table: {times: [1, 2], values: [0, 1]}"),
            (DRIVEN, "rate: 1", "table: {times: [-2, -1], values: [0, 1]}"),
            (DRIVEN, "rate: 1", "table: {times: [0, 1], values: [0, 1], ends: periodic}"),
            (EXAMPLE, "gravity", "gears: {g: {from: lever, to: lever, ratio: 2}}\ngravity"),
            (EXAMPLE, "gravity", "rolling: {r: {wheel: lever, radius: 2, circle: {centre: W, "
             "radius: 1, inside: true}}}\ngravity"),
        ],
    ),
    (
        "carries no mass|redundant|does not constrain",
        "so are M and G",
        [
            (DRIVEN, ", mass: 1", ""),
            (DRIVEN, "rate: 1}}", "rate: 1}}, n: {point: B, x: {rate: 1}}"),
        ],
    ),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that configs name."""
    folder = tmp_path_factory.mktemp("schema")
    (folder / "broken").mkdir()
    (folder / "hoist.yaml").write_text(EXAMPLE)
    for file in (ROOT / "docs/examples").glob("*.yaml"):
        (folder / file.name).write_text(file.read_text())
    (folder / "driven.yaml").write_text(DRIVEN)
    (folder / "broken/driven.yaml").write_text(DRIVEN.replace("rate", "rtae"))
    return folder


def judged(text, folder):
    """Complaints of `validate` and of the schema; None when it is no YAML."""
    try:
        document = documents.parse(text, "f.yaml")
    except DocumentError:
        return None
    is_mechanism = isinstance(document.data, dict) and not {"points", "bodies"}.isdisjoint(
        document.data
    )
    kind = "spatial" if loading.is_spatial(document.data) else "mechanism"
    validator = VALIDATORS[kind if is_mechanism else "config"]
    objection = next((error.message for error in validator.iter_errors(document.data)), "")
    try:
        if is_mechanism:
            loading.built("f", document)
        else:
            config.parse(document, keys.Surroundings(folder))
    except DocumentError as error:
        return str(error), objection
    return "", objection


def assert_agreement(text, folder):
    """Schema and `validate` both accept or both refuse, or the reason stands in BEYOND."""
    said, objection = judged(text, folder) or ("", "")
    if not said:
        assert not objection, f"{text}\nvalid, but the schema says: {objection}"
    elif not objection:
        assert any(re.search(words, said) for words, _, _ in BEYOND), f"{text}\nallowed: {said}"
    return said


@each("file", COMMITTED)
def test_committed_files_are_what_the_commands_print(cli, file):
    """After a change: newmark-study schema, schema mechanism, list --json (CONTRIBUTING)."""
    assert file.read_text() == cli(*COMMITTED[file]).stdout


@each("kind", schema.SCHEMAS)
def test_schemas_are_schemas(kind):
    """By the metaschemas of both drafts, with a description for every key."""
    written = json.loads(schema.text(kind))
    assert written["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    for draft in (Draft202012Validator, Draft7Validator):
        draft.check_schema(written)
    for definition in (written, *written["$defs"].values()):
        for key, value in definition.get("properties", {}).items():
            if "additionalProperties" in definition:
                assert "description" in value or "$ref" in value or key == "method", key


def test_names_come_from_the_registries():
    """Forms, integrators, problems and families are offered by name."""
    definitions = schema.config_schema()["$defs"]
    assert definitions["form"]["enum"] == list(FORMS)
    assert definitions["IntegratorConfig"]["properties"]["method"]["enum"] == list(INTEGRATORS)
    shipped, _, *mappings, code = definitions["problem"]["anyOf"]
    assert shipped["enum"] == list(PROBLEMS)
    assert [name for mapping in mappings for name in mapping["properties"]] == list(FAMILIES)
    assert code["required"] == ["python"]


@functools.cache
def committed(file):
    """A validator by a committed schema."""
    return Draft202012Validator(json.loads(file.read_text()))


@each("file", FILES)
def test_editors_find_the_schema_and_it_fits(file, folder):
    """The first line of every shipped file names the schema of its kind by a path."""
    text = file.read_text()
    named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", text)
    target = (file.parent / named[1]).resolve()
    assert target in COMMITTED
    # As an editor reads it, not with the project's reader.
    data = yaml.load(text, Loader=_Yaml12)
    kind = "spatial" if loading.is_spatial(data) else "mechanism" if "points" in data else "config"
    assert target.stem == kind
    committed(target).validate(data)
    if file.parent.name == "examples":  # others are loaded by tests of their own
        assert not assert_agreement(text, folder)


class _Yaml12(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """Numbers of the core schema of YAML 1.2: 1e-4 is one."""

    yaml_implicit_resolvers = {
        first: [pair for pair in pairs if not pair[0].endswith((":float", ":int", ":bool"))]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


_Yaml12.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"(true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)
_Yaml12.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$"),
    list("-+.0123456789"),
)


@each(("old", "new"), [mistake[:2] for mistake in CONFIG_MISTAKES])
def test_mistakes_in_configs(folder, old, new):
    """Each that the reader of configs is tested with."""
    assert_agreement(QUICK.replace(old, new), folder)


@each(("old", "new"), [mistake[:2] for mistake in MECHANISM_MISTAKES])
def test_mistakes_in_mechanisms(folder, old, new):
    """Each that the reader of mechanisms is tested with."""
    assert_agreement(BODY.replace(old, new), folder)


@each(
    ("words", "text", "old", "new"),
    [(words, *example) for words, _, examples in BEYOND for example in examples],
)
def test_what_no_schema_can_say(folder, words, text, old, new):
    """Each reason is one: `validate` refuses its examples with these words, the schema not."""
    assert old in text
    said, objection = judged(text.replace(old, new), folder)
    assert re.search(words, said), said
    assert not objection


@each(
    ("text", "old", "new"),
    [
        (QUICK, "problem: pendulum", "problem: hoist.yaml"),
        (QUICK, "problem: pendulum", "problem: {python: hoist.yaml}"),
        (QUICK, "problem: pendulum", 'problem: {python: "a.py:f", args: [1]}'),
        (QUICK, "problem: pendulum", 'problem: {python: "a.py:f", args: {a: []}}'),
        (QUICK, "problem: pendulum", 'problem: {python: "a.py:f g"}'),
        (QUICK, "problem: pendulum", "problem: {chain: {links: 1e3}}"),
        (QUICK, "problem: pendulum", "problem: {chain: {links: 3}, four-bars: {windows: 3}}"),
        (QUICK, "t_end: 1.0", "steps: 1e2"),
        (QUICK, "t_end: 1.0", "t_end: 1\nsteps: ~"),
        (QUICK, "t_end: 1.0", "t_end: 1\nstop: {}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nstop: ~"),
        (QUICK, "t_end: 1.0", "t_end: 1\nkrylov: {tolerance: 1}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nlinear_solver: [auto, gmres]"),
        (QUICK, "t_end: 1.0", "t_end: 1\nlinear_solver: [auto, sparse-lu]"),
        *(
            (QUICK, "t_end: 1.0", f"t_end: 1\nmeasure: trajectory\ntrajectory: {given}")
            for given in (
                "{every: 3, at: 0.5}", "{every: 3, at: ~}", "{every: 0}", "{at: []}", "{at: 0.5}",
                "{at: [0.5, 0.5]}", "{keep: w}", "{keep: [u, energy]}", "{}", "3",
            )
        ),
        (QUICK, "t_end: 1.0", "t_end: 1\ntrajectory: {every: 3}"),
        (QUICK, "t_end: 1.0", "t_end: 1\naccept: ok"),
        *(
            (QUICK, "t_end: 1.0", f"t_end: 1\nexpect: {given}")
            for given in (
                "~", "[]", "3", "[3]", "[{}]", "[{measure: condition}]", "[{slope: 1}]",
                "[{measure: condition, slope: ~}]", "[{measure: condition, slope: two}]",
                "[{measure: condition, slope: 1, within: 0}]", "[{measure: bogus, slope: 1}]",
                "[{measure: condition, at_most: 0}]", "[{measure: condition, at_most: -1}]",
                "[{measure: condition, at_least: 0}]",
                "[{measure: condition, at_least: 1, h: 0.1}]",
                "[{measure: condition, within: 1, at_most: 3}]",
                "[{measure: condition, slope: 1, h: 0.1}]",
                "[{measure: condition, slope: 1, quantity: u}]",
                "[{measure: condition, slope: 1, quantity: [jacobian]}]",
                "[{measure: condition, slope: 1, form: [u-lambda, v-lamda]}]",
                "[{measure: condition, slope: 1, integrator: {method: hht}}]",
                "[{measure: condition, slope: 1, integrator: {}, stop: saturation}]",
                "[{measure: condition, slope: 1, integrator: newmark beta=0.25 gamma=0.5}]",
                "[{measure: condition, slope: 1, preconditioning: [none, optimal]}]",
                "[{measure: condition, slope: 1, preconditioning: {name: none}}]",
                "[{measure: condition, slope: 1, stop: {}}]",
                "[{measure: condition, slope: 1, linear_solver: auto}]",
                "[{measure: condition, slope: 1, row_block: D}]",
                "[{measure: condition, slope: 1, bogus: D}]",
                "[{measure: drift, slope: 1}]",
                "[{measure: condition, slope: 1, problem: ~, h: ~, within: ~}]",
            )
        ),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht, alpha: 0.5}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht, alpha: 0.1, rho: 1}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht, alpha: 0.1, rho: ~}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: [{}, {method: newmark}]"),
        (QUICK, "study: quick", "study: slopes"),
        (QUICK, "study: quick", "study: 3"),
        (QUICK, "study: quick", "study: quick\ndescription: 3"),
        (QUICK, "u-lambda", "[u-lambda]\ncases: [{form: v-lambda}]"),
        (QUICK, "u-lambda", "bogus\ncases: [{form: v-lambda}]"),
        *(
            (QUICK, "[none, optimal]", f"{{name: x, left: {{D: {factor}}}}}")
            for factor in (
                "1/h", "h**2", "'2'", "2", "1.5e-3*h", "(beta*h)/(2*gamma)", "h^-2", "h^(2)", "0*h",
                "h^16", "h^-17",
                "h^016", "h^(-(2))", "h^2.", "(h)^2", "2^3*h", "(h*beta)^2/gamma",
                "'h h'", "h^h", "h+1", "-h", "2h", "'1/0'", "0.0", "1e-3", "'0.01'", "true", "~",
                "[h]",
            )
        ),
        (EXAMPLE, "length: 0.5,", "length: '0.5',"),
        (EXAMPLE, "length: 0.5,", "length: true,"),
        (EXAMPLE, "length: 0.5,", "length: 1e31,"),
        (EXAMPLE, "length: 0.5,", "length: 1e-31,"),
        (EXAMPLE, "mass: 1.2", "mass: 1e99"),
        (EXAMPLE, "gravity: [0, -9.81]", "gravity: [0, -9.81, 0]"),
        (EXAMPLE, "gravity: [0, -9.81]", "gravity: -9.81"),
        (EXAMPLE, "direction: [2, 1]", "direction: [0, 0.0]"),
        (EXAMPLE, "assemble: true", "assemble: yes"),
        (EXAMPLE, "assemble: true", "assemble: 1"),
        (EXAMPLE, "A: {fixed: [0, 0]}", "A: {fixed: [0, 0], at: [0, 0]}"),
        (EXAMPLE, "A: {fixed: [0, 0]}", "A: {fixed: [0, 0], at: ~}"),
        (EXAMPLE, "assemble: true", "assemble: true\nmotions: {m: {point: S}}"),
        (EXAMPLE, "assemble: true", "assemble: true\nmotions: {m: {point: S, angle: {}}}"),
        (EXAMPLE, "assemble: true", "assemble: true\nmotions: {m: {body: lever, x: {}}}"),
        (EXAMPLE, "assemble: true", "assemble: true\nmotions: {m: {body: lever, angle: {}}}"),
        ("points: {A: {at: [0, 0], mass: 1}}", "", ""),
        ("points: {A: {fixed: [0, 0]}}\nbars: {b: {from: A, to: A, length: 1}}", "", ""),
        ("points: {}\nbars: {}", "", ""),
        ("points: 3", "", ""),
    ],
)  # fmt: skip
def test_more_mistakes(folder, text, old, new):
    """And what is unusual but right."""
    assert old in text
    assert_agreement(text.replace(old, new), folder)


#: Values that are right on their own, in the combinations that `Case` has rules for.
VALUES = {
    "measure": [
        "correction",
        "condition",
        "[sensitivity, condition]",
        "[tolerance]",
        "krylov",
        "trajectory",
        "[condition, trajectory]",
    ],
    "trajectory": ["{every: 3}", "{keep: [u, energy]}", "~"],
    "stop": ["{absolute: 1e-6}", "~"],
    "precision": ["float32", "[float64, float32]", "float64"],
    "linear_solver": ["gmres", "[dense-lu, sparse-lu]", "auto", "[gmres, auto]"],
    "form": ["u-lambda", "[u-v-a-lambda, v-lambda]", "v-a-lambda"],
    "preconditioning": ["{name: x, left: {V: h}}", "[none, {name: y, right: {u: h}}]", "left"],
    "t_end": ["4", "~"],
    "steps": ["0", "3", "~"],
}
NEEDED = {"form": "u-lambda", "preconditioning": "none"}


def test_rules_between_keys(folder):
    """Configs whose keys stand at the top or in cases: never a disagreement."""
    chance = random.Random(4)
    verdicts = Counter()
    for _ in range(480):
        sizes = itertools.count(1)

        def some(likely, sizes=sizes):
            keys = [key for key in VALUES if chance.random() < likely]
            given = {key: chance.choice(VALUES[key]) for key in keys}
            return {"h": f"0.0{next(sizes)}", **given}

        top = {"study": "s", "problem": "pendulum", **some(0.4)}
        for key, value in NEEDED.items():
            if chance.random() < 0.8:
                top.setdefault(key, value)
        if "steps" not in top and chance.random() < 0.9:
            top.setdefault("t_end", "1")
        lines = [f"{key}: {value}" for key, value in top.items()]
        if chance.random() < 0.7:
            cases = [some(chance.choice((0.1, 0.4))) for _ in range(chance.randrange(1, 4))]
            spelled = (
                "{" + ", ".join(f"{k}: {v}" for k, v in case.items()) + "}" for case in cases
            )
            lines.append(f"cases: [{', '.join(spelled)}]")
        text = "\n".join(lines)
        said, objection = judged(text, folder)
        assert bool(said) == bool(objection), f"{text}\n{said}\n{objection}"
        verdicts[re.sub(r"cases\[\d\]\.", "", said.partition(": ")[2])[:40]] += 1
    # Every rule was met, and much was valid.
    assert len(verdicts) > 12
    assert verdicts[""] > 60


def test_damaged_files(folder):
    """Nothing that is valid looks wrong in an editor; what only looks right is in BEYOND."""
    spec = importlib.util.spec_from_file_location("fuzz", ROOT / "tests/verification/fuzz.py")
    fuzz = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fuzz)
    for _, data in fuzz.inputs(range(30), seed=11):
        if len(data) < 20_000:
            assert_agreement(data.decode(errors="ignore"), folder)
