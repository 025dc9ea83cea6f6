"""Forces that a code may have besides a mechanism's, may lack, or may take in other axes.

Each is a function of t, u and v, of which a multiple is fitted.
"""

import contextlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from newmark_cli.codes.file_numbers import (
    LEFT_OUT,
    LOADS,
    FileNumbers,
    difference,
    interpolations,
    joined,
)
from newmark_cli.codes.minimal_coordinates import Rate
from newmark_cli.codes.truth import Force
from newmark_cli.codes.turning_bodies import gyroscopic, moments
from newmark_cli.mechanisms.joints import JOINTS
from newmark_cli.mechanisms.spatial_outputs import Connection, SpatialOutputs
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array, Mask
from newmark_cli.support.errors import InputError

#: Speed below which dry friction falls to 0, over the largest speed of the motion.
_SLIPS = 2e-3
#: How near to 1 the multiple is of what is taken in other axes.
_WHOLE = 1e-2
_AXES = "xyz"
#: Parts of a file whose forces act between two bodies, and the key of their size.
_PAIRED = {"springs": "stiffness", "dampers": "damping", "torsion_springs": "stiffness",
           "torsion_dampers": "damping", "torques": "torque"}  # fmt: skip
#: Coordinates u (n,) → directions (n, k) of generalized forces that act on one thing.
_Directions = Callable[[Array], Array]


def _always(c: float) -> bool:
    return True


@dataclass(frozen=True, eq=False)
class FurtherForce:
    """A force of which a code may have a multiple besides.

    Attributes:
        name: What it is called.
        of: Time (s), u and v → (n,) force, for a multiple of 1.
        said: Its multiple → what it is then; None of a share of what the mechanism has.
        starts: Multiples that are tried first.
        holds: Whether a multiple can be.
        last: Whether it is looked at only where no number explains.
    """

    name: str
    of: Force
    said: Callable[[float], str] | None = None
    starts: Sequence[float] = ()
    holds: Callable[[float], bool] = _always
    last: bool = False


def further_forces(
    problem: Problem, force: float, speed: float, file: FileNumbers | None
) -> Iterator[FurtherForce]:
    """What a code may have besides.

    Args:
        problem: The mechanism.
        force: Size of its forces (N).
        speed: Largest of its velocities.
        file: Its file.
    """
    for name, moment in gyroscopic(problem, file):
        yield FurtherForce(name, partial(opposite, moment), starts=(-1.0, -2.0))
    size = force / speed
    yield FurtherForce(
        "a drag −c v", lambda t, u, v: -size * v, lambda c: f"a drag −c v, c = {c * size:.3g}",
        last=True,
    )  # fmt: skip
    if file is not None:
        if file.push is not None:
            yield FurtherForce("the forces in Python", file.push, starts=(-1.0, -2.0))
        yield from _in_other_axes(problem, file)
        yield from _weights(file)
        yield from _interpolated(file)
        yield from _one_sided(problem, file)
        yield from _along_vectors(problem, file)
    for name, unit, axes, of in _places(problem, file.document if file else {}):
        yield from _pushes(name, unit, axes, of, force, speed)


def opposite(force: Force, t: float, u: Array, v: Array) -> Array:
    """A force (n,) with its sign turned."""
    return -force(t, u, v)


# -- pushes and friction ----------------------------------------------------------------------


def _pushes(
    name: str, unit: str, axes: str, of: _Directions, force: float, speed: float
) -> Iterator[FurtherForce]:
    """A constant, friction that grows with the rate, and friction that does not."""

    def constant(k: int, t: float, u: Array, v: Array) -> Array:
        return np.asarray(force * of(u)[:, k])

    def viscous(t: float, u: Array, v: Array) -> Array:
        directions = of(u)
        return np.asarray(-force / speed * directions @ (directions.T @ v))

    def dry(t: float, u: Array, v: Array) -> Array:
        directions = of(u)
        rate = directions.T @ v
        size = max(float(np.linalg.norm(rate)), 1e-300)
        share = np.tanh(size / (_SLIPS * speed)) / size
        return np.asarray(-force * share * directions @ rate)

    kind, per = ("force", "m") if unit == "N" else ("moment", "rad")
    for k, axis in enumerate(axes):
        what = f"a further {kind} on {name}{f' along {axis}' if kind == 'force' else ''}"
        what = f"{what} about {axis}" if kind == "moment" and len(axes) > 1 else what
        yield FurtherForce(what, partial(constant, k), _sized(what, force, unit), last=True)
    for what, law, size, of_rate in (
        ("viscous friction", viscous, force / speed, f"{unit} s/{per}"),
        ("dry friction", dry, force, unit),
    ):
        what = f"{what} of {name}"
        yield FurtherForce(what, law, _sized(what, size, of_rate), (), _positive, last=True)


def _sized(what: str, size: float, unit: str) -> Callable[[float], str]:
    return lambda c: f"{what}, {c * size:.4g} {unit}"


def is_whole(c: float) -> bool:
    """Whether a multiple is 1, as that of what is taken otherwise or not."""
    return abs(c - 1) < _WHOLE


def _positive(c: float) -> bool:
    return c > 0


def _places(
    problem: Problem, document: Mapping[str, Any]
) -> Iterator[tuple[str, str, str, _Directions]]:
    """What may be pushed: name, unit, axes and directions."""
    places = {name: k for k, name in enumerate(problem.coordinate_names)}
    every = np.eye(problem.n)
    spatial = isinstance(problem.outputs, SpatialOutputs)
    vector, axes = (".origin", _AXES) if spatial else ("", "xy")
    points = [name.removesuffix(f"{vector}.x") for name in places if name.endswith(f"{vector}.x")]
    for point in points:
        names = [f"{point}{vector}.{axis}" for axis in axes]
        if places.keys() >= {*names}:
            columns = [places[name] for name in names]
            yield point, "N", axes, partial(_constant, every[:, columns])
    turns = _turns_in_space(problem) if spatial else _turns(problem, document, places)
    for name, of in turns.items():
        yield name, "N m", _AXES if spatial else "z", of
    for one, other in _bearings(document, turns, spatial):
        apart = partial(_apart, turns[one], turns[other])
        yield f"{one} on {other}", "N m", _AXES if spatial else "z", apart


def _constant(directions: Array, u: Array) -> Array:
    return directions


def _apart(one: _Directions, other: _Directions, u: Array) -> Array:
    return one(u) - other(u)


def _turns_in_space(problem: Problem) -> dict[str, _Directions]:
    """Body → a moment as forces on its directors, half of moment × director on each."""
    assert isinstance(problem.outputs, SpatialOutputs)

    def turn(k: int, u: Array) -> Array:
        directions = np.zeros((len(u), 3))
        directions[12 * k : 12 * k + 12] = moments(u.reshape(-1, 4, 3)[k, 1:])
        return directions

    return {name: partial(turn, k) for k, name in enumerate(problem.outputs.bodies)}


def _turns(
    problem: Problem, document: Mapping[str, Any], places: Mapping[str, int]
) -> dict[str, _Directions]:
    """Body in the plane → a moment on its angle, or as a pair of forces on its two points."""

    def turn(ends: _Ends, u: Array) -> Array:
        x, y = _span(ends, u)
        across = np.array([-y, x]) / (x * x + y * y)
        directions = np.zeros((problem.n, 1))
        for (at, _), sign in zip(ends, (-1, 1), strict=True):
            if at is not None:
                directions[at, 0] = sign * across
        return directions

    turns: dict[str, _Directions] = {}
    for name, body in (document.get("bodies") or {}).items():
        if (angle := places.get(f"{name}.angle")) is not None:
            turns[name] = partial(_constant, np.eye(problem.n)[:, [angle]])
        elif ends := _ends(document, places, body):
            turns[name] = partial(turn, ends)
    return turns


#: Of each end of a bar or a body in the plane, its coordinates, or where it is fixed.
_Ends = Sequence[tuple[list[int] | None, Any]]


def _ends(document: Mapping[str, Any], places: Mapping[str, int], item: Mapping[str, Any]) -> _Ends:
    """Empty if one of them is neither."""
    ends: list[tuple[list[int] | None, Any]] = []
    for end in (item.get("from"), item.get("to")):
        if fixed := document["points"].get(end, {}).get("fixed"):
            ends.append((None, fixed))
        elif f"{end}.x" in places:
            ends.append(([places[f"{end}.x"], places[f"{end}.y"]], None))
    return ends if len(ends) == 2 else []


def _span(ends: _Ends, u: Array) -> Array:
    """(2,) from the first end to the second."""
    first, second = (np.array(fixed) if at is None else u[at] for at, fixed in ends)
    return np.asarray(second - first)


def _bearings(
    document: Mapping[str, Any], turns: Mapping[str, _Directions], spatial: bool
) -> list[tuple[str, str]]:
    """Pairs of bodies that turn about each other."""
    if spatial:
        joints = (document.get("joints") or {}).values()
        pairs = [(joint.get("from"), joint.get("to")) for joint in joints]
    else:
        bodies = document.get("bodies") or {}
        pairs = [
            (one, other) for one, other in itertools.combinations(bodies, 2)
            if {bodies[one].get(key) for key in ("from", "to")}
            & {bodies[other].get(key) for key in ("from", "to")}
        ]  # fmt: skip
    return [*dict.fromkeys(pair for pair in pairs if turns.keys() >= {*pair})]


# -- shares of the mechanism's forces, and terms of its equations -----------------------------


def rates(problem: Problem, document: Mapping[str, Any]) -> Iterator[Rate]:
    """Rates in which codes may write their equations."""
    if isinstance(problem.outputs, SpatialOutputs):
        yield from _of_joints(problem, problem.outputs)
        return
    places = {name: k for k, name in enumerate(problem.coordinate_names)}
    for slider in (document.get("sliders") or {}).values():
        point, along = slider.get("point"), slider.get("direction")
        if f"{point}.x" in places and not slider.get("on"):
            weights = np.zeros(problem.n)
            weights[[places[f"{point}.{axis}"] for axis in "xy"]] = along
            yield Rate(point, f"the distance of {point}", partial(_constant, weights))
    rigid = {**(document.get("bodies") or {}), **(document.get("bars") or {})}
    document = {**document, "bodies": rigid}
    turns = _turns(problem, document, places)
    for name, of in turns.items():
        yield Rate(name, f"the angle of {name}", partial(_column, of))
    for one, other in _bearings(document, turns, spatial=False):
        apart = partial(_apart, turns[other], turns[one])
        yield Rate(other, f"the angle of {other} on {one}", partial(_column, apart))


def _of_joints(problem: Problem, outputs: SpatialOutputs) -> Iterator[Rate]:
    """Rates of the angles of joints in space."""
    turns = _turns_in_space(problem)

    def weights(joint: Connection, u: Array) -> Array:
        axis = joint.sides[0].direction("n", u.reshape(-1, 4, 3))
        moments = [np.zeros((problem.n, 3)) if side.body < 0
                   else turns[outputs.bodies[side.body]](u) for side in joint.sides]  # fmt: skip
        return np.asarray((moments[1] - moments[0]) @ axis)

    for name, joint in outputs.joints.items():
        if JOINTS[joint.kind].turns:
            yield Rate(name, f"the angle of {name}", partial(weights, joint))


def _column(of: _Directions, u: Array) -> Array:
    return of(u)[:, 0]


def _one_sided(problem: Problem, file: FileNumbers) -> Iterator[FurtherForce]:
    """Forces between two bodies that act on one of them only."""
    document, mechanism = file.document, file.mechanism
    places = {name: k for k, name in enumerate(problem.coordinate_names)}
    turns = {}
    if not isinstance(problem.outputs, SpatialOutputs):
        turns = _turns(problem, document, places)
    for part, key in _PAIRED.items():
        for name, item in (document.get(part) or {}).items():
            if item.get(key) is None or isinstance(item[key], list | tuple):
                continue  # a law of the length, or what acts on one body
            # Without it, bodies would have no angle.
            lesser = file.changed([(part, name, key)], partial(_instead, LEFT_OUT))
            whole = difference(mechanism, lesser)
            ends = [item.get("from"), item.get("to") or item.get("on")]
            if turns.keys() >= {*ends} and part not in ("springs", "dampers"):
                one, other = (turns[end] for end in ends)
                shares = {end: partial(_moment_on, whole, turns[end], one, other) for end in ends}
            else:
                pushed = whole(problem.t0, problem.u0, problem.v0 + 1.0) != 0
                shares = {
                    of: partial(_share, whole, on)
                    for of, on in _owned(problem, document, ends).items() if pushed[on].any()
                }  # fmt: skip
            for of, share in shares.items() if len(shares) == 2 else ():
                yield _exactly(f"{joined((part, name))} does not act on {of}",
                               partial(opposite, share))  # fmt: skip


def _along_vectors(problem: Problem, file: FileNumbers) -> Iterator[FurtherForce]:
    """Dampers against all of the velocity between their ends, springs along no unit vector."""

    def across(damping: float, of: tuple[Array, Array], t: float, u: Array, v: Array) -> Array:
        line, rate = of[0] @ u + of[1], of[0] @ v
        along = line * (line @ rate) / (line @ line)
        return np.asarray(-damping * of[0].T @ (rate - along))

    def stretched(force: Force, of: tuple[Array, Array], t: float, u: Array, v: Array) -> Array:
        return (float(np.linalg.norm(of[0] @ u + of[1])) - 1) * force(t, u, v)

    for name, item in (file.document.get("dampers") or {}).items():
        if (line := _line(problem, item)) and isinstance(item["damping"], int | float):
            text = f"dampers.{name} against all of the velocity between its ends"
            yield _exactly(text, partial(across, item["damping"], line))
    for name, item in (file.document.get("springs") or {}).items():
        if (line := _line(problem, item)) and isinstance(item.get("stiffness"), int | float):
            path = ("springs", name, "stiffness")
            whole = difference(file.mechanism, file.changed([path], partial(_instead, LEFT_OUT)))
            text = f"springs.{name} times the vector between its ends, which is not of length 1"
            yield _exactly(text, partial(stretched, whole, line))


def _line(problem: Problem, item: Mapping[str, Any]) -> tuple[Array, Array] | None:
    """(d, n) and (d,) of the vector from an end to the other; None of ends unlike points."""
    width, found = len(problem.axes), []
    for end in (item.get("from"), item.get("to")):
        weights, offset = np.zeros((width, problem.n)), np.zeros(width)
        if place := problem.places.get(str(end)):
            weights[:, place.coordinates], offset = place.weights, place.offset
        elif end in problem.points:
            weights[:, width * problem.points.index(end) :][:, :width] = np.eye(width)
        else:
            return None
        found.append((weights, offset))
    (one, at), (other, to) = found
    return other - one, to - at


def _owned(problem: Problem, document: Mapping[str, Any], ends: Sequence[Any]) -> dict[str, Mask]:
    """Body in space, or point in the plane → which coordinates it has."""
    names = problem.coordinate_names
    if isinstance(problem.outputs, SpatialOutputs):
        return {body: np.array([name.startswith(f"{body}.") for name in names])
                for body in problem.outputs.bodies}  # fmt: skip
    return {end: np.array([name in (f"{end}.x", f"{end}.y") for name in names]) for end in ends}


def _share(whole: Force, on: Mask, t: float, u: Array, v: Array) -> Array:
    """What of a force is on some coordinates."""
    return np.where(on, whole(t, u, v), 0.0)


def _moment_on(
    whole: Force, of: _Directions, one: _Directions, other: _Directions,
    t: float, u: Array, v: Array,
) -> Array:  # fmt: skip
    """What of a moment between two bodies is on one of them."""
    apart, sign = (other(u) - one(u))[:, 0], 1 if of is other else -1
    return np.asarray(sign * of(u)[:, 0] * (apart @ whole(t, u, v)) / (apart @ apart))


# -- axes of loads ----------------------------------------------------------------------------


def _weights(file: FileNumbers) -> Iterator[FurtherForce]:
    """The weight of each mass, which goes on to have inertia."""
    mechanism = file.mechanism
    for path in file.numbers() if file.document.get("gravity") else ():
        if path[-1] == "mass":
            lighter = file.changed([path], lambda mass: LEFT_OUT * mass)
            weightless = difference(lighter, mechanism)
            yield _exactly(f"the weight of {joined(path[:-1])} left out", weightless)


def _interpolated(file: FileNumbers) -> Iterator[FurtherForce]:
    """Tables of loads that are interpolated otherwise, and linearly."""
    mechanism = file.mechanism

    def with_number(path: tuple[Any, ...], value: float) -> Problem:
        return file.changed([path], partial(_instead, value))

    def linear(table: Mapping[str, Any], rest: Force, unit: Force) -> Force:
        return lambda t, u, v: (
            np.interp(t, table["times"], table["values"]) * unit(t, u, v) - rest(t, u, v)
        )

    for path, law in _tabulated(file.document):
        name, table = joined(path), law["table"]
        none = with_number(path, 0.0)
        others = {"linear": linear(table, difference(mechanism, none),
                                   difference(with_number(path, 1.0), none))}  # fmt: skip
        given, kinds = interpolations(table)
        for kind in kinds:
            with contextlib.suppress(InputError):  # too few values, or ends of a spline
                there = (*path, "table", "interpolation")
                other = file.changed([there], partial(_instead, kind))
                others[kind] = difference(other, mechanism)
        for kind, of in others.items():
            yield _exactly(f"{name}: interpolation {kind} in place of {given}", of)


def _instead(value: Any, given: Any) -> Any:
    return value


def _tabulated(document: Mapping[str, Any]) -> Iterator[tuple[tuple[Any, ...], Mapping[str, Any]]]:
    """Paths of laws of loads that are a table and nothing besides."""
    for part, key in LOADS:
        for name, load in (document.get(part) or {}).items():
            given = load.get(key)
            items = enumerate(given) if isinstance(given, list | tuple) else ((None, given),)
            for k, law in items:
                if isinstance(law, Mapping) and law.keys() == {"table"}:
                    yield (part, name, key) if k is None else (part, name, key, k), law


def _exactly(text: str, of: Force) -> FurtherForce:
    """A change that a code has or has not."""
    return FurtherForce(text, of, lambda c: text, (1.0,), is_whole, last=True)


def _in_other_axes(problem: Problem, file: FileNumbers) -> Iterator[FurtherForce]:
    """Loads whose components are taken along a body in place of global axes, or the other way."""
    document = file.document
    mechanism = file.mechanism

    def replaced(part: str, name: str, **keys: Any) -> Problem:
        load = {**document[part][name], **keys}
        return file.make({**document, part: {**document[part], name: load}})

    def frame(name: str, of: Force, axes: str) -> FurtherForce:
        text = f"{name} in axes of {axes}" if axes != "global" else f"{name} in global axes"
        return replace(_exactly(text, of), last=False)

    spatial = isinstance(problem.outputs, SpatialOutputs)
    for name, load in (document.get("forces") or {}).items():
        zero = replaced("forces", name, force=[0.0] * (3 if spatial else 2))
        for body, turn in _frames(problem, document, load.get("at")):
            turned = partial(_turned, difference(mechanism, zero), turn)
            yield frame(f"forces.{name}", turned, body)
    for name, load in (document.get("torques") or {}).items() if spatial else ():
        if isinstance(load.get("torque"), list | tuple):
            other = "global" if load.get("frame") == "body" else "body"
            of = difference(replaced("torques", name, frame=other), mechanism)
            yield frame(f"torques.{name}", of, other if other == "global" else load["on"])


def _turned(load: Force, turn: _Directions, t: float, u: Array, v: Array) -> Array:
    """What a load is more in other axes, whose directions are rows of (k, k)."""
    axes, given = turn(u), load(t, u, v)
    whole = len(u) - len(u) % len(axes)
    turned = np.array(given)
    turned[:whole] = (given[:whole].reshape(-1, len(axes)) @ axes).ravel()
    return turned - given


def _frames(
    problem: Problem, document: Mapping[str, Any], at: Any
) -> Iterator[tuple[str, _Directions]]:
    """Bodies and bars whose axes a force at a point may be given in."""
    on = (document.get("body_points") or {}).get(at, {}).get("on", at)
    if isinstance(problem.outputs, SpatialOutputs):
        if on in problem.outputs.bodies:
            k = problem.outputs.bodies.index(on)
            yield on, lambda u: u.reshape(-1, 4, 3)[k, 1:]
        return
    places = {name: k for k, name in enumerate(problem.coordinate_names)}

    def along(ends: _Ends, u: Array) -> Array:
        x, y = _span(ends, u)
        return np.asarray(np.array([[x, y], [-y, x]]) / np.hypot(x, y))

    for part in ("bodies", "bars"):
        for name, item in (document.get(part) or {}).items():
            ends = _ends(document, places, item)
            if ends and (name == on or at in (item.get("from"), item.get("to"))):
                yield name, partial(along, ends)
