"""Moments of inertia of bodies that turn: ω × J ω left out, and J in axes that are at rest.

Moments are forces on the directors of a body: half of moment × director on each.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from newmark_cli.codes.file_numbers import FileNumbers
from newmark_cli.codes.truth import Force
from newmark_cli.mechanisms.spatial_outputs import SpatialOutputs, angular_velocities
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array


def gyroscopic(problem: Problem, file: FileNumbers | None) -> Iterator[tuple[str, Force]]:
    """ω × J ω, with J about centres of mass, or about the point that holds a single body."""
    name, bodies = "the gyroscopic moment ω × J ω", _bodies(problem)
    for where, tensors in _inertias(problem, file):
        yield f"{name}{where}", partial(_moment, tensors)
    for k, body in enumerate(bodies if len(bodies) > 1 else ()):
        tensors = _tensors(problem, None)
        only = np.where(np.arange(len(tensors)) == k, tensors.T, 0.0).T
        yield f"{name} of {body}", partial(_moment, only)


def unturned(problem: Problem, file: FileNumbers | None) -> Iterator[tuple[str, "Unturned"]]:
    """J that does not turn with the bodies, by name: as at the start, and with or without ω × J ω.

    Codes that never turn J write J₀ ω′ + ω × J₀ ω, or only J₀ ω′, in axes at rest.
    """
    for where, tensors in _inertias(problem, file):
        axes = problem.u0.reshape(-1, 4, 3)[:, 1:]
        at_start = axes.swapaxes(1, 2) @ tensors @ axes
        of = {"as at the start": at_start, "its numbers those of global axes": tensors}
        if np.allclose(at_start, tensors, atol=1e-9 * np.abs(tensors).max()):
            del of["its numbers those of global axes"]
        for name, at_rest in of.items():
            text = f"J{where} that does not turn with the bodies, {name}"
            yield text, Unturned(tensors, at_rest, True)
            yield f"{text}, without ω × J ω", Unturned(tensors, at_rest, False)


@dataclass(frozen=True, eq=False)
class Unturned:
    """What equations have besides whose J is at rest."""

    tensors: Array  #: (bodies, 3, 3) J in axes of the bodies
    at_rest: Array  #: (bodies, 3, 3) J in axes at rest
    gyroscopic: bool  #: whether they have ω × J ω

    def mass(self, t: float, u: Array) -> Array:
        """(n, n) further part of M."""
        axes = u.reshape(-1, 4, 3)[:, 1:]
        more = self.at_rest - axes.swapaxes(1, 2) @ self.tensors @ axes
        matrix = np.zeros((len(u), len(u)))
        for k, of in enumerate(axes):
            turned = moments(of)
            matrix[12 * k : 12 * k + 12, 12 * k : 12 * k + 12] = turned @ more[k] @ turned.T
        return matrix

    def force(self, t: float, u: Array, v: Array) -> Array:
        """(n,) further force: ω × J ω less ω × J₀ ω."""
        right = _moment(self.tensors, t, u, v)
        if not self.gyroscopic:
            return right
        axes = u.reshape(-1, 4, 3)[:, 1:]
        return right - _moment(axes @ self.at_rest @ axes.swapaxes(1, 2), t, u, v)


def moments(axes: Array) -> Array:
    """(12, 3) forces on a body's origin and directors (3, 3) that are a moment about each axis."""
    pushed = np.zeros((4, 3, 3))
    pushed[1:] = np.cross(np.eye(3)[None], axes[:, None]).swapaxes(1, 2) / 2
    return pushed.reshape(12, 3)


def _bodies(problem: Problem) -> Sequence[str]:
    outputs = problem.outputs
    spatial = isinstance(outputs, SpatialOutputs) and 0 < problem.n == 12 * len(outputs.bodies)
    return outputs.bodies if isinstance(outputs, SpatialOutputs) and spatial else ()


def _inertias(problem: Problem, file: FileNumbers | None) -> Iterator[tuple[str, Array]]:
    """J about centres, and about the joint of a single body, and where that is."""
    if not (bodies := _bodies(problem)):
        return
    yield "", _tensors(problem, None)
    joints = [*((file.document.get("joints") or {}).values() if file else ())]
    if len(bodies) == len(joints) == 1 and (at := joints[0].get("at")):
        if isinstance(at, Mapping):  # in axes of the body
            origin, *axes = problem.u0.reshape(4, 3)
            at = origin + np.array(at[bodies[0]]) @ axes
        yield " about the joint", _tensors(problem, at)


def _tensors(problem: Problem, point: Sequence[float] | None) -> Array:
    """(bodies, 3, 3) J in axes of the bodies, about their centres or about a point at the start."""
    bodies = problem.n // 12
    blocks = np.asarray(problem.M)[::3, ::3].reshape(bodies, 4, bodies, 4)
    tensors = []
    for k, body in enumerate(problem.u0.reshape(-1, 4, 3)):
        block = blocks[k, :, k, :]  # ∫ (1, x) (1, x)ᵀ dm
        about = block[0, 1:] / block[0, 0] if point is None else body[1:] @ (point - body[0])
        shift = np.vstack([-about, np.eye(3)])
        euler = shift.T @ block @ shift
        tensors.append(np.trace(euler) * np.eye(3) - euler)
    return np.array(tensors)


def _moment(tensors: Array, t: float, u: Array, v: Array) -> Array:
    """(n,) the moments ω × J ω as forces on directors: half of moment × director on each."""
    axes, rates = u.reshape(-1, 4, 3)[:, 1:], v.reshape(-1, 4, 3)[:, 1:]
    pushed = np.zeros((len(tensors), 4, 3))
    for k, omega in enumerate(angular_velocities(axes, rates)):
        moment = np.cross(omega, (tensors[k] @ (axes[k] @ omega)) @ axes[k])
        pushed[k, 1:] = np.cross(moment, axes[k]) / 2
    return pushed.ravel()
