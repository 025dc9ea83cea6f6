"""The key `tables` of a study config: its models, which also read a record and options."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, TypeAdapter, create_model
from pydantic_core import PydanticCustomError

from newmark_cli.study import drawing, expecting
from newmark_cli.study.expecting import optional, recorded
from newmark_cli.study.figure_keys import series_keys
from newmark_cli.study.keys import OneLine, OneOrMore, Recorded, TableValues, Tabulated, Word
from newmark_cli.support.documents import RuledModel, StrictModel, misfit


class _Rules(RuledModel):
    """Rules that tie the keys of a table together."""

    @property
    def across(self) -> bool:
        """Whether series stand in columns; otherwise each has a row, and its values are columns."""
        return bool(self.columns or self.headings)

    @property
    def shown(self) -> tuple[str, ...]:
        """What it says of a series, of `tabulating.VALUES`."""
        return self.values or ("predicted", "fitted")

    def _misfits(self) -> Iterator[PydanticCustomError]:
        for axis in self.columns or ():
            if axis in (self.rows or ()):
                yield misfit("columns", f"{axis} already tells the rows apart")
        if self.columns is not None and self.headings is not None:
            yield misfit("headings", "are columns one by one; leave out columns")
        if (self.columns or self.headings) and not self.rows:
            yield misfit("rows", "missing: the axes that tell rows apart")


def _series() -> dict[str, Any]:
    """Keys that choose series."""
    return {
        "measure": optional(OneOrMore[Recorded], "kinds of rows of the CSV; default: all"),
        "initial": optional(Literal["start"], "start: what was measured at the initial state"),
        **series_keys(),
    }


if TYPE_CHECKING:
    TableConfig = _Rules
else:
    HeadingConfig = create_model(
        "HeadingConfig",
        __base__=StrictModel,
        __doc__="A column of a table: the strongest of the series that it chooses.",
        label=(OneLine, Field(description="what stands above it")),
        **_series(),
    )
    TableConfig = create_model(
        "TableConfig",
        __base__=_Rules,
        __doc__="A table of fitted orders, one for each combination of what else varies.",
        rows=optional(Tabulated, "axes that tell rows apart; default, of a list: what varies"),
        columns=optional(
            Tabulated,
            "axes that tell columns apart; without them and headings each series has a "
            "row, and its values are the columns",
        ),
        headings=optional(
            Annotated[tuple[HeadingConfig, ...], Field(min_length=1, max_length=40)],
            "the columns one by one",
        ),
        values=optional(TableValues, "what it says of each series; default: predicted and fitted"),
        title=optional(OneLine, "what it shows"),
        table=optional(Word, "number or word of its files"),
        **_series(),
    )

Tables = Annotated[tuple[TableConfig, ...], Field(min_length=1, max_length=40)]
_TABLES: TypeAdapter[tuple[TableConfig, ...]] = TypeAdapter(Tables)


def tables(config: Any) -> tuple[TableConfig, ...]:
    """Tables of a record or a shipped config; see `recorded`."""
    found: tuple[TableConfig, ...] = recorded(config, "tables", _TABLES)
    return found


def table(**keys: Iterable[str]) -> TableConfig:
    """A table of these axes and values; empty ones are left out."""
    return TableConfig.model_validate({key: [*of] for key, of in keys.items() if of})


def choice_of(entry: Any) -> dict[str, tuple[str, ...]]:
    """Axis → values of the series that a table or a heading chooses, including the measure."""
    kinds = [kind for name in entry.measure or () for kind in drawing.kinds(name)]
    return expecting.choice_of(entry) | ({"measure": tuple(kinds)} if kinds else {})
