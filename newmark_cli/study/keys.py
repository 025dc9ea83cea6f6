"""Types of the keys of a study config, which pydantic checks."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import (
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    PrivateAttr,
    Strict,
    ValidationInfo,
    WrapValidator,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError

from newmark_cli.newmark import formulation, integrator, scheme, steps
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.formulation import Formulation, Projection
from newmark_cli.newmark.integrator import FIELDS, Integrator
from newmark_cli.newmark.kept import KEEPABLE, Kept
from newmark_cli.newmark.linear.choice import AUTO, Krylov
from newmark_cli.newmark.own_integrator import NAMED, OwnIntegrator
from newmark_cli.newmark.scaling import VARIANTS, Preconditioning
from newmark_cli.newmark.scheme import Tolerance
from newmark_cli.newmark.steps import CONSTANT, LEVELS, SEQUENCES, SequenceError, StepSequence
from newmark_cli.study import axes
from newmark_cli.study.axes import SATURATION
from newmark_cli.study.axis import Axis
from newmark_cli.study.cell import NOT_CONVERGING, STATUSES, Window
from newmark_cli.study.kinds import (
    MOST_STEPS,
    Count,
    Factor,
    Known,
    Name,
    OneLine,
    OneOrMore,
    Positive,
    StepCount,
    unknown,
)
from newmark_cli.study.measures import MEASURES
from newmark_cli.study.subjects import Surroundings, own_integrator_of, problem_of
from newmark_cli.support import documents
from newmark_cli.support.documents import WHOLE, Document, Number, RuledModel, StrictModel, misfit
from newmark_cli.support.errors import warn
from newmark_cli.support.json_schema import JsonSchema, Shown
from newmark_cli.support.spelling import closest


class Valued(RuledModel):
    """Keys that stand for a value of the core."""

    def value(self) -> Any:
        """The core's value."""
        raise NotImplementedError


Value = TypeVar("Value", bound=Valued)


def read(name: str, value: Any, model: type[Value], around: Surroundings | None = None) -> Any:
    """The core's value of what a command line, or a function of the library, is given.

    The model is that of the config's key, and errors are those of a config, under the name.
    Without surroundings no code runs.
    """
    return documents.validate(Document.of(name, value), model, context=around).value()


class OwnScaling(Valued):
    """A scaling of your own; blocks that are not named keep the factor 1."""

    name: Name = Field(description="name in CSVs and figures")
    left: dict[str, Factor] = Field(
        {}, description="row block D, V, K, C → monomial in beta, gamma and h"
    )
    right: dict[str, Factor] = Field(
        {}, description="unknown u, v, a, lambda → monomial in beta, gamma and h"
    )

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.name in VARIANTS:
            yield misfit("name", f"{self.name!r} is a variant of the paper; take another name")

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
#: Those of a method whose parameters have the names of another's.
_OF_METHOD = {"alpha": {"beta": 0.3025, "gamma": 0.6, "alpha_m": -0.1, "alpha_f": 0.0}}


class MethodConfig(Valued):
    """A method and its parameters: a mapping, or text such as ``hht alpha=0.1``."""

    AXIS: ClassVar[Axis]
    METHODS: ClassVar[Mapping[str, Any]] = {}
    method: str

    @classmethod
    def example(cls, method: str = "") -> str:
        """How a config gives a method."""
        return f"{{method: {method or next(iter(cls.METHODS))}}}"

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        if isinstance(data, str):
            return cls._split(cls.AXIS.read(data))
        if not isinstance(data, dict | cls):
            text = f"must be the name of a method, or a mapping such as {cls.example()}"
            raise PydanticCustomError("method", "{message}", {"message": text})
        return data

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

    def _of_others(self, methods: Mapping[str, Collection[str]]) -> Iterator[PydanticCustomError]:
        """Misfits of parameters of other methods, from method → its parameters."""
        allowed = methods.get(self.method, ())
        has = f"has {' or '.join(allowed)}" if allowed else "has no parameters"
        owners = {name: method for method in [*methods][::-1] for name in methods[method]}
        for name in self.parameters():
            if name not in allowed:
                yield misfit(
                    name,
                    f"is not a parameter of {self.method}, which {has}; it belongs to "
                    f"{owners[name]}: {self.example(owners[name])}",
                )

    @property
    def label(self) -> str:
        """As CSVs have it."""
        return str(self.value().label)


class IntegratorConfig(MethodConfig):
    """An integrator and its parameters: a mapping, or text such as ``hht alpha=0.1``."""

    AXIS = axes.named("integrator")
    METHODS = integrator.INTEGRATORS
    method: Annotated[
        str,
        Known("method", METHODS),
        WrapValidator(lambda given, known: given if NAMED.fullmatch(str(given)) else known(given)),
        Field(description="method, or `file.py:Class` of your own, which needs --allow-code"),
    ] = "newmark"
    beta: Number | None = Field(None, description="β of alpha, and of newmark, 0.25 when omitted")
    gamma: Number | None = Field(None, description="γ of alpha, and of newmark, 0.5 when omitted")
    rho: Number | None = Field(None, description="ρ∞ of generalized-alpha, 0 to 1")
    alpha: Number | None = Field(None, description="α of hht, 0 to 1/3")
    alpha_m: Number | None = Field(None, description="α_m of alpha, of inertial forces")
    alpha_f: Number | None = Field(None, description="α_f of alpha, of the other forces")
    _own: OwnIntegrator | None = PrivateAttr(None)

    @classmethod
    def example(cls, method: str = "") -> str:
        """How a config gives a method."""
        method = method or "generalized-alpha"
        values = _EXAMPLES | _OF_METHOD.get(method, {})
        given = (f", {name}: {values[name]:g}" for name in integrator.parameters(method))
        return f"{{method: {method}{''.join(given)}}}"

    @model_validator(mode="before")
    @classmethod
    def _by_another_name(cls, data: Any) -> Any:
        return {} if data == {"method": integrator.TRAPEZOIDAL_NAME} else data

    @classmethod
    def unknown_key(cls, key: str) -> str:
        """Also where the name of a method stands as a key."""
        method = closest(key, cls.METHODS)
        if method is not None:
            return f"unknown key; write {cls.example(method)}"
        named = [method for method in cls.METHODS if closest(key, integrator.parameters(method))]
        return f"{super().unknown_key(key)}; for example {cls.example(named[0] if named else '')}"

    @model_validator(mode="after")
    def _usable(self, info: ValidationInfo) -> "IntegratorConfig":
        methods = {method: integrator.parameters(method) for method in self.METHODS}
        documents.together(self._of_others(methods))
        if NAMED.fullmatch(self.method):
            self._own = own_integrator_of(self.method, info.context or Surroundings())
        try:
            note = self.value().note
        except TypeError:
            missing = [name for name in methods[self.method] if name not in self.parameters()]
            raise self._unusable("method", f"{self.method} needs {', '.join(missing)}") from None
        except integrator.IntegratorError as error:
            raise self._unusable(str(error).split()[0], str(error)) from None
        if note:
            warn(f"integrator {self.method}: {note}")
        return self

    def _unusable(self, key: str, why: str) -> PydanticCustomError:
        return misfit(key, f"{why}; for example {self.example(self.method)}")

    def value(self) -> Integrator:
        """The core's value."""
        if self._own is not None:
            return self._own
        made: Integrator = integrator.INTEGRATORS[self.method](**self.parameters())
        return made


class FormulationConfig(MethodConfig):
    """Which constraint rows are solved: a mapping, or text such as ``baumgarte rate=100``."""

    AXIS = axes.named("formulation")
    METHODS = formulation.METHODS
    method: Annotated[str, Known("formulation", METHODS)] = INDEX_3
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

    def _misfits(self) -> Iterator[PydanticCustomError]:
        yield from self._of_others({name: of.parameters for name, of in self.METHODS.items()})
        if len(names := list(self.parameters())) > 1:
            yield misfit(names[-1], f"give either {' or '.join(names)}, not both")

    def value(self) -> Formulation:
        """The core's value."""
        return Formulation(self.method, next(iter(self.parameters().items()), None))


class ProjectionConfig(MethodConfig):
    """What is projected after each step: a mapping, or text such as ``velocity``."""

    AXIS = axes.named("projection")
    METHODS = formulation.PROJECTIONS
    method: Annotated[str, Known("projection", METHODS)] = "none"
    accelerations: bool = Field(
        False, description="also replace v' by that of the index-1 system, and change a alike"
    )

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.accelerations and self.method == "none":
            yield misfit("accelerations", "needs a projection of velocities, given method none")

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

    def _misfits(self) -> Iterator[PydanticCustomError]:
        given = self.model_dump(exclude_none=True)
        kinds = [kind for kind in SEQUENCES if kind in type(self).model_fields]
        chosen = [kind for kind in kinds if kind in given]
        if given and len(chosen) != 1:
            listed = ", ".join(chosen or kinds)
            raise ValueError(f"needs one of {listed}, given {', '.join(sorted(given))}")
        for kind in chosen:
            parts = {part.name: part.default for part in fields(SEQUENCES[kind])}
            others = sorted(given.keys() - parts)
            missing = [name for name in parts if parts[name] is MISSING and name not in given]
            try:
                if others:
                    yield misfit(others[0], f"does not belong to {kind}")
                elif missing:
                    yield misfit(kind, f"needs {missing[0]}")
                else:
                    self.value()
            except SequenceError as error:
                name, _, why = str(error).partition(": ")
                yield misfit(name, why)

    def value(self) -> StepSequence:
        """The core's value."""
        given = self.model_dump(exclude_none=True)
        kind = next((kind for kind in SEQUENCES if kind in given), CONSTANT.label)
        sequence: StepSequence = SEQUENCES[kind](**given)
        return sequence

    @property
    def label(self) -> str:
        """As CSVs have it."""
        return self.value().label


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

    test: Annotated[str, Known("test", (scheme.CORRECTION, scheme.RESIDUAL))] | None = Field(
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
        words = iter(axes.named("stop").read(data).replace("=", " ").split())
        limits: dict[str, Any] = {}
        of = limits
        for word in words:
            if word.endswith(scheme.RESIDUAL):
                limits["test"] = word
            elif word in (*FIELDS, "lambda"):
                of = limits[word] = {}
            else:
                into = of if word in ("absolute", "relative") else limits
                into[word] = documents.plain(next(words, ""))
        return limits

    @property
    def _fields(self) -> dict[str, LimitsConfig]:
        named = zip((*FIELDS, "lambda"), (self.u, self.v, self.a, self.lambda_), strict=True)
        return {name: limits for name, limits in named if limits is not None}

    def _misfits(self) -> Iterator[PydanticCustomError]:
        keys = [key for key in ("test", "absolute", "relative") if getattr(self, key) is not None]
        if self._fields and keys:
            yield misfit(keys[0], "not with fields, which have their own limits")
        if not self._fields and self.absolute is None and self.relative is None:
            raise ValueError("needs absolute or relative")

    def value(self) -> Tolerance:
        """The core's value."""
        fields = tuple(
            (name, limits.absolute or 0.0, limits.relative or 0.0)
            for name, limits in self._fields.items()
        )
        test = scheme.BY_FIELD if fields else self.test or scheme.CORRECTION
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


def _preconditioning(value: Any) -> Any:
    if isinstance(value, str) and value.endswith("]"):  # as CSVs have a scaling of one's own
        own = Preconditioning.parse(value)
        return OwnScaling(name=own.name, left=dict(own.left), right=dict(own.right))
    if isinstance(value, dict):
        return OwnScaling.model_validate(value)
    if not isinstance(value, str) or value not in VARIANTS:
        raise unknown("preconditioning", value, VARIANTS)
    return value


class TrajectoryConfig(Valued):
    """What `measure: trajectory` keeps: every k-th step, or those nearest to some times."""

    every: Annotated[int, Strict(), Field(ge=1, le=MOST_STEPS), WHOLE] | None = Field(
        None, description="the start, every so many steps, and the last; 1 when omitted"
    )
    at: OneOrMore[Number] | None = Field(
        None, description="the steps nearest to these times (s) instead"
    )
    keep: OneOrMore[Annotated[str, Known("name", KEEPABLE)]] = Field(
        Kept().keep,
        description="fields to keep; energy: where it is conserved; output: angular velocities, "
        "angles and reactions of spatial mechanisms; drift: how far the constraints and their rate "
        "are missed; default: all but drift",
    )

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.every is not None and self.at is not None:
            yield misfit("at", "give either every or at, not both")

    def value(self) -> Kept:
        """The core's value."""
        times = tuple(sorted({float(t) for t in self.at or ()}))
        return Kept(self.every or 1, times, self.keep)


class ErrorConfig(Valued):
    """Where `measure: error` looks for the largest errors, besides those at the end."""

    over: Literal["motion"] | tuple[Number, Number] = Field(
        description="motion: from the start to t_end; or from a time to a later one, [t0, t1] (s)"
    )

    def _misfits(self) -> Iterator[PydanticCustomError]:
        if self.over != "motion" and not 0 <= self.over[0] < self.over[1]:
            since, until = self.over
            text = f"must be [t0, t1] with 0 ≤ t0 < t1, given [{since:g}, {until:g}]"
            yield misfit("over", text)

    def value(self) -> Window:
        """The core's value."""
        return Window() if self.over == "motion" else Window(*map(float, self.over))


#: Key of a case → one of its values along an axis, or a setting, where that is not a name.
_VALUES: Mapping[str, Any] = {
    "problem": Annotated[
        Any, BeforeValidator(problem_of), PlainSerializer(lambda problem: problem.given)
    ],
    "integrator": IntegratorConfig,
    "preconditioning": Annotated[Any, BeforeValidator(_preconditioning)],
    "formulation": FormulationConfig,
    "projection": ProjectionConfig,
    "multipliers": Annotated[
        str, Known("multipliers", (AUTO, *formulation.REPORTED), axes.named("multipliers"))
    ],
    "stop": Annotated[
        StopConfig, Shown(lambda schema, handler: {"anyOf": [handler(schema), {"type": "string"}]})
    ]
    | None,
    "h_sequence": SequenceConfig,
    # As choices have it; a case gives `newmark_cli.study.other_codes.Codes`.
    "code": OneLine,
    "h": Positive,
    "t_end": Positive | None,
    "steps": StepCount | None,
    "measure": OneOrMore[Annotated[str, Known("measure", MEASURES)]],
    "iteration_cap": Count,
    "samples": Count,
    "twins": Annotated[int, Strict(), Field(ge=0, le=100), WHOLE],
    "krylov": KrylovConfig,
    "trajectory": TrajectoryConfig | None,
    "error": ErrorConfig | None,
    "accept": OneOrMore[Annotated[str, Known("status", (*STATUSES[1:], NOT_CONVERGING))]],
}


def value_of(axis: Axis) -> Any:
    """One value along an axis, or a setting, as a config may give it, for pydantic."""
    return _VALUES.get(axis.name, Annotated[str, Known(axis.title, axis.names, axis)])


def annotation(axis: Axis) -> Any:
    """What a config may give along an axis, for pydantic."""
    if axis.name == "stop":
        usual = BeforeValidator(lambda value: None if value == SATURATION else value)
        return Annotated[value_of(axis), usual]
    return OneOrMore[value_of(axis)] if axis.many else value_of(axis)  # type: ignore[misc]
