"""The command `plot` of a study of one's own: files, sizes, styles, figures with a number."""

import own_study
import pytest
from own_study import STUDY

from newmark_cli.report.drawing import plot, sheets
from newmark_cli.report.drawing.sheets import Results
from newmark_cli.report.judging.slopes import collect


@pytest.fixture
def mine(cli):
    return own_study.run(cli)


def files(cli):
    return sorted(path.name for path in (cli.folder / "results/figures").iterdir())


def test_plot_draws_a_study_of_ones_own(mine):
    """All of it without names; by its name the same; a wrong name in one line."""
    done = mine("plot")
    stems = [f"mine-pendulum-u-lambda-{what}" for what in ("condition", "error-u")]
    expected = [f"results/figures/{stem}.png" for stem in stems]
    assert done.stdout.split() == expected
    assert "mine: not drawn: mine-pendulum-u-lambda-work-precision-u; name one" in done.stderr
    assert files(mine) == sorted(path.split("/")[-1] for path in expected)
    assert (mine.folder / "results/slopes.csv").exists()
    line = mine.refused("plot", "mime")
    assert "unknown figure or study 'mime'; did you mean 'mine'? allowed: 1, 2," in line
    mine.write("file", "")
    told = "'--results': must name a folder, and 'file' is a file"
    assert told in mine.refused("plot", "mine", "--results", "file")
    line = mine.refused("plot", "pendulum-v")
    assert "results/pendulum-v.csv: no results; run 'newmark-study run pendulum-v' first" in line


def test_formats_and_sizes(mine):
    """PDF with the same bytes each time, as large as asked for; all else is refused."""
    arguments = ("plot", "mine", "--measure", "condition", "--size", "4x3", "--format")
    mine(*arguments, "pdf,png")
    pdf, png = ((mine.folder / "results/figures" / name).read_bytes() for name in files(mine))
    mine(*arguments, "pdf")
    assert (mine.folder / "results/figures" / files(mine)[0]).read_bytes() == pdf
    assert pdf.startswith(b"%PDF")
    assert b"CreationDate" not in pdf
    assert b"/MediaBox [ 0 0 288 216 ]" in pdf
    assert [int.from_bytes(png[at : at + 4], "big") for at in (16, 20)] == [1200, 900]
    line = mine.refused("plot", "--format", "png,eps")
    assert "unknown format 'eps'; allowed: png, svg, pdf" in line
    assert "unknown format 'pgf'; it is gone: LaTeX includes pdf" in mine.refused(
        "plot", "--format", "pgf"
    )
    for size in ("x4", "0.1x3", "4x99"):
        assert f"given '{size}'" in mine.refused("plot", "mine", "--size", size)
    assert "inches has no room" in mine.refused("plot", "mine", "--size", "1x1")


def test_styles(mine):
    """Settings of a file stand over those of the project; what is none is refused in one line."""
    mine.write("wide.mplstyle", "axes.facecolor: 00ff00\nsavefig.dpi: 50\nsvg.hashsalt: x\n")
    chosen = ("plot", "mine", "--measure", "condition", "--format", "svg,png", "--style")
    mine(*chosen, "wide.mplstyle")
    first = (mine.folder / "results/figures/mine-pendulum-u-lambda-condition.svg").read_bytes()
    assert b"#00ff00" in first
    png = (mine.folder / "results/figures/mine-pendulum-u-lambda-condition.png").read_bytes()
    assert int.from_bytes(png[16:20], "big") == 175
    mine(*chosen[:-2], "svg", "--style", "wide.mplstyle")
    again = (mine.folder / "results/figures/mine-pendulum-u-lambda-condition.svg").read_bytes()
    assert first == again
    assert "--style no.mplstyle: cannot be read" in mine.refused(*chosen, "no.mplstyle")
    for text in ("no colon here\n", "axes.facecolour: red\n", "lines.linewidth: wide\n"):
        mine.write("bad.mplstyle", text)
        line = mine.refused(*chosen, "bad.mplstyle")
        assert "--style bad.mplstyle: not a style of matplotlib: " in line


def test_a_numbered_figure_of_ones_own(cli):
    """Series one by one, in panels with titles; `plot` knows it by its number."""
    cli.write(
        "mine.yaml",
        STUDY.replace("3e-2", "2e-2")
        + """\
preconditioning: [none, optimal]
evaluation: [direct, compensated]
figures:
  - figure: 7a
    title: What compensation changes
    measure: error
    quantity: [u, lambda]
    problem: pendulum
    form: u-lambda
    panels: quantity
    note: one pendulum
    curves:
      - {label: plain, panel: direct, preconditioning: none}
      - {label: best, panel: compensated, preconditioning: optimal, evaluation: compensated}
  - {measure: condition, evaluation: direct}
""".replace("preconditioning: [none, optimal]\n", "", 1),
    )
    cli("run", "mine.yaml")
    assert cli("plot", "7a", "--format", "svg").stdout == "results/figures/figure-7a.svg\n"
    given = Results(cli.folder / "results", collect(cli.folder / "results"))
    (figure,) = plot.chosen(["7a"], given).figures
    sheet = sheets.sheet(figure, given)
    assert sheet.title == "What compensation changes"
    assert sheet.heading.startswith("one pendulum")
    assert [(p.title, [t.label for t in p.traces]) for p in sheet.panels] == [
        ("u, direct", ["plain"]), ("u, compensated", ["best"]),
        ("λ, direct", ["plain"]), ("λ, compensated", ["best"]),
    ]  # fmt: skip
    assert files(cli) == ["figure-7a.svg"]
    drawn_ = plot.chosen((), given).figures
    assert [figure.name for figure in drawn_] == ["7a", "mine-pendulum-u-lambda-condition"]
