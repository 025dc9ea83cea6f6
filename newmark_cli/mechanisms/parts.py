"""Parts of planar mechanisms: one record each, of all that tells one from another.

What a file says of a part is its model (`newmark_cli.mechanisms.models`), a field of
`Mechanism` by its key.  The rest is a `Part` in `PARTS`: its equation, how it becomes rows
of the element tables, what it looks like, whether it conserves energy.  The rows are of
kinds that the loop of `newmark_cli.mechanisms.elements` knows; most parts need no new one.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from newmark_cli.mechanisms import laws
from newmark_cli.mechanisms.models import (
    GROUND,
    AngleJoint,
    Bar,
    Damper,
    Force,
    Gear,
    Law,
    Mechanism,
    Motion,
    PythonForce,
    Rolling,
    Slider,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
)

if TYPE_CHECKING:
    from newmark_cli.mechanisms.planar import Builder
    from newmark_cli.support.documents import KeyPath

#: The constant vector (1, 0), as if it were a fixed point.
UNIT = "\0"

#: Largest misfit of a start, relative to the length it is a misfit of: data are rounded.
MISFIT = 1e-12


def _always(part: Any) -> bool:
    return True


def _one_row(part: Mapping[str, Any]) -> int:
    return 1


def _no_row(part: Mapping[str, Any]) -> int:
    return 0


@dataclass(frozen=True)
class Part:
    """A kind of part.

    Attributes:
        key: Its key in a mechanism file, and field of `Mechanism`.
        about: What it is and its equation, for the docs.
        build: (builder, model, path) → adds its rows to the tables.
        rows: Constraints of one, from what the file says of it; angles that become
            coordinates bring one more each.
        conserves: Whether one conserves energy.
    """

    key: str
    about: str
    build: Callable[["Builder", Any, "KeyPath"], None]
    rows: Callable[[Mapping[str, Any]], int] = _no_row
    conserves: Callable[[Any], bool] = _always


# -- between two points ---------------------------------------------------------------------


def _bar(builder: "Builder", bar: Bar, path: "KeyPath") -> None:
    builder.distance(bar.from_, bar.to, bar.length, path)


def _spring(builder: "Builder", spring: Spring, path: "KeyPath") -> None:
    difference = builder.difference(spring.from_, spring.to, path)
    builder.on_vector("SPRING", difference, (spring.stiffness, spring.rest_length))


def _damper(builder: "Builder", damper: Damper, path: "KeyPath") -> None:
    difference = builder.difference(damper.from_, damper.to, path)
    builder.on_vector("DAMPER", difference, (damper.damping,))


# -- on lines -------------------------------------------------------------------------------


def _slider(builder: "Builder", slider: Slider, path: "KeyPath") -> None:
    if slider.on is not None:
        towards, arm = builder.on_line(slider.point, slider, path)
        off = (builder.vector(towards).conjugate() * builder.vector(arm)).imag
        builder.require_on_line(slider.point, off, abs(builder.vector(arm)), path)
        builder.pair(towards, arm, (), path)
        return
    direction = complex(*slider.direction) / abs(complex(*slider.direction))
    normal = 1j * direction
    site = builder.moving_site(slider.point, (*path, "point"))
    through = complex(*slider.through)
    level = (normal.conjugate() * through).real
    away = (normal.conjugate() * builder.vector(site)).real - level
    builder.require_on_line(slider.point, away, abs(through), path)
    builder.line(site, normal, path, (level,))


# -- laws of time ---------------------------------------------------------------------------


def _motion(builder: "Builder", motion: Motion, path: "KeyPath") -> None:
    if motion.point is not None:
        site = builder.moving_site(motion.point, (*path, "point"))
        place = builder.vector(site)
        for key, law, normal in (("x", motion.x, 1 + 0j), ("y", motion.y, 1j)):
            if law is not None:
                now = place.real if key == "x" else place.imag
                with builder.checked():
                    parameters = builder.fitting(law, now, (*path, key))
                    builder.line(site, normal, (*path, key), parameters, law)
    elif motion.slider is not None:
        assert motion.distance is not None
        sliders = builder.mechanism.sliders
        if motion.slider not in sliders:
            raise builder.unknown("slider", motion.slider, (*path, "slider"), sliders)
        slider = sliders[motion.slider]
        along, away = builder.on_line(slider.point, slider, ("sliders", motion.slider))
        now = (builder.vector(along).conjugate() * builder.vector(away)).real
        # D × Δ with −iD in place of D is D · Δ.
        turned = {name: -1j * weight for name, weight in along.items()}
        parameters = builder.fitting(motion.distance, now, (*path, "distance"))
        driven = (*path, "distance")
        builder.pair(turned, away, (), driven, parameters, motion.distance)
    else:
        assert motion.body is not None
        assert motion.angle is not None
        body = builder.body(motion.body, (*path, "body"))
        driven = (*path, "angle")
        if motion.relative_to is not None:
            angles = builder.relative(
                motion.relative_to, motion.body, path, ("relative_to", "body")
            )
            now = builder.sum_of(angles)
            first, *others = builder.fitting(motion.angle, now, driven, 2 * math.pi)
            # The law may begin some turns away from the coordinates.
            turns = round((now - laws.begin(motion.angle, first)) / (2 * math.pi))
            parameters = (first + 2 * math.pi * turns, *others)
            builder.pair({}, {}, angles, driven, parameters, motion.angle)
            return
        difference = builder.difference(body.from_, body.to, path)
        vector = builder.vector(difference)
        now = math.atan2(vector.imag, vector.real)
        parameters = builder.fitting(motion.angle, now, driven, 2 * math.pi)
        timed = (laws.Timed(motion.angle, parameters),)
        builder.angular("ANGLE", difference, driven, parameters=parameters, timed=timed)


def _torque(builder: "Builder", torque: Torque, path: "KeyPath") -> None:
    ends = [(torque.on, "on", 1.0)]
    if torque.from_ is not None:
        ends.append((torque.from_, "from", -1.0))
        if torque.from_ == torque.on:
            raise builder.document.error((*path, "from"), f"must be another body than {torque.on}")
    for name, key, sign in ends:
        with builder.checked():
            body = builder.body(name, (*path, key))
            difference = builder.difference(body.from_, body.to, path)
            if isinstance(torque.torque, Law):
                timed = laws.Timed(torque.torque, torque.torque.parameters(), 0, sign)
                builder.on_vector("TORQUE", difference, (0.0,), (timed,))
            else:
                builder.on_vector("TORQUE", difference, (sign * torque.torque,))


def _conserving_torque(torque: Torque) -> bool:
    return not isinstance(torque.torque, Law) and torque.torque == 0


def _force(builder: "Builder", force: Force, path: "KeyPath") -> None:
    site = builder.moving_site(force.at, (*path, "at"))
    for law, given, normal in zip(
        force.amounts, force.force, ((1.0, 0.0), (0.0, 1.0)), strict=True
    ):
        if given != 0:
            six = law.parameters()
            builder.on_vector("FORCE", site, (*normal, *six), (laws.Timed(law, six),))


def _conserving_force(force: Force) -> bool:
    return not any(law.moves for law in force.amounts)


# -- of angles ------------------------------------------------------------------------------


def _torsion_spring(builder: "Builder", spring: TorsionSpring, path: "KeyPath") -> None:
    angles = builder.relative(spring.from_, spring.to, path)
    counted = builder.sum_of(angles)
    rest = counted
    if spring.rest_angle is not None:
        # The file counts from an angle within ±π, the coordinates perhaps from another turn.
        turns = round(counted / (2 * math.pi))
        rest = spring.rest_angle + 2 * math.pi * turns
    builder.twist(angles, rest, spring.stiffness, 0.0)


def _torsion_damper(builder: "Builder", damper: TorsionDamper, path: "KeyPath") -> None:
    builder.twist(builder.relative(damper.from_, damper.to, path), 0.0, 0.0, damper.damping)


def _angle_joint(builder: "Builder", joint: AngleJoint, path: "KeyPath") -> None:
    if joint.from_ == joint.to:
        raise builder.document.error((*path, "to"), f"joins {joint.to} with itself")
    end = builder.direction(joint.to, (*path, "to"))
    start = builder.direction(joint.from_, (*path, "from"))
    turn = builder.vector(end) / builder.vector(start)
    now = math.atan2(turn.imag, turn.real)
    angle = now if joint.angle is None else joint.angle
    away = math.remainder(angle - now, 2 * math.pi)
    if not builder.mechanism.assemble and abs(away) > 1e-9:
        raise builder.document.error(
            path,
            f"{joint.to} starts at {now:.12g} rad to {joint.from_}, given {angle:g}; correct the "
            "positions or set 'assemble: true'",
        )
    turned = complex(math.cos(angle), math.sin(angle))
    builder.pair({name: turned * weight for name, weight in start.items()}, end, (), path)


def _gear(builder: "Builder", gear: Gear, path: "KeyPath") -> None:
    found = [(builder.angle(gear.to, (*path, "to")), 1.0)]
    found.append((builder.angle(gear.from_, (*path, "from")), -gear.ratio))
    # Relative to a carrier that turns by ψ: θ_b − ψ = ratio (θ_a − ψ), Willis' equation.
    if gear.on is not None and gear.ratio != 1:
        found.append((builder.angle(gear.on, (*path, "on")), gear.ratio - 1.0))
    builder.pair({}, {}, tuple(found), path, (builder.sum_of(tuple(found)),))


def _rolling(builder: "Builder", rolling: Rolling, path: "KeyPath") -> None:
    body = builder.body(rolling.wheel, (*path, "wheel"))
    centre = rolling.centre or body.from_
    centre_key = "wheel" if rolling.centre is None else "centre"
    radius = rolling.radius
    if rolling.line is not None:
        along, away = builder.on_line(centre, rolling.line, (*path, "line"), (*path, centre_key))
        start, arm = builder.vector(along), builder.vector(away)
        off = (start.conjugate() * arm).imag
        side = math.copysign(1.0, off)
        builder.require_contact(rolling.wheel, abs(off), radius, abs(arm), path)
        builder.pair(along, away, (), (*path, "contact"), (side * radius,))
        # The place along the line and the turn relative to it: no slip on either side of it.
        angles = [(builder.angle(rolling.wheel, (*path, "wheel")), side * radius)]
        if rolling.line.on is not None:
            angles.append((builder.angle(rolling.line.on, (*path, "line", "on")), -side * radius))
        turned = {name: -1j * weight for name, weight in along.items()}
        now = (start.conjugate() * arm).real + builder.sum_of(tuple(angles))
        builder.pair(turned, away, tuple(angles), (*path, "rolling"), (now,))
        return
    circle = rolling.circle
    assert circle is not None
    signed = -radius if circle.inside else radius
    difference = builder.difference(circle.centre, centre, path, ("circle", centre_key))
    distance = circle.radius + signed
    builder.require_contact(
        rolling.wheel, abs(builder.vector(difference)), distance, distance, path
    )
    builder.distance(circle.centre, centre, distance, (*path, "contact"), checked=True)
    # (R ± r) ψ = R θ of the circle ± r θ of the wheel, ψ the angle of the line of centres.
    name = ".".join(map(str, (*path, "angle")))
    angles = [(builder.angle_of(difference, (*path, "angle"), name), distance)]
    angles.append((builder.angle(rolling.wheel, (*path, "wheel")), -signed))
    if circle.body is not None:
        angles.append((builder.angle(circle.body, (*path, "circle", "body")), -circle.radius))
    now = builder.sum_of(tuple(angles))
    builder.pair({}, {}, tuple(angles), (*path, "rolling"), (now,))


def _python_force(builder: "Builder", force: PythonForce, path: "KeyPath") -> None:
    builder.push(force.python, force.on, path)


def _rows_of_motion(motion: Mapping[str, Any]) -> int:
    return sum(key in motion for key in ("x", "y", "angle", "distance"))


def _rows_of_rolling(rolling: Mapping[str, Any]) -> int:
    return 2


#: Parts by key, in the order of their rows, after bodies and masses.
PARTS: Mapping[str, Part] = MappingProxyType(
    {
        part.key: part
        for part in (
            Part(
                "bars", "a constant distance: ½ (|Δ|² − L²) = 0", _bar, _one_row
            ),
            Part(
                "springs", "a force along Δ: k (|Δ| − L)", _spring
            ),
            Part(
                "sliders", "a point on a line: n·Δ = 0 from a point of the line; on a body "
                "d × Δ = 0, with d and the point fixed in the body", _slider, _one_row
            ),
            Part(
                "motions", "a law of time: x − x(t) = 0, y − y(t) = 0; n(t)·Δ = 0 with the normal "
                "of angle(t); θ_b − θ_a − angle(t) = 0; d·Δ − distance(t) = 0", _motion,
                _rows_of_motion,
                conserves=lambda motion: not any(law.moves for law in motion.laws.values()),
            ),
            Part(
                "dampers", "a force along Δ: c |Δ|'", _damper,
                conserves=lambda damper: damper.damping == 0
            ),
            Part(
                "torques", "a torque τ(t) on a body, the opposite one on another", _torque,
                conserves=_conserving_torque
            ),
            Part(
                "forces", "a force F(t) at a point", _force, conserves=_conserving_force
            ),
            Part(
                "torsion_springs", "a torque k (θ_b − θ_a − φ)", _torsion_spring
            ),
            Part(
                "torsion_dampers", "a torque c (θ_b' − θ_a')", _torsion_damper,
                conserves=lambda damper: damper.damping == 0
            ),
            Part(
                "angle_joints", "a constant angle: (Δ_a turned by φ) × Δ_b = 0", _angle_joint,
                _one_row,
            ),
            Part(
                "gears", "turns in a ratio, counted from the start: θ_b − ψ = i (θ_a − ψ), with ψ "
                "of the carrier", _gear, _one_row
            ),
            Part(
                "rolling", "contact and rolling without slip: d × Δ = ±r and d·Δ ± r (θ − ψ) "
                "constant on a line; |Δ| = R ± r and (R ± r) ψ − R θ_b ∓ r θ constant on a circle",
                _rolling, _rows_of_rolling
            ),
            Part(
                "python_forces", "forces F(P, P', t) on points, from a function in Python",
                _python_force, conserves=lambda force: False,
            ),
        )
    }
)  # fmt: skip


def conserves(mechanism: Mechanism) -> bool:
    """Whether energy is conserved: nothing damps, drives or moves by a law of time."""
    return all(
        part.conserves(one)
        for key, part in PARTS.items()
        for one in getattr(mechanism, key).values()
    )


def is_ground(name: str, mechanism: Mechanism) -> bool:
    """Whether what parts of angles name is the ground, and no body of that name."""
    return name == GROUND and name not in mechanism.bodies
