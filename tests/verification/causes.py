"""Score of what `judge` says of foreign codes, with and without faults: run it by hand.

    python tests/verification/causes.py [word of a name ...]

Mechanisms and codes are those of this file.  A code takes M, f, G and Φ of a problem, which may
differ from the one that its user describes, and marches by itself.  Printed are the tables whose
cause was not named rightly, and the score:

- right: the cause is named, and no other; misnamed: another one is; seen: something is said to be
  wrong, without a cause; missed: nothing is;
- of sound codes, accused: a fault is found;
- number: of tables with one number changed, how often it alone is named, with its value to 1 %.
"""

import copy
import itertools
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.integrate import solve_ivp

import newmark_cli as newmark

MECHANISMS: dict[str, dict[str, Any]] = yaml.safe_load("""
crane:  # a trolley on a spring, with a load that hangs from it
  points:
    W: {fixed: [-1.2, 0]}
    T: {at: [0, 0], mass: 2.5, velocity: [0.6, 0]}
    L: {at: [0.48, -0.64], mass: 0.9, velocity: [1.4, 0.6]}
  bars: {rope: {from: T, to: L, length: 0.8}}
  sliders: {rail: {point: T, through: [0, 0], direction: [1, 0]}}
  springs: {buffer: {from: W, to: T, stiffness: 45, rest_length: 1.1}}
  dampers: {oil: {from: W, to: T, damping: 1.5}}
  gravity: [0, -9.81]
triple:
  points:
    O: {fixed: [0, 0]}
    A: {at: [0.5, 0], mass: 1.1, velocity: [0, 0.5]}
    B: {at: [0.9, 0.3], mass: 0.8, velocity: [0.3, 0.1]}
    C: {at: [1.3, 0.3], mass: 0.6, velocity: [0.3, -0.9]}
  bars:
    a: {from: O, to: A, length: 0.5}
    b: {from: A, to: B, length: 0.5}
    c: {from: B, to: C, length: 0.4}
  gravity: [0, -9.81]
  project_velocities: true
rocker:  # two bodies and a motor
  points:
    O: {fixed: [0, 0]}
    A: {at: [0.2, 0.15], velocity: [-0.45, 0.6]}
    B: {at: [0.6, 0.45], velocity: [-0.45, 0.6]}
  bodies:
    lever: {from: O, to: A, length: 0.25, mass: 0.7, centre: [0.11, 0.02], inertia: 0.004}
    arm: {from: A, to: B, length: 0.5, mass: 1.3, centre: [0.22, -0.03], inertia: 0.03}
  torques: {motor: {on: lever, torque: {value: 0.5, amplitude: 1.2, frequency: 7}}}
  gravity: [0, -9.81]
  project_velocities: true
gyro:  # a heavy body in space on a ball joint
  dimensions: 3
  bodies:
    rotor: {position: [0, 0, 0], mass: 1.4, centre: [0.05, 0, 0.3],
            inertia: [0.02, 0.03, 0.012], angular_velocity: [1, -2, 9]}
  joints: {ball: {type: spherical, from: ground, to: rotor, at: [0, 0, 0]}}
  gravity: [0, 0, -9.81]
""")
T_END = {"crane": 0.9, "triple": 0.45, "rocker": 0.5, "gyro": 0.35}


class System:
    """A problem as a code has it, with what is wrong in its right-hand side."""

    def __init__(self, problem: Any, start: Any, curvature: float = 1.0) -> None:
        self.problem, self.M, self.n, self.m = problem, problem.M, problem.n, problem.m
        self.u0, self.v0, self.curvature = start.u0.copy(), start.v0.copy(), curvature

    def terms(self, t: float, u: Any, v: Any, forces: Any) -> Any:
        """f + G λ, Φ, −∂/∂u, −∂/∂v, G."""
        return self.problem.evaluate(float(t), *(np.ascontiguousarray(x) for x in (u, v, forces)))

    def index_1(self, t: float, u: Any, v: Any) -> tuple[Any, Any]:
        """a and λ."""
        x, n = self.terms(t, u, v, np.zeros(self.m)), self.n
        kappa = self.curvature * self.problem.constraint_derivatives(float(t), u, v)[1]
        both = np.linalg.solve(
            np.block([[self.M, -x.G], [x.G.T, np.zeros((self.m, self.m))]]),
            np.concatenate([x.force, -kappa]),
        )
        return both[:n], both[n:]


Rows = Iterator[tuple[float, Any, Any, Any]]


def alpha(s: System, h: float, steps: int, rho: float | None = 0.8, *, shift: float = 0.0,
          beta: float | None = None, from_rest: bool = False, old: str = "", most: int = 12,
          level: int = 3, dtype: Any = float) -> Rows:  # fmt: skip
    """Generalized-α; the trapezoidal rule where ρ∞ is None; HHT with α = −ρ∞ where it is < 0."""
    am, af = (0.0, 0.0) if rho is None else ((2 * rho - 1) / (rho + 1), rho / (rho + 1))
    am, af = (0.0, -rho) if rho is not None and rho < 0 else (am, af)
    gamma = 0.5 - am + af + shift
    beta = 0.25 * (0.5 + gamma) ** 2 if beta is None else beta
    u, v = s.u0, s.v0
    true, forces = s.index_1(0.0, u, v)
    true = 0 * true if from_rest else true
    a = true.copy()
    yield 0.0, u, v, forces
    for k in range(1, steps + 1):
        t, none = k * h, 0 * forces
        before = s.terms(t - h, u, v, none)
        new = true.copy()
        for _ in range(most):
            b = ((1 - af) * new + af * true - am * a) / (1 - am)
            w = u + h * v + h * h * ((0.5 - beta) * a + beta * b)
            r = v + h * ((1 - gamma) * a + gamma * b)
            x = s.terms(t, w, r, forces)
            force = x.force
            if old:
                force = force - s.terms(t, w, r, none).force + before.force
            c = (1 - af) / (1 - am)
            missed, scale = x.phi, beta * h * h * c
            if level == 2:
                missed, scale = x.G.T @ r, gamma * h * c
            J = np.block([[s.M + beta * h * h * c * x.X + gamma * h * c * x.Y, -x.G],
                          [x.G.T, np.zeros((s.m, s.m))]])  # fmt: skip
            d = np.linalg.solve(J, -np.concatenate([s.M @ new - force, missed / scale]))
            new, forces = new + d[: s.n], forces + d[s.n :]
        b = ((1 - af) * new + af * true - am * a) / (1 - am)
        u = u + h * v + h * h * ((0.5 - beta) * a + beta * b)
        v = v + h * ((1 - gamma) * a + gamma * b)
        a, true = b, new
        u, v, forces = (z.astype(dtype).astype(float) for z in (u, v, forces))
        yield t, u, v, forces


def bdf(s: System, h: float, steps: int, order: int = 2, level: int = 3) -> Rows:
    """BDF2, begun by BDF1; or BDF1."""
    us, vs, forces = [s.u0], [s.v0], s.index_1(0.0, s.u0, s.v0)[1]
    yield 0.0, s.u0, s.v0, forces
    for k in range(1, steps + 1):
        one = min(k, order) == 1
        b = h if one else 2 * h / 3
        hu = us[-1] if one else (4 * us[-1] - us[-2]) / 3
        hv = vs[-1] if one else (4 * vs[-1] - vs[-2]) / 3
        v = vs[-1].copy()
        for _ in range(10):
            u = hu + b * v
            x = s.terms(k * h, u, v, forces)
            missed, scale = (x.phi, b) if level == 3 else (x.G.T @ v, 1.0)
            J = np.block([[s.M / b + b * x.X + x.Y, -x.G], [x.G.T, np.zeros((s.m, s.m))]])
            d = np.linalg.solve(J, -np.concatenate([s.M @ (v - hv) / b - x.force, missed / scale]))
            v, forces = v + d[: s.n], forces + d[s.n :]
        us, vs = [us[-1], hu + b * v], [vs[-1], v]
        yield k * h, us[-1], v, forces


def rk4(s: System, h: float, steps: int) -> Rows:
    """The classical Runge–Kutta method for index 1."""
    u, v, n = s.u0, s.v0, s.n

    def rate(t: float, y: Any) -> Any:
        return np.concatenate([y[n:], s.index_1(t, y[:n], y[n:])[0]])

    for k in range(steps + 1):
        t, y = k * h, np.concatenate([u, v])
        yield t, u, v, s.index_1(t, u, v)[1]
        k1 = rate(t, y)
        k2 = rate(t + h / 2, y + h / 2 * k1)
        k3 = rate(t + h / 2, y + h / 2 * k2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, y + h * k3))
        u, v = y[:n], y[n:]


def euler(s: System, h: float, steps: int) -> Rows:
    """The semi-implicit Euler method for index 1."""
    u, v = s.u0, s.v0
    for k in range(steps + 1):
        a, forces = s.index_1(k * h, u, v)
        yield k * h, u, v, forces
        v = v + h * a
        u = u + h * v


def adaptive(s: System, tolerance: float, steps: int) -> Rows:
    """SciPy's Radau for index 1, with a tolerance in place of a step size."""
    n, end = s.n, float(steps)
    at = np.linspace(0, end, 6)
    done = solve_ivp(
        lambda t, y: np.concatenate([y[n:], s.index_1(t, y[:n], y[n:])[0]]), (0, end),
        np.concatenate([s.u0, s.v0]), "Radau", rtol=tolerance, atol=tolerance, t_eval=at,
    )  # fmt: skip
    for t, y in zip(at, done.y.T, strict=True):
        yield t, y[:n], y[n:], s.index_1(t, y[:n], y[n:])[1]


NONE: dict[str, Any] = {}
G8, B2 = {"integrator": "generalized-alpha rho=0.8"}, {"integrator": "bdf2"}
HHT = {"integrator": "hht alpha=0.1"}
ANOTHER = ("another mechanism",)


@dataclass(frozen=True)
class Case:
    """A table to judge, and which cause is right; none of a sound code."""

    name: str
    mechanism: str
    code: Callable[..., Rows] = alpha
    right: tuple[str, ...] = ()
    told: Mapping[str, Any] = field(default_factory=lambda: G8)
    how: Mapping[str, Any] = field(default_factory=dict)  #: arguments of the code
    change: tuple[Any, ...] = ()  #: path of a number in the mechanism, and its factor
    start: float = 1.0  #: factor of the start's velocities
    curvature: float = 1.0
    rows: str = "doc"
    digits: int = 17
    after: Callable[[pd.DataFrame], pd.DataFrame] | None = None

    def table(self) -> pd.DataFrame:
        """What the code prints."""
        right = newmark.problem(MECHANISMS[self.mechanism])
        document = copy.deepcopy(MECHANISMS[self.mechanism])
        if self.change:
            *way, last, factor = self.change
            there = document
            for key in way:
                there = there[key]
            value = there[last]
            there[last] = [x * factor for x in value] if isinstance(value, list) else value * factor
        system = System(newmark.problem(document), right, self.curvature)
        system.v0 = system.v0 * self.start
        parts = [("u", right.coordinate_names), ("v", right.coordinate_names),
                 ("lambda", right.constraint_names)]  # fmt: skip
        names = [f"{part}[{name}]" for part, of in parts for name in of]
        end, rows = T_END[self.mechanism], []
        if self.code is adaptive:
            sizes = [(tol, end) for tol in (1e-4, 1e-6, 1e-8)]
        else:
            sizes = [(end / n, n) for n in (60, 120, 240, 480)]
        for size, steps in sizes:
            run = [*self.code(system, size, steps, **self.how)]
            ends = [0, 1, 2, *range(len(run) - 3, len(run))]
            kept = {"doc": ends, "all": range(len(run)), "last": ends[-1:]}[self.rows]
            rows += [[size, run[k][0], *np.concatenate(run[k][1:])] for k in kept]
        first = "tolerance" if self.code is adaptive else "h"
        frame = pd.DataFrame(rows, columns=[first, "t", *names])
        frame = self.after(frame) if self.after else frame
        return frame.map(lambda x: x if isinstance(x, str) else f"%.{self.digits}g" % x)


def of(frame: pd.DataFrame, parts: str) -> list[str]:
    """Columns of λ, or of other parts of the state, such as "uv"."""
    wanted = ["lambda"] if parts == "lambda" else [*parts]
    return [name for name in frame if name.partition("[")[0] in wanted]


def times(parts: str, factor: Any) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """A change of columns after the run; the factor may be a function of h."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        by = factor(frame["h"]) if callable(factor) else factor
        return frame.assign(**{name: frame[name] * by for name in of(frame, parts)})

    return change


def no_lambda(frame: pd.DataFrame) -> pd.DataFrame:
    """u and v only."""
    return frame.drop(columns=of(frame, "lambda"))


def late(frame: pd.DataFrame) -> pd.DataFrame:
    """λ of the row before."""
    names = of(frame, "lambda")
    frame[names] = frame.groupby("h")[names].shift(1)
    return frame.dropna()


#: Mechanisms, and faults of codes that solve them: what is wrong, its cause, the rest of `Case`.
FAULTS: tuple[tuple[str, list[tuple[str, str, dict[str, Any]]]], ...] = (
    ("crane triple rocker gyro", [
        ("a(0) = 0", "a(0)", {"how": {"from_rest": True}}),
        ("γ + 0.08, nothing said", "averaging", {"told": NONE, "how": {"shift": 0.08}}),
        ("λ of the step before", "late", {"rows": "all", "after": late}),
        ("the start's velocities × 1.01", "start", {"code": bdf, "told": B2, "start": 1.01}),
        ("index 2 said to be index 3", "drift", {"how": {"level": 2}}),
    ]),
    ("crane rocker", [
        ("f of the step before", "old force", {"told": HHT, "how": {"rho": -0.1, "old": "f"}}),
        ("no centrifugal terms", *ANOTHER, {"code": rk4, "told": NONE, "curvature": 0.0}),
        ("β of 1/6", "unstable", {"how": {"beta": 1 / 6}}),
        ("one iteration", "Newton ends early", {"how": {"most": 1}}),
        ("in float32", "single precision", {"how": {"dtype": np.float32}}),
    ]),
    ("triple gyro", [
        ("λ times 2", "factor of λ", {"after": times("lambda", 2.0)}),
        ("λ times h²", "factor of λ",
         {"code": bdf, "told": B2, "after": times("lambda", lambda h: h * h)}),
        ("λ of the other sign", "columns", {"after": times("lambda", -1.0)}),
        ("u and v in mm", "columns", {"code": rk4, "told": NONE, "after": times("uv", 1e3)}),
    ]),
    ("triple", [
        ("BDF1 said to be BDF2", "backward Euler", {"code": bdf, "told": B2, "how": {"order": 1}}),
    ]),
)  # fmt: skip


def sound() -> Iterator[Case]:
    """Codes without a fault, of which users say much or nothing."""
    for mechanism in MECHANISMS:
        yield Case("generalized-α", mechanism)
        yield Case("BDF2, only u and v", mechanism, bdf, told=B2, after=no_lambda)
        yield Case("RK4, nothing said", mechanism, rk4, told=NONE, rows="last")
        yield Case("HHT with 9 digits", mechanism, told=HHT, how={"rho": -0.1}, digits=9)
        yield Case("Radau of SciPy", mechanism, adaptive, told=NONE)
    yield Case("semi-implicit Euler, nothing said", "crane", euler, told=NONE)
    yield Case("BDF1, nothing said", "rocker", bdf, told=NONE, how={"order": 1})


def faulty() -> Iterator[Case]:
    """One fault each."""
    changes = """
        crane points.L.mass 1.03; crane springs.buffer.stiffness 0.9; crane dampers.oil.damping 0
        crane springs.buffer.rest_length 1.02; crane dampers.oil.damping 3; triple gravity -1
        triple points.B.mass 1.05; triple points.C.mass 0.98; triple gravity 1.002
        rocker bodies.arm.inertia 1.25; rocker bodies.lever.mass 1.1
        rocker bodies.arm.centre.0 1.02; rocker torques.motor.torque.amplitude 1.05
        rocker torques.motor.torque.frequency 0.97; rocker gravity 0; gyro gravity 0.98
        gyro bodies.rotor.mass 1.04; gyro bodies.rotor.inertia 1.1
        gyro bodies.rotor.inertia.2 1.2; gyro bodies.rotor.centre.2 0.99"""
    methods = [(alpha, G8, {}), (bdf, B2, {}), (rk4, NONE, {}), (alpha, HHT, {"rho": -0.1})]
    for k, line in enumerate(changes.replace("\n", ";").strip(" ;").split(";")):
        mechanism, path, factor = line.split()
        code, told, how = methods[k % 4]
        change = (*(int(key) if key.isdigit() else key for key in path.split(".")), float(factor))
        yield Case(f"{path} × {factor}", mechanism, code, ANOTHER, told, how, change)
    for mechanisms, faults in FAULTS:
        for mechanism, (name, right, more) in itertools.product(mechanisms.split(), faults):
            yield Case(name, mechanism, right=(right,), **more)


UNDONE = ("the sign of", "taken to be in", "are in the order")


def verdict(case: Case) -> tuple[str, Any]:
    """Right, misnamed, seen or missed; sound or accused; with what was judged."""
    with np.errstate(all="ignore"):
        judged = newmark.judge(case.table(), MECHANISMS[case.mechanism], **case.told)
    if not case.right:
        return ("accused" if judged.faults else "sound"), judged
    notes = [one for one in judged.findings if not one.fault and one.name in case.right]
    names = {one.name for one in (*judged.faults, *notes)} - {"seen", "order 1", "failure"}
    names |= {"columns" for note in judged.notes if any(text in note for text in UNDONE)}
    if names:
        return ("right" if names <= {*case.right} else "misnamed"), judged
    return ("seen" if judged.faults else "missed"), judged


def number(case: Case, judged: Any) -> str:
    """Whether the number that was changed is the only one that is named, to 1 %."""
    *path, factor = case.change
    name = ".".join(map(str, path))
    found = next((one.evidence["changes"] for one in judged.faults if one.name in ANOTHER), {})
    if name not in found:
        return "number lacking"
    near = abs(1 + found[name] - factor) < 0.01 * max(abs(factor), 0.1)
    return "number" if len(found) == 1 and near else "number among others" if near else "number off"


def main(words: Sequence[str]) -> None:
    """Print the score."""
    score: Counter[str] = Counter()
    for case in (*sound(), *faulty()):
        if words and not any(word in f"{case.mechanism}: {case.name}" for word in words):
            continue
        said, judged = verdict(case)
        score[said] += 1
        if case.change:
            score[number(case, judged)] += 1
        if words or said not in ("sound", "right"):
            print(f"{said}: {case.mechanism}: {case.name}", flush=True)
            for one in judged.findings:
                print(f"    {one.name}{'' if one.fault else ' (no fault)'}: {one.text}")
    print(dict(sorted(score.items())))


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    main(sys.argv[1:])
