"""`judge`: what another code computed, measured, judged and explained."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from newmark_cli.codes.causes import explained, without_solution
from newmark_cli.codes.evidence import Finding, Told
from newmark_cli.codes.file_numbers import FileNumbers, file_of
from newmark_cli.codes.given_references import reference_at
from newmark_cli.codes.reading import METHOD, STEP_SIZE, UNNAMED, Run, Runs, names_of, read
from newmark_cli.codes.solutions import Measured, Solutions
from newmark_cli.codes.truth import NoMotion, Truth
from newmark_cli.codes.undoing import undone
from newmark_cli.library import judge_options
from newmark_cli.library.finding import problem as problem_of
from newmark_cli.library.marching import Method
from newmark_cli.library.measuring import measured, shown, slopes
from newmark_cli.library.measuring import method as method_of
from newmark_cli.library.scalings import read as value_of
from newmark_cli.newmark import integrator_labels
from newmark_cli.newmark.formulation import CORRECTED
from newmark_cli.problems.index_1 import Index1
from newmark_cli.problems.problem import Problem
from newmark_cli.problems.reference import NoReference
from newmark_cli.report.judging.expectations import Expected, expected
from newmark_cli.report.judging.fits import format_fit, format_order
from newmark_cli.report.judging.slopes import Slope
from newmark_cli.report.judging.text import text_table, wrapped
from newmark_cli.report.judging.verdicts import FAILING, UNDECIDED
from newmark_cli.study.measures import symbol
from newmark_cli.support.arrays import plain
from newmark_cli.support.errors import ArgumentError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Judged:
    """What there is to say of another code's runs; ``print`` shows it.

    Attributes:
        problem: Name of the problem.
        findings: What is wrong, or a limit of the method, with evidence.
        notes: What was taken for granted.
        slopes: Series with fits and verdicts, as `check` has them.
        expected: What the caller expects of them, judged.
        measured: The runs with their errors, and those of this tool's own marches.
        abscissa: ``"h"`` or ``"tolerance"``.
        differs: Whether units, signs or an order of columns are other than the problem's.

    Examples:
        >>> import newmark_cli as newmark
        >>> frames = []
        >>> for h in (1e-2, 3e-3, 1e-3):
        ...     swing = newmark.march("pendulum", h=h, t_end=0.9, integrator="bdf2").to_frame()
        ...     frames.append(swing.assign(h=h))
        >>> import pandas as pd
        >>> judged = newmark.judge(pd.concat(frames), "pendulum", integrator="bdf2")
        >>> judged.faults, judged.slopes[0].quantity, judged.slopes[0].verdict
        ((), 'u', 'pass')
    """

    problem: str
    findings: Sequence[Finding]
    notes: Sequence[str]
    slopes: Sequence[Slope]
    expected: Sequence[Expected] = ()
    measured: Sequence[Measured] = field(default=(), repr=False)
    abscissa: str = STEP_SIZE
    differs: bool = False

    @property
    def faults(self) -> tuple[Finding, ...]:
        """Findings that are faults of the code, not limits of its method."""
        return tuple(finding for finding in self.findings if finding.fault)

    @property
    def series(self) -> tuple[str, ...]:
        """Labels of the series."""
        return tuple(dict.fromkeys(slope.study for slope in self.slopes))

    @property
    def undecided(self) -> bool:
        """Whether no order could be judged, for want of step sizes or digits."""
        errors = {slope.verdict for slope in self.slopes if slope.measure == "error"}
        return errors == {UNDECIDED}

    @property
    def conclusion(self) -> str:
        """What can be said where no fault was found."""
        if not self.slopes:
            return "No error was measured."
        if self.undecided:
            return "No order could be judged."
        if failing := self._names(FAILING):
            return f"No cause of a fault was found; see above what is said of {failing}."
        nothing = f"Nothing {'else' if self.differs else 'wrong'} was found"
        if undecided := self._names((UNDECIDED,)):
            return f"{nothing}; no order could be judged of {undecided}."
        if any(note.startswith("not read") for note in self.notes):
            return f"{nothing} in the columns that were read."
        errors = [slope for slope in self.slopes if slope.measure == "error"]
        if errors and not self.expected and all(math.isnan(slope.expected) for slope in errors):
            return f"{nothing}. No order was expected, as no integrator was named."
        return f"{nothing}."

    def _names(self, verdicts: Sequence[str]) -> str:
        """Names of the series with one of these verdicts, separated by commas."""
        there = [slope for slope in self.slopes if slope.verdict in verdicts]
        return ", ".join(dict.fromkeys(_named(slope, self.series) for slope in there))

    def fails(self, strict: bool = False) -> bool:
        """Whether there is a fault, an order that is missed or an expectation that fails."""
        bad = (*FAILING, UNDECIDED) if strict or self.undecided else FAILING
        judged = [item.verdict for item in self.slopes] + [item.verdict for item in self.expected]
        return bool(self.faults) or any(verdict in bad for verdict in judged)

    def to_frame(self) -> "pd.DataFrame":
        """A row for each run and quantity: value, rounding, and the same of this tool's march."""
        import pandas as pd

        rows = []
        for m in self.measured:
            for (measure, quantity), row in m.errors.items():
                ours = m.ours.get((measure, quantity))
                rows.append({
                    "series": m.run.series, self.abscissa: m.run.size,
                    "t": float(m.run.t[-1]), "measure": measure, "quantity": quantity,
                    "value": row.statistics.max, "rounding": row.statistics.rounding,
                    "newmark_study": math.nan if ours is None else ours.statistics.max,
                })  # fmt: skip
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        values: dict[str, Any] = plain({
            "problem": self.problem,
            "series": [item.row() for item in self.slopes],
            "findings": [asdict(item) for item in self.findings],
            "expected": [item.row() for item in self.expected],
            "notes": self.notes,
            "runs": self.to_frame().to_dict("records"),
        })  # fmt: skip
        return values

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> Iterable[str]:
        rows: list[tuple[str, ...]] = [
            ("quantity", "order ± stderr", "expected", f"over {self.abscissa}", "least", "verdict")
        ]
        for label in self.series:
            rows += [("",), (label,)] if label != UNNAMED or len(self.series) > 1 else []
            rows += [_row(slope, self.abscissa) for slope in self.slopes if slope.study == label]
        yield f"{self.problem}: errors and invariants\n"
        if self.slopes:
            yield text_table(rows, indent=2)
        reasons = [(slope, slope.reason) for slope in self.slopes if slope.reason]
        if reasons:
            yield ""
            for slope, reason in reasons:
                yield wrapped(f"{_named(slope, self.series)}: {reason}", 2)
        for row in self.expected:
            yield wrapped(f"{row.verdict}: {row.name}, {row.label}: {row.said}: "
                          f"{row.measured or row.reason}", 2)  # fmt: skip
        if self.notes:
            yield "\nTaken for granted:"
            yield from (wrapped(f"- {note}", 2) for note in self.notes)
        if self.findings:
            yield "\nFindings:"
        for finding in self.findings:
            label = f"{finding.series}: " if len(self.series) > 1 else ""
            kind = "" if finding.fault else " (no fault)"
            yield wrapped(f"- {label}{finding.name}{kind}: {finding.text}", 2)
        if not self.faults:
            yield f"\n{self.conclusion}"


def _named(slope: Slope, series: Sequence[str]) -> str:
    label = f"{slope.study}, " if len(series) > 1 else ""
    return f"{label}{_quantity(slope)}"


def _quantity(slope: Slope) -> str:
    if slope.measure == "invariant":
        return {"position": "Φ", "velocity": "Gᵀv + Φ_t", "multiplier": "λ of u, v"}.get(
            slope.quantity, slope.quantity
        )
    return symbol(slope.quantity)


def _row(slope: Slope, abscissa: str) -> tuple[str, ...]:
    used = slope.h[slope.fitted]
    over = f"{used.max():g} … {used.min():g}" if len(used) > 1 else "–"
    value, h = slope.least or (math.nan, math.nan)
    least = f"{value:.2g} at {h:g}"
    fit = format_fit(slope.fit) if len(used) > 1 else "–"
    return (_quantity(slope), fit, format_order(slope.expected) or "–", over, least, slope.verdict)


def judge(
    table: Any,
    problem: Any,
    *,
    columns: Mapping[str, Any] | str | Path | None = None,
    expect: Sequence[Mapping[str, Any]] | str | Path | None = None,
    reference: str | Path | None = None,
    **method: Unpack[Method],
) -> Judged:
    """Say what is right and wrong with what another code computed.

    Args:
        table: A DataFrame, or the path of a file: text with any separator, Parquet, ``.npy`` or
            ``.mat``.  It has a row for each run and time, with ``h``, ``tolerance`` or ``steps``,
            ``t``, and the state under the names of `Trajectory.to_frame`; or a row for each
            ``quantity`` and ``value`` of these.  See docs/judge.md.
        problem: What was solved: what `problem` takes.
        columns: Column of this tool → number, or formula of the table's columns:
            ``{"h": 0.002, "lambda[bars.rod]": "-2 * force", "u[A.x]": "0.5 * cos(angle)"}``; or a
            YAML file of it.
        expect: Entries as of the key ``expect`` of a study, which may name a ``series``; or a
            YAML file with that key.
        reference: A file with the solution at the times at which runs end, in place of one that is
            computed: ``t``, ``u[…]``, ``v[…]`` and ``lambda[…]``, and the relative errors of
            these in ``error[u]``, ``error[v]`` and ``error[lambda]``, or in ``tolerance``.
        **method: ``integrator``, ``formulation``, ``projection``, ``multipliers``, ``start`` and
            ``evaluation``, as of `march`, which say what orders to expect: without an integrator
            orders are measured, and held against nothing.  Columns of these names go before.

    Returns:
        Orders of errors and invariants with verdicts, and findings: what is wrong, by which
        evidence, and what to do.

    Raises:
        ArgumentError: When the table cannot be used.
        ProblemError, DocumentError: When the problem cannot be used.
        IntegratorError, FormulationError: For an unknown method.

    Examples:
        A code that writes Φ without the half:

        >>> import pandas as pd
        >>> import newmark_cli as newmark
        >>> swings = [
        ...     newmark.march("pendulum", h=h, t_end=0.9, integrator="bdf2").to_frame().assign(h=h)
        ...     for h in (1e-2, 3e-3, 1e-3)
        ... ]
        >>> table = pd.concat(swings)
        >>> table["lambda[bars.rod]"] /= 2
        >>> [one.name for one in newmark.judge(table, "pendulum", integrator="bdf2").faults]
        ['factor of λ']
    """
    for name in method.keys() - METHOD:
        raise TypeError(f"judge() got an unexpected keyword argument {name!r}")
    solved = problem_of(problem)
    options = {name: value_of(name, v) for name, v in method.items() if v is not None}
    expectations = judge_options.expected(expect)
    runs = read(table, solved, judge_options.columns(columns))
    for run in runs.runs:
        method_of(run.method)
    given = None if reference is None else reference_at(Path(reference), solved)
    motion, truth, unsolved = Solutions(solved, {}, given), None, ""
    try:
        motion.at(max(float(run.t[-1]) for run in runs.runs))  # which says why there is none
        truth = _truth(runs, solved)
        runs = undone(runs, truth)
    except NoReference as error:
        if given is not None:
            raise ArgumentError(str(error)) from None
        findings = [
            finding
            for own, told in _by_series(runs, options)
            for finding in without_solution(own, solved.t0, told, str(error))
        ]
        return Judged(solved.name, findings, runs.notes, [])
    except NoMotion as error:  # errors are against the reference, and causes cannot be sought
        unsolved = str(error)
    measurements = measured(runs, motion, options)
    judged = slopes(measurements, runs, motion, options) if measurements else []
    by_key = {slope.key: slope for slope in judged}
    # What the caller expects takes the place of what the method's order would be.
    judged = [
        shown(slope) if any(one.matches(slope.key) for one in expectations) else slope
        for slope in judged
    ]
    return Judged(
        solved.name,
        _explained(runs, measurements, truth, options, file_of(solved, problem))
        if truth is not None
        else _unsought(runs, unsolved),
        runs.notes,
        [slope for slope in judged if slope.quantity != "energy"],
        [
            row
            for number, expectation in enumerate(expectations, 1)
            for row in expected("", number, expectation, by_key, Path("the table"))
        ],
        measurements,
        runs.abscissa,
        runs.differs,
    )


def _truth(runs: Runs, problem: Problem) -> Truth:
    """The solution, until a step after the last row, or as long as tables say anything."""
    last = max(float(run.t[-1]) for run in runs.runs)
    step = max(run.size for run in runs.runs) if runs.abscissa == STEP_SIZE else 0.0
    return Truth(problem, max(last, min(last + min(step, last - problem.t0), problem.until)))


def _by_series(runs: Runs, options: Mapping[str, Any]) -> Iterator[tuple[list[Run], Told]]:
    """Runs of each series, and what the table or the caller says of its code."""
    for label in dict.fromkeys(run.series for run in runs.runs):
        own = [run for run in runs.runs if run.series == label]
        yield own, _told(runs, own[-1].method, options)


def _explained(
    runs: Runs,
    measurements: Sequence[Measured],
    truth: Truth,
    options: Mapping[str, Any],
    file: FileNumbers | None,
) -> list[Finding]:
    """Findings on every series."""
    findings: list[Finding] = []
    for own, told in _by_series(runs, options):
        of = [m for m in measurements if m.run.series == own[0].series and not m.run.twin]
        findings += explained(own, of, told, truth, file)
    return findings


def _told(runs: Runs, of_table: Mapping[str, Any], options: Mapping[str, Any]) -> Told:
    """What the table or the caller says of the code."""
    said = {**options, **of_table}
    how = method_of(said)
    return Told(
        integrator_labels.parse(how["integrator"]) if said.get("integrator") else None,
        how["formulation"].split()[0] if {"integrator", "formulation"} & said.keys() else "",
        how.get("start") == CORRECTED,
        runs.abscissa == STEP_SIZE,
    )


def _unsought(runs: Runs, why: str) -> list[Finding]:
    """What is said where errors are known, and causes are not sought."""
    text = f"{why}: errors are against the reference, and causes are not sought"
    return [Finding("no solution", run.series, text, False) for run in runs.runs[:1]]


#: Rows that a template asks for.
ROWS = (
    "a row at t = 0, after each of the first two steps and each of the last three, for each of "
    "four step sizes or more; every step will do"
)


def template(problem: Problem) -> str:
    """Header of a table, and its first row: the start that the code must use.

    Args:
        problem: What is to be solved.
    """
    start = problem.t0, problem.u0, problem.v0
    _, multipliers = Index1(problem).accelerations(*start)
    names = [name for name, parts in names_of(problem).items() if parts]
    parts = {"u": problem.u0, "v": problem.v0, "lambda": multipliers}
    if problem.outputs is not None:
        parts["output"] = problem.outputs.values(problem, *start, multipliers)
    header = [f"{part}[{name}]" for part in names for name in names_of(problem)[part]]
    values = [repr(float(value)) for part in names for value in parts[part]]
    row = ["1e-3", repr(problem.t0), *values]
    return f"{','.join([STEP_SIZE, 't', *header])}\n{','.join(row)}"
