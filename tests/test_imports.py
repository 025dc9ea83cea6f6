"""The structure of the package: imports run downward only, those within functions too."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import newmark_cli

PACKAGE = Path(newmark_cli.__file__).parent
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in PACKAGE.rglob("*.py")
}


def imported(path):
    """Modules of the package that a module imports, but for those that only types need."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body.clear()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for name in node.names:
                whole = f"{node.module}.{name.name}"
                yield whole if whole in MODULES else node.module
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def test_imports_have_no_circle():
    """A circle raises, and is named."""
    graph = {name: {*imported(path)} & MODULES.keys() for name, path in MODULES.items()}
    order = list(TopologicalSorter(graph).static_order())
    assert order.index("newmark_cli.errors") < order.index("newmark_cli.newmark.kernel")
    assert len(order) == len(MODULES)
