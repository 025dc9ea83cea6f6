"""The documentation: every block of code in it is run, and its tables are those of the code."""

import re
import runpy
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import click
import pytest
import yaml
from pages import ROOT, blocks, commands, inline, pages

import newmark_cli as newmark
from newmark_cli.cli.commands import cli as group
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.models import Law, Mechanism, Table
from newmark_cli.mechanisms.planar import PlanarBuilder
from newmark_cli.mechanisms.registry import PROBLEMS, TESTSET
from newmark_cli.mechanisms.spatial_model import SpatialMechanism
from newmark_cli.report.judging import expectations, slopes
from newmark_cli.report.judging.verdicts import NOT_CONVERGING, PASS, SHOWN, UNDECIDED
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.study import config, csv_files, shipped
from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.axis import TRAPEZOIDAL
from newmark_cli.study.csv_rows import study_files
from newmark_cli.study.entries import ExpectConfig, FigureConfig
from newmark_cli.study.measures import MEASURES, RECORDED
from newmark_cli.support import documents

PAGES = pages()
DOCS = ROOT / "docs"
README = PAGES["README.md"].read_text(encoding="utf-8")
SPATIAL = PAGES["spatial.md"].read_text(encoding="utf-8")

#: Commands of a shell or of an installation, which the tests do not run.
FOREIGN = ("python3", "pip", ".", "mkdocs")
#: Studies and mechanisms that single keys of a page are tried in.
STUDY = {
    "study": "fragment", "problem": "pendulum", "form": "u-lambda", "preconditioning": "none",
    "measure": ["correction", "condition", "error"], "h": [0.1, 0.05], "t_end": 1.0,
}  # fmt: skip
COUNTED = re.compile(r"^(\d+) of (\d+) slopes as predicted")


def agrees(shown, printed):
    """Whether output is what a page shows, where … stands for any lines.

    How many of the slopes pass may depend on the processor, by what rounding does on it; the
    number of slopes, and all that is said besides, may not.
    """
    pattern = []
    for line in shown:
        counted = COUNTED.match(line)
        if line == "…":
            pattern.append(r"(?:.*\n)*?")
        elif counted:
            pattern.append(rf"\d+ of {counted[2]} slopes as predicted.*\n")
        else:
            pattern.append(re.escape(line) + r"\n")
    printed = "".join(f"{line}\n" for line in printed.splitlines() if line)
    return re.fullmatch("".join(pattern), printed) is not None


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Cells and references that one page has computed and another may need."""
    return tmp_path_factory.mktemp("cache")


class Reader:
    """Somebody who does all that a page says, in a folder without results."""

    def __init__(self, cli, cache):
        self.cli, self.names = cli, {}
        shutil.copytree(DOCS / "examples", cli.folder / "docs/examples")
        shutil.copytree(cache, cli.folder / "results")

    def leaves(self, cache):
        """Keep what was computed for the next page."""
        for kind in ("cells", "references"):
            if (self.cli.folder / "results" / kind).is_dir():
                shutil.copytree(
                    self.cli.folder / "results" / kind, cache / kind, dirs_exist_ok=True
                )

    def does(self, block):
        """Save a file, run commands, run code, or validate what goes into a file."""
        if block.title:
            self.cli.write(block.title, block.text)
        if block.not_run or block.language in ("text", "math"):
            return
        if block.title.startswith(".github/workflows/"):
            (job,) = yaml.safe_load(block.text)["jobs"].values()
            steps = [step["run"] for step in job["steps"] if "run" in step]
            assert any("check" in step for step in steps)
            self.run(commands(replace(block, language="bash", text="\n".join(steps))))
        elif block.language in ("bash", "console"):
            self.run(commands(block))
        elif block.language == "python":
            code = compile(block.text, block.title or "block", "exec")
            if not block.title:
                exec(code, self.names)
        else:
            assert block.language == "yaml", block.language
            if not block.title:
                self.validate(block.text)

    def run(self, wanted):
        """Run commands, and compare what they print with what is shown."""
        for command in wanted:
            program, *rest = command.words
            if program in FOREIGN or program.startswith(".venv/bin/"):
                continue
            if program == "python":
                script = ROOT / rest[0]
                assert script.is_file(), rest[0]
                if script.is_relative_to(DOCS):
                    done = self.cli.python(script, *rest[1:])
                    assert done.returncode == 0, done.stderr
                continue
            assert program == "newmark-study", command
            assert rest[0] != "advise" or not command.shown, command
            done = self.cli.run(*rest)
            printed = re.sub(r" \(\d+ cached\)", "", done.stdout + done.stderr)
            refused = bool(command.shown) and command.shown[0].startswith("newmark-study: ")
            codes = (0, 1) if command.may_fail else (2 if refused else 0,)
            assert done.returncode in codes, (command.words, printed)
            if rest[0] in ("draw", "plot"):
                self.require_pictures(done.stdout.split())
            if command.into:
                self.cli.write(command.into, done.stdout)
            if command.shown:
                shown = "\n".join(command.shown)
                assert agrees(command.shown, printed), f"{shown}\n-- but --\n{printed}"

    def require_pictures(self, names):
        """What a command says that it has drawn is there, a picture each."""
        drawn = [self.cli.folder / name for name in names if name.endswith((".png", ".svg"))]
        contents = [path.read_bytes() for path in drawn]
        assert len(set(contents)) == len(contents) > 0 or not drawn, names
        for path, content in zip(drawn, contents, strict=True):
            begins = b"\x89PNG" if path.suffix == ".png" else b"<?xml"
            assert content.startswith(begins), path

    def validate(self, text):
        """Keys of a study or of a mechanism, put where they belong."""
        keys = {} if "…" in text else yaml.safe_load(text) or {}
        if "…" in text:
            self.excerpt(text)
        elif set(keys) <= {"figures", "tables", "expect", *config.Case.model_fields}:
            self.cli.write("fragment.yaml", yaml.safe_dump(STUDY | keys))
            self.cli("validate", "fragment.yaml")
        else:
            assert set(keys) <= set(Mechanism.keys()), text
            whole = documents.read(DOCS / "examples/hoist.yaml").data
            self.cli.write("fragment.yaml", yaml.safe_dump(whole | keys))
            self.cli("validate", "fragment.yaml")

    def excerpt(self, text):
        """What a page shows of an example, with … in place of the rest."""
        whole = [path.read_text(encoding="utf-8") for path in (DOCS / "examples").glob("*.yaml")]
        lines = [line for line in text.splitlines() if line.strip() != "…"]
        assert any(all(line in example for line in lines) for example in whole), text


@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("name", PAGES)
def test_a_page_can_be_followed(name, cli, cache, monkeypatch):
    """Every command runs and prints what is shown, all code runs, all files are valid."""
    reader = Reader(cli, cache)
    monkeypatch.chdir(cli.folder)
    found = blocks(PAGES[name])
    run = "".join(block.text for block in found if block.language in ("bash", "console"))
    for block in found:
        reader.does(block)
        if block.title.endswith(".yaml") and f" {block.title}" not in run:
            given = yaml.safe_load(block.text)
            if "study" in given:
                largest = max(float(h) for h in given["h"])
                given |= {"h": largest, "t_end": 10 * largest}
                given["measure"] = [m for m in given.get("measure", ["condition"]) if m != "error"]
                cli.write(block.title, yaml.safe_dump(given))
                cli("run", block.title)
    reader.leaves(cache)
    if name == "python.md":
        assert reader.names["later"].t[-1] == pytest.approx(5.0)
        assert reader.names["factors"].right["lambda"] == pytest.approx(1 / (0.3025 * 1e-6))
        assert reader.names["swing"].m == 1
    if name == "slopes-in-ci.md":
        report = ElementTree.parse(cli.folder / "slopes.xml").getroot()
        assert {key: report.get(key) for key in ("tests", "failures", "errors", "skipped")} == {
            "tests": "14", "failures": "0", "errors": "0", "skipped": "0",
        }  # fmt: skip


@pytest.mark.parametrize("name", PAGES)
def test_what_a_page_names_exists(name):
    """Commands and options in the text, scripts, and files that the README links to."""
    for text in (part for found in inline(PAGES[name]) for part in found.split(" && ")):
        words = text.split()
        if words[0] == "python" and len(words) > 1 and "/" in words[1]:
            assert (ROOT / words[1]).is_file(), text
        if words[0] != "newmark-study" or len(words) == 1 or words[1] == "COMMAND":
            continue
        options = {
            option
            for parameter in group.commands[words[1]].params
            for option in (*parameter.opts, *parameter.secondary_opts)
        } | {"--help"}
        for word in words[2:]:
            assert not word.startswith("-") or word.partition("=")[0] in options, text
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", PAGES[name].read_text("utf-8")):
        assert (PAGES[name].parent / target).exists(), target


def test_the_readme_is_short():
    """A first impression, in at most 8 kB, with the command that CI runs."""
    assert len(README.encode()) <= 8192
    assert (
        "python3 -m venv .venv && .venv/bin/pip install -e '.[test]' && .venv/bin/pytest\n"
        in README
    )
    assert "docs/python.md" in README


def test_files_that_pages_show_are_those_of_the_examples():
    """What the README and the folder of examples both have says the same."""
    shown = {}
    for block in blocks(PAGES["README.md"]):
        if block.language == "yaml" and block.title:
            shown[block.title] = yaml.safe_load(block.text)
    assert set(shown) == {"hoist.yaml", "lift.yaml"}
    for name, found in shown.items():
        example = yaml.safe_load((DOCS / "examples" / name).read_text(encoding="utf-8"))
        for key in ("title", "source"):
            example.pop(key, None)
        assert found == example, name


@pytest.fixture(scope="module")
def reference():
    """Pages of the reference, by path."""
    return runpy.run_path(str(DOCS / "site/reference.py"))["written"]()


def test_pages_of_the_reference_are_those_of_the_code(reference):
    """`python docs/site/reference.py` after a key, an option or a name has changed."""
    found = {f"reference/{path.name}" for path in (DOCS / "reference").iterdir()}
    assert found == reference.keys()
    for path, text in reference.items():
        assert (DOCS / path).read_text(encoding="utf-8") == text, path
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (DOCS / path).parent.joinpath(target).is_file(), (path, target)


def rows_of(page):
    """First cells of the rows of all tables, without backticks, with the second ones."""
    return dict(re.findall(r"^\| `([^`|]+)` \| (.*?) \|", page, re.M))


def test_every_column_and_key_is_explained(reference):
    """No column of a CSV and no key of a file without a word about it."""
    columns = rows_of(reference["reference/csv.md"])
    for name in (*csv_files.COLUMNS, *slopes.COLUMNS):
        assert len(columns[name]) > 5, name
    assert set(csv_files.ABOUT) >= set(csv_files.COLUMNS)
    keys = rows_of(reference["reference/config.md"])
    for model in (config.Case, config.Study, FigureConfig, ExpectConfig):
        for name in model.model_fields:
            assert len(keys[name]) > 5, name
    for page, model in (("mechanism", Mechanism), ("spatial", SpatialMechanism)):
        keys = rows_of(reference[f"reference/{page}.md"])
        for name in model.keys():  # noqa: SIM118 (no mapping)
            assert len(keys[name]) > 5, name


def test_every_measure_command_and_name_is_there(reference):
    """With the kinds of rows, the options, and the line of `list`."""
    page = reference["reference/measures.md"]
    for measure in MEASURES.values():
        assert f"\n## {measure.name}\n" in page
    assert set(RECORDED) <= set(rows_of(page))
    page = reference["reference/commands.md"]
    for name, command in group.commands.items():
        section = page.split(f"\n## {name}\n")[1].split("\n## ")[0]
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                assert parameter.opts[-1] in section, (name, parameter.opts)
    names = rows_of(reference["reference/names.md"])
    for name in (*PROBLEMS, *FIGURES, *shipped.names()):
        assert len(names[name]) > 10, name
    about = rows_of(reference["reference/api.md"])
    for name in newmark.__all__:
        assert name == "__version__" or len(about[name]) > 10, name


@pytest.fixture(scope="module")
def committed(committed_folder, committed_results):
    """Slopes of the committed CSVs."""
    studies = [path.stem for path in study_files(committed_folder)]
    return committed_results(*studies).slopes


def test_tables_of_cures_are_those_of_the_results(committed):
    """Orders in docs/what-scaling-cures.md are the fitted ones, by the names in the figures."""
    page = PAGES["what-scaling-cures.md"].read_text(encoding="utf-8")
    column = r"^\| {} \| [^|]*\| [^|]*fitted ([−0-9.]+) \| [^|]* \| [^|]* \|$"
    fitted = {slope.key: slope.fit.slope for slope in committed}
    for curve in (curve for name in ("16", "24", "25") for curve in FIGURES[name].curves):
        if curve.problem == "andrews":
            at = {"measure": "condition", "quantity": "jacobian"}
            slope = fitted[SeriesKey.of(curve.key.named() | at)]
            (told,) = re.findall(column.format(re.escape(curve.label)), page, re.M)
            assert told == f"{slope:.1f}".replace("-0.0", "0.0").replace("-", "−"), curve.label


def test_committed_results_are_complete(committed):
    """All studies of `reproduce --all`, all figures, every slope as predicted, every claim true."""
    assert {s.study for s in committed} >= {*config.REPRODUCED, *config.BEYOND, *config.APART}
    others = [s for s in committed if s.verdict not in (PASS, SHOWN)]
    assert not any(slope.fails for slope in others)
    others = [s for s in others if s.study not in config.APART]
    # The trapezoidal rule, which studies of errors are about, single step sizes, and floors.
    assert {s.study for s in others} == {"error", "cures", "step-changes"}
    damped = {
        (s.problem, s.formulation.partition(" ")[0]) for s in others if s.integrator != TRAPEZOIDAL
    }
    assert damped <= {("shaken-pendulum", "index-3"), ("shaken-pendulum", "augmented-lagrangian")}
    assert {s.verdict for s in others} == {NOT_CONVERGING, UNDECIDED}
    judged = expectations.judge(ROOT / "results", committed)
    assert {entry.verdict for entry in judged} == {PASS}
    silent = {"integrators", "cures-tolerance", "cures-krylov", "spatial"}
    assert {entry.study for entry in judged} == {*config.BEYOND} - silent
    for number in FIGURES:
        assert (ROOT / f"results/figures/figure-{number}.png").stat().st_size > 5000


def test_tables_name_every_joint(reference):
    """With the rows of each joint, in their order."""
    page = reference["reference/spatial.md"].partition("## Types of joints")[2]
    assert rows_of(page) == {name: ", ".join(joint.rows) for name, joint in JOINTS.items()}
    for name in (*JOINTS, "heavy-top", "bricard", "governor", "spatial-slider-crank"):
        assert f"`{name}`" in SPATIAL, name


def test_tables_name_every_planar_part_and_law():
    """Each part with its equation, each key of a law and of a table."""
    page = PAGES["planar.md"].read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z_]+)` \| .+ \|$", page, re.M)
    parts = set(PlanarBuilder.parts) - {"points", "body_points", "bodies"}
    assert parts <= set(rows)
    assert parts <= Mechanism.model_fields.keys()
    for model in (Law, Table):
        for key in model.model_fields:
            assert f"`{key}`" in page or f"{key}`" in page or f", {key}" in page, key


def test_slopes_of_the_shipped_study_are_those_of_the_page(cli, committed_folder):
    """The number of slopes, from the committed results."""
    said = re.search(r"all (\d+) slopes are as predicted", SPATIAL)[1]
    told = cli("check", "spatial", "--results", committed_folder).stdout.splitlines()
    assert told[-1] == f"{said} of {said} slopes as predicted"


def test_page_of_the_test_set_is_that_of_its_data():
    """`python docs/site/testset.py` after a member has changed; each has small pictures."""
    script = runpy.run_path(str(ROOT / "docs/site/testset.py"))
    text = (ROOT / "docs/testset.md").read_text(encoding="utf-8")
    assert script["page"](text) == text
    for name in TESTSET:
        for picture, most in ((name, 30_000), (f"{name}-errors", 45_000)):
            path = ROOT / f"docs/figures/testset-{picture}.png"
            assert 1_000 < path.stat().st_size < most, picture
