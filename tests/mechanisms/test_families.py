"""Mechanisms of any size: starts, motion, and what they are at their smallest."""

import numpy as np
import pytest

from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.spec import Sized
from newmark_cli.problems.index_1 import Index1
from newmark_cli.support.documents import Document


def member(family, size):
    return Sized(family, tuple((name, size) for name in FAMILIES[family].parameters))


@pytest.mark.parametrize("spec", [member(family, size) for family in FAMILIES for size in (1, 4)])
def test_a_member_is_the_mechanism_that_its_data_say(spec):
    """What is built without a look at each part is what a file of the same data is read as."""
    found, data = spec.load(), FAMILIES[spec.family].mechanism(**dict(spec.sizes))
    expected = loading.built(spec.label, Document(spec.label, data, {}))
    assert found.content == expected.content
    assert found.coordinate_names == expected.coordinate_names
    assert found.constraint_names == expected.constraint_names
    assert found.points == expected.points
    assert found.drawing == expected.drawing


@pytest.mark.parametrize("links", [1, 400])
def test_chain_starts_across_its_line(links):
    """Released from a straight line the masses fall across it, hung by their weights along it."""
    subject = member("chain", links).load()
    a, multipliers = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    across = -0.8 * np.array([0.6, 0.8])
    np.testing.assert_allclose(a.reshape(-1, 2), np.tile(across, (links, 1)), atol=1e-12 * links)
    carried = -0.6 * np.arange(links, 0, -1)
    np.testing.assert_allclose(multipliers, carried, rtol=1e-9)


def test_random_chain_is_well_conditioned_at_any_length():
    """cond(GᵀM⁻¹G), which a straight chain's length squares; a shorter one is its beginning."""
    condition = {}
    for family in ("random-chain", "chain"):
        for links in (30, 300):
            subject = member(family, links).load()
            g = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(links)).G
            condition[family, links] = np.linalg.cond(g.T @ np.linalg.solve(subject.M, g))
    assert condition["random-chain", 300] < 3 * condition["random-chain", 30] < 300
    assert condition["chain", 300] > 50 * condition["chain", 30]
    short, long = member("random-chain", 30).load(), member("random-chain", 300).load()
    np.testing.assert_array_equal(short.u0, long.u0[:60])
    np.testing.assert_array_equal(short.M, long.M[:60, :60])


@pytest.mark.parametrize("windows", [1, 200])
def test_four_bars_move_as_one_rod(windows):
    """All rods stay parallel: θ'' of the one degree of freedom, whatever the number of windows."""
    subject = member("four-bars", windows).load()
    a, _ = Index1(subject).accelerations(0.0, subject.u0, subject.v0)
    # Upright, θ' = 1: the top is drawn inward by θ'², and gravity has no lever.
    np.testing.assert_allclose(a.reshape(-1, 2), np.tile([0.0, -1.0], (windows + 1, 1)), atol=1e-10)
    couplers, rods = windows, windows + 1
    kinetic = subject.v0 @ subject.M @ subject.v0 / 2
    assert kinetic == pytest.approx((rods / 3 + couplers) / 2, rel=1e-12)
    weight = subject.evaluate(0.0, subject.u0, subject.v0, np.zeros(subject.m)).force
    assert weight.sum() == pytest.approx(-9.81 * (rods / 2 + couplers), rel=1e-12)


def test_forces_in_a_net():
    """What the ground gives and the weight together move the mass centre of all bars."""
    net = Sized("spatial-grid", (("rows", 4), ("columns", 5))).load()
    a, multipliers = Index1(net).accelerations(0.0, net.u0, net.v0)
    values = net.outputs.values(net, 0.0, net.u0, net.v0, multipliers)
    found = dict(zip(net.outputs.names, values, strict=True))
    hung = np.array([[found[f"hang1.{j}.force.{c}"] for c in "xyz"] for j in range(1, 6)])
    bars = net.n // 12
    centres = a.reshape(-1, 12)[:, :3]
    np.testing.assert_allclose(
        centres.sum(axis=0) - hung.sum(axis=0), [0, 0, -bars], atol=1e-10 * bars
    )
    # The outer columns carry half as many ties.
    assert hung[0] @ hung[0] < hung[1] @ hung[1]
    assert np.abs(hung[0]).max() > 0.1
