"""Linear systems of marches as files: a collection for those who write solvers.

A system is a folder with J̄, the right-hand side and the solution in Matrix Market format,
the solution's digits as text, and a record that says what the numbers are; see
docs/export.md.  The same export writes the same bytes.
"""

import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import scipy.io

from newmark_cli import __version__
from newmark_cli.mechanisms.spec import is_code, with_problem
from newmark_cli.newmark.forms import INDEX_3
from newmark_cli.newmark.linear import exact
from newmark_cli.newmark.linear.choice import AUTO
from newmark_cli.newmark.march import March
from newmark_cli.newmark.march_data import COMPLETED, ENDINGS
from newmark_cli.newmark.newton_systems import NewtonSystem, newton_systems
from newmark_cli.newmark.scheme import DIRECT
from newmark_cli.problems.problem import Problem
from newmark_cli.study import axes, config
from newmark_cli.study.axes import Cell
from newmark_cli.study.compute import scheme_of
from newmark_cli.study.keys import Surroundings
from newmark_cli.study.provenance import checksum
from newmark_cli.support import files
from newmark_cli.support.apart import ApartError
from newmark_cli.support.documents import Document
from newmark_cli.support.errors import InputError
from newmark_cli.support.spelling import nearest

#: What the index of a collection calls itself, and its version.
KIND, VERSION = "newmark-study linear systems", 1
INDEX, RECORD = "index.json", "system.json"
#: Files of a system.
MATRIX, RIGHT_HAND_SIDE, SOLUTION, DIGITS = "J.mtx", "b.mtx", "x.mtx", "x.txt"
_FILES = {MATRIX, RIGHT_HAND_SIDE, SOLUTION, DIGITS, RECORD}
_NAME = re.compile(r"[0-9]{5}-[A-Za-z0-9._=-]+")
_ABOUT = (
    "J.mtx times x equals b.mtx. x.mtx is the solution of the exact binary numbers, rounded to "
    f"double precision; x.txt has at least {exact.DIGITS} of its digits. rows and unknowns name "
    "the blocks in their order, with sizes and the factors that are in J already: "
    "J = D_L (Jacobian) D_R, b = -D_L (residual), correction = D_R x."
)
#: Systems of a collection are numbered with five digits, and each has five files.
MOST = 20_000
#: Steps of a march whose systems are written, where nobody says which.
USUAL = 5


@dataclass(frozen=True)
class Choice:
    """Which systems of a march."""

    #: these steps, the first being 1, ascending; without any see `every`
    steps: tuple[int, ...] = ()
    every: int | None = None  #: every so many steps; a handful, evenly spread, when omitted
    #: systems of all of Newton's iterations, not of the first and the last
    every_iteration: bool = False

    def of(self, cell: Cell) -> Sequence[int]:
        """Steps of a cell's march; raises InputError when it does not come to one of them."""
        last = cell.steps
        if self.steps:
            if self.steps[-1] > last:
                raise InputError(
                    f"step {self.steps[-1]} is past the last step: the march has {last} "
                    f"({axes.described(cell)})"
                )
            return self.steps
        if self.every is not None:
            if self.every > last:
                raise InputError(
                    f"every {self.every} steps leaves none: the march has {last} "
                    f"({axes.described(cell)})"
                )
            return range(self.every, last + 1, self.every)
        spread: list[int] = np.unique(np.rint(np.linspace(1, last, USUAL)).astype(int)).tolist()
        return spread


@dataclass
class Exported:
    """The result of an export."""

    systems: int = 0  #: how many were written
    marches: int = 0
    #: why marches have no systems that they might have had
    left_out: list[str] = field(default_factory=list)
    #: why marches ended before the last of the chosen steps
    ended: list[str] = field(default_factory=list)


class Watcher(Protocol):
    """Is told how an export goes on."""

    def planned(self, steps: int) -> None:
        """Steps that will be marched."""

    def marched(self, steps: int) -> None:
        """So many more were."""

    def written(self) -> None:
        """A system was written."""


def marches(cells: Sequence[Cell], exported: Exported) -> list[Cell]:
    """Cells whose systems can be exported, those of equal systems once."""
    chosen: dict[Cell, Cell] = {}
    without: dict[str, int] = {}
    for cell in cells:
        if cell.steps == 0:
            reason = "they measure at the initial state and solve no system"
        elif cell.precision != "float64":
            reason = (
                f"marches in {cell.precision} are solved inside the compiled kernel, whose "
                "systems cannot be exported"
            )
        else:
            # What is measured and reported changes no system.
            key = replace(cell, measure=(), samples=1, trajectory=None, multipliers=AUTO, accept=())
            chosen.setdefault(key, cell)
            continue
        without[reason] = without.get(reason, 0) + 1
    exported.left_out += [f"{count} cells left out: {why}" for why, count in without.items()]
    if not chosen:
        raise InputError("nothing to export: " + "; ".join(exported.left_out))
    return [*chosen.values()]


def write(
    cells: Sequence[Cell], folder: Path, choice: Choice, force: bool = False, *, watcher: Watcher
) -> Exported:
    """Write the systems of marches into a folder, all or nothing.

    The folder is made, or replaced if an export has written all that is in it; with ``force`` it
    may hold other files, which stay.
    """
    exported = Exported()
    chosen = {cell: choice.of(cell) for cell in marches(cells, exported)}
    least = sum(map(len, chosen.values()))
    if least > MOST:
        raise InputError(
            f"systems of {least} steps are more than {MOST}; choose fewer steps, step sizes, forms "
            "or scalings"
        )
    with files.new_folder(folder, INDEX, _is_ours, force) as new:
        watcher.planned(sum(steps[-1] for steps in chosen.values()))
        index: list[dict[str, Any]] = []
        for cell, steps in chosen.items():
            before = len(index)
            try:
                for system in _systems(cell, steps, choice.every_iteration, watcher):
                    _write_system(new, cell, system, index)
                    watcher.written()
            except _EndedError as ended:
                exported.ended.append(f"{axes.described(cell)}: {ended}")
            exported.marches += len(index) > before
        if not index:
            raise InputError("nothing to export: " + "; ".join(exported.ended))
        head = {
            "kind": KIND,
            "version": VERSION,
            "written_by": f"newmark-study {__version__}",
            "about": _ABOUT,
            "digits": exact.DIGITS,
        }
        files.write_new(new / INDEX, files.json_text({**head, "systems": index}))
    exported.systems = len(index)
    return exported


class _EndedError(Exception):
    """A march ended early; the text says how."""


def _systems(
    cell: Cell, steps: Sequence[int], every_iteration: bool, watcher: Watcher
) -> Iterator[NewtonSystem]:
    """Systems of a cell; raises _EndedError after the last if the march ends early."""
    ending: list[str] = []
    if is_code(cell.problem):
        try:
            systems, ending = with_problem(
                cell.problem, _collected, cell, tuple(steps), every_iteration
            )
        except ApartError as error:
            raise _EndedError(str(error)) from None
        watcher.marched(steps[-1])
        yield from systems
    else:
        yield from _observed(
            cell.problem.load(), cell, steps, every_iteration, watcher.marched, ending
        )
    if ending:
        raise _EndedError(ending[0])


def _collected(
    problem: Problem, cell: Cell, steps: Sequence[int], every_iteration: bool
) -> tuple[list[NewtonSystem], list[str]]:
    """All systems at once, for another process."""
    ending: list[str] = []
    systems = _observed(problem, cell, steps, every_iteration, lambda steps: None, ending)
    return [*systems], ending


def _observed(
    problem: Problem,
    cell: Cell,
    steps: Sequence[int],
    every_iteration: bool,
    on_steps: Callable[[int], None],
    ending: list[str],
) -> Iterator[NewtonSystem]:
    """Systems of a cell; why the march ended early, if it did, is appended to ``ending``."""
    march: March | None = None
    try:
        with np.errstate(all="ignore"):
            march = March(problem, scheme_of(cell), cell.linear_solver, cell.krylov)
        systems = newton_systems(march, steps, every_iteration, on_steps)
        while True:
            with np.errstate(all="ignore"):  # not of whoever takes the systems
                system = next(systems, None)
            if system is None:
                break
            yield system
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        where = f"in step {march.done + 1}" if march else "at the start"
        ending.append(f"no march {where}: {error}")
        return
    if march.ending != COMPLETED:
        ending.append(f"{ENDINGS[march.ending]} in step {march.done + 1}")


def _write_system(
    folder: Path, cell: Cell, system: NewtonSystem, index: list[dict[str, Any]]
) -> None:
    """Write a system, and append its entry to the index."""
    if len(index) == MOST:
        raise InputError(f"more than {MOST} systems; choose fewer steps or iterations")
    try:
        digits = system.solution()
    except np.linalg.LinAlgError as error:
        raise _EndedError(
            f"no solution in step {system.step}, iteration {system.iteration}: {error}"
        ) from None
    solution = np.array([float(value) for value in digits])
    if not np.all(np.isfinite(solution)):
        raise _EndedError(
            f"the solution in step {system.step}, iteration {system.iteration} is beyond double "
            "precision"
        )
    entry = _entry(f"{len(index) + 1:05d}-{_slug(cell, system)}", cell, system)
    entry["residual"] = system.residual(solution)
    contents = {
        MATRIX: _matrix_market(system.matrix, _comment(entry)),
        RIGHT_HAND_SIDE: _matrix_market(system.rhs[:, None]),
        SOLUTION: _matrix_market(solution[:, None]),
        DIGITS: "".join(f"{exact.text(value)}\n" for value in digits).encode(),
    }
    entry["sha256"] = {name: checksum(content) for name, content in contents.items()}
    own = folder / entry["name"]
    files.make_folder(own, folder)
    contents[RECORD] = files.json_text(entry).encode()
    for name, content in contents.items():
        files.write_new(own / name, content)
    index.append(entry)


def _entry(name: str, cell: Cell, system: NewtonSystem) -> dict[str, Any]:
    """The index's entry of a system."""

    def blocks(
        names: Sequence[str], factors: dict[str, float], formulas: Any
    ) -> list[dict[str, Any]]:
        return [
            {"name": block, "size": size, "factor": factors[block], "formula": str(formulas[block])}
            for block, size in zip(names, system.sizes, strict=True)
        ]

    scaling = system.scheme.scaling
    labels = {key: value for key, value in axes.labels(cell).items() if key not in ("h", "stop")}
    del labels["multipliers"]
    return {
        "name": name,
        **labels,
        "stop": cell.stop.label if cell.stop else axes.SATURATION,
        "h": system.h,
        "beta": system.beta,
        "gamma": system.gamma,
        "t": system.t,
        "step": system.step,
        "iteration": system.iteration,
        "iterations": system.iterations,
        "size": len(system.rhs),
        "nonzeros": int(system.matrix.nnz),
        "rows": blocks(system.rows, system.left, scaling.left),
        "unknowns": blocks(system.unknowns, system.right, scaling.right),
    }


def _comment(entry: dict[str, Any]) -> str:
    """Comment of a matrix, for readers without its record."""

    def sizes(blocks: list[dict[str, Any]]) -> str:
        return " ".join(f"{block['name']}:{block['size']}" for block in blocks)

    keys = ("problem", "integrator", "form", "formulation", "preconditioning")
    labels = json.dumps(", ".join(str(entry[key]) for key in keys), ensure_ascii=True)
    lines = [
        labels[1:-1][:500],  # lines of the format have at most 1024 characters
        f"rows {sizes(entry['rows'])}; unknowns {sizes(entry['unknowns'])}",
        f"h {entry['h']!r} beta {entry['beta']!r} gamma {entry['gamma']!r}",
        f"t {entry['t']!r} step {entry['step']} iteration {entry['iteration']} of "
        f"{entry['iterations']}",
    ]
    return "\n".join(f" {line}" for line in lines)


def _slug(cell: Cell, system: NewtonSystem) -> str:
    """Name of a system's folder, after its number."""
    labels = [
        str(axis.write(cell))
        for axis in axes.cell_axes()
        if axis.cell and axis.series and axis.name not in ("multipliers", "linear_solver")
        and str(axis.write(cell)) != axis.usual
    ]  # fmt: skip
    parts = [re.sub(r"[^A-Za-z0-9._=]+", "-", part).strip("-._")[:40] for part in labels]
    where = [f"h{system.h:g}", f"step{system.step}", f"iteration{system.iteration}"]
    return "-".join([*filter(None, parts), *where]).replace("+", "")


def _matrix_market(matrix: Any, comment: str = "") -> bytes:
    """A matrix in the shortest digits that round-trip."""
    file = io.BytesIO()
    scipy.io.mmwrite(file, matrix, comment=comment, symmetry="general")
    return file.getvalue()


def _is_ours(entry: Path) -> bool:
    """Whether an entry of a folder comes from an export, with nothing else inside."""
    if entry.is_symlink():
        return False
    if entry.name == INDEX:
        return files.read_mapping(entry).get("kind") == KIND
    if not (_NAME.fullmatch(entry.name) and entry.is_dir()):
        return False
    return all(
        part.name in _FILES and part.is_file() and not part.is_symlink() for part in entry.iterdir()
    )


# -- which marches -----------------------------------------------------------------------------

#: Axes that a command may choose along, and what a problem has where it does not.
CHOSEN: Mapping[str, tuple[Any, ...]] = MappingProxyType(
    {
        "form": ("u-lambda",),
        "preconditioning": ("none", "optimal"),
        "integrator": (axes.TRAPEZOIDAL,),
        "formulation": (INDEX_3,),
        "evaluation": (DIRECT,),
        "h": (1e-3, 1e-5, 1e-7),
    }
)
#: Steps of a problem's march where nobody says where it ends.
_STEPS = 100


def cells_of(
    subject: str,
    wanted: Mapping[str, Sequence[Any]],
    choice: Choice,
    t_end: float | None = None,
    allow_code: bool = False,
) -> list[Cell]:
    """Marches of a study, or of a problem, for values along the axes of `CHOSEN`.

    Of axes without values a study has all, and a problem those of `CHOSEN`.
    """
    values = {name: tuple(wanted.get(name, ())) for name in CHOSEN}
    if config.is_study(subject):
        if t_end is not None:
            raise InputError("t_end: the study says where its marches end; choose among its steps")
        return _filtered(config.find(subject, allow_code).cells(), values)
    last = max((*choice.steps, choice.every or 0, 0 if choice.steps else _STEPS))
    choices = {name: values[name] or usual for name, usual in CHOSEN.items()}
    data = {
        **{name: [*values] for name, values in choices.items()},
        "study": "export",
        "problem": config.problem_named(subject, allow_code),
        "measure": "correction",
        **({"steps": last} if t_end is None else {"t_end": t_end}),
    }
    document = Document.of("command line", data)
    return config.parse(document, Surroundings(Path(), allow_code)).cells()


def _filtered(cells: Sequence[Cell], wanted: Mapping[str, Sequence[Any]]) -> list[Cell]:
    """Cells of a study with the wanted values."""
    write = {axis.name: axis.write for axis in axes.cell_axes()}
    left = [*cells]
    for name, values in wanted.items():
        known = dict.fromkeys(write[name](cell) for cell in cells)
        for value in values:
            if not any(_same(value, label) for label in known):
                text, *names = (
                    f"{label:g}" if isinstance(label, float) else str(label)
                    for label in (value, *known)
                )
                raise InputError(f"{name}: {text!r} is not among the study's{nearest(text, names)}")
        if values:
            left = [cell for cell in left if any(_same(v, write[name](cell)) for v in values)]
    if not left:
        raise InputError("no cell of the study has all that was asked for")
    return left


def _same(wanted: Any, known: Any) -> bool:
    """Whether a label matches a wanted value; an own scaling matches by its name."""
    if isinstance(known, float):
        return math.isclose(wanted, known, rel_tol=1e-9)
    return bool(wanted == known or str(known).startswith(f"{wanted}["))
