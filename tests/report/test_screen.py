"""What reaches a terminal, a figure, a table or a page of names that somebody made to harm."""

import json
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from test_show import on_a_terminal

import newmark_cli as newmark
from newmark_cli.report.drawing import draw
from newmark_cli.report.drawing.draw import drawn
from newmark_cli.report.drawing.draw_mechanism import mechanism_sheet
from newmark_cli.report.drawing.panels import Panel, Sheet, Trace, look
from newmark_cli.report.drawing.style import rendered
from newmark_cli.report.judging import text
from newmark_cli.report.tables.table import Report, Table, latex, markdown_table
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
        "measure": ["correction", "trajectory"],
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
    ("show", "bad"), ("show", "bad", "--json"), ("show", "--record"),
    ("show", "--record", "--json"),
    ("plot", "bad", "--measure", "correction", "--quantity", "u", "--format", "svg"),
    ("compare", "results", "results"), ("validate", "bad.yaml"),
    ("run", "bad.yaml", "-v", "--force"), ("run", "bad.yaml", "--dry-run"),
    ("show", "bad", "--problem", BAD), ("validate", "bad.yaml", BAD), ("plot", BAD),
    ("compare", "results", BAD), ("run", BAD + ".yaml"), ("show", "--record", "--results", BAD),
)  # fmt: skip


def test_no_command_prints_control_characters(cli, hostile):
    """Neither on stdout nor on stderr, in a pipe or on a terminal; nor a forged line."""
    for command in COMMANDS:
        done = cli.run(*command)
        for printed in (done.stdout, done.stderr):
            assert visible_lines(printed) == printed, command
            assert "fake.csv: ok" not in printed.split("\n"), command
        assert done.stdout or done.stderr
    for command in COMMANDS[:8]:
        printed = on_a_terminal(cli, *command, columns=200)
        plain = re.sub(r"\x1b\[(31|33|0)m", "", printed)
        assert visible_lines(plain) == plain, command
    assert r"\x1b[2J" in cli("show", "bad").stdout
    assert r"d\x1b[31m\u202e" in cli("show", "--record").stdout


NAMES = ("$x^2$", "$", r"\frac{", r"$\frac{$", r"\$x$", "a_b^c{}", "<b>&amp;]]>-->", BAD)


@pytest.mark.parametrize(
    ("name", "fits"), [*((name, True) for name in NAMES), ("$x^2$", False), (BAD, False)]
)
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


#: Would run, or break, a document that has it as it is.
TEX = r"$\input{/x}$ \write18{y} \$\catcode\$ ^^5cz % # } & _ ~"
#: What LaTeX prints as a sign of a text.
PRINTED = re.compile(
    r"\\(?:textbackslash|textasciitilde|textasciicircum|textless|textgreater|textbar"
    r"|textasciigrave|char34)\{\}|\\[&%$#_{}]"
)

EVIL = {
    "title": TEX,
    "points": {"O": {"fixed": [0, 0]}, r"$\input{x}$": {"at": [1, 0], "mass": 1}},
    "bars": {"rod": {"from": "O", "to": r"$\input{x}$", "length": 1}},
    "gravity": [0, -1],
}


def test_figures_take_names_as_text(cli):
    """Titles, labels, notes and names of points are no formulas, and SVGs stay XML."""
    cli.write("evil.yaml", json.dumps(EVIL))
    curve = {"label": TEX, "panel": TEX, "form": "u-lambda"}
    shown = {"measure": "correction", "quantity": "u", "problem": "evil.yaml",
             "title": TEX, "note": TEX}  # fmt: skip
    curves = [curve | {"preconditioning": name} for name in ("none", "optimal")]
    config = {
        "study": "evil", "problem": "evil.yaml", "form": "u-lambda", "h": [0.1, 0.05], "steps": 9,
        "preconditioning": ["none", "optimal"], "measure": "correction",
        "figures": [
            shown | {"figure": "one", "curves": curves[:1]},
            shown | {"figure": "two", "curves": [curves[0], curves[1] | {"panel": f"other {TEX}"}]},
            {"figure": "drawn", "kind": "mechanism", "problem": "evil.yaml", "title": TEX},
        ],
    }  # fmt: skip
    cli.write("evil-study.yaml", json.dumps(config))
    cli("run", "evil-study.yaml")
    cli("plot", "one", "two", "--format", "svg")
    written = cli.folder / "results/figures"
    evil = newmark.problem(EVIL)
    assert b"input" in rendered(drawn(mechanism_sheet(TEX, evil, evil.u0)), "svg")
    for name in ("one", "two"):
        ElementTree.parse(written / f"figure-{name}.svg")
        assert r"\input" in (written / f"figure-{name}.svg").read_text()
    line = cli.refused("plot", "drawn")
    assert "figure drawn: evil.yaml is not a shipped mechanism; 'newmark-study draw" in line


def test_long_texts_are_drawn_short():
    """A name of thousands of letters takes no longer than others, and says that it goes on."""
    h = np.array([1e-3, 1e-2])
    panels = (Panel((Trace("l" * 9000, h, h, look(0)),), "h", "y", ("p" * 9000,)),) * 2
    drawing = draw.drawn(Sheet("$" * 9000, panels))
    entry = drawing.legends[0].get_texts()[0]
    texts = [drawing.get_suptitle(), drawing.axes[0].get_title(), entry.get_text()]
    for found, letter in zip(texts, "$pl", strict=True):
        lines = found.split("\n")
        assert len(lines) > 1
        assert "".join(lines).replace("\\$", "$") == letter * 199 + "…"
        assert not any(line.replace(r"\$", "").strip("pl…") for line in lines)


def test_latex_takes_names_as_text():
    """Nothing of a name is a command, a ligature of signs, or ends a line."""
    found = text.latex_text('\\input{/etc/passwd} $ % & _ # { } ~ ^ \\ < > | " `\n\n' + BAD)
    without = PRINTED.sub("", found)
    assert not set(without) & set('\\{}$%&_#~^<>|"`')
    assert found.isprintable()
    assert r"\textbackslash{}input\{/etc/passwd\}" in found
    # Signs of a name next to signs of mathematics, and subscripts that no formula has.
    assert latex("$λ") == r"\$$\lambda$"
    assert latex("λλ$") == r"$\lambda\lambda$\$"
    assert [latex(name) for name in ("a_b_c", "_", "b_C")] == [r"a\_b\_c", r"\_", "$b_C$"]


def test_markdown_takes_names_as_text():
    """A cell ends where the table says; no code, no tags, no links, no emphasis."""
    row = ("a|b", "`x`", "<img src=x>", "[a](b)", "*x* _y_ a_b", "\\|", BAD)
    line = markdown_table([row]).split("\n")[0]
    assert line == (
        r"| a\|b | \`x\` | \<img src=x\> | \[a\](b) | \*x\* \_y\_ a_b | \\\| | "
        + SHOWN.replace("\\", r"\\").replace("[", r"\[").replace("]", r"\]")
        + " |"
    )


def test_latex_of_long_and_of_wide_tables():
    """Long ones go on under their number; letters shrink before columns wrap.

    What is wider than one of two columns takes both.
    """
    rows = tuple((f"row {i}", "−1.03 ± 0.05*") for i in range(60))
    long = Report("t", (Table("Orders", ("name", "u_1"), rows),), study="own").written("latex")
    assert long.count(r"\begin{table}") == long.count(r"\end{table}") == 2
    assert long.count(r"\label{tab:own-Orders}") == long.count(r"\addtocounter{table}{-1}") == 1
    assert long.count(r" \tabularnewline") == 60 + 2
    assert r"\caption{Orders, continued.}" in long
    assert r"row 7 & $-$1.03~$\pm$~0.05* \tabularnewline" in long
    for letters, size, columns in (
        (20, "footnotesize", "llll"), (25, "scriptsize", "llll"), (50, "tiny", "p{"),
    ):  # fmt: skip
        row = ("a " * (letters // 2),) * 4
        text = Report("t", (Table("Wide", row, (row,)),)).written("latex")
        assert rf"\{size}" in text
        assert text.count(r"\begin{table*}") == text.count(r"\end{table*}") == 1
        assert r"\begin{tabular}{@{}" + columns in text
