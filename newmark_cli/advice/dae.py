"""Advice for codes that choose their steps and solve general DAEs: IDA, Radau, BDF.

They test local errors and Newton's corrections in one norm with a weight for each unknown,

    ‖e‖² = mean (e_i / w_i)²,   w_i = rtol |y_i| + atol_i,   ‖local error‖ ≤ 1,   ‖correction‖ ≤ κ.

So Newton's iteration leaves κw of u and v, and rounding about a unit in the last place.  In one
step the constraints bring both into λ: with S = (Gᵀ M⁻¹ G)⁻¹, λ is off by S Φ/h² (index 3) or
S Φ'/h (index 2, GGL).  Below some h a test on λ can fail, and halving h makes it worse.  Λ = ∫λ is
off by S Φ', H = ∫η by (Gᵀ G)⁻¹ Φ, at any h: their tests are met where w is far enough above.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from newmark_cli.advice.linearised import subject_of
from newmark_cli.advice.text import plain, titled
from newmark_cli.library import arguments
from newmark_cli.library.problems import dae
from newmark_cli.library.problems import problem as problem_of
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.support.arrays import Array
from newmark_cli.support.errors import ArgumentError

_DRAWS = 32
#: Least size of an unknown next to the largest of its kind.
_LEAST = 1e-3
#: Multiples of rounding that κw is at least, and that the smallest accuracy is.
_ABOVE, _FAR_ABOVE = 10.0, 100.0
#: Most |u| over its motion with which rtol is the accuracy.
_FAR = 10.0

_START = """\
import numpy as np
import newmark_cli as newmark
{imports}

dae = newmark.dae({named}, "ggl", integrals=True)
atol = np.array([
{atol}
])
"""
_IDA = """
def residual(t, y, yp, res):
    res[:] = dae.residual(t, y, yp)

def jacobian(t, y, yp, res, cj, JJ):
    of_y, of_yp = dae.jacobian(t, y, yp)
    JJ[:] = of_y + cj * of_yp

solver = IDA(residual, jacfn=jacobian, rtol={rtol!r}, atol=atol, max_num_steps=100_000)
found = solver.solve([dae.t0, {end!r}], dae.y0, dae.yp0)
u, v, multipliers = dae.state(found.y[-1], found.yp[-1])
print(found.message, multipliers)"""
_SOLVE_DAE = """
found = solve_dae(
    dae.residual, (dae.t0, {end!r}), dae.y0, dae.yp0, method="{method}",
    jac=dae.jacobian, rtol={rtol!r}, atol=atol,
)
u, v, multipliers = dae.state(found.y[:, -1], found.yp[:, -1])
print(found.message, multipliers)"""
_IMPORT = "from solve_dae.integrate import solve_dae  # or from scipy_dae.integrate"
#: Code → its name, method, import, and lines.
CODES = {
    "ida": ("IDA of scikit-sundae", "", "from sksundae.ida import IDA", _IDA),
    "radau": ("Radau of solve_dae and scipy_dae", "Radau", _IMPORT, _SOLVE_DAE),
    "bdf": ("BDF of solve_dae and scipy_dae", "BDF", _IMPORT, _SOLVE_DAE),
}


@dataclass(frozen=True)
class DaeAdvice:
    """What to set in a code for general DAEs, given GGL with ∫λ and ∫η for unknowns.

    ``print`` shows it as text; `to_dict` gives plain values for JSON.

    Attributes:
        subject, code: Names of the problem and of the code.
        n, m: Coordinates and constraints.
        where: At which states.
        accuracy: That was asked for: of local errors, relative to the motion.
        smallest: The smallest accuracy that rounding leaves room for.
        rtol: To set.
        atol: Unknown → to set, in its own unit.
        sizes: Unknown → how far u moves, how fast v gets, what errors as large are in ∫λ, ∫η.
        amplified: Equations → the power of h with which λ is amplified, and step sizes (s) below
            which what Newton's iteration leaves, and rounding, fail a test on λ.
        noisy: Step size (s) below which Newton's rest and rounding move λ by 1 % of its size.
        lines: To paste.
        findings: What to know, in sentences.

    Examples:
        >>> import newmark_cli as newmark
        >>> advice = newmark.advise_dae("pendulum", code="ida", accuracy=1e-8)
        >>> advice.rtol, list(advice.atol)[-1], advice.amplified["index-3"]["power"]
        (1e-08, '∫eta[bars.rod]', -2)
    """

    subject: str
    code: str
    n: int
    m: int
    where: str
    accuracy: float
    smallest: float
    rtol: float
    atol: Mapping[str, float]
    sizes: Mapping[str, float]
    amplified: Mapping[str, Mapping[str, float]]
    noisy: float
    lines: tuple[str, ...] = field(repr=False)
    findings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain mappings, lists, numbers and text."""
        values: dict[str, Any] = plain(asdict(self))
        return values

    def __str__(self) -> str:
        ranges = [
            [kind, *(_range([x for name, x in of.items() if name.startswith(f"{kind}[")])
                     for of in (self.sizes, self.atol))]
            for kind in dict.fromkeys(name.partition("[")[0] for name in self.atol)
        ]  # fmt: skip
        amplified = [
            [name, f"h^{of['power']}", *(f"{of[key]:.1g}" for key in ("newton", "rounding"))]
            for name, of in self.amplified.items()
        ]
        return "\n\n".join([
            f"{self.subject}: n = {self.n} coordinates, m = {self.m} constraints, {self.where}\n"
            f"{CODES[self.code][0]}, accuracy {self.accuracy:g}",
            "Equations: GGL with Λ' = λ and H' = η for y = (u, v, Λ, H), index 1\n"
            "  u' = v + GH',  M v' = f + GΛ',  0 = Φ,  0 = Gᵀv + Φ_t",
            titled(f"Tolerances: rtol = {self.rtol:g}, and for each unknown, in the lines below",
                   [["", "size", "atol"], *ranges]),
            titled("With λ itself for unknown: step size (s) below which a test on it can fail",
                   [["", "grows like", "by Newton's rest", "by rounding"], *amplified]),
            "\n".join(f"- {text}" for text in self.findings),
            "\n".join(self.lines),
        ])  # fmt: skip


def advise_dae(
    subject: Any, *, code: str = "ida", accuracy: float = 1e-6, t_end: float | None = None
) -> DaeAdvice:
    """Say what to set in a code that chooses its steps and solves general DAEs.

    Args:
        subject: What `problem` takes.
        code: ``"ida"`` (scikit-sundae), ``"radau"`` or ``"bdf"`` (solve_dae, scipy_dae).
        accuracy: Of local errors, relative to the motion.
        t_end: End of the motion (s); when omitted, once or three times the time in which it
            moves by about its own size.

    Raises:
        ArgumentError: For an argument of the wrong type, size or name, and where there is no
            motion.
        ProblemError, DocumentError: When the problem cannot be used.

    Examples:
        >>> import newmark_cli as newmark
        >>> newmark.advise_dae("pendulum", code="radau").lines[2]
        'from solve_dae.integrate import solve_dae  # or from scipy_dae.integrate'
    """
    named = repr(str(subject)) if isinstance(subject, str | Path) else "problem"
    return advised(problem_of(subject), named, code, accuracy, t_end)


def advised(
    problem: Problem, named: str, code: str, accuracy: float = 1e-6, t_end: float | None = None
) -> DaeAdvice:
    """The same of a problem that Python spells so."""
    _, method, imports, lines = CODES[arguments.one_of("code", code, CODES)]
    if arguments.positive("accuracy", accuracy) >= 1:
        raise ArgumentError(f"accuracy must be below 1, given {accuracy:g}")
    t_end = None if t_end is None else arguments.positive("t_end", t_end)
    about = subject_of(problem, t_end)
    if len(about.states) == 1 and t_end is None:
        about = subject_of(problem, motions=1)
    if len(about.states) == 1:
        why = about.notes[0].partition(": ")[0] if about.notes else "it is too large to march"
        raise ArgumentError(f"{about.name}: advice for DAE codes needs a motion, but {why}")
    sizes, rounding, amplified, far = _looked_at(about.states)
    rtol = accuracy if far <= _FAR else float(f"{accuracy / far:.0e}")
    # Of solve_dae and scipy_dae; IDA has a constant.
    of_rtol = max(10 * float(np.finfo(float).eps) / rtol, min(0.03, math.sqrt(rtol)))
    kappa = of_rtol if method else 0.33
    names = dae(problem).names
    atol = np.maximum(accuracy * sizes, _ABOVE * rounding / kappa)
    smallest = _FAR_ABOVE * _norm((rounding / sizes)[: 2 * problem.n])
    in_lambda = {
        power: {"power": power, "newton": (kappa * rest) ** (-1 / power),
                "rounding": (rounded / accuracy) ** (-1 / power)}
        for power, (rest, rounded) in amplified.items()
    }  # fmt: skip
    noisy = 100 * (kappa * accuracy * amplified[-1][0] + amplified[-1][1])
    end = float(f"{about.states[-1].t0:.6g}")
    values = textwrap.fill(", ".join(f"{x:.1e}" for x in atol), 84)
    filled = (_START + lines).format(
        named=named, imports=imports, method=method, rtol=rtol, end=end,
        atol=textwrap.indent(values, "    "),
    )  # fmt: skip
    findings = [
        "leave nothing out of the error test: no unknown is algebraic. With λ and η for unknowns, "
        f"at places {2 * problem.n} to {len(names) - 1}, leave them out: IDASetSuppressAlg, or an "
        "atol of 1e12 where a code has no such switch; scikit-sundae wants algebraic_idx, too",
        "λ is Λ': what Newton's iteration and rounding leave moves it by 1 % in steps of "
        f"{noisy:.1g} s, and by more in smaller ones",
        f"rounding leaves room for accuracies down to {smallest:.1g}"
        + (", not for this one" if accuracy < smallest else ""),
    ]
    if rtol != accuracy:
        findings.append(
            f"rtol counts from the origin, and the largest coordinate is {far:.2g} times as large "
            f"as the motion: so rtol is {rtol:g} for an accuracy of {accuracy:g}"
        )
    return DaeAdvice(
        about.name, code, problem.n, problem.m, about.where, float(accuracy), smallest, rtol,
        {name: float(f"{x:.1e}") for name, x in zip(names, atol, strict=True)},
        dict(zip(names, sizes.tolist(), strict=True)),
        {"index-3": in_lambda[-2], "index-2": in_lambda[-1], "ggl": in_lambda[-1]}, noisy,
        tuple(filled.splitlines()), tuple(findings),
    )  # fmt: skip


def _looked_at(
    states: Sequence[Problem],
) -> tuple[Array, Array, dict[int, tuple[float, float]], float]:
    """What the states of a motion tell.

    Returns:
        (N,) How large u (from its start) and v become, and what errors as large are in Λ and H;
        (N,) rms of rounding in a step; power of h → what λ, in its own size, is off by in a step
        of 1 s, from such errors and from rounding; largest |u| over largest motion.
    """
    problem = states[0]
    u, v = (np.array([getattr(at, name) for at in states]) for name in ("u0", "v0"))
    moved, speed = _largest(problem, u - u[0]), _largest(problem, v)
    multipliers = [Index1(at).accelerations(at.t0, at.u0, at.v0)[1] for at in states]
    of_lambda = _not_small(np.sqrt(np.mean(np.square(multipliers), axis=0)))
    squares = [_squares(at, moved, speed) for at in states]
    *rounding, twice, in_impulse, in_eta, in_twice = (
        np.sqrt(np.max(samples, axis=0)) for samples in zip(*squares, strict=True)
    )
    amplified = {
        -1: (_norm(in_impulse / of_lambda), _norm(rounding[2] / of_lambda)),
        -2: (_norm(in_twice / of_lambda), _norm(twice / of_lambda)),
    }
    sizes = np.concatenate([moved, speed, in_impulse, in_eta])
    return sizes, np.concatenate(rounding), amplified, float(np.abs(u).max() / moved.max())


def _squares(at: Problem, moved: Array, speed: Array) -> tuple[Array, ...]:
    """Mean squares: of rounding in u, v, Λ, H and λh²; of errors in Λ, H and λh²."""
    random, none = np.random.default_rng(20061012), np.zeros(at.m)
    units = [np.where(x == 0, 0.0, np.abs(np.spacing(x))) for x in (at.u0, at.v0)]
    drawn = []
    for _ in range(_DRAWS):  # neighbours among the machine numbers
        u, v = (x + random.integers(-1, 2, at.n) * unit
                for x, unit in zip((at.u0, at.v0), units, strict=True))  # fmt: skip
        values, rate = at.values(at.t0, u, v, none), at.constraint_derivatives(at.t0, u, v)[0]
        drawn.append([values.phi, at.along(values.g, v) + rate])
    phi, phi_1 = np.moveaxis(np.array(drawn) - np.mean(drawn, axis=0), 0, -1)
    gradient = at.evaluate(at.t0, at.u0, at.v0, none).G
    # Independent errors as large as u and v, of which squares add up.
    of_u, of_v = (math.sqrt(at.n) * gradient.T * size for size in (moved, speed))
    changes = Index1(at).changes(at.t0, at.u0)
    (in_v, in_impulse), (_, by_of_v) = changes(phi_1), changes(of_v)
    eta, by_of_u = (np.linalg.solve(gradient.T @ gradient, x) for x in (phi, of_u))
    errors = (gradient @ eta + units[0][:, None], in_v + units[1][:, None], in_impulse, eta,
            changes(phi)[1], by_of_v, by_of_u, changes(of_u)[1])  # fmt: skip
    return tuple(np.mean(np.square(x), axis=1) for x in errors)


def _largest(problem: Problem, values: Array) -> Array:
    """(n,) largest of (states, n), of a point's length where a coordinate belongs to one."""
    sizes, axes = np.abs(values), len(problem.axes)
    k = len(problem.points) * axes
    lengths = np.linalg.norm(values[:, :k].reshape(len(values), -1, axes), axis=2)
    sizes[:, :k] = np.repeat(lengths, axes, axis=1)
    return _not_small(np.max(sizes, axis=0))


def _not_small(sizes: Array) -> Array:
    """The same, but nothing far below the largest; 1 where all are 0."""
    largest = float(np.max(sizes))
    return np.maximum(sizes, _LEAST * largest) if largest > 0 else np.ones_like(sizes)


def _norm(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _range(values: list[float]) -> str:
    low, high = f"{min(values):.1e}", f"{max(values):.1e}"
    return low if low == high else f"{low} to {high}"
