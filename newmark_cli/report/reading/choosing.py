"""Series as options of a command choose them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from newmark_cli.study.axes import SeriesKey, is_among, means
from newmark_cli.study.showable import SHOWABLE, kinds
from newmark_cli.support.errors import InputError
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    from newmark_cli.report.judging.slopes import Slope


def grouped(slopes: Iterable["Slope"], axes: Sequence[str]) -> dict[tuple[str, ...], list["Slope"]]:
    """Values along axes → the series that have them."""
    groups: dict[tuple[str, ...], list[Slope]] = {}
    for slope in slopes:
        groups.setdefault(tuple(getattr(slope, axis) for axis in axes), []).append(slope)
    return groups


def select(slopes: Iterable["Slope"], **axes: Sequence[str]) -> list["Slope"]:
    """The series that have one of the values of every axis; see `is_among`."""
    return [slope for slope in slopes if is_among(slope, axes)]


@dataclass(frozen=True)
class Choice:
    """Which series are shown, and which figures of them."""

    measures: tuple[str, ...] = ()  #: names of `SHOWABLE`; all when empty
    #: Axis → its values, as people or CSVs write them; all when it has none.
    values: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    everything: bool = False  #: whether all figures of a study are drawn, however many

    def __bool__(self) -> bool:
        """Whether it leaves anything out."""
        return bool(self.measures) or any(self.values.values())

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of rows, and the work–precision diagram."""
        return tuple(dict.fromkeys(kind for name in self.measures for kind in kinds(name)))

    def keeps(self, series: "Slope | SeriesKey") -> bool:
        """Whether a series has one of the values of every axis."""
        return is_among(series, self.values)

    def takes(self, series: "Slope | SeriesKey") -> bool:
        """Whether it has one of the measures, too."""
        return is_among(series, {**self.values, "measure": self.kinds})

    def require(self, slopes: Sequence["Slope"]) -> None:
        """Refuse a word that no series of the results is meant by."""
        for name in self.measures:
            if name not in SHOWABLE:
                raise InputError(f"--measure: unknown measure {name!r}{nearest(name, SHOWABLE)}")
        for axis, words in self.values.items():
            known = list(dict.fromkeys(v for s in slopes if (v := getattr(s, axis))))
            for word in words:
                if not any(means(axis, word, value) for value in known):
                    raise InputError(
                        f"--{axis}: no series of {word!r} in the results{nearest(word, known)}"
                    )

    def series(self, slopes: Sequence["Slope"]) -> list["Slope"]:
        """Series that are chosen; raises `InputError` where none is."""
        self.require(slopes)
        chosen = list(filter(self.takes, slopes))
        if self and not chosen:
            raise InputError("no series has all that the options choose")
        return chosen
