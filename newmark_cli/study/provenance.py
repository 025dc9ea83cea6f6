"""What stands beside a CSV: the resolved config, versions, platform, wall times."""

import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import newmark_cli
from newmark_cli.study.cell import Cell, Outcome
from newmark_cli.study.config import Study

_PACKAGES = ("numpy", "scipy", "numba", "pandas", "matplotlib", "pydantic", "PyYAML", "click")


def record(
    study: Study,
    cells: Sequence[Cell],
    outcomes: Sequence[Outcome],
    seconds: Sequence[float],
    total: float,
    jobs: int,
    rows: int,
) -> dict[str, Any]:
    """Provenance of one run of a study.

    Args:
        study: The study.
        cells, outcomes, seconds: Cells, what they found, and their wall times (s).
        total: Wall time of the whole study (s).
        jobs: Threads.
        rows: Rows of the CSV.
    """
    return {
        "study": study.study,
        "config": study.model_dump(mode="json", by_alias=True, exclude_none=True),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "newmark-study": newmark_cli.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in _PACKAGES},
        },
        "platform": {
            "system": platform.platform(),
            "machine": platform.machine(),
        },
        "jobs": jobs,
        "rows": rows,
        "wall_seconds": round(total, 3),
        "cells": [
            {
                "problem": cell.problem.label,
                "linear_solver": cell.solver,
                "form": cell.form,
                "preconditioning": cell.preconditioning.label,
                "h": cell.h,
                "steps": cell.steps,
                "status": outcome.status,
                **({"reason": outcome.reason} if outcome.reason else {}),
                "wall_seconds": round(taken, 4),
            }
            for cell, outcome, taken in zip(cells, outcomes, seconds, strict=True)
        ],
    }
