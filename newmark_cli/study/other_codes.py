"""Other codes that a study config names."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PrivateAttr,
    ValidationInfo,
    model_validator,
)

from newmark_cli.codes import programs
from newmark_cli.codes.given_references import ReferenceFile
from newmark_cli.codes.programs import OtherCode
from newmark_cli.study.axes import OURS
from newmark_cli.study.keys import Valued
from newmark_cli.study.kinds import OneLine, OneOrMore, unknown
from newmark_cli.study.subjects import Surroundings
from newmark_cli.support.documents import misfit

_KINDS = ("command", "python", "table")


class CodeConfig(Valued):
    """Another code: its name, and one of ``command``, ``python`` and ``table``."""

    name: OneLine = Field(description="label in CSVs and figures")
    command: tuple[str | int | float, ...] | None = Field(
        None,
        min_length=1,
        description="words of a command that prints a table; `{h}`, `{t_end}`, `{steps}`, `{t0}`, "
        "`{u0}` and `{v0}` stand for the numbers of a run; needs --allow-code",
    )
    python: str | None = Field(
        None,
        description="`file.py:solve`, a function solve(problem, h, t_end, u0, v0) that returns "
        "rows; needs --allow-code",
    )
    args: dict[str, str | int | float | bool] = Field(
        {}, description="further arguments of the Python function, by name"
    )
    table: str | None = Field(None, description="file of runs that are computed already")
    series: str = Field("", description="label of the series in the table, where it has several")
    columns: dict[str, str | int | float] = Field(
        {}, description="column of this tool → column of the code's table, or an expression in them"
    )
    _value: OtherCode = PrivateAttr()

    @model_validator(mode="after")
    def _usable(self, info: ValidationInfo) -> "CodeConfig":
        around = info.context or Surroundings()
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            listed = " and ".join(given) or "none"
            raise ValueError(f"needs one of {', '.join(_KINDS)}, given {listed}")
        if self.name == OURS:
            raise misfit("name", f"{OURS} is this tool; take another name")
        if self.series and self.table is None:
            raise misfit("series", "belongs to a table")
        if self.args and self.python is None:
            raise misfit("args", "belong to a Python function")
        if given[0] != "table" and not around.allow_code:
            what = self.python or self.command[0]  # type: ignore[index]
            raise misfit(given[0], f"{what} is code, which runs only with --allow-code")
        file, _, function = (self.python or "").rpartition(":")
        if self.python is not None and not (file and function.isidentifier()):
            raise misfit("python", 'must be "file.py:function"')
        folder = around.folder.absolute()
        path = folder / (self.table if self.table is not None else file)
        if self.command is None and not path.is_file():
            raise misfit(given[0], f"{path.name}: no such file")
        columns = tuple((name, str(value)) for name, value in self.columns.items())
        if self.command is not None:
            command = tuple(map(str, self.command))
            content = programs.digest(programs.program_files(command, folder), *command)
            self._value = programs.Program(self.name, columns, content, command, folder)
        elif self.table is not None:
            self._value = programs.WrittenTable(
                self.name, columns, programs.digest([path]), path, self.series
            )
        else:
            arguments = tuple(self.args.items())
            content = programs.digest(
                [path, *sorted(path.parent.glob("*.py"))], function, repr(arguments)
            )
            self._value = programs.PythonCode(
                self.name, columns, content, path, function, arguments
            )
        return self

    def value(self) -> OtherCode:
        """The code with what its files had when the config was read."""
        return self._value


def _code_of(value: Any, info: ValidationInfo) -> "CodeConfig | str":
    """A code that a config names; `Surroundings` are the context of the validation."""
    if isinstance(value, dict | CodeConfig):
        return CodeConfig.model_validate(value, context=info.context)
    if value != OURS:
        raise unknown("code", value, (OURS,))
    return OURS


def _described(code: Any) -> Any:
    """A code as records have it."""
    return code if isinstance(code, str) else code.model_dump(exclude_defaults=True)


def _reference_of(value: Any, info: ValidationInfo) -> ReferenceFile | None:
    """A file of references that a config names."""
    if value is None or isinstance(value, ReferenceFile):
        return value
    if not isinstance(value, str):
        raise ValueError("must be the name of a file")
    around = info.context or Surroundings()
    try:
        return ReferenceFile.of(value, (around.folder / value).absolute())
    except OSError as error:
        raise ValueError(f"{value}: cannot be read: {error.strerror}") from None


#: What a config may give as ``reference``.
GivenReference = Annotated[
    Any, BeforeValidator(_reference_of), PlainSerializer(lambda file: file and file.name)
]
#: What a config may give along the axis ``code``.
Codes = OneOrMore[Annotated[Any, BeforeValidator(_code_of), PlainSerializer(_described)]]
#: Axes along which other codes do not differ: what they are like inside is theirs.
INSIDE = ("form", "preconditioning", "evaluation", "precision", "linear_solver", "auxiliary")
#: What a case with other codes has along those axes which nobody needs to give.
USUAL = {"form": "u-lambda", "preconditioning": "optimal"}


def counts(cell: Mapping[str, Any], first: Mapping[str, Any]) -> bool:
    """Whether a combination of values is a cell: another code has one for all forms.

    Args:
        cell: Axis → value.
        first: Axis → the first value of the case.
    """
    return isinstance(cell["code"], str) or all(cell[name] == first[name] for name in INSIDE)
