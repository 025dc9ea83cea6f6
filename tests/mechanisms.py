"""A mechanism with every element, for tests that go through all of them."""

from newmark_cli.mechanisms import loading

#: Two bodies on points A, B and C, and points on them.
TWO_BODIES = """\
bodies:
  one: {from: A, to: B, length: 0.5, mass: 3, centre: [0.2, 0.1], inertia: 0.5}
  two: {from: B, to: C, length: 1, mass: 4, centre: [0.5, -0.2], inertia: 0.25}
body_points:
  P: {on: one, at: [0.25, 0.3]}
  Q: {on: two, at: [0.75, -0.1]}
"""
_EVERYTHING = (
    """\
points:
  A: {fixed: [0, 0]}
  W: {fixed: [2, 2]}
  B: {at: [0.3, 0.4]}
  C: {at: [0.9, 1.2], mass: 2}
  S: {at: [1.5, 0.5], mass: 1}
"""
    + TWO_BODIES
    + """\
bars:
  fixed on bodies: {from: P, to: S, length: LENGTH}
sliders:
  rail: {point: S, through: [1, 0], direction: [1, 1]}
springs:
  spring: {from: P, to: Q, stiffness: 7, rest_length: 0.3}
dampers:
  damper: {from: W, to: Q, damping: 3}
  between: {from: P, to: C, damping: 2}
torques:
  motor: {on: two, torque: 1.5}
MOTIONS
gravity: [1, -9]
project_velocities: true
"""
)

_MOTIONS = "motions: {crank: {body: one, angle: {rate: 2, amplitude: 0.1, frequency: 5}}}"


def everything(folder, driven=True):
    """The mechanism, moving; without its law of time its constraints are quadratic in u."""
    along = (0.3 + 0.4j) / 0.5
    length = abs(1.5 + 0.5j - (0.25 + 0.3j) * along)
    text = _EVERYTHING.replace("LENGTH", repr(length)).replace(
        "MOTIONS", _MOTIONS if driven else ""
    )
    if not driven:
        text = text.replace("mass: 1}", "mass: 1, velocity: [0.5, 0.5]}")
    path = folder / "everything.yaml"
    path.write_text(text)
    return loading.load(path, "everything")
