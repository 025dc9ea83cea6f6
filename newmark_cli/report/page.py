"""Results as one HTML page that needs no other file."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import newmark_cli
from newmark_cli.mechanisms import registry
from newmark_cli.report.drawing import draw, plot, sheets
from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.drawing.style import Drawing, rendered
from newmark_cli.report.judging import expectations, slopes
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.reading import records
from newmark_cli.report.reading.choosing import Choice
from newmark_cli.report.tables import check, outcomes, study_tables
from newmark_cli.report.tables.table import Report
from newmark_cli.study.csv_rows import read_record
from newmark_cli.support import files
from newmark_cli.support.errors import InputError

_SVG = "http://www.w3.org/2000/svg"
_LINK = "{http://www.w3.org/1999/xlink}href"


def write(folder: Path, output: Path | None = None) -> Path:
    """Write the page, by default to ``report.html`` of the results folder; returns the file."""
    text = html(folder)
    if output is None:
        output = folder / "report.html"
        files.write(output, text)
    else:
        files.write_output(output, text)
    return output


def html(folder: Path) -> str:
    """The page of a results folder, the same text each time."""
    try:
        import jinja2
    except ModuleNotFoundError:
        raise InputError(
            "report: needs jinja2; install it with: pip install 'newmark-study[report]'"
        ) from None
    series = slopes.collect(folder)
    expected = expectations.judge(folder, series)
    # Of studies of one's own, which no figure shows, nothing is folded away.
    shown = check.chosen(series, everything=not check.in_paper(series))
    studies = dict.fromkeys(slope.study for slope in series)
    changed = records.changed(folder, studies)
    runs = [_run(study, records.known(folder / f"{study}.csv")) for study in studies]
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("newmark_cli.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html").render(
        version=newmark_cli.__version__,
        finished=max((run["facts"].get("finished", "") for run in runs), default=""),
        holds=outcomes.hold(outcomes.of(series, expected, changed)),
        changed=[f"{entry.path}: {entry.finding}" for entry in changed],
        summary=check.summary(series, expectations.summary(expected)),
        slopes=check.slope_rows(shown),
        rest=check.slope_rows([slope for slope in series if slope not in shown]),
        claims=expectations.claim_rows(expected),
        expectations=expectations.table(expected),
        pictures=list(_pictures(Results(folder, series))),
        tables=_tables(folder, series),
        runs=runs,
    )


def _pictures(results: Results) -> Iterator[dict[str, Any]]:
    """Figures that the results are enough for, and shipped mechanisms in space they are of."""
    for figure in plot.chosen((), results, Choice(everything=True)).figures:
        caption = figure.name.capitalize()
        if plot.stem(figure) == figure.name:
            caption = figure.study
        elif figure.name[0].isdigit():
            caption = f"Figure {figure.name}"
        sheet = sheets.sheet(figure, results)
        yield _picture(sheet, f"figure-{figure.name}", figure.title, f"{caption}: {figure.title}")
    for name in dict.fromkeys(slope.problem for slope in results.slopes):
        if registry.is_spatial(name):
            subject = registry.problem(name)
            title = subject.drawing.title
            caption = f"{name}: {title}, initial position"
            if subject.released:
                caption += f"; redundant, dropped: {', '.join(subject.released)}"
            sheet = mechanism_sheet(title, subject, subject.u0)
            yield _picture(sheet, f"mechanism-{name}", title, caption)


def _picture(sheet: Any, name: str, title: str, caption: str) -> dict[str, Any]:
    """A figure on the page: its ids are unique there, and its label is for those who hear it."""
    svg = inline_svg(draw.drawn(sheet), f"{name}-", sheet.words)
    return {"title": title, "caption": caption, "svg": svg, "wide": sheet.wide}


def inline_svg(drawing: Drawing, prefix: str, label: str) -> str:
    """A drawing inside HTML with a label; a prefix tells its ids from those of other figures."""
    root = ElementTree.fromstring(rendered(drawing, "svg"))
    for parent in list(root.iter()):
        for child in list(parent):
            # Matplotlib's metadata names addresses, its style would hold for the whole page.
            if child.tag in (f"{{{_SVG}}}metadata", f"{{{_SVG}}}style"):
                parent.remove(child)
    for element in root.iter():
        element.tag = element.tag.removeprefix(f"{{{_SVG}}}")
        if _LINK in element.attrib:
            element.set("href", element.attrib.pop(_LINK).replace("#", f"#{prefix}"))
        for name, value in element.attrib.items():
            if name == "id":
                element.set(name, prefix + value)
            elif "url(#" in value:
                element.set(name, value.replace("url(#", f"url(#{prefix}"))
    viewed = root.attrib["viewBox"]
    root.attrib.clear()
    root.attrib.update({"viewBox": viewed, "role": "img", "aria-label": label})
    return ElementTree.tostring(root, encoding="unicode")


def _tables(folder: Path, series: Sequence[Slope]) -> list[Report]:
    """Tables that configs define, including Tables 1 and 2 of the paper."""
    reports = []
    for study in dict.fromkeys(slope.study for slope in series):
        ours = [slope for slope in series if slope.study == study]
        if study == study_tables.PAPER and ours[0].shipped:
            reports += study_tables.paper_reports(ours)
        else:
            layouts = study_tables.defined(folder, study)
            record = read_record(folder / f"{study}.csv")
            reports += [study_tables.report(ours, layout, record) for layout in layouts]
    return [report for report in reports if report.tables]


def _run(study: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """A study on the page; only its name where it has no record."""
    if not record:
        return {"study": study, "facts": {}}
    return {
        "study": study,
        "description": records.description(record),
        "facts": records.facts(record),
        "cells": records.cell_rows(record),
        "config": records.config_text(record),
    }
