"""Study configs: YAML in, frozen models and cells out."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, product, starmap
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from pydantic import Field, PrivateAttr, create_model
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.spec import MechanismFile, ProblemSpec, Traits, with_ending
from newmark_cli.newmark.forms import FORMS
from newmark_cli.newmark.kept import DRIFT, ENERGY, OUTPUT, Kept
from newmark_cli.newmark.linear.choice import AUTO, DENSE, GMRES, SPARSE, STATIC
from newmark_cli.newmark.scaling import ScalingError
from newmark_cli.newmark.scheme import COMPENSATED
from newmark_cli.newmark.steps import CONSTANT, StepSequence, TimeGrid, steps_until
from newmark_cli.problems.problem import is_beyond
from newmark_cli.study import axes, fitting, keys, other_codes, overrides, shipped, showable
from newmark_cli.study.axes import Cell
from newmark_cli.study.axis import ALIASES, Axis, label
from newmark_cli.study.entries import Expectations, Figures, Tables
from newmark_cli.study.kinds import MOST_STEPS, NAMES, Name, dividing, fitting_end
from newmark_cli.study.measures import MEASURES, Measure
from newmark_cli.study.replay import OF_STATES
from newmark_cli.study.subjects import Surroundings
from newmark_cli.support import documents
from newmark_cli.support.documents import Document, DocumentError, KeyPath, misfit
from newmark_cli.support.errors import warn
from newmark_cli.support.spelling import closest, nearest

#: Shipped configs that `reproduce` runs: the paper's, and with `--all` those past it.
REPRODUCED = ("pendulum-u", "pendulum-v", "pendulum-a", "andrews-u", "all-forms", "sensitivity")
BEYOND = (
    "integrators", "multipliers", "error", "tolerance", "krylov", "precision", "history",
    "cures", "cures-tolerance", "cures-krylov", "drift", "floor",
    "spatial", "step-changes", "over-motion",
)  # fmt: skip
#: Shipped configs that take minutes, and are run by name only.
APART = ("testset",)
MOST_CASES = 500
#: What the linear solver `AUTO` may stand for.
_OF_AUTO = (DENSE, SPARSE, STATIC)
#: No settings of the command line.
NOTHING: Mapping[str, str] = MappingProxyType({})
# More is a slip of the finger, and would keep `validate` busy.
_MOST_CELLS = 20_000
_TOO_MANY_CELLS = f"more than {_MOST_CELLS} cells"


# Numbers in the trajectories of a study: up to 200 MB of CSV, 150 MB of kept cells, 1 GB of
# memory.
_MOST_RECORDED = 5_000_000


class _Rules(documents.RuledModel):
    """Rules that tie the keys of a case together; the keys are the axes of `Cell`."""

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.count > _MOST_CELLS:
            raise ValueError(_TOO_MANY_CELLS)
        measures = [MEASURES[name] for name in self.measure]
        if (self.t_end is None) == (self.steps is None):
            which = "both" if self.steps is not None else "neither"
            yield misfit("t_end", f"needs either t_end or steps, given {which}")
        yield from self._misfits_of_the_end(any(measure.at_end for measure in measures))
        yield from (error for measure in measures for error in self._unmeasurable(measure))
        labels = self.axes()["preconditioning"]
        if len(set(labels)) < len(labels):
            twice = next(label for label in labels if labels.count(label) > 1)
            yield misfit("preconditioning", f"given twice: {twice}")
        if AUTO in self.linear_solver and {*_OF_AUTO} & {*self.linear_solver}:
            text = f"{AUTO} stands for {DENSE}, {STATIC} or {SPARSE}, which is then given twice"
            yield misfit("linear_solver", text)
        for at in self._combinations("form", "formulation", "preconditioning"):
            variant = at["preconditioning"]
            try:
                variant.scaling(at["formulation"].applied(FORMS[at["form"]]))
            except ScalingError as error:
                yield misfit("preconditioning", f"{variant.name}: {error}")
                return
        for at in self._combinations("integrator", "projection", "multipliers", "start"):
            yield from starmap(misfit, fitting.of_each_other(at))
        if self.trajectory is not None and "trajectory" not in self.measure:
            yield misfit("trajectory", "needs 'measure: trajectory'")
        yield from self._misfits_of_the_window()
        if len(set(self.others)) < len(self.others):
            again = next(name for name in self.others if self.others.count(name) > 1)
            yield misfit("code", f"two codes are named {again}")
        if self.others and not set(self.measure) & set(OF_STATES):
            text = f"other codes can be measured by {', '.join(OF_STATES)}"
            yield misfit("measure" if "measure" in self.model_fields_set else "code", text)
        if self.reference is not None and len(self.problem) > 1:
            text = "is of one problem; give each problem a case of its own"
            yield misfit("reference", text)
        if self.others and self.steps == 0:
            yield misfit("steps", "no other code without steps")
        yield from self._unfit()

    def _misfits_of_the_end(self, errors: bool) -> Iterator[PydanticCustomError]:
        """Step sizes that do not fit t_end; errors are measured there."""
        if self.t_end is None:
            return
        errors = errors and CONSTANT in axes.values(self)["h_sequence"]
        for h in self.h:
            steps = self.t_end / h
            if h > self.t_end * (1 + 1e-9):
                yield misfit("t_end", f"shorter than the step h = {h:g}, given {self.t_end:g}")
            if steps > MOST_STEPS:
                yield misfit("h", f"more than {MOST_STEPS} steps to t_end, given {h:g}")
            if errors and abs(steps - round(steps)) > 1e-6:
                yield misfit(
                    "h",
                    f"errors need a whole number of steps to t_end = {self.t_end:g}, given "
                    f"{h:g}; the nearest is {dividing(self.t_end, max(round(steps), 1))}"
                    f"{fitting_end(self.t_end, h, self.h)}",
                )

    def _misfits_of_the_window(self) -> Iterator[PydanticCustomError]:
        """A window of errors without errors, or beyond the end of the shortest march."""
        if self.error is None:
            return
        if "error" not in self.measure:
            yield misfit("error", "needs 'measure: error'")
        until = self.error.value().until
        ends = [self.t_end] if self.t_end else [(self.steps or 0) * h for h in self.h]
        if until is not None and until > min(ends) * (1 + 1e-9):
            text = f"over ends at {until:g}, and the march at {min(ends):g}"
            yield misfit("error", text)

    def _unmeasurable(self, measure: Measure) -> Iterator[PydanticCustomError]:
        """Why these keys leave nothing of a measure."""
        if self.steps == 0 and measure.along_steps:
            yield misfit("steps", f"no {measure.name} without steps; set 'measure: condition'")
        if measure.stop is False and self.stop is not None:
            yield misfit(
                "measure" if "measure" in self.model_fields_set else "stop",
                "with 'stop' Newton's iteration ends at a tolerance, not at rounding; 'measure' "
                f"cannot have {measure.name}",
            )
        if measure.stop and self.stop is None:
            yield misfit("measure", f"{measure.name} needs 'stop'")
        if measure.solvers and not set(self.linear_solver) <= set(measure.solvers):
            solvers = " or ".join(measure.solvers)
            yield misfit("measure", f"{measure.name} needs linear_solver {solvers}")

    def _unfit(self) -> Iterator[PydanticCustomError]:
        """Errors for problems that a study cannot use; loads problems only where it matters."""
        yield from self._out_of_time()
        if not (
            COMPENSATED in self.evaluation
            or STATIC in self.linear_solver
            or "float32" in self.precision
        ):
            return
        names = ["form", "formulation", "projection", "evaluation", "precision", "linear_solver"]
        for spec in self.problem:
            traits = spec.traits()
            for at in self._combinations(*names):
                yield from starmap(misfit, fitting.of_problem(traits, traits.sample, at))

    def _combinations(self, *names: str) -> Iterator[dict[str, Any]]:
        """Every combination of the values along some axes."""
        values_of = axes.values(self)
        for values in product(*(values_of[name] for name in names)):
            yield dict(zip(names, values, strict=True))

    def _out_of_time(self) -> Iterator[PydanticCustomError]:
        """Times of a trajectory that a march does not come to, and marches past a table's end."""
        kept = self.kept
        tabled = any(isinstance(spec, MechanismFile) for spec in self.problem)
        if not tabled and (kept is None or not kept.at):
            return
        for spec, (sequence, h, steps) in product(self.problem, self._lengths()):
            sample = spec.traits().sample
            grid = TimeGrid.of(sequence, sample.t0, h, steps)
            start, end = grid.t0, grid.t(steps)
            if kept and (time := kept.outside(grid, steps)) is not None:
                yield misfit(
                    "trajectory",
                    f"{time:g} s is outside the march with h = {h:g}, {start:g} to {end:g} s",
                )
            if isinstance(spec, MechanismFile) and is_beyond(sample.until, end - start):
                yield misfit(
                    "steps" if self.steps is not None else "t_end",
                    f"must be at most {sample.until:g} s, where a table of {spec.label} ends, "
                    f"given {end - start:g} s",
                )

    def _lengths(self) -> list[tuple[StepSequence, float, int]]:
        """Sequences, step sizes and steps; none where the march has no length."""
        every = [(sequence.value(), h) for sequence in self.h_sequence for h in self.h]
        if self.steps is not None:
            return [(sequence, h, self.steps) for sequence, h in every]
        end = self.t_end
        if end is None:
            return []
        return [(how, h, steps_until(end, h, how)) for how, h in every if end / h <= MOST_STEPS]

    @classmethod
    def missing_key(cls, key: str) -> str:
        """Message for a key that must be given: names that are its values."""
        return f"missing{nearest(None, NAMES[key])}" if key in NAMES else "missing"

    def axes(self) -> dict[str, tuple[Any, ...]]:
        """Values along each axis by which cells differ, as CSVs would have them."""
        values = axes.values(self)
        values["preconditioning"] = tuple(map(label, values["preconditioning"]))
        values["code"] = tuple(map(label, values["code"]))
        solvers = (_OF_AUTO if of == AUTO else (of,) for of in values["linear_solver"])
        values["linear_solver"] = tuple(chain.from_iterable(solvers))
        return {**values, "measure": self.measure, "initial": (self.steps == 0,)}

    @property
    def kept(self) -> Kept | None:
        """The part of its marches that it keeps; None if it measures no trajectory."""
        if "trajectory" not in self.measure:
            return None
        return Kept() if self.trajectory is None else self.trajectory.value()

    @property
    def count(self) -> int:
        """Number of cells."""
        sizes = {name: len(values) for name, values in axes.values(self).items()}
        others, codes = len(self.others), sizes.pop("code")
        inside = math.prod(sizes[name] for name in other_codes.INSIDE)
        return math.prod(sizes.values()) // inside * (inside * (codes - others) + others)

    @property
    def others(self) -> list[str]:
        """Names of the other codes."""
        return [code.name for code in axes.values(self)["code"] if not isinstance(code, str)]

    def recorded(self) -> int:
        """Most numbers in its trajectories."""
        if (kept := self.kept) is None:
            return 0
        traits = [spec.traits() for spec in self.problem]
        sizes = [
            {"lambda": t.m, ENERGY: 1, OUTPUT: _outputs(t), DRIFT: 2} | dict.fromkeys("uva", t.n)
            for t in traits
        ]
        width = sum(2 + sum(size[name] for name in kept.keep) for size in sizes)
        steps = [last for *_, last in self._lengths()]
        looks = sum(len(kept.at) or -(-last // kept.every) + 1 for last in steps)
        others = self.count // (len(self.h) * len(self.h_sequence) * len(self.problem))
        return int(looks * width * others)

    def cells(self) -> Iterator[Cell]:
        """Cells in the order of the CSV."""
        values = axes.values(self)
        first = {name: of[0] for name, of in values.items()}
        settings = {of.name: getattr(self, of.name) for of in axes.cell_axes() if not of.cell}
        for at in axes.grid(values):
            if not other_codes.counts(at, first):
                continue
            h, steps = at["h"], self.steps
            if steps is None:
                steps = steps_until(self.t_end, h, at["h_sequence"])
            marched = {
                "t_end": self.t_end if self.t_end is not None else steps * h,
                "steps": steps,
                "krylov": self.krylov.value() if at["linear_solver"] == GMRES else None,
                "trajectory": self.kept,
                "error": self.error.value() if self.error is not None else None,
                "twins": self.twins if any(MEASURES[name].twins for name in self.measure) else 0,
            }
            yield Cell(**settings | at | marched)


def _field(axis: Axis) -> tuple[Any, FieldInfo]:
    """Key of a config that an axis has."""
    default: Any = keys.KrylovConfig() if axis.name == "krylov" else axis.default
    own = {"code": other_codes.Codes, "reference": other_codes.GivenReference}
    of = own[axis.name] if axis.name in own else keys.annotation(axis)
    return of, Field(default, description=axis.about, validate_default=axis.many)


if TYPE_CHECKING:
    Case = _Rules
else:
    Case = create_model(
        "Case",
        __base__=_Rules,
        __doc__="A full grid: every problem, form, scaling and step size with every other.",
        **{axis.name: _field(axis) for axis in axes.cell_axes()},
    )


class Study(documents.StrictModel):
    """A study: a name and its cases."""

    study: Name = Field(description="names the CSV")
    description: str = Field("", description="one line for `list`")
    figures: Figures | None = Field(
        None, description="what `plot` draws of it; default: what its results compare"
    )
    tables: Tables | None = Field(
        None, description="what `tables` prints of it; default: scalings by quantities"
    )
    expect: Expectations | None = Field(
        None, description="slopes and levels that `check` asserts besides the predicted orders"
    )
    cases: tuple[Case, ...]
    _expected_at: tuple[str, tuple[int, ...]] = PrivateAttr(("", ()))
    _origin: str = PrivateAttr("")

    @property
    def expected_at(self) -> tuple[str, tuple[int, ...]]:
        """The file, and the line of each expectation in it; no lines without a file."""
        return self._expected_at

    @property
    def count(self) -> int:
        """Number of cells."""
        return sum(case.count for case in self.cases)

    @property
    def origin(self) -> str:
        """Its file, resolved; the bare name of a shipped study; empty for one without a file."""
        return self._origin

    def cells(self) -> list[Cell]:
        """All cells in the order of the CSV."""
        return [cell for case in self.cases for cell in case.cells()]


def load(
    path: Path, name: str | None = None, allow_code: bool = False, timeout: float | None = None,
    settings: Mapping[str, str] = NOTHING,
) -> Study:  # fmt: skip
    """Study from a YAML file, with other values of some keys.

    Keys of a case may stand at the top: they hold for every case that does not
    set them, and without ``cases`` they are the only case.
    """
    document = overrides.changed(documents.read(path, name), settings)
    study = parse(document, Surroundings(path.parent, allow_code, timeout))
    study._origin = str(path.resolve())
    return study


def parse(document: Document, around: Surroundings | None = None) -> Study:
    """Study from a document; see :func:`load`."""
    document = document.renamed(ALIASES, frozenset(("problem",)))
    data = document.data
    if not isinstance(data, dict):
        raise document.error((), "must be a mapping of keys to values, such as 'study: my-study'")
    if loading.is_mechanism(data) and data.keys().isdisjoint(("study", "cases", "problem", "h")):
        raise document.error((), "is a mechanism, not a study: a study has it as its 'problem'")
    # What is reported already is so for this document only.
    around = replace(around or Surroundings(), problems={})
    mistakes = documents.Mistakes()
    head, shared, more = _keys_at_the_top(document, mistakes)
    entries = data.get("cases", [] if "cases" in head else [{}])
    if "cases" in data:
        if not isinstance(entries, list) or not entries:
            mistakes.note(document.error(("cases",), "must be a list of cases, at least one"))
            entries = []
        if len(entries) > MOST_CASES:
            raise document.error(("cases",), f"at most {MOST_CASES} cases, given {len(entries)}")
    cases = _cases(document, shared, entries, around, mistakes)
    with mistakes.gathered():
        named = {**head, "cases": [*cases.values()]}
        study = documents.validate(document, Study, named, context=around)
    for refuse in (_refuse_repeated_cells, _refuse_repeated_labels, _refuse_long_trajectories):
        with mistakes.gathered():
            refuse(document, cases)
    mistakes.refuse(more=more)
    assert len(study.cases) == len(entries)
    _require_shown(document, study)
    lines = (document.line(("expect", i)) for i in range(len(study.expect or ())))
    study._expected_at = (document.name, tuple(filter(None, lines)))
    for spec in dict.fromkeys(spec for case in study.cases for spec in case.problem):
        warn_of(spec)
    for case in study.cases:
        if case.others and (inside := [of for of in case.measure if of not in OF_STATES]):
            warn(f"{', '.join(inside)}: not of {', '.join(case.others)}; only {axes.OURS} shows it")
    return study


def _keys_at_the_top(
    document: Document, mistakes: documents.Mistakes
) -> tuple[dict[str, Any], dict[str, Any], int]:
    """Keys of the study, those of its cases, and how many unknown ones go unreported."""
    data, allowed = document.data, (*shipped.STUDY_KEYS, *Case.model_fields)
    head = {key: data[key] for key in shipped.STUDY_KEYS[:-1] if key in data}
    shared = {key: value for key, value in data.items() if key in Case.model_fields}
    unknown = [key for key in data if key not in allowed]
    for key in unknown[: documents.MOST_REPORTED]:
        mistakes.note(document.error((key,), f"unknown key{nearest(key, allowed)}"))
        # What was meant by a misspelled key is not missing.
        meant = closest(key, allowed)
        if meant is not None and meant not in data:
            (shared if meant in Case.model_fields else head)[meant] = documents.REPORTED
    return head, shared, len(unknown[documents.MOST_REPORTED :])


def _cases(
    document: Document,
    shared: Mapping[str, Any],
    entries: Sequence[Any],
    around: Surroundings,
    mistakes: documents.Mistakes,
) -> dict[int, Case]:
    """Place → case, of those without a mistake."""
    cases: dict[int, Case] = {}
    count = 0
    for i, case in enumerate(entries):
        if mistakes.full:  # nobody reads a thousand, and looking takes its time
            mistakes.stop()
            break
        with mistakes.gathered():
            cases[i] = _case(document, shared, case, i, around)
            count += cases[i].count
        if count > _MOST_CELLS:
            mistakes.note(document.error(("cases",), _TOO_MANY_CELLS))
            break
    return cases


def warn_of(spec: ProblemSpec) -> None:
    """Warn of what a mechanism file can hardly mean."""
    if isinstance(spec, MechanismFile):
        warn(*spec.load().doubts)


def _case(
    document: Document, shared: Mapping[str, Any], entry: Any, index: int, around: Surroundings
) -> Case:
    if not isinstance(entry, dict):
        raise document.error(("cases", index), "must be a mapping of keys to values")

    def locate(path: KeyPath) -> KeyPath:
        if "cases" in document.data and (not path or path[0] in entry or path[0] not in shared):
            return ("cases", index, *path)
        return path

    if "t_end" in entry or "steps" in entry:
        shared = {key: value for key, value in shared.items() if key not in ("t_end", "steps")}
    given = {**shared, **entry}
    if "code" in given:
        given = {**other_codes.USUAL, **given}
    return documents.validate(document, Case, given, locate, around)


def _refuse_repeated_cells(document: Document, cases: Mapping[int, Case]) -> None:
    """Grids have a cell in common if they share a value along every axis."""
    known: list[dict[str, frozenset[Any]]] = []
    for case in cases.values():
        ours = case.axes()
        for theirs in known:
            both = {name: [v for v in ours[name] if v in theirs[name]] for name in ours}
            if all(both.values()):
                problem, form, scaling, h, measure = (
                    both[name][0] for name in ("problem", "form", "preconditioning", "h", "measure")
                )
                raise document.error(
                    ("cases",),
                    f"two cases have {problem.label}, {form}, "
                    f"{axes.value_text('preconditioning', scaling)}, h = {h:g}, {measure}",
                )
        known.append({name: frozenset(values) for name, values in ours.items()})


def _outputs(traits: Traits) -> int:
    """How many outputs a problem has; of a large member of a family, about."""
    outputs = traits.sample.outputs
    # As many for each coordinate as a small one.
    share = len(outputs.names) / traits.sample.n if outputs else 0
    return round(share * traits.n)


def _refuse_long_trajectories(document: Document, cases: Mapping[int, Case]) -> None:
    numbers = sum(case.recorded() for case in cases.values())
    if numbers > _MOST_RECORDED:
        key = next(key for key in ("trajectory", "cases", "measure") if key in document.data)
        raise document.error(
            (key,),
            f"trajectory of {numbers} numbers in all cases, at most {_MOST_RECORDED}; "
            "keep fewer steps, or less of each",
        )


def _refuse_repeated_labels(document: Document, cases: Mapping[int, Case]) -> None:
    """Problems that the CSV could not tell apart."""
    known: dict[str, ProblemSpec] = {}
    for i, case in cases.items():
        for spec in case.problem:
            if known.setdefault(spec.label, spec) != spec:
                path = ("cases", i, "problem") if "cases" in document.data else ("problem",)
                raise document.error(
                    path, f"two problems would be {spec.label!r} in the CSV; rename a file"
                )


def _require_shown(document: Document, study: Study) -> None:
    """Figures and tables must be of what the study measures, and figures must be files apart."""
    known: dict[str, Collection[str]] = {
        "measure": {name: None for case in study.cases for name in case.measure},
        "problem": {spec.label: None for case in study.cases for spec in case.problem},
        "form": {name: None for case in study.cases for name in case.form},
    }
    for kind, models in (("figures", study.figures or ()), ("tables", study.tables or ())):
        for (i, model), key in product(enumerate(models), known):
            value = getattr(model, key) or ()
            for name in (value,) if isinstance(value, str) else value:
                needed = showable.needed(name) if key == "measure" else ()
                if name not in known[key] and not set(needed) & set(known[key]):
                    text = f"{name!r} is not among the study's{nearest(name, known[key])}"
                    raise document.error((kind, i, key), text)
    names = [figure.name for figure in study.figures or ()]
    for i, name in enumerate(names):
        if name is not None and name in names[:i]:
            text = f"{name!r} is the name of another figure"
            raise document.error(("figures", i, "name"), text)


def load_shipped(name: str, settings: Mapping[str, str] = NOTHING) -> Study:
    """The shipped config of this name, whatever lies in the current folder."""
    study = load(shipped.folder() / f"{name}.yaml", f"{name}.yaml", settings=settings)
    study._origin = name
    return study


def find(
    config: str, allow_code: bool = False, timeout: float | None = None,
    settings: Mapping[str, str] = NOTHING,
) -> Study:  # fmt: skip
    """Study from a file (``.yaml``, ``.yml`` or a path), or the shipped config of this name.

    Loading a problem in Python takes ``timeout`` seconds at most; for settings see `overrides`.
    """
    if config in shipped.names():
        return load_shipped(config, settings)
    config = with_ending(config)
    path = Path(config)
    if path.suffix in (".yaml", ".yml"):
        return load(path, config, allow_code, timeout, settings)
    if path.exists():
        raise DocumentError(f"{config}: is not a study; give a YAML file, or a shipped study")
    near = nearest(config, shipped.names())
    raise DocumentError(f"{config}: no such file and no shipped study{near}")
