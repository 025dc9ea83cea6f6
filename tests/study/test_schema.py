"""JSON Schemas: as committed, found by editors, and never stricter than `validate`."""

import json
import re
from pathlib import Path

import pytest
import yaml
from conftest import QUICK
from jsonschema import Draft7Validator, Draft202012Validator

from newmark_cli.mechanisms import loading
from newmark_cli.study import config, schema, subjects
from newmark_cli.support import documents
from newmark_cli.support.documents import DocumentError

ROOT = Path(__file__).parents[2]
MECHANISMS = ROOT / "newmark_cli/mechanisms/shipped"
COMMITTED = {
    MECHANISMS / "schema/mechanism.json": ("list", "--schema", "mechanism"),
    MECHANISMS / "schema/spatial.json": ("list", "--schema", "spatial"),
}
FILES = sorted(
    file
    for place in ("configs", "docs/examples", MECHANISMS)
    for file in (ROOT / place).glob("*.yaml")
)
VALIDATORS = {kind: Draft202012Validator(make()) for kind, make in schema.SCHEMAS.items()}

EXAMPLE = (ROOT / "docs/examples/hoist.yaml").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that configs name."""
    folder = tmp_path_factory.mktemp("schema")
    for file in (ROOT / "docs/examples").glob("*.yaml"):
        (folder / file.name).write_text(file.read_text())
    return folder


def judged(text, folder):
    """Complaints of `validate` and of the schema."""
    document = documents.parse(text, "f.yaml")
    data = document.data
    if {"points", "bodies"}.isdisjoint(data):
        kind, read = "config", lambda: config.parse(document, subjects.Surroundings(folder))
    else:
        kind = "spatial" if loading.is_spatial(data) else "mechanism"
        read = lambda: loading.built("f", document)  # noqa: E731
    objection = next((error.message for error in VALIDATORS[kind].iter_errors(data)), "")
    try:
        read()
    except DocumentError as error:
        return str(error), objection
    return "", objection


@pytest.mark.parametrize("file", COMMITTED)
def test_committed_files_are_what_the_commands_print(cli, file):
    """After a change: newmark-study schema, schema mechanism, list --json (CONTRIBUTING)."""
    assert file.read_text() == cli(*COMMITTED[file]).stdout


@pytest.mark.parametrize("kind", schema.SCHEMAS)
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


@pytest.mark.parametrize("file", FILES)
def test_editors_find_the_schema_and_it_fits(file, folder):
    """The first line of every mechanism names the schema of its kind by a path."""
    text = file.read_text()
    # As an editor reads it, not with the project's reader.
    data = yaml.load(text, Loader=_Yaml12)
    kind = "spatial" if loading.is_spatial(data) else "mechanism" if "points" in data else "config"
    VALIDATORS[kind].validate(data)
    if kind != "config":
        named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", text)
        target = (file.parent / named[1]).resolve()
        assert target in COMMITTED
        assert target.stem == kind
    if file.parent.name == "examples":  # others are loaded by tests of their own
        assert judged(text, folder) == ("", "")


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


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        (QUICK, "problem: pendulum", "problem: hoist.yaml"),
        (QUICK, "pendulum", "[pendulum, {chain: {links: 3}}]"),
        (QUICK, "t_end: 1.0", "t_end: 1\nsteps: ~"),
        (QUICK, "t_end: 1.0", "t_end: 1\nstop: ~"),
        (QUICK, "t_end: 1.0", "t_end: 1\nlinear_solver: [auto, gmres]"),
        (QUICK, "t_end: 1.0", "t_end: 1\nmeasure: trajectory\ntrajectory: {at: 0.5}"),
        (QUICK, "t_end: 1.0", "t_end: 1\naccept: not_converged"),
        (QUICK, "t_end: 1.0", "t_end: 1\nexpect: [{measure: condition, slope: 1, form: u-lambda}]"),
        (
            QUICK, "t_end: 1.0",
            "t_end: 1\nexpect: [{measure: condition, slope: 1, integrator: newmark beta=0.25}]",
        ),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht, alpha: 0.1, rho: ~}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nformulation: [ggl, {method: baumgarte, rate_h: 1}]"),
        (QUICK, "t_end: 1.0", "t_end: 1\nprojection: {method: velocity, accelerations: true}"),
        (QUICK, "form: u-lambda", "cases: [{form: u-lambda}, {form: v-lambda}]"),
        *(
            (QUICK, "[none, optimal]", f"{{name: x, left: {{D: {factor}}}}}")
            for factor in ("1/h", "2", "1.5e-3*h", "(beta*h)/(2*gamma)", "h^(2)", "(h)^2", "'2'")
        ),
        (EXAMPLE, "A: {fixed: [0, 0]}", "A: {fixed: [0, 0], at: ~}"),
        (EXAMPLE, "gravity:", "motions: {m: {body: lever, angle: {rate: 0}}}\ngravity:"),
    ],
)  # fmt: skip
def test_unusual_but_right(folder, text, old, new):
    """An editor marks nothing that `validate` takes, wherever names are right."""
    assert old in text
    said, objection = judged(text.replace(old, new), folder)
    assert not objection, (said, objection)


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        (QUICK, "problem: pendulum\n", ""),
        (QUICK, "form: u-lambda", "frm: u-lambda"),
        (QUICK, "u-lambda", "[u-lambda]\ncases: [{form: v-lamda}]"),
        (QUICK, "1e-2]", "0]"),
        (QUICK, "study: quick", "study: quick\ndescription: 3"),
        (QUICK, "t_end: 1.0", "steps: 1.5"),
        (QUICK, "t_end: 1.0", "t_end: 1\nintegrator: {method: hht, alfa: 0.1}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nkrylov: {tolerance: 1}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nmeasure: trajectory\ntrajectory: {keep: w}"),
        (QUICK, "t_end: 1.0", "t_end: 1\nexpect: [{measure: condition, slope: two}]"),
        (EXAMPLE, "length: 0.5,", "length: '0.5',"),
        (EXAMPLE, "length: 0.5,", "length: 1e31,"),
        (EXAMPLE, "gravity: [0, -9.81]", "gravity: -9.81"),
    ],
)  # fmt: skip
def test_misspelled_keys_and_wrong_types(folder, text, old, new):
    """Keys, types, names and bounds of a single key are marked while one types."""
    assert old in text
    said, objection = judged(text.replace(old, new), folder)
    assert said
    assert objection
