"""Study configs: YAML in, frozen models and cells out."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import MISSING, dataclass, field, fields, replace
from itertools import chain, product
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    WrapValidator,
    create_model,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from newmark_cli import documents
from newmark_cli.documents import (
    WHOLE,
    Document,
    DocumentError,
    KeyPath,
    Number,
    StrictModel,
    misfit,
)
from newmark_cli.errors import InputError
from newmark_cli.json_schema import JsonSchema, Shown, also, given
from newmark_cli.mechanisms import planar
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import MechanismFile, ProblemSpec, PythonFactory, Shipped, Sized
from newmark_cli.newmark.forms import FORMS, ROWS
from newmark_cli.newmark.integrator import (
    FIELDS,
    INTEGRATORS,
    Integrator,
    IntegratorError,
    parameters,
)
from newmark_cli.newmark.linear.choice import (
    AUTO,
    DENSE,
    GMRES,
    LINEAR_SOLVERS,
    MINRES,
    SPARSE,
    Krylov,
    choose,
)
from newmark_cli.newmark.linear.krylov import is_symmetric
from newmark_cli.newmark.monomial import LONGEST, SYMBOLS
from newmark_cli.newmark.scaling import VARIANTS, Preconditioning, ScalingError
from newmark_cli.newmark.scheme import (
    COMPENSATED,
    DIRECT,
    EVALUATIONS,
    PRECISIONS,
    Scheme,
    Tolerance,
)
from newmark_cli.problems.problem import Problem
from newmark_cli.spelling import closest, nearest
from newmark_cli.study.cell import STATUSES, Cell

MEASURES = (
    "correction", "condition", "sensitivity", "error", "invariant", "tolerance", "history",
    "krylov",
)  # fmt: skip
#: Measures that need steps; the others can be taken at the initial state.
ALONG_STEPS = ("correction", "error", "invariant", "tolerance", "history", "krylov")

#: Shipped configs that `reproduce` runs: the paper's, and with `--all` those past it.
REPRODUCED = ("pendulum-u", "pendulum-v", "pendulum-a", "andrews-u", "all-forms", "sensitivity")
BEYOND = ("integrators", "multipliers", "error", "tolerance", "krylov", "precision", "history")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_RESERVED = ("slopes",)
_MOST_STEPS = 20_000_000
# More is a slip of the finger, and would keep `validate` busy.
_MOST_ITEMS = 1_000
MOST_CASES = 500
_MOST_CELLS = 20_000
_TOO_MANY_CELLS = f"more than {_MOST_CELLS} cells"


def _one_or_more(
    value: Any, validate: Callable[[Any], tuple[Any, ...]], info: ValidationInfo
) -> tuple[Any, ...]:
    """A value or a list of values, each once."""
    given = value if isinstance(value, list) else [value]
    if len(given) > _MOST_ITEMS:
        raise ValueError(f"at most {_MOST_ITEMS} values, given {len(given)}")
    try:
        values = validate(given)
    except ValidationError:
        # Not before: the name of a file may have a comma in it.
        documents.require_brackets(value, info)
        raise
    seen = set()
    for item in values:
        # A scaling of one's own has no hash.
        if repr(item) in seen:
            name = getattr(item, "label", getattr(item, "name", item))
            raise ValueError(f"given twice: {name}")
        seen.add(repr(item))
    return values


def _written_once_or_more(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
    several = handler(schema) | {"maxItems": _MOST_ITEMS, "uniqueItems": True}
    return {"anyOf": [several["items"], several]}


Item = TypeVar("Item")
OneOrMore = Annotated[
    tuple[Item, ...],
    Field(min_length=1),
    WrapValidator(_one_or_more),
    Shown(_written_once_or_more),
]


@dataclass(frozen=True)
class _Known:
    """One of the names of a registry."""

    kind: str
    allowed: tuple[str, ...]

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        return {"type": "string", "enum": list(self.allowed)}

    def _check(self, name: str) -> str:
        if name not in self.allowed:
            raise documents.unknown_name(self.kind, name, self.allowed)
        return name


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise ValueError("must be a name of letters, digits, '.', '_' and '-'")
    if text in _RESERVED:
        raise ValueError("is the name of a file that 'check' writes; take another name")
    return text


Positive = Annotated[Number, Field(gt=0)]
Name = Annotated[
    str,
    AfterValidator(_name),
    also(pattern=f"^{_NAME.pattern}$", not_={"enum": list(_RESERVED)}),
]
# A factor of a scaling, but that nobody counts its parentheses: symbols and positive
# numbers with whole powers up to 16, joined by * and /.
_ATOM = rf"({'|'.join(SYMBOLS)}|(?=[0-9.]*[1-9])([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?)"
_POWER = r"([ )]*(\^|\*\*)[ (]*(-[ (]*)?(1[0-6]|[0-9])(?![0-9]))?"
_MONOMIAL = rf"^[ (]*{_ATOM}{_POWER}[ )]*([*/][ (]*{_ATOM}{_POWER}[ )]*)*$"
Factor = Annotated[
    str | Annotated[int, Strict()] | Number,
    Field(union_mode="left_to_right"),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "pattern": _MONOMIAL, "maxLength": LONGEST},
                {"type": "number", "exclusiveMinimum": 0},
            ],
        }
    ),
]


def _blocks(*names: str) -> Shown:
    """Mapping with these keys; `own_scaling` knows which of them a form has."""

    def written(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
        factor = handler(schema)["additionalProperties"] | {"title": "Factor"}
        properties = dict.fromkeys(names, factor)
        return {"type": "object", "properties": properties, "additionalProperties": False}

    return Shown(written)


class OwnScaling(StrictModel):
    """A scaling of one's own; blocks that are not named keep factor 1."""

    name: Annotated[Name, also(not_={"enum": [*_RESERVED, *VARIANTS]})] = Field(
        description="name in CSVs and figures"
    )
    left: Annotated[dict[str, Factor], _blocks(*ROWS)] = Field(
        {}, description="row block D, V, K, C → monomial in beta, gamma and h"
    )
    right: Annotated[dict[str, Factor], _blocks(*FIELDS, "lambda")] = Field(
        {}, description="unknown u, v, a, lambda → monomial in beta, gamma and h"
    )

    @model_validator(mode="after")
    def _not_a_variant(self) -> "OwnScaling":
        if self.name in VARIANTS:
            raise misfit("name", f"{self.name!r} is a variant of the paper; take another name")
        return self

    def preconditioning(self) -> Preconditioning:
        """The core's value."""
        # Without blanks, so that the label in the CSV can be read back.
        left, right = (
            tuple((block, "".join(str(factor).split())) for block, factor in side.items())
            for side in (self.left, self.right)
        )
        return Preconditioning(self.name, left, right, own=True)


#: Values of parameters in the examples of error messages.
_EXAMPLES = {"beta": 0.25, "gamma": 0.5, "rho": 0.9, "alpha": 0.1}


def _example(method: str) -> str:
    """How a config spells an integrator."""
    given = "".join(f", {name}: {_EXAMPLES[name]:g}" for name in parameters(method))
    return f"{{method: {method}{given}}}"


class IntegratorConfig(StrictModel):
    """An integrator of the Newmark family; each method has parameters of its own."""

    method: Annotated[str, _Known("method", tuple(INTEGRATORS))] = "newmark"
    # The integrators check the bounds, and say why; they stand here for JSON Schema.
    beta: Annotated[Number, also(exclusiveMinimum=0)] | None = Field(
        None, description="β of newmark, 0.25 when omitted"
    )
    gamma: Annotated[Number, also(minimum=0.5)] | None = Field(
        None, description="γ of newmark, 0.5 when omitted"
    )
    rho: Annotated[Number, also(minimum=0, maximum=1)] | None = Field(
        None, description="ρ∞ of generalized-alpha, 0 to 1"
    )
    alpha: Annotated[Number, also(minimum=0, maximum=1 / 3)] | None = Field(
        None, description="α of hht, 0 to 1/3"
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        reference = handler(schema)
        rules = []
        for method, integrator in INTEGRATORS.items():
            is_it: JsonSchema = {"properties": {"method": {"const": method}}}
            if method != cls.model_fields["method"].default:
                is_it["required"] = ["method"]
            absent = [
                name for name in cls.model_fields if name not in ("method", *parameters(method))
            ]
            needed = [f.name for f in fields(integrator) if f.default is MISSING]
            then = {"properties": {name: {"type": "null"} for name in absent}}
            rules.append({"if": is_it, "then": {"allOf": [then, *map(given, needed)]}})
        handler.resolve_ref_schema(reference)["allOf"] = rules
        return reference

    @model_validator(mode="before")
    @classmethod
    def _spelled(cls, data: Any) -> Any:
        """Other spellings are refused with the right one."""
        if isinstance(data, str):
            method = closest(data, INTEGRATORS) or "generalized-alpha"
            text = f"must be a mapping such as {_example(method)}, given {data[:60]!r}"
            raise documents.refused(IntegratorError(text))
        return data

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """Also where the name of a method stands as a key."""
        method = closest(key, INTEGRATORS)
        if method is not None:
            return f"unknown key; write {_example(method)}"
        named = [method for method in INTEGRATORS if closest(key, parameters(method))]
        example = _example(named[0] if named else "generalized-alpha")
        return f"{super().unknown_key(key)}; for example {example}"

    @model_validator(mode="after")
    def _usable(self) -> "IntegratorConfig":
        given = self._parameters()
        allowed = parameters(self.method)
        example = f"for example {_example(self.method)}"
        has = f"has {', '.join(allowed)}" if allowed else "has no parameters"
        owners = {name: method for method in INTEGRATORS for name in parameters(method)}
        documents.together(
            misfit(
                name,
                f"is not a parameter of {self.method}, which {has}; it belongs to "
                f"{owners[name]}: {_example(owners[name])}",
            )
            for name in given
            if name not in allowed
        )
        try:
            self.integrator()
        except TypeError:
            missing = [name for name in allowed if name not in given]
            raise misfit("method", f"{self.method} needs {', '.join(missing)}; {example}") from None
        except IntegratorError as error:
            raise misfit(str(error).split()[0], f"{error}; {example}") from None
        return self

    def _parameters(self) -> dict[str, float]:
        given = self.model_dump(exclude={"method"}, exclude_none=True)
        return {name: float(value) for name, value in given.items()}

    def integrator(self) -> Integrator:
        """The core's value."""
        integrator: Integrator = INTEGRATORS[self.method](**self._parameters())
        return integrator


class StopConfig(StrictModel):
    """Stops Newton at ‖q̄‖ ≤ absolute + relative ‖scaled unknowns‖, not where rounding does."""

    model_config = ConfigDict(json_schema_extra={"anyOf": [given("absolute"), given("relative")]})

    absolute: Positive | None = Field(None, description="bound of the scaled correction")
    relative: Positive | None = Field(None, description="bound relative to the scaled unknowns")

    @model_validator(mode="after")
    def _given(self) -> "StopConfig":
        if self.absolute is None and self.relative is None:
            raise ValueError("needs absolute or relative")
        return self

    def tolerance(self) -> Tolerance:
        """The core's value."""
        return Tolerance(self.absolute or 0.0, self.relative or 0.0)


class KrylovConfig(StrictModel):
    """How far GMRES and MINRES go."""

    tolerance: Positive = Field(
        Krylov().tolerance, lt=1, description="relative residual to reach, in balanced rows"
    )
    limit: Annotated[int, Strict(), Field(ge=1, le=100_000), WHOLE] = Field(
        Krylov().limit, description="most iterations of one solve"
    )

    def options(self) -> Krylov:
        """The core's value."""
        return Krylov(self.tolerance, self.limit)


def _preconditioning(value: Any) -> Any:
    if isinstance(value, dict):
        return OwnScaling.model_validate(value)
    if not isinstance(value, str) or value not in VARIANTS:
        raise documents.unknown_name("preconditioning", value, VARIANTS)
    return value


@dataclass(frozen=True)
class Surroundings:
    """What a config's meaning depends on besides its text.

    Attributes:
        folder: Where files that it names are looked for.
        allow_code: Whether problems in Python may be loaded.
        refused: Problems whose mistakes are reported already.
    """

    folder: Path = Path()
    allow_code: bool = False
    refused: set[ProblemSpec] = field(default_factory=set, compare=False)


def _problem(value: Any, info: ValidationInfo) -> ProblemSpec:
    around = info.context or Surroundings()
    if isinstance(value, ProblemSpec):
        return value
    if isinstance(value, dict) and "python" in value:
        return _python_problem(value, around)
    if isinstance(value, dict):
        if len(value) != 1:
            raise ValueError("must be one family with its sizes, such as {chain: {links: 1000}}")
        (family,) = value
        if family not in FAMILIES:
            raise documents.unknown_name("family of problems", family, (*FAMILIES, "python"))
        # As a mapping, so that a mistake is found under the family's name.
        sizes: Any = dict.__class_getitem__((str, FAMILIES[family].size))
        check: TypeAdapter[Any] = TypeAdapter(sizes)
        return Sized(family, tuple(check.validate_python(value)[family]))
    if isinstance(value, str) and value in FAMILIES:
        sizes = ", ".join(f"{parameter}: N" for parameter in FAMILIES[value].parameters)
        raise ValueError(f"needs a size: {{{value}: {{{sizes}}}}}")
    if isinstance(value, str) and Path(value).suffix in (".yaml", ".yml"):
        return _loaded(MechanismFile((around.folder / value).absolute(), value), around)
    if not isinstance(value, str) or value not in PROBLEMS:
        raise documents.unknown_name("problem", value, (*PROBLEMS, *FAMILIES))
    return Shipped(value)


def _python_problem(value: dict[str, Any], around: Surroundings) -> ProblemSpec:
    unknown = [key for key in value if key not in ("python", "args")]
    if unknown:
        raise documents.unknown_name("key", unknown[0], ("python", "args"))
    file, colon, factory = str(value["python"]).rpartition(":")
    arguments = value.get("args", {})
    if not colon or not file or not factory.isidentifier():
        raise misfit("python", 'must be "file.py:factory"')
    if not isinstance(arguments, dict):
        raise misfit("args", "must be a mapping of names to values")
    if not all(isinstance(item, str | int | float | bool | None) for item in arguments.values()):
        raise misfit("args", "values must be numbers, text, true or false")
    if not around.allow_code:
        raise misfit("python", f"{file} is code, which runs only with --allow-code")
    path = (around.folder / file).absolute()
    given = tuple(arguments.items())
    return _loaded(PythonFactory(path, factory, given, str(value["python"])), around)


def _loaded(spec: ProblemSpec, around: Surroundings) -> ProblemSpec:
    """The problem, once it has shown that it can be used."""
    if spec in around.refused:
        raise documents.reported()
    try:
        spec.load()
    except InputError as error:
        around.refused.add(spec)
        raise documents.refused(error) from None
    return spec


def _auto_alone(solvers: tuple[str, ...]) -> tuple[str, ...]:
    if AUTO in solvers and {DENSE, SPARSE} & set(solvers):
        raise ValueError(f"{AUTO} stands for {DENSE} or {SPARSE}, which is then given twice")
    return solvers


def _written_solvers(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
    both = [{"contains": {"const": AUTO}}, {"contains": {"enum": [DENSE, SPARSE]}}]
    return _written_once_or_more(schema, handler) | {"not": {"type": "array", "allOf": both}}


def _written_variant(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
    """What `_preconditioning` takes."""
    own = handler(OwnScaling.__pydantic_core_schema__)
    return {"anyOf": [{"type": "string", "enum": list(VARIANTS)}, own]}


def _written_problem(schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchema:
    """What `_problem` takes."""

    def mapping(about: str, properties: JsonSchema, required: str) -> JsonSchema:
        return {
            "type": "object",
            "description": about,
            "properties": properties,
            "required": [required],
            "additionalProperties": False,
        }

    arguments = {
        "type": "object",
        "description": "arguments of the function",
        "additionalProperties": {"type": ["string", "number", "boolean", "null"]},
    }
    # Identifiers may have letters of any script, which no pattern names.
    code = {"type": "string", "pattern": r"[^:]:[^\s\d:()./-][^\s:()./-]*$"}
    return {
        "anyOf": [
            {"type": "string", "enum": list(PROBLEMS)},
            {
                "type": "string",
                "description": "mechanism file, looked for beside the config",
                "pattern": r"[^/]\.ya?ml/*$",
            },
            *(
                mapping(family.title, {name: handler(family.size.__pydantic_core_schema__)}, name)
                for name, family in FAMILIES.items()
            ),
            mapping(
                "function in a Python file, which runs only with --allow-code",
                {"python": code, "args": arguments},
                "python",
            ),
        ]
    }


Variant = Annotated[Any, BeforeValidator(_preconditioning), Shown(_written_variant)]
Problems = OneOrMore[
    Annotated[
        Any,
        BeforeValidator(_problem),
        PlainSerializer(lambda p: p.given),
        Shown(_written_problem),
    ]
]
Variants = OneOrMore[Variant]
StepSizes = OneOrMore[Positive]
Forms = OneOrMore[Annotated[str, _Known("form", tuple(FORMS))]]
Measures = OneOrMore[Annotated[str, _Known("measure", MEASURES)]]
Evaluations = OneOrMore[Annotated[str, _Known("evaluation", EVALUATIONS)]]
Precisions = OneOrMore[Annotated[str, _Known("precision", tuple(PRECISIONS))]]
LinearSolvers = Annotated[
    tuple[Annotated[str, _Known("linear solver", LINEAR_SOLVERS)], ...],
    Field(min_length=1),
    WrapValidator(_one_or_more),
    AfterValidator(_auto_alone),
    Shown(_written_solvers),
]
Accepted = OneOrMore[Annotated[str, _Known("status", STATUSES[1:])]]
Integrators = OneOrMore[IntegratorConfig]


class Case(StrictModel):
    """A full grid: every problem, form, scaling and step size with every other."""

    problem: Problems = Field(
        description="name of a problem, mechanism file, family with its size, "
        "Python factory, or a list"
    )
    form: Forms = Field(description="name of a form, or a list")
    preconditioning: Variants = Field(description="variant or scaling of one's own, or a list")
    h: StepSizes = Field(description="step sizes (s)")
    t_end: Positive | None = Field(None, description="end of the march, from 0 (s)")
    steps: Annotated[int, Strict(), Field(ge=0, le=_MOST_STEPS), WHOLE] | None = Field(
        None, description="steps to take, in place of t_end; 0: measure at the initial state"
    )
    integrator: Integrators = Field(
        (IntegratorConfig(),), description="an integrator or a list; default: trapezoidal"
    )
    evaluation: Evaluations = Field(
        (DIRECT,), description="in the unknowns themselves, or in compensated increments"
    )
    precision: Precisions = Field(("float64",), description="arithmetic of the march")
    stop: StopConfig | None = Field(
        None, description="tolerance on the scaled correction; default: where rounding stops it"
    )
    measure: Measures = Field(("correction", "condition"), description="what is measured")
    iteration_cap: Annotated[int, Strict(), Field(ge=1, le=10_000), WHOLE] = Field(
        50, description="most Newton corrections in a step"
    )
    samples: Annotated[int, Strict(), Field(ge=1, le=10_000), WHOLE] = Field(
        32, description="most steps at which J is evaluated for condition and sensitivity"
    )

    linear_solver: LinearSolvers = Field(
        (AUTO,), description="who solves for the corrections; auto: by size"
    )
    krylov: KrylovConfig = Field(KrylovConfig(), description="how far gmres and minres go")
    accept: Accepted = Field(
        (), description="statuses of cells that are what the study is about, not failures"
    )

    @model_validator(mode="after")
    def _consistent(self) -> "Case":
        if self.count > _MOST_CELLS:
            raise ValueError(_TOO_MANY_CELLS)
        documents.together(self._misfits())
        return self

    def _misfits(self) -> Iterator[PydanticCustomError]:
        """Keys that do not fit each other."""
        if (self.t_end is None) == (self.steps is None):
            given = "both" if self.steps is not None else "neither"
            yield misfit("t_end", f"needs either t_end or steps, given {given}")
        if self.t_end is not None:
            for h in self.h:
                if h > self.t_end * (1 + 1e-9):
                    yield misfit("t_end", f"shorter than the step h = {h:g}, given {self.t_end:g}")
                if self.t_end / h > _MOST_STEPS:
                    yield misfit("h", f"more than {_MOST_STEPS} steps to t_end, given {h:g}")
                steps = self.t_end / h
                if "error" in self.measure and abs(steps - round(steps)) > 1e-6:
                    yield misfit("h", f"errors need a whole number of steps to t_end, given {h:g}")
        along = [measure for measure in self.measure if measure in ALONG_STEPS]
        if self.steps == 0 and along:
            yield misfit("steps", f"no {along[0]} without steps; set 'measure: condition'")
        if self.stop is not None and "correction" in self.measure:
            yield misfit(
                "measure" if "measure" in self.model_fields_set else "stop",
                "with 'stop' Newton's iteration ends at a tolerance, not at rounding; 'measure' "
                "cannot have correction",
            )
        if self.stop is None and "tolerance" in self.measure:
            yield misfit("measure", "tolerance needs 'stop'")
        if "krylov" in self.measure and not set(self.linear_solver) <= {GMRES, MINRES}:
            yield misfit("measure", f"krylov needs linear_solver {GMRES} or {MINRES}")
        labels = [variant.label for variant in self.variants()]
        if len(set(labels)) < len(labels):
            twice = next(label for label in labels if labels.count(label) > 1)
            yield misfit("preconditioning", f"given twice: {twice}")
        for name in self.form:
            for variant in self.variants():
                try:
                    variant.scaling(FORMS[name])
                except ScalingError as error:
                    yield misfit("preconditioning", f"{variant.name}: {error}")
                    return
        yield from self._unfit()

    def _unfit(self) -> Iterator[PydanticCustomError]:
        """What a problem is not fit for; loads problems only where it matters."""
        if not (
            COMPENSATED in self.evaluation
            or MINRES in self.linear_solver
            or "float32" in self.precision
        ):
            return
        for spec in self.problem:
            traits = spec.traits()
            if COMPENSATED in self.evaluation and not traits.sample.quadratic:
                yield misfit(
                    "evaluation",
                    f"compensated needs constraints that are quadratic in u and do not depend on "
                    f"time; those of {spec.label} are not, or not declared so",
                )
            if MINRES in self.linear_solver:
                yield from self._asymmetric(spec.label, traits.sample)
            if "float32" not in self.precision:
                continue
            if not traits.sample.single:
                yield misfit("precision", f"{spec.label} is computed in float64 only")
            for form, solver in product(self.form, self.linear_solver):
                if choose(solver, traits, FORMS[form]) != DENSE:
                    yield misfit("precision", f"float32 needs {DENSE}: {spec.label}, {form}")

    def _asymmetric(self, label: str, problem: Problem) -> Iterator[PydanticCustomError]:
        for form, variant, integrator in product(self.form, self.variants(), self.integrator):
            scaling = variant.scaling(FORMS[form])
            scheme = Scheme(integrator.integrator(), FORMS[form], scaling, self.h[0])
            try:
                symmetric = is_symmetric(problem, scheme)
            except ArithmeticError:
                yield misfit("h", f"too large or too small, given {self.h[0]:g}")
                return
            if not symmetric:
                yield misfit(
                    "linear_solver",
                    f"{MINRES}: the matrix of {label}, {form}, {variant.name} is not "
                    f"symmetric; take {GMRES}",
                )

    def variants(self) -> list[Preconditioning]:
        """Scalings in the order given."""
        return [
            v.preconditioning() if isinstance(v, OwnScaling) else Preconditioning(v)
            for v in self.preconditioning
        ]

    def axes(self) -> list[tuple[Any, ...]]:
        """Values along each axis by which cells differ, problem to measure first."""
        solvers = [
            (DENSE, SPARSE) if solver == AUTO else (solver,) for solver in self.linear_solver
        ]
        return [
            self.problem,
            self.form,
            tuple(variant.label for variant in self.variants()),
            self.h,
            self.measure,
            tuple(integrator.integrator() for integrator in self.integrator),
            self.evaluation,
            self.precision,
            tuple(chain.from_iterable(solvers)),
            (self.stop,),
            (self.steps == 0,),
        ]

    @property
    def count(self) -> int:
        """Number of cells."""
        axes = (
            self.problem, self.integrator, self.evaluation, self.precision, self.linear_solver,
            self.form, self.preconditioning, self.h,
        )  # fmt: skip
        return math.prod(len(axis) for axis in axes)

    def cells(self) -> Iterator[Cell]:
        """Cells in the order of the CSV."""
        for problem, integrator, evaluation, precision, solver, form, variant, h in product(
            self.problem,
            self.integrator,
            self.evaluation,
            self.precision,
            self.linear_solver,
            self.form,
            self.variants(),
            self.h,
        ):
            steps = self.steps
            if steps is None:
                assert self.t_end is not None
                # Whole steps up to t_end; h = 1e-7 is no binary fraction.
                steps = math.floor(self.t_end / h * (1 + 1e-9))
            yield Cell(
                problem=problem,
                integrator=integrator.integrator(),
                form=form,
                preconditioning=variant,
                h=h,
                t_end=self.t_end if self.t_end is not None else steps * h,
                steps=steps,
                measure=self.measure,
                iteration_cap=self.iteration_cap,
                samples=self.samples,
                linear_solver=solver,
                evaluation=evaluation,
                precision=precision,
                stop=self.stop.tolerance() if self.stop else None,
                accept=self.accept,
                krylov=self.krylov.options() if solver in (GMRES, MINRES) else None,
            )


def _optional(field: FieldInfo) -> tuple[Any, FieldInfo]:
    optional = copy(field)
    optional.default, optional.default_factory = None, None
    return field.annotation, optional


#: Keys of a case that stand at the top, each looked at on its own.
_SHARED_KEYS: dict[str, Any] = {name: _optional(field) for name, field in Case.model_fields.items()}
_Shared = create_model("_Shared", __base__=StrictModel, **_SHARED_KEYS)


class Study(StrictModel):
    """A study: a name and its cases."""

    study: Name = Field(description="names the CSV")
    description: str = Field("", description="one line for `list`")
    cases: tuple[Case, ...]

    @property
    def count(self) -> int:
        """Number of cells."""
        return sum(case.count for case in self.cases)

    def cells(self) -> list[Cell]:
        """All cells in the order of the CSV."""
        return [cell for case in self.cases for cell in case.cells()]


_STUDY_KEYS = ("study", "description", "cases")


def load(path: Path, name: str | None = None, allow_code: bool = False) -> Study:
    """Study from a YAML file.

    Keys of a case may stand at the top: they hold for every case that does not
    set them, and without ``cases`` they are the only case.

    Args:
        path: The file.
        name: How errors name it.
        allow_code: Whether problems in Python may be loaded.

    Raises:
        DocumentError: For every mistake, each with file, line and key.
    """
    return parse(documents.read(path, name), Surroundings(path.parent, allow_code))


def parse(document: Document, around: Surroundings | None = None) -> Study:
    """Study from a document; see :func:`load`."""
    data = document.data
    if not isinstance(data, dict):
        raise document.error((), "must be a mapping of keys to values, such as 'study: my-study'")
    # What is reported already is so for this document only.
    around = replace(around or Surroundings(), refused=set())
    mistakes = documents.Mistakes()
    allowed = (*_STUDY_KEYS, *Case.model_fields)
    shared = {key: value for key, value in data.items() if key in Case.model_fields}
    head = {key: data[key] for key in ("study", "description") if key in data}
    unknown = [key for key in data if key not in allowed]
    for key in unknown[: documents.MOST_REPORTED]:
        mistakes.note(document.error((key,), f"unknown key{nearest(key, allowed)}"))
        # What was meant by a misspelled key is not missing.
        meant = closest(key, allowed)
        if meant is not None and meant not in data:
            (shared if meant in Case.model_fields else head)[meant] = documents.REPORTED
    given = data.get("cases", [] if "cases" in head else [{}])
    if "cases" in data and (not isinstance(given, list) or not given):
        mistakes.note(document.error(("cases",), "must be a list of cases, at least one"))
        given = []
    if len(given) > MOST_CASES:
        raise document.error(("cases",), f"at most {MOST_CASES} cases, given {len(given)}")
    if "cases" in data:
        # Also what every case replaces: a mistake is a mistake where nobody looks.
        try:
            documents.validate(document, _Shared, shared, context=around)
        except DocumentError as error:
            mistakes.note(error)
            wrong = {mistake.path[0] for mistake in error.mistakes if mistake.path}
            shared |= dict.fromkeys(wrong & shared.keys(), documents.REPORTED)
    cases: dict[int, Case] = {}
    for i, case in enumerate(given):
        with mistakes.gathered():
            cases[i] = _case(document, shared, case, i, around)
        if sum(case.count for case in cases.values()) > _MOST_CELLS:
            mistakes.note(document.error(("cases",), _TOO_MANY_CELLS))
            break
    with mistakes.gathered():
        study = documents.validate(document, Study, {**head, "cases": [*cases.values()]})
    for refuse in (_refuse_repeated_cells, _refuse_repeated_labels):
        with mistakes.gathered():
            refuse(document, cases)
    mistakes.refuse(more=len(unknown[documents.MOST_REPORTED :]))
    assert len(study.cases) == len(given)
    return study


def _case(
    document: Document, shared: Mapping[str, Any], given: Any, index: int, around: Surroundings
) -> Case:
    if not isinstance(given, dict):
        raise document.error(("cases", index), "must be a mapping of keys to values")

    def locate(path: KeyPath) -> KeyPath:
        if "cases" in document.data and (not path or path[0] in given or path[0] not in shared):
            return ("cases", index, *path)
        return path

    if "t_end" in given or "steps" in given:
        shared = {key: value for key, value in shared.items() if key not in ("t_end", "steps")}
    return documents.validate(document, Case, {**shared, **given}, locate, around)


def _refuse_repeated_cells(document: Document, cases: Mapping[int, Case]) -> None:
    """Grids have a cell in common if they share a value along every axis."""
    known: list[list[frozenset[Any]]] = []
    for case in cases.values():
        axes = case.axes()
        for others in known:
            if not any(other.isdisjoint(axis) for other, axis in zip(others, axes, strict=True)):
                problem, form, label, h, measure = (
                    next(value for value in axis if value in other)
                    for other, axis in list(zip(others, axes, strict=True))[:5]
                )
                raise document.error(
                    ("cases",),
                    f"two cases have {problem.label}, {form}, {label.partition('[')[0]}, "
                    f"h = {h:g}, {measure}",
                )
        known.append([frozenset(axis) for axis in axes])


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


def shipped_folder() -> Path:
    """Folder of the shipped configs: in the wheel, or at the top of a checkout."""
    package = Path(__file__).parents[1]
    in_wheel = package / "configs"
    return in_wheel if in_wheel.is_dir() else package.parent / "configs"


def shipped() -> tuple[str, ...]:
    """Names of the shipped configs."""
    return tuple(sorted(file.stem for file in shipped_folder().glob("*.yaml")))


def load_shipped(name: str) -> Study:
    """The shipped config of this name, whatever lies in the current folder."""
    return load(shipped_folder() / f"{name}.yaml", f"{name}.yaml")


def find(config: str, allow_code: bool = False) -> Study:
    """Study from a file (``.yaml``, ``.yml`` or a path), or the shipped config of this name.

    Raises:
        DocumentError: When it is neither, or is not valid.
    """
    path = Path(config)
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        return load(path, config, allow_code)
    if config in shipped():
        return load_shipped(config)
    raise DocumentError(f"{config}: no such file and no shipped config{nearest(config, shipped())}")


def problem_named(text: str) -> ProblemSpec:
    """Problem that a command line names: shipped, a mechanism file, or a label.

    Args:
        text: Such as ``andrews``, ``my.yaml`` or ``chain(links=20)``.

    Raises:
        DocumentError: When there is none, or the file is not valid.
    """
    match = re.fullmatch(r"([\w-]+)\(([\w= ]*)\)", text)
    value: Any = text
    if match:
        sizes = dict(part.partition("=")[::2] for part in match[2].split())
        value = {match[1]: {k: int(v) if v.isdecimal() else v for k, v in sizes.items()}}
    document = Document("command line", {"problem": value}, {("problem",): 1})
    spec: ProblemSpec = documents.validate(document, _OneProblem).problem
    return spec


class _OneProblem(StrictModel):
    problem: Annotated[Any, BeforeValidator(_problem)]


def describe(path: Path, name: str, allow_code: bool) -> str:
    """What a valid config or mechanism file holds, in one line.

    Args:
        path: The file.
        name: How the line names it.
        allow_code: Whether problems in Python may be loaded.

    Raises:
        DocumentError: For every mistake.
    """
    document = documents.read(path, name)
    if isinstance(document.data, dict) and "points" in document.data:
        problem = planar.built(name, document)
        return f"{name}: mechanism, {problem.n} coordinates, {problem.m} constraints"
    study = parse(document, Surroundings(path.parent, allow_code))
    return f"{name}: study {study.study}, {study.count} cells"
