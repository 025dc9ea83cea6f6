"""The structure of the package: imports run downward only, those within functions too."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import newmark_cli

PACKAGE = Path(newmark_cli.__file__).parent
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in PACKAGE.rglob("*.py")
}
#: Public names → the modules that they are imported from, when they are first used.
HOMES = {f"{PACKAGE.name}.{n}": f"{PACKAGE.name}.{home}" for n, home in newmark_cli._HOMES.items()}


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
                yield whole if whole in MODULES else HOMES.get(whole, node.module)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def room(module):
    """The folder of a module in the package; the report has several rooms."""
    folder = MODULES[module].parent.relative_to(PACKAGE).parts
    if module == PACKAGE.name:
        return "the public names"
    return "/".join(folder[: 1 + (folder[:1] == ("report",))])


@cache
def graph():
    """Module → the modules that it imports."""
    return {name: {*imported(path)} & MODULES.keys() for name, path in MODULES.items()}


def test_imports_have_no_circle():
    """A circle raises, and is named."""
    order = list(TopologicalSorter(graph()).static_order())
    assert len(order) == len(MODULES)


def test_rooms_have_no_circle():
    """So a room can be read with those below it only."""
    rooms = {}
    for module, others in graph().items():
        rooms.setdefault(room(module), set()).update(map(room, others))
    for name, below in rooms.items():
        below.discard(name)
    order = list(TopologicalSorter(rooms).static_order())
    assert order.index("support") < order.index("problems") < order.index("newmark")
    assert order.index("newmark") < order.index("study") < order.index("report/judging")
    assert order.index("report/judging") < order.index("report/drawing") < order.index("cli")
