"""The pages of the reference, written from the declarations of the package.

    python docs/site/reference.py

writes them to ``docs/reference``.  Keys of configs and mechanism files come from the models
(their JSON Schemas), measures and columns from the records in ``study``, commands from click,
names from what `newmark-study list` prints, and orders from the theory.  `PAGES` has every page;
the tests hold the files to it.
"""

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

import newmark_cli
from newmark_cli.cli.commands import cli
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.report.judging import expectations, slopes
from newmark_cli.report.reading.figures import Figure
from newmark_cli.report.tables import check, theory
from newmark_cli.report.tables.table import markdown_table
from newmark_cli.study import axes, catalogue, csv_files, schema
from newmark_cli.study.measures import MEASURES, Record
from newmark_cli.study.showable import VALUES

_HUGE = 1e29
_TINY = 1e-29
#: Keyword of JSON Schema → the sign of its bound.
_BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    lines = [[*heads]]
    lines.append(["---"] * len(lines[0]))
    lines += [[_in_cell(text) for text in row] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _in_cell(text: str) -> str:
    """Text for a cell; in code a bar is no end of one."""
    parts = re.split(r"(`[^`]*`)", text.replace("\n", " "))
    return "".join(part if part[:1] == "`" else part.replace("|", "\\|") for part in parts)


# -- keys of files --------------------------------------------------------------------------------


def _named(reference: str) -> str:
    return reference.rpartition("/")[2]


def _as_yaml(value: Any) -> str:
    """A default as one would write it in a file."""
    match value:
        case bool():
            return str(value).lower()
        case list():
            return f"[{', '.join(map(_as_yaml, value))}]"
        case dict():
            return f"{{{', '.join(f'{key}: {_as_yaml(part)}' for key, part in value.items())}}}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _model(found: Mapping[str, Any]) -> Mapping[str, Any]:
    """The mapping that a definition is, by itself or besides text; empty if it is none."""
    return next((one for one in (found, *found.get("anyOf", ())) if "properties" in one), {})


class _Keys:
    """Tables of the keys of one JSON Schema, a section for each model."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.document = document
        self.definitions: Mapping[str, Any] = document["$defs"]
        # What several keys share is in small letters, and no model.
        self.sections = [
            name for name, found in self.definitions.items() if name[0].isupper() and _model(found)
        ]

    def resolved(self, part: Mapping[str, Any]) -> Mapping[str, Any]:
        """A property with what its reference to another property says."""
        reference = part.get("$ref", "")
        if not reference:
            return part
        at: Any = self.document
        for step in reference.removeprefix("#/").split("/"):
            at = at[step]
        rest = {key: value for key, value in part.items() if key != "$ref"}
        return {**self.resolved(at), **rest}

    def allowed(self, part: Mapping[str, Any]) -> str:
        """What a value may be, in words."""
        reference = part.get("$ref", "")
        if reference.endswith("/Case"):
            return "mapping with the keys of a case"
        if reference and _named(reference) in self.sections:
            return f"[{_named(reference)}](#{_named(reference).lower()})"
        part = self.resolved(part)
        for kind in ("anyOf", "oneOf"):
            if kind in part and all(self._says_anything(one) for one in part[kind]):
                return self._either(part[kind])
        if "enum" in part:
            return ", ".join(f"`{value}`" for value in part["enum"] if value is not None)
        if "const" in part:
            return f"`{part['const']}`"
        match part.get("type"):
            case "array":
                return self._list(part)
            case "object" if part.get("additionalProperties"):
                return f"mapping of names to {self.allowed(part['additionalProperties'])}"
            case "object" if part.get("properties"):
                return f"mapping with {', '.join(f'`{key}`' for key in part['properties'])}"
            case "object":
                return "mapping"
            case "number" | "integer" as kind:
                return self._number(part, "number" if kind == "number" else "whole number")
            case "boolean":
                return "`true`, `false`"
            case "string":
                return "text"
        return ""

    @staticmethod
    def _says_anything(part: Mapping[str, Any]) -> bool:
        return bool({"type", "$ref", "enum", "const", "anyOf", "oneOf"} & set(part))

    def _either(self, parts: Iterable[Mapping[str, Any]]) -> str:
        found = [self.allowed(one) for one in parts if one.get("type") != "null"]
        single = next(iter(found), "")
        told = ["a list of them" if text == f"list of {single}" else text for text in found]
        return " or ".join(dict.fromkeys(text for text in told if text))

    def _list(self, part: Mapping[str, Any]) -> str:
        items = part.get("items")
        if not isinstance(items, Mapping):
            return "list"
        least, most = part.get("minItems"), part.get("maxItems")
        of = self.allowed(items)
        return f"{least} of: {of}" if least == most and least is not None else f"list of {of}"

    @staticmethod
    def _number(part: Mapping[str, Any], kind: str) -> str:
        bounds = []
        for key, sign in _BOUNDS.items():
            value = part.get(key)
            if value is not None and (_TINY < abs(value) < _HUGE or value == 0):
                bounds.append(f"{sign} {value:g}")
            elif value is not None and 0 < value <= _TINY:
                bounds.append("> 0")
        return " ".join([kind, " and ".join(dict.fromkeys(bounds))]).strip()

    def rows(self, model: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
        """Key, meaning, what is allowed, and the default."""
        required = set(model.get("required", ()))
        for key, given in model["properties"].items():
            part = self.resolved(given)
            default = part.get("default")
            shown = f"`{_as_yaml(default)}`" if default is not None else ""
            yield (
                f"`{key}`",
                part.get("description", ""),
                self.allowed(given),
                "required" if key in required else shown,
            )

    def section(self, name: str, title: str = "") -> str:
        """A model as a section with its table."""
        model = _model(self.definitions[name])
        about = inspect.cleandoc(model.get("description", "")).partition("\n\n")[0]
        heads = ("key", "meaning", "allowed", "default")
        return f"## {title or name}\n\n{about}\n\n{table(heads, self.rows(model))}\n"


def _mechanism(kind: str, title: str, lead: str) -> str:
    keys = _Keys(schema.SCHEMAS[kind]())
    heads = ("key", "meaning", "allowed", "default")
    top = table(heads, keys.rows(keys.document))
    parts = "\n".join(keys.section(name) for name in keys.sections)
    return f"# {title}\n\n{lead}\n\n## The file\n\n{top}\n\n{parts}"


def config_page() -> str:
    """Keys of study configs."""
    keys = _Keys(schema.config_schema())
    heads = ("key", "meaning", "allowed", "default")
    case = keys.definitions["Case"]
    own = {
        key: value
        for key, value in keys.document["properties"].items()
        if key not in case["properties"]
    }
    top = table(heads, keys.rows({"properties": own, "required": ["study"]}))
    needed = {"required": ["problem", "form", "preconditioning", "h"]}
    of_case = table(heads, keys.rows({**case, **needed}))
    others = [name for name in keys.sections if name not in ("Case", "Study")]
    parts = "\n".join(keys.section(name) for name in others)
    return (
        "# Keys of a study\n\n"
        "A study is a YAML file, or a dict in Python. "
        "[Your own study](../studies.md) shows how the keys work together, and "
        "`newmark-study list --schema config` prints them as JSON Schema, for editors. Where a "
        "key takes several values, a list of them spans a grid: every combination is a cell.\n\n"
        f"## The study\n\n{top}\n\n"
        "## A case\n\nThese keys stand at the top of the file. In a study with `cases` each case "
        "has its own, and those at the top hold for every case that does not set them. "
        "One of `t_end` and `steps` is required.\n\n"
        f"{of_case}\n\n{parts}"
    )


def mechanism_page() -> str:
    """Keys of planar mechanism files."""
    return _mechanism(
        "mechanism",
        "Keys of a planar mechanism",
        "SI units. [Mechanisms in the plane](../planar.md) has an example, and "
        "`newmark-study list --schema mechanism` prints the keys as JSON Schema.",
    )


def spatial_page() -> str:
    """Keys of spatial mechanism files."""
    joints = table(
        ("joint", "rows", "what it does"),
        ((f"`{name}`", ", ".join(joint.rows), joint.about) for name, joint in JOINTS.items()),
    )
    keys = _mechanism(
        "spatial",
        "Keys of a spatial mechanism",
        "SI units. [Mechanisms in space](../spatial.md) has an example, and "
        "`newmark-study list --schema spatial` prints the keys as JSON Schema.",
    )
    return f"{keys}\n## Types of joints\n\n{joints}\n"


# -- measures and columns -------------------------------------------------------------------------

_KINDS = {
    "rounding": "rounding: it scatters from step to step",
    "truncation": "truncation, down to a floor of rounding",
    "determined": "the state: it is smooth in h",
}


def _record(record: Record) -> tuple[str, str, str, str, str, str]:
    tolerance = "" if record.tolerance != record.tolerance else f"± {record.tolerance:g}"
    return (
        f"`{record.name}`",
        ", ".join(f"`{name}`" for name in record.quantities),
        f"`{record.statistic}`",
        _KINDS[record.kind],
        "yes" if record.predicts else "no",
        tolerance,
    )


def measures_page() -> str:
    """Measures and the rows of the CSV that each gives."""
    heads = ("`measure` in the CSV", "quantities", "drawn and fitted", "ruled by", "order predicted", "tolerance")  # noqa: E501  # fmt: skip
    parts = []
    for measure in MEASURES.values():
        needs = []
        if measure.along_steps:
            needs.append("needs steps: `steps: 0` is refused")
        if measure.stop:
            needs.append("needs the key `stop`")
        if measure.stop is False:
            needs.append("refuses the key `stop`")
        if measure.solvers:
            solvers = " or ".join(f"`{name}`" for name in measure.solvers)
            needs.append(f"needs `linear_solver` {solvers}")
        if measure.at_end:
            needs.append("`t_end` must be a whole number of steps")
        said = measure.about[0].upper() + measure.about[1:]
        text = f"{said}.\n\n" + (f"{'; '.join(needs).capitalize()}.\n\n" if needs else "")
        rows = table(heads, map(_record, measure.records))
        parts.append(f"## {measure.name}\n\n{text}{rows}\n")
    return (
        "# Measures\n\n"
        "The key `measure` of a [study](config.md) names what is recorded. Each measure gives one "
        "or more kinds of rows of the [CSV](csv.md). Of every row one statistic is drawn and "
        "fitted; where theory predicts its order in h, `check` compares the two within a "
        "tolerance.\n\n" + "\n".join(parts)
    )


def csv_page() -> str:
    """Columns of the files in a results folder."""
    of_slopes = {
        **{axis.name: axis.shows or axis.about for axis in axes.series_axes() if axis.column},
        **VALUES,
        "figure": "figures that draw the series",
        "expected": "predicted order; empty where theory predicts none",
        "tolerance": "largest |slope − expected| that passes",
        "verdict": "see the verdicts in “Reading results”",
    }
    return (
        "# Columns of the CSVs\n\n"
        "## `<study>.csv`\n\n"
        "One row for each cell and quantity. Floats read back to the same bits. A CSV of an older "
        "version lacks the columns that came later, and is read with the value that went without "
        "saying then.\n\n"
        + table(
            ("column", "meaning"),
            ((f"`{name}`", csv_files.ABOUT[name]) for name in csv_files.COLUMNS),
        )
        + "\n\n## `slopes.csv`\n\n"
        "One row for each series over h; `plot` and `reproduce` write it.\n\n"
        + table(
            ("column", "meaning"),
            ((f"`{name}`", of_slopes[name]) for name in slopes.COLUMNS),
        )
        + "\n\n## Values over time\n\n"
        "`trajectory/<study>.csv` has a row for each cell and step that was kept: first the "
        "columns "
        + ", ".join(f"`{name}`" for name in csv_files.HISTORY_COLUMNS)
        + ", and of "
        + ", ".join(f"`{name}`" for name in csv_files.HISTORY_MAY_HAVE)
        + " those in which a cell differs from the default. What was kept comes after them, by "
        "name: "
        "`u[A.x]`, `v[A.x]`, `a[A.x]`, `lambda[bars.link]`, …, `energy`, `drift[position]`. "
        "[Multipliers](../python.md#multipliers) has signs and units.\n"
    )


# -- names, commands, API -------------------------------------------------------------------------


def names_page() -> str:
    """All that a config can name."""
    from newmark_cli.report.reading.figures import FIGURES

    parts = [
        f"## {section[0].upper()}{section[1:]}\n\n"
        + table(("name", "what it is"), ((f"`{name}`", about) for name, about in found.items()))
        for section, found in catalogue.sections().items()
    ]
    figures = ((f"`{name}`", _title(figure)) for name, figure in FIGURES.items())
    return (
        "# Names\n\nAll that a config and the command line can name, as `newmark-study list` "
        "prints it. n is the number of coordinates, m that of constraints.\n\n"
        + "\n\n".join(parts)
        + f"\n\n## Figures\n\n{table(('name', 'what it shows'), figures)}\n"
    )


def _title(figure: Figure) -> str:
    return figure.title


def _help(command: click.Command) -> str:
    """Help of a command as Markdown; examples become code."""
    text = inspect.cleandoc(command.help or "")
    paragraphs = []
    for paragraph in re.split(r"\n\n+", text):
        if paragraph.startswith("\b\n"):
            _, _, *lines = paragraph.split("\n")
            paragraphs.append("```bash\n" + "\n".join(line.strip() for line in lines) + "\n```")
        else:
            paragraphs.append(paragraph.replace("\n", " ").replace("<", "&lt;"))
    return "\n\n".join(paragraphs)


def _options(command: click.Command) -> Iterator[tuple[str, str]]:
    context = click.Context(command)
    for parameter in command.params:
        record = parameter.get_help_record(context)
        if record is not None:
            name, about = record
            yield f"`{name}`", about


def commands_page() -> str:
    """Commands with their options."""
    parts = []
    for name, command in cli.commands.items():
        usage = " ".join(command.collect_usage_pieces(click.Context(command)))
        parts.append(
            f"## {name}\n\n```text\nnewmark-study {name} {usage}\n```\n\n{_help(command)}\n\n"
            + table(("option", "meaning"), _options(command))
        )
    codes = table(
        ("exit code", "meaning"),
        (
            ("0", "success"),
            ("1", "a check failed, a cell did not end well, a file is not what was written, or a "
                  "verdict changed"),
            ("2", "bad input: a line on stderr for each mistake, with file, line and key"),
            ("70", "an error of the program itself; its traceback is printed"),
            ("141", "nobody reads the output any more"),
            ("143", "ended by SIGTERM"),
        ),
    )  # fmt: skip
    return (
        "# Commands\n\n`newmark-study COMMAND --help` prints the same.\n\n"
        f"{codes}\n\n" + "\n\n".join(parts) + "\n"
    )


def _public() -> Iterator[tuple[str, list[str]]]:
    """Names of the library by their kind."""
    kinds: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in newmark_cli.__all__:
        if name == "__version__":
            continue
        found = getattr(newmark_cli, name)
        if isinstance(found, type) and issubclass(found, Exception):
            kinds["Errors"].append(name)
        else:
            kinds["Classes" if isinstance(found, type) else "Functions"].append(name)
    yield from kinds.items()


def api_page() -> str:
    """Public names of the library, each with the first sentence of its docstring."""
    parts = [
        "# The API\n\n`import newmark_cli as newmark`. [The Python library](../python.md) shows "
        "how the names work together. Everything that is not here is private. "
        "`help(newmark.march)` prints a docstring, and the website has all of them."
    ]
    for kind, names in _public():
        abouts = ((f"`{name}`", _first_sentence(name)) for name in names)
        parts.append(f"## {kind}\n\n{table(('name', 'what it is'), abouts)}")
    return "\n\n".join(parts) + "\n"


def _first_sentence(name: str) -> str:
    about = inspect.getdoc(getattr(newmark_cli, name)) or ""
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", about.partition("\n\n")[0])


def docstrings() -> str:
    """What mkdocstrings sets the docstrings of all public names in for."""
    return "\n\n".join(
        f"::: newmark_cli.{name}\n    options:\n      heading_level: 2"
        for _, names in _public()
        for name in names
    )


def orders_page() -> str:
    """Predicted orders of all formulations and forms."""
    report = theory.formulations().written("markdown").strip()
    return (
        "# Predicted orders\n\n`newmark-study tables --formulations` prints these tables. "
        "[Theory](../theory.md) says how the orders are found.\n\n"
        f"{report}\n"
    )


def claim_tables() -> dict[str, str]:
    """Marks in verification.md and the tables that replace them, from the committed results."""
    folder = Path(__file__).parents[2] / "results"
    series = slopes.collect(folder)
    claims = expectations.claim_rows(expectations.judge(folder, series))
    return {
        "<!-- slopes -->": markdown_table(check.slope_rows(check.in_paper(series))),
        "<!-- claims -->": markdown_table(claims),
    }


#: Pages of the site, by their path, and what writes each.
PAGES: Mapping[str, Callable[[], str]] = {
    "reference/commands.md": commands_page,
    "reference/config.md": config_page,
    "reference/mechanism.md": mechanism_page,
    "reference/spatial.md": spatial_page,
    "reference/measures.md": measures_page,
    "reference/csv.md": csv_page,
    "reference/names.md": names_page,
    "reference/orders.md": orders_page,
    "reference/api.md": api_page,
}

#: What heads a page, so that nobody edits it.
_HEAD = "<!-- Written by `python docs/site/reference.py`. -->\n\n"


def written() -> dict[str, str]:
    """Every page, as its file has it."""
    return {path: f"{_HEAD}{page()}" for path, page in PAGES.items()}


if __name__ == "__main__":
    for path, text in written().items():
        Path(__file__).parents[1].joinpath(path).write_text(text, encoding="utf-8")
