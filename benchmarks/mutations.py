"""Break the core in one place after another and see that a test fails each time.

Mutations: one more power of h in every entry of Table 2, every weight of every
form halved, and every sign in the three assemblers turned. Each runs in a copy of
the project, with the tests that should notice it.

    python benchmarks/mutations.py
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from newmark_cli.newmark.forms import FORMS, eliminate
from newmark_cli.newmark.integrator import FIELDS, Newmark

ROOT = Path(__file__).parents[1]
CORE = Path("newmark_cli/newmark")


class Mutation(NamedTuple):
    """One change: where, what, and who should notice."""

    name: str
    file: Path
    position: int
    old: str
    new: str
    tests: tuple[str, ...]


def table_2() -> Iterator[Mutation]:
    """Every factor of Table 2 times h."""
    file = CORE / "scaling.py"
    text = (ROOT / file).read_text()
    begin, end = text.index("TABLE_2: "), text.index("#: Entries of Table 2 as the scan")
    form = side = ""
    pattern = re.compile(r'"([\w-]+)": (?:"([^"]+)"|\{)')
    for match in pattern.finditer(text, begin, end):
        key, factor = match.groups()
        if key in FORMS:
            form = key
        elif factor is None:
            side = key
        else:
            yield Mutation(
                f"Table 2, {form}, {side} {key}: {factor} times h",
                file, match.start(2), factor, f"({factor})*h", ("tests/test_scaling.py",),
            )  # fmt: skip


def weights() -> Iterator[Mutation]:
    """Every weight of every form that is not 0, halved."""
    file = CORE / "forms.py"
    anchor = "    return Elimination(weights"
    position = (ROOT / file).read_text().index(anchor)
    for name, form in FORMS.items():
        found = eliminate(form, Newmark().relations(0.1)).weights
        for i, field in enumerate(FIELDS):
            for k, kept in enumerate(form.kept):
                if found[i, k] != 0:
                    change = f"    if form.name == {name!r}:\n        weights[{i}, {k}] /= 2\n"
                    yield Mutation(
                        f"form {name}, weight ∂{field}/∂{kept} halved",
                        file, position, anchor, change + anchor, ("tests/test_forms.py",),
                    )  # fmt: skip


def signs() -> Iterator[Mutation]:
    """Every sign in the literal assembler, in the kernel's and in the sparse one."""
    engines = ("tests/test_engines.py", "-k", "converge_alike or quadratic or per_step")
    for file, start, stop, tests, changes in (
        (CORE / "jacobian.py", "def four_field", "def form_blocks", ("tests/test_condition.py",
         "-k", "assembled"), (
            ('"u": terms.X', '"u": -terms.X'), ('"v": terms.Y', '"v": -terms.Y'),
            ('"a": relations.acc', '"a": -relations.acc'), ("-terms.G,", "terms.G,"),
            ('"v": identity', '"v": -identity'), ("-relations.v_from_a", "relations.v_from_a"),
            ('"u": identity', '"u": -identity'), ("-relations.u_from_a", "relations.u_from_a"),
            ("terms.G.T", "-terms.G.T"),
        )),
        (CORE / "kernel.py", "def _march", "_compiling", engines, (
            ("+= factor * problem.mass", "-= factor * problem.mass"),
            ("i] = factor\n", "i] = -factor\n"),
            ("+= x_factor", "-= x_factor"), ("+= y_factor", "-= y_factor"),
            ("+= gt_factor", "-= gt_factor"), ("-= g_factor", "+= g_factor"),
            ("force[i] - dynamic", "-force[i] - dynamic"),
            ("force[i] - dynamic", "force[i] + dynamic"),
            ("rhs[mass_rows[e]] -=", "rhs[mass_rows[e]] +="),
            ("-left[1 + r] * residual", "left[1 + r] * residual"),
            ("-left[1 + extra] * phi", "left[1 + extra] * phi"),
        )),
        (CORE / "scipy_march.py", "def residual", "def march", engines, (
            ("+ self.dynamic_history", "- self.dynamic_history"),
            ("- force,", "+ force,"),
            ("+ self.row_history", "- self.row_history"),
        )),
        (CORE / "sparse.py", "class SparseSystem", "def scaled_entries",
         ("tests/test_sparse.py",), (
            ("relations.acceleration[0] *", "-relations.acceleration[0] *"),
            ("[1.0, -rel", "[-1.0, -rel"),
            ("-relations.v_from_a", "relations.v_from_a"),
            ("-relations.u_from_a", "relations.u_from_a"),
            ("g_sources, -1.0", "g_sources, 1.0"),
            ("self._x.values(values.x)", "-self._x.values(values.x)"),
            ("self._y.values(values.y)", "-self._y.values(values.y)"),
            ("self._g.values(values.g)", "-self._g.values(values.g)"),
        )),
    ):  # fmt: skip
        text = (ROOT / file).read_text()
        for old, new in changes:
            position = text.index(old, text.index(start), text.index(stop, text.index(start)))
            label = f"{file.name}: {old.strip()} → {new.strip()}"
            yield Mutation(label, file, position, old, new, tests)


def passes(tests: tuple[str, ...], copy: Path) -> bool:
    """Whether the tests pass in the copy as it is."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        timeout=900,
    )
    return done.returncode == 0


def notices(mutation: Mutation, copy: Path) -> bool:
    """Whether the tests fail with the mutation in place."""
    target = copy / mutation.file
    original = target.read_text()
    end = mutation.position + len(mutation.old)
    assert original[mutation.position : end] == mutation.old
    target.write_text(original[: mutation.position] + mutation.new + original[end:])
    try:
        return not passes(mutation.tests, copy)
    finally:
        target.write_text(original)


def main() -> None:
    """Try all mutations, print a line for each, exit with 1 when one survives."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="only mutations whose name has this text")
    options = parser.parse_args()
    chosen = [m for m in (*table_2(), *weights(), *signs()) if options.only in m.name]
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".*", "__pycache__", "results", "build")
        )
        for tests in dict.fromkeys(mutation.tests for mutation in chosen):
            if not passes(tests, copy):
                sys.exit(f"{' '.join(tests)} fails without any mutation")
        for number, mutation in enumerate(chosen, start=1):
            noticed = notices(mutation, copy)
            print(f"{number:3} {'noticed ' if noticed else 'SURVIVED'} {mutation.name}", flush=True)
            if not noticed:
                survivors.append(mutation.name)
    print(f"{len(chosen)} mutations, {len(survivors)} survived")
    sys.exit(1 if survivors else 0)


if __name__ == "__main__":
    main()
