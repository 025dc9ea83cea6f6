"""Tables as files hold them: text of any separator, Parquet, arrays of NumPy and of MATLAB.

The numbers of text stay text: parsers of tables lose last digits, and digits are counted.
"""

import gzip
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from newmark_cli.support import files
from newmark_cli.support.arrays import Array, shown
from newmark_cli.support.errors import ArgumentError, InputError, described
from newmark_cli.support.spelling import nearest

if TYPE_CHECKING:
    import pandas as pd

#: Lines that begin with one of these are comments.
_COMMENT = "#%"
#: Separators, the first that the first line has counts; of lines without any these are blanks.
_SEPARATORS = ("\t", ";", ",")
#: What Fortran writes before an exponent, or leaves out where it has three digits.
_EXPONENT = re.compile(r"(?<=[\d.])(?:[dDqQ](?=[-+]?\d+$)|(?=[-+]\d{3}$))")
#: Columns of a long table, which has a row for each number.
_QUANTITY, VALUE = ("quantity", "variable", "name"), "value"


def table(source: Any, names: dict[str, Any]) -> tuple["pd.DataFrame", str]:
    """A table with rows and a column for each quantity, and what errors call it.

    Args:
        source: A DataFrame, or the path of a file.
        names: ``quantity`` and ``value`` → columns of a long table that has other names for them.
            Both are taken out.

    Returns:
        The table, whose index is called "line" or "row" and has their numbers; and its name.

    Raises:
        ArgumentError: When the file cannot be read, has no row, or has a column or value twice.
    """
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        frame, where = source, "table"
    else:
        frame, where = _file(Path(source)), str(source)
    frame = frame.set_axis([str(name).strip() for name in frame.columns], axis=1)
    if not len(frame):
        raise ArgumentError(f"{where}: no row")
    if where == "table" or frame.index.name not in ("line", "row"):
        frame.index = pd.RangeIndex(1, len(frame) + 1, name="row")
    _require_different(frame, where)
    frame = _wide(frame, names, where)
    _require_different(frame, where)
    return frame, where


def _require_different(frame: "pd.DataFrame", where: str) -> None:
    if frame.columns.duplicated().any():
        twice = frame.columns[frame.columns.duplicated()][0]
        raise ArgumentError(f"{where}: column {twice} is there twice")


def line(frame: "pd.DataFrame", place: int) -> str:
    """What a row of a table is called."""
    return f"{frame.index.name} {frame.index[place]}"


def numbers(frame: "pd.DataFrame", name: str, where: str) -> Array:
    """(rows,) numbers of a column; NaN where it is empty, or says that there is none.

    Raises:
        ArgumentError: Where there is another word; names the line.
    """
    values = frame[name].to_numpy()
    try:
        return np.asarray(values, object).astype(float)
    except (ValueError, TypeError):
        pass  # where some are empty, words, or Fortran's
    found = np.full(len(values), np.nan)
    for place, value in enumerate(values):
        text = str(value).strip()
        # "nan" is in all that C writes for numbers that are none, such as -nan(ind).
        if not text or text == "None" or "nan" in text.lower():
            continue
        if not is_number(text):
            at = line(frame, place)
            raise ArgumentError(f"{where}: {name}, {at}: not a number, given {text!r}")
        found[place] = float(_EXPONENT.sub("e", text))
    return found


def is_number(text: str) -> bool:
    """Whether a text is a number, as Python or Fortran writes it."""
    try:
        float(_EXPONENT.sub("e", text))
    except ValueError:
        return False
    return True


def _wide(frame: "pd.DataFrame", names: dict[str, Any], where: str) -> "pd.DataFrame":
    """A table with a column for each quantity, of one that may have a row for each."""
    import pandas as pd

    for key in ("quantity", VALUE):
        if key in names and names[key] not in frame:
            raise ArgumentError(
                f"columns: {key}: {where} has no column {shown(names[key])}"
                f"{nearest(names[key], frame.columns)}"
            )
    quantity = names.pop("quantity", next((n for n in _QUANTITY if n in frame), None))
    value = names.pop(VALUE, VALUE)
    if quantity not in frame or value not in frame:
        return frame
    numbers(frame, value, where)  # names the line of what is no number
    others = [name for name in frame if name not in (quantity, value)]
    again = frame.duplicated([*others, quantity]).to_numpy()
    if again.any():
        at = int(again.argmax())
        raise ArgumentError(
            f"{where}, {line(frame, at)}: a second {value} of {frame[quantity].iloc[at]}"
        )
    group = frame.groupby(others, sort=False, dropna=False).ngroup() if others else 0
    rows = pd.DataFrame({"group": group, "name": frame[quantity], VALUE: frame[value]})
    rows["name"] = rows["name"].astype(str).str.strip()
    found = rows.pivot(index="group", columns="name", values=VALUE)
    first = frame.drop_duplicates(others) if others else frame[:1]
    return pd.concat([first[others], found.set_axis(first.index, axis=0)], axis=1)


def _file(path: Path) -> "pd.DataFrame":
    import pandas as pd
    from scipy.io import loadmat

    try:
        content = files.read(path, given=True)
        if path.suffix == ".parquet":
            files.require_parquet(f"{path}:")
            return pd.read_parquet(io.BytesIO(content))
        if path.suffix == ".npy":
            array = np.load(io.BytesIO(content), allow_pickle=False)
            return _of_arrays(_fields(array) if array.dtype.names else {"#": array})
        if path.suffix == ".mat":
            found = loadmat(cast(Any, io.BytesIO(content)), squeeze_me=True)
            arrays = {name: array for name, array in found.items() if not name.startswith("__")}
            only = np.asarray(next(iter(arrays.values()), 0))
            return _of_arrays(_fields(only) if only.dtype.names else arrays)
        return _of_text(gzip.decompress(content) if path.suffix == ".gz" else content, path)
    except OSError as error:
        raise ArgumentError(f"{path}: cannot be read: {error.strerror or error}") from None
    except InputError:
        raise
    except Exception as error:  # readers of damaged files raise whatever they meet
        raise ArgumentError(f"{path}: not a table: {described(error)}") from None


def _fields(array: Any) -> dict[str, Any]:
    """Fields of a structured array, or of a structure of MATLAB, which has arrays in them."""
    return {name: np.array(array[name].tolist()) for name in array.dtype.names}


def _of_arrays(arrays: Mapping[str, Any]) -> "pd.DataFrame":
    """A table of columns; a matrix has several, which are numbered, and a number is repeated."""
    import pandas as pd

    columns: dict[str, Any] = {}
    for name, array in arrays.items():
        if np.ndim(array) == 2:
            columns |= {f"{name}{k}": values for k, values in enumerate(array.T, 1)}
        else:
            columns[name] = array
    lengths = {len(values) for values in columns.values() if np.ndim(values)}
    if len(lengths) != 1:
        raise ValueError(f"arrays of {', '.join(map(str, sorted(lengths))) or 'no'} rows")
    rows = lengths.pop()
    return pd.DataFrame({name: np.broadcast_to(values, rows) for name, values in columns.items()})


def _of_text(content: bytes, path: Path) -> "pd.DataFrame":
    """A table of text: comments and empty lines left out, blanks, tabs, ``;`` or ``,`` between."""
    import pandas as pd

    marked = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = content.decode("utf-16" if marked else "utf-8-sig", errors="replace")
    comments: list[str] = []
    kept: dict[int, str] = {}
    for number, written in enumerate(re.split(r"\r\n|\r|\n", text), 1):
        stripped = written.strip()
        if stripped.startswith(tuple(_COMMENT)):
            comments += [] if kept else [stripped.lstrip(f"{_COMMENT} \t")]
        elif stripped.strip(",;"):
            kept[number] = written
    if not kept or "\0" in text:
        raise ArgumentError(f"{path}: not a table: {'it is no text' if kept else 'no line'}")
    lines = [*kept]
    first = kept[lines[0]]
    separator = next((sign for sign in _SEPARATORS if sign in first), r"\s+")
    if separator == r"\s+":  # a unit in brackets belongs to its name
        kept[lines[0]] = re.sub(r"\s+(?=[\[(])", "", first)
    try:
        rows = pd.read_csv(
            io.StringIO("\n".join(kept.values())), sep=separator, header=None, dtype=str,
            keep_default_na=False, skipinitialspace=True,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found is None:
            raise
        raise ArgumentError(
            f"{path}, line {lines[int(found[2]) - 1]}: {found[3]} columns, and {found[1]} in the "
            f"first line, which is line {lines[0]}"
        ) from None
    if separator != ",":  # which may then be the decimal sign
        rows = rows.replace(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$", r"\1.\2", regex=True)
    # A text in quotation marks may have line ends, and lines cannot be told then.
    whole = len(rows) == len(lines)
    rows.index = pd.Index(lines if whole else range(len(rows)), name="line" if whole else "row")
    head = [str(name).strip() for name in rows.iloc[0]]
    if not all(map(is_number, head)):
        rows = rows.iloc[1:]
    else:
        head = _named_in(comments, separator, len(head)) or [f"#{k + 1}" for k in range(len(head))]
    kept_columns = [k for k, name in enumerate(head) if name or rows[k].str.strip().any()]
    return rows[kept_columns].set_axis([head[k] or f"#{k + 1}" for k in kept_columns], axis=1)


def _named_in(comments: Sequence[str], separator: str, count: int) -> list[str] | None:
    """Names of so many columns from the last comment that has them."""
    for comment in reversed(comments):
        for sign in (separator, r"[\s,;]+"):
            names = [name.strip() for name in re.split(sign, comment)]
            if len({*names}) == count == len(names) and not any(map(is_number, names)):
                return names
    return None
