"""Advice as text for a terminal or a notebook."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from newmark_cli.advice.advising import Advice


def sections(advice: "Advice") -> Iterable[str]:
    """Its parts, each with a title; some are empty."""
    yield (
        f"{advice.subject}: n = {advice.n} coordinates, m = {advice.m} constraints, "
        f"{advice.where}\nform {advice.form}, {advice.integrator}, {advice.formulation}, "
        f"{advice.evaluation} evaluation"
    )
    yield titled(
        "Condition number of J̄ = D_L J D_R (2-norm)",
        [
            ["h", *advice.orders],
            *([f"{h:g}", *(f"{c:.4g}" for c in of.values())] for h, of in advice.condition.items()),
            ["grows like", *(f"h^{order:g}" for order in advice.orders.values())],
        ],
    )
    factors = list(advice.factors.values())
    yield titled(
        "Factors of the optimal scaling: solve (D_L J D_R) q̄ = −D_L b, then q = D_R q̄",
        [
            ["", "formula", *(f"h = {h:g}" for h in advice.factors)],
            *(
                [f"row {row}", text, *(f"{one.left[row]:.6g}" for one in factors)]
                for row, text in factors[0].left_formulas.items()
            ),
            *(
                [unknown, text, *(f"{one.right[unknown]:.6g}" for one in factors)]
                for unknown, text in factors[0].right_formulas.items()
            ),
        ],
    )
    yield "\n".join(["NumPy", *(f"  {line}" for line in advice.code["numpy"])])
    if advice.tolerances:
        yield titled(
            "Smallest tolerance that Newton can meet on a correction's 2-norm (set three times it)",
            _tolerance_rows(advice),
        )
    if advice.noise:
        noise = {"in one step": advice.noise.one_step, "carried on": advice.noise.carried}
        yield titled(
            "Step size below which rounding moves λ by a part of its size, rms ‖λ‖ = "
            f"{advice.multipliers:.3g}",
            [
                [f"{part:.0%} {kind}" for kind in noise for part in advice.noise.one_step],
                [
                    _below(of[part]) if of else "not predicted"
                    for of in noise.values()
                    for part in advice.noise.one_step
                ],
            ],
        )
    yield "\n".join(f"- {text}" for text in advice.findings)


def _below(h: float | None) -> str:
    if h is None:
        return "at any h"
    return f"{h:.2g}" if h else "below 1e-9"


def _tolerance_rows(advice: "Advice") -> list[list[str]]:
    precisions = dict.fromkeys(one.precision for one in advice.tolerances)
    rows = [
        ["h", "unknown", *(f"{p}, {kind}" for p in precisions for kind in ("scaled", "physical"))]
    ]
    grouped: dict[tuple[float, str], list[float | None]] = {}
    for one in advice.tolerances:
        grouped.setdefault((one.h, one.unknown), []).extend((one.scaled, one.physical))
    for (h, unknown), sizes in grouped.items():
        rows.append([f"{h:g}", unknown, *map(_size, sizes)])
    return rows


def _size(size: float | None) -> str:
    if size is None:
        return ""
    return "not predicted" if math.isnan(size) else f"{size:.2g}"


def plain(value: Any) -> Any:
    """Plain values for JSON: keys that are numbers become text."""
    if isinstance(value, Mapping):
        return {
            _key(key) if isinstance(key, float) else str(key): plain(item)
            for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _key(number: float) -> str:
    """A number as a key, with all digits where six are too few to tell it from others."""
    short = f"{number:g}"
    return short if float(short) == number else repr(number)


def titled(title: str, rows: Sequence[Sequence[str]]) -> str:
    """A table in columns under a title."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(entry.ljust(width) for entry, width in zip(row, widths, strict=True))
        for row in rows
    )
    return "\n".join([title, *(f"  {line}".rstrip() for line in lines)])
