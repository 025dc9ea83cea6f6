"""Types of the keys of a study config, which pydantic checks."""

import re
import sys
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from newmark_cli.mechanisms import loading
from newmark_cli.mechanisms.families import FAMILIES
from newmark_cli.mechanisms.registry import PROBLEMS
from newmark_cli.mechanisms.spec import (
    ForcedMechanism,
    MechanismFile,
    ProblemSpec,
    PythonFactory,
    Shipped,
    Sized,
    inline,
    name_and_arguments,
    with_ending,
)
from newmark_cli.newmark import steps
from newmark_cli.newmark.forms import INDEX_3, ROWS
from newmark_cli.newmark.formulation import (
    METHODS,
    PROJECTIONS,
    REPORTED,
    Formulation,
    Projection,
)
from newmark_cli.newmark.integrator import (
    FIELDS,
    INTEGRATORS,
    TRAPEZOIDAL_NAME,
    Integrator,
    IntegratorError,
    parameters,
    plain_label,
)
from newmark_cli.newmark.kept import KEEPABLE, Kept
from newmark_cli.newmark.linear.choice import AUTO, DENSE, LINEAR_SOLVERS, SPARSE, STATIC, Krylov
from newmark_cli.newmark.scaling import VARIANTS, Preconditioning
from newmark_cli.newmark.scheme import (
    BY_FIELD,
    CORRECTION,
    RESIDUAL,
    Tolerance,
)
from newmark_cli.newmark.steps import CONSTANT, LEVELS, SEQUENCES, SequenceError, StepSequence
from newmark_cli.study import axes, drawing, tabulating
from newmark_cli.study.axes import ALIASES, SATURATION, STUDY_NAME, Axis
from newmark_cli.study.cell import NOT_CONVERGING, STATUSES
from newmark_cli.study.measures import MEASURES, RECORDED
from newmark_cli.support import documents
from newmark_cli.support.documents import WHOLE, Document, Number, StrictModel, misfit
from newmark_cli.support.errors import InputError
from newmark_cli.support.json_schema import JsonSchema, Shown, also
from newmark_cli.support.spelling import closest

_RESERVED = ("slopes",)
MOST_STEPS = 20_000_000
# More is a slip of the finger, and would keep `validate` busy.
_MOST_ITEMS = 1_000
# Every row of the CSV has the problem's name, which is file, function and arguments.
_LONGEST_LABEL = 2_000
# From the beginning to the end of the text: $ would allow a line end behind it.
_LINE = r"^[^\x00-\x1f\x7f]{1,200}(?![\s\S])"


def _one_or_more(
    value: Any, validate: Callable[[Any], tuple[Any, ...]], info: ValidationInfo
) -> tuple[Any, ...]:
    """A value or a list of values, each once."""
    items = value if isinstance(value, list) else [value]
    if len(items) > _MOST_ITEMS:
        raise ValueError(f"at most {_MOST_ITEMS} values, given {len(items)}")
    try:
        values = validate(items)
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
    tuple[Item, ...], Field(min_length=1), WrapValidator(_one_or_more), Shown(_written_once_or_more)
]


@dataclass(frozen=True, eq=False)
class _Known:
    """One of some names, or what legends make of it as a value of an axis."""

    kind: str
    allowed: Collection[str]
    axis: Axis | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        return {"type": "string", "enum": list(self.allowed)}

    def _check(self, name: str) -> str:
        name = self.axis.named(name) if self.axis else name
        if name not in self.allowed:
            raise _unknown(self.kind, name, self.allowed)
        return name


#: Key of a config → the names that are its values.
_NAMES: Mapping[str, Collection[str]] = {
    **{axis.name: axis.names for axis in axes.cell_axes()},
    "problem": (*PROBLEMS, *FAMILIES),
    "measure": MEASURES,
}


def annotation(axis: Axis) -> Any:
    """What a config may give along an axis."""
    if axis.config is not None:
        return axis.config(sys.modules[__name__])
    return OneOrMore[Annotated[str, _Known(axis.title, axis.names, axis)]]  # type: ignore[misc]


def _unknown(kind: str, value: Any, allowed: Iterable[str]) -> PydanticCustomError:
    """Error of a name that is not allowed; says which keys it is a value of."""
    keys = [key for key, names in _NAMES.items() if isinstance(value, str) and value in names]
    remark = f", which is a value of the key {' or '.join(keys)}" if keys else ""
    return documents.unknown_name(kind, value, allowed, remark)


def _name(text: str) -> str:
    if not STUDY_NAME.fullmatch(text):
        raise ValueError("must be a name of letters, digits, '.', '_' and '-'")
    if text in _RESERVED:
        raise ValueError("is the name of a file that 'check' writes; take another name")
    return text


Positive = Annotated[Number, Field(gt=0)]
Count = Annotated[int, Strict(), Field(ge=1, le=10_000), WHOLE]
TwinCount = Annotated[int, Strict(), Field(ge=0, le=100), WHOLE]
StepCount = Annotated[int, Strict(), Field(ge=0, le=MOST_STEPS), WHOLE]
Name = Annotated[str, AfterValidator(_name)]
Factor = str | Annotated[int, Strict()] | Number


class Valued(StrictModel):
    """Keys that stand for a value of the core."""

    def value(self) -> Any:
        """The core's value."""
        raise NotImplementedError


Value = TypeVar("Value", bound=Valued)


def read(name: str, value: Any, model: type[Value]) -> Any:
    """The core's value of what a command line, or a function of the library, is given.

    The model is that of the config's key, and errors are those of a config, under the name.
    """
    return documents.validate(Document.of(name, value), model).value()


class OwnScaling(Valued):
    """A scaling of your own; blocks that are not named keep the factor 1."""

    name: Name = Field(description="name in CSVs and figures")
    left: dict[str, Factor] = Field(
        {}, description="row block D, V, K, C → monomial in beta, gamma and h"
    )
    right: dict[str, Factor] = Field(
        {}, description="unknown u, v, a, lambda → monomial in beta, gamma and h"
    )

    @model_validator(mode="after")
    def _not_a_variant(self) -> "OwnScaling":
        if self.name in VARIANTS:
            raise misfit("name", f"{self.name!r} is a variant of the paper; take another name")
        return self

    def value(self) -> Preconditioning:
        """The core's value."""
        # Without blanks, so that the label in the CSV can be read back.
        left, right = (
            tuple((block, "".join(str(factor).split())) for block, factor in side.items())
            for side in (self.left, self.right)
        )
        return Preconditioning(self.name, left, right, own=True)


#: Values of parameters in the examples of error messages.
_EXAMPLES = {"beta": 0.25, "gamma": 0.5, "rho": 0.9, "alpha": 0.1}


class MethodConfig(Valued):
    """A method and its parameters: a mapping, or text such as ``hht alpha=0.1``."""

    METHODS: ClassVar[Iterable[str]] = ()
    method: str

    @classmethod
    def example(cls, method: str = "") -> str:
        """How a config gives a method."""
        return f"{{method: {method or next(iter(cls.METHODS))}}}"

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        if isinstance(data, str):
            return cls._split(cls.plain(data))
        if not isinstance(data, dict | cls):
            text = f"must be the name of a method, or a mapping such as {cls.example()}"
            raise PydanticCustomError("method", "{message}", {"message": text})
        return data

    @classmethod
    def plain(cls, text: str) -> str:
        """A label from what tables and legends print of it."""
        return text

    @classmethod
    def _split(cls, text: str) -> dict[str, Any]:
        """Text as a mapping; a word without a value is true."""
        method, *words = text.split() or [""]
        mapping: dict[str, Any] = {"method": method}
        for word in words:
            name, equals, value = word.partition("=")
            why = f"{name} is given twice" if name in mapping else ""
            mapping[name] = documents.plain(value) if equals else True
            if name not in cls.model_fields:
                why = f"unknown parameter {name!r}; for example {cls.example()}"
            elif isinstance(mapping[name], str):
                why = f"{name} must be a number"
            if why:
                raise PydanticCustomError("method", "{message}", {"message": why})
        return mapping

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchema:
        mapping = handler.resolve_ref_schema(handler(schema))
        # Without its title, by which it would become a definition of the name that this one has.
        mapping = {key: value for key, value in mapping.items() if key != "title"}
        text = {"type": "string"}
        return {"anyOf": [text | {"enum": list(cls.METHODS)}, text, mapping]}

    def parameters(self) -> dict[str, float]:
        """Those that are given."""
        values = self.model_dump(exclude={"method"}, exclude_none=True)
        return {name: float(value) for name, value in values.items()}

    def _refuse_others(self, allowed: Collection[str], owners: Mapping[str, str]) -> None:
        """Refuse parameters of other methods, by parameter and method in ``owners``."""
        has = f"has {' or '.join(allowed)}" if allowed else "has no parameters"
        documents.together(
            misfit(
                name,
                f"is not a parameter of {self.method}, which {has}; it belongs to "
                f"{owners[name]}: {self.example(owners[name])}",
            )
            for name in self.parameters()
            if name not in allowed
        )

    @property
    def label(self) -> str:
        """As CSVs have it."""
        return str(self.value().label)


class IntegratorConfig(MethodConfig):
    """An integrator and its parameters: a mapping, or text such as ``hht alpha=0.1``."""

    METHODS = INTEGRATORS
    method: Annotated[str, _Known("method", INTEGRATORS)] = "newmark"
    beta: Number | None = Field(None, description="β of newmark, 0.25 when omitted")
    gamma: Number | None = Field(None, description="γ of newmark, 0.5 when omitted")
    rho: Number | None = Field(None, description="ρ∞ of generalized-alpha, 0 to 1")
    alpha: Number | None = Field(None, description="α of hht, 0 to 1/3")

    @classmethod
    def example(cls, method: str = "") -> str:
        """How a config gives a method."""
        method = method or "generalized-alpha"
        return (
            f"{{method: {method}{''.join(f', {n}: {_EXAMPLES[n]:g}' for n in parameters(method))}}}"
        )

    @model_validator(mode="before")
    @classmethod
    def _by_another_name(cls, data: Any) -> Any:
        return {} if data == {"method": TRAPEZOIDAL_NAME} else data

    @classmethod
    def plain(cls, text: str) -> str:
        """A label from what tables and legends print of it."""
        return plain_label(text)

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """Also where the name of a method stands as a key."""
        method = closest(key, INTEGRATORS)
        if method is not None:
            return f"unknown key; write {cls.example(method)}"
        named = [method for method in INTEGRATORS if closest(key, parameters(method))]
        return f"{super().unknown_key(key)}; for example {cls.example(named[0] if named else '')}"

    @model_validator(mode="after")
    def _usable(self) -> "IntegratorConfig":
        allowed, values = parameters(self.method), self.parameters()
        owners = {name: method for method in INTEGRATORS for name in parameters(method)}
        self._refuse_others(allowed, owners)
        example = f"for example {self.example(self.method)}"
        try:
            self.value()
        except TypeError:
            missing = [name for name in allowed if name not in values]
            raise misfit("method", f"{self.method} needs {', '.join(missing)}; {example}") from None
        except IntegratorError as error:
            raise misfit(str(error).split()[0], f"{error}; {example}") from None
        return self

    def value(self) -> Integrator:
        """The core's value."""
        integrator: Integrator = INTEGRATORS[self.method](**self.parameters())
        return integrator


class FormulationConfig(MethodConfig):
    """Which constraint rows are solved: a mapping, or text such as ``baumgarte rate=100``."""

    METHODS = METHODS
    method: Annotated[str, _Known("formulation", METHODS)] = INDEX_3
    rate: Positive | None = Field(None, description="α of baumgarte (1/s), 1000 when omitted")
    rate_h: Positive | None = Field(
        None, description="α h of baumgarte, in place of rate: α grows as h falls"
    )
    factor: Positive | None = Field(
        None,
        description="penalty of augmented-lagrangian over the inertia that the constraints "
        "move, 10 when omitted",
    )
    penalty: Positive | None = Field(
        None, description="penalty of augmented-lagrangian itself, in place of factor"
    )

    @model_validator(mode="after")
    def _usable(self) -> "FormulationConfig":
        owners = {name: method for method, kind in METHODS.items() for name in kind.parameters}
        self._refuse_others(METHODS[self.method].parameters, owners)
        if len(names := list(self.parameters())) > 1:
            raise misfit(names[-1], f"give either {' or '.join(names)}, not both")
        return self

    def value(self) -> Formulation:
        """The core's value."""
        return Formulation(self.method, next(iter(self.parameters().items()), None))


class ProjectionConfig(MethodConfig):
    """What is projected after each step: a mapping, or text such as ``velocity``."""

    METHODS = PROJECTIONS

    @classmethod
    def plain(cls, text: str) -> str:
        """A label from what tables and legends print of it."""
        text = axes.named("projection").named(text)
        return text.replace(" projection", "").replace(" with ", " ")

    method: Annotated[str, _Known("projection", PROJECTIONS)] = "none"
    accelerations: bool = Field(
        False, description="also replace v' by that of the index-1 system, and change a alike"
    )

    @model_validator(mode="after")
    def _usable(self) -> "ProjectionConfig":
        if self.accelerations and self.method == "none":
            raise misfit("accelerations", "needs a projection of velocities, given method none")
        return self

    def value(self) -> Projection:
        """The core's value."""
        return Projection(self.method, self.accelerations)


class SequenceConfig(Valued):
    """How the step size varies: ``constant``, or a mapping with one of its keys.

    The keys are those of the sequences of `newmark_cli.newmark.steps`.
    """

    change: Positive | None = Field(None, description="multiple of h from the time `at` on")
    at: Positive | None = Field(None, description="time of the change, from the start (s)")
    alternate: Annotated[tuple[Positive, ...], Field(min_length=2)] | None = Field(
        None, description="multiples of h that take turns"
    )
    every: Count | None = Field(None, description="steps before the next takes its turn, 1")
    random: tuple[Positive, Positive] | None = Field(
        None, description=f"multiples of h between which {LEVELS} are drawn from"
    )
    seed: StepCount | None = Field(None, description="of the generator, 1 when omitted")

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        """A label, as CSVs have it."""
        if not isinstance(data, str):
            return data
        try:
            return vars(steps.parse(data))
        except SequenceError as error:
            raise PydanticCustomError("sequence", "{message}", {"message": str(error)}) from None

    @model_validator(mode="after")
    def _usable(self) -> "SequenceConfig":
        names = {name for name in type(self).model_fields if getattr(self, name) is not None}
        kinds = [kind for kind in (*_OF_SEQUENCE,) if kind in names]
        if names and len(kinds) != 1:
            kinds = kinds or list(_OF_SEQUENCE)
            raise ValueError(f"needs one of {', '.join(kinds)}, given {', '.join(sorted(names))}")
        for kind in kinds:
            other, needed = _OF_SEQUENCE[kind]
            if others := sorted(names - {kind, other}):
                raise misfit(others[0], f"does not belong to {kind}")
            if needed and other not in names:
                raise misfit(kind, f"needs {other}")
        try:
            self.value()
        except SequenceError as error:
            name, _, why = str(error).partition(": ")
            raise misfit(name, why) from None
        return self

    def value(self) -> StepSequence:
        """The core's value."""
        kind = next((kind for kind in _OF_SEQUENCE if getattr(self, kind) is not None), None)
        if kind is None:
            return CONSTANT
        arguments = self.model_dump(exclude_none=True)
        sequence: StepSequence = SEQUENCES[kind](**arguments)
        return sequence

    @property
    def label(self) -> str:
        """As CSVs have it."""
        return self.value().label


#: Kind of sequence → its other key, and whether it needs it.
_OF_SEQUENCE = {"change": ("at", True), "alternate": ("every", False), "random": ("seed", False)}


class LimitsConfig(StrictModel):
    """The root mean square of Δx / (absolute + relative |x|) is at most 1."""

    absolute: Positive | None = Field(None, description="absolute part, in the field's unit")
    relative: Positive | None = Field(None, description="part relative to the field")

    @model_validator(mode="after")
    def _given(self) -> "LimitsConfig":
        if self.absolute is None and self.relative is None:
            raise ValueError("needs absolute or relative")
        return self


class StopConfig(Valued):
    """Ends Newton's iteration at a test in place of where rounding stops it.

    On the scaled correction, on the residual before scaling, relative to the step's first, or
    by field on what a correction changes, each field with parts of its own.
    """

    test: Annotated[str, _Known("test", (CORRECTION, RESIDUAL))] | None = Field(
        None, description="what is looked at, if not single fields; default: correction"
    )
    absolute: Positive | None = Field(None, description="bound of what is looked at")
    relative: Positive | None = Field(
        None, description="bound relative to the scaled unknowns, or to the step's first residual"
    )
    u: LimitsConfig | None = Field(None, description="what u may change by")
    v: LimitsConfig | None = Field(None, description="what v may change by")
    a: LimitsConfig | None = Field(None, description="what a may change by")
    lambda_: LimitsConfig | None = Field(
        None, alias="lambda", description="what lambda may change by"
    )

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        """Text such as ``absolute 1e-08`` or ``a relative 0.0001``, as CSVs have it."""
        if not isinstance(data, str):
            return data
        words = data.removeprefix("tolerance ").replace("=", " ").split()
        limits: dict[str, Any] = {}
        of = limits
        while words:
            word = words.pop(0)
            if word.endswith(RESIDUAL):
                limits["test"] = word
            elif word in (*FIELDS, "lambda"):
                of = limits[word] = {}
            elif word in ("absolute", "relative"):
                of[word] = documents.plain(words.pop(0)) if words else None
            else:
                limits[word] = documents.plain(words.pop(0)) if words else None
        return limits

    @property
    def _fields(self) -> dict[str, LimitsConfig]:
        named = zip((*FIELDS, "lambda"), (self.u, self.v, self.a, self.lambda_), strict=True)
        return {name: limits for name, limits in named if limits is not None}

    @model_validator(mode="after")
    def _given(self) -> "StopConfig":
        keys = [key for key in ("test", "absolute", "relative") if getattr(self, key) is not None]
        if self._fields and keys:
            raise misfit(keys[0], "not with fields, which have their own limits")
        if not self._fields and self.absolute is None and self.relative is None:
            raise ValueError("needs absolute or relative")
        return self

    def value(self) -> Tolerance:
        """The core's value."""
        fields = tuple(
            (name, limits.absolute or 0.0, limits.relative or 0.0)
            for name, limits in self._fields.items()
        )
        test = BY_FIELD if fields else self.test or CORRECTION
        return Tolerance(self.absolute or 0.0, self.relative or 0.0, test, fields)


class KrylovConfig(Valued):
    """How far GMRES goes."""

    tolerance: Positive = Field(
        Krylov().tolerance, lt=1, description="relative residual to reach, in balanced rows"
    )
    limit: Annotated[int, Strict(), Field(ge=1, le=100_000), WHOLE] = Field(
        Krylov().limit, description="most iterations of one solve"
    )

    def value(self) -> Krylov:
        """The core's value."""
        return Krylov(self.tolerance, self.limit)


_StopOrText = Annotated[
    StopConfig, Shown(lambda schema, handler: {"anyOf": [handler(schema), {"type": "string"}]})
]
Stop = Annotated[
    _StopOrText | None, BeforeValidator(lambda value: None if value == SATURATION else value)
]


def _preconditioning(value: Any) -> Any:
    if isinstance(value, str) and value.endswith("]"):  # as CSVs have a scaling of one's own
        own = Preconditioning.parse(value)
        return OwnScaling(name=own.name, left=dict(own.left), right=dict(own.right))
    if isinstance(value, dict):
        return OwnScaling.model_validate(value)
    if not isinstance(value, str) or value not in VARIANTS:
        raise _unknown("preconditioning", value, VARIANTS)
    return value


@dataclass(frozen=True)
class Surroundings:
    """Context on which a config's meaning depends besides its text.

    Attributes:
        folder: Where files that it names are looked for.
        allow_code: Whether problems in Python may be loaded.
        timeout: Most wall time of loading one (s).
        problems: Those of the document that were read, by how it names them, None for one
            whose mistakes are reported already: what their files said then holds for all of it.
    """

    folder: Path = Path()
    allow_code: bool = False
    timeout: float | None = None
    problems: dict[Hashable, ProblemSpec | None] = field(default_factory=dict, compare=False)


def problem_of(value: Any, info: ValidationInfo) -> ProblemSpec:
    """The problem that a config names; `Surroundings` are the context of the validation."""
    around = info.context or Surroundings()
    if isinstance(value, ProblemSpec):
        return value
    if isinstance(value, str):
        value = _labelled(value, around)
    if loading.is_mechanism(value):
        return _read_once(repr(value), "", partial(inline, value), around)
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
        path = (around.folder / value).absolute()
        read = partial(_mechanism, path, value, around)
        return _read_once(value, loading.label(value), read, around)
    if not isinstance(value, str) or value not in PROBLEMS:
        raise _unknown("problem", value, (*PROBLEMS, *FAMILIES))
    return Shipped(value)


def _labelled(text: str, around: Surroundings) -> Any:
    """What a label stands for, ``chain(links=20)`` or the name of a file without its ending."""
    name, arguments = name_and_arguments(text)
    if re.fullmatch(r".+\.py:\w+", name):
        return {"python": name, "args": arguments}
    if name in FAMILIES and arguments:
        return {name: arguments}
    return text if text in (*PROBLEMS, *FAMILIES) else with_ending(text, around.folder)


def _mechanism(path: Path, name: str, around: Surroundings) -> ProblemSpec:
    """What a mechanism file says now."""
    file = documents.fetch(path, name)
    if around.allow_code and _has_code(file):
        return ForcedMechanism(file, path).read(around.timeout)
    mechanism = MechanismFile(file)
    mechanism.load()
    return mechanism


def _has_code(file: documents.File) -> bool:
    """Whether a mechanism file names forces in Python; what is wrong with it is told later."""
    try:
        return loading.has_code(file.document().data)
    except InputError:
        return False


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
    spec = PythonFactory(path, factory, tuple(arguments.items()), str(value["python"]))
    return _read_once(spec, spec.label, partial(spec.read, around.timeout), around)


def _read_once(
    key: Hashable, label: str, read: Callable[[], ProblemSpec], around: Surroundings
) -> ProblemSpec:
    """The problem, once it has shown that it can be used."""
    if key not in around.problems:
        if len(label) > _LONGEST_LABEL:
            raise ValueError(
                f"too long for a name in the CSV: {len(label)} characters, at most {_LONGEST_LABEL}"
            )
        if re.search("[\ud800-\udfff]", label):
            raise ValueError("half a surrogate pair cannot be written into a CSV")
        around.problems[key] = None
        try:
            around.problems[key] = read()
        except InputError as error:
            raise documents.refused(error) from None
    problem = around.problems[key]
    if problem is None:
        raise documents.reported()
    return problem


def _auto_alone(solvers: tuple[str, ...]) -> tuple[str, ...]:
    if AUTO in solvers and {DENSE, SPARSE, STATIC} & set(solvers):
        raise ValueError(
            f"{AUTO} stands for {DENSE}, {STATIC} or {SPARSE}, which is then given twice"
        )
    return solvers


class TrajectoryConfig(Valued):
    """What `measure: trajectory` keeps: every k-th step, or those nearest to some times."""

    every: Annotated[int, Strict(), Field(ge=1, le=MOST_STEPS), WHOLE] | None = Field(
        None, description="the start, every so many steps, and the last; 1 when omitted"
    )
    at: OneOrMore[Number] | None = Field(
        None, description="the steps nearest to these times (s) instead"
    )
    keep: OneOrMore[Annotated[str, _Known("name", KEEPABLE)]] = Field(
        Kept().keep,
        description="fields to keep; energy: where it is conserved; output: angular velocities, "
        "angles and reactions of spatial mechanisms; drift: how far the constraints and their rate "
        "are missed; default: all but drift",
    )

    @model_validator(mode="after")
    def _consistent(self) -> "TrajectoryConfig":
        if self.every is not None and self.at is not None:
            raise misfit("at", "give either every or at, not both")
        return self

    def value(self) -> Kept:
        """The core's value."""
        times = tuple(sorted({float(t) for t in self.at or ()}))
        return Kept(self.every or 1, times, self.keep)


Variant = Annotated[Any, BeforeValidator(_preconditioning)]
Problems = OneOrMore[
    Annotated[Any, BeforeValidator(problem_of), PlainSerializer(lambda problem: problem.given)]
]
Variants = OneOrMore[Variant]
StepSizes = OneOrMore[Positive]
Forms = annotation(axes.named("form"))
Measures = OneOrMore[Annotated[str, _Known("measure", MEASURES)]]
LinearSolvers = Annotated[
    OneOrMore[Annotated[str, _Known("linear solver", LINEAR_SOLVERS)]], AfterValidator(_auto_alone)
]
Accepted = OneOrMore[Annotated[str, _Known("status", (*STATUSES[1:], NOT_CONVERGING))]]
Integrators = OneOrMore[IntegratorConfig]
Formulations = OneOrMore[FormulationConfig]
Projections = OneOrMore[ProjectionConfig]
Reported = OneOrMore[
    Annotated[str, _Known("multipliers", (AUTO, *REPORTED), axes.named("multipliers"))]
]
Sequences = OneOrMore[SequenceConfig]


#: Reads an alias of an axis as the axis.
_ALIAS = BeforeValidator(lambda axis: ALIASES.get(axis, axis) if isinstance(axis, str) else axis)
Compared = OneOrMore[Annotated[str, _ALIAS, _Known("axis", drawing.COMPARABLE)]]
Tabulated = OneOrMore[Annotated[str, _ALIAS, _Known("axis", tabulating.AXES)]]
TableValues = OneOrMore[Annotated[str, _Known("value", tabulating.VALUES)]]
Quantities = OneOrMore[Annotated[str, _Known("quantity", drawing.quantities(drawing.SHOWABLE))]]
Showable = Annotated[str, _Known("measure", drawing.SHOWABLE)]
Recorded = Annotated[str, _Known("measure", RECORDED)]
RowBlocks = OneOrMore[Annotated[str, _Known("row block", ROWS)]]


def _one_line(text: str) -> str:
    if not re.search(_LINE, text):
        raise ValueError("must be one line of 1 to 200 letters")
    return text


#: A line of text, and a word or a number that names something.
OneLine = Annotated[str, Strict(), AfterValidator(_one_line)]
Word = Annotated[
    str,
    BeforeValidator(lambda v: str(v) if isinstance(v, int) and not isinstance(v, bool) else v),
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"),
    also(type=["string", "integer"]),
]
