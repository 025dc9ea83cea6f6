"""Rows of studies as DataFrames that keep what their records say."""

from typing import Any, Self

import pandas as pd


class Rows(pd.DataFrame):
    """Rows of studies; ``pd.concat`` of several keeps the attributes of all.

    Attributes are mappings from studies; pandas itself drops attributes that differ.
    """

    @property
    def _constructor(self) -> Any:
        return Rows

    def __finalize__(self, other: Any, method: str | None = None, **options: Any) -> Self:
        super().__finalize__(other, method, **options)  # type: ignore[misc]
        if method == "concat":
            # They are `objs` before pandas 3.
            frames: Any = getattr(other, "input_objs", None) or getattr(other, "objs", ())
            for frame in frames:
                for name, of_studies in frame.attrs.items():
                    if isinstance(of_studies, dict):
                        self.attrs[name] = self.attrs.get(name, {}) | of_studies
        return self
