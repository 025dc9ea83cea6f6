"""Names that the package no longer knows, and what is said where one is still asked for."""

from collections.abc import Mapping
from types import MappingProxyType

_MISSED = "a march goes on after a step that misses its test; the column met counts the others"
_DASK = "--executor dask spreads a study over machines, see docs/studies.md"
_DAE_CODES = (
    "docs/advice.md has lines to paste for codes that choose their steps, and "
    "docs/examples/tolerances.py their tolerances"
)

#: Key, value, command or option → a name that is allowed where it was, and its way out.
RETIRED: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "run --format": ("", "take --trajectories csv or parquet"),
        "--cures": ("", "take 'newmark-study tables cures', and docs/what-scaling-cures.md"),
        "missed": ("absolute", _MISSED),
        "smallest_h": ("absolute", _MISSED),
        "guess": ("absolute", "Newton starts each step from u + h v and the last lambda"),
        "tangent": ("absolute", "the tangent is the full one"),
        "scaled-residual": ("residual", "take test: residual, or scale absolute and relative"),
        "minres": ("gmres", "take gmres"),
        "export": (
            "run",
            "newmark_cli.linear_systems gives the systems and scipy.io.mmwrite writes them, see "
            "docs/scalings-integrators.md",
        ),
        "pgf": ("pdf", "LaTeX includes pdf, which needs no LaTeX to be drawn"),
        "merge": ("run", _DASK),
        "--shard": ("", _DASK),
        "prune": ("run", "DIR/cells is a cache, which you may delete"),
        "verify": ("check", "check compares files with their records, too"),
        **dict.fromkeys(("--code", "--accuracy", "advise_dae", "DaeAdvice"), ("", _DAE_CODES)),
        "info": ("show", "take 'show STUDY --record', with --json for the whole record"),
        "schema": ("list", "take 'list --schema config', mechanism or spatial"),
        **dict.fromkeys(("21", "22"), ("20", "the study stopping, which it showed, went")),
        "history": (
            "trajectory",
            "take measure: trajectory and trajectory: {every: 11, keep: lambda}, which with an odd "
            "number shows what alternates from step to step",
        ),
        "drift": ("trajectory", "take measure: trajectory and trajectory: {keep: drift}"),
        "transient": (
            "error",
            "take measure: error and error: {over: [t0, t1]}, from the change on, whose rows are "
            "window_error",
        ),
        "stopping": ("step-changes", "the page on studies says what `stop` can test"),
    }
)
