"""Summary of a spatial mechanism: sizes, freedoms, ranks, inertia."""

import numpy as np

from newmark_cli.mechanisms.spatial import SpatialModel
from newmark_cli.mechanisms.spatial_model import Body
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array

#: Bodies whose inertia is listed.
_MOST_BODIES = 20


def lines(name: str, problem: Problem) -> list[str]:
    """A valid spatial mechanism in words: the file, what to know of it, a line for each body.

    Args:
        name: How the first line names it.
        problem: The problem.
    """
    model: SpatialModel = problem.drawing
    n, m, free = problem.n, problem.m, model.freedom
    found = [
        f"{name}: spatial mechanism, {n} coordinates, {m} constraints, "
        f"{free} freedom{'s' * (free != 1)}; rank of M {model.mass_rank}, "
        f"of the saddle point {n + m}"
    ]
    if problem.released:
        found.append(f"  redundant, dropped: {', '.join(problem.released)}")
        shared = ", ".join(sorted(model.shared))
        found.append(f"  reactions that are not unique, because of that: {shared}")
    found += [f"  warning: nothing holds {body}: no joint has it" for body in model.loose]
    bodies = model.mechanism.bodies
    for body in list(bodies)[:_MOST_BODIES]:
        about, of_origin = map(_moments, (bodies[body].tensor, about_origin(bodies[body])))
        if any(bodies[body].centre):
            about = f"its centre {about}, about its origin {of_origin}"
        else:
            about = f"its centre and origin {about}"
        found.append(f"  {body}: inertia about {about}")
    if len(bodies) > _MOST_BODIES:
        found.append(f"  … and {len(bodies) - _MOST_BODIES} more bodies")
    return found


def about_origin(body: Body) -> Array:
    """(3, 3) tensor of inertia of a body about its origin, in body axes (kg m²)."""
    centre = np.array(body.centre)
    steiner = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    return np.asarray(body.tensor + body.mass * steiner)


def _moments(tensor: Array) -> str:
    text = f"[{', '.join(f'{moment:.6g}' for moment in np.diag(tensor))}]"
    products = tensor[np.triu_indices(3, 1)]
    if np.abs(products).max() > 1e-15 * np.abs(tensor).max():
        text += f" xy, xz, yz [{', '.join(f'{product:.6g}' for product in products)}]"
    return f"{text} kg m²"
