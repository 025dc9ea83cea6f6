"""Redundant rows of mechanisms of any size: which are dropped, and where they are needed."""

import numpy as np
import pytest
import scipy.sparse
from each import each
from mechanisms import built

import newmark_cli as newmark
from newmark_cli.mechanisms import start
from newmark_cli.newmark import needed
from newmark_cli.problems import redundancy, singular
from newmark_cli.support.documents import DocumentError

DAMPED = "generalized-alpha rho=0.9"
BRICARD = newmark.problem("bricard").sources["bricard.yaml"].decode()


def four_bars(count, lean=0.2, redundant="drop"):
    """Four-bar linkages that share the ground, each in a plane of its own."""
    bodies, joints = [], []
    for i in range(count):
        axis = f"axis: [{0.1 * i}, 1, 0]"
        bodies += [
            f"  l{i}: {{position: [0, {i}, 0], mass: 1, inertia: [1, 1, 1]}}",
            f"  p{i}: {{position: [0, {i}, -1], mass: 2, inertia: [1, 2, 3]}}",
            f"  r{i}: {{position: [1, {i - 0.1 * i}, 0], mass: 1, inertia: [1, 1, 1]}}",
        ]
        for name, one, two, x, z in (
            ("A", "ground", f"l{i}", 0, 0), ("B", f"l{i}", f"p{i}", 0, -1),
            ("C", f"p{i}", f"r{i}", 1, -1 - lean), ("D", "ground", f"r{i}", 1, 0),
        ):  # fmt: skip
            at = f"at: [{x}, {i - 0.1 * i * x:g}, {z:g}]"
            joints.append(f"  {name}{i}: {{type: revolute, from: {one}, to: {two}, {at}, {axis}}}")
    lines = ["dimensions: 3", "bodies:", *bodies, "joints:", *joints]
    return "\n".join([*lines, "gravity: [0, 0, -9.81]", f"redundant: {redundant}", ""])


def test_null_space_of_a_sparse_matrix():
    """That of the singular value decomposition, whatever its size; the least value likewise."""
    random = np.random.default_rng(3)
    dense = random.normal(size=(60, 40)) * (random.random((60, 40)) < 0.2)
    dense[:, 28:40] = dense[:, :28] @ random.normal(size=(28, 12))
    dense /= np.linalg.norm(dense, axis=0)
    found = redundancy.null_space(scipy.sparse.csc_array(dense), 1e-10)
    _, values, vectors = np.linalg.svd(dense)
    assert values[27] > 1e-3
    assert values[28] < 1e-12
    np.testing.assert_allclose(found.T @ found, np.eye(12), atol=1e-12)
    np.testing.assert_allclose(found @ found.T, vectors[28:].T @ vectors[28:], atol=1e-9)
    least = redundancy.Least()
    for changed in (dense[:, :28], dense[:, 1:28] + 0.0):
        exact = np.linalg.svd(changed, compute_uv=False)[-1]
        fresh = redundancy.Least().of(scipy.sparse.csc_array(changed))
        assert fresh == pytest.approx(exact, rel=0.05)
    exact = np.linalg.svd(dense[:, :28], compute_uv=False)[-1]
    for _ in range(3):
        again = least.of(scipy.sparse.csc_array(dense[:, :28]))
    assert again == pytest.approx(exact, rel=1e-6)


@each("text", [four_bars(3), BRICARD.replace("{P5: [q]}", "drop")])
def test_large_mechanisms_drop_the_same_rows(text, monkeypatch):
    """The rule does not depend on how null vectors are found."""
    dense = built(text)
    monkeypatch.setattr(start, "DENSE_UP_TO", 10)
    sparse = built(text)
    assert dense.released
    assert sparse.released == dense.released
    assert sparse.outputs.not_unique == dense.outputs.not_unique
    assert sparse.drawing.freedom == dense.drawing.freedom == (3 if "p2" in text else 1)
    np.testing.assert_allclose(sparse.v0, dense.v0, atol=1e-12)
    with pytest.raises(DocumentError) as caught:
        built(text.replace("redundant: drop", "redundant: refuse"))
    assert str(caught.value).endswith(f"releases {', '.join(dense.released)}")


def test_large_mechanism_that_is_singular_at_the_start(monkeypatch):
    """A folded linkage loses rank there only: nothing of it is redundant."""
    flat = four_bars(1, redundant="drop").replace("at: [0, 0, -1]", "at: [0.5, 0, 0]")
    flat = flat.replace("at: [1, 0, -1.2]", "at: [2, 0, 0]")
    for size in (600, 10):
        monkeypatch.setattr(start, "DENSE_UP_TO", size)
        with pytest.raises(DocumentError, match="the start is a singular position, such"):
            built(flat)


#: Without y of P1, Bricard's first angle comes to a right one: there G has lost rank.
NEEDED = BRICARD.replace("{P5: [q]}", "{P1: [y]}")


@each("limit", [600, 10])
def test_march_ends_where_a_row_is_needed(limit, monkeypatch):
    """Found by dense factors and by sparse ones."""
    monkeypatch.setattr(needed, "_DENSE_UP_TO", limit)
    subject = built(NEEDED)
    done = newmark.march(subject, h=5e-3, t_end=1.6, integrator=DAMPED)
    assert done.status == "redundant"
    assert not done.success
    assert "released rows (P1.y) are needed at t = 1.2" in done.message
    joint = subject.outputs.joints["P0"]
    angle = joint.angle(done.u[-1].reshape(-1, 4, 3))
    assert abs(angle) == pytest.approx(np.pi / 2, abs=0.05)
    # The states on the way had rank, and the last has next to none.
    least = [singular.smallest(subject, 0.0, u) for u in done.u[[0, -2, -1]]]
    assert least[2] < 1e-2 * least[0] < least[1] * 1.5
