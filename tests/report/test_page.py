"""The page of `report`: what it says, and that it needs nothing but itself."""

import json
import re
import sys
from html.parser import HTMLParser

import pytest
import synthetic
from conftest import QUICK

from newmark_cli.report import page
from newmark_cli.report.judging import expectations, slopes
from newmark_cli.report.reading.figures import FIGURES
from newmark_cli.report.tables import check

VOID = {"meta", "link", "br", "img", "input", "hr"}


class Reader(HTMLParser):
    """Elements with their attributes, texts of table rows, and that all tags are closed."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.rows, self.open, self.style = [], [], [], ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        """Note an element, a row, a cell."""
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag, attrs):
        """Note an element without content."""
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        """Close what was opened last."""
        assert self.open.pop() == tag

    def handle_data(self, data):
        """Note texts of cells and styles."""
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
        if self.open and self.open[-1] == "style":
            self.style += data

    def attributes(self, tag):
        """Attributes of all elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]


#: Studies past the paper, with what the page has of any: a figure, none, and a table.
STUDIES = ("multipliers", "tolerance", "precision", "drift")
CLAIMING = [figure for figure in synthetic.CLAIMING if figure.study in STUDIES]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The studies; one has a record, with a reason that is markup."""
    path = tmp_path_factory.mktemp("results")
    for figure in CLAIMING:
        synthetic.write(path, figure)
    cell = {"problem": "pendulum", "h": 0.1, "steps": 30, "wall_seconds": 1.25}
    record = {
        "study": "precision",
        "config": {"study": "precision", "description": "a < b & c"},
        "finished": "2001-02-03T04:05:06+00:00",
        "jobs": 2,
        "cells": [
            cell | {"status": "ok"},
            cell | {"status": "failed", "reason": "<script>alert(1)</script>"},
        ],
    }
    (path / "precision.json").write_text(json.dumps(record))
    return path


@pytest.fixture(scope="module")
def text(folder):
    return page.html(folder)


@pytest.fixture(scope="module")
def read(text):
    return Reader(text)


def test_every_claim_with_its_verdict(folder, read):
    """The rows that `check` prints, slopes and claims."""
    found = slopes.collect(folder)
    for row in [
        *expectations.claim_rows(expectations.judge(folder, found)),
        *check.slope_rows(found),
    ]:
        assert list(row) in read.rows, row


def test_every_figure_is_labelled(read):
    """Title and fitted slopes, for those who do not see it."""
    labels = [attributes["aria-label"] for attributes in read.attributes("svg")]
    # Figure 18 needs time series, which are not here.
    made = [figure for figure in CLAIMING if figure.name != "18"]
    drawn = (FIGURES["6"], *made)
    found = [label.partition(".")[0] for label in labels]
    assert sorted(found) == sorted(figure.title for figure in drawn)
    assert {attributes["role"] for attributes in read.attributes("svg")} == {"img"}
    assert (
        "Δλ (physical), optimal, compensated: slope −1.00 ± 0.05, predicted −1, pass." in labels[1]
    )
    assert "share of steps, none: 0.99 at h = 0.0001, 0 at h = 1e-07." in labels[2]
    assert len(read.attributes("figure")) == len(labels)


def test_ids_are_unique_and_found(text, read):
    """Also those of clip paths and glyphs, which figures share."""
    ids = [attributes["id"] for _, attributes in read.elements if "id" in attributes]
    assert len(set(ids)) == len(ids)
    used = re.findall(r'href="#([^"]+)"', text) + re.findall(r"url\(#([^)]+)\)", text)
    assert used
    assert set(used) <= set(ids)


def test_nothing_is_loaded(text, read):
    """No script, no address; one style, for the page alone."""
    tags = {tag for tag, _ in read.elements}
    assert not tags & {"script", "iframe", "object", "embed", "img", "base", "form"}
    assert [attributes["href"] for attributes in read.attributes("link")] == ["data:,"]
    for tag, attributes in read.elements:
        for name in ("src", "href", "xlink:href", "action", "data", "srcset"):
            assert attributes.get(name, "#").startswith(("#", "data:")), (tag, attributes)
    assert len(read.attributes("style")) == 1
    assert "url(" not in read.style
    assert "@import" not in read.style
    assert "http" not in text.replace("http-equiv", "")


def test_texts_of_others_are_escaped(text, read):
    """Descriptions and reasons are text, not markup."""
    assert "a &lt; b &amp; c" in text
    assert any(
        row[-2:] == ["failed – <script>alert(1)</script>", "1.25"] for row in read.rows
    )  # fmt: skip


def test_times_are_those_of_the_runs(text):
    """The page has no time of its own; a record says when its study was finished."""
    assert "2001-02-03T04:05:06+00:00" in text
    assert "2.5 s of all cells together, 1.25 s of the slowest, 2 side by side" in text


def test_a_single_small_study(cli):
    """With figures of its own, without tables or Andrews' mechanism; in an empty folder.

    What it expects stands next to the slopes, and in the sentence above them.
    """
    text = QUICK.replace("form: u-lambda", "form: [u-lambda, v-lambda]\nmeasure: condition")
    expected = "{measure: condition, form: u-lambda, preconditioning: none, at_most: 1}"
    cli.write("quick.yaml", f"{text}expect: [{expected}]\n")
    cli("run", "quick.yaml")
    assert cli("report", "--output", "page.html").stdout == "page.html\n"
    page = cli.folder / "page.html"
    read = Reader(page.read_text())
    for told in ("Expectations of the studies", "0 of 1 expectations hold", '<p class="miss">'):
        assert told in page.read_text()
    labels = [attributes["aria-label"] for attributes in read.attributes("svg")]
    assert [label.partition(":")[0] for label in labels] == [
        "pendulum, (u, λ) form", "pendulum, (v, λ) form"
    ]  # fmt: skip
    assert {"#claims", "#figures", "#studies"} <= {
        attributes["href"] for attributes in read.attributes("a")
    }
    # All series are of one's own: none is folded away as further ones.
    assert len(read.attributes("details")) == 3
    found = slopes.collect(cli.folder / "results")
    for row in check.slope_rows(found):
        assert list(row) in read.rows
    cells = [row for row in read.rows if len(row) > 3 and row[0] == "pendulum"]
    assert [row[1:6] for row in cells] == [
        [form, variant, h, steps, "ok"]
        for form in ("u-lambda", "v-lambda")
        for variant in ("none", "optimal")
        for h, steps in (("0.1", "10"), ("0.01", "100"))
    ]
    # Another process, later, makes the same bytes.
    beside = cli.folder / "results/report.html"
    assert cli("report").stdout == "results/report.html\n"
    assert beside.read_bytes() == page.read_bytes()


def test_refusals(cli, folder, monkeypatch):
    """No results; jinja2 is not there: one line that says what to install."""
    assert "no results" in cli.refused("report")
    assert not (cli.folder / "results").exists()
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert "newmark-study[report]" in cli.refused("report", "--results", folder)
    assert not (folder / "report.html").exists()


def test_mechanisms_in_space_are_drawn(cli):
    """Results of shipped ones come with a drawing, which says which rows were dropped."""
    cli.write(
        "mine.yaml",
        "study: mine\nproblem: bricard\nform: u-lambda\npreconditioning: optimal\n"
        "measure: condition\nh: 1e-2\nsteps: 0\n",
    )
    cli("run", "mine.yaml")
    assert cli("report").stdout == "results/report.html\n"
    text = (cli.folder / "results/report.html").read_text()
    assert text.count("<figcaption>bricard: ") == 1
    assert "initial position; redundant, dropped: P5.q</figcaption>" in text
