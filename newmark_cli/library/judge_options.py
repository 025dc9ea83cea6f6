"""Files with which a table is judged: other names of its columns, and what is expected of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, RootModel

from newmark_cli.study.axes import SeriesKey
from newmark_cli.study.entries import ExpectConfig, Recorded
from newmark_cli.study.kinds import OneLine
from newmark_cli.support import documents
from newmark_cli.support.documents import Document, StrictModel


def _number_or_text(value: Any) -> float | str:
    """A number as such: as text it might be the name of a column."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("must be a number or text; text with # stands in quotation marks")
    return value


class _Columns(RootModel[dict[str, Annotated[Any, BeforeValidator(_number_or_text)]]]):
    pass


if TYPE_CHECKING:
    _Expected = ExpectConfig
else:

    class _Expected(ExpectConfig):
        """A slope or a level that series of a table must have."""

        measure: Recorded = Field("error", description="error or invariant")
        series: OneLine | None = Field(None, description="label of the series; any when omitted")

        @property
        def described(self) -> str:
            """The series that it is about, in words."""
            return super().described + (f", study {self.series}" if self.series else "")

        def matches(self, key: SeriesKey) -> bool:
            """Whether it is about a series; the label of one stands as its study."""
            return super().matches(key) and self.series in (None, key.study)


class _File(StrictModel):
    expect: tuple[_Expected, ...]


def columns(source: Any) -> Mapping[str, Any]:
    """Names of columns from a YAML file, or the mapping as it is.

    Raises:
        DocumentError: When the file cannot be used.
    """
    if not isinstance(source, str | Path):
        return dict(source or {})
    return documents.validate(documents.read(Path(source)), _Columns).root


def expected(source: Any) -> list[ExpectConfig]:
    """Expectations from a YAML file with the key ``expect``, or from a list of mappings.

    Raises:
        DocumentError: For every mistake.
    """
    if source is None:
        return []
    document = (
        documents.read(Path(source)) if isinstance(source, str | Path)
        else Document.of("expect", {"expect": source})
    )  # fmt: skip
    return list(documents.validate(document, _File).expect)
