"""Run a notebook from top to bottom with the package that this Python has installed.

    python tests/verification/notebook.py docs/examples/library.ipynb

Every cell must end well, tables and figures must be shown inline, and nothing may be left in
the folder that it runs in.  The notebook stays as it is, without outputs.  Needs the extra
``notebook``.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError


def main() -> int:
    """Run it, and say what it showed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebook", type=Path)
    given = parser.parse_args().notebook
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
    if left or tables < 4 or figures < 2:
        print(f"{given}: shows too little, or left {left}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
