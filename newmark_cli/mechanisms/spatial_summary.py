"""Summary of a spatial mechanism: sizes, freedoms, ranks, inertia."""

import numpy as np

from newmark_cli.mechanisms.spatial_model import SpatialMechanism, inertias
from newmark_cli.mechanisms.spatial_outputs import SpatialOutputs
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.spelling import degrees_of_freedom

#: Bodies whose inertia is listed.
_MOST_BODIES = 20
#: Largest moment of a body, relative to others, with which a motion has no inertia.
_NO_INERTIA = 1e-13


def lines(name: str, problem: Problem) -> list[str]:
    """A valid spatial mechanism in words: the file, what to know of it, a line for each body."""
    mechanism: SpatialMechanism = problem.drawing
    n, m = problem.n, problem.m
    blocks = inertias(mechanism)
    moments = np.linalg.eigvalsh(blocks)
    largest = np.maximum(moments[:, -1:], 1e-300)
    rank = 3 * int(np.count_nonzero(moments > _NO_INERTIA * largest))
    text = [
        f"{name}: spatial mechanism, {n} coordinates, {m} constraints, "
        f"{degrees_of_freedom(n - m)}; rank of M {rank}, "
        f"of the saddle point {n + m}"
    ]
    if problem.released:
        text.append(f"  redundant, dropped: {', '.join(problem.released)}")
        assert isinstance(problem.outputs, SpatialOutputs)
        shared = ", ".join(sorted(problem.outputs.shared))
        text.append(f"  reactions that are not unique, because of that: {shared}")
    bodies = mechanism.bodies
    held = {end for joint in mechanism.joints.values() for end in (joint.from_, joint.to)}
    loose = (body for body in bodies if body not in held)
    text += [f"  warning: nothing holds {body}: no joint has it" for body in loose]
    with_points = {point.on for point in mechanism.body_points.values() if point.mass}
    for body, block in zip(list(bodies)[:_MOST_BODIES], blocks, strict=False):
        centre, tensor, origin = inertia_of(block)
        about, of_origin = _moments(tensor), _moments(origin)
        if np.any(centre):
            about = f"its centre {about}, about its origin {of_origin}"
        else:
            about = f"its centre and origin {about}"
        loaded = " with its point masses" * (body in with_points)
        text.append(f"  {body}: inertia{loaded} about {about}")
    if len(bodies) > _MOST_BODIES:
        text.append(f"  … and {len(bodies) - _MOST_BODIES} more bodies")
    return text


def inertia_of(block: Array) -> tuple[Array, Array, Array]:
    """Mass centre (m), and tensors of inertia about it and about the origin (kg m²).

    Args:
        block: (4, 4) one of `inertias`.

    Returns:
        (3,), (3, 3), (3, 3) in body axes.
    """
    mass, first, euler, one = block[0, 0], block[0, 1:], block[1:, 1:], np.eye(3)
    centre = first / (mass or 1.0)
    origin = np.trace(euler) * one - euler
    about = origin - mass * ((centre @ centre) * one - np.outer(centre, centre))
    return centre, about, origin


def _moments(tensor: Array) -> str:
    text = f"[{', '.join(f'{moment:.6g}' for moment in np.diag(tensor))}]"
    products = tensor[np.triu_indices(3, 1)]
    if np.abs(products).max() > 1e-14 * np.abs(tensor).max():
        text += f" xy, xz, yz [{', '.join(f'{product:.6g}' for product in products)}]"
    return f"{text} kg m²"
