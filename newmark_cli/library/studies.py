"""Studies for notebooks: run one, get its rows, fit them and draw them."""

import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from newmark_cli.library import arguments
from newmark_cli.report.reading import records
from newmark_cli.study import axes, config, csv_files, csv_rows, showable
from newmark_cli.study import trajectories as kept
from newmark_cli.study.axis import ALIASES
from newmark_cli.study.config import Study
from newmark_cli.study.subjects import Surroundings
from newmark_cli.support.documents import Document
from newmark_cli.support.errors import ArgumentError, ExecutorError, InputError
from newmark_cli.support.processors import usable

if TYPE_CHECKING:
    import pandas as pd

    from newmark_cli.report.drawing.style import Drawing
    from newmark_cli.report.judging.slopes import Slope

#: Attribute of a frame: study → what its record says besides the rows, as JSON.
_RECORDS = "newmark-study records"
#: Attribute of a frame: study → its trajectories, as the text of their CSV.
_TRAJECTORIES = "newmark-study trajectories"
#: What of a record goes with a frame: the config says what is accepted and drawn.
_KEPT = ("study", "config", "motions", "not_unique")


def run(
    study: Any,
    *,
    results: str | Path | None = None,
    jobs: int | None = None,
    force: bool = False,
    timeout: float | None = None,
    allow_code: bool = False,
) -> "pd.DataFrame":
    """Run a study; the rows of its CSV.

    Cells that do not end well raise nothing: the column ``status`` says how each ended,
    as in the CSV.  Each call reads the files that the study names, once, before it runs.

    Args:
        study: A config file (``"mine.yaml"``), the name of a shipped config
            (``"pendulum-u"``), or a dict with the keys of a config.
        results: Folder in which the CSV, its record and finished cells are kept, as by
            ``newmark-study run``: the next run computes what is missing.  Nothing is kept if
            omitted.
        jobs: Cells that run side by side; one for each usable processor if omitted.
        force: Whether cells that are kept are computed again.
        timeout: Most wall time of a cell, and of loading a problem in Python (s).
        allow_code: Whether problems in Python may be loaded, which runs their code.

    Returns:
        A row for each cell and quantity, in the order of the CSV, with its columns; numbers
        are floats, what is empty is NaN.  `slopes` and `plot` take it, and `trajectories`
        where the study has ``measure: trajectory``.

    Raises:
        DocumentError: When the config cannot be used; names file and line, or the key.
        ArgumentError: For an argument of the wrong type.
        InputError: When the folder cannot be written or is in use.
        ProblemError: When a problem in Python changes while it runs.

    Examples:
        >>> import newmark_cli as newmark
        >>> frame = newmark.run({
        ...     "study": "swing", "problem": "pendulum", "form": "u-lambda",
        ...     "preconditioning": ["none", "optimal"], "h": [1e-2, 1e-3, 1e-4], "steps": 50,
        ... })
        >>> set(frame["status"]), sorted(set(frame["measure"]))
        ({'ok'}, ['condition', 'correction', 'physical_correction'])
    """
    from newmark_cli.running import runner

    options = runner.Options(
        jobs=usable() if jobs is None else arguments.count("jobs", jobs, 1),
        force=arguments.flag("force", force),
        timeout=None if timeout is None else arguments.positive("timeout", timeout, " of seconds"),
    )
    wanted = _study(study, arguments.flag("allow_code", allow_code), options.timeout)
    if results is not None and not isinstance(results, str | Path):
        raise ArgumentError(f"results must be a folder, given {arguments.shown(results)}")
    with tempfile.TemporaryDirectory(prefix="newmark-study-") as scratch:
        folder = Path(scratch if results is None else results)
        try:
            runner.run_studies([wanted], folder, options)
        except ExecutorError as error:
            raise InputError(str(error)) from error
        return _read(folder, wanted.study)


def _read(folder: Path, study: str) -> "pd.DataFrame":
    from newmark_cli.library.frames import Rows

    path = folder / f"{study}.csv"
    frame = Rows(csv_rows.read_study(path).reset_index(drop=True))
    record = records.known(path)
    record_kept = {key: record[key] for key in _KEPT if key in record}
    frame.attrs[_RECORDS] = {study: json.dumps(record_kept)}
    content = csv_files.read(path, series=True)[csv_files.trajectory_path(folder, study)]
    if not isinstance(content, OSError):
        frame.attrs[_TRAJECTORIES] = {study: content.decode()}
    return frame


def trajectories(given: Any, study: str | None = None) -> "pd.DataFrame":
    """Trajectories that the cells of a study kept, with ``measure: trajectory``.

    Args:
        given: Rows as `run` returns them, or a results folder.
        study: Name of the study; may be left out for rows.

    Returns:
        A row for each cell and step that was kept: what tells the cell from others
        (``problem``, ``integrator``, ``form``, ``preconditioning``, ``h`` and so on), ``step``,
        ``t`` (s), and the columns of ``Trajectory.to_frame``: ``u[A.x]``,
        ``lambda[bars.link]`` and so on, to the bit.  NaN where a problem lacks one.

    Raises:
        ArgumentError: When the rows have no trajectories, or no study is named.
        ResultsError: When the folder has none, or its file cannot be used.
        InputError: When it is Parquet, and pyarrow is not installed.

    Examples:
        >>> import newmark_cli as newmark
        >>> frame = newmark.run({
        ...     "study": "swing", "problem": "pendulum", "form": "u-lambda",
        ...     "preconditioning": "optimal", "h": [1e-2, 5e-3], "t_end": 1.0,
        ...     "measure": "trajectory", "trajectory": {"at": [0.5, 1.0], "keep": "lambda"},
        ... })
        >>> found = newmark.trajectories(frame)
        >>> found["step"].tolist(), found["lambda[bars.rod]"].round(2).tolist()
        ([50, 100, 100, 200], [-0.37, -1.43, -0.37, -1.43])
    """
    import pandas as pd

    if isinstance(given, pd.DataFrame):
        texts = given.attrs.get(_TRAJECTORIES, {})
        if not texts:
            raise ArgumentError("frame has no trajectories; run a study with measure: trajectory")
        name = next(iter(texts)) if study is None else arguments.one_of("study", study, texts)
        return kept.parse(Path("frame"), texts[name].encode())
    if not isinstance(given, str | Path):
        raise ArgumentError(f"give rows of run or a results folder, given {arguments.shown(given)}")
    if not isinstance(study, str):
        raise ArgumentError(f"study must be the name of one, given {arguments.shown(study)}")
    return kept.read(Path(given), study)


def slopes(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Fits of every series of a frame, and what theory says of them.

    Args:
        frame: Rows as `run` returns them, or some of them, or those of several studies.

    Returns:
        A row for each series with the columns of ``slopes.csv``: what tells it from others,
        ``slope`` and ``stderr`` of the fit over its asymptotic middle, ``points``, the
        ``expected`` order, ``tolerance``, ``verdict``, ``h_from`` and ``h_to`` of the fit (s),
        ``local_orders`` as text, and ``reason``.  What is empty is NaN.

    Raises:
        ArgumentError: When the frame has not the columns of a study.
        ResultsError: When a row has what no study has.

    Examples:
        >>> import newmark_cli as newmark
        >>> frame = newmark.run({
        ...     "study": "swing", "problem": "pendulum", "form": "u-lambda",
        ...     "preconditioning": "none", "h": [1e-3, 1e-4, 1e-5], "steps": 50,
        ... })
        >>> fits = newmark.slopes(frame)
        >>> condition = fits[fits["measure"] == "condition"].iloc[0]
        >>> print(round(condition["slope"], 1), condition["expected"], condition["verdict"])
        -4.0 -4.0 pass
    """
    import pandas as pd

    from newmark_cli.report.judging.slopes import COLUMNS

    rows = [slope.row() for slope in _fits(frame)[0]]
    return pd.DataFrame(rows, columns=axes.present(COLUMNS, rows))


def plot(
    frame: "pd.DataFrame",
    figure: int | str | None = None,
    *,
    size: float | tuple[float, float | None] | None = None,
    **choice: str,
) -> "Drawing":
    """Draw a figure of a study, as ``newmark-study plot`` does.

    Args:
        frame: Rows as `run` returns them.
        figure: Which: its place among those that the frame is enough for, from 0, or its
            name; the first if omitted.
        size: Width, or width and height (inch), from 1 to 40; as tall as it takes without a height.
        **choice: Draw only these: ``measure``, ``quantity``, ``form``, ``problem``,
            ``preconditioning`` or ``scaling``, ``integrator``, ``code``, or another axis.

    Returns:
        A figure of matplotlib, which a notebook shows and ``savefig`` writes.

    Raises:
        ArgumentError: If there is no such figure; names those there are.  Or for another size.
        InputError: When nothing can be drawn.

    Examples:
        >>> import newmark_cli as newmark
        >>> frame = newmark.run({
        ...     "study": "swing", "problem": "pendulum", "form": "u-lambda",
        ...     "preconditioning": ["none", "optimal"], "h": [1e-3, 1e-4, 1e-5], "steps": 50,
        ... })
        >>> figure = newmark.plot(frame, measure="condition")
        >>> len(figure.axes)
        1
    """
    from newmark_cli.report.drawing import draw
    from newmark_cli.report.drawing import plot as plotting
    from newmark_cli.report.drawing.sheets import Results, sheet
    from newmark_cli.report.reading.choosing import Choice

    sides = _sides(size)
    values: dict[str, tuple[str, ...]] = {}
    for given, value in choice.items():
        name = ALIASES.get(given, given)
        arguments.one_of("argument", name, ("measure", *showable.COMPARABLE))
        if not isinstance(value, str):
            raise ArgumentError(f"{name} must be text, given {arguments.shown(value)}")
        values[name] = (value,)
    fits, recorded = _fits(frame)
    data = Results(_NOWHERE, fits, in_memory=recorded)
    wanted = Choice(values.pop("measure", ()), values, everything=True)
    try:
        figures = plotting.chosen((), data, wanted).figures
    except InputError as error:
        raise ArgumentError(str(error).replace("--", "")) from None
    names = [plotting.stem(entry) for entry in figures]
    if not figures:
        raise ArgumentError("nothing to draw: no series has two step sizes")
    if isinstance(figure, str):
        place = names.index(arguments.one_of("figure", figure, names))
    else:
        place = 0 if figure is None else arguments.count("figure", figure)
    if place >= len(figures):
        raise ArgumentError(f"figure must be below {len(figures)}, given {place}")
    return draw.drawn(sheet(figures[place], data), sides)


def _sides(size: Any) -> tuple[float, float | None] | None:
    """Width and height (inch), if any, of a figure."""
    if size is None:
        return None
    given = size if isinstance(size, tuple | list) else (size, None)
    try:
        width, other = given
        width = arguments.number("size", width)
        height = None if other is None else arguments.number("size", other)
    except ValueError:
        width = height = math.nan
    if not all(1 <= side <= 40 for side in (width, width if height is None else height)):
        raise ArgumentError(
            "size must be a width, or a width and a height, from 1 to 40 inches, given "
            f"{arguments.shown(size)}"
        )
    return width, height


def _study(study: Any, allow_code: bool, timeout: float | None) -> Study:
    if isinstance(study, Mapping):
        document = Document.of("study", study)
        return config.parse(document, Surroundings(Path(), allow_code, timeout))
    if isinstance(study, str | Path):
        return config.find(str(study), allow_code, timeout)
    raise ArgumentError(f"a study must be a file, a name or a dict, given {arguments.shown(study)}")


#: The folder that messages name of rows in memory; nothing is read from it.
_NOWHERE = Path("frame")


def _fits(frame: Any) -> tuple[list["Slope"], dict[str, Any]]:
    """Series of a frame, and study → what its record says; rows are checked as those of a CSV."""
    import pandas as pd

    from newmark_cli.report.judging.slopes import study_slopes

    if not isinstance(frame, pd.DataFrame):
        raise ArgumentError(f"frame must be a DataFrame, given {arguments.shown(frame)}")
    lacking = [name for name in axes.present(csv_files.COLUMNS, ()) if name not in frame.columns]
    if lacking or frame.empty:
        why = f"lacks {', '.join(lacking)}" if lacking else "is empty"
        raise ArgumentError(f"frame must be rows of a study, as run returns them, but {why}")
    fits: list[Slope] = []
    recorded = {study: json.loads(of) for study, of in frame.attrs.get(_RECORDS, {}).items()}
    for study, rows in frame.groupby("study", sort=False):
        path = _NOWHERE / f"{study}.csv"
        lines = [{str(k): v for k, v in row.items()} for row in rows.to_dict("records")]
        text = csv_files.csv_text(axes.present(csv_files.COLUMNS, lines), lines)
        fits += study_slopes(csv_rows.read_rows(path, text.encode()), path, recorded.get(study, {}))
    return fits, recorded
