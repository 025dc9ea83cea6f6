"""Figures drawn by several processes are those that one draws."""

import dataclasses

import numpy as np
import pytest
from each import each

from newmark_cli.report.drawing import rendering
from newmark_cli.report.drawing.panels import Panel, Sheet, Trace, look
from newmark_cli.support.errors import InputError


def sheet(exponent):
    """A line; linear axes have fewer ticks to draw."""
    h = np.array([1e-3, 1e-2, 1e-1])
    trace = Trace("λ", h, h**exponent, look(0))
    panel = Panel((trace,), "h", "Δ", x_scale="linear", y_scale="linear")
    return Sheet("", (panel,))


#: Few dots make small files.
COARSE = {"savefig.dpi": 50}

SHEETS = [sheet(exponent) for exponent in range(6)]


@pytest.fixture(scope="module")
def one():
    """Files of all sheets, drawn by this process."""
    return rendering.rendered(SHEETS, ("png", "svg"), None, COARSE, processes=1)


def test_the_same_files_in_the_same_order(one, monkeypatch):
    """Every other figure comes from another process, and this one draws none of those."""
    here, files = [], rendering._files
    monkeypatch.setattr(rendering, "_files", lambda *given: here.append(given) or files(*given))
    two = rendering.rendered(SHEETS, ("png", "svg"), None, COARSE, processes=2)
    assert one == two
    assert [given[0] for given in here] == SHEETS[::2]
    assert len({files["svg"] for files in one}) == 6
    assert all(files["png"].startswith(b"\x89PNG") for files in one)


def test_what_cannot_be_handed_on_is_drawn_here(one):
    """A sheet with something that pickle does not take."""
    odd = [*SHEETS[:5], dataclasses.replace(SHEETS[5], settings={"font.size": Odd(9)})]
    found = rendering.rendered(odd, ("svg",), None, COARSE, processes=2)
    plain = [{"svg": files["svg"]} for files in one]
    assert found[:5] == plain[:5]
    assert found[5] != plain[5]


class Odd(float):
    """A number that pickle refuses."""

    def __reduce_ex__(self, protocol):
        raise TypeError("not to be pickled")


@each("processes", [1, 2])
def test_one_error(processes):
    """A size that leaves no room is refused alike, wherever it is found out."""
    with pytest.raises(InputError, match="no room"):
        rendering.rendered(SHEETS, ("png",), (0.1, 0.1), {}, processes)
