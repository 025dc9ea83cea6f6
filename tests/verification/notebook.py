"""Run notebooks from top to bottom with the package that this Python has installed.

    python tests/verification/notebook.py docs/examples/*.ipynb

Every cell must end well, tables and figures must be shown inline, and nothing may be left in
the folder that a notebook runs in.  The notebooks stay as they are, without outputs.  Needs
the extra ``notebook``.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError

#: Notebook → least number of tables and of figures that it shows.
SHOWN = {"library.ipynb": (4, 2), "paper.ipynb": (3, 2), "cures.ipynb": (1, 1)}


def main() -> int:
    """Run them, and say what they showed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebook", type=Path, nargs="+")
    return max(run(given) for given in parser.parse_args().notebook)


def run(given: Path) -> int:
    """Run one, and say what it showed; 1 where something is wrong."""
    notebook = nbformat.read(given, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    if any(cell.outputs or cell.execution_count for cell in code):
        print(f"{given}: has outputs; strip them", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as away:
        client = NotebookClient(
            notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": away}}
        )
        try:
            client.execute()
        except (CellExecutionError, CellTimeoutError) as error:
            print(f"{given}: {error}", file=sys.stderr)
            return 1
        left = sorted(path.name for path in Path(away).iterdir())
    kinds = [kind for cell in code for out in cell.outputs for kind in out.get("data", {})]
    tables, figures = kinds.count("text/html"), kinds.count("image/png")
    print(f"{given}: {len(code)} cells, {tables} tables, {figures} figures")
    least_tables, least_figures = SHOWN.get(given.name, (0, 2))
    if left or tables < least_tables or figures < least_figures:
        print(f"{given}: shows too little, or left {left}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
