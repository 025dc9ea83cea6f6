"""What reaches a terminal, a figure, a table or a page of names that somebody made to harm."""

import csv
import json
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from each import each
from test_show import on_a_terminal

from newmark_cli.report.drawing import draw
from newmark_cli.report.drawing.panels import Panel, Sheet, Trace, look
from newmark_cli.report.drawing.style import rendered
from newmark_cli.report.judging import text
from newmark_cli.report.tables.table import markdown_table
from newmark_cli.study.results import csv_text
from newmark_cli.support.errors import one_line, visible, visible_lines

#: Moves the cursor, sets a title, rings; begins and ends lines; turns writing around.
BAD = "\x1b[2J\x1b]0;x\x07\x9b31m\r\b\x7f\u2028\u2029\x85\u202e\u200b\nfake.csv: ok"
SHOWN = (
    r"\x1b[2J\x1b]0;x\x07\x9b31m\r\x08\x7f\u2028\u2029\x85\u202e\u200b\nfake.csv: ok"
)  # fmt: skip


def test_visible():
    """What is not printed is escaped; letters of any script and wide blanks stay."""
    assert visible(BAD) == SHOWN
    assert visible_lines(f"a{BAD}\nb") == "a" + SHOWN.replace(r"\n", "\n") + "\nb"
    assert visible("Δλ ≈ 1e−3, 机构 ½\u00a0x") == "Δλ ≈ 1e−3, 机构 ½\u00a0x"
    assert visible("\udc80\U000e0001") == r"\udc80\U000e0001"
    assert one_line("a \n\u2028 b\x1b" + "x" * 2000)[:12] == r"a b\x1bxxxxx"


MECHANISM = """\
title: "t\\e[31m"
points:
  O: {fixed: [0, 0]}
  "P": {at: [1, 0], mass: 1}
bars:
  rod: {from: O, to: P, length: 1}
gravity: [0, -1]
"""


@pytest.fixture
def hostile(cli):
    """A study of a mechanism whose file, description and record are full of it."""
    name = BAD.replace("\x07", "") + ".yaml"
    cli.write(name, MECHANISM)
    config = {
        "study": "bad", "description": "d\x1b[31m\u202e", "problem": name,
        "form": "u-lambda", "preconditioning": "none", "h": [0.1, 0.05, 0.02], "t_end": 1.0,
        "measure": ["correction", "history"],
    }  # fmt: skip
    cli.write("bad.yaml", json.dumps(config))
    cli("run", "bad.yaml")
    path = cli.folder / "results/bad.json"
    record = json.loads(path.read_text())
    record["cells"][0]["reason"] = BAD
    path.write_text(json.dumps(record))
    path = cli.folder / "results/runs/bad.json"
    run = json.loads(path.read_text())
    run["versions"]["numpy" + BAD] = BAD
    run["blas"]["numpy"] = BAD
    path.write_text(json.dumps(run))
    return name


COMMANDS = (
    ("check", "--all"), ("check", "--json"), ("check", "--markdown", "--all"), ("show",),
    ("show", "bad"), ("show", "bad", "--json"), ("info", "--cells", "--config"), ("verify",),
    ("plot", "bad", "--measure", "correction", "--quantity", "u", "--format", "svg"),
    ("compare", "results", "results"), ("validate", "bad.yaml"),
    ("run", "bad.yaml", "-v", "--force"), ("run", "bad.yaml", "--dry-run"),
    ("show", "bad", "--problem", BAD), ("validate", "bad.yaml", BAD), ("plot", BAD),
    ("compare", "results", BAD), ("run", BAD + ".yaml"), ("info", "--results", BAD),
)  # fmt: skip


def test_no_command_prints_control_characters(cli, hostile):
    """Neither on stdout nor on stderr, in a pipe or on a terminal; nor a forged line."""
    for command in COMMANDS:
        done = cli.warm.run([*command], cli.folder)
        for printed in (done.stdout, done.stderr):
            assert visible_lines(printed) == printed, command
            assert "fake.csv: ok" not in printed.split("\n"), command
        assert done.stdout or done.stderr
    for command in COMMANDS[:8]:
        printed = on_a_terminal(cli, *command, columns=200)
        plain = re.sub(r"\x1b\[(31|33|0)m", "", printed)
        assert visible_lines(plain) == plain, command
    assert r"\x1b[2J" in cli("show", "bad").stdout
    assert r"d\x1b[31m\u202e" in cli("info").stdout


NAMES = ("$x^2$", "$", r"\frac{", r"$\frac{$", r"\$x$", "a_b^c{}", "<b>&amp;]]>-->", BAD)


@each("name, fits", [*((name, True) for name in NAMES), ("$x^2$", False), (BAD, False)])
def test_figures_write_names_as_they_are(name, fits):
    """In legends, titles and among the points; SVGs stay XML."""
    h = np.array([1e-3, 1e-2, 1e-1])
    trace = Trace(name, h, h, look(0), fit="1.00 ± 0.01")
    # Linear axes have fewer ticks to draw.
    titles = ("",) if fits else (name,)
    panel = Panel((trace,), "h", "y", titles, x_scale="linear", y_scale="linear")
    drawing = draw.drawn(Sheet(name, (panel,) * (1 if fits else 2), columns=2))
    texts = [drawing.get_suptitle()]
    texts += [each.get_text() for axes in drawing.axes for each in (axes.title, *axes.texts)]
    texts = [each for each in texts if each]
    texts += [entry.get_text() for entry in drawing.legends[0].get_texts()]
    shown = "".join(visible(name).split())
    assert len(texts) == (3 if fits else 6)
    for found in texts:
        begin = "".join(found.replace(r"\$", "$").split())
        assert begin.startswith(shown[:4])
        # What matplotlib would read as mathematics has an even number of bare dollar signs.
        assert found.count("$") == found.count(r"\$")
    ElementTree.fromstring(rendered(drawing, "svg"))


def test_latex_takes_names_as_text():
    """Nothing of a name is a command, a ligature of signs, or ends a line."""
    found = text.latex_text('\\input{/etc/passwd} $ % & _ # { } ~ ^ \\ < > | " `\n\n' + BAD)
    without = re.sub(r"\\(textbackslash|textasciitilde|textasciicircum|textless|textgreater"
                     r"|textbar|textasciigrave|char34)\{\}|\\[&%$#_{}]", "", found)  # fmt: skip
    assert not set(without) & set('\\{}$%&_#~^<>|"`')
    assert found.isprintable()
    assert r"\textbackslash{}input\{/etc/passwd\}" in found


def test_markdown_takes_names_as_text():
    """A cell ends where the table says; no code, no tags, no links, no emphasis."""
    row = ("a|b", "`x`", "<img src=x>", "[a](b)", "*x* _y_ a_b", "\\|", BAD)
    line = markdown_table([row]).split("\n")[0]
    assert line == (
        r"| a\|b | \`x\` | \<img src=x\> | \[a\](b) | \*x\* \_y\_ a_b | \\\| | "
        + SHOWN.replace("\\", r"\\").replace("[", r"\[").replace("]", r"\]")
        + " |"
    )


def test_the_page_shows_names_as_text(cli, committed_folder):
    """Neither markup nor a script, in texts, attributes and figures."""
    name = '"><script>alert(1)</script>' + "{{7*7}}"
    with (committed_folder / "pendulum-u.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["measure"] == "condition"]
    rows = [row | {"problem": name, "study": "mine"} for row in rows]
    cli.write("results/mine.csv", csv_text([*rows[0]], rows))
    cli("report")
    page = (cli.folder / "results/report.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;{{7*7}}" in page
